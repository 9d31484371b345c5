"""Distance that the BVs drive, from a counted sample of tests: it turns BV-BV crashes into a rate per mile.

Bulk simulation does not count the distance of BVs, because that costs speed. The sample's mean is exact to a fraction
of a percent, because it is a mean over thousands of tests of some tens of vehicles each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cornerforge._checks import check_integer
from cornerforge.errors import InputError
from cornerforge.sim import Setting, runner, statistics
from cornerforge.types import FRAME_S, METRES_PER_MILE

__all__ = ["SAMPLE_TESTS", "BvTravel", "bv_travel"]

SAMPLE_TESTS = 4096
"""Tests that are counted; the mean is then good to about 0.3 %."""
_GROUP = 64


@dataclass(frozen=True)
class BvTravel:
    """Distance that all BVs of a test drive together, in the mean.

    Attributes:
        miles_per_test: Mean [miles].
        relative_error: Standard error of the mean over the mean; None with fewer than two groups of 64 tests.
        tests: Size of the sample.
    """

    miles_per_test: float
    relative_error: float | None
    tests: int


def bv_travel(
    setting: Setting,
    slots: int,
    *,
    seed: int,
    tests: int = SAMPLE_TESTS,
    threads: int = 1,
    drive: runner.DriveChunk = runner.drive_chunk,
) -> BvTravel:
    """Drive tests 0 .. `tests` - 1 of a seed with counting on, and take the mean distance of all BVs.

    Speed times one second is counted at every decision; a test ends within a second, so the sum is scaled by the ratio
    of the time driven to the seconds counted.

    Args:
        setting, slots: The run and its vehicle slots per world.
        seed: Seed of the tests.
        tests: How many, at least 1.
        threads: Pool size; does not change the result.
        drive: Function that drives a chunk (`sim.runner.simulate`).

    Raises:
        InputError: A number is out of range.
    """
    check_integer("tests", tests, low=1)
    if setting.who.critical:
        raise InputError("The distance of BVs is asked for natural traffic; this run has an adversary.")
    millimetres, driven, counted = [], 0.0, 0
    for _, outcomes, counts in runner.simulate_chunks(
        setting, slots, seed=seed, first=0, tests=tests, threads=threads, counting=True, chunk=_GROUP, drive=drive
    ):
        millimetres.append(int(counts.totals[statistics.BV_TRAVEL_MM]))
        driven += float(outcomes.frame.sum(dtype=np.int64)) * FRAME_S
        counted += int(outcomes.decisions.sum(dtype=np.int64))
    scale = driven / counted / 1000.0 / METRES_PER_MILE if counted else 0.0
    whole = np.array(millimetres[: tests // _GROUP], dtype=np.float64)
    error = None
    if whole.size > 1 and whole.mean() > 0.0:
        error = float(whole.std(ddof=1) / math.sqrt(whole.size) / whole.mean())
    return BvTravel(sum(millimetres) * scale / tests, error, tests)
