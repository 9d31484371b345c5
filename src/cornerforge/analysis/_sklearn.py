"""The only module that uses scikit-learn, an optional extra; it imports it on first use.

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

__all__ = ["k_means", "one_thread", "refine_k_means", "require_sklearn"]

FloatArray = NDArray[np.float64]


def require_sklearn() -> None:
    """Load scikit-learn, or say early that the extra is missing.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    _module("sklearn")
    _module("sklearn.cluster")
    _module("threadpoolctl")


def one_thread() -> AbstractContextManager[object]:
    """Hold BLAS and OpenMP to one thread; entering costs milliseconds, so do it around loops, not within.

    Raises:
        MissingExtraError: scikit-learn is not installed (it brings threadpoolctl).
    """
    return cast("AbstractContextManager[object]", _module("threadpoolctl").threadpool_limits(limits=1))


def k_means(points: FloatArray, k: int, *, n_init: int, seed: int) -> tuple[NDArray[np.intp], FloatArray]:
    """K-means with k-means++ starts.

    Args:
        points: Shape (S, 2) with at least k different rows.
        k: Number of clusters, at least 1.
        n_init: Number of starts; the best is returned.
        seed: Seed of the starts.

    Returns:
        Label of each point, shape (S,); centres, shape (k, 2).
    """
    kmeans_class = _module("sklearn.cluster").KMeans
    model = kmeans_class(n_clusters=k, n_init=n_init, random_state=seed).fit(points)
    return np.asarray(model.labels_, np.intp), np.asarray(model.cluster_centers_, np.float64)


def refine_k_means(points: FloatArray, centres: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """K-means from given centres.

    Args:
        points: Shape (S, 2).
        centres: Centres to begin with, shape (k, 2), k >= 1.

    Returns:
        Label of each point, shape (S,); centres, shape (k, 2).
    """
    kmeans_class = _module("sklearn.cluster").KMeans
    model = kmeans_class(n_clusters=len(centres), init=centres, n_init=1).fit(points)
    return np.asarray(model.labels_, np.intp), np.asarray(model.cluster_centers_, np.float64)


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError("scikit-learn", "analysis") from error
