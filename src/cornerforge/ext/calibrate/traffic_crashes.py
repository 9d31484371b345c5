"""Crash counts in the traffic of a naturalistic model, between BVs and with a built-in AV; for studies of a fit."""

from __future__ import annotations

from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.setting import experiment
from cornerforge.intervals import binomial_interval, poisson_interval
from cornerforge.ndd.model import NddModel
from cornerforge.rates.exposure import SAMPLE_TESTS, bv_travel
from cornerforge.rates.monte_carlo import drive_block
from cornerforge.results.naturalistic import FitTraffic

__all__ = ["traffic_crashes"]


def traffic_crashes(
    name: str, model: NddModel, *, tests: int, seed: int = 0, threads: int = 1, progress: Progress = NO_PROGRESS
) -> FitTraffic:
    """Drive tests of the default ODD with `idm-mobil` among the BVs of a model, and count crashes.

    Args:
        name: Name of the model, for the progress.
        model: The model by which the BVs drive.
        tests: Number of tests, at least 1.
        seed: Seed of the tests.
        threads: Pool size; does not change the result.
        progress: Called with the progress.
    """
    run = experiment(model=model)
    run.warm_up()
    travel = bv_travel(run.setting, run.slots, seed=seed, tests=min(tests, SAMPLE_TESTS), threads=threads)

    def tell(done: int, _: int) -> None:
        progress(f"drive: {name}", done, tests)

    counted = drive_block(run.setting, run.slots, seed=seed, first=0, tests=tests, threads=threads, tell=tell)
    av_crashes, miles = len(counted.crashed), tests * travel.miles_per_test
    low, high = poisson_interval(counted.bv_crashes)
    return FitTraffic(
        tests=tests,
        av_crashes=av_crashes,
        av_crashes_per_test=av_crashes / tests,
        av_interval95=binomial_interval(av_crashes, tests),
        bv_crashes=counted.bv_crashes,
        bv_miles=miles,
        bv_crashes_per_mile=counted.bv_crashes / miles,
        bv_interval95=(low / miles, high / miles),
    )
