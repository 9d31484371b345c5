"""Reference line of a road in the world's plane: pieces along which the curvature changes evenly.

A line, an arc and a clothoid are one thing: curvature `k + c u` after u metres of a piece. The heading follows in
closed form, the place by Gauss's quadrature, whose error is below 1e-9 m as no piece turns by more than 1 rad. Each
piece has a place of its own, so that errors do not add up, and lines drawn by others keep the gaps that they have.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cornerforge.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import ArrayLike, NDArray

__all__ = ["Piece", "Pose", "ReferenceLine"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
_MOST_TURN = 1.0
"""A piece that turns by more is divided [rad]."""
_CIRCLE = 2.0 * np.pi
_STEP = 2.0
"""Distance of the places among which the one nearest to a point is looked for [m]."""
_ROUNDS = 12
_NEAR = 1e-9


class Piece(NamedTuple):
    """A piece of a line.

    Attributes:
        s: Where it begins along the line [m].
        x, y, heading: Pose at its begin [m, m, rad], east, north, from the east to the left.
        curvature: At its begin, to the left positive [1/m].
        change: Of the curvature along it [1/m2].
    """

    s: float
    x: float
    y: float
    heading: float
    curvature: float = 0.0
    change: float = 0.0


class Pose(NamedTuple):
    """Poses on a plane, arrays of one shape: [m, m, rad, 1/m]."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    curvature: NDArray[np.float64]


@dataclass(frozen=True)
class ReferenceLine:
    """A line along a road; before its begin and behind its end it goes on straight.

    Attributes:
        pieces: At least one, by s; the first begins at 0.
        length: [m].
    """

    pieces: tuple[Piece, ...]
    length: float

    @classmethod
    def of_curvature(
        cls, parts: Iterable[tuple[float, float, float]], pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> ReferenceLine:
        """Make a line without gaps of parts: (length [m], curvature at its begin and at its end [1/m]).

        Args:
            parts: In the order of travel; lengths above 0.
            pose: Where it begins, x, y and heading.

        A bend to the left by a right angle, and what is 10 m to its left:
        >>> bend = ReferenceLine.of_curvature([(157.0796326794897, 0.01, 0.01)])
        >>> [round(float(part), 3) for part in bend.at(157.0796326794897, 10.0)]
        [90.0, 100.0, 1.571, 0.011]
        """
        pieces: list[Piece] = []
        s, (x, y, heading) = 0.0, pose
        for length, begin, end in parts:
            change = (end - begin) / length
            part = cls((Piece(0.0, x, y, heading, begin, change),), length)
            pieces.append(Piece(s, x, y, heading, begin, change))
            x, y, heading, _ = (float(value) for value in part.at(length))
            s += length
        return cls(tuple(pieces), s)

    def __post_init__(self) -> None:
        """Check it.

        Raises:
            InputError: There is no piece, the first does not begin at 0, they are not in order, a number is not finite,
                or one turns by more than a full circle.
        """
        begins = [piece.s for piece in self.pieces]
        if not begins or begins[0] != 0.0 or not all(length > 0.0 for length in np.diff([*begins, self.length])):
            raise InputError("A reference line needs pieces that begin at 0 and follow each other.")
        if not np.isfinite([self.length, *itertools.chain(*self.pieces)]).all():
            raise InputError("A number of the reference line is not finite.")
        for piece, length in self._lengths():
            if _turn(piece, length) > _CIRCLE:
                raise InputError(f"The reference line turns by more than a full circle in one piece, at {piece.s:g} m.")

    def _lengths(self) -> Iterator[tuple[Piece, float]]:
        """Go through the pieces, each with its length."""
        ends = [*(piece.s for piece in self.pieces[1:]), self.length]
        return ((piece, end - piece.s) for piece, end in zip(self.pieces, ends, strict=True))

    @cached_property
    def _table(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pieces (P, 6), none of which turns much, and the length of each (P,)."""
        rows: list[tuple[float, ...]] = []
        lengths: list[float] = []
        for piece, length in self._lengths():
            n = max(1, int(np.ceil(_turn(piece, length) / _MOST_TURN)))
            row = np.array([piece], np.float64)
            for k in range(n):
                rows.append(tuple(row[0]))
                lengths.append(length / n)
                if k < n - 1:
                    u = np.array([length / n])
                    x, y, heading = _go(row, u)
                    bend = row[0, 4] + row[0, 5] * u[0]
                    row = np.array([[row[0, 0] + u[0], x[0], y[0], heading[0], bend, row[0, 5]]])
        return np.array(rows), np.array(lengths)

    def at(self, s: ArrayLike, d: ArrayLike = 0.0) -> Pose:
        """Give the pose at places along the line [m] and to its left [m], of one shape together."""
        along, aside = np.broadcast_arrays(np.asarray(s, np.float64), np.asarray(d, np.float64))
        table, lengths = self._table
        flat = along.ravel()
        k = np.clip(np.searchsorted(table[:, 0], flat, side="right") - 1, 0, len(table) - 1)
        row, u = table[k], flat - table[k, 0]
        inside = np.clip(u, 0.0, lengths[k])
        x, y, heading = _go(row, inside)
        within = (flat >= 0.0) & (flat <= self.length)
        bend = np.where(within, row[:, 4] + row[:, 5] * inside, 0.0)
        beyond = np.where(within, 0.0, u - inside)
        x, y = x + beyond * np.cos(heading), y + beyond * np.sin(heading)
        left = aside.ravel()
        x, y = x - left * np.sin(heading), y + left * np.cos(heading)
        found = (x, y, heading, bend / (1.0 - bend * left))
        return Pose(*(part.reshape(along.shape) for part in found))

    def project(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Say where points are: along the line and to its left [m], of the shape of x and y.

        The nearest place counts; a point from which two are equally near is given one of them.
        """
        across, up = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        points = np.stack([across.ravel(), up.ravel()], axis=1)
        places, tree = self._places
        s = places[tree.query(points)[1]]
        for _ in range(_ROUNDS):
            pose = self.at(s)
            ahead, left = _turned(points, pose)
            step = ahead / np.maximum(1.0 - pose.curvature * left, 0.1)
            s = s + step
            if np.abs(step).max(initial=0.0) < _NEAR:
                break
        _, left = _turned(points, self.at(s))
        return s.reshape(across.shape), left.reshape(across.shape)

    @cached_property
    def _places(self) -> tuple[NDArray[np.float64], Any]:
        """Places along it and a tree of their points."""
        from scipy.spatial import cKDTree

        s = np.linspace(0.0, self.length, max(2, int(np.ceil(self.length / _STEP)) + 1))
        pose = self.at(s)
        return s, cKDTree(np.stack([pose.x, pose.y], axis=1))

    @property
    def gaps(self) -> NDArray[np.float64]:
        """Gap and kink between each piece and the one before, (P - 1, 2) [m, rad]."""
        found = []
        for before, after in itertools.pairwise(self.pieces):
            end = ReferenceLine((before._replace(s=0.0),), after.s - before.s).at(after.s - before.s)
            turn = np.remainder(after.heading - end.heading + np.pi, 2.0 * np.pi) - np.pi
            found.append((float(np.hypot(after.x - end.x, after.y - end.y)), float(abs(turn))))
        return np.array(found).reshape(-1, 2)

    @property
    def tightest(self) -> float:
        """Radius of its tightest place [m]; inf: it is straight."""
        bend = max(max(abs(one.curvature), abs(one.curvature + one.change * length)) for one, length in self._lengths())
        return float("inf") if bend == 0.0 else 1.0 / bend


def _turn(piece: Piece, length: float) -> float:
    """Say by how much a piece turns at most, there and back counted together [rad]."""
    return abs(piece.curvature) * length + 0.5 * abs(piece.change) * length * length


def _go(row: NDArray[np.float64], u: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Go u metres along pieces (Q, 6): x, y and heading (Q,)."""
    v = 0.5 * u[:, None] * (_NODES + 1.0)
    heading = row[:, 3:4] + v * (row[:, 4:5] + 0.5 * v * row[:, 5:6])
    half = 0.5 * u
    x = row[:, 1] + half * (np.cos(heading) @ _WEIGHTS)
    y = row[:, 2] + half * (np.sin(heading) @ _WEIGHTS)
    return x, y, row[:, 3] + u * (row[:, 4] + 0.5 * u * row[:, 5])


def _turned(points: NDArray[np.float64], pose: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Say how far points (Q, 2) are ahead and to the left of poses."""
    dx, dy = points[:, 0] - pose.x, points[:, 1] - pose.y
    cos, sin = np.cos(pose.heading), np.sin(pose.heading)
    return dx * cos + dy * sin, dy * cos - dx * sin
