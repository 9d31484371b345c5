"""State of all cases at one moment. It never changes; an analysis that arrives makes another."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from cornerforge.analysis.avoidability import WayOut
from cornerforge.errors import InputError
from cornerforge.ext.explorer.columns import CaseTable, case_table
from cornerforge.ext.explorer.sources import Analysis, Source, read_ways_out
from cornerforge.library import StoredCase

__all__ = ["Shelf", "State", "UnknownKeyError"]


class UnknownKeyError(InputError):
    """No source, case, AV or format has this name."""


class _WaysOut:
    """The ways out of an analysis, read when one is first asked for."""

    def __init__(self, source: Source, analysis: Analysis) -> None:
        self._source, self._analysis = source, analysis
        self._lock = threading.Lock()
        self._read: tuple[dict[str, int], pa.Table] | None = None

    def of(self, case_id: str) -> WayOut | None:
        with self._lock:
            if self._read is None:
                table = read_ways_out(self._analysis.folder, self._source.cases.path)
                self._read = {name: row for row, name in enumerate(table["case_id"].to_pylist())}, table
            rows, motions = self._read
        row = rows.get(case_id)
        if row is None:
            return None
        _, begin_s, *motion = (motions[name][row].as_py() for name in motions.column_names)
        if begin_s is None or not motion[0]:
            return None
        return WayOut(begin_s, *(np.array(values, np.float64) for values in motion))


@dataclass(frozen=True)
class Shelf:
    """One source.

    Attributes:
        source, analysis: Its library, and the analysis if there is one.
    """

    source: Source
    analysis: Analysis | None
    _reading: threading.Lock = field(default_factory=threading.Lock)
    _ways_out: _WaysOut | None = None

    def stored(self, case_id: str) -> StoredCase:
        """Read a case.

        Raises:
            FileFormatError: It lies in a damaged file.
        """
        with self._reading:
            return self.source.cases.scenario(case_id)

    def way_out(self, case_id: str) -> WayOut | None:
        """Give the AV's way out of a case; None if none is known.

        Raises:
            FileFormatError: The file of ways out is missing or damaged.
        """
        return None if self._ways_out is None else self._ways_out.of(case_id)

    def analysed(self, analysis: Analysis | None) -> Shelf:
        """Give the same source with this analysis."""
        ways_out = None if analysis is None else _WaysOut(self.source, analysis)
        return dataclasses.replace(self, analysis=analysis, _ways_out=ways_out)


@dataclass(frozen=True)
class State:
    """All sources and their cases.

    Attributes:
        revision: Grows with each analysis that arrives.
        shelves: The sources by name, in their order.
        table: Their cases.
    """

    revision: int
    shelves: Mapping[str, Shelf]
    table: CaseTable

    @classmethod
    def of(cls, sources: Sequence[tuple[Source, Analysis | None]]) -> State:
        """Make the first state."""
        shelves = {source.name: Shelf(source, None).analysed(analysis) for source, analysis in sources}
        return cls(1, shelves, case_table(sources))

    @property
    def sources(self) -> list[tuple[Source, Analysis | None]]:
        """The sources, each with its analysis if there is one."""
        return [(shelf.source, shelf.analysis) for shelf in self.shelves.values()]

    def analysed(self, source: str, analysis: Analysis) -> State:
        """Make the state in which a source has this analysis."""
        shelves = {**self.shelves, source: self.shelves[source].analysed(analysis)}
        table = case_table([(shelf.source, shelf.analysis) for shelf in shelves.values()])
        return State(self.revision + 1, shelves, table)

    def find(self, source: str, case_id: str) -> tuple[Shelf, int]:
        """Give the shelf of a case, and its row in the table.

        Raises:
            UnknownKeyError: No case has this name.
        """
        row = self.table.rows.get((source, case_id))
        if row is None:
            known = ", ".join(self.shelves)
            what = f"case {case_id[:80]!r} in {source}" if source in self.shelves else f"source {source[:80]!r}"
            raise UnknownKeyError(f"There is no {what}; sources: {known}.")
        return self.shelves[source], row
