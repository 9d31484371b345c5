"""Rates as means of weights: interval, precision, and whether the weights can be trusted.

The mean over trees of tests is the crash rate; most trees give 0, few give much. Means of this kind are skewed: most
are a little too low, few far too high. So intervals reach further up than down (Hall 1992, "On the removal of skewness
by transformation"). While only few trees carry the sum, even they are too narrow, since what is missing sits in rare
heavy trees. So a rate is given only if enough trees carry it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_number
from cornerforge.errors import InputError

__all__ = [
    "LARGEST_SHARE",
    "LEAST_EFFECTIVE",
    "LEAST_TREES",
    "WeightedRate",
    "always_valid_interval",
    "first_guess",
    "plain_doubts",
    "weighted_rate",
]

LEAST_EFFECTIVE = 300.0
"""Fewest trees, by `WeightedRate.effective`, that a rate may rest on."""
LEAST_TREES = 300_000
"""Fewest trees that a run may stop at: as many as taught the network, nearly. A run that stops as soon as its rate is
narrow stops before the rare heavy trees come, and is too low."""
LARGEST_SHARE = 0.05
"""Largest share of the sum that one tree may have."""
_HALVES_APART = 3.5
_Z95, _Z90 = 1.959963984540054, 1.6448536269514722
_LOOKS_AT = 300.0
_CHANCE_OF_PLAIN = 0.01


@dataclass(frozen=True)
class WeightedRate:
    """A rate from independent weights of mean `rate`.

    Attributes:
        n: Number of weights.
        unit: What has a weight, for words: "trees" or "tests".
        rate: Their mean.
        error: Its standard error.
        skewness: Skewness of the weights over the root of n, so of their mean; 0 if all are equal.
        low, high: 95 % interval, corrected for skewness; low is at least 0.
        half_width, half_width_90: Half of the 95 % and of the 90 % interval over the rate; infinite without a crash.
        effective: (sum)^2 / sum of squares: so many equal weights would be as exact, nearly; 0 without a crash.
        largest: Largest share of the sum in one weight.
        halves: Means of the first and the second half.
        tail: Hill's estimate of the tail index from the largest twentieth of what is above 0, at least 10 of them; None
            with fewer. Below 2 the variance is not finite, as far as they show it.
    """

    n: int
    unit: str
    rate: float
    error: float
    skewness: float
    low: float
    high: float
    half_width: float
    half_width_90: float
    effective: float
    largest: float
    halves: tuple[float, float]
    tail: float | None

    @property
    def counted_tests(self) -> float:
        """Tests that counting would need for the same half-width, for a rate far below 1; 0 without a crash."""
        return (_Z95 / self.half_width) ** 2 / self.rate if self.rate > 0.0 and self.half_width > 0.0 else 0.0

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust the interval, in words; may be empty."""
        found = []
        if self.effective < LEAST_EFFECTIVE:
            found.append(f"it rests on {self.effective:.0f} effective {self.unit}, fewer than {LEAST_EFFECTIVE:.0f}")
        if self.largest > LARGEST_SHARE:
            found.append(
                f"one {self.unit[:-1]} has {100.0 * self.largest:.0f} % of it, more than {100.0 * LARGEST_SHARE:.0f} %"
            )
        apart = abs(self.halves[0] - self.halves[1]) / (2.0 * self.error) if self.error > 0.0 else 0.0
        if apart > _HALVES_APART:
            found.append(f"its halves are {apart:.1f} standard errors apart")
        return tuple(found)


def weighted_rate(weights: NDArray[np.float64], unit: str = "trees") -> WeightedRate:
    """Take the mean of independent weights, at least 2, and judge it; `unit`: what has a weight.

    Raises:
        InputError: There are fewer than 2 weights, or one is below 0 or not finite.

    >>> found = weighted_rate(np.array([0.0, 1.0, 0.0, 1.0]))
    >>> found.rate, found.effective, found.largest
    (0.5, 2.0, 0.5)
    """
    n = weights.size
    if n < 2 or not np.isfinite(weights).all() or (weights < 0.0).any():
        raise InputError(f"weights: {n} of them; needed are at least 2, all finite and 0 or more.")
    total = float(weights.sum())
    rate = total / n
    spread = float(weights.std(ddof=1))
    error = spread / math.sqrt(n)
    apart = weights - rate
    skewness = float(np.dot(apart * apart, apart)) / n / spread**3 / math.sqrt(n) if spread > 0.0 else 0.0
    (low, high), (low90, high90) = (_interval(rate, error, skewness, z) for z in (_Z95, _Z90))
    return WeightedRate(
        n=n,
        unit=unit,
        rate=rate,
        error=error,
        skewness=skewness,
        low=low,
        high=high,
        half_width=0.5 * (high - low) / rate if rate > 0.0 else math.inf,
        half_width_90=0.5 * (high90 - low90) / rate if rate > 0.0 else math.inf,
        effective=total * total / float((weights * weights).sum()) if total > 0.0 else 0.0,
        largest=float(weights.max()) / total if total > 0.0 else 0.0,
        halves=(float(weights[: n // 2].mean()), float(weights[n // 2 :].mean())),
        tail=_tail_index(weights),
    )


def _interval(mean: float, error: float, skewness: float, z: float) -> tuple[float, float]:
    """Compute the interval of a mean of values that are not negative: z standard errors, corrected for skewness.

    Hall's cubic transformation of the t-statistic; for skewness 0 the normal interval.
    """
    return max(0.0, mean - error * _untransformed(z, skewness)), mean - error * _untransformed(-z, skewness)


def _untransformed(y: float, skewness: float) -> float:
    """Solve t + g t^2 / 3 + g^2 t^3 / 27 + g / 6 = y for t; g is the skewness."""
    if abs(skewness) < 1e-6:
        return y
    return 3.0 / skewness * (float(np.cbrt(1.0 + skewness * (y - skewness / 6.0))) - 1.0)


def _tail_index(weights: NDArray[np.float64]) -> float | None:
    """Estimate the index of the upper tail (Hill 1975)."""
    above = np.sort(weights[weights > 0.0])
    k = above.size // 20
    if k < 10:
        return None
    spread = float(np.log(above[-k:] / above[-k - 1]).mean())
    return 1.0 / spread if spread > 0.0 else math.inf


def always_valid_interval(found: WeightedRate, confidence: float = 0.95) -> tuple[float, float]:
    """Compute an interval for all n at once, so that one may stop when it is narrow; (0, inf) without a crash.

    Robbins' normal mixture with the estimated variance (Waudby-Smith, Arbour, Sinha, Kennedy and Ramdas 2021, "Time-
    uniform central limit theory and asymptotic confidence sequences"), narrowest near 300 effective trees, says how
    many standard errors; they are corrected for skewness. Like the central limit theorem it holds once n is large.

    Raises:
        InputError: The confidence is not in (0, 1).
    """
    check_number("confidence", confidence, low=1e-9, high=1.0 - 1e-9)
    if found.effective == 0.0:
        return 0.0, math.inf
    alpha = 1.0 - confidence
    best = _LOOKS_AT * found.n / found.effective
    scale = (-2.0 * math.log(alpha) + math.log(-2.0 * math.log(alpha) + 1.0)) / best
    grown = found.n * scale + 1.0
    radius = math.sqrt(2.0 * grown / (found.n**2 * scale) * math.log(math.sqrt(grown) / alpha))
    return _interval(found.rate, found.error, found.skewness, radius * math.sqrt(found.n))


def first_guess(rounds: Sequence[NDArray[np.float64]]) -> float:
    """Guess a rate from the weights of rounds of teaching, each without bias, later ones more exact.

    The round k has the weight of its root (Owen and Zhou 2020, "The square root rule for adaptive importance
    sampling"): at most 9/8 of the least variance if variances fall by a power of k between 0 and 1.

    >>> first_guess([np.array([0.0, 2.0]), np.array([2.0, 2.0])])
    1.585786437626905
    """
    trust = np.sqrt(np.arange(1, len(rounds) + 1))
    return float(np.dot(trust, [weights.mean() for weights in rounds]) / trust.sum())


def plain_doubts(most: Mapping[str, float], plain: Mapping[str, int], tests: int) -> tuple[str, ...]:
    """Compare rates with what plain tests came to, which no network chose: kinds of crash that it does not know.

    Args:
        most: Upper bound of the rate of each kind of crash, by name.
        plain: Crashes of each in plain tests, by the same names.
        tests: Number of plain tests.

    Returns:
        What plain tests have more of than they would with a chance of 1 %, all kinds together; in words.

    >>> plain_doubts({"side": 1e-3, "rear": 1e-3}, {"side": 2, "rear": 9}, 1000)
    ('1,000 plain tests had 9 crashes of rear, the trees allow 1',)
    """
    from scipy.special import bdtrc  # here, because it takes long to load

    told = []
    for name, crashes in plain.items():
        if crashes > 0 and float(bdtrc(crashes - 1, tests, min(1.0, most[name]))) < _CHANCE_OF_PLAIN / len(plain):
            told.append(
                f"{tests:,} plain tests had {crashes} crashes of {name}, the trees allow {most[name] * tests:.2g}"
            )
    return tuple(told)
