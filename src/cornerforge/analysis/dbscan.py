"""Majority and minority of cases: exact DBSCAN in the plane, with the radius chosen by a stated rule.

scikit-learn's DBSCAN keeps every neighbourhood in memory, too much of it for 50,000 cases with heavy tails. In the
plane the same clusters follow from far less (ADR 0003): a case is a core when its distance to its `min_samples`-th
nearest case is at most eps, and two cores share a cluster exactly when a chain of edges of the Delaunay triangulation,
none longer than eps, joins them (the triangulation contains a Euclidean minimum spanning tree).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, KDTree, QhullError

__all__ = [
    "MAJORITY_SHARE",
    "DensitySplit",
    "choose_eps",
    "choose_min_samples",
    "dbscan",
    "knee",
    "neighbour_distance",
    "split",
]

MAJORITY_SHARE = 0.1
"""A dense cluster belongs to the majority when it holds at least this share of all cases."""

NOISE = -1


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
    """Split cases into majority (in large dense clusters) and minority (noise and small clusters).

    When no cluster is large enough, the largest alone is the majority; when there is no cluster, everything is.

    Args:
        points: Shape (S, 2), S >= 2, finite, not all equal.
    """
    min_samples = choose_min_samples(len(points))
    eps = choose_eps(points, min_samples)
    labels = dbscan(points, eps, neighbour_distance(points, min_samples))
    sizes = np.bincount(labels + 1, minlength=1)[1:]
    if sizes.size == 0:
        return DensitySplit(eps, min_samples, labels, np.ones(len(points), np.bool_))
    is_large = sizes >= MAJORITY_SHARE * len(points)
    is_large[0] = True
    return DensitySplit(eps, min_samples, labels, np.where(labels == NOISE, False, is_large[labels]))


def choose_min_samples(n: int) -> int:
    """Twice the dimension (Sander et al. 1998), growing with the logarithm of n so that chance clumps stay noise.

    >>> choose_min_samples(20), choose_min_samples(50_000)
    (4, 11)
    """
    return min(n, max(4, int(np.ceil(np.log(n)))))


def neighbour_distance(points: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Distance from each point to its k-th nearest, itself the first, shape (S,); k in 1..S."""
    distance = KDTree(points).query(points, k=[k])[0]
    return np.asarray(distance, np.float64)[:, 0]


def knee(values: NDArray[np.float64]) -> int:
    """Index where an ascending curve leaves its chord most (Satopaa et al. 2011, without smoothing).

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
    along a line fall apart, and 13 % of one Gaussian cloud of 800 are noise. Distances of zero are left out: such cases
    are cores at any radius and say nothing of it.

    Args:
        points: Shape (S, 2), not all equal.
        min_samples: Of DBSCAN.
    """
    distance = np.sort(neighbour_distance(points, min(len(points), 2 * min_samples)))
    distance = distance[distance > 0.0]
    smallest = 1e-6 * float(np.ptp(points, axis=0).max())
    if distance.size == 0:
        return smallest
    # a hair above, so that rounding does not decide about the very pair of cases that the distance comes from
    return float(max((1.0 + 1e-9) * distance[knee(distance)], smallest))


def dbscan(points: NDArray[np.float64], eps: float, distance: NDArray[np.float64]) -> NDArray[np.intp]:
    """DBSCAN (Ester et al. 1996) of points in the plane, in O(S log S) time and O(S) memory.

    Clusters of cores and noise are those of the definition. A border point that several clusters reach goes to the one
    with the nearest core, where the original gives it to whichever was found first.

    Args:
        points: Shape (S, 2), finite.
        eps: Radius of a neighbourhood.
        distance: To each point's `min_samples`-th nearest, itself the first, shape (S,).

    Returns:
        Labels, shape (S,): 0 the largest cluster (ties: the one with the first point), -1 noise.
    """
    labels = np.full(len(points), NOISE, dtype=np.intp)
    is_core = distance <= eps
    if not is_core.any():
        return labels
    cores, which = np.unique(points[is_core], axis=0, return_inverse=True)
    core_labels = _components(cores, eps)
    labels[is_core] = core_labels[which.ravel()]
    rest = np.flatnonzero(~is_core)
    if rest.size:
        to_core, nearest = KDTree(cores).query(points[rest])
        labels[rest] = np.where(to_core <= eps, core_labels[nearest], NOISE)
    return _by_size(labels)


def _components(cores: NDArray[np.float64], eps: float) -> NDArray[np.intp]:
    """Component of each of the different points (n, 2) when those at most eps apart are joined, shape (n,)."""
    edges = _candidate_edges(cores)
    length = np.hypot(*(cores[edges[:, 0]] - cores[edges[:, 1]]).T)
    near = edges[length <= eps]
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(cores), len(cores)))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)


def _candidate_edges(points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Edges (e, 2) that contain a Euclidean minimum spanning tree of different points."""
    try:
        mesh = Delaunay(points)
    except (QhullError, ValueError):
        # fewer than three points, or all on one line: neighbours along the line (rows are sorted by x, then y)
        order = np.arange(len(points), dtype=np.intp)
        return np.stack([order[:-1], order[1:]], axis=1)
    corners = mesh.simplices
    # coplanar: points that rounding keeps out of the mesh, with the mesh point nearest to each
    return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]], mesh.coplanar[:, [0, 2]]])


def _by_size(labels: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number clusters by size, largest first, ties by first appearance; -1 stays."""
    found, first, sizes = np.unique(labels[labels != NOISE], return_index=True, return_counts=True)
    rank = np.empty(len(found), np.intp)
    rank[np.lexsort((first, -sizes))] = np.arange(len(found))
    return np.where(labels == NOISE, NOISE, rank[labels])
