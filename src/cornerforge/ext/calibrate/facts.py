"""Published facts about motorway traffic, the range allowed for simulated traffic, and the values found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.free_running import (
    PERIODS,
    WHOLE,
    FreeRunning,
    FreeTraffic,
    lower_rate,
    miles_of,
    upper_rate,
)
from cornerforge.ext.calibrate.judging import judged, spread
from cornerforge.sim import statistics

__all__ = ["CRASH_LIMIT", "FACTS", "Fact", "compare_crashes", "compare_with_facts"]

CRASH_LIMIT = 3e-6
"""Limit of the upper bound of crashes between BVs per vehicle-mile; the human rate is 2e-6."""
HUMAN_CRASHES = 1.9e-6
IVBSS = "IVBSS tables of Feng et al. 2023, doi:10.1038/s41586-023-05732-2"

Measure = Callable[[statistics.Counts], float | None]


class Fact(NamedTuple):
    """A quantity of simulated traffic with its published value and, for a gate, the range allowed: `low` to `high`.

    Attributes:
        name, unit: As shown to people.
        published: The published value, or the range of several; None where none is published for this quantity.
        low, high: Ends of the allowed range, both allowed; None where the fact is shown and is no gate.
        measure: Computes the quantity.
        size: Computes the number of states or events behind it.
        source: Source of the published value.
        theme: The table that shows it.
    """

    name: str
    unit: str
    published: float | tuple[float, float] | None
    low: float | None
    high: float | None
    measure: Measure
    size: Callable[[statistics.Counts], int]
    source: str = IVBSS
    theme: str = "drift"


def _total(which: int) -> Callable[[statistics.Counts], int]:
    return lambda counts: int(counts.totals[which])


_STATES, _FOLLOWERS = _total(statistics.BV_STATES), _total(statistics.FOLLOWING_STATES)


def _row(name: str) -> int:
    return [grid.name for grid in statistics.TRAFFIC].index(name)


def _moment(name: str, key: str) -> Measure:
    """Return a measure: mean or sd of a quantity of TRAFFIC."""

    def measure(counts: statistics.Counts) -> float | None:
        row = _row(name)
        found: Any = statistics.histogram_summary(statistics.TRAFFIC[row], counts.histograms[row])[key]
        return None if found is None else float(found)

    return measure


def _quantile(name: str, percent: float) -> Measure:
    """Return a measure: a quantile of a quantity of TRAFFIC, interpolated within its bin (intervals need it smooth)."""

    def measure(counts: statistics.Counts) -> float | None:
        row = _row(name)
        return statistics.histogram_quantile(statistics.TRAFFIC[row], counts.histograms[row], percent)

    return measure


def _ratio(above: int, below: int) -> Measure:
    def measure(counts: statistics.Counts) -> float | None:
        total = int(counts.totals[below])
        return int(counts.totals[above]) / total if total else None

    return measure


def _lane_changes(counts: statistics.Counts) -> float | None:
    miles = miles_of(counts)
    return int(counts.totals[statistics.LANE_CHANGES]) / miles if miles else None


def _accelerations(row: int, speed: int | None = None) -> Callable[[statistics.Counts], NDArray[np.int64]]:
    grid = statistics.JOINT[row]

    def rows(counts: statistics.Counts) -> NDArray[np.int64]:
        by_speed = counts.joint[row, :, : grid.bins]
        return np.asarray(by_speed.sum(axis=0) if speed is None else by_speed[speed])

    return rows


def _acceleration(row: int, what: str, speed: int | None = None) -> Measure:
    """Return a measure: mean or sd of an acceleration, or its share at or below -1 m/s2; at all speeds or one [m/s]."""
    rows = _accelerations(row, speed)

    def measure(counts: statistics.Counts) -> float | None:
        found = rows(counts)
        if found.sum() == 0:
            return None
        summary = statistics.histogram_summary(statistics.JOINT[row], found)
        if what in ("mean", "sd"):
            return float(summary[what])  # type: ignore[arg-type]
        return float(found[:16].sum() / found.sum())  # bins of -4.0 ... -1.0

    return measure


def _time_gap(percent: float, published: float, tolerance: float) -> Fact:
    low, high = published * (1.0 - tolerance), published * (1.0 + tolerance)
    return Fact(f"time gap, {percent:g} %", "s", published, low, high, _quantile("time_gap", percent), _FOLLOWERS)


def _time_gap_share(below: float, published: float, low: float, high: float) -> Fact:
    row = _row("time_gap")
    bins = round(below / statistics.TRAFFIC[row].width)

    def measure(counts: statistics.Counts) -> float | None:
        states = _FOLLOWERS(counts)
        return int(counts.histograms[row, :bins].sum()) / states if states else None

    return Fact(
        f"share of following states with a time gap below {below:g} s", "", published, low, high, measure, _FOLLOWERS
    )


def _ttc_share(limit: float, published: float, factor: float | None) -> Fact:
    measure = _ratio(statistics.TTC_BELOW + statistics.TTC_LIMITS.index(limit), statistics.FOLLOWING_STATES)
    low, high = (None, None) if factor is None else (published / factor, published * factor)
    name = f"share of following states with TTC below {limit:g} s"
    return Fact(name, "", published, low, high, measure, _FOLLOWERS)


def _free(speed: int, sd: float, hard: float) -> tuple[Fact, ...]:
    row = statistics.FREE_ACCELERATION
    at = f"free-flow acceleration at {speed} m/s"

    def size(counts: statistics.Counts) -> int:
        return int(_accelerations(row, speed)(counts).sum())

    return (
        Fact(f"{at}, mean", "m/s2", (0.02, 0.05), None, None, _acceleration(row, "mean", speed), size),
        Fact(f"{at}, sd", "m/s2", sd, None, None, _acceleration(row, "sd", speed), size),
        Fact(f"{at}, share at or below -1", "", hard, None, None, _acceleration(row, "hard", speed), size),
    )


def _beside(counts: statistics.Counts) -> NDArray[np.int64]:
    return np.asarray(counts.histograms[statistics.SPEED_DIFFERENCE_BESIDE])


def _beside_sd(counts: statistics.Counts) -> float | None:
    found: Any = statistics.histogram_summary(statistics.BESIDE[0], _beside(counts))["sd"]
    return None if found is None else float(found)


OURS = "none published, the range is ours"
FACTS = (
    _time_gap(0.1, 0.365, 0.15),
    _time_gap(1.0, 0.455, 0.15),
    _time_gap(5.0, 0.55, 0.15),
    _time_gap(25.0, 0.80, 0.10),
    _time_gap(50.0, 1.14, 0.10),
    _time_gap(75.0, 1.78, 0.10),
    _time_gap(95.0, 2.90, 0.15),
    _time_gap_share(0.3, 1.8e-4, 0.0, 5e-4),
    _time_gap_share(0.5, 0.020, 0.020 / 1.5, 0.020 * 1.5),
    Fact(
        "share of vehicles that follow", "", 0.682, 0.582, 0.782,
        _ratio(statistics.FOLLOWING_STATES, statistics.BV_STATES), _STATES,
    ),
    Fact("range rate, sd", "m/s", 1.3, 1.1, 1.5, _moment("range_rate", "sd"), _FOLLOWERS),
    Fact("speed, mean", "m/s", 30.05, 29.05, 31.05, _moment("speed", "mean"), _STATES),
    Fact("speed, sd", "m/s", 3.48, 3.48 * 0.8, 3.48 * 1.2, _moment("speed", "sd"), _STATES),
    Fact(
        "speed difference beside each other, sd", "m/s", (2.15, 2.7), 2.0, 2.7, _beside_sd,
        lambda counts: int(_beside(counts).sum()), "NGSIM US-101 and another motorway",
    ),
    _ttc_share(5.0, 1.5e-4, 2.5),
    _ttc_share(10.0, 3.4e-3, 2.0),
    _ttc_share(15.0, 1.7e-2, 1.6),
    _ttc_share(20.0, 4.0e-2, 1.5),
    Fact("acceleration, sd", "m/s2", None, 0.35, 0.55, _moment("acceleration", "sd"), _STATES, OURS),
    Fact(
        "lane changes", "per vehicle-mile", (0.20, 0.36), 0.2, 0.4, _lane_changes, _total(statistics.LANE_CHANGES),
        "Krajewski et al. 2018; Lee, Olsen, Wierwille 2004",
    ),
    Fact(
        "acceleration while following, sd", "m/s2", None, None, None,
        _acceleration(statistics.FOLLOWING_ACCELERATION, "sd"), _FOLLOWERS, OURS,
    ),
    Fact(
        "acceleration in free flow, sd", "m/s2", None, None, None,
        _acceleration(statistics.FREE_ACCELERATION, "sd"),
        lambda counts: int(_accelerations(statistics.FREE_ACCELERATION)(counts).sum()), OURS,
    ),
    *_free(20, 0.61, 0.06),
    *_free(30, 0.38, 0.008),
    *_free(36, 0.32, 0.004),
    _ttc_share(3.0, 1.4e-5, None),
    _ttc_share(4.0, 6.1e-5, None),
)  # fmt: skip
"""Tolerances, and the range of the acceleration's sd over all states, are ours. A lane change holds the speed: it
counts as acceleration 0. A follower has a gap of at most 115.5 m."""


def compare_with_facts(part: FreeRunning, facts: tuple[Fact, ...] = FACTS) -> list[dict[str, Any]]:
    """Compare each fact with the counts of one window; rows of `judging.judged`, intervals by jackknife over blocks."""
    total = part.total()
    reduced = [part.total(without) for without in range(len(part.blocks))]
    rows = []
    for fact in facts:
        found = fact.measure(total)
        allowed = None if fact.low is None or fact.high is None else (fact.low, fact.high)
        rows.append(
            judged(
                fact.theme,
                part.window.name,
                fact.name,
                fact.unit,
                fact.published,
                fact.source,
                found,
                fact.size(total),
                None if found is None else spread(found, [fact.measure(some) for some in reduced]),
                allowed,
            )
        )
    return rows


def compare_crashes(traffic: FreeTraffic) -> list[dict[str, Any]]:
    """Compare crashes between BVs per vehicle-mile with the limit, in the whole drive and period by period.

    The whole drive is judged by the exact upper 95 % bound; a period fails if its exact 95 % interval lies above the
    limit. A crash has two vehicles; it counts as one if its partner was not counted.
    """
    return [_crashes(traffic.during(window)) for window in (WHOLE, *PERIODS)]


def _crashes(part: FreeRunning) -> dict[str, Any]:
    total = part.total()
    crashes = (int(total.totals[statistics.CRASHED_BVS]) + 1) // 2
    miles = miles_of(total)
    interval = None
    if miles and part.window == WHOLE:
        interval = [0.0, upper_rate(crashes, miles)]
    elif miles:
        interval = [lower_rate(crashes, miles, 0.975), upper_rate(crashes, miles, 0.975)]
    row = judged(
        "crashes", part.window.name, "crashes between background vehicles", "per vehicle-mile", HUMAN_CRASHES,
        "police-reported, US: NHTSA 2023", crashes / miles if miles else None, crashes, interval, (0.0, CRASH_LIMIT),
    )  # fmt: skip
    judged_by = None if interval is None else interval[1 if part.window == WHOLE else 0]
    return row | {"within": judged_by is not None and judged_by <= CRASH_LIMIT, "crashes": crashes, "miles": miles}
