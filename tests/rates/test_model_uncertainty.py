"""The spread between drawn models: known answers, coverage over replications, and checks that can fail."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats
from statistical_bounds import rate_fits

from cornerforge.errors import InputError
from cornerforge.rates import model_uncertainty
from cornerforge.rates.model_uncertainty import (
    ModelSpread,
    effective_counts,
    interval_with_model,
    model_spread,
    traffic_weights,
)
from cornerforge.rates.people import MOTORWAY
from cornerforge.rates.weighted import weighted_rate

pytestmark = pytest.mark.full

RATE = 3e-7
Z95 = 1.959963984540054


def counted(rng: np.random.Generator, log_sd: float, draws: int, crashes: float) -> ModelSpread:
    """The spread found in counts of models with a known spread."""
    rates = RATE * np.exp(log_sd * rng.standard_normal(draws))
    exposure = crashes / RATE
    return model_spread(rng.poisson(rates * exposure).astype(float), np.full(draws, exposure))


@pytest.mark.parametrize("log_sd", [0.2, 0.6, 1.2])
def test_a_known_spread_is_found(seed: int, log_sd: float) -> None:
    """400 models of 400 crashes each. The standard error of a standard deviation of n normals is sd / sqrt(2 n), of
    which chance (1 / 20 a model) adds (1 + (0.05 / sd)^2) to the variance; five of them. Half the spread is farther.
    """
    found = counted(np.random.default_rng(seed), log_sd, 400, 400.0)
    error = log_sd * (1.0 + (0.05 / log_sd) ** 2) / math.sqrt(800.0)
    assert abs(found.log_sd - log_sd) < 5.0 * error
    assert abs(found.log_sd - 1.5 * log_sd) > 5.0 * error, "or the check could not fail"
    assert found.log_sd95[0] < found.log_sd < found.log_sd95[1]
    assert found.log_sd95[1] - found.log_sd95[0] == pytest.approx(2.0 * Z95 * error, rel=0.25)
    assert found.median == pytest.approx(RATE, rel=5.0 * log_sd / 20.0)
    assert found.cv == pytest.approx(math.sqrt(math.exp(found.log_sd**2) - 1.0))


def test_weights_of_trees_lead_to_the_same_spread(seed: int) -> None:
    """Trees of which 1 % have a crash, with log-normal weights: 20,000 a model, 60 models, spread 0.5."""
    rng = np.random.default_rng(seed)
    rates, errors = np.empty(60), np.empty(60)
    for k in range(60):
        weights = np.where(rng.random(20_000) < 0.01, rng.lognormal(size=20_000), 0.0)
        found = weighted_rate(weights * math.exp(0.5 * rng.standard_normal()))
        rates[k], errors[k] = found.rate, found.error
    spread = model_spread(*effective_counts(rates, errors))
    assert abs(spread.log_sd - 0.5) < 5.0 * 0.5 * 1.1 / math.sqrt(120.0)
    assert spread.log_sd95[0] > 0.1


def test_alike_models_leave_the_interval_of_sampling(seed: int) -> None:
    """Where each of 100 models has 10,000 crashes, hardly any spread is possible: less than chance's own 1 %."""
    found = counted(np.random.default_rng(seed), 0.0, 100, 10_000.0)
    assert found.log_sd95[0] == 0.0
    assert found.log_sd_used < 0.01
    low, high = interval_with_model(1.0, (0.8, 1.3), found)
    assert 0.79 < low <= 0.8
    assert 1.3 <= high < 1.32


def test_an_unseen_spread_is_bounded_not_denied() -> None:
    """Equal counts of few crashes: nothing is seen, but a spread of half of chance's own is not excluded."""
    found = model_spread(np.full(10, 9.0), np.full(10, 1e6))
    assert found.log_sd == 0.0 == found.cv
    assert 0.05 < found.log_sd_used < found.log_sd95[1] < 1.0 / 3.0
    wide = interval_with_model(1.0, (0.8, 1.3), found)
    assert wide[0] < 0.8
    assert wide[1] > 1.3


REPLICATIONS, LOG_SD = 300, 0.6


def covered(spreads: list[ModelSpread], factor: float) -> int:
    """Count how many intervals hold the rate of a model that nobody knows, with `factor` times the spread found."""
    rng = np.random.default_rng(1)
    held = 0
    for found in spreads:
        tampered = replace(found, log_sd_used=factor * found.log_sd_used)
        shipped = math.exp(0.07 * rng.standard_normal())
        sampling = (shipped * math.exp(-Z95 * 0.07), shipped * math.exp(Z95 * 0.07))
        low, high = interval_with_model(shipped, sampling, tampered)
        held += low <= math.exp(LOG_SD * rng.standard_normal()) <= high
    return held


def test_intervals_hold_as_often_as_they_say(seed: int) -> None:
    """H0: 95 % hold, of the rate and of the spread. Unit: 30 models of 25 crashes, n 300, exact binomial at 1e-6.

    With a spread half as large, and with intervals of the spread half as long (in logarithms), both are refused.
    """
    rng = np.random.default_rng(seed)
    spreads = [counted(rng, LOG_SD, 30, 25.0) for _ in range(REPLICATIONS)]
    assert rate_fits(covered(spreads, 1.0), REPLICATIONS, 0.95, 2)
    assert not rate_fits(covered(spreads, 0.5), REPLICATIONS, 0.95, 2)

    held, shorter = 0, 0
    for found in spreads:
        low, high = found.log_sd95
        held += low <= LOG_SD <= high
        shorter += found.log_sd * (low / found.log_sd) ** 0.5 <= LOG_SD <= found.log_sd * (high / found.log_sd) ** 0.5
    assert rate_fits(held, REPLICATIONS, 0.95, 2)
    assert not rate_fits(shorter, REPLICATIONS, 0.95, 2)


@pytest.mark.parametrize(
    ("count", "exposure", "mu", "tau"),
    [(0.0, 2.0, 0.3, 0.5), (7.5, 3.0, 0.1, 1.5), (900.0, 1e3, 0.0, 0.05), (3.0, 1e-3, 2.0, 2.0)],
)
def test_the_likelihood_is_the_integral(count: float, exposure: float, mu: float, tau: float) -> None:
    """Against adaptive integration by another library, of the Poisson chance over log-normal rates."""
    (ours,) = model_uncertainty._log_likelihood(np.array([count]), np.array([exposure]), mu, tau)

    def inside(x: float) -> float:
        return math.exp(count * x - exposure * math.exp(x) - peak) * stats.norm.pdf(x, mu, tau)

    top = math.log(max(count, 0.1) / exposure)
    middle = (top * count + mu / tau**2) / (count + 1.0 / tau**2)
    peak = count * middle - exposure * math.exp(middle)
    theirs, _ = integrate.quad(inside, mu - 12.0 * tau, mu + 12.0 * tau, points=[middle], limit=400)
    assert ours == pytest.approx(peak + math.log(theirs), abs=2e-6 * max(1.0, abs(ours)))


@given(st.floats(0.01, 0.99), st.floats(1.01, 50.0), st.floats(0.0, 2.0), st.integers(5, 500))
def test_it_is_never_narrower_than_sampling_and_grows_with_the_spread(
    below: float, above: float, log_sd: float, draws: int
) -> None:
    spread = partial(ModelSpread, draws, median=1.0, log_sd95=(0.0, 3.0))
    low, high = interval_with_model(5.0, (5.0 * below, 5.0 * above), spread(log_sd=log_sd, log_sd_used=log_sd))
    assert 0.0 <= low <= 5.0 * below
    assert high >= 5.0 * above
    wider = interval_with_model(5.0, (5.0 * below, 5.0 * above), spread(log_sd=log_sd, log_sd_used=log_sd + 0.1))
    assert wider[0] < low
    assert wider[1] > high
    assert interval_with_model(5.0, (0.0, 9.0), spread(log_sd=log_sd, log_sd_used=log_sd))[0] == 0.0


def test_a_unit_of_exposure_does_not_matter() -> None:
    counts, exposures = np.array([3.0, 40.0, 11.0, 0.0, 8.0, 25.0]), np.array([1.0, 2.0, 1.0, 1.0, 2.0, 1.0]) * 1e7
    one, other = model_spread(counts, exposures), model_spread(counts, exposures / 1e7)
    assert one.log_sd == pytest.approx(other.log_sd, rel=1e-3)
    assert one.median == pytest.approx(other.median / 1e7, rel=1e-3)


def test_weights_count_draws_and_leave_out_what_weighs_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    counts, exposures = rng.poisson(25.0 * np.exp(0.6 * rng.standard_normal(40))).astype(float), np.full(40, 1e7)
    wild = np.where(np.arange(40) < 20, counts, 50.0 * counts)
    kept = np.where(np.arange(40) < 20, 0.3, 0.0)
    some, weighed = model_spread(counts[:20], exposures[:20]), model_spread(wild, exposures, kept)
    assert weighed.draws == pytest.approx(20.0)
    assert weighed.log_sd == pytest.approx(some.log_sd, rel=1e-3)
    assert weighed.log_sd95 == pytest.approx(some.log_sd95, rel=2e-3)
    assert model_spread(wild, exposures).log_sd > 2.0 * some.log_sd


def test_traffic_like_peoples_weighs_most() -> None:
    """With many miles a model's rate is known, and the weight is that of a log-normal known to a factor of 3."""
    miles = 1e10
    factors = np.array([0.1, 0.5, 1.0, 2.0, 10.0])
    weights = traffic_weights(factors * MOTORWAY.low * miles, miles)
    np.testing.assert_allclose(weights, np.exp(-0.5 * (np.log(factors) / math.log(3.0)) ** 2), atol=0.01)
    few = traffic_weights(np.arange(60.0), 1.3e6)
    assert np.argmax(few) == 1, "1.04 crashes of motorways in so many miles"
    assert (np.diff(few[1:]) < 0.0).all()
    assert few[0] > 0.05, "no crash in so few miles excludes little"
    for wrong in (np.array([-1.0]), np.array([math.nan]), np.ones((2, 2))):
        with pytest.raises(InputError, match="bv_crashes"):
            traffic_weights(wrong, 1e6)
    with pytest.raises(InputError, match="bv_miles"):
        traffic_weights(np.ones(3), 0.0)


def test_what_is_wrong_is_said() -> None:
    ones = np.ones(6)
    with pytest.raises(InputError, match="too few"):
        model_spread(ones[:4], ones[:4])
    with pytest.raises(InputError, match="no drawn model crashed"):
        model_spread(0.0 * ones, ones)
    with pytest.raises(InputError, match="no drawn model crashed"):
        effective_counts(0.0 * ones, ones)
    with pytest.raises(InputError, match="shape"):
        model_spread(ones, ones[:5])
    with pytest.raises(InputError, match="shape"):
        effective_counts(ones, ones[:5])
    with pytest.raises(InputError, match="weights"):
        model_spread(ones, ones, -ones)
    with pytest.raises(InputError, match="too few"):
        model_spread(ones, ones, np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(InputError, match="exposures"):
        model_spread(ones, 0.0 * ones)
    with pytest.raises(InputError, match="errors"):
        effective_counts(ones, 0.0 * ones)
    with pytest.raises(InputError, match="does not hold the rate"):
        interval_with_model(2.0, (2.5, 3.0), ModelSpread(9, 0.0, (0.0, 0.0), 0.0, 1.0))
