"""How far a fit's own choices matter: the prior's strength, and the window by which noisy positions are smoothed.

Each variant is a whole fit of the same files with one choice changed; all are scored on the same held-out decisions,
read with the shipped choices. If the caller can drive the variants, their crash rates stand beside the scores, and the
chance to overlook a neighbour is varied too, which no held-out decision can score.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cornerforge.experiment.setting import experiment
from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.fit import DEFAULT_PRIOR_STRENGTH, fit_model
from cornerforge.ext.calibrate.laws import log_likelihood
from cornerforge.ext.calibrate.readers import read_decisions
from cornerforge.ext.calibrate.report import PROBES
from cornerforge.ext.calibrate.scores import table_log_likelihood
from cornerforge.ext.calibrate.validate import stated_law
from cornerforge.intervals import binomial_interval, poisson_interval
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel
from cornerforge.rates.exposure import SAMPLE_TESTS, bv_travel
from cornerforge.rates.monte_carlo import drive_block
from cornerforge.results.naturalistic import FitTraffic, FitVariant, HeldOutScore
from cornerforge.types import ACCELERATIONS
from cornerforge.work.progress import NO_PROGRESS, Progress

__all__ = ["OVERLOOK_FACTORS", "STRENGTHS", "WINDOW_FACTORS", "fit_sensitivity", "traffic_crashes"]

STRENGTHS = (10.0, 50.0, 1000.0)
"""Other prior strengths to try."""
WINDOW_FACTORS = (0.6, 1.4)
"""Other factors of the smoothing windows to try."""
OVERLOOK_FACTORS = (0.0, 10.0)
"""Other factors of both chances to overlook a vehicle (`NddModel.overlook`, `overlook_conflict`) to try."""


def fit_sensitivity(
    paths: Sequence[Path],
    data_format: str,
    *,
    prior_strength: float = DEFAULT_PRIOR_STRENGTH,
    strengths: Sequence[float] = STRENGTHS,
    window_factors: Sequence[float] = WINDOW_FACTORS,
    lane_changes: str = "fit",
    progress: Callable[[str], None] | None = None,
    drive: Callable[[str, NddModel], FitTraffic] | None = None,
) -> tuple[FitVariant, ...]:
    """Fit the same files with other choices, and say what changes; by default as long as six fits.

    Args:
        paths: As for `fit_model`.
        data_format: As for `fit_model`.
        prior_strength: Number that the fit in question uses.
        strengths: Other strengths to try.
        window_factors: Factors of the smoothing windows, to try.
        lane_changes: As for `fit_model`.
        progress: Called with a sentence on each step.
        drive: Gets the variant's name and its model, and says how often its traffic crashes.

    Returns:
        The variants, the fit itself first; probes are `report.PROBES`. With `drive` two more: overlooking.

    Raises:
        CornerForgeError: As `fit_model`.
    """
    tell = progress or (lambda _: None)
    scored = {
        reading.path.name: reading.decisions.where(reading.decisions.held_out & np.isfinite(reading.decisions.gap))
        for reading in read_decisions(paths, data_format)
    }
    scored = {name: decisions for name, decisions in scored.items() if decisions.size}
    choices = [("as fitted", prior_strength, 1.0)]
    choices += [(f"prior strength {strength:g}", strength, 1.0) for strength in strengths if strength != prior_strength]
    choices += [(f"smoothing windows x {factor:g}", prior_strength, factor) for factor in window_factors]
    models = {}
    for name, strength, factor in choices:
        tell(f"Sensitivity: {name}")
        models[name], _ = fit_model(
            paths, data_format, prior_strength=strength, window_factor=factor, lane_changes=lane_changes
        )
    if drive is None:
        return tuple(_row(name, model, scored, None) for name, model in models.items())
    for factor in OVERLOOK_FACTORS:
        models[f"overlooking x {factor:g}"] = _overlooking(models["as fitted"], factor)
    return tuple(_row(name, model, scored, drive(name, model)) for name, model in models.items())


def _overlooking(model: NddModel, factor: float) -> NddModel:
    return replace(model, overlook=model.overlook * factor, overlook_conflict=model.overlook_conflict * factor)


def _row(name: str, model: NddModel, scored: dict[str, Decisions], traffic: FitTraffic | None) -> FitVariant:
    law = stated_law(model)
    held_out = {}
    for file, d in scored.items():
        table, number = table_log_likelihood(model, d)
        held_out[file] = HeldOutScore(
            law=None if law is None else log_likelihood(law, d.speed, d.gap, d.range_rate, d.acceleration),
            table=table if number else None,
        )
    probes = tuple(_mean_sd(model, *probe) for probe in PROBES)
    return FitVariant(variant=name, held_out=held_out, probes=probes, traffic=traffic)


def _mean_sd(model: NddModel, speed: float, gap: float, range_rate: float) -> tuple[float, float]:
    place = SPEEDS.searchsorted(speed), GAPS.searchsorted(gap), RANGE_RATES.searchsorted(range_rate)
    p = model.following[place].astype(np.float64)
    mean = float(p @ ACCELERATIONS)
    return mean, float(np.sqrt(p @ (ACCELERATIONS - mean) ** 2))


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
