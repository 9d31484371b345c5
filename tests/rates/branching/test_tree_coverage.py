"""Intervals of trees of tests, stopped as `rate` stops, hold as often as they say."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge.experiment.av_file import av_of
from cornerforge.ndd.model import NddModel
from cornerforge.rates.branching.drive import drive_trees
from cornerforge.rates.teaching import plan_of, teach
from cornerforge.rates.weighted import always_valid_interval, weighted_rate
from cornerforge.sim import n_slots, simulate

TREES, BLOCK, TARGET = 1_000_000, 1_000, 0.3
PLAIN = 1_000_000
ODD = replace(WIDE, n_lanes=2)
SIGMAS = 5.0


def stopped(weights: np.ndarray) -> list[tuple[float, float]]:
    """Intervals of runs one after the other, each stopped after a block without doubts at the target."""
    found, first, end = [], 0, BLOCK
    while end <= weights.size:
        rate = weighted_rate(weights[first:end])
        low, high = always_valid_interval(rate)
        if not rate.doubts and 0.5 * (high - low) <= TARGET * rate.rate:
            found.append((low, high))
            first = end
        end += BLOCK
    return found


@pytest.mark.slow
def test_intervals_of_stopped_runs_hold(model: NddModel, monkeypatch: pytest.MonkeyPatch) -> None:
    teaching = importlib.import_module("cornerforge.rates.teaching")
    for name, value in {"_EXPLORING": 2_000, "_ROUNDS": (4_000, 8_000, 8_000), "_STEPS": 2_000}.items():
        monkeypatch.setattr(teaching, name, value)
    memory, often = replace(model.memory, away=0.02, away_again=0.5), np.full(21, 0.05, dtype=np.float32)
    careless = replace(model, memory=memory, lc_base=often, overlook=0.1, overlook_conflict=0.1)
    run = setting_of(careless, ODD, av=av_of("idm-mobil"))
    slots = n_slots(ODD)
    taught = teach(run, slots, seed=1, threads=2)
    plan = plan_of(taught.network, taught.level)
    weights = drive_trees(run, slots, plan, seed=5, first=0, tests=TREES, threads=2).trees["weight"]

    # All trees together give the rate that counting gives, and would not with weights 20 % wrong.
    counted = simulate(run, slots, seed=9, tests=PLAIN, threads=2)
    rate = counted.av_crashes / PLAIN
    whole = weighted_rate(weights)
    off = np.hypot(whole.error, (rate / PLAIN) ** 0.5)
    assert abs(whole.rate - rate) < SIGMAS * off
    assert off < 0.07 * rate

    # All trees together know the rate much better than one stopped run.
    runs = stopped(weights)
    n, holds = len(runs), np.mean([low <= whole.rate <= high for low, high in runs])
    print(
        f"{n} runs of {TREES // n} trees: {holds:.3f} hold; {whole.rate:.3g} +- {whole.error:.1g}, counted {rate:.3g}"
    )
    assert whole.error < 0.1 * np.mean([0.5 * (high - low) for low, high in runs])
    assert n >= 50
    assert holds >= 0.95 - 3.0 * (0.95 * 0.05 / n) ** 0.5

    # Weights 30 % wrong do not hold.
    assert np.mean([1.3 * low <= whole.rate <= 1.3 * high for low, high in runs]) < 0.75
