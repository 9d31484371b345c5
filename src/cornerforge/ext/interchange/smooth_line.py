"""Reference lines through the points of other people's roads, which are drawn as straight lines with kinks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import splev, splprep

from cornerforge.errors import InputError
from cornerforge.road.reference import Piece, ReferenceLine

__all__ = ["clothoids", "dense", "smooth_line", "ways"]

_OFFS = (0.007, 0.03, 0.1)
"""Root mean square by which the line may miss the drawn one [m], tried in this order."""
_EASY = 150.0
"""A line whose tightest radius is more than this needs no further smoothing [m]."""
_DENSE = 5.0
"""Distance of the points of a drawn line that are looked at [m]."""
_PIECE = 4.0
"""Length of its clothoids [m]."""


def ways(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the way along a drawn line to each of its points (P, 2) [m]."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def dense(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add points to a drawn line (P, 2) so that they are 5 m apart at most."""
    along = ways(points)
    at = np.unique(np.concatenate([along, np.linspace(0.0, along[-1], math.ceil(along[-1] / _DENSE) + 1)]))
    return np.stack([np.interp(at, along, part) for part in points.T], axis=1)


def smooth_line(points: NDArray[np.float64]) -> tuple[ReferenceLine, float]:
    """Lay a line of clothoids along a drawn one: the smoothest that misses it by 1 cm in the mean.

    Where that bends too tightly, 3 or 10 cm.

    Args:
        points: Of the drawn line, (P, 2) [m], no two in a row the same; 20 m long or more.

    Returns:
        The line, and by how much it misses the drawn one at most [m].

    Raises:
        InputError: The drawn line turns back on itself.
    """
    points = dense(points)
    along = ways(points)
    for off in _OFFS:
        line = _line(splprep(list(points.T), u=along, s=len(along) * off**2)[0], along[-1])
        if line.tightest > _EASY:
            break
    _, beside = line.project(*points.T)
    return line, float(np.abs(beside).max())


def _line(spline: object, end: float) -> ReferenceLine:
    """Turn a spline into a reference line."""
    at = np.linspace(0.0, end, math.ceil(end / _PIECE) + 1)
    place, first, second = (np.array(splev(at, spline, der=order)) for order in range(3))
    pace, middle = np.hypot(*first), np.hypot(*splev(0.5 * (at[1:] + at[:-1]), spline, der=1))
    length = (pace[1:] + pace[:-1] + 4.0 * middle) / 6.0 * np.diff(at)
    s = np.concatenate([[0.0], np.cumsum(length)])
    return ReferenceLine(tuple(clothoids(s, place, first, second)), float(s[-1]))


def clothoids(
    s: NDArray[np.float64], place: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]
) -> list[Piece]:
    """Turn a curve into clothoids, each of which begins on it and has its curvature at both ends.

    Args:
        s: Where they begin and the last one ends, (P,) [m].
        place: x and y there, (2, P) [m].
        first, second: Derivatives of `place` by whatever it is a function of, (2, P).

    Raises:
        InputError: The curve stands still.
    """
    pace = np.hypot(*first)
    if not (pace > 0.0).all():
        raise InputError("The line turns back.")
    heading = np.unwrap(np.arctan2(first[1], first[0]))
    bend = np.round((first[0] * second[1] - first[1] * second[0]) / pace**3, 8)
    rows = np.stack([s, *place, heading, bend])[:, :-1]
    return [Piece(*row) for row in np.vstack([rows, np.diff(bend) / np.diff(s)]).T.tolist()]
