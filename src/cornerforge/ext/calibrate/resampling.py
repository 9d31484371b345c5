"""Intervals by resampling whole vehicles, and distances between distributions over fixed bins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge.results.validation import PartDistance

__all__ = ["RESAMPLES", "bootstrap_mean", "distance", "owner_sums", "resampled_weights"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RESAMPLES = 1000
_SEED = 2021


def resampled_weights(vehicles: int) -> Floats:
    """How often each of `vehicles` vehicles is drawn in each of 1000 resamples with a fixed seed, shape (1000, n)."""
    rng = np.random.Generator(np.random.Philox(_SEED))
    chosen = rng.integers(vehicles, size=(RESAMPLES, vehicles))
    weights = np.zeros((RESAMPLES, vehicles))
    np.add.at(weights, (np.arange(RESAMPLES)[:, None], chosen), 1.0)
    return weights


def bootstrap_mean(values: Floats, vehicle: Ints) -> tuple[float, float]:
    """95 % interval of a mean over decisions, by resampling whole vehicles: one driver's decisions are alike.

    Args:
        values: One number per decision, shape (n,), n at least 1.
        vehicle: Vehicle of each value, shape (n,).

    Returns:
        The 2.5 and 97.5 % points over 1000 resamples with a fixed seed; equal if there is but one vehicle.

    Source: percentile bootstrap over clusters, Efron and Tibshirani (1993).
    """
    _, owner = np.unique(vehicle, return_inverse=True)
    sums, sizes = np.bincount(owner, weights=values), np.bincount(owner)
    weights = resampled_weights(sums.size)
    low, high = np.percentile((weights @ sums) / (weights @ sizes), [2.5, 97.5])
    return float(low), float(high)


def owner_sums(rows: Floats, owner: Ints, owners: int) -> Floats:
    """Sum of the rows of each owner: (n, k) and (n,) to (owners, k)."""
    sums = np.zeros((owners, rows.shape[1]))
    np.add.at(sums, owner, rows)
    return sums


def distance(observed: Floats, expected: Floats, width: float, unit: str) -> PartDistance:
    """Distance between observed and expected counts, over equal bins.

    Args:
        observed: Counts by vehicle and bin, shape (V, k), V at least 1 and one count at least.
        expected: Expected counts, the same shape and the same sum for each vehicle.
        width: Width of a bin, in the quantity's unit.
        unit: Unit of the quantity.

    Returns:
        The distance with basic (reflected) bootstrap intervals, cut off at 0. A sample's distance is biased upwards;
        resampling adds about the same bias again, and the reflection removes it (Efron and Tibshirani 1993, section
        13).
    """
    gaps = np.cumsum(observed - expected, axis=1)
    sizes = observed.sum(axis=1)
    weights = resampled_weights(observed.shape[0])
    drawn = np.abs(weights @ gaps) / np.maximum(weights @ sizes, 1e-9)[:, None]
    apart = np.abs(gaps.sum(axis=0)) / sizes.sum()
    wasserstein, largest = float(apart.sum() * width), float(apart.max())
    return PartDistance(
        decisions=round(float(sizes.sum())),
        vehicles=int((sizes > 0).sum()),
        unit=unit,
        wasserstein=wasserstein,
        wasserstein_interval95=_reflected(wasserstein, drawn.sum(axis=1) * width),
        kolmogorov_smirnov=largest,
        kolmogorov_smirnov_interval95=_reflected(largest, drawn.max(axis=1)),
    )


def _reflected(found: float, drawn: Floats) -> tuple[float, float]:
    low, high = np.percentile(drawn, [2.5, 97.5])
    return max(0.0, float(2.0 * found - high)), max(0.0, float(2.0 * found - low))
