"""Exact binomial intervals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from cornerforge.errors import InputError
from cornerforge.rates import binomial_interval


@given(st.integers(1, 10**7), st.floats(0.0, 1.0), st.floats(0.5, 1.0 - 1e-6))
def test_interval_is_scipys_exact_one(tests: int, share: float, confidence: float) -> None:
    crashes = round(share * tests)
    expected = stats.binomtest(crashes, tests).proportion_ci(confidence, method="exact")
    assert binomial_interval(crashes, tests, confidence) == pytest.approx(tuple(expected), rel=1e-6, abs=1e-12)


def coverage(interval: Callable[[int, int], tuple[float, float]], n: int, p: float) -> float:
    """Chance that the interval of a binomial count holds p: exact, by summing over all counts."""
    held = [low <= p <= high for low, high in (interval(k, n) for k in range(n + 1))]
    return float(stats.binom.pmf(np.arange(n + 1), n, p)[held].sum())


def wald_interval(crashes: int, tests: int) -> tuple[float, float]:
    """The textbook's normal approximation."""
    rate = crashes / tests
    half = 1.96 * np.sqrt(rate * (1.0 - rate) / tests)
    return rate - half, rate + half


PLACES = [(n, p) for n in (1, 10, 60) for p in (1e-6, 1e-3, 0.02, 0.3, 0.5, 0.97)]


def test_interval_covers_the_truth_at_least_as_often_as_it_says() -> None:
    assert min(coverage(binomial_interval, n, p) for n, p in PLACES) >= 0.95
    assert min(coverage(wald_interval, n, p) for n, p in PLACES) < 0.5  # negative control: rare events


def test_no_crash_still_has_an_upper_bound_and_all_crashes_a_lower_one() -> None:
    low, high = binomial_interval(0, 1000)
    assert low == 0.0
    assert high == pytest.approx(1.0 - 0.025 ** (1.0 / 1000))
    assert binomial_interval(1000, 1000) == (pytest.approx(1.0 - high), 1.0)


@pytest.mark.parametrize(
    ("crashes", "tests", "confidence"),
    [(1, 0, 0.95), (-1, 5, 0.95), (6, 5, 0.95), (1, 5, 1.0), (1, 5, 0.0), (1, 5, float("nan"))],
)
def test_numbers_out_of_range_are_refused(crashes: int, tests: int, confidence: float) -> None:
    with pytest.raises(InputError, match="out of range"):
        binomial_interval(crashes, tests, confidence)
