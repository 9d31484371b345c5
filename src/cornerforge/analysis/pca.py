"""Principal components of the features, with signs that do not depend on the solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis._sklearn import one_thread, principal_components

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


def project(values: NDArray[np.float64]) -> Projection:
    """Project cases on their first two principal components.

    A component's sign is arbitrary; here its loading of largest magnitude is positive (the first such feature when
    several are equal up to rounding), so that pictures of the same data agree.

    Args:
        values: Scaled features, shape (S, F), F >= 2, finite.

    Returns:
        The projection; all zero when there are fewer than two cases or all are alike.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    n_cases, n_features = values.shape
    if n_cases < 2 or not values.any():
        return Projection(np.zeros((n_cases, 2)), np.zeros(2), np.zeros((2, n_features)))
    with one_thread():
        components, shares = principal_components(values, 2)
    size = np.abs(components)
    # loadings that are equal in theory differ by rounding: take the first within a hair of the largest
    leading = np.argmax(size >= (1.0 - 1e-9) * size.max(axis=1, keepdims=True), axis=1)
    loadings = components * np.sign(components[np.arange(2), leading])[:, None]
    # einsum, not matmul: its sums do not depend on the number of BLAS threads
    points = np.einsum("sf,cf->sc", values - values.mean(axis=0), loadings)
    return Projection(points, shares, loadings)
