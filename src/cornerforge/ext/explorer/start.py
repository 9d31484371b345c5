"""Cards to look at first: each is a case with one plain sentence on why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge.analysis.first_case import what_to_see_first
from cornerforge.analysis.flaw import FLAWS, headline
from cornerforge.analysis.prevented import CAREFULLY, NOT_JUDGED
from cornerforge.ext.explorer.columns import CaseTable
from cornerforge.ext.explorer.sources import Analysis, Source
from cornerforge.ext.explorer.words import KINDS, VALUES
from cornerforge.intervals import weighted_interval
from cornerforge.report import text
from cornerforge.report.judged import BY_CAREFUL
from cornerforge.results.analysis import FlawShown

__all__ = ["cards", "headline_of", "miles_of"]

_BILLION = 1e9
_KMH = 3.6


def headline_of(sources: Sequence[tuple[Source, Analysis | None]]) -> str:
    """Say in a sentence or two what the AV does wrong; "" while no analysis says it."""
    told = {source.natural: a.found.own_doing for source, a in sources if a is not None and a.found.own_doing}
    return headline(told.get(True), told.get(False)) if told else ""


def miles_of(per_billion: NDArray[np.float64], largest: float) -> str:
    """Say how often some natural crashes happen, from what each stands for.

    Args:
        per_billion: Crashes per billion miles that each stands for, at least one, above 0.
        largest: The largest that any crash of the library stands for.

    >>> miles_of(np.array([50.0, 75.0]), 75.0)
    'once in 8.0 million miles (95 %: 2.1 million to 70 million)'
    """
    low, high = weighted_interval(per_billion, largest)
    return _once_in(*(_BILLION / rate if rate > 0.0 else None for rate in (float(per_billion.sum()), high, low)))


def _once_in(between: float | None, low: float | None, high: float | None) -> str:
    """Say how many miles lie between two crashes, with the ends of the interval; None for a missing end."""
    said, *ends = ["no upper end" if miles is None else text.miles(miles) for miles in (between, low, high)]
    return f"once in {said} (95 %: {ends[0].removesuffix(' miles')} to {ends[1].removesuffix(' miles')})"


def cards(sources: Sequence[tuple[Source, Analysis | None]], table: CaseTable) -> list[dict[str, Any]]:
    """Make the cards, in the order in which they matter; none while there is no analysis."""
    judged = [(source, found) for source, found in sources if found is not None]
    natural = next(((source, found) for source, found in judged if source.natural), None)
    made: list[dict[str, Any] | None] = []
    if natural is not None:
        made.append(_most_frequent(_Cases(table, natural[0])))
    made.append(_own_doing(judged, table))
    if natural is not None:
        made.append(_most_severe(_Cases(table, natural[0]), None if made[0] is None else made[0]["case"]))
    made += [_most_valuable(_Cases(table, source)) for source, _ in judged if not source.natural]
    return [card for card in made if card is not None]


class _Cases:
    """The cases of one source as columns."""

    def __init__(self, table: CaseTable, source: Source) -> None:
        self._table = table.table
        self.name = source.name
        self.rows = np.flatnonzero(self.texts("source", every=True) == source.name)

    def has(self, name: str) -> bool:
        return name in self._table.column_names

    def texts(self, name: str, *, every: bool = False) -> NDArray[np.object_]:
        """Texts of a column, None for null; all None if the column does not exist."""
        if not self.has(name):
            values = np.full(self._table.num_rows, None, dtype=object)
        else:
            column = self._table[name]
            if pa.types.is_dictionary(column.type):  # much faster than value by value
                column = column.cast(pa.string())
            values = column.to_numpy()
        return values if every else values[self.rows]

    def numbers(self, name: str) -> NDArray[np.float64]:
        """Numbers of a column, NaN for null."""
        if not self.has(name):
            return np.full(self.rows.size, np.nan)
        values = self._table[name].to_numpy()
        return np.asarray(values, np.float64)[self.rows]

    def key(self, row: int) -> str:
        return f"{self.name}/{self.texts('case_id')[row]}"


def _kind_column(cases: _Cases) -> str:
    return "mechanism" if any(name is not None for name in cases.texts("mechanism")) else "crash_type"


def _sentence(column: str, kind: str) -> str:
    """Say what happens in crashes of a kind."""
    if column == "mechanism" and kind in KINDS:
        return KINDS[kind][1]
    words = VALUES["crash_type"].get(kind, kind)
    return f"The AV and another vehicle crash: {words}."


def _card(title: str, key: str, told: str, often: str = "", filters: Mapping[str, str] | None = None) -> dict[str, Any]:
    return {"title": title, "case": key, "text": told, "often": often, "filters": dict(filters or {})}


def _most_frequent(cases: _Cases) -> dict[str, Any] | None:
    """The most frequent kind among the natural crashes that a careful driver would have prevented."""
    often = cases.numbers("often")
    known = often > 0.0
    column = _kind_column(cases)
    prevention = np.array([how or NOT_JUDGED for how in cases.texts("prevention")], np.str_)
    points = np.stack([cases.numbers("pc1"), cases.numbers("pc2")], axis=1)
    first = what_to_see_first(cases.texts(column).tolist(), np.where(known, often, 0.0), points, prevention)
    if first is None:
        return None
    (found, prevented), n = first, int(known.sum())
    filters = {"f.source": cases.name, f"f.{column}": found.kind}
    if prevented:
        title = "The most frequent crash that a careful driver would have prevented"
        end = BY_CAREFUL[str(prevention[found.row])]
        filters["f.prevention"] = "|".join(CAREFULLY)
    elif (prevention[known] == NOT_JUDGED).all():
        title, end = "The most frequent crash", "Nobody looked whether a careful driver would have prevented it."
    else:
        title = "No crash here would have been prevented by a careful driver"
        end = f"This is the most frequent one of {n:,}."
    how_often = miles_of(often[found.rows], float(often[known].max()))
    told = f"{_sentence(column, found.kind)} {end} ({found.rows.size:,} of the {n:,} natural crashes here.)"
    return _card(title, cases.key(found.row), told, how_often, filters)


def _own_doing(judged: Sequence[tuple[Source, Analysis]], table: CaseTable) -> dict[str, Any] | None:
    """The first flaw of the AV, in natural cases if they show one."""
    for source, analysis in sorted(judged, key=lambda one: not one[0].natural):
        doing = analysis.found.own_doing
        if doing is None or not doing.flaws:
            continue
        flaw = doing.flaws[0]
        case = next((case for case in flaw.typical if (source.name, case) in table.rows), None)
        if case is None:
            continue
        conduct = table.row(table.rows[source.name, case]).get("conduct")
        often = ""
        if source.natural:
            often = _flaw_once_in(_Cases(table, source).numbers("often"), flaw)
        filters = {"f.source": source.name} | ({} if conduct is None else {"f.conduct": str(conduct)})
        told = text.sentence(doing.text)
        return _card(f"What this AV does wrong: it {FLAWS[flaw.flaw]}", f"{source.name}/{case}", told, often, filters)
    return None


def _flaw_once_in(often: NDArray[np.float64], flaw: FlawShown) -> str:
    """Say how many miles lie between two crashes that show a flaw, of natural cases that happen so often."""
    known = often[often > 0.0]
    if known.size == 0:
        return ""
    if np.ptp(known) == 0.0:
        return miles_of(known[: flaw.cases], float(known[0]))
    ends = (flaw.share, flaw.interval95[1], flaw.interval95[0])  # the share's interval is that of its rate
    return _once_in(*(_BILLION / (known.sum() * end) if end > 0.0 else None for end in ends))


def _most_severe(cases: _Cases, but: str | None) -> dict[str, Any] | None:
    """The natural crash with the highest chance of injury among crashes that a careful driver would have prevented.

    Args:
        cases: Cases of natural traffic.
        but: Key of a case that is shown already.
    """
    injury, prevention = cases.numbers("av_injury_probability"), cases.texts("prevention")
    rows = [
        row
        for row in np.flatnonzero(np.isfinite(injury)).tolist()
        if prevention[row] in CAREFULLY and cases.key(row) != but
    ]
    if not rows:
        return None
    row = max(rows, key=lambda one: injury[one])
    column = _kind_column(cases)
    speed = cases.numbers("impact_speed_mps")[row]
    told = (
        f"{_sentence(column, str(cases.texts(column)[row]))} They meet at {speed:.0f} m/s ({_KMH * speed:.0f} km/h) "
        f"relative to each other. {BY_CAREFUL[str(prevention[row])]}"
    )
    filters = {"f.source": cases.name, "f.prevention": "|".join(CAREFULLY)}
    return _card("The most severe crash that a careful driver would have prevented", cases.key(row), told, "", filters)


def _most_valuable(cases: _Cases) -> dict[str, Any] | None:
    """The case that the analysis values most."""
    value = cases.numbers("value")
    if not np.isfinite(value).any():
        return None
    row = int(np.nanargmax(value))
    column = _kind_column(cases)
    told = (
        f"{_sentence(column, str(cases.texts(column)[row]))} It has the highest value of all cases here: the mean of "
        "the AV's own doing, how well it could have been avoided, how severe it is, and how unlike the others."
    )
    title = "The adversary's most telling crash" if cases.name == "adversary" else "The most telling crash"
    return _card(title, cases.key(row), told, "", {"f.source": cases.name})
