"""How far drivers differ in their noise level (`memory.own_rank`), estimated from decisions: a mixed model by moments.

A decision is outer (1, else 0) if its acceleration lies in the outer quarters of the fitted law's distribution. The
mean in states of like speed, gap and range rate is taken off, as the law may be too wide or too narrow there. Of the
remainders, products of two decisions of one driver, so far apart that memory has faded, have a mean: the variance
between drivers of the chance of an outer decision, (1 + t) / 2 for noise level t. That is the random intercept of a
mixed model (Searle, Casella and McCulloch 1992, Variance Components). See docs/adr/0029-traits.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.laws import FollowingLaw
from cornerforge.ext.calibrate.resampling import resampled_weights
from cornerforge.ndd.initial import InitialState

__all__ = ["APART", "FEWEST_DRIVERS", "SHORTEST", "NoiseSpread", "fit_noise_spread"]

Floats = NDArray[np.float64]

APART = 10
"""Decisions of a driver count as apart from this many seconds on. On I-80 the remainder of their products falls from
0.09 a second apart to the level of the rest, 0.005 and less, within 10."""
SHORTEST = 30
"""Least number of decisions of a driver, for some hundred pairs apart."""
FEWEST_DRIVERS = 30
"""Least number of drivers with as many; with fewer the prior stays."""
_PER_CELL = 150.0
"""Decisions that a cell of like states holds, about: with fewer, one driver would be most of a cell."""
_MOST_PARTS = 6
"""Most parts, of equally many decisions, of each of speed, gap and range rate."""
_LARGEST = 2.0


@dataclass(frozen=True)
class NoiseSpread:
    """How far drivers differ in their noise level.

    Attributes:
        spread: `InitialState.noise_spread`: standard deviation of the logarithm of a driver's odds of an acceleration
            in the outer quarters.
        fitted: It is from the decisions; else it is the prior.
        drivers: Drivers with at least `SHORTEST` decisions.
        interval95: Interval by bootstrap over drivers; NaN for the prior.
    """

    spread: float
    fitted: bool
    drivers: int
    interval95: tuple[float, float]


def fit_noise_spread(decisions: Decisions, law: FollowingLaw) -> NoiseSpread:
    """Estimate how far drivers differ in their noise level, or keep the shipped value where they are too few.

    Thanks to the rounding to 3 significant digits a second fit gives the same bytes, mostly on another machine too.

    Args:
        decisions: One a second; those without a leader do not count.
        law: The law fitted to them.
    """
    followers = decisions.where(np.isfinite(decisions.gap))
    followers = followers.where(np.bincount(followers.vehicle, minlength=1)[followers.vehicle] >= SHORTEST)
    order = np.argsort(followers.vehicle, kind="stable")
    ends = np.flatnonzero(np.diff(followers.vehicle[order])) + 1
    drivers = ends.size + 1 if followers.size else 0
    if drivers < FEWEST_DRIVERS:
        return NoiseSpread(InitialState().noise_spread, fitted=False, drivers=drivers, interval95=(np.nan, np.nan))
    left = _outer(followers, law)
    left -= _means(left, followers.speed, followers.gap, np.abs(followers.range_rate))
    sums, pairs = np.array([_apart(part) for part in np.split(left[order], ends)]).T
    weights = resampled_weights(drivers)
    low, high = np.quantile((weights @ sums) / (weights @ pairs), [0.025, 0.975]).tolist()
    spread, *ends95 = (float(format(_spread(x), ".3g")) for x in (float(sums.sum() / pairs.sum()), low, high))
    return NoiseSpread(spread, fitted=True, drivers=drivers, interval95=(ends95[0], ends95[1]))


def _outer(decisions: Decisions, law: FollowingLaw) -> Floats:
    """Tell which accelerations lie in the outer quarters of the law's distribution, 1 or 0, shape (n,)."""
    from scipy.special import stdtr

    state = decisions.speed, decisions.gap, decisions.range_rate
    rank = stdtr(law.degrees, (decisions.acceleration - law.mean(*state)) / law.scale(*state))
    return np.asarray(np.abs(rank - 0.5) > 0.25, dtype=np.float64)


def _means(values: Floats, *states: Floats) -> Floats:
    """Mean of `values` in the cell of each decision, shape (n,); cells by quantiles of each of `states`."""
    parts = max(1, min(_MOST_PARTS, round((values.size / _PER_CELL) ** (1.0 / len(states)))))
    cell = np.zeros(values.size, dtype=np.int64)
    for state in states:
        cell = cell * parts + np.searchsorted(np.quantile(state, np.arange(1, parts) / parts), state)
    return np.asarray((np.bincount(cell, values) / np.maximum(np.bincount(cell), 1))[cell])


def _apart(left: Floats) -> tuple[float, float]:
    """Sum of the products of all pairs of one driver's decisions that are `APART` or more, and their number."""
    n = left.size - APART
    return float(left[APART:] @ np.cumsum(left)[:n]), n * (n + 1) / 2.0


def _spread(variance: float) -> float:
    """Find the spread at which chances to decide outside have this variance between drivers; 0 to 2."""
    points, weights = np.polynomial.hermite_e.hermegauss(61)
    low, high = 0.0, _LARGEST
    for _ in range(48):
        middle = 0.5 * (low + high)
        found = float(weights @ np.tanh(0.5 * middle * points) ** 2 / weights.sum()) / 4.0
        low, high = (middle, high) if found < variance else (low, middle)
    return low if variance > 0.0 else 0.0
