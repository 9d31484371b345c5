"""Exact DBSCAN in the plane, which splits cases into majority and minority; a stated rule chooses the radius.

scikit-learn's DBSCAN keeps every neighbourhood in memory, too much of it for 50,000 cases with heavy tails. In the
plane the same clusters follow from points sorted into cells (`density_grid.py`, ADR 0003).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_finite, check_integer
from cornerforge.analysis.density_grid import CELL_WIDTH, Cells, attach_border, join_cells, mark_cores
from cornerforge.errors import InputError

__all__ = [
    "MAJORITY_SHARE",
    "DensitySplit",
    "choose_eps",
    "choose_min_samples",
    "dbscan",
    "knee",
    "majority_of",
    "neighbour_distance",
    "split",
]

MAJORITY_SHARE = 0.1
"""A dense cluster belongs to the majority when it holds at least this share of all cases."""

NOISE = -1

_BLOCK = 65_536
"""Number of points that have their neighbours in memory at a time."""


@dataclass(frozen=True)
class DensitySplit:
    """Result of the density split.

    Attributes:
        eps: Radius of a neighbourhood, in units of the plane.
        min_samples: Cases within eps, itself included, that make a case a core of a cluster.
        labels: Dense cluster of each case, shape (S,), 0 the largest; -1 = noise.
        is_majority: The case is in a dense cluster with a share of at least `MAJORITY_SHARE`, shape (S,).
    """

    eps: float
    min_samples: int
    labels: NDArray[np.intp]
    is_majority: NDArray[np.bool_]


def split(points: NDArray[np.float64]) -> DensitySplit:
    """Split cases into majority (in large dense clusters) and minority (noise and small clusters): see `majority_of`.

    Args:
        points: Shape (S, 2), S >= 2, finite, not all equal.
    """
    min_samples = choose_min_samples(len(points))
    eps = choose_eps(points, min_samples)
    labels = dbscan(points, eps, min_samples)
    return DensitySplit(eps, min_samples, labels, majority_of(labels))


def majority_of(labels: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mark the majority: cases in dense clusters with a share of at least `MAJORITY_SHARE`, bool, shape (S,).

    When no cluster is large enough, the largest alone is the majority; when there is no cluster, everything is.

    Args:
        labels: Result of `dbscan`, shape (S,).
    """
    sizes = np.bincount(labels + 1, minlength=1)[1:]
    if sizes.size == 0:
        return np.ones(len(labels), np.bool_)
    is_large = sizes >= MAJORITY_SHARE * len(labels)
    is_large[0] = True
    return np.where(labels == NOISE, False, is_large[labels])


def choose_min_samples(n: int) -> int:
    """Twice the dimension (Sander et al. 1998), growing with the logarithm of n so that chance clumps stay noise.

    >>> choose_min_samples(20), choose_min_samples(50_000)
    (4, 11)
    """
    return min(n, max(4, int(np.ceil(np.log(n)))))


def neighbour_distance(points: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Distance from each point to its k-th nearest, itself the first, shape (S,); k in 1..S.

    Equal points count as one point with a weight: a k-d tree cannot separate them; 45,000 of them took minutes.
    """
    from scipy.spatial import KDTree

    order = np.lexsort((points[:, 1], points[:, 0]))
    is_new = np.concatenate([[True], (np.diff(points[order], axis=0) != 0.0).any(axis=1)])
    places, weight = points[order[is_new]], np.diff(np.append(np.flatnonzero(is_new), len(points)))
    tree = KDTree(places)
    at_places = np.empty(len(places))
    # in the order of the tree's leaves, neighbours are asked one after the other: less than half the time for a million
    for begin in range(0, len(places), _BLOCK):
        rows = tree.indices[begin : begin + _BLOCK]
        distance, neighbour = tree.query(places[rows], k=np.arange(1, min(k, len(places)) + 1))
        is_kth = np.cumsum(weight[neighbour], axis=1) >= k
        at_places[rows] = distance[np.arange(len(rows)), is_kth.argmax(axis=1)]
    found = np.empty(len(points))
    found[order] = at_places[np.cumsum(is_new) - 1]
    return found


def knee(values: NDArray[np.float64]) -> int:
    """Find the index at which an ascending curve is farthest from its chord (Satopaa et al. 2011, without smoothing).

    Args:
        values: Ascending, shape (n,), n >= 1.

    Returns:
        The index; the last one when all values are equal.

    >>> knee(np.array([1.0, 1.1, 1.2, 1.3, 9.0]))
    3
    """
    span = values[-1] - values[0]
    if span <= 0.0:
        return len(values) - 1
    return int(np.argmax(np.linspace(0.0, 1.0, len(values)) - (values - values[0]) / span))


def choose_eps(points: NDArray[np.float64], min_samples: int) -> float:
    """Radius of a neighbourhood: the knee of the sorted distances to the 2 x `min_samples`-th nearest case.

    A core needs half as many, a margin against chance gaps: at the knee for `min_samples` itself, points spread evenly
    along a line fall apart, and 13 % of one Gaussian cloud of 800 are noise. Distances of zero are left out: these
    cases are cores at any radius and say nothing of it.

    Args:
        points: Shape (S, 2), not all equal.
        min_samples: Parameter of DBSCAN.
    """
    distance = np.sort(neighbour_distance(points, min(len(points), 2 * min_samples)))
    distance = distance[distance > 0.0]
    smallest = 1e-6 * float(np.ptp(points, axis=0).max())
    if distance.size == 0:
        return smallest
    # a hair above, so that rounding does not decide about the very pair of cases that the distance comes from
    return float(max((1.0 + 1e-9) * distance[knee(distance)], smallest))


def dbscan(points: NDArray[np.float64], eps: float, min_samples: int) -> NDArray[np.intp]:
    """DBSCAN (Ester et al. 1996) of points in the plane, exactly as defined, in O(S log S) time and O(S) memory.

    A core has `min_samples` points within eps (itself included; the border counts); cores within eps of each other
    share a cluster. A border point that several clusters reach goes to the one with the nearest core, where the
    original gives it to whichever was found first.

    Args:
        points: Shape (S, 2), finite.
        eps: Radius of a neighbourhood, above 0 and at least 1e-12 of the extent of the points.
        min_samples: At least 1.

    Returns:
        Labels, shape (S,): 0 the largest cluster (ties: the one with the first point), -1 noise.

    Raises:
        InputError: A point is not finite, or eps or `min_samples` is out of range.

    >>> dbscan(np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 9.0]]), 1.0, 2).tolist()
    [0, 0, 0, -1]
    """
    check_integer("min_samples", min_samples, low=1)
    check_finite("points", points)
    if len(points) == 0:
        return np.empty(0, np.intp)
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max())
    if not eps > 0.0 or not np.isfinite(eps) or extent > 1e12 * eps:
        raise InputError(f"eps = {eps} is out of range; allowed: above 0, at least 1e-12 of the extent {extent:g}.")
    cell = np.floor((points - low) / (CELL_WIDTH * eps)).astype(np.int64)
    order = np.lexsort((cell[:, 1], cell[:, 0]))
    placed, cell = points[order], cell[order]
    is_new = np.concatenate([[True], (cell[1:] != cell[:-1]).any(axis=1)])
    start = np.append(np.flatnonzero(is_new), len(points))
    column, row = np.ascontiguousarray(cell[is_new].T)
    is_core = np.zeros(len(points), np.bool_)
    cluster = np.empty(len(column), np.int64)
    label = np.empty(len(points), np.int64)
    cells = Cells(placed, start, column, row, float(eps))
    mark_cores(cells, min_samples, np.zeros(5, np.int64), is_core)
    join_cells(cells, is_core, np.zeros(5, np.int64), np.empty((len(column), 4)), cluster)
    attach_border(cells, is_core, cluster, np.zeros(5, np.int64), label)
    labels = np.empty(len(points), np.intp)
    labels[order] = label
    return _by_size(labels)


def _by_size(labels: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number clusters by size, largest first, ties by first appearance; -1 stays."""
    is_in = labels != NOISE
    _, first, which, sizes = np.unique(labels[is_in], return_index=True, return_inverse=True, return_counts=True)
    rank = np.empty(len(sizes), np.intp)
    rank[np.lexsort((first, -sizes))] = np.arange(len(sizes))
    numbered = np.full(len(labels), NOISE, np.intp)
    numbered[is_in] = rank[which]
    return numbered
