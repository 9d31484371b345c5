"""Roads of other people's files, laid straight: from points on a plane to ways along and across a road.

A road is straight if its line is nowhere more than 0.05 m off the line between its ends: then the plane is turned and
shifted, and distances stay. A gentle curve is straightened: its line is replaced by a polynomial, which may be 0.3 m
off, and points are given by their foot on it. That shortens lengths on the outer side of the curve and stretches
lengths on the inner side, by distance / radius; the radius must be 500 m or more, so by 2 % at 10 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import DataError

__all__ = ["Course", "Placed", "course_along"]

_STRAIGHT = 0.05
_OFF = 0.3
_TIGHTEST = 500.0
_DEGREES = (3, 5)
"""The first that will do: a higher one follows every kink of a drawn line."""
_SHORTEST = 5.0
_STEP = 0.5
_ROUNDS = 20
"""Rounds of the search for a foot: each is better by a factor of radius / distance, at least 20 on a wide road."""


@dataclass(frozen=True)
class Placed:
    """Where points are on a road; all (P,).

    Attributes:
        along: Way along the road [m], from where the foot of the file's origin is.
        across: To the left of the road's line [m].
        turned: The road's own direction there [rad], in the file's system.
        stretched: Factor by which ways along the road are longer than in the file.
    """

    along: NDArray[np.float64]
    across: NDArray[np.float64]
    turned: NDArray[np.float64]
    stretched: NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """The line of a road.

    Attributes:
        start: Its first point (2,) [m].
        direction: From its first point to its last [rad].
        length: Distance between the two [m].
        off: How far it is off the line between the two, to the left: coefficients of a polynomial in the way from
            `start` [m], the highest power first; zeros: it is straight.
    """

    start: NDArray[np.float64]
    direction: float
    length: float
    off: NDArray[np.float64]

    @property
    def is_straight(self) -> bool:
        """Do distances stay as they were?"""
        return not self.off.any()

    @property
    def radius(self) -> float:
        """Radius of the tightest place [m]; inf: the road is straight."""
        u = np.linspace(0.0, self.length, 101)
        bend = float(np.abs(self._bend(u)).max())
        return math.inf if bend == 0.0 else 1.0 / bend

    def place(self, points: NDArray[np.float64]) -> Placed:
        """Say where points (P, 2) [m] are on the road; beyond its ends it goes on straight."""
        cos, sin = math.cos(self.direction), math.sin(self.direction)
        offset = points - self.start
        u, v = offset @ np.array([cos, sin]), offset @ np.array([-sin, cos])
        begin = float(self.start @ np.array([cos, sin]))
        if self.is_straight:
            none = np.zeros(len(points))
            return Placed(begin + u, v, none + self.direction, none + 1.0)
        foot = u.copy()
        for _ in range(_ROUNDS):
            foot = u + (v - self._beside(foot)) * self._slope(foot)
        angle = np.arctan(self._slope(foot))
        across = (v - self._beside(foot)) * np.cos(angle) - (u - foot) * np.sin(angle)
        along = begin + self._way(foot)
        return Placed(along, across, self.direction + angle, 1.0 / (1.0 - self._bend(foot) * across))

    def _inside(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.clip(u, 0.0, self.length)

    def _beside(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.polyval(self.off, self._inside(u)) + self._slope(u) * (u - self._inside(u))

    def _slope(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        slope: NDArray[np.float64] = np.polyval(np.polyder(self.off), self._inside(u))
        return slope

    def _bend(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the curvature [1/m], to the left positive."""
        inside = (u >= 0.0) & (u <= self.length)
        bend: NDArray[np.float64] = np.polyval(np.polyder(self.off, 2), self._inside(u))
        bend *= inside / np.hypot(1.0, self._slope(u)) ** 3
        return bend

    def _way(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the way along the curve from its start to each foot [m]."""
        at = np.linspace(0.0, self.length, max(2, math.ceil(self.length / _STEP)))
        pace = np.hypot(1.0, self._slope(at))
        ways = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(at))])
        beyond = np.hypot(1.0, self._slope(u)) * (u - self._inside(u))
        way: NDArray[np.float64] = np.interp(self._inside(u), at, ways) + beyond
        return way


def course_along(line: NDArray[np.float64], place: str) -> Course:
    """Make the course of a road along a line of points (P, 2) [m], in the direction of travel.

    Args:
        line: At least two points.
        place: Where the line stands in the source, for messages.

    Raises:
        DataError: The line is shorter than 5 m, or neither straight nor a gentle curve.
    """
    start, end = line[0], line[-1]
    length = float(np.hypot(*(end - start)))
    if length < _SHORTEST:
        raise DataError(f"{place}: the road is {length:.3g} m long from end to end; {_SHORTEST:g} m are needed.")
    direction = math.atan2(end[1] - start[1], end[0] - start[0])
    course = Course(start, direction, length, np.zeros(1))
    placed = course.place(line)
    u, v = placed.along - float(placed.along[0]), placed.across
    if np.abs(v).max() <= _STRAIGHT:
        return course
    even = np.linspace(0.0, length, max(8, math.ceil(length)))
    if (np.diff(u) >= 0.0).all():
        off = np.interp(even, u, v)
        for degree in _DEGREES:
            curved = Course(start, direction, length, np.polyfit(even, off, degree))
            if np.abs(np.polyval(curved.off, even) - off).max() <= _OFF and curved.radius >= _TIGHTEST:
                return curved
    raise DataError(
        f"{place}: the road is not straight: its middle is up to {np.abs(v).max():.1f} m off the line between its "
        f"ends, {length:.0f} m apart. Straight roads are read, and gentle curves, of a radius of {_TIGHTEST:g} m or "
        f"more. Cut out a straight part."
    )
