"""Cases made of scenarios in memory, by the kernel that makes all cases, and their way into a library."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge.fields import BODY, FRAME_FIELDS, SERIES
from cornerforge.library import CaseLibrary
from cornerforge.library.harvester import Scalar
from cornerforge.library.schema import EXTRA_TYPES
from cornerforge.library.shards import encode_tables
from cornerforge.library.tables import tables_of
from cornerforge.road.straight import road_numbers
from cornerforge.sim.harvest import NEAR_M, CaseName, Recorded, allocate_harvest, keep_case
from cornerforge.sim.keep import Decisions
from cornerforge.sim.world import VEHICLE
from cornerforge.types import Odd, Scenario

__all__ = ["CaseRecord", "append", "case_record"]


@dataclass(frozen=True)
class CaseRecord:
    """One case: a row of the cases, own columns included, and a row of the tracks."""

    odd: Odd
    cases: pa.Table
    tracks: pa.Table

    @property
    def case(self) -> dict[str, Any]:
        """Values of the columns."""
        row: dict[str, Any] = self.cases.to_pylist()[0]
        return row

    @property
    def case_id(self) -> str:
        """Name of the case."""
        return str(self.case["case_id"])


def case_record(
    scenario: Scenario,
    *,
    trajectory_digest: str | None = None,
    extra: Mapping[str, Scalar] | None = None,
    start: NDArray[np.void] | None = None,
    poses: NDArray[np.float64] | None = None,
) -> CaseRecord:
    """The case of a recorded crash of the AV; what a scenario does not hold is NaN or 0."""
    contact, partner = scenario.contact()
    frames, vehicles = scenario.x.shape
    decided = len(scenario.critical_bv)
    recording = np.zeros((frames, vehicles), dtype=FRAME_FIELDS)
    for series in SERIES:
        recording[series.name] = np.where(scenario.present, getattr(scenario, series.name), 0)
    decisions = Decisions(
        np.ascontiguousarray(scenario.action, dtype=np.int8),
        np.ascontiguousarray(scenario.critical_bv, dtype=np.int16),
        np.ascontiguousarray(scenario.log_prob_nde, dtype=np.float64),
        np.full(decided, np.nan) if scenario.shortfall is None else np.array(scenario.shortfall, np.float64),
        np.full(decided, np.nan) if scenario.excess is None else np.array(scenario.excess, np.float64),
        np.zeros(decided),
        np.zeros(decided, dtype=np.int8),
    )
    bodies = np.zeros(vehicles, dtype=VEHICLE)
    for body in BODY:
        bodies[body.name] = getattr(scenario, body.name)
    harvest = allocate_harvest(1, vehicles, max(decided, -(-frames // 10)))
    end = Recorded(frames, decided, vehicles, contact, partner)
    near_m = NEAR_M if start is None else math.inf
    name = CaseName(int(scenario.seed), int(scenario.test), 0)
    keep_case(name, end, near_m, road_numbers(scenario.odd), recording, decisions, bodies, harvest)
    kept = int(harvest.rows["n_kept"][0])
    harvest.slot[:kept] = scenario.slot[harvest.slot[:kept]]
    harvest.rows["bv_slot"] = scenario.slot[partner]
    starts, rails = () if start is None else (start,), () if poses is None else (poses,)
    cases, tracks = tables_of(harvest, starts=starts, poses=rails)
    if trajectory_digest is not None:
        place = cases.schema.get_field_index("trajectory_digest")
        cases = cases.set_column(place, cases.field(place), pa.array([trajectory_digest]))
    for column, value in (extra or {}).items():
        cases = cases.append_column(column, pa.array([value], EXTRA_TYPES[type(value).__name__]))
    return CaseRecord(scenario.odd, cases, tracks)


def append(
    library: CaseLibrary, records: Sequence[CaseRecord], *, next_test: int, tests: int, crashes: int,
    shard_cases: int | None = None,
) -> None:  # fmt: skip
    """Write cases as one shard, or so that shards are filled up to so many cases."""
    progress = {"next_test": next_test, "tests": tests, "crashes": crashes}
    if not records:
        library.append_shard(None, **progress)
        return
    cases, tracks = (pa.concat_tables(part) for part in zip(*((r.cases, r.tracks) for r in records), strict=True))
    if shard_cases is None:
        library.append_shard(encode_tables(cases, tracks), **progress)
    else:
        library.fill(cases, tracks, **progress, shard_cases=shard_cases)
