"""The grid of kinds, the discovery curve against shuffling, and what is refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from cornerforge.analysis.coverage import coverage_of, discovery_curve
from cornerforge.errors import InputError

LABELS = ("unavoidable", "by braking")


def test_every_case_has_its_cell_and_empty_cells_are_named() -> None:
    found = coverage_of(
        np.array([1, 1, 4, 5]), np.array([0.0, 1.99, 2.0, 30.0]), np.array([0, 0, 1, 1]), LABELS
    )  # fmt: skip
    assert found.counts.shape == (4, 2, 4), "no head-on on a one-way road"
    cells = found.to_json()["cells"]
    assert cells == {
        "rear-end by AV | unavoidable | 0-2 m/s": 2,
        "sideswipe | by braking | 2-5 m/s": 1,
        "angle | by braking | 10 m/s and more": 1,
    }
    assert len(found.empty) == 4 * 2 * 4 - 3
    assert "rear-end by BV | by braking | 5-10 m/s" in found.empty
    assert found.unseen == 0.5, "two kinds of four cases were seen once"
    assert found.unseen_interval95[0] <= 0.5 <= found.unseen_interval95[1]


def test_a_head_on_crash_gets_its_row() -> None:
    found = coverage_of(np.array([3]), np.array([60.0]))
    assert "head-on" in found.axes["crash type"]
    assert found.to_json()["cells"] == {"head-on | 10 m/s and more": 1}


def test_the_curve_is_the_mean_over_all_orders() -> None:
    """Seven cases of three kinds: all 7! orders, counted."""
    counts = np.array([4, 2, 0, 1])
    kinds = np.repeat(np.arange(4), counts)
    orders = np.array(list(itertools.permutations(range(7))))
    expected = []
    for m in range(1, 8):
        first = np.sort(kinds[orders[:, :m]], axis=1)
        expected.append(1.0 + (np.diff(first, axis=1) > 0).sum(axis=1).mean())
    np.testing.assert_allclose(discovery_curve(counts), np.stack([np.arange(1, 8), expected], axis=1), atol=1e-9)


def test_the_curve_of_many_cases_rises_to_what_was_seen() -> None:
    counts = np.random.default_rng(1).multinomial(50_000, np.full(60, 1.0 / 60.0))
    curve = discovery_curve(counts)
    steps = np.diff(curve, axis=0)
    assert (steps[:, 0] > 0.0).all()
    assert (steps[:, 1] >= 0.0).all()
    np.testing.assert_allclose(curve[[0, -1]], [[1.0, 1.0], [50_000.0, 60.0]])


@pytest.mark.parametrize(
    ("types", "speeds", "labels", "message"),
    [
        ([], [], None, "no cases"),
        ([1], [-1.0], None, "negative"),
        ([1], [np.nan], None, "not finite"),
        ([7], [1.0], None, "unknown codes"),
        ([1], [1.0], [2], "below 2"),
    ],
)
def test_what_is_refused(types: list[int], speeds: list[float], labels: list[int] | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        coverage_of(
            np.array(types, np.int64), np.array(speeds), None if labels is None else np.array(labels), LABELS
        )  # fmt: skip
