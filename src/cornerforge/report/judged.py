"""Reading and checking what `analyse` says about single cases: value, avoidability, fault, severity, coverage."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError
from cornerforge.report.reader import Reader
from cornerforge.results.analysis import FAULTS, PARTS

__all__ = [
    "Avoided",
    "CaseJudgement",
    "Coverage",
    "Judged",
    "TopCase",
    "WayOut",
    "read_case_judgements",
    "read_judged",
    "read_table",
]


@dataclass(frozen=True)
class TopCase:
    """A case worth a look. `value` and `parts` (in the order of `PARTS`) lie in [0, 1]; `text` is one sentence."""

    case_id: str
    value: float
    parts: dict[str, float]
    crash_type: str
    fault: str
    text: str


@dataclass(frozen=True)
class Avoided:
    """How the AV could have avoided cases drawn at random.

    Attributes:
        cases: Number drawn, at least 1.
        reaction_s: A way out counts if it begins at least this long after the manoeuvre's begin [s].
        labels: Cases of each label; with `not_judged` they sum to `cases`.
        not_judged: Cases that cannot be judged.
        share, low, high: Share with a way out, in [0, 1], and its 95 % interval.
        median_s: Median time to react [s]; None where no case has one.
    """

    cases: int
    reaction_s: float
    labels: dict[str, int]
    not_judged: int
    share: float
    low: float
    high: float
    median_s: float | None

    @property
    def kinds(self) -> dict[str, int]:
        """All cases by label, those that cannot be judged as a kind of their own where there are any."""
        return self.labels | ({"cannot be judged": self.not_judged} if self.not_judged else {})


@dataclass(frozen=True)
class Coverage:
    """Which kinds of case were seen.

    Attributes:
        cases: Number of cases in the grid, at least 1.
        axes: Name of each of the two or three axes to its labels; the first is the crash type, the last the speed.
        counts: Cases in each cell, one axis each, int64.
        curve: Cases looked at, and kinds expected among them, shape (m, 2).
        unseen, low, high: Chance that the next case is of a kind not seen, in [0, 1], and its 95 % interval.
    """

    cases: int
    axes: dict[str, list[str]]
    counts: NDArray[np.int64]
    curve: NDArray[np.float64]
    unseen: float
    low: float
    high: float


@dataclass(frozen=True)
class Judged:
    """The judgement of a library.

    Attributes:
        fault: Number of cases by the vehicle that broke a rule of RSS.
        rules: Cases by the rule that was broken first.
        severity: Quantity to its quantiles, percent to value.
        avoided: Avoidability; None if ways out were not searched for.
        weights: Weights of the parts of the value.
        top: The most valuable cases, the best first; empty if ways out were not searched for.
        coverage: Kinds seen and not seen.
    """

    fault: dict[str, int]
    rules: dict[str, int]
    severity: dict[str, dict[str, float]]
    avoided: Avoided | None
    weights: dict[str, float]
    top: list[TopCase]
    coverage: Coverage

    @property
    def fault_in_words(self) -> dict[str, int]:
        """`fault` by names for people."""
        return {name: self.fault[who] for who, name in zip(FAULTS, ("AV", "BV", "both", "nobody"), strict=True)}


@dataclass(frozen=True)
class WayOut:
    """The AV on a way out, every 0.1 s, each of shape (W,): m, m, m/s, rad; `begin_s` before the contact [s]."""

    begin_s: float
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    speed: NDArray[np.float64]
    heading: NDArray[np.float64]


@dataclass(frozen=True)
class CaseJudgement:
    """The row of one case. Times are seconds before the contact; None where there is none or none was searched for."""

    fault: str
    rule: str
    fault_s: float | None
    avoidability: str | None
    manoeuvre_s: float | None
    latest_s: float | None
    way_out: WayOut | None


def read_judged(reader: Reader) -> Judged:
    """Read the keys of `analysis.json` about single cases.

    Raises:
        FileFormatError: A key is missing, as in an analysis by an earlier version, or holds something else.
    """
    # A missing key must not look like a library without a case of that fault.
    for key in ("fault", "fault_rules"):
        reader.child(key)
    fault = reader.counts("fault")
    unknown = sorted(set(fault) - set(FAULTS))
    if unknown:
        raise reader.fault("fault", f"holds {unknown[0]!r}, allowed: {', '.join(FAULTS)}")
    rules = reader.counts("fault_rules")
    if not sum(fault.values()) or sum(fault.values()) != sum(rules.values()):
        raise reader.fault("fault", f"holds {sum(fault.values())} cases, fault_rules {sum(rules.values())}")
    value, severity = reader.child("value"), reader.child("severity")
    weights = value.child("weights")
    if set(weights.values) != set(PARTS):
        raise value.fault("weights", f"are of {', '.join(weights.values)}, here: {', '.join(PARTS)}")
    return Judged(
        fault={who: fault.get(who, 0) for who in FAULTS},
        rules=rules,
        severity={name: _numbers(severity.child(name)) for name in severity.values},
        avoided=_avoided(reader),
        weights={part: weights.number(part) for part in PARTS},
        top=[_top(case) for case in value.children("top")],
        coverage=_coverage(reader.child("coverage")),
    )


def _numbers(reader: Reader) -> dict[str, float]:
    return {key: reader.number(key) for key in reader.values}


def _share(reader: Reader, key: str) -> float:
    value = reader.number(key)
    if not 0.0 <= value <= 1.0:
        raise reader.fault(key, f"= {value} is outside [0, 1]")
    return value


def _interval(reader: Reader, key: str, share: float) -> tuple[float, float]:
    low, high = reader.numbers(key, 2)
    if not 0.0 <= low <= share <= high <= 1.0:
        raise reader.fault(key, f"= [{low}, {high}] does not hold {share}, or leaves [0, 1]")
    return low, high


def _avoided(reader: Reader) -> Avoided | None:
    if "avoidability" in reader.values and reader.values["avoidability"] is None:
        return None
    child = reader.child("avoidability")
    cases, labels, rest = child.count("cases"), child.counts("labels"), child.count("not_judged")
    if cases == 0 or sum(labels.values()) + rest != cases:
        raise child.fault("labels", f"and not_judged sum to {sum(labels.values()) + rest}, cases = {cases}")
    share = _share(child, "avoidable_share")
    low, high = _interval(child, "interval95", share)
    median = child.number_or_none("median_time_to_react_s")
    return Avoided(cases, child.number("reaction_s"), labels, rest, share, low, high, median)


def _top(reader: Reader) -> TopCase:
    return TopCase(
        case_id=reader.text("case_id"),
        value=_share(reader, "value"),
        parts={part: _share(reader, part) for part in PARTS},
        crash_type=reader.text("crash_type"),
        fault=reader.text("fault"),
        text=reader.text("text"),
    )


def _coverage(reader: Reader) -> Coverage:
    children = reader.child("axes")
    axes = {name: children.texts(name) for name in children.values}
    if len(axes) not in (2, 3) or not all(axes.values()):
        raise reader.fault("axes", "are not two or three lists of labels")
    names = {" | ".join(labels): place for place, labels in enumerate(product(*axes.values()))}
    cells, cases = reader.counts("cells"), reader.count("cases")
    unknown = sorted(set(cells) - set(names))
    if unknown:
        raise reader.fault("cells", f"holds {unknown[0]!r}, which is no combination of the axes' labels")
    if cases == 0 or sum(cells.values()) != cases:
        raise reader.fault("cells", f"sum to {sum(cells.values())}, cases = {cases}")
    counts = np.zeros(len(names), np.int64)
    for name, n in cells.items():
        counts[names[name]] = n
    rows = reader.items("discovery_curve")
    if not rows or not all(isinstance(row, list) and len(row) == 2 for row in rows):
        raise reader.fault("discovery_curve", "is not a list of pairs")
    pairs = Reader(reader.file, {"discovery_curve": [v for row in rows for v in row]}, reader.command, reader.place)
    unseen = _share(reader, "unseen_kind_chance")
    low, high = _interval(reader, "unseen_kind_interval95", unseen)
    return Coverage(
        cases=cases,
        axes=axes,
        counts=counts.reshape([len(labels) for labels in axes.values()]),
        curve=np.array(pairs.numbers("discovery_curve")).reshape(-1, 2),
        unseen=unseen,
        low=low,
        high=high,
    )


def read_table(file: Path, names: list[str], command: str, case_ids: Iterable[str] | None = None) -> dict[str, Any]:
    """Columns of a Parquet file as lists, of some cases only if given.

    Args:
        file: The file.
        names: Of the columns.
        command: What writes the file again, for messages.
        case_ids: Cases to read; None for all.

    Raises:
        FileFormatError: The file is missing or damaged, or lacks a column.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq
    from pyarrow.fs import LocalFileSystem

    if not file.is_file():
        raise FileFormatError(f"{file} is missing; write it with: {command}")
    try:
        # The local file system is named, because Arrow reads a path like run-10:30 as an address, ~ as the home folder.
        place, local = str(file.absolute()), LocalFileSystem()
        missing = [name for name in names if name not in pq.read_schema(place, filesystem=local).names]
        if not missing:
            only = None if case_ids is None else [("case_id", "in", set(case_ids) | {""})]  # an empty set is refused
            table = pq.read_table(place, columns=names, filters=only, filesystem=local)
    except (pa.ArrowException, OSError) as error:
        raise FileFormatError(f"{file} is damaged ({error}); write it again with: {command}") from None
    if missing:
        raise FileFormatError(f"{file} lacks the column(s) {', '.join(missing)}; write it again with: {command}")
    return {name: table.column(name).to_pylist() for name in names}


_CASE = ["case_id", "fault", "fault_rule", "fault_s", "avoidability", "manoeuvre_begin_s", "latest_any_s"]
_WAY = ["witness_x_m", "witness_y_m", "witness_speed_mps", "witness_heading_rad"]


def read_case_judgements(analysis: Path, case_ids: Iterable[str], command: str) -> dict[str, CaseJudgement]:
    """Read the judgements of single cases by case id; cases that the analysis does not hold are left out.

    Args:
        analysis: Folder of the analysis.
        case_ids: Cases to read.
        command: What writes the analysis again, for messages.

    Raises:
        FileFormatError: `cases.parquet` or `witnesses.parquet` is missing or damaged.
    """
    ids = list(case_ids)
    known = read_table(analysis / "cases.parquet", _CASE, command, ids)
    ways = read_table(analysis / "witnesses.parquet", ["case_id", "latest_any_s", *_WAY], command, ids)
    way_out = {
        case_id: WayOut(begin_s, *(np.array(values, np.float64) for values in way))
        for case_id, begin_s, *way in zip(*ways.values(), strict=True)
        if begin_s is not None and way[0]
    }
    return {
        case_id: CaseJudgement(fault, rule, fault_s, label, manoeuvre_s, latest_s, way_out.get(case_id))
        for case_id, fault, rule, fault_s, label, manoeuvre_s, latest_s in zip(*known.values(), strict=True)
    }
