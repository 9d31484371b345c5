"""An AV's rate against people's: ratio with interval, miles that would show it, and what makes them differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cornerforge._checks import check_integer, check_number
from cornerforge.errors import InputError
from cornerforge.ext.evidence.benchmarks import CRASHED, PERSONS, Benchmark
from cornerforge.intervals import poisson_interval, rate_ratio_interval
from cornerforge.results.analysis import NaturalKind

__all__ = [
    "DIFFERENCES", "TRUE_RATIOS", "AgainstPeople", "compare", "compare_kind", "compare_weighted", "effective_count",
    "miles_needed",
]  # fmt: skip

TRUE_RATIOS = (0.2, 0.5, 0.8)
"""True ratios for which the page says how many miles would show them."""
DIFFERENCES = (
    "The two numbers do not count the same. The simulator counts every touch of the AV, however light; police hear of "
    "four in ten crashes with damage only and of two in three with an injury, and many states ask for a least damage. "
    "The simulator drives one motorway in one direction among drivers that touch less severely than people do: no "
    "crossing, no oncoming traffic, no pedestrian, no single vehicle that leaves the road, no weather and no night. "
    "Published rates are of whole cities, years and fleets; this AV's miles are those of its ODD. An injury is here a "
    "chance of MAIS 3 or more in the AV, by delta-v; published ones are what an officer saw, of anybody in the crash "
    "(on German motorways the share of MAIS 3 among them, projected for all roads). So a ratio below 1 shows no safety "
    "on a road. It says whether the AV would have to be looked at again even if the simulator were right."
)
"""Why a rate from the simulator and a published one are not of the same thing; pages show it beside each ratio."""
_MOST_EVENTS = 1_000_000


@dataclass(frozen=True)
class AgainstPeople:
    """A rate of the AV over one of people.

    Attributes:
        benchmark: People's rate.
        rate: The AV's, per million miles.
        ratio: `rate` over people's; below 1: the AV's is lower.
        low, high: Its 95 % interval.
        exact: People's rate was taken as exact, because no interval of it is published.
    """

    benchmark: Benchmark
    rate: float
    ratio: float
    low: float
    high: float
    exact: bool

    @property
    def verdict(self) -> str:
        """Word for what the interval shows: "lower", "higher", or "not known" while it holds 1."""
        return "lower" if self.high < 1.0 else "higher" if self.low > 1.0 else "not known"


def compare(benchmark: Benchmark, count: int, miles: float, confidence: float = 0.95) -> AgainstPeople:
    """Compare counted crashes of the AV with people's rate.

    The interval holds chance in the AV's count and, where it is published, in people's rate (as so many crashes as
    would give that interval).

    Args:
        benchmark: People's rate, in crashed vehicles or in persons hurt. A vehicle can have several of these, so that
            the ratio is a lower bound.
        count: Crashes of the AV, at least 0.
        miles: Million miles that it drove, above 0.
        confidence: Of the interval, in (0, 1).

    Raises:
        InputError: A number is out of range, or the benchmark counts something else.

    Source: Przyborowski and Wilenski (1940) for two counts; Garwood (1936) where people's rate is exact.
    """
    check_integer("count", count, low=0)
    check_number("miles", miles, low=1e-300, high=1e300)
    if benchmark.unit not in (CRASHED, PERSONS):
        raise InputError(
            f"{benchmark.id} counts {benchmark.unit}, the AV's rate {CRASHED}: turn it with as_crashed_vehicles, or "
            "choose another benchmark."
        )
    known = benchmark.interval
    if known is None:
        low, high = (end / miles / benchmark.rate for end in poisson_interval(count, confidence))
    else:
        theirs = benchmark.count or max(1, int(effective_count(benchmark.rate, known[0])))
        low, end = rate_ratio_interval(count, miles, theirs, theirs / benchmark.rate, confidence)
        high = np.inf if end is None else end
    rate = count / miles
    return AgainstPeople(benchmark, rate, rate / benchmark.rate, low, high, known is None)


def compare_weighted(benchmark: Benchmark, rate: float, low: float) -> AgainstPeople:
    """Compare a weighted rate of the AV, such as one of trees or of serious injuries, with people's rate.

    The rate counts as the number of equal events that would give its interval, rounded down.

    Args:
        benchmark: People's rate, as in `compare`.
        rate: The AV's, per million miles, above 0.
        low: Lower end of its 95 % interval, above 0 and below `rate`.

    Raises:
        InputError: A number is out of range, the rate rests on less than one event, or as `compare`.
    """
    events = int(effective_count(rate, low))
    if events < 1:
        raise InputError(f"The rate {rate:g} rests on less than one event: drive more before you compare it.")
    return compare(benchmark, events, events / rate)


def compare_kind(benchmark: Benchmark, kind: NaturalKind) -> AgainstPeople:
    """Compare natural crashes of one kind, such as `Natural.all` or `Natural.serious_injuries`, with people's rate.

    Serious injuries (MAIS 3 or more, each crash counted by its chance) belong to benchmarks of outcome MAIS 3 or more;
    serious injuries as police count them are more frequent.

    Raises:
        InputError: As `compare_weighted`.
    """
    return compare_weighted(benchmark, 1e6 / kind.miles_between, 1e6 / kind.interval95_miles[1])


def effective_count(rate: float, low: float) -> float:
    """Give how many events of equal weight make an interval whose lower 95 % end is `low` of their rate.

    Exact for Garwood's interval and for that of weights (Fay and Feuer 1997), where it is (sum of weights)^2 / sum of
    squares; near for others.

    Raises:
        InputError: The numbers are not 0 < `low` < `rate`.

    >>> round(effective_count(10.0, poisson_interval(10)[0]), 6)
    10.0
    """
    from scipy.optimize import brentq
    from scipy.special import gammaincinv

    if not 0.0 < low < (1.0 - 1e-5) * rate < np.inf:
        raise InputError(f"The rate {rate:g} and the lower end {low:g} of its interval must be 0 < end < rate.")
    share = low / rate
    at = brentq(lambda log: gammaincinv(np.exp(log), 0.025) / np.exp(log) - share, np.log(0.02), np.log(1e12))
    return float(np.exp(at))


def miles_needed(rate: float, ratio: float = 0.0, confidence: float = 0.95, power: float = 0.8) -> tuple[float, int]:
    """Give how far an AV must drive to show that it crashes no more often than people.

    Shown is it where so few crashes as were seen would come with a chance of at most 1 - `confidence` at people's rate.

    Args:
        rate: People's, per million miles, above 0; taken as exact.
        ratio: The AV's true rate over it, 0 to below 1. 0: it never crashes ("rule of three").
        confidence: In (0, 1).
        power: Chance that an AV of this ratio shows it, in (0, 1).

    Returns:
        Million miles, and the most crashes that may be seen in them.

    Raises:
        InputError: A number is out of range, or a million crashes would not be enough: the ratio is too near 1.

    Source: the exact test of a Poisson mean; Kalra and Paddock (2016) for the question.

    >>> miles, most = miles_needed(0.0109)  # 1.09 deaths per 100 million miles
    >>> round(miles), most
    (275, 0)
    """
    from scipy.special import gammaincc, gammaincinv

    check_number("rate", rate, low=1e-300, high=1e300)
    check_number("ratio", ratio, low=0.0, high=1.0 - 1e-9)
    for name, value in (("confidence", confidence), ("power", power)):
        check_number(name, value, low=1e-9, high=1.0 - 1e-9)
    most = 1024
    while most <= _MOST_EVENTS:
        seen = np.arange(most) + 1.0
        expected = gammaincinv(seen, confidence)  # at people's rate, so that fewer are too few by chance
        enough = gammaincc(seen, ratio * expected) >= power
        if enough.any():
            first = int(enough.argmax())
            return float(expected[first]) / rate, first
        most *= 4
    raise InputError(f"ratio = {ratio:g} is too near 1: a million crashes would not show the difference.")
