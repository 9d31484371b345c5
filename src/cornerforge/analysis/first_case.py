"""The case to look at first: typical of the kind of natural crash that happens most, of those that matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FirstCase", "first_case", "prevented_by_braking"]


@dataclass(frozen=True)
class FirstCase:
    """The case to look at first.

    Attributes:
        row: Of the case.
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
        matter: Which cases matter, such as `prevented_by_braking`, shape (S,).

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


def prevented_by_braking(
    prevented_by: Sequence[str | None], held_speed_prevents: Sequence[bool | None]
) -> NDArray[np.bool_]:
    """Mark the cases that a reference driver's braking would have prevented; not those in which holding the speed does.

    Args:
        prevented_by, held_speed_prevents: Columns of `cases.parquet`, of S cases; None: not judged.

    Returns:
        Shape (S,).
    """
    return np.array(
        [
            who is not None and who != "nobody" and not held
            for who, held in zip(prevented_by, held_speed_prevents, strict=True)
        ],
        np.bool_,
    )
