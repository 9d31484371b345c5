"""Bounds for tests that sample, from n alone (CONTRIBUTING, Tests).

A sampler that is right fails one of `comparisons` checks with a chance of at most `ALPHA`. Each bound is also the
smallest error that such a test can see, so a test states its n and is worth nothing where the bound is large.

The file is not called `statistics`: `tests/` is on the import path and would hide that module of Python.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

__all__ = ["ALPHA", "distance_to_law", "dkw_bound", "l1_bound", "l1_distance", "mean_bound", "rate_fits"]

ALPHA = 1e-6


def dkw_bound(n: int, comparisons: int = 1) -> float:
    """Of sup |F_n - F|, n independent draws (Dvoretzky, Kiefer and Wolfowitz 1956; constant by Massart 1990).

    >>> round(dkw_bound(10_000), 3)
    0.027
    """
    return math.sqrt(math.log(2.0 * comparisons / ALPHA) / (2.0 * n))


def mean_bound(low: float, high: float, n: int, comparisons: int = 1) -> float:
    """Of |mean - expectation|, n independent draws in [low, high] (Hoeffding 1963)."""
    return (high - low) * dkw_bound(n, comparisons)


def l1_bound(k: int, n: int, comparisons: int = 1) -> float:
    """Of sum |frequency - probability| over k outcomes, n independent draws (Weissman et al. 2003).

    >>> round(l1_bound(33, 100_000), 3)
    0.027
    """
    return math.sqrt(2.0 * (k * math.log(2.0) + math.log(comparisons / ALPHA)) / n)


def rate_fits(successes: int, n: int, p: float, comparisons: int = 1) -> bool:
    """Does a count agree with a rate? Two-sided exact binomial test.

    >>> rate_fits(500, 1000, 0.5), rate_fits(600, 1000, 0.5)
    (True, False)
    """
    return bool(stats.binomtest(successes, n, p).pvalue >= ALPHA / comparisons)


def distance_to_law(values: NDArray[np.float64], law: stats.rv_continuous) -> float:
    """sup |F_n - F| to a (frozen) continuous law of scipy."""
    return float(stats.kstest(values, law.cdf).statistic)


def l1_distance(counts: NDArray[np.int64], p: NDArray[np.float64]) -> float:
    """Sum |frequency - probability|."""
    return float(np.abs(counts / counts.sum() - p).sum())
