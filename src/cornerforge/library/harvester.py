"""Driving of tests in bulk, with crashes stored as rows of the library's tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge.fields import CASES, TRACKS
from cornerforge.library.schema import arrow_schema
from cornerforge.library.tables import POLICY_COLUMNS, tables_of
from cornerforge.sim import (
    Setting,
    allocate_scratch,
    allocate_worlds,
    keep_nothing,
    keep_whole_test,
    naming_tests,
    outcome,
    statistics,
    warn_of_left_out,
    world_of,
)
from cornerforge.sim import (
    harvest as harvests,
)
from cornerforge.types import SUBSTEPS

__all__ = ["CaseRoom", "Harvested", "Harvester", "extra_columns", "harvested_of"]

_ROOM = 64
"""Number of cases that buffers hold."""


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
    """

    def __init__(self, slots: int, decisions: int, policies: Sequence[str] = ()) -> None:
        self._policies = tuple(policies)
        self._longest = (SUBSTEPS * decisions + 1, slots)
        self._harvest = harvests.allocate_harvest(_ROOM, slots, decisions)
        self._parts: list[tuple[pa.Table, pa.Table]] = []

    def room(self) -> harvests.Harvest:
        """Give the buffers with room for at least the longest case; cases in them are moved to tables if necessary."""
        if harvests.is_full(self._harvest, *self._longest):
            self._empty()
        return self._harvest

    def _empty(self) -> None:
        h = self._harvest
        if h.n_cases:
            self._parts.append(tables_of(h, policies=self._policies))
        h.clear()

    def take(self) -> tuple[pa.Table, pa.Table]:
        """Give all cases so far and their tracks, and empty the buffers."""
        self._empty()
        extra = extra_columns(with_policy=bool(self._policies))
        parts, self._parts = self._parts, []
        cases = [arrow_schema(CASES, extra).empty_table(), *(part[0] for part in parts)]
        tracks = [arrow_schema(TRACKS).empty_table(), *(part[1] for part in parts)]
        return pa.concat_tables(cases), pa.concat_tables(tracks)


class Harvester:
    """Drives tests of one run and keeps their crashes; its buffers serve one thread.

    Args:
        setting: The run.
        slots: Vehicle slots per world.
        policies: As for `CaseRoom`.
    """

    def __init__(self, setting: Setting, slots: int, policies: Sequence[str] = ()) -> None:
        self._setting = setting
        self._world = world_of(allocate_worlds(1, slots))
        self._scratch = allocate_scratch(slots, setting.who.policy)
        self._whole, self._nothing = keep_whole_test(setting, slots), keep_nothing(slots)
        self._no_counts = statistics.allocate_counts()
        self._cases = CaseRoom(slots, setting.road.max_decisions, policies)
        self.extra = extra_columns(with_policy=bool(policies))

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


def extra_columns(*, with_policy: bool) -> dict[str, str]:
    """Give the extra columns of a library that is filled in bulk: name to a key of `schema.EXTRA_TYPES`."""
    return dict(POLICY_COLUMNS) if with_policy else {}
