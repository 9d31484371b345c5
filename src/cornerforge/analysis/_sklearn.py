"""The one place that meets scikit-learn, an optional extra, imported on first use.

Callers wrap their work in `one_thread`: scikit-learn adds up the parts of its threads in the order in which they
finish, so that with several the last bits, and with them a cluster's border, would differ from run to run.
"""

from __future__ import annotations

import importlib
from contextlib import AbstractContextManager
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import MissingExtraError

__all__ = ["k_means", "one_thread", "principal_components", "require_sklearn", "silhouette"]

FloatArray = NDArray[np.float64]


def require_sklearn() -> None:
    """Say early that the extra is missing.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    _module("sklearn")


def one_thread() -> AbstractContextManager[object]:
    """Hold BLAS and OpenMP to one thread; entering costs milliseconds, so do it around loops, not within.

    Raises:
        MissingExtraError: scikit-learn is not installed (it brings threadpoolctl).
    """
    return cast("AbstractContextManager[object]", _module("threadpoolctl").threadpool_limits(limits=1))


def principal_components(values: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Directions of largest variance and their shares of it.

    Args:
        values: Shape (S, F) with S, F >= n.
        n: How many.

    Returns:
        Unit directions, shape (n, F), of either sign; shares of the total variance, shape (n,), descending.
    """
    pca_class = _module("sklearn.decomposition").PCA
    # "full": the default would choose a randomised solver for wide data in older versions
    model = pca_class(n_components=n, svd_solver="full").fit(values)
    return np.asarray(model.components_, np.float64), np.asarray(model.explained_variance_ratio_, np.float64)


def k_means(points: FloatArray, k: int, *, n_init: int, seed: int) -> tuple[NDArray[np.intp], FloatArray]:
    """K-means with k-means++ starts.

    Args:
        points: Shape (S, 2) with at least k different rows.
        k: Number of clusters, at least 1.
        n_init: Number of starts; the best is returned.
        seed: Of the starts.

    Returns:
        Label of each point, shape (S,); centres, shape (k, 2).
    """
    kmeans_class = _module("sklearn.cluster").KMeans
    model = kmeans_class(n_clusters=k, n_init=n_init, random_state=seed).fit(points)
    return np.asarray(model.labels_, np.intp), np.asarray(model.cluster_centers_, np.float64)


def silhouette(points: FloatArray, labels: NDArray[np.intp]) -> float:
    """Mean silhouette of a partition, in [-1, 1] (Rousseeuw 1987); needs 2 to S - 1 labels; memory S^2."""
    score = _module("sklearn.metrics").silhouette_score
    return float(score(points, labels))


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError("scikit-learn", "analysis") from error
