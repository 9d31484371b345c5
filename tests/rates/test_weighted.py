"""Means of weights: intervals that cover, and doubts that are spoken."""

from __future__ import annotations

import math

import numpy as np
import pytest
from statistical_bounds import rate_fits

from cornerforge.errors import InputError
from cornerforge.rates.weighted import always_valid_interval, weighted_rate


def drawn(rng: np.random.Generator, n: int) -> np.ndarray:
    """Weights like those of trees: mostly 0, else log-normal; mean 0.05 exp(0.5)."""
    return np.where(rng.random(n) < 0.05, np.exp(rng.standard_normal(n)), 0.0)


MEAN = 0.05 * math.exp(0.5)


def test_by_hand() -> None:
    found = weighted_rate(np.array([0.0, 2.0, 0.0, 6.0]))
    assert found.rate == 2.0
    assert found.error == pytest.approx(math.sqrt(8.0) / 2.0)
    assert found.effective == pytest.approx(64.0 / 40.0)
    assert found.largest == 0.75
    assert found.halves == (1.0, 3.0)
    assert found.low == 0.0
    # The skewness: (-8 + 0 - 8 + 64) / 4 = 12 over 8^1.5, over 2. Hall's interval solves a cubic.
    g = 12.0 / 8.0**1.5 / 2.0
    assert found.skewness == pytest.approx(g)
    t = (2.0 - found.high) / found.error
    assert t + g * t**2 / 3.0 + g**2 * t**3 / 27.0 + g / 6.0 == pytest.approx(-1.959964)
    assert found.half_width == pytest.approx(found.high / 2.0 / 2.0)


def test_weights_without_skewness_have_the_normal_interval() -> None:
    found = weighted_rate(np.tile([1.0, 3.0], 500))
    assert (found.low, found.high) == pytest.approx((2.0 - 1.959964 * found.error, 2.0 + 1.959964 * found.error))


def test_no_crash_is_no_rate_of_zero() -> None:
    found = weighted_rate(np.zeros(100))
    assert (found.rate, found.half_width, found.effective) == (0.0, math.inf, 0.0)
    assert found.doubts
    assert always_valid_interval(found) == (0.0, math.inf)


@pytest.mark.parametrize("weights", [[], [1.0], [1.0, -1.0], [1.0, math.nan], [1.0, math.inf]])
def test_weights_that_are_none(weights: list[float]) -> None:
    with pytest.raises(InputError, match="at least 2"):
        weighted_rate(np.array(weights))


@pytest.mark.full
def test_intervals_cover(seed: int) -> None:
    rng, runs = np.random.default_rng(seed), 1000
    found = [weighted_rate(drawn(rng, 60_000)) for _ in range(runs)]
    assert sum(bool(one.doubts) for one in found) < 0.05 * runs
    inside = sum(one.low <= MEAN <= one.high for one in found)
    assert rate_fits(inside, runs, 0.95)
    wrong = sum(one.low <= 1.1 * MEAN <= one.high for one in found)
    assert not rate_fits(wrong, runs, 0.95), "a mean 10 % off would not be seen"


@pytest.mark.full
def test_who_looks_all_the_time_is_wrong_seldom_with_the_always_valid_interval(seed: int) -> None:
    rng, runs, n = np.random.default_rng([seed, 1]), 300, 60_000
    looks = np.unique(np.geomspace(6_000, n, 30).astype(int))
    ever_out, ever_out_of_plain = 0, 0
    for _ in range(runs):
        weights = drawn(rng, n)
        rates = [weighted_rate(weights[:look]) for look in looks]
        held = [low <= MEAN <= high for low, high in map(always_valid_interval, rates)]
        ever_out += not all(held)
        ever_out_of_plain += any(not one.low <= MEAN <= one.high for one in rates)
    assert ever_out <= 0.05 * runs + 3.0 * math.sqrt(0.05 * 0.95 * runs)
    assert ever_out_of_plain > 0.10 * runs, "this test could not tell the two apart"


def test_doubts() -> None:
    calm = np.tile([0.0, 1.0], 400)
    assert not weighted_rate(calm).doubts
    assert "effective trees" in weighted_rate(np.tile([0.0, 1.0], 100)).doubts[0]
    assert "effective tests" in weighted_rate(np.tile([0.0, 1.0], 100), "tests").doubts[0]
    heavy = calm.copy()
    heavy[0] = 60.0
    assert any("one tree has" in doubt for doubt in weighted_rate(heavy).doubts)
    lopsided = np.concatenate([np.tile([0.0, 0.0, 0.0, 1.0], 400), np.tile([0.0, 1.0, 1.0, 1.0], 400)])
    assert any("halves" in doubt for doubt in weighted_rate(lopsided).doubts)


def test_the_tail_index_of_a_known_tail(seed: int) -> None:
    rng = np.random.default_rng([seed, 2])
    weights = (1.0 - rng.random(100_000)) ** (-1.0 / 3.0)
    tail = weighted_rate(weights).tail
    assert tail is not None
    assert abs(tail - 3.0) < 5.0 * 3.0 / math.sqrt(5000.0)
    assert weighted_rate(np.array([0.0, 1.0])).tail is None


def heavy(rng: np.random.Generator, n: int) -> np.ndarray:
    """Weights as heavy as trees have had: Pareto of index 1.3 cut at 1,000 times the least; the rest 0."""
    return np.where(rng.random(n) < 0.5, (1.0 - rng.random(n) * (1.0 - 1000.0**-1.3)) ** (-1.0 / 1.3), 0.0)


def test_intervals_of_heavy_weights_hold_when_one_stops_without_doubts(seed: int) -> None:
    rng, runs, n, block = np.random.default_rng([seed, 3]), 200, 80_000, 4_000
    mean = 0.5 * 1.3 / 0.3 * (1.0 - 1000.0**-0.3) / (1.0 - 1000.0**-1.3)
    stopped = held = 0
    for _ in range(runs):
        weights = heavy(rng, n)
        for end in range(block, n + 1, block):
            found = weighted_rate(weights[:end])
            low, high = always_valid_interval(found)
            if not found.doubts and high - low <= 0.3 * found.rate:
                stopped, held = stopped + 1, held + (low <= mean <= high)
                break
    assert stopped > 0.9 * runs
    assert held >= 0.95 * stopped - 3.0 * math.sqrt(0.95 * 0.05 * stopped)


def test_skewed_means_are_covered_and_would_not_be_by_normal_intervals(seed: int) -> None:
    rng, runs, n = np.random.default_rng([seed, 4]), 5_000, 300
    inside = normal = 0
    for _ in range(runs):
        found = weighted_rate(np.where(rng.random(n) < 0.1, rng.exponential(size=n), 0.0))
        inside += found.low <= 0.1 <= found.high
        normal += abs(found.rate - 0.1) <= 1.96 * found.error
    assert rate_fits(inside, runs, 0.95)
    assert not rate_fits(normal, runs, 0.95)
