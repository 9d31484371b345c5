"""How often the AV touches a vehicle on the road: one rate, made once, for every place of the page that says it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from cornerforge.report import text
from cornerforge.report.artefacts import Summary
from cornerforge.results import NaturalRate
from cornerforge.results.analysis import Natural, NaturalKind
from cornerforge.results.rates import Rate

__all__ = ["RoadRate", "on_road", "road_rate"]


@dataclass(frozen=True)
class RoadRate:
    """How often the AV crashes in natural traffic.

    Attributes:
        miles: From one crash to the next, on average; None: no crash was seen.
        low, high: 95 % interval of `miles`; high None: no upper end.
        basis: What it rests on, with n, in words.
        driven: Miles in which no crash was seen; None: not known, or there was one.
        doubts: Why it cannot be trusted yet.
    """

    miles: float | None
    low: float
    high: float | None
    basis: str
    driven: float | None = None
    doubts: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """How often, as "once in 760 thousand miles"."""
        if self.miles is None:
            return f"less than once in {text.miles(text.rounded_down(self.low))}"
        return f"once in {text.miles(self.miles)}"

    @property
    def interval(self) -> str:
        """The 95 % interval, in words."""
        if self.high is None:
            return f"{text.miles(self.low)} to any distance"
        return text.miles_range(self.low, self.high)


def road_rate(summary: Summary) -> RoadRate | None:
    """Return the best that is known of how often the AV crashes in natural traffic; None if nothing is.

    In this order: the natural rate of a run or of `rate`; the weights of natural cases; plain tests of natural traffic.
    """
    rate = summary.natural_rate
    found = None if summary.natural_cases is None else summary.natural_cases.natural
    if found is not None and not isinstance(rate, NaturalRate):
        n = f"n = {text.count(found.all.cases)} crashes"
        if found.all.cases - found.effective_cases > 0.5:
            n += f", which tell as much as {text.count(found.effective_cases)} of equal weight"
        return RoadRate(found.all.miles_between, *found.all.interval95_miles, n)
    if rate is None or rate.interval95[1] == 0.0:
        return None
    each = _miles_a_test(rate)
    low, high = rate.interval95
    return RoadRate(
        miles=each / rate.crashes_per_test if rate.crashes_per_test > 0.0 else None,
        low=each / high,
        high=each / low if low > 0.0 else None,
        basis=_basis(rate),
        driven=rate.miles if rate.is_bound else None,
        doubts=rate.doubts if isinstance(rate, NaturalRate) else (),
    )


def _miles_a_test(rate: Rate) -> float:
    """Return the miles that the AV drives in a test."""
    if rate.crashes_per_mile:
        return rate.crashes_per_test / rate.crashes_per_mile
    if isinstance(rate, NaturalRate) and rate.interval95_per_mile is not None and rate.interval95_per_mile[1] > 0.0:
        return rate.interval95[1] / rate.interval95_per_mile[1]
    return rate.miles / rate.tests


def _basis(rate: Rate) -> str:
    """Say what a rate rests on."""
    tests = text.count(rate.tests)
    if not isinstance(rate, NaturalRate) or rate.method == "mc":
        return f"{text.count(rate.crashes_per_test * rate.tests)} crashes in n = {tests} simulated drives"
    if rate.is_bound:
        return f"0 crashes in n = {text.count(rate.plain_tests)} simulated drives"
    counts = text.count(rate.effective_sample_size)
    if rate.method == "is":
        return f"n = {tests} weighted drives, which tell as much as {counts} of equal weight"
    return f"n = {tests} drives that branch where danger rises, which tell as much as {counts} crashes"


def on_road(found: Natural, road: RoadRate) -> Natural:
    """Return the kinds of natural crashes with their miles as parts of the one rate."""
    if road.miles is None:
        return found
    scale = road.miles / found.all.miles_between

    def scaled(kind: NaturalKind) -> NaturalKind:
        low, high = kind.interval95_miles
        return replace(kind, miles_between=scale * kind.miles_between, interval95_miles=(scale * low, scale * high))

    def of(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: scaled(kind) for name, kind in value.items()}
        return scaled(value) if isinstance(value, NaturalKind) else value

    parts = replace(found, **{one.name: of(getattr(found, one.name)) for one in fields(found)})
    if road.high is None:
        return parts
    return replace(parts, all=replace(parts.all, interval95_miles=(road.low, road.high)))
