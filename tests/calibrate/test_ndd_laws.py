"""Laws and prior: closing faster never raises the mean, rows are probabilities, the fit finds what was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from cornerforge.ext.calibrate.lane_change import LaneChange
from cornerforge.ext.calibrate.laws import IdmLaw, LogLaw, bin_index, bin_probabilities, fit_law, log_likelihood
from cornerforge.ext.calibrate.prior import SUPPORT_SD, FreeFlow, SafeLaw, following_prior, free_prior, support
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS
from cornerforge.types import ACCELERATIONS

SAFE = SafeLaw(LogLaw())
TABLE = following_prior(SAFE)


@given(speed=st.floats(0.0, 40.0), gap=st.floats(0.0, 120.0), closing=st.floats(-8.0, 20.0), more=st.floats(0.0, 5.0))
def test_closing_faster_never_raises_the_centre(speed: float, gap: float, closing: float, more: float) -> None:
    state = np.array([speed]), np.array([gap])
    milder = SAFE.mean(*state, np.array([-closing]))
    harder = SAFE.mean(*state, np.array([-closing - more]))
    assert harder[0] <= milder[0] + 1e-12


@given(speed=st.floats(0.0, 16.0), gap=st.floats(0.0, 120.0), range_rate=st.floats(-15.0, 15.0))
def test_in_congestion_the_fitted_law_stands_as_it_is(speed: float, gap: float, range_rate: float) -> None:
    state = np.array([speed]), np.array([gap]), np.array([range_rate])
    assert SAFE.mean(*state)[0] == SAFE.law.mean(*state)[0]


@given(speed=st.floats(24.0, 40.0), gap=st.floats(4.5, 120.0), closing=st.floats(0.01, 20.0))
def test_closing_drivers_brake_enough_to_keep_four_metres(speed: float, gap: float, closing: float) -> None:
    centre = SAFE.mean(np.array([speed]), np.array([gap]), np.array([-closing]))
    assert centre[0] <= -(closing**2) / (2.0 * (gap - 4.0)) + 1e-9


def test_closing_faster_never_raises_the_mean_of_a_table_row() -> None:
    # near a leader noise is wide and cut off at -4 and 2 m/s2, and a bin at the edge of the support comes or goes: this
    # moves a mean by less than 0.001 m/s2
    mean = TABLE @ ACCELERATIONS
    assert (np.diff(mean, axis=2) >= -1e-3).all()
    assert (np.diff(mean[:, 15:], axis=2) >= -1e-9).all()


def test_a_shorter_gap_never_raises_the_mean_where_the_pair_closes() -> None:
    mean = TABLE @ ACCELERATIONS
    gaps, closing = GAPS >= 4.0, RANGE_RATES <= 0.0  # nearer, wide noise is cut off at -4 m/s2 and lifts the mean
    safe = SAFE.speed_full <= SPEEDS
    # a bin at the edge of the support (5 sd) that comes or goes moves a mean by less than 0.001 m/s2
    assert (np.diff(mean[safe][:, gaps][:, :, closing], axis=1) >= -1e-3).all()


@pytest.mark.parametrize("rows", [TABLE, free_prior(FreeFlow())])
def test_rows_are_probabilities_and_never_empty(rows: np.ndarray) -> None:
    np.testing.assert_allclose(rows.sum(axis=-1), 1.0, atol=1e-12)
    assert (rows >= 0.0).all()


def test_impossible_is_exactly_zero_and_only_beyond_five_standard_deviations() -> None:
    speed, gap, range_rate = 10, 40, 10  # 30 m/s, 40 m, 0 m/s
    state = SPEEDS[[speed]], GAPS[[gap]], RANGE_RATES[[range_rate]]
    centre, scale = float(SAFE.mean(*state)[0]), float(SAFE.scale(*state)[0])
    sd = scale * np.sqrt(SAFE.degrees / (SAFE.degrees - 2.0))
    far = np.abs(ACCELERATIONS - centre) > SUPPORT_SD * sd
    row = TABLE[speed, gap, range_rate]
    assert far.any()
    assert (row[far] == 0.0).all()
    assert (row[~far] > 0.0).all()


def test_support_is_never_empty_however_hard_one_must_brake() -> None:
    possible = support(np.array([-80.0, 30.0]), np.array([1e-3, 1e-3]), 8.0)
    np.testing.assert_array_equal(np.flatnonzero(possible[0]), [0])
    np.testing.assert_array_equal(np.flatnonzero(possible[1]), [30])


@given(centre=st.floats(-5.0, 3.0), degrees=st.floats(1e-3, 100.0))
def test_support_is_never_empty_however_small_the_spread(centre: float, degrees: float) -> None:
    possible = support(np.array([centre]), np.array([1e-6]), degrees)[0]
    assert possible[np.abs(ACCELERATIONS - centre).argmin()]
    assert degrees <= 2.0 or possible.sum() <= 2


def test_free_flow_spread_is_the_published_one() -> None:
    for speed, sd, share in ((20.0, 0.61, 0.06), (30.0, 0.38, 0.008), (36.0, 0.32, 0.004)):
        p = free_prior(FreeFlow())[int(speed) - 20]
        mean = p @ ACCELERATIONS
        assert np.sqrt(p @ (ACCELERATIONS - mean) ** 2) == pytest.approx(sd, rel=0.03)
        assert p[ACCELERATIONS <= -0.99].sum() == pytest.approx(share, rel=0.35)
        assert 0.0 <= mean <= 0.1
    assert free_prior(FreeFlow())[0] @ ACCELERATIONS > free_prior(FreeFlow())[20] @ ACCELERATIONS


def test_bins_cover_every_acceleration_once() -> None:
    mean, scale = np.array([0.3]), np.array([0.5])
    rng = np.random.default_rng(1)
    n = 200_000
    drawn = bin_index(0.3 + 0.5 * rng.standard_t(6.0, size=n))
    frequency = np.bincount(drawn, minlength=31) / n
    # H0: bin_probabilities is the law of binned draws; n independent draws, alpha = 1e-6, L1 bound for 31 bins.
    bound = np.sqrt(2.0 * (31 * np.log(2.0) + np.log(1e6)) / n)
    assert np.abs(frequency - bin_probabilities(mean, scale, 6.0)[0]).sum() < bound
    wrong = bin_probabilities(mean + 0.05, scale, 6.0)[0]  # negative control: a shift by a quarter of a bin is seen
    assert np.abs(frequency - wrong).sum() > bound


def states(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return rng.uniform(10.0, 30.0, n), rng.uniform(5.0, 80.0, n), rng.normal(0.0, 2.0, n)


@pytest.mark.slow
def test_the_fit_finds_the_law_that_made_the_data() -> None:
    rng = np.random.default_rng(2)
    true = LogLaw(
        response=5.0, reach=10.0, pull=0.3, headway=1.4, offset=0.1, spread=0.3, spread_closing=0.8, degrees=6.0
    )
    state = states(40_000, rng)
    acceleration = true.mean(*state) + true.scale(*state) * rng.standard_t(6.0, size=40_000)
    found = fit_law(LogLaw(), *state, acceleration)
    fresh = states(1_000, rng)
    np.testing.assert_allclose(found.mean(*fresh), true.mean(*fresh), atol=0.08)
    np.testing.assert_allclose(found.scale(*fresh), true.scale(*fresh), rtol=0.08)
    best = log_likelihood(found, *state, acceleration)
    assert best >= log_likelihood(true, *state, acceleration) - 1e-3
    assert best > log_likelihood(fit_law(IdmLaw(), *state, acceleration), *state, acceleration)


def test_fitted_numbers_are_short() -> None:
    rng = np.random.default_rng(3)
    state = states(500, rng)
    found = fit_law(LogLaw(), *state, 0.4 * rng.standard_normal(500))
    assert fit_law(LogLaw(), *state, 0.4 * np.random.default_rng(4).standard_normal(500)) != found
    for value in vars(found).values():
        assert float(f"{value:.4g}") == value


def test_acceptance_grows_with_the_gap_and_only_an_overlap_is_never_accepted() -> None:
    change = LaneChange()
    for accept in (change.accept_lead(), change.accept_rear()):
        assert (accept > 0.0).all()  # a gap of 0 or less is refused by `accept_chance`
        assert accept.max() <= 1.0
        assert (np.diff(accept, axis=0) >= 0.0).all()
        assert (np.diff(accept, axis=1) >= 0.0).all()  # the slower it closes, the sooner it is accepted
    np.testing.assert_allclose(change.accept_lead()[11, RANGE_RATES >= 0.0], 0.5)
    careful = replace(change, misjudge=0.0).accept_rear()
    np.testing.assert_allclose(careful[12, RANGE_RATES >= 0.0], 0.5)
    # half of those who look closely see 100 m close by 0.5 m/s: c / gap^2 is what counts
    assert careful[100, RANGE_RATES == -1.0] == pytest.approx(ndtr(np.log(0.5) / 1.5), abs=2e-3)
    # the others mind c only by a second of it, and by how hard the one behind must brake
    alone = replace(change, misjudge=1.0).accept_rear()
    assert alone[38, RANGE_RATES == -8.0] == pytest.approx(ndtr(np.log(38 / (28.0 + 8.0 + 8.0)) / 0.15), abs=1e-6)


def test_a_driver_turns_back_for_a_critical_gap() -> None:
    critical = np.array([6.0 + 3.5 * closing + closing**2 / 12.0 for closing in np.maximum(-RANGE_RATES, 0.0)])
    np.testing.assert_array_equal(LaneChange().turn_back(), GAPS[:, None] <= critical[None, :])


def test_the_wish_to_change_grows_behind_a_slower_and_nearer_leader() -> None:
    desire = LaneChange().desire()
    closing = RANGE_RATES <= 0.0
    far = GAPS >= 60.0  # nearer, the room to the own leader counts too
    assert (np.diff(desire[far][:, closing], axis=1) < 0.0).all()
    assert (np.diff(desire[far][:, ~closing], axis=0) < 0.0).all()
    assert (LaneChange().base().max() * desire.max()) < 0.2


def test_nobody_begins_a_lane_change_too_near_its_own_leader() -> None:
    """At the usual gap every second one who wants to, at half of it one in forty."""
    change = LaneChange()
    desire, closing = change.desire(), np.maximum(-RANGE_RATES, 0.0)
    usual = 9.0 + closing + closing**2 / 6.0
    wish = 0.5 + (0.5 + closing) * np.exp(-GAPS[:, None] / 60.0)
    assert (desire / wish)[GAPS[:, None] <= 0.5 * usual[None, :]].max() < 0.025
    assert (desire > 0.0).all()
    np.testing.assert_allclose((desire / wish)[9, RANGE_RATES >= 0.0], 0.5)


def test_no_bin_has_a_negative_probability() -> None:
    """Also far out, where SciPy below 1.15 has a distribution function that goes down by its last bit."""
    mean = np.linspace(-60.0, 60.0, 20_001)
    for degrees in (3.0, 10.0, 100.0):
        for scale in (0.3, 4.137):
            rows = bin_probabilities(mean, np.full_like(mean, scale), degrees)
            assert rows.min() >= 0.0
            assert rows.sum(axis=1) == pytest.approx(1.0, abs=1e-12)
