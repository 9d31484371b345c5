"""Cases made from recordings, by the same kernel of `sim/harvest.py` for all drivers."""

from __future__ import annotations

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
from cornerforge.sim import recorder
from cornerforge.types import Odd, Scenario

__all__ = ["CaseRecord", "Scalar", "case_record", "extra_kinds"]

Scalar: TypeAlias = bool | int | float | str | None


@dataclass(frozen=True)
class CaseRecord:
    """One case as `CaseLibrary.append` takes it; make it with `case_record`.

    Attributes:
        odd: Road and rules, equal to the library's.
        cases: One row of `fields.CASES`.
        tracks: One row of `fields.TRACKS`, or of `schema.SCRIPTED_TRACKS` or `RAILS_TRACKS` for a scripted case.
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
    def on_rails(self) -> bool:
        """Whether its other vehicles are on rails."""
        return "rails" in self.tracks.column_names

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
    poses: NDArray[np.float64] | None = None,
) -> CaseRecord:
    """Make the library's row of a recorded AV crash.

    Args:
        scenario: Recording that ends in a crash of the AV.
        trajectory_digest: Hex digest to store instead of the recording's (`sim.recorder.scenario_digest`).
        extra: Own columns, the same for all cases of a library; names end in their unit where they have one.
        start: All states of a scripted case at frame 0 (`sim.scripted.Script.start`); all vehicles are stored then.
            None for a test of a seed.
        poses: Rails of the others in a scripted case on rails (`sim.scripted.Script.poses`).

    Raises:
        InputError: The scenario holds no AV crash, or an extra name cannot be a column.
    """
    own = {check_extra_name(name): value for name, value in (extra or {}).items()}
    room = recorder.case_of(scenario, whole=start is not None)
    digests = None if trajectory_digest is None else [trajectory_digest]
    cases, tracks = tables_of(
        room, digests=digests, starts=None if start is None else [start], poses=None if poses is None else [poses]
    )
    return CaseRecord(scenario.odd, cases, tracks, own)


def extra_kinds(record: CaseRecord) -> dict[str, str]:
    """Types of a record's own columns: name to a key of `EXTRA_TYPES`.

    Raises:
        InputError: A value has another type.
    """
    kinds = {}
    for name, value in record.extra.items():
        kinds[name] = type(value).__name__
        if kinds[name] not in EXTRA_TYPES:
            raise InputError(
                f"Extra column {name} of case {record.case_id} is {value!r}; allowed: {', '.join(EXTRA_TYPES)}."
            )
    return kinds
