"""Published rates of human crashes: the table `benchmarks.csv`, and choosing from it.

Each row says where its number was read. `checked` is "yes" only where the publication's own text was read (most often
its abstract), and "no" where only somebody's account of it was. Rates are per million vehicle-miles. What cornerforge
itself estimates (`rates.people`) is a row too. Shares that police never hear of, the share of serious injuries that are
MAIS 3 or more, and vehicles per crash stand in the same table under units of their own.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

from cornerforge.errors import InputError
from cornerforge.intervals import poisson_interval
from cornerforge.rates.people import MOTORWAY

__all__ = [
    "CLAIMS", "CRASHED", "CRASHES", "PERSONS", "RATES", "Benchmark", "as_crashed_vehicles", "benchmarks", "matching",
    "unreported",
]  # fmt: skip

CRASHES, CRASHED, CLAIMS, PERSONS = RATES = ("crashes", "crashed vehicles", "claims", "persons hurt")
"""Units of rates: a crash of two vehicles is one crash and two crashed vehicles; a claim is of one who is liable;
persons are those with the outcome, dead ones included, wherever they were."""
_PER_CRASH, _SHARE = "vehicles per crash", "share not reported"
UNITS = (*RATES, _PER_CRASH, _SHARE, "share MAIS 3 or more")


@dataclass(frozen=True)
class Benchmark:
    """A row of the table.

    Attributes:
        id: Name of the row.
        road: freeway, surface (all others) or all.
        place, year: Where and when people drove.
        outcome: Least that must have happened: police-reported, any damage or injury, any injury, airbag, serious
            injury (suspected serious or fatal, of anybody in the crash; in Germany 24 h in hospital), MAIS 3 or more,
            fatal; of claims: property damage, any injury.
        crash_type: Kind of crash, or all.
        rate: Per million vehicle-miles; of other units what the unit says.
        low, high: 95 % interval as published, None: none is.
        count, miles: Events, and million vehicle-miles, as published; None: not.
        unit: One of `UNITS`.
        corrected: "yes", "no" or "not said": was it raised by what police never hear of?
        source, doi, where: The publication, and where in it the number stands.
        checked: Was the number read in the publication's own text?
        read_in: Where it was read.
    """

    id: str
    road: str
    place: str
    year: str
    outcome: str
    crash_type: str
    rate: float
    low: float | None
    high: float | None
    count: int | None
    miles: float | None
    unit: str
    corrected: str
    source: str
    doi: str
    where: str
    checked: bool
    read_in: str

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % interval of the rate, as published or from the published count; None: neither, so it is taken as exact.

        Chance only: how well miles are known, and how rates differ between places and years, is in no interval.
        """
        if self.low is not None and self.high is not None:
            return self.low, self.high
        if self.count is None or self.miles is None:
            return None
        low, high = poisson_interval(self.count)
        return low / self.miles, high / self.miles


@cache
def benchmarks() -> tuple[Benchmark, ...]:
    """Read all rows, the one of our own last."""
    with Path(__file__).with_name("benchmarks.csv").open(encoding="utf-8", newline="") as file:
        rows = [_row(line) for line in csv.DictReader(file)]
    ours = replace(
        next(row for row in rows if row.unit == CRASHES),
        id="cornerforge-motorway", road="freeway", place="not said", year="not said", rate=1e6 * MOTORWAY.low,
        count=None, miles=None, crash_type="same direction", source=MOTORWAY.source, doi="",
        where="rates/people.py, known to a factor of 3", read_in="docs/adr/0034-the-models-own-uncertainty.md",
    )  # fmt: skip
    return (*rows, ours)


def _row(line: dict[str, str]) -> Benchmark:
    numbers = {name: float(line[name]) if line[name] else None for name in ("rate", "low", "high", "count", "miles")}
    count = None if numbers["count"] is None else int(numbers["count"])
    values = {**line, **numbers, "count": count, "checked": line["checked"] == "yes"}
    return Benchmark(**{field.name: values[field.name] for field in fields(Benchmark)})  # type: ignore[arg-type]


def matching(
    road: str, outcome: str, *, unit: str = CRASHED, place: str | None = None, crash_type: str = "all"
) -> tuple[Benchmark, ...]:
    """Choose the rates to compare with: those of this road, outcome, unit and kind of crash, the best first.

    Rows of all roads are no match for one kind of road. Best is what was checked, then what has an interval, then what
    was corrected for crashes that police never hear of.

    Args:
        road, outcome, unit, crash_type: As in `Benchmark`.
        place: Part of the row's place; None: any.

    Raises:
        InputError: No row matches; the text says what there is.

    >>> [row.rate for row in matching("freeway", "any injury")]
    [2.4, 0.7]
    """
    rated = [row for row in benchmarks() if row.unit in RATES]
    found = [
        row
        for row in rated
        if (row.road, row.outcome, row.unit, row.crash_type) == (road, outcome, unit, crash_type)
        and (place is None or place.lower() in row.place.lower())
    ]
    if not found:
        there = sorted({f"{row.outcome} ({row.unit})" for row in rated if row.road == road})
        where = "" if place is None else f" in {place}"
        raise InputError(
            f"No published rate of {unit} matches: {outcome}, {crash_type} kinds of crash, {road} roads{where}. "
            + (f"Of {road} roads there are: {', '.join(there)}." if there else "Roads are freeway, surface or all.")
        )
    return tuple(sorted(found, key=lambda r: (not r.checked, r.interval is None, r.corrected != "yes", r.id)))


def as_crashed_vehicles(row: Benchmark, per_crash: float | None = None) -> Benchmark:
    """Turn a rate of crashes into one of crashed vehicles, as an AV's rate is; a rate of crashed vehicles stays.

    Args:
        row: The rate.
        per_crash: Vehicles in a crash, at least 1; None: the mean of all police-reported crashes in the US.

    Raises:
        InputError: The rate is one of claims, or `per_crash` is below 1.
    """
    if row.unit == CRASHED:
        return row
    if row.unit != CRASHES:
        raise InputError(f"{row.id} counts {row.unit}: {CRASHED} cannot be had from it; choose another benchmark.")
    mean = next(one.rate for one in benchmarks() if one.unit == _PER_CRASH and one.outcome == "police-reported")
    factor = mean if per_crash is None else per_crash
    if not factor >= 1.0:
        raise InputError(f"per_crash = {factor:g}; a crash has at least 1 vehicle.")
    low, high = (None, None) if row.interval is None else (factor * end for end in row.interval)
    return replace(
        row, rate=factor * row.rate, low=low, high=high, unit=CRASHED, count=None, miles=None,
        where=f"{row.where}; times {factor:g} vehicles per crash",
    )  # fmt: skip


def unreported(outcome: str) -> float:
    """Give the share of crashed vehicles (or of injuries: "MAIS 1" and so on) that police never hear of.

    A rate of what is reported, divided by 1 minus it, is the rate of all.

    Raises:
        InputError: The share of this outcome is not known.

    >>> round(1.91 / (1.0 - unreported("any injury")), 2)  # Kusano et al. 2024 say 2.80
    2.8
    """
    known = {row.outcome: row.rate for row in benchmarks() if row.unit == _SHARE}
    if outcome not in known:
        raise InputError(f"How many crashes of outcome {outcome!r} are not reported is not known; known: {list(known)}")
    return known[outcome]
