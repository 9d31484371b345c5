"""Intervals of trees of tests hold as often as they say; known answer: a long count of plain tests."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from hand_built import setting_of

from cornerforge.ndd.model import NddModel
from cornerforge.pipeline.av_file import av_of
from cornerforge.rates.teaching import plan_of, teach
from cornerforge.rates.trees import grow
from cornerforge.rates.weighted import always_valid_half_width, weighted_rate
from cornerforge.sim import n_slots, simulate
from cornerforge.types import Odd

REPETITIONS, TREES = 1_000, 4_000
PLAIN = 4_000_000
ODD = Odd(n_lanes=2)


@pytest.mark.slow
@pytest.mark.parametrize("av", ["idm-mobil", "idm-mobil-blind"])
def test_95_percent_intervals_hold_in_92_to_98_percent(
    av: str, model: NddModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    teaching = importlib.import_module("cornerforge.rates.teaching")
    for name, value in {"_EXPLORING": 1_000, "_ROUNDS": (2_000, 4_000), "_STEPS": 1_000}.items():
        monkeypatch.setattr(teaching, name, value)
    memory, often = replace(model.memory, away=0.02, away_again=0.5), np.full(21, 0.05, dtype=np.float32)
    careless = replace(model, memory=memory, lc_base=often, overlook=0.1, overlook_conflict=0.1)
    run = setting_of(careless, ODD, av=av_of(av))
    slots = n_slots(ODD)
    plain = simulate(run, slots, seed=9, tests=PLAIN, threads=2)
    truth = plain.av_crashes / plain.tests
    known_to = (truth / PLAIN) ** 0.5

    taught = teach(run, slots, seed=1, threads=2)
    plan = plan_of(taught.network, 0.5 * taught.level)
    grown = grow(run, slots, plan, seed=5, first=0, tests=REPETITIONS * TREES, threads=2)
    assert grown.roots["lost"].sum() == 0
    weights = grown.roots["weight"].reshape(REPETITIONS, TREES)
    rates = [weighted_rate(part) for part in weights]
    effective, error = np.mean([rate.effective for rate in rates]), np.mean([rate.error for rate in rates])
    holds = np.mean([rate.low <= truth <= rate.high for rate in rates])
    print(f"{av}: {truth:.3g} +- {known_to:.1g}, error {error:.2g}, {effective:.0f} effective, {holds:.3f} hold")
    assert known_to < 0.25 * error, "the known answer must be known much better than an interval is wide"
    assert 0.92 <= holds <= 0.98

    # However often one looks
    looks = np.linspace(TREES // 5, TREES, 20).astype(int)
    always = 0
    for part in weights:
        sofar = [weighted_rate(part[:n]) for n in looks]
        always += all(abs(rate.rate - truth) <= always_valid_half_width(rate) for rate in sofar)
    print(f"{av}: {always / REPETITIONS:.3f} hold at all of 20 looks")
    assert always / REPETITIONS >= 0.93

    # Negative controls: weights 5 % wrong are seen in all trees together, and most intervals say so less often
    pooled = weighted_rate(grown.roots["weight"])
    off = np.hypot(pooled.error, known_to)
    assert abs(pooled.rate - truth) < 5.0 * off
    assert abs(1.05 * pooled.rate - truth) > 3.0 * off
    wrong = np.mean([1.3 * rate.low <= truth <= 1.3 * rate.high for rate in rates])
    assert wrong < 0.92
