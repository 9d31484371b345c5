"""K-means within a group of cases, with the number of clusters chosen by a stated rule; one is allowed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis._sklearn import k_means, one_thread, refine_k_means

__all__ = ["MAX_CLUSTERS", "MIN_CASES", "Choice", "Clusters", "choose_k", "cluster", "k_means_in", "mean_silhouette"]

MAX_CLUSTERS = 8
MIN_CASES = 10
"""Fewer cases than this form one cluster, because their silhouettes say nothing."""

_SUBSAMPLE = 400
_START_SAMPLE = 10_000
_REFERENCES = 12
_SIGMAS = 3.0
_STARTS = 2
_FINAL_STARTS = 5


@dataclass(frozen=True)
class Choice:
    """Why a group has as many clusters as it has.

    Attributes:
        k: Number of clusters, 1 to 8.
        scores: Mean silhouette of k = 2, 3, ... clusters, in [-1, 1]; empty where the group is too small to ask.
        bound: What the largest must exceed, else k = 1; None where `scores` is empty.
    """

    k: int
    scores: tuple[float, ...]
    bound: float | None

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values; the scores by number of clusters."""
        return {
            "k": self.k,
            "silhouettes": {str(k): score for k, score in enumerate(self.scores, 2)},
            "bound": self.bound,
        }


@dataclass(frozen=True)
class Clusters:
    """Clusters of a group.

    Attributes:
        labels: Cluster of each case, shape (S,), 0 the largest.
        centres: Mean of each cluster, shape (k, 2).
        choice: Why there are k.
    """

    labels: NDArray[np.intp]
    centres: NDArray[np.float64]
    choice: Choice


def cluster(points: NDArray[np.float64], *, seed: int = 0) -> Clusters:
    """Cluster the cases of a group.

    Args:
        points: Shape (S, 2), S >= 1, finite.
        seed: Seed of the subsamples, the reference data and the starts.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    choice = choose_k(points, seed=seed)
    labels, centres = k_means_in(points, choice.k, seed=seed)
    return Clusters(labels, centres, choice)


def k_means_in(points: NDArray[np.float64], k: int, *, seed: int = 0) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """K-means with k clusters, the largest first.

    The best of five k-means++ starts; with more than 10,000 points the starts are compared on so many of them, and the
    best one's centres go on with all.

    Args:
        points: Shape (S, 2), with at least k different rows.
        k: At least 1.
        seed: Seed of the subsample and the starts.

    Returns:
        Label of each point, shape (S,), 0 the largest cluster; mean of each cluster, shape (k, 2).

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    if k == 1:
        return np.zeros(len(points), np.intp), points.mean(axis=0, keepdims=True)
    sample = _sample_of(points, _START_SAMPLE, np.random.default_rng(seed))
    with one_thread():
        labels, centres = k_means(sample, k, n_init=_FINAL_STARTS, seed=seed)
        if len(sample) < len(points):
            labels, centres = refine_k_means(points, centres)
    order = np.argsort(-np.bincount(labels, minlength=k), kind="stable")
    rank = np.empty(k, np.intp)
    rank[order] = np.arange(k)
    return rank[labels], centres[order]


def choose_k(points: NDArray[np.float64], *, seed: int = 0) -> Choice:
    """Number of clusters: the k in 2..8 with the largest mean silhouette, or 1 when that shows no structure.

    "No structure" has a measure: points spread evenly over the group's box along its principal axes (the reference of
    Tibshirani et al.'s gap statistic, 2001) have silhouettes too, and long boxes have large ones. The group's best must
    exceed the mean best of 12 references of this kind by 3 of their standard deviations. A fixed cut, such as the often
    quoted 0.5, calls every straight line clustered. A subsample of 400 cases decides; that bounds the time.

    Args:
        points: Shape (S, 2), finite.
        seed: Seed of the subsample, the reference data and the starts.

    Returns:
        k from 1 to 8, with the silhouettes and the bound; 1 without these for fewer than 10 cases.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    if len(points) < MIN_CASES:
        return Choice(1, (), None)
    rng = np.random.default_rng(seed)
    sample = _sample_of(points, _SUBSAMPLE, rng)
    most = min(MAX_CLUSTERS, _distinct(sample) - 1, len(sample) // 3)
    if most < 2:
        return Choice(1, (), None)
    with one_thread():
        scores = _silhouettes(sample, most, seed)
        references = [max(_silhouettes(_evenly_spread(sample, rng), most, seed)) for _ in range(_REFERENCES)]
    bound = float(np.mean(references) + _SIGMAS * np.std(references, ddof=1))
    return Choice(int(np.argmax(scores)) + 2 if max(scores) > bound else 1, tuple(scores), bound)


def _sample_of(points: NDArray[np.float64], most: int, rng: np.random.Generator) -> NDArray[np.float64]:
    return points if len(points) <= most else points[rng.choice(len(points), most, replace=False)]


def _silhouettes(points: NDArray[np.float64], most: int, seed: int) -> list[float]:
    """Mean silhouette of k = 2..most clusters."""
    from scipy.spatial.distance import cdist

    distance = cdist(points, points)
    return [mean_silhouette(distance, k_means(points, k, n_init=_STARTS, seed=seed)[0], k) for k in range(2, most + 1)]


def mean_silhouette(distance: NDArray[np.float64], labels: NDArray[np.intp], k: int) -> float:
    """Mean silhouette of a partition, in [-1, 1] (Rousseeuw 1987); a case alone in its cluster counts 0.

    Args:
        distance: Between all cases, shape (S, S). Asking for it saves most of the time where one set of cases is
            clustered several times.
        labels: Cluster of each case, each of 0..k-1 at least once, shape (S,).
        k: Number of clusters, at least 2.
    """
    rows = np.arange(len(labels))
    member = (labels[:, None] == np.arange(k)).astype(np.float64)
    total = np.einsum("ij,jc->ic", distance, member, optimize=True)
    size = member.sum(axis=0)
    own = size[labels]
    inner = total[rows, labels] / np.maximum(own - 1.0, 1.0)
    other = total / size
    other[rows, labels] = np.inf
    outer = other.min(axis=1)
    longest = np.maximum(inner, outer)
    value = np.where((own > 1.0) & (longest > 0.0), (outer - inner) / np.where(longest > 0.0, longest, 1.0), 0.0)
    return float(value.mean())


def _evenly_spread(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw as many points, uniform over the box of `points` along their principal axes, shape (S, 2)."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    along = np.einsum("sf,cf->sc", centred, axes)
    return np.asarray(rng.uniform(along.min(axis=0), along.max(axis=0), size=along.shape), np.float64)


def _distinct(points: NDArray[np.float64]) -> int:
    """Count the points, (S, 2), that k-means can tell apart: those nearer than 1e-9 of their spread count as one."""
    step = 1e-9 * float(np.ptp(points, axis=0).max())
    return 1 if step == 0.0 else len(np.unique(np.rint(points / step), axis=0))
