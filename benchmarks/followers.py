"""Why natural crashes come early in a test: the AV's follower, and how often it brakes hard, second by second.

    .venv/bin/python benchmarks/followers.py --tests 12000

Prints shares with exact 95 % intervals, for `idm-mobil` in natural traffic of the default ODD.
"""

from __future__ import annotations

import argparse

import numpy as np
from measuring import table

from cornerforge.experiment.setting import experiment
from cornerforge.rates import binomial_interval
from cornerforge.types import Scenario

_SECONDS = 12
_CLOSE_S = (0.5, 0.3)
_HARD_MPS2 = -3.0
_SAME_LANE_M = 2.0


def time_gap_behind(scenario: Scenario, frame: int) -> float:
    """Time gap [s] of the nearest BV behind the AV within 2 m sideways; infinite if there is none."""
    behind = scenario.x[frame, 0] - scenario.x[frame]
    there = scenario.present[frame] & (np.abs(scenario.y[frame] - scenario.y[frame, 0]) < _SAME_LANE_M) & (behind > 0.0)
    if not there.any():
        return float("inf")
    nearest = int(np.argmin(np.where(there, behind, np.inf)))
    return float((behind[nearest] - scenario.odd.vehicle_length) / max(scenario.speed[frame, nearest], 1.0))


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(
        description="Who follows the AV, and how often it brakes hard, by time into a test."
    )
    parser.add_argument("--tests", type=int, default=12_000)
    parser.add_argument("--lanes", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    recorder = experiment(av="idm-mobil", lanes=given.lanes).recorder()
    close, hard, alive = np.zeros((len(_CLOSE_S), _SECONDS), int), np.zeros(_SECONDS, int), np.zeros(_SECONDS, int)
    for test in range(given.tests):
        scenario = recorder.record(given.seed, test)
        for second in range(min(_SECONDS, (len(scenario.x) - 1) // 10)):
            gap = time_gap_behind(scenario, 10 * second)
            alive[second] += 1
            close[:, second] += [gap < limit for limit in _CLOSE_S]
            hard[second] += bool((scenario.acceleration[10 * second : 10 * second + 10, 0] <= _HARD_MPS2).any())
    rows = [
        [f"{second} s", *(_share(n[second], alive[second]) for n in (*close, hard))]
        for second in range(_SECONDS)
        if alive[second]
    ]
    print(table(["time", *(f"BV less than {limit} s behind" for limit in _CLOSE_S), "AV brakes hard"], rows))


def _share(n: int, whole: int) -> str:
    low, high = binomial_interval(int(n), int(whole))
    return f"{100 * n / whole:.2f} % ({100 * low:.2f} to {100 * high:.2f})"


if __name__ == "__main__":
    main()
