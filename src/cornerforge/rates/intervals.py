"""Exact intervals of crash rates."""

from __future__ import annotations

from cornerforge._checks import check_integer, check_number

__all__ = ["binomial_interval"]


def binomial_interval(crashes: int, tests: int, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper-Pearson interval of a probability: it holds the truth in at least `confidence` of all repetitions.

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
    from scipy.special import betaincinv

    check_integer("tests", tests, low=1)
    check_integer("crashes", crashes, low=0, high=tests)
    check_number("confidence", confidence, low=1e-9, high=1.0 - 1e-9)
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if crashes == 0 else float(betaincinv(crashes, tests - crashes + 1, tail))
    high = 1.0 if crashes == tests else float(betaincinv(crashes + 1, tests - crashes, 1.0 - tail))
    return low, high
