"""Exact intervals of crash rates, per test and per mile, and of their ratios; and one of sums of weights."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cornerforge._checks import check_integer, check_number
from cornerforge.errors import InputError

__all__ = ["binomial_interval", "poisson_interval", "rate_ratio_interval", "share_interval", "weighted_interval"]


def binomial_interval(crashes: int, tests: int, confidence: float = 0.95) -> tuple[float, float]:
    """Give the Clopper-Pearson interval of a probability, right in at least `confidence` of all repetitions.

    Args:
        crashes: Number of tests with a crash, 0 to `tests`.
        tests: Number of independent tests, at least 1.
        confidence: In (0, 1).

    Returns:
        Low and high; low is 0 with no crash, high is 1 with all.

    Raises:
        InputError: A number is out of range.

    Source: Clopper and Pearson (1934), by the beta distribution's quantiles.

    >>> low, high = binomial_interval(0, 100)
    >>> low, round(high, 5)
    (0.0, 0.03622)
    """
    check_integer("tests", tests, low=1)
    check_integer("crashes", crashes, low=0, high=tests)
    check_number("confidence", confidence, low=1e-9, high=1.0 - 1e-9)
    tail = 0.5 * (1.0 - confidence)
    if crashes == 0:  # as usual on a road; these are betaincinv's bits, and SciPy takes 0.2 s to load
        return 0.0, -math.expm1(math.log1p(tail - 1.0) / tests)
    from scipy.special import betaincinv

    low = float(betaincinv(crashes, tests - crashes + 1, tail))
    high = 1.0 if crashes == tests else float(betaincinv(crashes + 1, tests - crashes, 1.0 - tail))
    return low, high


def poisson_interval(count: int, confidence: float = 0.95) -> tuple[float, float]:
    """Give the exact (Garwood) interval of a Poisson mean; divide by the exposure, such as miles, for a rate.

    Args:
        count: Events seen, at least 0.
        confidence: In (0, 1).

    Returns:
        Low and high; low is 0 with no event.

    Raises:
        InputError: A number is out of range.

    Source: Garwood (1936), by the gamma distribution's quantiles.

    >>> low, high = poisson_interval(0)
    >>> low, round(high, 3)
    (0.0, 3.689)
    """
    from scipy.special import gammaincinv

    check_integer("count", count, low=0)
    check_number("confidence", confidence, low=1e-9, high=1.0 - 1e-9)
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if count == 0 else float(gammaincinv(count, tail))
    return low, float(gammaincinv(count + 1, 1.0 - tail))


def rate_ratio_interval(
    count: int, exposure: float, base_count: int, base_exposure: float, confidence: float = 0.95
) -> tuple[float, float | None]:
    """Give the exact interval of the ratio of two Poisson rates, (count / exposure) / (base_count / base_exposure).

    Given the sum of both counts, the first is binomial; its Clopper-Pearson interval is turned into one of the ratio.
    Counts that rise and fall together, as on common random numbers, make it too wide, never too narrow.

    Args:
        count, base_count: Events, at least 0.
        exposure, base_exposure: What they are counted over (tests, miles), above 0, same unit.
        confidence: In (0, 1).

    Returns:
        Low and high; high is None (no bound) where `base_count` is 0. Low is 0 where `count` is 0.

    Raises:
        InputError: A number is out of range.

    Source: Przyborowski and Wilenski (1940).

    >>> low, high = rate_ratio_interval(10, 1e6, 10, 1e6)
    >>> round(low, 3), round(high, 3)
    (0.374, 2.677)
    """
    check_integer("count", count, low=0)
    check_integer("base_count", base_count, low=0)
    check_number("exposure", exposure, low=1e-300, high=1e300)
    check_number("base_exposure", base_exposure, low=1e-300, high=1e300)
    if count + base_count == 0:
        return 0.0, None
    low, high = binomial_interval(count, count + base_count, confidence)
    scale = base_exposure / exposure
    return low / (1.0 - low) * scale, None if base_count == 0 else high / (1.0 - high) * scale


def weighted_interval(weights: ArrayLike, largest: float, confidence: float = 0.95) -> tuple[float, float]:
    """Give an interval of the mean of a sum of weights, one for each of a Poisson number of events.

    With equal weights it is Garwood's. Else it keeps `confidence` in all cases that its authors tried, and is too wide
    where few events carry the sum.

    Args:
        weights: One for each event that was seen, shape (K,), 0 or more.
        largest: Largest weight that an event could have had, above 0, at least the largest weight seen.
        confidence: In (0, 1).

    Returns:
        Low and high; low is 0 without a weight above 0.

    Raises:
        InputError: A number is out of range.

    Source: Fay and Feuer (1997), "Confidence intervals for directly standardized rates: a method based on the gamma
    distribution".

    >>> low, high = weighted_interval([0.5, 0.5, 1.0], 1.0)
    >>> round(low, 3), round(high, 3)
    (0.36, 6.8)
    """
    from scipy.special import gammaincinv

    check_number("confidence", confidence, low=1e-9, high=1.0 - 1e-9)
    check_number("largest", largest, low=1e-300, high=1e300)
    each = np.asarray(weights, np.float64)
    if not ((each >= 0.0) & (each <= largest)).all():
        raise InputError(f"weights: each must be 0 to {largest:g}, the largest that it can be.")
    tail = 0.5 * (1.0 - confidence)
    total, square = float(each.sum()), float((each * each).sum())
    low = 0.0 if total == 0.0 else square / total * float(gammaincinv(total * total / square, tail))
    total, square = total + largest, square + largest * largest
    return low, square / total * float(gammaincinv(total * total / square, 1.0 - tail))


def share_interval(part: ArrayLike, whole: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """Give the interval of the share of some events among all of a Poisson number of events.

    With equal weights it is exact (`binomial_interval`); else it is their rate's interval (`weighted_interval`) over
    the rate of all, which is too wide rather than too narrow.

    Args:
        part: Weights of the events that count, shape (K,), above 0; they are part of `whole`.
        whole: Weights of all, shape (N,), N at least 1.
        confidence: In (0, 1).

    Returns:
        Low and high, within [0, 1].

    >>> low, high = share_interval([1.0], [1.0, 1.0])
    >>> round(low, 3), round(high, 3)
    (0.013, 0.987)
    """
    some, every = np.asarray(part, np.float64), np.asarray(whole, np.float64)
    if np.ptp(every) == 0.0:
        return binomial_interval(some.size, every.size, confidence)
    low, high = weighted_interval(some, float(every.max()), confidence)
    return low / float(every.sum()), min(1.0, high / float(every.sum()))
