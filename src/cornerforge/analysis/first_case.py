"""The case to look at first: typical of the most frequent kind of natural crash that matters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.prevented import CAREFULLY

__all__ = ["FirstCase", "first_case", "what_to_see_first"]


@dataclass(frozen=True)
class FirstCase:
    """The case to look at first.

    Attributes:
        row: Row of the case.
        kind: What it is typical of, such as its mechanism.
        rows: All cases of this kind that matter, ascending, shape (K,).
    """

    row: int
    kind: str
    rows: NDArray[np.intp]


def first_case(
    kinds: Sequence[str | None], weights: NDArray[np.float64], points: NDArray[np.float64], matter: NDArray[np.bool_]
) -> FirstCase | None:
    """Choose the kind that happens most among the cases that matter, and its typical case.

    Args:
        kinds: What kind each of the S cases is, None or "": not known.
        weights: How often each happens, above 0, shape (S,).
        points: Each in the plane of the principal components, shape (S, 2); NaN where a case has no place in it.
        matter: Which cases matter, for example cases that a careful driver would have prevented, shape (S,).

    Returns:
        The case of that kind nearest to the weighted middle of its cases; None if no case that matters has a kind. Of
        kinds that happen equally often the first by name, of cases equally near the first.

    >>> kinds, weights = ["a", "b", "b", "b"], np.array([5.0, 3.0, 3.0, 3.0])
    >>> points = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [9.0, 0.0]])
    >>> first_case(kinds, weights, points, np.array([True, True, True, False])).row
    1
    """
    names = np.array([name or "" for name in kinds], np.str_)
    useful = matter & (names != "")
    if not useful.any():
        return None
    found, place = np.unique(names[useful], return_inverse=True)
    kind = str(found[np.argmax(np.bincount(place, weights[useful]))])
    rows = np.flatnonzero(useful & (names == kind))
    placed = rows[np.isfinite(points[rows]).all(axis=1)]
    if placed.size == 0:
        return FirstCase(int(rows[0]), kind, rows)
    middle = np.average(points[placed], axis=0, weights=weights[placed])
    far = ((points[placed] - middle) ** 2).sum(axis=1)
    return FirstCase(int(placed[np.argmin(far)]), kind, rows)


def what_to_see_first(
    kinds: Sequence[str | None],
    weights: NDArray[np.float64],
    points: NDArray[np.float64],
    prevention: NDArray[np.str_],
) -> tuple[FirstCase, bool] | None:
    """Choose the natural case to look at first.

    Of the kinds that a careful driver would have prevented, by braking or by leaving out what the AV began, the most
    frequent; where none would have been, the most frequent of all.

    Args:
        kinds, weights, points: As for `first_case`; a weight that is not above 0 leaves a case out.
        prevention: One of `prevented.PREVENTION` for each case, shape (S,).

    Returns:
        The case, and whether a careful driver would have prevented it. None if no case has a kind.
    """
    known = weights > 0.0
    for matter, prevented in ((known & np.isin(prevention, CAREFULLY), True), (known, False)):
        found = first_case(kinds, weights, points, matter)
        if found is not None:
            return found, prevented
    return None
