"""Reference lines through the points of other people's roads, which are drawn as straight lines with kinks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import splev, splprep

from cornerforge.errors import InputError
from cornerforge.road.reference import Piece, ReferenceLine

__all__ = ["smooth_line", "ways"]

_OFFS = (0.007, 0.03, 0.1)
"""Root mean square by which the line may miss the drawn one [m], tried in this order."""
_EASY = 150.0
"""A line whose tightest radius is more than this needs no further smoothing [m]."""
_DENSE = 5.0
"""Distance of the points of the drawn line that it is laid through [m]."""
_PIECE = 4.0
"""Length of its clothoids [m]."""


def ways(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the way along a drawn line to each of its points (P, 2) [m]."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


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
    along = ways(points)
    dense = np.unique(np.concatenate([along, np.linspace(0.0, along[-1], math.ceil(along[-1] / _DENSE) + 1)]))
    x, y = (np.interp(dense, along, part) for part in points.T)
    for off in _OFFS:
        line = _line(splprep([x, y], u=dense, s=len(dense) * off**2)[0], along[-1])
        if line.tightest > _EASY:
            break
    _, beside = line.project(x, y)
    return line, float(np.abs(beside).max())


def _line(spline: object, end: float) -> ReferenceLine:
    """Turn a spline into clothoids, each of which begins on it and has its curvature at both ends."""
    at = np.linspace(0.0, end, math.ceil(end / _PIECE) + 1)
    (x, y), (dx, dy), (ddx, ddy) = (splev(at, spline, der=order) for order in range(3))
    pace = np.hypot(dx, dy)
    if not (pace > 0.0).all():
        raise InputError("The line turns back on itself.")
    heading, bend = np.unwrap(np.arctan2(dy, dx)), np.round((dx * ddy - dy * ddx) / pace**3, 8)
    middle = np.hypot(*splev(0.5 * (at[1:] + at[:-1]), spline, der=1))
    length = (pace[1:] + pace[:-1] + 4.0 * middle) / 6.0 * np.diff(at)
    s = np.concatenate([[0.0], np.cumsum(length)])
    rows = np.stack([s[:-1], x[:-1], y[:-1], heading[:-1], bend[:-1], np.diff(bend) / length], axis=1)
    return ReferenceLine(tuple(Piece(*row) for row in rows.tolist()), float(s[-1]))
