"""`rate --model-draws M`: the rate again in M models drawn about the one in use, and the interval that takes them in.

Each drawn model is driven with tests or trees of its own; no test is reweighted. Plain tests say how often its BVs
crash into one another, and a model that is unlike people in that counts for less. `draws/` holds a file a model; a kill
loses the model in progress. Tests driven otherwise (another method, number or factor) are driven again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from cornerforge._checks import check_integer
from cornerforge._schema import Closed, Share, Whole, meant, read
from cornerforge.drivers.naturalistic import tables_of
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import read_json_file, write_json
from cornerforge.ext.calibrate.uncertainty import check_drawable, drawn_laws, drawn_model, drawn_variations
from cornerforge.ndd.model import NddModel, model_hash
from cornerforge.rates.branching import Plan, TreeDriver, drive_trees
from cornerforge.rates.model_uncertainty import (
    FEWEST_DRAWS,
    effective_counts,
    effective_number,
    interval_with_model,
    model_spread,
    traffic_weights,
)
from cornerforge.rates.monte_carlo import BLOCK, drive_block
from cornerforge.rates.weighted import weighted_rate
from cornerforge.results import NaturalRate
from cornerforge.results.driving import Cost, ModelUncertainty
from cornerforge.road.straight import LawFactors
from cornerforge.sim import controllers
from cornerforge.work.progress import Progress

__all__ = ["Draw", "check_model_draws", "with_model_draws"]

_TREES_EACH = 20_000
_CRASHES_EACH = 25
"""Plain tests of one model are as many as give about so many crashes, and no more than the rate itself rests on."""
_TRAFFIC_TESTS = 4 * BLOCK
"""Plain tests of each model that say how often its BVs crash into each other: some 1.3e6 BV-miles."""
_MOST_IN_ONE_TREE = 0.5
_USE = 3
"""Makes seeds of the draws different from the seeds of `Splitting`."""


class Draw(Closed, frozen=True):
    """One model's rate; a file of `draws/` holds it."""

    method: Annotated[str, meant("How the rate was found.")]
    tests: Annotated[Whole, meant("From how many tests or trees.")]
    model_hash: Annotated[str, meant("Which model.")]
    factors: Annotated[dict[str, float], meant("Times what its numbers are of the model in use.")]
    rate: Annotated[float, meant("Crashes of the AV; 0 without a crash.", "per test", 0.0)]
    error: Annotated[float, meant("Its standard error.", "per test", 0.0)]
    largest: Annotated[Share, meant("Largest share of the rate in one tree; 0 for counts.")]
    lost: Annotated[Whole, meant("Copies of worlds that found no room.")]
    traffic_tests: Annotated[Whole, meant("Plain tests besides, in which crashes between BVs were counted.")]
    bv_crashes: Annotated[Whole, meant("Crashes between BVs in them.")]
    cpu_seconds: Annotated[float, meant("Time on processors.", "s", 0.0)]
    seconds: Annotated[float, meant("Wall-clock time.", "s", 0.0)]


_Drive = Callable[[Experiment, int, Callable[[int], None]], dict[str, Any]]
"""Drives an experiment's tests of a seed, tells how many are done, and says what `Draw` holds of them."""


def check_model_draws(model_draws: int, model: NddModel) -> None:
    """Check, before long work, that so many models can be drawn.

    Raises:
        InputError: The number is neither 0 nor 5 to 1000, or nothing can be drawn about this model.
    """
    check_integer("model_draws", model_draws, low=0, high=1000)
    if 0 < model_draws < FEWEST_DRAWS:
        raise InputError(
            f"model_draws = {model_draws} is too few to know a spread; take 0 (none), or {FEWEST_DRAWS} or more."
        )
    if model_draws:
        check_drawable(model)


def with_model_draws(
    found: NaturalRate,
    run: Experiment,
    *,
    model_draws: int,
    seed: int,
    out: Path | None,
    threads: int,
    progress: Progress,
    by_trees: tuple[Plan, TreeDriver] | None,
) -> NaturalRate:
    """Add to a rate the interval with the model's own uncertainty; without a crash it gets none.

    Args:
        found: The rate, with its interval of sampling alone.
        run: Experiment in which it was found.
        model_draws: Models to draw, 5 or more.
        seed: Seed from the user; models and tests have seeds of their own made from it.
        out: The output folder, or None.
        threads: Pool size; does not change the result.
        progress: Called with the progress.
        by_trees: How tests branch into trees; None: tests are counted.

    Raises:
        InputError: Not one of the drawn models crashed.
        FileFormatError: A file of the folder is damaged.
    """
    if not found.crashes_per_test or found.state == "no crash":
        return found
    if by_trees is None:
        method, tests, drive = "mc", _tests_each(found), _counting(_tests_each(found), threads)
    else:
        method, tests, drive = "splitting", _TREES_EACH, _weigh_trees(*by_trees, threads)
    draws: list[Draw] = []

    def tell(done: int) -> None:
        progress("drive drawn models", len(draws) * tests + done, model_draws * tests)

    for k in range(model_draws):
        place = None if out is None else out / "draws" / f"{k:04}.json"
        draw = None
        if place is not None and place.exists():
            draw = read(Draw, read_json_file(place), f"{place} is damaged", "remove it, or choose another place.")
        tell(0)
        driven = (method, tests, _TRAFFIC_TESTS, _factors(run, seed, k))
        if draw is None or (draw.method, draw.tests, draw.traffic_tests, draw.factors) != driven:
            draw = _driven(run, seed, k, drive, method, tests, threads, tell)
            if place is not None:
                write_json(place, msgspec.structs.asdict(draw))
        draws.append(draw)
    tell(0)
    return replace(found, model_uncertainty=_judged(found, draws))


def _tests_each(found: NaturalRate) -> int:
    """Choose a power of 2, so that a run that goes on a little seldom drives all models again."""
    wanted = 1 << math.ceil(math.log2(_CRASHES_EACH / found.crashes_per_test))
    return min(found.tests, wanted)


def _factors(run: Experiment, seed: int, k: int) -> dict[str, float]:
    laws = drawn_laws(run.setting.road, seed, k)
    return {f"{v.part}.{v.field}": v.factor for v in drawn_variations(run.model, seed, k)} | {
        f"{row.part}.{row.field}": factor for row, factor in laws.items()
    }


def _driven(
    run: Experiment, seed: int, k: int, drive: _Drive, method: str, tests: int, threads: int,
    tell: Callable[[int], None],
) -> Draw:  # fmt: skip
    model, road = drawn_model(run.model, seed, k), run.setting.road
    law = LawFactors(**{row.field: factor for row, factor in drawn_laws(road, seed, k).items()})
    tables = tables_of(model, stops=road.stops, traffic=run.odd.traffic)
    changed = replace(run, model=model, setting=run.setting._replace(tables=tables, road=road._replace(law=law)))
    own_seed = int(np.random.SeedSequence([seed, _USE, k]).generate_state(1, np.uint64)[0] >> np.uint64(1))
    begun = time.perf_counter()
    came_to = drive(changed, own_seed, tell)
    # Of the AV only where it is matters for how often BVs crash into each other; one from outside is not asked.
    traffic = drive_block(
        changed.setting.with_drivers(av=controllers.BUILT_IN), run.slots, seed=own_seed, first=0, tests=_TRAFFIC_TESTS,
        threads=threads,
    )  # fmt: skip
    came_to["cpu_seconds"] = round(came_to["cpu_seconds"] + traffic.cpu_seconds, 3)
    seconds = round(time.perf_counter() - begun, 3)
    return Draw(
        method=method, tests=tests, model_hash=model_hash(model), factors=_factors(run, seed, k),
        seconds=seconds, traffic_tests=traffic.tests, bv_crashes=traffic.bv_crashes, **came_to,
    )  # fmt: skip


def _counting(tests: int, threads: int) -> _Drive:
    def drive(run: Experiment, seed: int, tell: Callable[[int], None]) -> dict[str, Any]:
        block = drive_block(
            run.setting, run.slots, seed=seed, first=0, tests=tests, threads=threads, drive=run.drive,
            tell=lambda done, _: tell(done),
        )  # fmt: skip
        valid, crashes = block.tests - block.av_faults, len(block.crashed)
        return {
            "rate": crashes / valid, "error": math.sqrt(crashes) / valid, "largest": 0.0, "lost": 0,
            "cpu_seconds": round(block.cpu_seconds, 3),
        }  # fmt: skip

    return drive


def _weigh_trees(plan: Plan, driver: TreeDriver, threads: int) -> _Drive:
    def drive(run: Experiment, seed: int, tell: Callable[[int], None]) -> dict[str, Any]:
        driven = drive_trees(
            run.setting, run.slots, plan, seed=seed, first=0, tests=_TREES_EACH, threads=threads, driver=driver,
            progress=tell,
        )  # fmt: skip
        rate = weighted_rate(driven.trees["weight"].copy())
        return {
            "rate": rate.rate, "error": rate.error, "largest": rate.largest, "lost": int(driven.trees["lost"].sum()),
            "cpu_seconds": round(driven.cpu_seconds, 3),
        }  # fmt: skip

    return drive


def _judged(found: NaturalRate, draws: list[Draw]) -> ModelUncertainty:
    rates, errors = np.array([draw.rate for draw in draws]), np.array([draw.error for draw in draws])
    if found.method == "mc":
        exposures = np.array([float(draw.tests) for draw in draws])
        counts = rates * exposures
    else:
        counts, exposures = effective_counts(rates, errors)
    doubts = []
    miles = found.bv_miles / found.plain_tests * draws[0].traffic_tests
    weights = traffic_weights(np.array([float(draw.bv_crashes) for draw in draws]), miles)
    if effective_number(weights) < FEWEST_DRAWS:
        weights = np.ones(len(draws))
        doubts.append("hardly any drawn model's traffic crashes as often as people do, so none is held to that")
    spread = model_spread(counts, exposures, weights)
    low, high = interval_with_model(found.crashes_per_test, found.interval95, spread)
    per_mile = None if found.crashes_per_mile is None else found.crashes_per_mile / found.crashes_per_test
    if lost := sum(draw.lost for draw in draws):
        doubts.append(f"{lost} copies of worlds found no room")
    if heavy := sum(draw.largest > _MOST_IN_ONE_TREE for draw in draws):
        doubts.append(f"in {heavy} of {len(draws)} drawn models one tree has more than half of the rate")
    return ModelUncertainty(
        draws=len(draws),
        effective_draws=spread.draws,
        bv_crashes=sum(draw.bv_crashes for draw in draws),
        bv_miles=miles * len(draws),
        tests_each=draws[0].tests,
        effective_each=float(np.median(counts)),
        cv=spread.cv,
        cv_interval95=spread.cv95,
        log_sd_used=spread.log_sd_used,
        median_crashes_per_test=spread.median,
        interval95=(low, high),
        interval95_per_mile=None if per_mile is None else (low * per_mile, high * per_mile),
        doubts=tuple(doubts),
        cost=Cost(
            tests=sum(draw.tests for draw in draws), cpu_seconds=round(sum(draw.cpu_seconds for draw in draws), 3)
        ),
    )
