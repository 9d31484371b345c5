"""How far a rate is uncertain because the model is: rates of drawn models, each with an error of its own.

A drawn model's rate is r = exp(mu + tau z), z standard normal, and what was found of it are k crashes (or effective
trees, which carry as much information) in an exposure e: Poisson with mean e r. tau has the greatest likelihood over
all draws, its interval comes from the profile likelihood. With it the interval of a rate is widened. Models with
traffic that crashes much more or less often than people do count for less (`traffic_weights`). (A Poisson-log-normal
model: Aitchison and Ho 1989, doi:10.1093/biomet/76.4.643; integrals by adaptive Gauss-Hermite quadrature: Liu and
Pierce 1994, doi:10.1093/biomet/81.3.624.) Rates are taken as weights' means by `effective_counts`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_number
from cornerforge.errors import InputError
from cornerforge.rates.people import MOTORWAY

__all__ = [
    "FEWEST_DRAWS",
    "ModelSpread",
    "effective_counts",
    "effective_number",
    "interval_with_model",
    "model_spread",
    "traffic_weights",
]

Floats = NDArray[np.float64]

FEWEST_DRAWS = 5
"""Fewest drawn models from which their spread is estimated."""
_KNOWN_TO = math.log(3.0)
"""Standard deviation of the logarithm to which this holds for a model's tests, a judgement: not all crashes are
reported, and in tests of 400 m BVs crash less often than in traffic of a minute."""
_QUANTILES = (np.arange(200) + 0.5) / 200.0
_Z95 = 1.959963984540054
_CHI2_95, _CHI2_90 = 3.841458820694124, 2.705543454095404
_LARGEST, _SMALLEST = 4.0, 1e-4
"""Between these tau is sought; a smaller one counts as 0."""
_NODES, _NODE_WEIGHTS = np.polynomial.hermite.hermgauss(20)
_LOG_WEIGHTS = np.log(_NODE_WEIGHTS) + _NODES**2
_NEWTON_STEPS = 60


@dataclass(frozen=True)
class ModelSpread:
    """How far rates of drawn models lie apart, beyond what chance does.

    Attributes:
        draws: Models drawn; with weights the number of equal ones with as much information.
        log_sd: Standard deviation of the rate's natural logarithm between models; 0 if nothing is seen of it.
        log_sd95: Its 95 % interval; begins at 0 if models that are all alike would explain what was found.
        log_sd_used: The one for intervals: `log_sd`; where that is 0, its upper 95 % bound.
        median: Median rate of the models, per unit of the exposure.
    """

    draws: float
    log_sd: float
    log_sd95: tuple[float, float]
    log_sd_used: float
    median: float

    @property
    def cv(self) -> float:
        """Standard deviation between models over their mean."""
        return _cv(self.log_sd)

    @property
    def cv95(self) -> tuple[float, float]:
        """Interval of 95 %."""
        low, high = self.log_sd95
        return _cv(low), _cv(high)


def _cv(log_sd: float) -> float:
    return math.sqrt(math.expm1(log_sd * log_sd))


def effective_counts(rates: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Turn rates with standard errors into counts and exposures that say the same: k = r^2 / s^2, e = r / s^2.

    Args:
        rates: Rate of each draw, 0 or more, shape (M,); at least one above 0.
        errors: Standard errors, shape (M,); above 0 where the rate is.

    Returns:
        Counts and exposures, each of shape (M,). Of a rate of 0 the error says nothing; its exposure is the median of
        the others'.

    Raises:
        InputError: The shapes differ, a number is not finite or below 0, or no rate is above 0.

    >>> effective_counts(np.array([2.0, 0.0]), np.array([1.0, 0.0]))
    (array([4., 0.]), array([2., 2.]))
    """
    if rates.shape != errors.shape or rates.ndim != 1:
        raise InputError(f"rates have shape {rates.shape}, errors {errors.shape}; both must be (M,).")
    found = rates > 0.0
    if not np.isfinite([rates, errors]).all() or (rates < 0.0).any() or (errors[found] <= 0.0).any():
        raise InputError("rates and their errors must be finite, rates 0 or more, and errors of rates above 0 above 0.")
    if not found.any():
        raise InputError("no drawn model crashed, so nothing is known of their spread; drive more of each.")
    exposure = np.divide(rates, errors**2, out=np.zeros_like(rates), where=found)
    exposure[~found] = np.median(exposure[found])
    return rates * exposure, exposure


def traffic_weights(bv_crashes: Floats, bv_miles: float) -> Floats:
    """Weigh drawn models by how well their traffic crashes as often as people do, between 0 and 1.

    Crashes of people are known to a factor of 3: a log-normal likelihood about that of `MOTORWAY`. What a model's rate
    is, after n crashes in its miles, is Gamma(n + 1/2, miles), so the weight is a mean over that.

    Args:
        bv_crashes: Crashes between BVs in tests of each model, shape (M,), 0 or more.
        bv_miles: Miles that the BVs of one model drove, above 0.

    Raises:
        InputError: A number is not what it must be.

    >>> traffic_weights(np.array([0.0, 2.0, 40.0]), 1.3e6).round(2)
    array([0.44, 0.73, 0.  ])
    """
    from scipy.special import gammaincinv  # here, because it takes long to load

    check_number("bv_miles", bv_miles, low=1e-9, high=math.inf)
    if bv_crashes.ndim != 1 or not np.isfinite(bv_crashes).all() or (bv_crashes < 0.0).any():
        raise InputError("bv_crashes must be of shape (M,), finite and 0 or more.")
    rates = gammaincinv(bv_crashes[:, None] + 0.5, _QUANTILES) / bv_miles
    off = np.log(np.maximum(rates, 1e-300) / MOTORWAY.low) / _KNOWN_TO
    return np.asarray(np.exp(-0.5 * off**2).mean(axis=1))


def effective_number(weights: Floats) -> float:
    """Compute how many equal weights carry as much information, (sum)^2 / sum of squares; 0 if all are 0.

    >>> effective_number(np.array([1.0, 1.0, 0.0]))
    2.0
    """
    total = float(weights.sum())
    return total * total / float((weights * weights).sum()) if total > 0.0 else 0.0


def model_spread(counts: Floats, exposures: Floats, weights: Floats | None = None) -> ModelSpread:
    """Find how far the rates of drawn models lie apart, by maximum likelihood.

    Args:
        counts: Crashes of each draw, 0 or more, whole or not, shape (M,), M at least 5; not all 0.
        exposures: Tests in which they were found, or exposures of `effective_counts`, above 0, shape (M,).
        weights: How much each draw counts, 0 or more, shape (M,), so that at least 5 count effectively; None: equal
            weights. Their scale does not matter.

    Raises:
        InputError: The shapes differ, there are too few draws, no crash, or a number is not what it must be.

    >>> model_spread(np.full(8, 100.0), np.full(8, 1e6)).log_sd
    0.0
    """
    from scipy.optimize import brentq, minimize_scalar  # here, because it takes long to load

    if counts.shape != exposures.shape or counts.ndim != 1:
        raise InputError(f"counts have shape {counts.shape}, exposures {exposures.shape}; both must be (M,).")
    w = np.ones(counts.shape) if weights is None else weights
    if w.shape != counts.shape or not np.isfinite(w).all() or (w < 0.0).any():
        raise InputError(f"weights have shape {w.shape}; they must be {counts.shape}, finite and 0 or more.")
    draws = effective_number(w)
    if draws < FEWEST_DRAWS - 1e-9:
        raise InputError(f"{draws:.3g} drawn models are too few to know their spread; at least {FEWEST_DRAWS}.")
    if not np.isfinite([counts, exposures]).all() or (counts < 0.0).any() or (exposures <= 0.0).any():
        raise InputError("counts must be finite and 0 or more, exposures finite and above 0.")
    if not (w * counts).any():
        raise InputError("no drawn model crashed, so nothing is known of their spread; drive more of each.")
    w = w * (draws / w.sum())
    centre = math.log(w @ counts / (w @ exposures))

    def best_centre(tau: float) -> tuple[float, float]:
        if tau <= _SMALLEST:
            return centre, float(w @ _log_likelihood(counts, exposures, centre, 0.0))
        found = minimize_scalar(
            lambda mu: -float(w @ _log_likelihood(counts, exposures, mu, tau)),
            bounds=(centre - 3.0 - tau * tau, centre + 3.0 + tau * tau), method="bounded", options={"xatol": 1e-4},
        )  # fmt: skip
        return float(found.x), -float(found.fun)

    def profile(tau: float) -> float:
        return best_centre(tau)[1]

    grid = np.concatenate([[0.0], np.geomspace(0.01, _LARGEST, 13)])
    heights = [profile(tau) for tau in grid]
    top = int(np.argmax(heights))
    log_sd, highest = float(grid[top]), heights[top]
    if top > 0:
        around = (float(grid[top - 1]), float(grid[min(top + 1, grid.size - 1)]))
        found = minimize_scalar(lambda tau: -profile(tau), bounds=around, method="bounded", options={"xatol": 1e-4})
        log_sd, highest = float(found.x), max(highest, -float(found.fun))

    def end(low: float, high: float, fall: float) -> float:
        return float(brentq(lambda tau: profile(tau) - highest + 0.5 * fall, low, high, xtol=1e-4))

    if profile(0.0) >= highest - 1e-9:
        log_sd = 0.0
    falls = profile(_LARGEST) < highest - 0.5 * _CHI2_95
    upper = end(log_sd, _LARGEST, _CHI2_95) if falls else _LARGEST
    lower = 0.0 if profile(0.0) >= highest - 0.5 * _CHI2_95 else end(0.0, log_sd, _CHI2_95)
    used = log_sd
    if log_sd == 0.0:
        used = end(0.0, _LARGEST, _CHI2_90) if profile(_LARGEST) < highest - 0.5 * _CHI2_90 else _LARGEST
    return ModelSpread(draws, log_sd, (lower, upper), used, math.exp(best_centre(log_sd)[0]))


def _log_likelihood(counts: Floats, exposures: Floats, mu: float, tau: float) -> Floats:
    """Compute the log-likelihood of each draw, shape (M,), but for what depends on neither `mu` nor `tau`."""
    if tau == 0.0:
        return counts * mu - exposures * math.exp(mu)
    precision = 1.0 / (tau * tau)
    centre = np.full(counts.shape, mu)  # of the integrand k x - e exp(x) - (x - mu)^2 / (2 tau^2), by Newton's steps
    for _ in range(_NEWTON_STEPS):
        mean = exposures * np.exp(centre)
        step = (counts - mean - precision * (centre - mu)) / (mean + precision)
        centre = centre + np.clip(step, -1.0, 1.0)
        if np.abs(step).max() < 1e-9:
            break
    width = math.sqrt(2.0) / np.sqrt(exposures * np.exp(centre) + precision)
    x = centre[:, None] + width[:, None] * _NODES
    inside = counts[:, None] * x - exposures[:, None] * np.exp(x) - 0.5 * precision * (x - mu) ** 2 + _LOG_WEIGHTS
    peak = inside.max(axis=1)
    integral = peak + np.log(np.exp(inside - peak[:, None]).sum(axis=1)) + np.log(width)
    return np.asarray(integral - math.log(tau * math.sqrt(2.0 * math.pi)))


def interval_with_model(rate: float, sampling: tuple[float, float], spread: ModelSpread) -> tuple[float, float]:
    """Widen the 95 % interval of a rate by what the models' spread adds; log-normal about the rate.

    On each side the variance of the logarithm is the sampling interval's plus `log_sd_used` squared. Student's quantile
    for one degree less than there are draws takes the place of 1.96, as the spread is from few models.

    Args:
        rate: Above 0.
        sampling: Its 95 % interval; 0 <= low <= rate <= high.
        spread: Spread of drawn models.

    Returns:
        A 95 % interval, never inside of `sampling`; low is 0 where the low of `sampling` is 0.

    Raises:
        InputError: Rate or interval are not right.

    >>> alike = ModelSpread(1e9, 0.0, (0.0, 0.0), 0.0, 1.0)
    >>> [round(x, 6) for x in interval_with_model(2.0, (1.0, 4.0), alike)]
    [1.0, 4.0]
    """
    from scipy.special import stdtrit

    check_number("rate", rate, low=1e-300, high=math.inf)
    low, high = sampling
    if not 0.0 <= low <= rate <= high:
        raise InputError(f"The interval {low:g} to {high:g} does not hold the rate {rate:g}, or is below 0.")
    quantile = float(stdtrit(spread.draws - 1, 0.975))
    up = quantile * math.hypot(math.log(high / rate) / _Z95, spread.log_sd_used)
    if low == 0.0:
        return 0.0, rate * math.exp(up)
    down = quantile * math.hypot(math.log(rate / low) / _Z95, spread.log_sd_used)
    return rate * math.exp(-down), rate * math.exp(up)
