"""Cases made from recordings, by the same kernel of `sim/harvest.py` for all drivers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.library.schema import EXTRA_TYPES, check_extra_name
from cornerforge.library.tables import tables_of
from cornerforge.road.straight import road_numbers
from cornerforge.sim.harvest import NEAR_M, CaseName, allocate_harvest, keep_case
from cornerforge.sim.recorder import recording_of
from cornerforge.sim.step import SUBSTEPS
from cornerforge.types import Odd, Scenario

__all__ = ["CaseRecord", "Scalar", "case_record", "extra_kinds"]

Scalar: TypeAlias = bool | int | float | str | None


@dataclass(frozen=True)
class CaseRecord:
    """One case as `CaseLibrary.append` takes it; make it with `case_record`.

    Attributes:
        odd: Road and rules, equal to those of the library.
        cases: One row of `fields.CASES`.
        tracks: One row of `fields.TRACKS`, or of `schema.SCRIPTED_TRACKS` for a scripted case.
        extra: The caller's own columns.
    """

    odd: Odd
    cases: pa.Table
    tracks: pa.Table
    extra: Mapping[str, Scalar]

    @cached_property
    def case(self) -> dict[str, Any]:
        """Values of the columns of `fields.CASES` as Python objects; None for null."""
        row: dict[str, Any] = self.cases.to_pylist()[0]
        return row

    @property
    def scripted(self) -> bool:
        """Whether its replay starts from what is stored (True), or from its seed."""
        return "start" in self.tracks.column_names

    @property
    def case_id(self) -> str:
        """Name of the case, `seed:test`."""
        return str(self.case["case_id"])


def case_record(
    scenario: Scenario,
    *,
    trajectory_digest: str | None = None,
    extra: Mapping[str, Scalar] | None = None,
    start: NDArray[np.void] | None = None,
) -> CaseRecord:
    """Make the library's row of a recorded AV crash.

    Args:
        scenario: Recording that ends in a crash of the AV.
        trajectory_digest: Hex digest to store instead of that of the recording (`sim.recorder.scenario_digest`).
        extra: Own columns, the same for all cases of a library; names end in their unit where they have one.
        start: Of a scripted case all states at frame 0 (`sim.scripted.Script.start`); all vehicles are stored
            then. None for a test of a seed.

    Raises:
        InputError: The scenario holds no AV crash, or an extra name cannot be a column.
    """
    own = {check_extra_name(name): value for name, value in (extra or {}).items()}
    end, recording, decisions, bodies = recording_of(scenario)
    room = allocate_harvest(1, end.vehicles, max(end.decisions, -(-end.frames // SUBSTEPS)))
    name = CaseName(int(scenario.seed), int(scenario.test), 0)
    near_m = NEAR_M if start is None else math.inf
    keep_case(name, end, near_m, road_numbers(scenario.odd), recording, decisions, bodies, room)
    # the kernel counts vehicles; their names are the scenario's
    kept = int(room.rows["n_kept"][0])
    room.slot[:kept] = scenario.slot[room.slot[:kept]]
    room.rows["bv_slot"] = scenario.slot[end.partner]
    digests = None if trajectory_digest is None else [trajectory_digest]
    cases, tracks = tables_of(room, digests=digests, starts=None if start is None else [start])
    return CaseRecord(scenario.odd, cases, tracks, own)


def extra_kinds(record: CaseRecord) -> dict[str, str]:
    """Types of a record's own columns: name to a key of `EXTRA_TYPES`.

    Raises:
        InputError: A value is of no such type.
    """
    kinds = {}
    for name, value in record.extra.items():
        kinds[name] = type(value).__name__
        if kinds[name] not in EXTRA_TYPES:
            raise InputError(
                f"Extra column {name} of case {record.case_id} is {value!r}; allowed: {', '.join(EXTRA_TYPES)}."
            )
    return kinds
