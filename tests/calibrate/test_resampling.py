"""Distances and their intervals: by hand, and as often right as they say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from statistical_bounds import rate_fits

from cornerforge.ext.calibrate.resampling import bootstrap_mean, distance, owner_sums, resampled_weights

pytestmark = pytest.mark.full


def test_a_distance_by_hand() -> None:
    """All mass of bin 0 against half of it two bins on: Wasserstein 0.5 x 2 bins, Kolmogorov-Smirnov 0.5."""
    found = distance(np.array([[4.0, 0.0, 0.0]]), np.array([[2.0, 0.0, 2.0]]), 0.2, "m")
    assert (found.decisions, found.vehicles, found.unit) == (4, 1, "m")
    assert found.wasserstein == pytest.approx(0.5 * 2 * 0.2)
    assert found.kolmogorov_smirnov == pytest.approx(0.5)
    assert found.wasserstein_interval95 == pytest.approx((0.2, 0.2))  # one vehicle: nothing to resample


@given(st.integers(0, 1000), st.integers(1, 30))
def test_equal_counts_have_no_distance_and_a_shift_is_its_length(seed: int, vehicles: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.integers(0, 9, (vehicles, 12)).astype(np.float64)
    rows[0, 0] += 1.0
    rows[:, 9:] = 0.0
    none = distance(rows, rows, 0.5, "s")
    assert none.wasserstein == none.kolmogorov_smirnov == none.wasserstein_interval95[1] == 0.0
    moved = distance(np.roll(rows, 3, axis=1), rows, 0.5, "s")
    assert moved.wasserstein == pytest.approx(1.5)
    assert moved.wasserstein_interval95 == pytest.approx((1.5, 1.5))
    assert 0.0 < moved.kolmogorov_smirnov <= 1.0


def test_weights_are_resamples_of_whole_vehicles() -> None:
    weights = resampled_weights(7)
    assert (weights.sum(axis=1) == 7).all()
    assert weights.mean() == 1.0
    np.testing.assert_array_equal(weights, resampled_weights(7))


def test_rows_are_summed_by_owner() -> None:
    rows = np.array([[1.0, 2.0], [10.0, 20.0], [100.0, 200.0]])
    np.testing.assert_array_equal(owner_sums(rows, np.array([2, 0, 2]), 3), [[10, 20], [0, 0], [101, 202]])


def many_intervals(vehicle: np.ndarray, draws: int, seed: int) -> int:
    """How many of `draws` intervals hold the true mean 0; each driver's decisions share half of their variance."""
    rng = np.random.default_rng(seed)
    held = 0
    for _ in range(draws):
        values = rng.standard_normal(40)[np.arange(400) // 10] + rng.standard_normal(400)
        low, high = bootstrap_mean(values, vehicle)
        held += low <= 0.0 <= high
    return held


def test_intervals_hold_the_truth_about_as_often_as_they_say(seed: int) -> None:
    """H0: coverage of 0.94 (the percentile bootstrap with 40 vehicles); unit: a data set; n = 200.

    Negative control: decisions taken as independent, whose intervals are too narrow by about 2.3.
    """
    assert rate_fits(many_intervals(np.arange(400) // 10, 200, seed), 200, 0.94, comparisons=2)
    assert not rate_fits(many_intervals(np.arange(400), 200, seed), 200, 0.94, comparisons=2)


def test_an_interval_is_the_same_each_time_whatever_the_vehicles_are_called() -> None:
    values = np.random.default_rng(5).standard_normal(60)
    vehicle = np.arange(60) // 6
    assert bootstrap_mean(values, vehicle) == bootstrap_mean(values, 7 * vehicle + 3)
    assert bootstrap_mean(values, np.zeros(60, dtype=np.int64)) == pytest.approx((values.mean(), values.mean()))


def covered(shift: float, by_vehicle: bool, draws: int, seed: int) -> int:
    """How many intervals hold the true Wasserstein distance `shift`: normal values, each driver with a mean of its own.

    Expected is the law of all drivers together (sd sqrt(2)), recorded are 60 drivers of 10 values, moved by `shift`.
    """
    from scipy.stats import norm

    edges = np.arange(-8.0, 12.01, 0.1)
    share = np.diff(norm.cdf(edges, scale=np.sqrt(2.0)))
    rng = np.random.default_rng(seed)
    held = 0
    for _ in range(draws):
        values = shift + rng.standard_normal((60, 1)) + rng.standard_normal((60, 10))
        rows = values if by_vehicle else values.reshape(-1, 1)
        observed = np.array([np.histogram(row, edges)[0] for row in rows], dtype=np.float64)
        found = distance(observed, observed.sum(axis=1, keepdims=True) * share, 0.1, "m")
        held += found.wasserstein_interval95[0] <= shift <= found.wasserstein_interval95[1]
    return held


def test_intervals_of_distances_hold_the_truth_about_as_often_as_they_say(seed: int) -> None:
    """H0: coverage of 0.93 of a clear distance (0.8); unit: a data set; n = 150; negative control as above."""
    assert rate_fits(covered(0.8, True, 150, seed), 150, 0.93, comparisons=2)
    assert not rate_fits(covered(0.8, False, 150, seed), 150, 0.93, comparisons=2)


def test_the_interval_of_no_distance_holds_or_nearly_holds_zero(seed: int) -> None:
    """Where nothing differs, the lower end is 0 in at least nine data sets of ten (n = 150; bound: exact binomial)."""
    from scipy.stats import binomtest

    held = covered(0.0, True, 150, seed)
    assert binomtest(held, 150, 0.9, alternative="less").pvalue >= 1e-6
