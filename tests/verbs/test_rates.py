"""Exact intervals: binomial, Poisson, and of ratios of rates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from cornerforge.errors import InputError
from cornerforge.rates import binomial_interval, poisson_interval, rate_ratio_interval, weighted_interval


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


# --- Poisson means and ratios of rates ---


@given(st.integers(0, 10**6), st.floats(0.5, 1.0 - 1e-6))
def test_poisson_interval_is_that_of_the_chi_square_quantiles(count: int, confidence: float) -> None:
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if count == 0 else 0.5 * stats.chi2.ppf(tail, 2 * count)
    expected = (low, 0.5 * stats.chi2.ppf(1.0 - tail, 2 * count + 2))
    assert poisson_interval(count, confidence) == pytest.approx(expected, rel=1e-6)


def poisson_coverage(interval: Callable[[int], tuple[float, float]], mean: float) -> float:
    """Chance that the interval of a Poisson count holds its mean, by summing over all counts that matter."""
    counts = range(int(mean + 12.0 * mean**0.5 + 30))
    return float(sum(stats.poisson.pmf(k, mean) for k in counts if interval(k)[0] <= mean <= interval(k)[1]))


def test_poisson_interval_covers_the_mean_at_least_as_often_as_it_says() -> None:
    means = (1e-3, 0.5, 3.0, 20.5)
    assert min(poisson_coverage(poisson_interval, mean) for mean in means) >= 0.95
    narrow = min(poisson_coverage(lambda k: (k - 1.96 * k**0.5, k + 1.96 * k**0.5), mean) for mean in means)
    assert narrow < 0.5  # negative control


def ratio_coverage(mean: float, base_mean: float, confidence: float) -> float:
    """Chance that the interval of the ratio of two Poisson counts (of equal exposure) holds mean / base_mean."""
    held = 0.0
    for a in range(40):
        for b in range(40):
            low, high = rate_ratio_interval(a, 1.0, b, 1.0, confidence)
            if low <= mean / base_mean and (high is None or mean / base_mean <= high):
                held += float(stats.poisson.pmf(a, mean) * stats.poisson.pmf(b, base_mean))
    return held


@pytest.mark.parametrize(("mean", "base_mean"), [(0.3, 5.0), (4.0, 4.0), (9.0, 2.0)])
def test_ratio_interval_covers_the_ratio(mean: float, base_mean: float) -> None:
    assert ratio_coverage(mean, base_mean, 0.95) >= 0.95 - 1e-9
    assert ratio_coverage(mean, base_mean, 0.3) < 0.8  # negative control: a narrow one does not


def test_ratio_interval_turns_round_and_scales() -> None:
    low, high = rate_ratio_interval(12, 3e6, 5, 1e6)
    turned_low, turned_high = rate_ratio_interval(5, 1e6, 12, 3e6)
    assert high is not None
    assert turned_high is not None
    assert (turned_low, turned_high) == (pytest.approx(1.0 / high), pytest.approx(1.0 / low))
    assert low < 0.8 < high
    assert rate_ratio_interval(0, 1.0, 0, 1.0) == (0.0, None)
    assert rate_ratio_interval(3, 1.0, 0, 1.0)[1] is None
    assert rate_ratio_interval(0, 1.0, 3, 1.0)[0] == 0.0


def test_negative_counts_and_exposures_are_refused() -> None:
    with pytest.raises(InputError, match="count"):
        poisson_interval(-1)
    with pytest.raises(InputError, match="exposure"):
        rate_ratio_interval(1, 0.0, 1, 1.0)


# --- Sums of weights ---

BIRTHS_5 = (327, 30_666, 123_419, 149_919, 104_088, 34_392)
CASES_5 = (0, 8, 63, 112, 262, 295)
BIRTHS = (319_933, 931_318, 786_511, 488_235, 237_863, 61_313)
"""Births and cases of Down's syndrome of fifth and later children by the mother's age, and all births; Michigan, 1950
to 1964 (Stark and Mantel 1966, table 14.4 of Fleiss 1981)."""


def test_weighted_interval_is_the_one_that_others_compute() -> None:
    # Package dsrTest of R, in its introduction, prints 75.52901 (67.70212, 188.30017).
    weights = [1e5 * births / sum(BIRTHS) / of_fifth for births, of_fifth in zip(BIRTHS, BIRTHS_5, strict=True)]
    each = np.repeat(weights, CASES_5)
    assert each.sum() == pytest.approx(75.52901, abs=5e-6)
    assert weighted_interval(each, max(weights)) == pytest.approx((67.70212, 188.30017), abs=5e-6)


@given(st.integers(0, 1000), st.floats(1e-9, 10.0), st.floats(0.5, 1.0 - 1e-6))
def test_with_equal_weights_it_is_that_of_the_count(count: int, weight: float, confidence: float) -> None:
    expected = [weight * end for end in poisson_interval(count, confidence)]
    assert weighted_interval(np.full(count, weight), weight, confidence) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("mean", [0.5, 6.0, 60.0])
def test_weighted_interval_covers_the_mean_at_least_as_often_as_it_says(mean: float) -> None:
    rng = np.random.default_rng(5)
    tries, held, wald = 2_000, 0, 0
    for _ in range(tries):
        each = rng.choice([0.1, 0.5, 2.0], rng.poisson(mean), p=[0.6, 0.3, 0.1])
        low, high = weighted_interval(each, 2.0)
        held += low <= mean * 0.41 <= high
        half = 1.96 * (each * each).sum() ** 0.5
        wald += each.sum() - half <= mean * 0.41 <= each.sum() + half
    assert held >= 0.95 * tries - 5.0 * (0.95 * 0.05 * tries) ** 0.5
    if mean < 10.0:
        assert wald < 0.9 * tries  # negative control


@pytest.mark.parametrize("wrong", [([-0.1], 1.0), ([2.0], 1.0), ([float("nan")], 1.0), ([], 0.0)])
def test_weights_out_of_range_are_refused(wrong: tuple[list[float], float]) -> None:
    with pytest.raises(InputError, match=r"weights|largest"):
        weighted_interval(*wrong)
