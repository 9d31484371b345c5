"""Stochastic car-following laws: mean, spread and heavy tails of the next second's acceleration, and their fit.

A law maps a state (speed, gap, range rate) to a Student-t distribution of the mean acceleration over the next second,
which is then summed into the 31 acceleration bins of the model. The model is made from `LogLaw`; `IdmLaw` is the
baseline, fitted to the same data.

Sources: the LOG form was found by comparing laws on the NGSIM I-80 data (docs/adr/0008-likely-and-safe.md); IDM:
Treiber, Hennecke, Helbing (2000), doi:10.1103/PhysRevE.62.1805.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from cornerforge.types import ACCELERATION_STEP, ACCELERATIONS

__all__ = ["ENDLESS", "FollowingLaw", "IdmLaw", "LogLaw", "bin_index", "bin_probabilities", "fit_law", "log_likelihood"]

Floats = NDArray[np.float64]

ENDLESS = 1e6
"""`LogLaw.opening` [m/s] at which drivers follow a leader that draws away at all speeds; of files that say none."""
MIN_GAP = 0.5
"""Smaller gaps count as this [m], so that a touching pair has a finite law."""
_EDGES: Floats = np.concatenate([[-np.inf], ACCELERATIONS[:-1] + ACCELERATION_STEP / 2, [np.inf]])
_FLOOR = 1e-6
"""Least probability of a decision in a log-likelihood, also if a law calls it impossible."""


class FollowingLaw(Protocol):
    """Interface of all laws; arrays broadcast against each other."""

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the Student-t noise."""

    def mean(self, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
        """Return the centre of the acceleration's distribution [m/s2]."""

    def scale(self, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
        """Return the scale of the Student-t noise [m/s2], above 0."""


def _scale(law: LogLaw | IdmLaw, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
    """Scale of the noise [m/s2]: grows with |rr| / gap^power; shrinks in creeping traffic, below 7 m/s (I-80)."""
    creep = np.minimum((speed + 1.0) / 8.0, 1.0) ** 0.4
    closing = law.spread_closing * np.abs(range_rate) / np.maximum(gap, MIN_GAP) ** law.spread_power
    return np.asarray(creep * (law.spread + closing))


@dataclass(frozen=True)
class LogLaw:
    """A law that follows the leader's speed and pulls the logarithm of the time gap gently to its usual value.

    mean = f + pull * ln(tg / headway) - 0.067 c^2 / (2 gap) + offset, with time gap tg = gap / (v + 0.55) and closing
    speed c = max(-rr, 0); f = response * rr * (v + 1)^0.24 / (gap + reach) where the gap closes. Where it opens,
    f / (1 + f ((v + 1) / opening)^opening_power): people follow a leader that draws away the less, the faster they are;
    scale = spread + spread_closing |rr| / gap^spread_power, less below 7 m/s (`_scale`).

    The defaults were fitted to the NGSIM files of the default model; they are used where a user has too few data.
    The pull on a logarithm, unlike the IDM's, lets drivers keep very different time gaps, as real drivers do.
    """

    response: float = 3.793
    reach: float = field(default=5.516, metadata={"unit": "m"})
    pull: float = field(default=0.02696, metadata={"unit": "m/s2"})
    headway: float = field(default=1.6, metadata={"unit": "s"})
    offset: float = field(default=0.01105, metadata={"unit": "m/s2"})
    spread: float = field(default=0.29, metadata={"unit": "m/s2"})
    spread_closing: float = 0.6185
    spread_power: float = 0.7612
    degrees: float = 5.396
    opening: float = field(default=19.51, metadata={"unit": "m/s"})
    opening_power: float = 1.722

    def mean(self, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
        """Centre of the acceleration's distribution [m/s2]; gaps below 0.5 m count as 0.5 m."""
        gap = np.maximum(gap, MIN_GAP)
        closing = np.maximum(-range_rate, 0.0)
        follow = self.response * range_rate * (speed + 1.0) ** 0.24 / (gap + self.reach)
        less = np.minimum((speed + 1.0) / self.opening, 1e3) ** self.opening_power
        follow /= 1.0 + np.maximum(follow, 0.0) * less
        pull = self.pull * np.log(gap / (speed + 0.55) / self.headway)
        return np.asarray(follow + pull - 0.067 * closing**2 / (2.0 * gap) + self.offset)

    scale = _scale


@dataclass(frozen=True)
class IdmLaw:
    """The intelligent driver model with the same noise as `LogLaw`; desired speed fixed at 36 m/s.

    It is fixed because congested data do not determine it: a fitted value would be extrapolated and spoil the baseline.
    """

    acceleration: float = field(default=1.0, metadata={"unit": "m/s2"})
    comfort: float = field(default=2.0, metadata={"unit": "m/s2"})
    standstill: float = field(default=3.0, metadata={"unit": "m"})
    headway: float = field(default=1.2, metadata={"unit": "s"})
    spread: float = field(default=0.4, metadata={"unit": "m/s2"})
    spread_closing: float = 0.3
    spread_power: float = 0.5
    degrees: float = 8.0

    def mean(self, speed: Floats, gap: Floats, range_rate: Floats) -> Floats:
        """IDM acceleration [m/s2]; gaps below 0.5 m count as 0.5 m."""
        gap = np.maximum(gap, MIN_GAP)
        interaction = -speed * range_rate / (2.0 * math.sqrt(self.acceleration * self.comfort))
        desired = self.standstill + np.maximum(0.0, speed * self.headway + interaction)
        return np.asarray(self.acceleration * (1.0 - (speed / 36.0) ** 4 - (desired / gap) ** 2))

    scale = _scale


def bin_index(acceleration: Floats) -> NDArray[np.int64]:
    """Return the index of the nearest of the 31 accelerations; beyond -4 or 2 m/s2, of the outermost.

    >>> bin_index(np.array([-9.0, -0.09, 0.11, 5.0]))
    array([ 0, 20, 21, 30])
    """
    nearest = np.rint((acceleration - ACCELERATIONS[0]) / ACCELERATION_STEP)
    return np.asarray(np.clip(nearest, 0, ACCELERATIONS.size - 1), dtype=np.int64)


def bin_probabilities(mean: Floats, scale: Floats, degrees: float) -> Floats:
    """Return Student-t probabilities of the 31 acceleration bins, shape (*d, 31), from centre and scale, shape (*d).

    The outermost bins include the tails, so rows sum to 1 for every centre. None is negative: before SciPy 1.15 the
    distribution function goes down by its last bit in places, and a model with that row is refused.
    """
    from scipy.special import stdtr

    cumulative = stdtr(degrees, (_EDGES - mean[..., None]) / scale[..., None])
    return np.asarray(np.maximum(np.diff(cumulative, axis=-1), 0.0), dtype=np.float64)


def log_likelihood(law: FollowingLaw, speed: Floats, gap: Floats, range_rate: Floats, acceleration: Floats) -> float:
    """Return the mean natural log of the observed bins' probability; higher is better, uniform is -ln 31 = -3.43.

    Args:
        law: The law.
        speed: Subject speed [m/s], shape (n,), n at least 1.
        gap: Bumper-to-bumper distance [m], shape (n,).
        range_rate: Lead minus subject [m/s], shape (n,).
        acceleration: Observed mean acceleration over the next second [m/s2], shape (n,).
    """
    from scipy.special import stdtr

    mean, scale = law.mean(speed, gap, range_rate), law.scale(speed, gap, range_rate)
    index = bin_index(acceleration)
    upper = stdtr(law.degrees, (_EDGES[index + 1] - mean) / scale)
    lower = stdtr(law.degrees, (_EDGES[index] - mean) / scale)
    return float(np.log(np.maximum(upper - lower, _FLOOR)).mean())


Law = TypeVar("Law", LogLaw, IdmLaw)


def fit_law(start: Law, speed: Floats, gap: Floats, range_rate: Floats, acceleration: Floats) -> Law:
    """Fit a law by maximum likelihood, starting at `start`; parameters are rounded to 4 significant digits.

    All parameters but the offset stay positive: their logarithms are fitted. Thanks to the rounding a second fit gives
    the same bytes, mostly on another machine too. Arrays as for `log_likelihood`.
    """
    from scipy.optimize import minimize

    names = list(type(start).__dataclass_fields__)
    positive = np.array([name != "offset" for name in names])

    def law_at(point: Floats, form: str = ".17g") -> Law:
        values = np.where(positive, np.exp(np.where(positive, point, 0.0)), point)
        return type(start)(*(float(format(value, form)) for value in values))

    values = np.array(astuple(start))
    first = np.where(positive, np.log(np.where(positive, values, 1.0)), values)
    best = minimize(
        lambda point: -log_likelihood(law_at(point), speed, gap, range_rate, acceleration),
        first,
        method="L-BFGS-B",
        bounds=[(math.log(1e-3), math.log(100.0)) if flag else (-1.0, 1.0) for flag in positive],
    )
    return law_at(np.asarray(best.x, dtype=np.float64), ".4g")
