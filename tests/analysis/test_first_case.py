"""The case to look at first: by how often its kind happens, not by how many cases of it there are."""

from __future__ import annotations

import numpy as np

from cornerforge.analysis.first_case import first_case, what_to_see_first
from cornerforge.analysis.prevented import PREVENTION

SEVEN = np.zeros((7, 2))


def test_the_kind_that_happens_most_wins_not_the_one_with_most_cases() -> None:
    kinds = ["a", "a", "a", "b", "b", "c", None]
    weights = np.array([1.0, 1.0, 1.0, 4.0, 2.0, 5.0, 50.0])
    found = first_case(kinds, weights, SEVEN, np.ones(7, np.bool_))
    assert found is not None
    assert (found.kind, found.rows.tolist()) == ("b", [3, 4])
    only = first_case(kinds, weights, SEVEN, np.array([True, True, True, False, True, False, True]))
    assert only is not None
    assert (only.kind, only.rows.tolist()) == ("a", [0, 1, 2]), "cases that do not matter have no say"


def test_the_typical_case_is_nearest_to_the_weighted_middle() -> None:
    points = np.array([[0.0, 0.0], [4.0, 0.0], [10.0, 0.0]])
    matter = np.ones(3, np.bool_)
    evenly = first_case(["a"] * 3, np.array([1.0, 1.0, 1.0]), points, matter)  # middle 4.67
    at_the_end = first_case(["a"] * 3, np.array([1.0, 1.0, 20.0]), points, matter)  # middle 9.27
    assert evenly is not None
    assert at_the_end is not None
    assert (evenly.row, at_the_end.row) == (1, 2)


def test_where_nothing_matters_there_is_no_case() -> None:
    assert first_case(["a", "b"], np.ones(2), np.zeros((2, 2)), np.zeros(2, np.bool_)) is None
    assert first_case([None, ""], np.ones(2), np.zeros((2, 2)), np.ones(2, np.bool_)) is None


def test_what_a_careful_driver_prevents_comes_first_else_what_happens_most() -> None:
    kinds, points = ["a", "a", "b", "c"], np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    weights = np.array([2.0, 2.0, 3.0, 9.0])
    by_braking, held, _, _, nobody, not_judged = PREVENTION

    def chosen(*how: str) -> tuple[str, bool]:
        found = what_to_see_first(kinds, weights, points, np.array(how, np.str_))
        assert found is not None
        return found[0].kind, found[1]

    assert chosen(by_braking, held, by_braking, nobody) == ("a", True)
    assert chosen(nobody, held, by_braking, nobody) == ("b", True)
    assert chosen(nobody, held, not_judged, nobody) == ("a", True)
    assert chosen(nobody, nobody, not_judged, nobody) == ("c", False)
    assert what_to_see_first(kinds, np.zeros(4), points, np.array([held] * 4, np.str_)) is None
