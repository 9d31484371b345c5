"""Worlds of a wished size, and what a rate of world-steps counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.road.straight import road_numbers
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import simulate_chunks
from cornerforge.sim.world import n_slots

__all__ = ["SEED", "driven_seconds", "mean_bvs", "with_bvs", "with_length"]

SEED = 0


def driven_seconds(run: Experiment, tests: int) -> float:
    """Seconds of traffic in the first tests of the seed: what a rate of world-steps counts."""
    chunks = simulate_chunks(run.setting, run.slots, seed=SEED, first=0, tests=tests, threads=1)
    return sum(int(outcomes.frame.sum()) for _, outcomes, _ in chunks) / 10.0


def mean_bvs(run: Experiment, tests: int) -> float:
    """Mean number of BVs over all recorded frames of some tests."""
    recorder = Recorder(run.setting, run.odd)
    scenarios = [recorder.record(SEED, test) for test in range(tests)]
    there = sum(np.count_nonzero(s.present[:, 1:]) for s in scenarios)
    return there / sum(len(s.present) for s in scenarios)


def with_length(run: Experiment, metres: float) -> Experiment:
    """The same run with traffic on so many metres, the AV as far along it as before."""
    odd = replace(run.odd, traffic_length=metres, av_start=metres * run.odd.av_start / run.odd.traffic_length)
    return replace(run, odd=odd, setting=run.setting._replace(road=road_numbers(odd)), slots=n_slots(odd))


def with_bvs(bvs: int, *, lanes: int = 3, tests: int = 50) -> tuple[Experiment, float]:
    """A world that holds about so many BVs, at the usual density on a shorter or longer road, and its mean number."""
    run = experiment(lanes=lanes)
    found = mean_bvs(run, tests)
    for _ in range(2):
        run = with_length(run, min(5000.0, max(60.0, run.odd.traffic_length * bvs / max(found, 1.0))))
        found = mean_bvs(run, tests)
    return run, found
