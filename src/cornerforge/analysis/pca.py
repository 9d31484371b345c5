"""Principal components of the features, with signs that do not depend on the solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis._sklearn import one_thread
from cornerforge.analysis.features import Scaling, row_blocks

__all__ = ["Projection", "project"]


@dataclass(frozen=True)
class Projection:
    """Cases in the plane of the first two principal components.

    Attributes:
        points: Shape (S, 2), centred, in units of the (scaled) features.
        explained_variance: Share of the total variance of each component, shape (2,), descending, at most 1 in sum.
        loadings: Weight of each feature in each component, shape (2, F), rows of length 1.
    """

    points: NDArray[np.float64]
    explained_variance: NDArray[np.float64]
    loadings: NDArray[np.float64]


def project(values: NDArray[np.float64], scaling: Scaling) -> Projection:
    """Project cases on the first two principal components of their z-scores.

    A component's sign is arbitrary; here its loading of largest magnitude is positive (the first of them when several
    are equal up to rounding), so that pictures of the same data agree. The components are eigenvectors of the
    correlation matrix, which is summed block by block: a million cases of 75 features need no second table.

    Args:
        values: Features in SI units, shape (S, F), F >= 2, finite.
        scaling: Mean and spread of these values.

    Returns:
        The projection; all zero when there are fewer than two cases or all are alike.

    Raises:
        MissingExtraError: scikit-learn is not installed (it brings what holds BLAS to one thread).
    """
    n_cases, n_features = values.shape
    if n_cases < 2 or scaling.is_trivial:
        return Projection(np.zeros((n_cases, 2)), np.zeros(2), np.zeros((2, n_features)))
    # one thread: with several, the order of the sums and so the last bits would change from run to run
    with one_thread():
        products = np.zeros((n_features, n_features))
        for block in row_blocks(values):
            scaled = scaling.scaled(block)
            products += scaled.T @ scaled
        variances, vectors = np.linalg.eigh(products / n_cases)
        components = vectors[:, :-3:-1].T
        shares = np.maximum(variances[:-3:-1], 0.0) / np.trace(products / n_cases)
        size = np.abs(components)
        # loadings that are equal in theory differ by rounding: take the first within a hair of the largest
        leading = np.argmax(size >= (1.0 - 1e-9) * size.max(axis=1, keepdims=True), axis=1)
        loadings = components * np.sign(components[np.arange(2), leading])[:, None]
        points = np.concatenate([scaling.scaled(block) @ loadings.T for block in row_blocks(values)])
    return Projection(points, shares, loadings)
