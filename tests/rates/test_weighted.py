"""Means of weights: intervals that cover, and doubts that are spoken."""

from __future__ import annotations

import math

import numpy as np
import pytest
from statistical_bounds import rate_fits

from cornerforge.errors import InputError
from cornerforge.rates.weighted import always_valid_half_width, weighted_rate


def drawn(rng: np.random.Generator, n: int) -> np.ndarray:
    """Weights like those of trees: mostly 0, else log-normal; mean 0.02 exp(0.5)."""
    return np.where(rng.random(n) < 0.02, np.exp(rng.standard_normal(n)), 0.0)


MEAN = 0.02 * math.exp(0.5)


def test_by_hand() -> None:
    found = weighted_rate(np.array([0.0, 2.0, 0.0, 6.0]))
    assert found.rate == 2.0
    assert found.error == pytest.approx(math.sqrt(8.0) / 2.0)
    assert found.effective == pytest.approx(64.0 / 40.0)
    assert found.largest == 0.75
    assert found.halves == (1.0, 3.0)
    assert found.low == 0.0
    assert found.half_width == pytest.approx(1.96 * found.error / 2.0, rel=1e-4)


def test_no_crash_is_no_rate_of_zero() -> None:
    found = weighted_rate(np.zeros(100))
    assert (found.rate, found.half_width, found.effective) == (0.0, math.inf, 0.0)
    assert found.doubts
    assert always_valid_half_width(found) == math.inf


@pytest.mark.parametrize("weights", [[], [1.0], [1.0, -1.0], [1.0, math.nan], [1.0, math.inf]])
def test_weights_that_are_none(weights: list[float]) -> None:
    with pytest.raises(InputError, match="at least 2"):
        weighted_rate(np.array(weights))


def test_intervals_cover(seed: int) -> None:
    rng, runs = np.random.default_rng(seed), 1000
    found = [weighted_rate(drawn(rng, 150_000)) for _ in range(runs)]
    assert sum(bool(one.doubts) for one in found) < 0.05 * runs
    inside = sum(one.low <= MEAN <= one.high for one in found)
    assert rate_fits(inside, runs, 0.95)
    wrong = sum(one.low <= 1.1 * MEAN <= one.high for one in found)
    assert not rate_fits(wrong, runs, 0.95), "a mean 10 % off would not be seen"


def test_who_looks_all_the_time_is_wrong_seldom_with_the_always_valid_interval(seed: int) -> None:
    rng, runs, n = np.random.default_rng([seed, 1]), 400, 200_000
    looks = np.unique(np.geomspace(20_000, n, 60).astype(int))
    ever_out, ever_out_of_plain = 0, 0
    for _ in range(runs):
        weights = drawn(rng, n)
        rates = [weighted_rate(weights[:look]) for look in looks]
        ever_out += any(abs(one.rate - MEAN) > always_valid_half_width(one) for one in rates)
        ever_out_of_plain += any(not one.low <= MEAN <= one.high for one in rates)
    assert ever_out <= 0.05 * runs + 3.0 * math.sqrt(0.05 * 0.95 * runs)
    assert ever_out_of_plain > 0.10 * runs, "this test could not tell the two apart"


def test_doubts() -> None:
    calm = np.tile([0.0, 1.0], 400)
    assert not weighted_rate(calm).doubts
    assert "effective trees" in weighted_rate(np.tile([0.0, 1.0], 100)).doubts[0]
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
