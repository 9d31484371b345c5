"""Grouping of plain feature tables, and the same over the paper's eight lengths of history."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cornerforge.analysis import analyse
from cornerforge.analysis.features import crash_features
from cornerforge.analysis.grouping import group_features
from cornerforge.analysis.periods import PERIODS, analyse_periods
from cornerforge.errors import InputError


def some_history(n: int, seed: int = 0) -> np.ndarray:
    """Random histories with a contact that touches; every third case is recorded for 4 s only."""
    rng = np.random.default_rng(seed)
    history = rng.normal(size=(n, 16, 2, 4)).cumsum(axis=1)
    history[:, 0] = [[0.0, 0.0, 30.0, 0.0], [4.8, 0.0, 25.0, 0.0]]
    history[::3, 5:] = np.nan
    return history


@pytest.mark.full
def test_the_papers_periods_hold_all_seconds_up_to_their_end() -> None:
    found = analyse_periods(some_history(60))
    assert [one.steps for one in found] == list(PERIODS) == [1, 2, 3, 5, 7, 9, 12, 15]
    assert [one.to_json()["features"] for one in found] == [5, 10, 15, 25, 35, 45, 60, 75]
    assert [one.padded for one in found] == [0, 0, 0, 20, 20, 20, 20, 20]
    for one in found:
        content = json.loads(json.dumps(one.to_json(), allow_nan=False))
        assert content["majority"] + content["minority"] == content["cases"] == 60
        assert content["noise"] <= content["minority"]


def test_a_period_is_the_analysis_of_its_features() -> None:
    history = some_history(80)
    (period,) = analyse_periods(history, periods=[5], seed=3)
    alone = group_features(crash_features(history, 5).values, seed=3)
    whole = analyse([str(row) for row in range(80)], history, steps=5, seed=3)
    assert period.grouping.projection.points.tobytes() == alone.projection.points.tobytes()
    assert period.grouping.index.tolist() == alone.index.tolist() == whole.cluster_index.tolist()
    assert [str(row) for row in period.grouping.rare] == list(whole.rare)
    assert [[str(row) for row in one.typical] for one in alone.groups] == [list(one.typical) for one in whole.clusters]


@pytest.mark.full
def test_excluded_periods_hold_fewer_cases_and_none_is_an_error() -> None:
    found = analyse_periods(some_history(60), short="exclude")
    assert [len(one.kept) for one in found] == [60, 60, 60, 40, 40, 40, 40, 40]
    assert [one.excluded for one in found] == [0, 0, 0, 20, 20, 20, 20, 20]
    short = some_history(12)
    short[:, 1:] = np.nan
    with pytest.raises(InputError, match="No case lasts as long as any of the periods"):
        analyse_periods(short, short="exclude")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((0, 5)), r"values has shape \(0, 5\)"),
        (np.zeros((5, 1)), r"values has shape \(5, 1\)"),
        (np.zeros(5), r"values has shape \(5,\)"),
        (np.array([[0.0, 1.0], [np.nan, 1.0]]), r"values\[1, 0\] = nan is not finite"),
    ],
)
def test_features_that_cannot_be_grouped_are_named(values: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        group_features(values)


@given(arrays(np.float64, st.tuples(st.integers(1, 40), st.integers(2, 6)), elements=st.floats(-1e3, 1e3, width=32)))
def test_any_table_is_grouped_without_rest(values: np.ndarray) -> None:
    """Copies, constant columns, lines: each row is in one cluster, and typical rows are in theirs."""
    found = group_features(values)
    assert np.bincount(found.index, minlength=len(found.groups)).tolist() == [one.size for one in found.groups]
    assert np.isfinite(found.projection.points).all()
    for number, one in enumerate(found.groups):
        assert 1 <= len(one.typical) <= 3
        assert (found.index[list(one.typical)] == number).all()
        assert (found.is_majority[list(one.typical)] == (one.name == "majority")).all()
    assert not found.is_majority[list(found.rare)].any()
