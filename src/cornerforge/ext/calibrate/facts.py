"""Published facts about motorway traffic, the range allowed for simulated traffic, and the values found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.free_running import PERIODS, WHOLE, FreeRunning, FreeTraffic, miles_of, upper_rate
from cornerforge.ext.calibrate.judging import judged, spread
from cornerforge.intervals import poisson_interval
from cornerforge.rates.people import MOTORWAY
from cornerforge.results.validation import FactFound
from cornerforge.sim import statistics

__all__ = ["CRASH_LIMIT", "CUT_IN_FACTS", "FACTS", "QUANTILES", "Fact", "compare_crashes", "compare_with_facts"]

CRASH_LIMIT = 3e-6
"""Limit of the upper bound of crashes between BVs per vehicle-mile."""
IVBSS = "IVBSS tables of Feng et al. 2023, doi:10.1038/s41586-023-05732-2"
OURS = "none published, the range is ours"
SPMD = "Safety Pilot Model Deployment (D. Zhao's group): 44,373 closing cut-ins at 25-35 m/s"

Counts: TypeAlias = statistics.Counts
Measure = Callable[[Counts], float | None]
Size = Callable[[Counts], int]
Histogram = Callable[[Counts], NDArray[np.int64]]


class Fact(NamedTuple):
    """A quantity of simulated traffic with its published value and, for a gate, the allowed range.

    Attributes:
        name, unit: As shown to people.
        published: The published value, or the range of several; None where none is published for this quantity.
        allowed: Ends of the allowed range, both allowed; None where the fact is shown and is no gate.
        measure: Computes the quantity.
        size: Computes the number of states or events behind it.
        source: Source of the published value.
        theme: The table that shows it.
    """

    name: str
    unit: str
    published: float | tuple[float, float] | None
    allowed: tuple[float, float] | None
    measure: Measure
    size: Size
    source: str = IVBSS
    theme: str = "drift"


def _total(which: int) -> Size:
    return lambda counts: int(counts.totals[which])


_STATES, _FOLLOWERS = _total(statistics.BV_STATES), _total(statistics.FOLLOWING_STATES)


def _ratio(above: Callable[[Counts], float], below: Callable[[Counts], float]) -> Measure:
    """Return a measure: a ratio; None over 0."""
    return lambda counts: above(counts) / total if (total := below(counts)) else None


def _row(name: str) -> int:
    return [grid.name for grid in statistics.TRAFFIC].index(name)


def _moment(grid: statistics.HistogramGrid, histogram: Histogram, key: str) -> Measure:
    """Return a measure: mean or sd of a histogram."""

    def measure(counts: Counts) -> float | None:
        found = statistics.histogram_summary(grid, histogram(counts))[key]
        return None if found is None else float(found)  # type: ignore[arg-type]

    return measure


def _traffic(name: str, key: str) -> Measure:
    row = _row(name)
    return _moment(statistics.TRAFFIC[row], lambda counts: counts.histograms[row], key)


def _near(value: float, tolerance: float) -> tuple[float, float]:
    return value * (1.0 - tolerance), value * (1.0 + tolerance)


def _within(value: float, factor: float) -> tuple[float, float]:
    return value / factor, value * factor


def _time_gap(percent: float, published: float, tolerance: float) -> Fact:
    row = _row("time_gap")

    def measure(counts: Counts) -> float | None:  # interpolated within its bin: intervals need it smooth
        return statistics.histogram_quantile(statistics.TRAFFIC[row], counts.histograms[row], percent)

    return Fact(f"time gap, {percent:g} %", "s", published, _near(published, tolerance), measure, _FOLLOWERS)


def _time_gap_share(below: float, published: float, allowed: tuple[float, float]) -> Fact:
    row = _row("time_gap")
    bins = round(below / statistics.TRAFFIC[row].width)
    measure = _ratio(lambda counts: int(counts.histograms[row, :bins].sum()), _FOLLOWERS)
    return Fact(
        f"share of following states with a time gap below {below:g} s", "", published, allowed, measure, _FOLLOWERS
    )


def _ttc_share(limit: float, published: float, factor: float | None) -> Fact:
    measure = _ratio(_total(statistics.TTC_BELOW + statistics.TTC_LIMITS.index(limit)), _FOLLOWERS)
    allowed = None if factor is None else _within(published, factor)
    return Fact(f"share of following states with TTC below {limit:g} s", "", published, allowed, measure, _FOLLOWERS)


def _accelerations(row: int, speed: int | None = None) -> Histogram:
    """Return a histogram: accelerations at all speeds, or at one [m/s]."""
    bins = statistics.JOINT[row].bins
    rows = slice(None) if speed is None else slice(speed, speed + 1)
    return lambda counts: np.asarray(counts.joint[row, rows, :bins].sum(axis=0))


def _free(speed: int, sd: float, hard: float) -> tuple[Fact, ...]:
    """Facts on free-flow accelerations at a speed: mean, sd, share at or below -1 m/s2 (bins of -4.0 ... -1.0)."""
    row = statistics.FREE_ACCELERATION
    at, found, grid = f"free-flow acceleration at {speed} m/s", _accelerations(row, speed), statistics.JOINT[row]

    def size(counts: Counts) -> int:
        return int(found(counts).sum())

    share = _ratio(lambda counts: int(found(counts)[:16].sum()), size)
    return (
        Fact(f"{at}, mean", "m/s2", (0.02, 0.05), None, _moment(grid, found, "mean"), size),
        Fact(f"{at}, sd", "m/s2", sd, None, _moment(grid, found, "sd"), size),
        Fact(f"{at}, share at or below -1", "", hard, None, share, size),
    )


def _acceleration_sd(name: str, row: int, size: Size) -> Fact:
    measure = _moment(statistics.JOINT[row], _accelerations(row), "sd")
    return Fact(f"acceleration {name}, sd", "m/s2", None, None, measure, size, OURS)


def _beside(counts: Counts) -> NDArray[np.int64]:
    return np.asarray(counts.histograms[statistics.SPEED_DIFFERENCE_BESIDE])


FACTS = (
    _time_gap(0.1, 0.365, 0.15),
    _time_gap(1.0, 0.455, 0.15),
    _time_gap(5.0, 0.55, 0.15),
    _time_gap(25.0, 0.80, 0.10),
    _time_gap(50.0, 1.14, 0.10),
    _time_gap(75.0, 1.78, 0.10),
    _time_gap(95.0, 2.90, 0.15),
    _time_gap_share(0.3, 1.8e-4, (0.0, 5e-4)),
    _time_gap_share(0.5, 0.020, _within(0.020, 1.5)),
    Fact("share of vehicles that follow", "", 0.682, (0.582, 0.782), _ratio(_FOLLOWERS, _STATES), _STATES),
    Fact("range rate, sd", "m/s", 1.3, (1.1, 1.5), _traffic("range_rate", "sd"), _FOLLOWERS),
    Fact("speed, mean", "m/s", 30.05, (29.05, 31.05), _traffic("speed", "mean"), _STATES),
    Fact("speed, sd", "m/s", 3.48, (3.48 * 0.8, 3.48 * 1.2), _traffic("speed", "sd"), _STATES),
    Fact(
        "speed difference beside each other, sd", "m/s", (2.15, 2.7), (2.0, 2.7),
        _moment(statistics.BESIDE[0], _beside, "sd"), lambda counts: int(_beside(counts).sum()),
        "NGSIM US-101 and another motorway",
    ),
    _ttc_share(5.0, 1.5e-4, 2.5),
    _ttc_share(10.0, 3.4e-3, 2.0),
    _ttc_share(15.0, 1.7e-2, 1.6),
    _ttc_share(20.0, 4.0e-2, 1.5),
    Fact("acceleration, sd", "m/s2", None, (0.35, 0.55), _traffic("acceleration", "sd"), _STATES, OURS),
    Fact(
        "lane changes", "per vehicle-mile", (0.20, 0.36), (0.2, 0.4),
        _ratio(_total(statistics.LANE_CHANGES), miles_of), _total(statistics.LANE_CHANGES),
        "Krajewski et al. 2018; Lee, Olsen, Wierwille 2004",
    ),
    _acceleration_sd("while following", statistics.FOLLOWING_ACCELERATION, _FOLLOWERS),
    _acceleration_sd(
        "in free flow", statistics.FREE_ACCELERATION,
        lambda counts: int(_accelerations(statistics.FREE_ACCELERATION)(counts).sum()),
    ),
    *_free(20, 0.61, 0.06),
    *_free(30, 0.38, 0.008),
    *_free(36, 0.32, 0.004),
    _ttc_share(3.0, 1.4e-5, None),
    _ttc_share(4.0, 6.1e-5, None),
)  # fmt: skip
"""Tolerances, and the range of the acceleration's sd over all states, are ours. A lane change holds the speed: it
counts as acceleration 0. A follower has a gap of at most 115.5 m."""

_BAND = 2
"""Band of `statistics.CUT_IN_BANDS`: 25 to 35 m/s, where the default environment drives."""
_PERCENTS = (1.0, 5.0, 25.0, 50.0, 75.0)
QUANTILES = {
    "gap": (10.75, 16.4, 31.39, 46.4, 60.99),
    "time_gap": (0.350, 0.529, 0.989, 1.448, 1.890),
    "ttc": (8.62, 14.63, 36.8, 72.7, 161.0),
    "closing_speed": (0.011, 0.049, 0.248, 0.560, 1.167),
}
"""Published quantiles of closing cut-ins at _PERCENTS [m, s, s, m/s]."""
_CUT_INS = {
    "gap": (0, "gap", "m"), "time_gap": (1, "follower's time gap", "s"), "ttc": (2, "TTC", "s"),
    "closing_speed": (3, "closing speed", "m/s"),
}  # fmt: skip
"""Quantity -> its row in the counts, words and unit."""
_SHARES = (
    ("gap below 10 m", "gap", 10.0, 0.00703),
    ("gap below 15 m", "gap", 15.0, 0.0369),
    ("time gap below 0.3 s", "time_gap", 0.3, 0.00437),
    ("time gap below 0.5 s", "time_gap", 0.5, 0.0416),
    ("TTC below 5 s", "ttc", 5.0, 0.00113),
    ("TTC below 10 s", "ttc", 10.0, 0.0172),
    ("closing speed above 3 m/s", "closing_speed", 3.0, 0.0577),
)
_JOINT_SHARES = (("gap below 10 m", 0, 10.0, 0.00070), ("time gap below 0.5 s", 1, 0.5, 0.00232))
_TTC = 10.0
_PER_MILE = 157_757 / 2e6


def _cut_ins(counts: Counts) -> int:
    return int(counts.cut_ins[_BAND, 0].sum())


def _all_cut_ins(counts: Counts) -> int:
    return int(counts.cut_ins[:, 0].sum())


def _cut_in_quantile(name: str, percent: float, published: float) -> Fact:
    row, words, unit = _CUT_INS[name]
    end = 100.0 - percent if name == "ttc" else percent  # of TTC from the other end, since 1/TTC is counted

    def measure(counts: Counts) -> float | None:
        found = statistics.histogram_quantile(statistics.CUT_INS[row], counts.cut_ins[_BAND, row], end)
        return found if name != "ttc" else 1.0 / found if found else None

    return Fact(f"{words}, {percent:g} %", unit, published, _near(published, 0.15), measure, _cut_ins, SPMD, "cut-ins")


def _cut_in_share(words: str, name: str, limit: float, published: float) -> Fact:
    """Make the fact on the share of cut-ins on the near side of a limit, which is an edge of the bins."""
    row = _CUT_INS[name][0]
    edge = round((1.0 / limit if name == "ttc" else limit) / statistics.CUT_INS[row].width)
    near = slice(edge, None) if name in ("ttc", "closing_speed") else slice(edge)
    measure = _ratio(lambda counts: int(counts.cut_ins[_BAND, row, near].sum()), _cut_ins)
    return Fact(f"share with {words}", "", published, _within(published, 1.5), measure, _cut_ins, SPMD, "cut-ins")


def _joint_share(words: str, row: int, below: float, published: float) -> Fact:
    """Make the fact on the share of cut-ins that are near and have a short TTC at the same time."""
    near, fast = (statistics.CUT_IN_PAIRS[which].width for which in (row, 2))
    edge, since = round(below / near), round(1.0 / _TTC / fast)
    measure = _ratio(lambda counts: int(counts.pairs[_BAND, row, :edge, since:].sum()), _cut_ins)
    name = f"share with {words} and TTC below {_TTC:g} s"
    return Fact(name, "", published, _within(published, 1.5), measure, _cut_ins, SPMD, "cut-ins")


def _correlation(counts: Counts) -> float | None:
    """Correlate 1/gap with 1/TTC, both in the middle of their bins; None where one does not vary."""
    table = counts.pairs[_BAND, 0]
    gap, fast = (grid.width * (np.arange(grid.bins) + 0.5) for grid in statistics.CUT_IN_PAIRS[::2])
    values, chance = (1.0 / gap, fast), table / max(int(table.sum()), 1)
    off = [value - value @ chance.sum(axis=1 - axis) for axis, value in enumerate(values)]
    spreads = [some**2 @ chance.sum(axis=1 - axis) for axis, some in enumerate(off)]
    return float(off[0] @ chance @ off[1] / np.sqrt(spreads[0] * spreads[1])) if min(spreads) > 0.0 else None


CUT_IN_FACTS = (
    *(
        _cut_in_quantile(name, percent, value)
        for name, values in QUANTILES.items()
        for percent, value in zip(_PERCENTS, values, strict=True)
    ),
    *(_cut_in_share(*share) for share in _SHARES),
    *(_joint_share(*share) for share in _JOINT_SHARES),
    Fact("correlation of 1/gap and 1/TTC", "", 0.14, (0.05, 0.25), _correlation, _cut_ins, SPMD, "cut-ins"),
    Fact(
        "closing cut-ins at 5-35 m/s", "per vehicle-mile", round(_PER_MILE, 3), _within(_PER_MILE, 1.5),
        _ratio(_all_cut_ins, miles_of), _all_cut_ins, "the same: 157,757 in over 2 million miles", "cut-ins",
    ),
)  # fmt: skip
"""At the moment when the centre of the vehicle that cuts in crosses the marking, with a faster vehicle at most 75 m
behind; both BVs. Tolerances are ours: quantiles 15 %, shares and rate a factor of 1.5."""


def compare_with_facts(part: FreeRunning, facts: tuple[Fact, ...] = FACTS) -> list[FactFound]:
    """Compare each fact with the counts of one window; intervals by jackknife over blocks."""
    total = part.total()
    reduced = [part.total(without) for without in range(len(part.blocks))]
    rows = []
    for fact in facts:
        found = fact.measure(total)
        interval = None if found is None else spread(found, [fact.measure(some) for some in reduced])
        rows.append(
            judged(
                found, fact.allowed, theme=fact.theme, when=part.window.name, fact=fact.name, unit=fact.unit,
                published=fact.published, source=fact.source, n=fact.size(total), interval95=interval,
            )
        )  # fmt: skip
    return rows


def compare_crashes(traffic: FreeTraffic) -> list[FactFound]:
    """Compare crashes between BVs per vehicle-mile with the limit, in the whole drive and period by period.

    The whole drive is judged by the exact upper 95 % bound; a period fails if its exact 95 % interval lies above the
    limit. A crash has two vehicles; it counts as one if its partner was not counted.
    """
    return [_crashes(traffic.during(window)) for window in (WHOLE, *PERIODS)]


def _crashes(part: FreeRunning) -> FactFound:
    total, is_whole = part.total(), part.window == WHOLE
    crashes, miles = (int(total.totals[statistics.CRASHED_BVS]) + 1) // 2, miles_of(total)
    low, high = (0.0, upper_rate(crashes, 1.0)) if is_whole else poisson_interval(crashes)
    row = judged(
        crashes / miles if miles else None, (0.0, CRASH_LIMIT), theme="crashes", when=part.window.name,
        fact="crashes between background vehicles", unit="per vehicle-mile", published=MOTORWAY.low,
        source=f"{MOTORWAY.covers}: {MOTORWAY.source}", n=crashes,
        interval95=(low / miles, high / miles) if miles else None,
    )  # fmt: skip
    within = miles > 0.0 and (high if is_whole else low) / miles <= CRASH_LIMIT
    return replace(row, within=within, crashes=crashes, miles=miles)
