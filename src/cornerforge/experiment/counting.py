"""Driving and counting the tests of an experiment, and result objects with units and intervals."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, get_args

from cornerforge._checks import check_integer
from cornerforge.experiment.experiments import Experiment
from cornerforge.foreign.session import answers_per_test
from cornerforge.intervals import binomial_interval
from cornerforge.results import Simulated, from_json
from cornerforge.results.driving import Distributions, Quantity, TtcLimit
from cornerforge.results.rates import Interval, Rate
from cornerforge.sim import Tally, outcome, runner, statistics
from cornerforge.types import METRES_PER_MILE
from cornerforge.work.progress import NO_PROGRESS, Progress, moving

__all__ = [
    "CHUNK", "distributions_of", "drive_tests", "rate_of", "rate_summary", "simulate_experiment", "tally_summary",
]  # fmt: skip

CHUNK = 512
"""Tests in a range that one thread drives, unless the AV is slow."""


def rate_summary(crashes: int, tests: int, miles: float, *, at_site: bool = False) -> Rate:
    """Make a crash rate per test and per mile, with n and exact 95 % intervals; `at_site`: in a site's units too."""
    return rate_of(crashes / tests, binomial_interval(crashes, tests), tests, miles, tests, at_site=at_site)


def rate_of(
    per_test: float, interval95: Interval, tests: int, miles: float, driven: int, *, at_site: bool = False
) -> Rate:
    """Make a crash rate per test, with its interval and n, one per mile too: `driven` tests had so many miles.

    `at_site`: per million entering vehicles and per vehicle-kilometre too.
    """
    low, high = interval95
    per_km = driven / (miles * METRES_PER_MILE / 1000.0) if at_site and miles > 0.0 else None
    per_mile = driven / miles if miles > 0.0 else None
    return Rate(
        tests=tests,
        crashes_per_test=per_test,
        interval95=(low, high),
        crashes_per_mile=None if per_mile is None else per_test * per_mile,
        interval95_per_mile=None if per_mile is None else (low * per_mile, high * per_mile),
        miles=miles,
        crashes_per_million_entering=1e6 * per_test if at_site else None,
        interval95_per_million_entering=(1e6 * low, 1e6 * high) if at_site else None,
        crashes_per_vehicle_km=None if per_km is None else per_test * per_km,
        interval95_per_vehicle_km=None if per_km is None else (low * per_km, high * per_km),
    )


def distributions_of(counts: statistics.Counts) -> Distributions:
    """Describe the traffic of BVs by the distributions in its counts."""
    quantities: dict[str, Any] = {
        grid.name: from_json(
            Quantity, {"unit": grid.unit, **statistics.histogram_summary(grid, counts.histograms[row])}
        )
        for row, grid in enumerate(statistics.TRAFFIC)
    }
    totals = counts.totals
    following, states = int(totals[statistics.FOLLOWING_STATES]), int(totals[statistics.BV_STATES])
    miles = int(totals[statistics.BV_TRAVEL_MM]) / 1000.0 / METRES_PER_MILE
    return Distributions(
        **quantities,
        ttc_share_below={
            limit: int(totals[statistics.TTC_BELOW + k]) / following if following else None
            for k, limit in enumerate(get_args(TtcLimit))
        },
        following_share=following / states if states else None,
        lane_changes_per_mile=int(totals[statistics.LANE_CHANGES]) / miles if miles else None,
        bv_miles=miles,
    )


def tally_summary(tally: Tally, seconds: float, *, with_distributions: bool) -> Simulated:
    """Make the result of `simulate`."""
    return Simulated(
        **vars(rate_summary(tally.av_crashes, tally.tests, tally.miles)),
        av_crashes=tally.av_crashes,
        av_faults=tally.av_faults,
        bv_crashes=tally.bv_crashes,
        left_road=tally.left_road,
        seconds=round(seconds, 3),
        world_steps=tally.decisions,
        world_steps_per_second=round(tally.decisions / seconds, 2),
        tests_per_second=round(tally.tests / seconds, 4),
        digest=tally.digest.hexdigest(),
        distributions=distributions_of(tally.counts) if with_distributions else None,
    )


def drive_tests(
    run: Experiment, tally: Tally, stage: str, *, seed: int, first: int, tests: int, threads: int | None,
    progress: Progress, counting: bool = False,
) -> Iterator[tuple[int, outcome.Outcomes]]:  # fmt: skip
    """Drive tests of an experiment, add them to a tally, and yield the first test and the outcomes of each range.

    Raises:
        AvFaultError: The foreign AV failed in all tests, or in too many.
    """
    with moving(progress, run.answered(), 1.0 / answers_per_test(run.setting), stage, 0, tests) as told:
        for start, out, counts in runner.simulate_chunks(
            run.setting, run.slots, seed=seed, first=first, tests=tests, threads=run.processes(threads),
            counting=counting, chunk=run.range_size(CHUNK, tests, threads), drive=run.drive,
        ):  # fmt: skip
            tally.add(out, counts)
            told(stage, tally.tests + tally.av_faults, tests)
            yield start, out
    run.check_not_all_spoiled(tally.tests, tests)


def simulate_experiment(
    run: Experiment,
    *,
    tests: int,
    seed: int,
    first: int = 0,
    threads: int | None = None,
    counting: bool = False,
    progress: Progress = NO_PROGRESS,
    stage: str = "simulate",
) -> tuple[Tally, float]:
    """Drive tests of an experiment; return the sums and the time that it took [s]."""
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("tests", tests, low=1, high=10**12)
    run.warm_up()
    start, tally = time.perf_counter(), Tally()
    for _ in drive_tests(
        run, tally, stage, seed=seed, first=first, tests=tests, threads=threads, progress=progress, counting=counting
    ):
        pass
    return tally, time.perf_counter() - start
