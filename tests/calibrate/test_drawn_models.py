"""Drawn models: factors of the stated width, rows of data of the stated spread, and what cannot be drawn is said."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats
from statistical_bounds import distance_to_law, dkw_bound

from cornerforge.errors import FileFormatError, InputError
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ext.calibrate.uncertainty import (
    DESIGN_EFFECT,
    LAWS,
    UNCERTAIN,
    check_drawable,
    drawn_laws,
    drawn_model,
    drawn_variations,
    widths,
)
from cornerforge.ext.calibrate.variations import counted_decisions, varied_model
from cornerforge.ndd.model import NddModel, model_hash
from cornerforge.road.straight import LawFactors, road_numbers
from cornerforge.types import Odd

DRAWS = 4000


@pytest.fixture(scope="module")
def factors(model: NddModel) -> dict[tuple[str, str], Any]:
    """Factors of each number, shape (DRAWS,)."""
    drawn = [drawn_variations(model, 5, k) for k in range(DRAWS)]
    places = {(v.part, v.field): i for i, v in enumerate(drawn[0])}
    table = np.array([[v.factor for v in variations] for variations in drawn])
    return {name: table[:, place] for name, place in places.items()}


@pytest.mark.full
def test_factors_have_the_stated_widths_and_limits(model: NddModel, factors: dict[tuple[str, str], Any]) -> None:
    """Unit: a draw, n 4,000. The distance to the stated law is at most 0.052; a width off by a quarter is farther."""
    rows = widths(model)
    assert set(factors) == {(row.part, row.field) for row in rows} == {(row.part, row.field) for row in UNCERTAIN}
    free = 0
    for row in rows:
        of = factors[row.part, row.field]
        inside = (of < of.max()) & (of > of.min())
        assert of.min() > 0.0
        if inside.sum() < DRAWS - 2:  # some were cut
            continue
        free += 1
        bound = dkw_bound(DRAWS, len(rows))
        assert distance_to_law(np.log(of), stats.norm(0.0, row.width)) < bound, row
        assert distance_to_law(np.log(of), stats.norm(0.0, 1.35 * row.width)) > bound, "or the check could not fail"
    assert free >= 10
    value = model.initial.vigilance_sigma
    assert (value * factors["initial", "vigilance_sigma"]).max() == pytest.approx(1.5)
    stated: Any = model.provenance["following"]
    assert (stated["law"]["degrees"] * factors["law", "degrees"]).min() == pytest.approx(3.0)


@pytest.mark.full
def test_factors_of_different_numbers_and_draws_are_independent(factors: dict[tuple[str, str], Any]) -> None:
    """The correlation of n independent pairs has a standard deviation of n^-1/2: six of them, over 300 pairs."""
    logs = np.log(np.array(list(factors.values())))
    bound = 6.0 / DRAWS**0.5
    apart = np.corrcoef(logs) - np.eye(len(logs))
    assert np.abs(apart).max() < bound
    in_turn = [np.corrcoef(row[1:], row[:-1])[0, 1] for row in logs]
    assert np.abs(in_turn).max() < bound


@pytest.mark.full
def test_a_draw_is_its_seed_and_number(model: NddModel) -> None:
    one = drawn_model(model, 7, 3)
    assert model_hash(one) == model_hash(drawn_model(model, 7, 3))
    others = {model_hash(drawn_model(model, seed, k)) for seed, k in ((7, 4), (8, 3), (3, 7))}
    assert model_hash(one) not in others
    assert len(others) == 3
    assert one.following.dtype == np.float32
    assert ((one.following > 0.0) | (one.following == 0.0)).all()


@pytest.mark.full
def test_rows_of_data_scatter_like_their_decisions_say(model: NddModel) -> None:
    """Variance of p under Dirichlet(a p) is p (1 - p) / (a + 1), summed over the 551 rows with data."""
    seed, k = 1, 2
    varied = varied_model(model, drawn_variations(model, seed, k))
    drawn = drawn_model(model, seed, k)
    n = counted_decisions(model)
    counted = n > 0
    assert counted.sum() == 551
    np.testing.assert_array_equal(drawn.following[~counted], varied.following[~counted])
    rows, found = varied.following[counted].astype(float), drawn.following[counted].astype(float)
    assert (found[rows == 0.0] == 0.0).all()
    trusted = n[counted] / DESIGN_EFFECT + 200.0
    expected = (rows * (1.0 - rows)).sum(axis=1) / (trusted + 1.0)
    squares = ((found - rows) ** 2).sum(axis=1)
    off = 6.0 * squares.std() * len(squares) ** 0.5
    assert abs(squares.sum() - expected.sum()) < off
    assert off < 0.4 * expected.sum(), "or the check could not see decisions that count double"


def test_intervals_of_the_models_own_fit_are_taken(model: NddModel) -> None:
    found = {(row.part, row.field): row for row in widths(model)}
    assert found["initial", "noise_spread"].width == 0.49, "the shipped fit's own interval begins at 0"
    fit = {"numbers": {"rate": {"interval95": [0.01, 0.02]}, "near": {"interval95": [40.0, 80.0]}}}
    said = {**model.provenance, "lane_change_fit": fit, "noise_spread_fit": {"interval95": [0.05, 0.2]}}
    found = {(row.part, row.field): row for row in widths(replace(model, provenance=said))}
    assert found["lane_change", "rate"].width == pytest.approx(np.log(2.0) / 3.92, rel=1e-3)
    assert found["lane_change", "rate"].measured
    assert ("lane_change", "near") in found
    assert found["initial", "noise_spread"].width == pytest.approx(np.log(4.0) / 3.92, rel=1e-3)
    for wrong in ({"interval95": 1.0}, {"interval95": [1.0]}, {}, "many", {"interval95": ["a", "b"]}):
        with pytest.raises(FileFormatError, match="no usable intervals"):
            widths(replace(model, provenance={"noise_spread_fit": wrong}))
        with pytest.raises(FileFormatError, match="no usable intervals"):
            widths(replace(model, provenance={"lane_change_fit": {"numbers": {"rate": wrong}}}))


def test_what_cannot_be_drawn_is_refused_in_one_sentence(model: NddModel) -> None:
    check_drawable(model)
    imported = replace(model, provenance={"format": "ivbss"})
    with pytest.raises(InputError, match=r'does not say its "counted".*cornerforge ndd fit.*leave out --model-draws'):
        check_drawable(imported)
    with pytest.raises(InputError, match="k"):
        drawn_model(model, 1, -1)


def test_laws_are_drawn_where_they_hold() -> None:
    """Unit: a draw, n 4,000; the bound as for the factors of a model."""
    ramp, dense = road_numbers(odd_on(Odd(), road_named("on-ramp"))), road_numbers(Odd(traffic="dense"))
    assert drawn_laws(road_numbers(Odd()), 5, 0) == {}
    assert drawn_laws(road_numbers(odd_on(Odd(), road_named("curves"))), 5, 0) == {}
    everywhere, stopping = drawn_laws(ramp, 5, 0), drawn_laws(dense, 5, 0)
    assert stopping == {row: factor for row, factor in everywhere.items() if row.part == "stopping"}
    assert {row.part for row in LAWS} == {"merging", "stopping"}
    assert drawn_laws(ramp, 5, 1) != everywhere != drawn_laws(ramp, 6, 0)
    drawn = [drawn_laws(ramp, 5, k) for k in range(DRAWS)]
    free = 0
    for row in LAWS:
        of = np.array([factors[row] for factors in drawn])
        assert 0.0 < of.min() < of.max() <= row.most
        if (of == row.most).mean() < 0.05:
            free += 1
            assert distance_to_law(np.log(of), stats.norm(0.0, row.width)) < dkw_bound(DRAWS, len(LAWS)), row
    assert free == len(LAWS) - 1, "no vehicle brakes harder than its own braking is"


def test_the_table_states_its_sources() -> None:
    names = [(row.part, row.field) for row in (*UNCERTAIN, *LAWS)]
    assert len(set(names)) == len(names)
    assert {row.field for row in LAWS} == set(LawFactors._fields)
    for row in (*UNCERTAIN, *LAWS):
        assert 0.0 < row.width < 1.0
        assert len(row.source) > 20
