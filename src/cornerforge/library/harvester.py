"""Driving of tests in bulk, with crashes stored as rows of the library's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.fields import CASES, TRACKS
from cornerforge.library.schema import EXTRA_TYPES, arrow_schema, check_extra_name
from cornerforge.library.tables import extra_columns, tables_of
from cornerforge.sim import (
    Setting,
    allocate_scratch,
    allocate_worlds,
    controllers,
    keep_nothing,
    keep_whole_test,
    naming_tests,
    outcome,
    recorder,
    statistics,
    warn_of_left_out,
    world_of,
)
from cornerforge.sim import (
    harvest as harvests,
)
from cornerforge.types import SUBSTEPS

__all__ = ["CaseRoom", "Harvested", "Harvester", "Scalar", "harvested_of", "hides_bvs"]

_ROOM = 64
"""Number of cases that buffers hold."""
_MOST_NUMBERS = 2**24
"""Of long tests with many vehicles buffers hold fewer: about so many states."""
Scalar: TypeAlias = bool | int | float | str | None


@dataclass(frozen=True)
class Harvested:
    """Result of a range of tests: outcomes of all, and the tables of the crashes, ascending by test.

    Attributes:
        first: Number of the first test.
        outcomes: One entry per test.
        counts: Histograms over all tests, all 0 unless they were asked for.
        tests: Numbers of the tests with an AV crash, int64, shape (C,).
        cases, tracks: Rows of `fields.CASES` with the extra columns, and of `fields.TRACKS`; C rows.
    """

    first: int
    outcomes: outcome.Outcomes
    counts: statistics.Counts
    tests: NDArray[np.int64]
    cases: pa.Table
    tracks: pa.Table


class CaseRoom:
    """Buffers for cases, emptied into tables whenever they are full. Serves one thread.

    Args:
        slots: Vehicle slots per world.
        decisions: Most of a test.
        policies: Hashes of the policies that drive, in the order of the mixture; none for a plain adversary.
        hides: As for `tables.tables_of`.
    """

    def __init__(self, slots: int, decisions: int, policies: Sequence[str] = (), *, hides: bool = False) -> None:
        self._policies, self._hides = tuple(policies), hides
        self._longest = (SUBSTEPS * decisions + 1, slots)
        cases = max(1, min(_ROOM, _MOST_NUMBERS // (self._longest[0] * slots)))
        self._harvest = harvests.allocate_harvest(cases, slots, decisions)
        self.clear()

    def __len__(self) -> int:
        """Count the cases."""
        return sum(len(part[0]) for part in self._parts) + self._harvest.n_cases

    def room(self) -> harvests.Harvest:
        """Give the buffers with room for at least the longest case; cases in them are moved to tables if necessary."""
        if harvests.is_full(self._harvest, *self._longest):
            self._empty()
        return self._harvest

    def add(
        self, drive: recorder.Recording, extra: Mapping[str, Scalar] | None = None, *,
        start: NDArray[np.void] | None = None, poses: NDArray[np.float64] | None = None,
    ) -> None:  # fmt: skip
        """Add what was driven last.

        Args:
            drive: Where it was driven; it ended in a crash of the AV.
            extra: Own columns, the same for all cases; names end in their unit where they have one.
            start: All states of a scripted case at frame 0 (`sim.Script.start`); all vehicles are stored then. None
                for a test of a seed.
            poses: Rails of the others in a scripted case on rails (`sim.Script.poses`).

        Raises:
            InputError: There is no crash of the AV, or an extra name cannot be a column.
        """
        own = {check_extra_name(name): value for name, value in (extra or {}).items()}
        drive.keep(self.room(), whole=start is not None)
        self._own.append(own)
        self._starts += [] if start is None else [start]
        self._poses += [] if poses is None else [poses]

    def _empty(self) -> None:
        h = self._harvest
        if h.n_cases:
            self._parts.append(
                tables_of(h, policies=self._policies, hides=self._hides, starts=self._starts, poses=self._poses)
            )
        self._starts.clear()
        self._poses.clear()
        h.clear()

    def tables(self) -> tuple[pa.Table, pa.Table]:
        """Give all cases so far and their tracks.

        Raises:
            InputError: The cases have other columns than the first one, or a value cannot be stored.
        """
        self._empty()
        if not self._parts:
            extra = extra_columns(self._policies, hides=self._hides)
            return arrow_schema(CASES, extra).empty_table(), arrow_schema(TRACKS).empty_table()
        cases, tracks = (pa.concat_tables(tables) for tables in zip(*self._parts, strict=True))
        kinds = [{name: type(value).__name__ for name, value in own.items()} for own in self._own]
        for row, kind in enumerate(kinds):
            if kind != kinds[0] or not set(kind.values()) <= EXTRA_TYPES.keys():
                raise InputError(
                    f"Case {cases['case_id'][row]} has the extra columns {self._own[row]}; all cases need the same "
                    f"columns, of one of the types {', '.join(EXTRA_TYPES)}."
                )
        for name, type_ in kinds[0].items() if kinds else ():
            cases = cases.append_column(name, pa.array([own[name] for own in self._own], EXTRA_TYPES[type_]))
        return cases, tracks

    def clear(self) -> None:
        """Forget all cases."""
        self._harvest.clear()
        self._parts: list[tuple[pa.Table, pa.Table]] = []
        self._own: list[dict[str, Scalar]] = []
        self._starts: list[NDArray[np.void]] = []
        self._poses: list[NDArray[np.float64]] = []

    def take(self) -> tuple[pa.Table, pa.Table]:
        """Give all cases so far and their tracks, and forget them."""
        found = self.tables()
        self.clear()
        return found


def hides_bvs(setting: Setting) -> bool:
    """Say whether the adversary of a run may make the AV lose a BV (`perception.Perception`)."""
    return bool(setting.road.perception.dropout > 0.0 and setting.who.critical != controllers.NOBODY)


class Harvester:
    """Drives tests of one run and keeps their crashes; its buffers serve one thread.

    Args:
        setting: The run.
        slots: Vehicle slots per world.
        policies: As for `CaseRoom`.
    """

    def __init__(self, setting: Setting, slots: int, policies: Sequence[str] = ()) -> None:
        self._setting = setting
        self._world = world_of(allocate_worlds(1, slots, setting.road))
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._whole, self._nothing = keep_whole_test(setting, slots), keep_nothing(slots)
        self._no_counts = statistics.allocate_counts()
        self._cases = CaseRoom(slots, setting.road.max_decisions, policies, hides=hides_bvs(setting))

    def harvest(self, seed: int, first: int, count: int, *, counting: bool = False) -> Harvested:
        """Drive `count` tests from `first` on; nearly all of it without the GIL.

        Args:
            seed, first, count: Which tests.
            counting: Fill the histograms too.
        """
        out, done = outcome.allocate_outcomes(count), 0
        counts = statistics.allocate_counts() if counting else self._no_counts
        at = self._buffers(counts, counting)
        with naming_tests(self._world):
            while done < count:
                rest = outcome.Outcomes._make(column[done:] for column in out)
                done += harvests.harvest_range(seed, first + done, self._setting, at, rest, self._cases.room())
        warn_of_left_out(self._scratch)
        return harvested_of(first, out, counts, self._cases)

    def warm_up(self) -> None:
        """Load the compiled kernels, or compile them, so that timings do not count it."""
        nothing = self._buffers(self._no_counts, False)
        harvests.harvest_range(0, 0, self._setting, nothing, outcome.allocate_outcomes(0), self._cases.room())

    def _buffers(self, counts: statistics.Counts, counting: bool) -> harvests.Buffers:
        """Give the buffers in which tests are driven, counted into `counts`."""
        census = statistics.census_of(counting)
        return harvests.Buffers(
            self._world,
            self._scratch,
            counted=self._nothing._replace(counts=counts, census=census),
            whole_counted=self._whole._replace(counts=counts, census=census),
            whole=self._whole,
        )


def harvested_of(first: int, outcomes: outcome.Outcomes, counts: statistics.Counts, cases: CaseRoom) -> Harvested:
    """Make the result from the outcomes and the cases."""
    rows, tracks = cases.take()
    return Harvested(first, outcomes, counts, rows.column("test").to_numpy(), rows, tracks)
