"""`simulate`: drive tests, count crashes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

from cornerforge._checks import check_integer
from cornerforge.errors import AvFaultError, InputError
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.rates import binomial_interval
from cornerforge.sim import statistics
from cornerforge.sim.runner import Tally
from cornerforge.sim.runner import simulate as drive
from cornerforge.types import METRES_PER_MILE
from cornerforge.world_options import WorldKeywords, WorldOptions

__all__ = ["distributions_of", "rate_summary", "simulate", "simulate_experiment", "tally_summary"]


def rate_summary(crashes: int, tests: int, miles: float) -> dict[str, Any]:
    """A crash rate with its units, its n and its exact 95 % intervals, per test and per mile."""
    low, high = binomial_interval(crashes, tests)
    per_mile = tests / miles if miles > 0.0 else None
    return {
        "tests": tests,
        "crashes_per_test": crashes / tests,
        "interval95": [low, high],
        "crashes_per_mile": None if per_mile is None else crashes / tests * per_mile,
        "interval95_per_mile": None if per_mile is None else [low * per_mile, high * per_mile],
        "miles": miles,
    }


def distributions_of(counts: statistics.Counts) -> dict[str, Any]:
    """The object `distributions` of `simulate --stats`."""
    summaries: dict[str, Any] = {
        grid.name: {"unit": grid.unit, **statistics.histogram_summary(grid, counts.histograms[row])}
        for row, grid in enumerate(statistics.TRAFFIC)
    }
    totals = counts.totals
    following = int(totals[statistics.FOLLOWING_STATES])
    miles = int(totals[statistics.BV_TRAVEL_MM]) / 1000.0 / METRES_PER_MILE
    summaries["ttc_share_below"] = {
        f"{limit:g}": int(totals[statistics.TTC_BELOW + k]) / following if following else None
        for k, limit in enumerate(statistics.TTC_LIMITS)
    }
    summaries["following_share"] = (
        following / int(totals[statistics.BV_STATES]) if totals[statistics.BV_STATES] else None
    )
    summaries["lane_changes_per_mile"] = int(totals[statistics.LANE_CHANGES]) / miles if miles else None
    summaries["bv_miles"] = miles
    return summaries


def tally_summary(tally: Tally, seconds: float, *, with_distributions: bool) -> dict[str, Any]:
    """The JSON object of `simulate`."""
    summary = rate_summary(tally.av_crashes, tally.tests, tally.miles)
    summary |= {
        "av_crashes": tally.av_crashes,
        "av_faults": tally.av_faults,
        "bv_crashes": tally.bv_crashes,
        "seconds": round(seconds, 3),
        "world_steps": tally.decisions,
        "world_steps_per_second": round(tally.decisions / seconds, 2),
        "tests_per_second": round(tally.tests / seconds, 4),
        "digest": tally.digest.hexdigest(),
    }
    if with_distributions:
        summary["distributions"] = distributions_of(tally.counts)
    return summary


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
    """Drive tests of an experiment; returns the sums and the seconds it took."""
    run.warm_up()
    start = time.perf_counter()
    tally = drive(
        run.setting,
        run.slots,
        seed=seed,
        tests=tests,
        first=first,
        threads=check_threads(threads),
        counting=counting,
        progress=lambda done: progress(stage, done, tests),
        drive=run.drive,
    )
    if tally.tests == 0 and run.foreign is not None:
        fault = next(iter(run.foreign.faults.values()))
        raise AvFaultError(
            f"The AV {run.av.name} spoiled every one of {tests} tests. In test {fault.test} it {fault.message}. "
            f"Mend it; to look closer: cornerforge check-av {run.av.name}"
        )
    return tally, time.perf_counter() - start


def simulate(
    *,
    tests: int,
    bv: str | Path | Sequence[str | Path] = "nde",
    acting: str = "greedy",
    stats: bool = False,
    out: Path | str | None = None,
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[WorldKeywords],
) -> dict[str, Any]:
    """Run tests of an AV; crashes are counted, and stored only when `out` names a library.

    Args:
        tests: How many tests (drives of 400 m), at least 1.
        bv: How background vehicles drive: "nde", "idm", a plain adversary's name, or a policy file; several files:
            each test is driven by one of these policies, drawn at random.
        acting: How a policy acts: "greedy", or "softmax:T" to draw actions by exp(Q / T).
        stats: Add distributions over all BVs at decision times.
        out: Library that the crashes go to.
        resume: Go on with that library.
        seed: 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
        world: The world, keyword by keyword; see `WorldOptions`.

    Returns:
        The object that `cornerforge simulate --json` prints.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    check_integer("tests", tests, low=1, high=10**12)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    if resume and out is None:
        raise InputError("There is nothing to resume without out; name the folder: --out FOLDER --resume")
    run = experiment(WorldOptions(**world), bv=bv, acting=acting, takes_foreign=True, seed=seed)
    if out is not None:
        from cornerforge.pipeline.generate import store_tests

        return store_tests(
            run, Path(out), tests=tests, seed=seed, threads=threads, counting=stats, resume=resume, progress=progress
        )
    tally, seconds = simulate_experiment(
        run, tests=tests, seed=seed, threads=threads, counting=stats, progress=progress
    )
    return tally_summary(tally, seconds, with_distributions=stats)
