"""K-means within a group of cases, with the number of clusters chosen by a stated rule; one is allowed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis._sklearn import k_means, one_thread, silhouette

__all__ = ["MAX_CLUSTERS", "MIN_CASES", "Clusters", "choose_k", "cluster"]

MAX_CLUSTERS = 8
MIN_CASES = 10
"""A smaller group is one cluster: its silhouettes say nothing."""

_SUBSAMPLE = 400
_REFERENCES = 12
_SIGMAS = 3.0
_STARTS = 2
_FINAL_STARTS = 5


@dataclass(frozen=True)
class Clusters:
    """Clusters of a group.

    Attributes:
        labels: Cluster of each case, shape (S,), 0 the largest.
        centres: Mean of each cluster, shape (k, 2).
    """

    labels: NDArray[np.intp]
    centres: NDArray[np.float64]


def cluster(points: NDArray[np.float64], *, seed: int = 0) -> Clusters:
    """Cluster the cases of a group.

    Args:
        points: Shape (S, 2), S >= 1, finite.
        seed: Of the subsample, the reference data and the starts.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    k = choose_k(points, seed=seed)
    if k == 1:
        return Clusters(np.zeros(len(points), np.intp), points.mean(axis=0, keepdims=True))
    with one_thread():
        labels, centres = k_means(points, k, n_init=_FINAL_STARTS, seed=seed)
    order = np.argsort(-np.bincount(labels, minlength=k), kind="stable")
    rank = np.empty(k, np.intp)
    rank[order] = np.arange(k)
    return Clusters(rank[labels], centres[order])


def choose_k(points: NDArray[np.float64], *, seed: int = 0) -> int:
    """Number of clusters: the k in 2..8 with the largest mean silhouette, or 1 when that shows no structure.

    "No structure" is measured: points spread evenly over the group's box along its principal axes (the reference of
    Tibshirani et al.'s gap statistic, 2001) have silhouettes too, and long boxes have large ones. The group's best must
    exceed the mean best of 12 such references by 3 of their standard deviations. A fixed cut, such as the often quoted
    0.5, calls every straight line clustered. A subsample of 400 cases decides; that bounds the time.

    Args:
        points: Shape (S, 2), finite.
        seed: Of the subsample, the reference data and the starts.

    Returns:
        From 1 to 8; 1 for fewer than 10 cases.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    if len(points) < MIN_CASES:
        return 1
    rng = np.random.default_rng(seed)
    sample = points if len(points) <= _SUBSAMPLE else points[rng.choice(len(points), _SUBSAMPLE, replace=False)]
    most = min(MAX_CLUSTERS, len(np.unique(sample, axis=0)) - 1, len(sample) // 3)
    if most < 2:
        return 1
    with one_thread():
        score, k = _best_silhouette(sample, most, seed)
        references = [_best_silhouette(_evenly_spread(sample, rng), most, seed)[0] for _ in range(_REFERENCES)]
    bound = float(np.mean(references) + _SIGMAS * np.std(references, ddof=1))
    return k if score > bound else 1


def _best_silhouette(points: NDArray[np.float64], most: int, seed: int) -> tuple[float, int]:
    """Largest mean silhouette over k = 2..most, and that k (the smallest of equals)."""
    scores = [silhouette(points, k_means(points, k, n_init=_STARTS, seed=seed)[0]) for k in range(2, most + 1)]
    best = int(np.argmax(scores))
    return scores[best], best + 2


def _evenly_spread(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """As many points, uniform over the box of `points` along their principal axes (in these axes), shape (S, 2)."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    along = np.einsum("sf,cf->sc", centred, axes)
    return np.asarray(rng.uniform(along.min(axis=0), along.max(axis=0), size=along.shape), np.float64)
