"""Content of the explorer: the cases of its sources, one at a time or as columns. HTTP is not its business."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from typing import Any, NamedTuple

import numpy as np

from cornerforge.analysis.in_words import what_happened
from cornerforge.errors import FileFormatError, InputError
from cornerforge.ext.explorer.columns import CaseTable, case_table
from cornerforge.ext.explorer.downloads import Shown, formats, made, packed
from cornerforge.ext.explorer.driving import Driving
from cornerforge.ext.explorer.room import Room
from cornerforge.ext.explorer.sources import Analysis, Source
from cornerforge.ext.explorer.start import cards, headline_of
from cornerforge.ext.explorer.words import KINDS
from cornerforge.library.query import Asker
from cornerforge.report import text
from cornerforge.report.cases import case_data, first_shown
from cornerforge.report.judged import JUDGED, judgement_of, verdict
from cornerforge.types import Scenario

__all__ = ["Exhibit", "UnknownKeyError"]


class UnknownKeyError(InputError):
    """No source, case, AV or format has this name."""


class _State(NamedTuple):
    """All sources by name with their analyses, and their cases, at one moment; another analysis makes another."""

    revision: int
    sources: Mapping[str, tuple[Source, Analysis | None]]
    table: CaseTable

    def find(self, source: str, case_id: str) -> tuple[Source, Analysis | None, int]:
        """Give the source of a case, and its row in the table."""
        row = self.table.rows.get((source, case_id))
        if row is None:
            known = ", ".join(self.sources)
            what = f"case {case_id[:80]!r} in {source}" if source in self.sources else f"source {source[:80]!r}"
            raise UnknownKeyError(f"There is no {what}; sources: {known}.")
        return *self.sources[source], row


_WHOLE = re.compile(r"\s*(select|with|from)\b", re.IGNORECASE)
"""Begins a whole SELECT; all else is a condition."""


class Exhibit:
    """The cases of some sources.

    Args:
        name: Name of the exhibit.
        sources: Its libraries, each with its analysis if there is one.
        driving: What drives.
        warnings: Plain lines on damaged or missing files.
    """

    def __init__(
        self,
        name: str,
        sources: Sequence[tuple[Source, Analysis | None]],
        driving: Driving,
        warnings: Sequence[str] = (),
    ) -> None:
        self.name = name
        self.driving = driving
        self.warnings = list(warnings)
        self.work: dict[str, Any] | None = None
        self._drives, self._asks, self._makes = Room("drives"), Room("questions in SQL"), Room("videos")
        self._asker: tuple[CaseTable, Asker] | None = None
        self._state = _State(1, {source.name: (source, found) for source, found in sources}, case_table(sources))

    @property
    def table(self) -> CaseTable:
        """All cases, as they are known now."""
        return self._state.table

    def analysed(self, source: str, analysis: Analysis) -> None:
        """Use an analysis that has just been written; `revision` grows. For one thread."""
        sources = {**self._state.sources, source: (self._state.sources[source][0], analysis)}
        self._state = _State(self._state.revision + 1, sources, case_table(list(sources.values())))

    # Each answer takes the state once: another may be there before it is done.

    def about(self) -> dict[str, Any]:
        """Make what /api/about says."""
        state = self._state
        table, judged = state.table, list(state.sources.values())
        sources = [source for source, _ in judged]
        first = sources[0].cases.identity
        attack = [source for source in sources if not source.natural]
        counts = Counter(name for name, _ in table.rows)
        return {
            "name": self.name,
            "av": str(first.get("av", "unknown")),
            "version": str(first.get("cornerforge", "unknown")),
            "headline": text.sentence(headline_of(judged)),
            "adversary": str(attack[0].cases.identity.get("bv", "")) if attack else "",
            "sources": [
                {
                    "name": source.name,
                    "label": source.label,
                    "cases": counts[source.name],
                    "natural": source.natural,
                    "replay": source.replay,
                }
                for source in sources
            ],
            "revision": state.revision,
            "work": self.work,
            "avs": list(self.driving.avs),
            "drivers": list(self.driving.drivers),
            "downloads": [{"format": name, "label": label} for name, label in self._formats().items()],
            "columns": list(table.columns),
            "start": cards(judged, table),
            "warnings": self.warnings,
        }

    def case(self, source: str, case_id: str) -> dict[str, Any]:
        """Make what /api/case/SOURCE/CASE_ID says.

        Raises:
            UnknownKeyError: No case has this name.
            FileFormatError: It lies in a damaged file.
        """
        return dict(self._shown(source, case_id).data)

    def _shown(self, source: str, case_id: str) -> Shown:
        state = self._state
        of, analysis, row = state.find(source, case_id)
        stored, told = of.stored(case_id), state.table.row(row)
        way_out = None if analysis is None else analysis.way_out(case_id)
        data = case_data(f"{source}/{case_id}", stored.scenario, way_out)
        known = "" if told.get("fault") is None else verdict(judgement_of({n: told.get(n) for n in JUDGED}, way_out))
        data |= {
            "key": f"{source}/{case_id}",
            "title": _title(stored.scenario, told),
            "verdict": text.sentence(known),
            "facts": _facts(state.table, told),
        }
        return Shown(stored.scenario, way_out, data)

    def ghosts(self, source: str, case_id: str) -> dict[str, Any]:
        """Make what /api/case/SOURCE/CASE_ID/ghosts says.

        Raises:
            CornerForgeError: As of `case`; the case cannot be judged; or too many ask, or the server ends.
        """
        of, _, _ = self._state.find(source, case_id)
        stored = of.stored(case_id)
        with self._drives.turn():
            return {"drivers": self.driving.ghosts(of, stored)}

    def case_with(self, source: str, case_id: str, av: str) -> dict[str, Any]:
        """Make what /api/case/SOURCE/CASE_ID/with/AV says: the same case driven by another AV, others as recorded.

        Raises:
            UnknownKeyError: No case or no AV has this name.
            CornerForgeError: The case cannot be read or driven.
        """
        of, _, _ = self._state.find(source, case_id)
        if av not in self.driving.avs:
            raise UnknownKeyError(f"There is no AV {av[:80]!r} here; known: {', '.join(self.driving.avs)}.")
        stored = of.stored(case_id)
        with self._drives.turn():
            scenario = self.driving.with_av(of, stored, av)
        key = f"{source}/{case_id}@{av}"
        first, struck = first_shown(stored.scenario), stored.scenario.partner
        partner = None if struck is None else int(stored.scenario.slot[struck])
        data = case_data(key, scenario, first=min(first, len(scenario.x) - 1), partner=partner)
        seconds = "" if scenario.crash is None else f" after {scenario.crash.time:.1f} s"
        title = f"{av}: " + (f"it crashes{seconds}" if scenario.partner is not None else "it does not crash")
        return data | {"key": key, "title": title, "verdict": "", "facts": []}

    def download(self, source: str, case_id: str, name: str) -> tuple[str, str, bytes]:
        """Make a file of a case; videos one at a time, because each takes all cores.

        Returns:
            Media type, file name, and content.

        Raises:
            UnknownKeyError: No case or no format has this name.
            OutputError: The program that writes videos failed.
            UnavailableError: Too many videos are being made, or the server ends.
        """
        of, _, _ = self._state.find(source, case_id)
        stem = f"{source}-{case_id.replace(':', '-')}"
        if name not in (known := self._formats()):
            raise UnknownKeyError(f"There is no format {name[:80]!r}; known: {', '.join(known)}.")
        if name in self.driving.exports:
            with self._drives.turn():
                return packed(stem, self.driving.export(of, of.stored(case_id), name))
        shown = self._shown(source, case_id)
        with nullcontext() if name == "numbers" else self._makes.turn():
            media, content = made(shown, name, self._makes.check)
        return media, f"{stem}.{'json' if name == 'numbers' else name}", content

    def _formats(self) -> dict[str, str]:
        """Files that can be made of a case, each with its label."""
        return {**formats(), **self.driving.exports}

    def rows_where(self, where: str) -> bytes:
        """Say which rows a condition in SQL holds for, or a whole SELECT names by `source` and `case_id`.

        Returns:
            One bit a row, the lowest first.

        Raises:
            InputError: The condition is wrong or forbidden, or takes too much time or memory.
            MissingExtraError: DuckDB is not installed.
            UnavailableError: Too many questions are being answered, or the server ends.
        """
        with self._asks.turn():
            table = self._state.table
            if self._asker is None or self._asker[0] is not table:
                if self._asker is not None:
                    self._asker[1].close()
                self._asker = table, Asker(table.plain())
                self._asks.check()  # `close` may have missed it
            return _bits(self._asker[1], table, where)

    def close(self) -> None:
        """Stop: waiting and running requests are told so, and SQL's process ends."""
        for room in (self._drives, self._asks, self._makes):
            room.close()
        if self._asker is not None:
            self._asker[1].close()


def _facts(table: CaseTable, told: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {**{key: column[key] for key in ("name", "label", "unit", "meaning")}, "value": _fact(told[column["name"]])}
        for column in table.columns
        if column["name"] not in ("source", "case_id")
    ]


def _bits(asker: Asker, table: CaseTable, where: str) -> bytes:
    if not where.strip():
        raise InputError("The condition is empty.")
    is_whole = _WHOLE.match(where) is not None
    names, rows = asker.ask(where if is_whole else f"SELECT source, case_id FROM cases WHERE (\n{where}\n)")
    if not {"source", "case_id"} <= set(names):
        raise InputError("A SELECT must give the columns source and case_id; or write a condition only.")
    of, case = names.index("source"), names.index("case_id")
    chosen = np.zeros(table.table.num_rows, np.bool_)
    for row in rows:
        at = table.rows.get((str(row[of]), str(row[case])))
        if at is not None:
            chosen[at] = True
    return np.packbits(chosen, bitorder="little").tobytes()


def _fact(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return "infinite" if value > 0.0 else "minus infinite" if value < 0.0 else None
    return value


def _title(scenario: Scenario, told: Mapping[str, Any]) -> str:
    """Say in one line what happens in a case."""
    kind = told.get("mechanism")
    try:
        happened = what_happened(scenario)
    except (InputError, FileFormatError):
        happened = str(told.get("crash_type") or "a crash")
    words = KINDS[kind][1].removesuffix(".") if kind in KINDS else ""
    return text.sentence(f"{words} ({happened})" if words and words != happened else happened)
