"""Published facts about motorway traffic, the range allowed for simulated traffic, and the values found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.pipeline.free_running import FreeRunning, miles_of, upper_rate
from cornerforge.sim import statistics

__all__ = ["CRASH_LIMIT", "FACTS", "Fact", "compare_with_facts"]

CRASH_LIMIT = 2e-5
"""Limit of the upper bound of crashes between BVs per vehicle-mile; the human rate is 2e-6."""
HUMAN_CRASHES = 1.9e-6
_T_95 = 2.093
"""97.5 % point of Student's t with 19 degrees of freedom, for 20 blocks."""

Measure = Callable[[statistics.Counts], float | None]


class Fact(NamedTuple):
    """A quantity of simulated traffic with its published value and, for a gate, the range allowed: `low` to `high`.

    Attributes:
        name, unit: As shown to people.
        published: The published value, or the range of several; None where none is published for this quantity.
        low, high: Ends of the allowed range, both allowed; None where the fact is shown and is no gate.
        measure: Computes the quantity.
    """

    name: str
    unit: str
    published: float | tuple[float, float] | None
    low: float | None
    high: float | None
    measure: Measure


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
    return Fact(f"time gap, {percent:g} %", "s", published, low, high, _quantile("time_gap", percent))


def _ttc_share(limit: float, published: float, *, gate: bool) -> Fact:
    measure = _ratio(statistics.TTC_BELOW + statistics.TTC_LIMITS.index(limit), statistics.FOLLOWING_STATES)
    low, high = (published / 2.5, published * 2.5) if gate else (None, None)
    return Fact(f"share of following states with TTC below {limit:g} s", "", published, low, high, measure)


def _free(speed: int, sd: float, hard: float) -> tuple[Fact, ...]:
    row = statistics.FREE_ACCELERATION
    at = f"free-flow acceleration at {speed} m/s"
    return (
        Fact(f"{at}, mean", "m/s2", (0.02, 0.05), None, None, _acceleration(row, "mean", speed)),
        Fact(f"{at}, sd", "m/s2", sd, None, None, _acceleration(row, "sd", speed)),
        Fact(f"{at}, share at or below -1", "", hard, None, None, _acceleration(row, "hard", speed)),
    )


FACTS = (
    _time_gap(5.0, 0.55, 0.15),
    _time_gap(25.0, 0.80, 0.10),
    _time_gap(50.0, 1.14, 0.10),
    _time_gap(75.0, 1.78, 0.10),
    _time_gap(95.0, 2.90, 0.15),
    Fact("speed, mean", "m/s", 30.05, 29.05, 31.05, _moment("speed", "mean")),
    Fact("speed, sd", "m/s", 3.48, 3.48 * 0.8, 3.48 * 1.2, _moment("speed", "sd")),
    Fact(
        "share of vehicles that follow", "", 0.682, 0.582, 0.782,
        _ratio(statistics.FOLLOWING_STATES, statistics.BV_STATES),
    ),
    Fact("range rate, sd", "m/s", 1.3, 1.1, 1.5, _moment("range_rate", "sd")),
    Fact("acceleration, sd", "m/s2", None, 0.35, 0.55, _moment("acceleration", "sd")),
    _ttc_share(5.0, 1.5e-4, gate=True),
    _ttc_share(10.0, 3.4e-3, gate=True),
    Fact("lane changes", "per vehicle-mile", (0.20, 0.36), 0.2, 0.4, _lane_changes),
    Fact(
        "acceleration while following, sd", "m/s2", None, None, None,
        _acceleration(statistics.FOLLOWING_ACCELERATION, "sd"),
    ),
    Fact("acceleration in free flow, sd", "m/s2", None, None, None, _acceleration(statistics.FREE_ACCELERATION, "sd")),
    *_free(20, 0.61, 0.06),
    *_free(30, 0.38, 0.008),
    *_free(36, 0.32, 0.004),
    _ttc_share(3.0, 1.4e-5, gate=False),
    _ttc_share(4.0, 6.1e-5, gate=False),
    _ttc_share(15.0, 1.7e-2, gate=False),
    _ttc_share(20.0, 4.0e-2, gate=False),
)  # fmt: skip
"""Computed from the published IVBSS tables (Feng et al. 2023, doi:10.1038/s41586-023-05732-2); lane changes: highD
(0.20; Krajewski et al. 2018) and a NHTSA naturalistic study (0.36; Lee, Olsen, Wierwille 2004). Tolerances, and the
range of the acceleration's sd over all states, are ours. A lane change holds the speed: it counts as acceleration 0."""


def compare_with_facts(part: FreeRunning) -> list[dict[str, Any]]:
    """Compare each of `FACTS`, and crashes between BVs, with the counts of one window.

    Returns:
        Objects with `when`, `fact`, `unit`, `published`, `found`, `interval95` (by jackknife over 20 blocks of worlds;
        of crashes: 0 and the exact upper 95 % bound), `allowed` [low, high] and `within` (both null where the fact is
        only shown). `within` is false for a quantity that was not seen (`found` is null).
    """
    total = part.total()
    reduced = [part.total(without) for without in range(len(part.blocks))]
    rows = []
    for fact in FACTS:
        found = fact.measure(total)
        within = None
        if fact.low is not None and fact.high is not None:
            within = found is not None and fact.low <= found <= fact.high
        rows.append(
            {
                "when": part.window.name,
                "fact": fact.name,
                "unit": fact.unit,
                "published": fact.published,
                "found": found,
                "interval95": None if found is None else _jackknife(found, [fact.measure(some) for some in reduced]),
                "allowed": None if fact.low is None or fact.high is None else [round(fact.low, 9), round(fact.high, 9)],
                "within": within,
            }
        )
    return [*rows, _crashes(part, total)]


def _jackknife(found: float, without_one: list[float | None]) -> list[float] | None:
    """Return the 95 % interval from values that each leave out one block; None if one of them is None."""
    values = np.array([np.nan if value is None else value for value in without_one])
    if not np.isfinite(values).all():
        return None
    n = values.size
    error = float(np.sqrt((n - 1) / n * ((values - values.mean()) ** 2).sum()))
    return [found - _T_95 * error, found + _T_95 * error]


def _crashes(part: FreeRunning, total: statistics.Counts) -> dict[str, Any]:
    """Compare crashes per vehicle-mile. A crash has two vehicles; it counts as one if its partner was not counted."""
    crashes = (int(total.totals[statistics.CRASHED_BVS]) + 1) // 2
    miles = miles_of(total)
    bound = upper_rate(crashes, miles) if miles else None
    return {
        "when": part.window.name,
        "fact": "crashes between background vehicles",
        "unit": "per vehicle-mile",
        "published": HUMAN_CRASHES,
        "found": crashes / miles if miles else None,
        "interval95": None if bound is None else [0.0, bound],
        "allowed": [0.0, CRASH_LIMIT],
        "within": bound is not None and bound <= CRASH_LIMIT,
        "crashes": crashes,
        "miles": miles,
    }
