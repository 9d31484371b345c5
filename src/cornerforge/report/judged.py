"""Words, grids, judgements of single cases and verdicts on them, out of what `analyse` says, for the page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.avoidability import WayOut
from cornerforge.analysis.conduct import CONDUCTS, IN_SHORT, NO_CONDUCT
from cornerforge.analysis.prevented import NOT_JUDGED, PREVENTION
from cornerforge.results import Analysed
from cornerforge.results.analysis import FAULTS, Avoidability, Coverage, OwnDoing, Prevented

__all__ = [
    "BY_CAREFUL", "FAULT_WORDS", "JUDGED", "PREVENTION_WORDS", "CaseJudgement", "avoided_kinds",
    "conducts_in_words", "faults_in_words", "judgement_of", "kind_counts", "prevented_kinds", "read_case_judgements",
    "read_table", "verdict",
]  # fmt: skip


FAULT_WORDS = dict(zip(FAULTS, ("the AV", "the other", "both", "nobody"), strict=True))
"""Vehicle at fault, by names for people."""


@dataclass(frozen=True)
class CaseJudgement:
    """The row of one case. Times are seconds before the contact; None where there is none or none was searched for."""

    fault: str
    rule: str
    fault_s: float | None
    avoidability: str | None
    manoeuvre_s: float | None
    latest_s: float | None
    prevented_by: str | None
    prevention: str | None
    conduct: str
    conduct_s: float | None
    way_out: WayOut | None


def _kinds(found: Coverage) -> list[str]:
    return [" | ".join(labels) for labels in product(*found.axes.values())]


def kind_counts(found: Coverage) -> NDArray[np.int64]:
    """Cases of each kind, one axis each for `axes`: first the crash type, last the speed."""
    counts = np.array([found.cells.get(name, 0) for name in _kinds(found)], np.int64)
    return counts.reshape([len(labels) for labels in found.axes.values()])


def faults_in_words(found: Analysed) -> dict[str, int]:
    """Cases by vehicle at fault, zeros included, by names for people."""
    return {name: found.fault.get(who, 0) for who, name in FAULT_WORDS.items()}


def avoided_kinds(found: Avoidability) -> dict[str, int]:
    """All cases by label; cases that cannot be judged are a label of their own."""
    return found.labels | ({"cannot be judged": found.not_judged} if found.not_judged else {})


PREVENTION_WORDS = dict(zip(PREVENTION, (
    "a careful driver, by braking", "a careful driver, by not beginning it", "another speed, by chance",
    "models of a careful driver differ", "no careful driver", "not judged",
), strict=True))  # fmt: skip
"""What would have prevented a crash, in a few words."""


def conducts_in_words(found: OwnDoing, words: Mapping[str, str] = IN_SHORT) -> dict[str, int]:
    """Cases by what the AV did wrong, by names for people, most first."""
    return {words[name]: k for name, k in found.conducts.items()}


def prevented_kinds(found: Prevented) -> dict[str, int]:
    """Cases that a careful driver, and each reference driver, would have prevented, and of these by its braking."""
    kinds: dict[str, int] = {} if found.careful is None else {"a careful driver": found.careful.cases}
    for name, one in found.by.items():
        kinds |= {name: one.cases, f"{name}, by braking": one.by_braking}
    return kinds


def read_table(file: Path, names: list[str], command: str, case_ids: Iterable[str] | None = None) -> dict[str, Any]:
    """Columns of a Parquet file as lists, of some cases only if given.

    Args:
        file: The file.
        names: Names of the columns.
        command: What writes the file again, for messages.
        case_ids: Cases to read; None for all.

    Raises:
        FileFormatError: The file is missing or damaged, or lacks a column.
    """
    import pyarrow.compute as pc

    from cornerforge.analysis.stored import read_analysed  # loads Arrow

    table = read_analysed(file, command, names)
    if case_ids is not None:
        table = table.filter(pc.field("case_id").isin(list(case_ids)))
    return {name: table.column(name).to_pylist() for name in names}


JUDGED = (
    "fault", "fault_rule", "fault_s", "avoidability", "manoeuvre_begin_s", "latest_any_s", "prevented_by",
    "prevention", "conduct", "conduct_s",
)  # fmt: skip
"""Columns of `cases.parquet` that a `CaseJudgement` is made of, in the order of its fields."""
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
    known = read_table(analysis / "cases.parquet", ["case_id", *JUDGED], command, ids)
    ways = read_table(analysis / "witnesses.parquet", ["case_id", "latest_any_s", *_WAY], command, ids)
    way_out = {
        case_id: WayOut(begin_s, *(np.array(values, np.float64) for values in way))
        for case_id, begin_s, *way in zip(*ways.values(), strict=True)
        if begin_s is not None and way[0]
    }
    rows = (dict(zip(known, row, strict=True)) for row in zip(*known.values(), strict=True))
    return {row["case_id"]: judgement_of(row, way_out.get(row["case_id"])) for row in rows}


def judgement_of(row: Mapping[str, Any], way_out: WayOut | None) -> CaseJudgement:
    """Take what was judged of a case out of its row of `cases.parquet`.

    Args:
        row: The columns `JUDGED`, None for null.
        way_out: From `witnesses.parquet`.
    """
    said: dict[str, Any] = {one.name: row[name] for one, name in zip(fields(CaseJudgement), JUDGED, strict=False)}
    return CaseJudgement(**said, way_out=way_out)


def verdict(known: CaseJudgement) -> str:
    """Say which vehicle was at fault in a case, and whether the AV could have avoided it."""
    if known.fault == "none":
        fault = "No rule of RSS was broken"
    else:
        who = {"av": "The AV", "bv": "The BV"}.get(known.fault, "Both")
        when = "" if known.fault_s is None else f", {known.fault_s:.1f} s before contact"
        fault = f"{who} broke a rule of RSS ({known.rule}{when})"
    fault += f".{_conduct_in_words(known)}{_prevented_in_words(known)}"
    if known.avoidability is None:
        return fault
    begun = "" if known.manoeuvre_s is None else f" The manoeuvre began {known.manoeuvre_s:.1f} s before contact."
    return f"{fault}{begun} {_way_in_words(known)}"


def _conduct_in_words(known: CaseJudgement) -> str:
    """Say what the AV did wrong in a case; "" where it did nothing wrong."""
    if known.conduct == NO_CONDUCT:
        return ""
    return f" The AV's own doing, from {known.conduct_s:.1f} s before contact: {CONDUCTS[known.conduct]}."


BY_CAREFUL = {
    PREVENTION[0]: "A careful driver would have prevented it by braking.",
    PREVENTION[1]: "A careful driver would have left out what the AV began.",
}
"""What a careful driver would have done, by `PREVENTION`."""
_NOBODY = "No careful driver would have prevented it."


def _prevented_in_words(known: CaseJudgement) -> str:
    """Say whether a careful driver would have prevented a case; "" where it was not judged."""
    models = "" if known.prevented_by == "nobody" else f", as {known.prevented_by} would"
    return {
        PREVENTION[0]: f" {BY_CAREFUL[PREVENTION[0]].removesuffix('.')}{models}.",
        PREVENTION[1]: f" {BY_CAREFUL[PREVENTION[1]]}",
        PREVENTION[2]: " The speed that it then had would have been enough, but no care would have told so.",
        PREVENTION[3]: f" Models of a careful driver differ: only {known.prevented_by} would have prevented it by "
        "braking.",
        PREVENTION[4]: (
            " No careful driver would have prevented it."
            if known.conduct == NO_CONDUCT
            else " To leave that out would not have prevented the crash."
        ),
    }.get(known.prevention or NOT_JUDGED, "")


_HOW = {"by both": "by braking or by steering", "by combination": "by braking and steering together"}


def _way_in_words(known: CaseJudgement) -> str:
    """Say until when the AV could have avoided a case that was searched for a way out."""
    last = "" if known.latest_s is None else f"{known.latest_s:.1f} s before contact"
    if known.avoidability == "undecided":
        return "In hindsight, no way out of the AV was found, but not all could be tried."
    if known.avoidability == "unavoidable":
        if known.latest_s is None:
            return "In hindsight unavoidable: the AV had no way out in the time looked at."
        foreseen = known.manoeuvre_s is not None and known.latest_s > known.manoeuvre_s
        when = "before the manoeuvre, so that it had to foresee it" if foreseen else "within its reaction time"
        return f"In hindsight unavoidable: the AV's last way out began {last}, {when}."
    how = _HOW.get(str(known.avoidability), known.avoidability)
    ends = f"; its last way out began {last}." if last else "."
    return f"In hindsight, the AV could have avoided it {how}{ends}"
