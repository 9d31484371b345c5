"""From tests to the library's tables in bulk: what `case_record` does for one recording, for thousands a second."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge.library.schema import CASES, HISTORY_SHAPE, TRACKS, arrow_schema
from cornerforge.sim.harvest import CASES as N_CASES
from cornerforge.sim.harvest import EXACT, FILLED, MARKS, Buffers, Harvest, allocate_harvest, harvest_range
from cornerforge.sim.keep import Outcomes, allocate_outcomes, keep_nothing, keep_whole_test
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import allocate_worlds, world_of

__all__ = ["ADVERSARY_COLUMNS", "POLICY_COLUMNS", "Harvested", "Harvester"]

ADVERSARY_COLUMNS = {"shortfall_nats": "float", "n_implausible": "int"}
"""Extra columns of every library that is filled in bulk: by how much the log-probability of the critical BV's actions,
for an attentive naturalistic driver, falls short of the likeliest actions' (summed over the actions that are possible
at all), and how many actions were not possible at all."""
POLICY_COLUMNS = {"log_prob_policy": "float", "policy": "str"}
"""Extra columns where policies drive: log-probability of the critical BV's actions under the policy (0 when it acts
greedily), and the hash of the policy that drove the test."""

_ROOM = 64
"""Cases that a harvester's buffers hold."""
_NULLABLE = frozenset(column.name for column in CASES if "null" in column.meaning)
_SERIES = {
    "x_m": "x",
    "y_m": "y",
    "speed_mps": "speed",
    "heading_rad": "heading",
    "acceleration_mps2": "acceleration",
    "target_lane": "target_lane",
    "present": "present",
}


@dataclass(frozen=True)
class Harvested:
    """A range of tests: outcomes of all, and the tables of the crashes, ascending by test.

    Attributes:
        first: Number of the first test.
        outcomes: One entry per test.
        tests: Numbers of the tests with an AV crash, int64, shape (C,).
        cases, tracks: Rows of `schema.CASES` with the extra columns, and of `schema.TRACKS`; C rows.
    """

    first: int
    outcomes: Outcomes
    tests: NDArray[np.int64]
    cases: pa.Table
    tracks: pa.Table


class Harvester:
    """Drives tests of one run and keeps their crashes; its buffers serve one thread.

    Args:
        setting: The run.
        slots: Vehicle slots per world.
        policies: Hashes of the policies that drive, in the order of the mixture; none for a plain adversary.
    """

    def __init__(self, setting: Setting, slots: int, policies: Sequence[str] = ()) -> None:
        self._setting = setting
        self._policies = np.array(policies, dtype=object)
        self._buffers = Buffers(
            world_of(allocate_worlds(1, slots)),
            allocate_scratch(slots, setting.who.policy),
            keep_whole_test(setting, slots),
            keep_nothing(slots),
        )
        self._harvest = allocate_harvest(_ROOM, slots, setting.road.max_decisions)
        self.extra = extra_columns(with_policy=bool(policies))

    def harvest(self, seed: int, first: int, count: int) -> Harvested:
        """Drive `count` tests from `first` on; nearly all of it without the GIL."""
        out = allocate_outcomes(count)
        tables: list[tuple[pa.Table, pa.Table]] = []
        done = 0
        h = self._harvest
        while done < count:
            rest = Outcomes._make(column[done:] for column in out)
            h.filled[: len(FILLED) - 2] = 0
            done += harvest_range(seed, first + done, self._setting, self._buffers, rest, h)
            if h.filled[N_CASES]:
                tables.append(self._tables(seed))
        cases = [arrow_schema(CASES, self.extra).empty_table(), *(pair[0] for pair in tables)]
        tracks = [arrow_schema(TRACKS).empty_table(), *(pair[1] for pair in tables)]
        table = pa.concat_tables(cases)
        tests = table.column("test").to_numpy()
        return Harvested(first, out, tests, table, pa.concat_tables(tracks))

    def _tables(self, seed: int) -> tuple[pa.Table, pa.Table]:
        """What is in the buffers, copied."""
        h = self._harvest
        rows = h.rows[: h.filled[N_CASES]]
        ids = pa.array([f"{seed}:{test}" for test in rows["test"].tolist()])
        given = {
            "case_id": ids,
            "seed": np.full(rows.size, seed),
            "trajectory_digest": pa.array(_digests(h)),
            "critical_bv_action": _lists(h.critical_bv_action, rows["n_decisions"]),
            "history": pa.FixedSizeListArray.from_arrays(
                pa.array(h.history[: rows.size].ravel().copy()), int(np.prod(HISTORY_SHAPE))
            ),
            "physically_plausible": rows["physically_plausible"].astype(np.bool_),
        }
        if "policy" in self.extra:
            given["policy"] = self._policies[rows["policy"]]
        schema = arrow_schema(CASES, self.extra)
        cases = [_array(given.get(name), rows, name, schema.field(name).type) for name in schema.names]
        numbers = rows["n_kept"].astype(np.int64) * rows["n_frames"]
        tracks: dict[str, Any] = {
            "case_id": ids,
            "n_frames": pa.array(rows["n_frames"].copy()),
            "slot": _lists(h.slot, rows["n_kept"]),
            **{name: _lists(getattr(h, part), numbers) for name, part in _SERIES.items()},
            "action": _lists(h.action, rows["n_kept"].astype(np.int64) * rows["n_decisions"]),
            "critical_bv": _lists(h.critical_bv, rows["n_decisions"]),
            "decision_log_prob_nde": _lists(h.log_prob, rows["n_decisions"]),
        }
        return (
            pa.Table.from_arrays(cases, schema=schema),
            pa.Table.from_arrays([tracks[column.name] for column in TRACKS], schema=arrow_schema(TRACKS)),
        )


def extra_columns(*, with_policy: bool) -> dict[str, str]:
    """The extra columns of a library that is filled in bulk: name to a key of `schema.EXTRA_TYPES`."""
    return {**ADVERSARY_COLUMNS, **(POLICY_COLUMNS if with_policy else {})}


def _array(given: Any, rows: NDArray[np.void], name: str, kind: pa.DataType) -> pa.Array:
    """A column of the cases; buffers are reused, so nothing may point into them."""
    if isinstance(given, pa.Array):
        return given
    values = rows[name].copy() if given is None else given
    return pa.array(values, type=kind, from_pandas=name in _NULLABLE)


def _lists(flat: NDArray[Any], sizes: NDArray[Any]) -> pa.ListArray:
    """Lists of these sizes, one after the other in `flat`."""
    offsets = np.zeros(sizes.size + 1, dtype=np.int32)
    np.cumsum(sizes, out=offsets[1:])
    return pa.ListArray.from_arrays(pa.array(offsets), pa.array(flat[: offsets[-1]].copy()))


def _digests(h: Harvest) -> list[str]:
    """`sim.recorder.scenario_digest` of each case."""
    found = []
    exact = marks = 0
    for row in h.rows[: h.filled[N_CASES]]:
        size = int(row["n_frames"]) * int(row["n_vehicles"])
        rest = 2 * size + int(row["n_decisions"]) * (int(row["n_vehicles"]) + 2)
        digest = hashlib.sha256(h.exact[exact : exact + 5 * size].data)
        digest.update(h.marks[marks : marks + rest].data)
        found.append(digest.hexdigest())
        exact += 5 * size
        marks += rest
    if exact != h.filled[EXACT] or marks != h.filled[MARKS]:
        raise AssertionError("the harvest's layout changed")
    return found
