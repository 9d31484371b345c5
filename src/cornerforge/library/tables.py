"""Conversion of cases to Arrow tables and Parquet bytes, and of rows back to a `Scenario`."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cornerforge._arrow import arrow_type
from cornerforge._checksums import MIGRATE
from cornerforge.drivers.rails import POSE_NUMBERS
from cornerforge.errors import FileFormatError
from cornerforge.fields import BODY, CASES, REALS, SERIES, TRACKS, Field
from cornerforge.library.schema import RAILS_TRACKS, SCRIPTED_TRACKS, arrow_schema
from cornerforge.sim import Script, scripted
from cornerforge.types import Crash, Odd, Scenario

if TYPE_CHECKING:
    from cornerforge.sim import harvest

__all__ = [
    "HIDDEN_COLUMN",
    "POLICY_COLUMNS",
    "ROW_GROUP",
    "extra_columns",
    "parquet_bytes",
    "restore",
    "script_of",
    "tables_of",
]

POLICY_COLUMNS = {"log_prob_policy": "float", "policy": "str"}
"""Extra columns where policies drive: log-probability of the critical BV's actions under the policy (0 when it acts
greedily), and the hash of the policy that drove the test."""
HIDDEN_COLUMN = "hidden_seconds"
"""Extra column where an adversary may make the AV lose the critical BV: bit k is 1 if it did in second k."""
ROW_GROUP = 100
"""Cases in a row group of a tracks file; reading one case unpacks one row group."""


def extra_columns(policies: Sequence[str], *, hides: bool) -> dict[str, str]:
    """Give the extra columns of the cases of an adversary, name to type: policies' hashes, and whether it hides BVs."""
    return {**(POLICY_COLUMNS if policies else {}), **({HIDDEN_COLUMN: "int"} if hides else {})}


def tables_of(
    h: harvest.Harvest,
    *,
    policies: Sequence[str] = (),
    hides: bool = False,
    starts: Sequence[NDArray[np.void]] = (),
    poses: Sequence[NDArray[np.float64]] = (),
) -> tuple[pa.Table, pa.Table]:
    """Copy all cases of a harvest: rows of `fields.CASES` (with `POLICY_COLUMNS`), and of `fields.TRACKS`.

    Args:
        h: At least one case.
        policies: Hashes of the policies that drove, in the order of the mixture; none: no columns of policies.
        hides: The adversary may make the AV lose the critical BV: with `HIDDEN_COLUMN`.
        starts: States at frame 0 of each case if they are scripted; the tracks are `SCRIPTED_TRACKS` then.
        poses: Rails of each scripted case (`sim.Script.poses`); the tracks are `RAILS_TRACKS` then.
    """
    rows = h.rows[: h.n_cases]
    names = zip(rows["seed"].tolist(), rows["test"].tolist(), strict=True)
    given: dict[str, pa.Array] = {
        "case_id": pa.array([f"{seed}:{test}" for seed, test in names]),
        "trajectory_digest": pa.array(_digests(h)),
        "critical_bv_action": _lists(h.critical_bv_action, rows["n_decisions"]),
        "history": pa.FixedSizeListArray.from_arrays(
            pa.array(h.history[: rows.size].ravel().copy()), h.history.shape[1]
        ),
        "physically_plausible": pa.array(rows["physically_plausible"].astype(np.bool_)),
        # what was not recorded cannot be counted
        "n_implausible": pa.array(rows["n_implausible"].copy(), mask=np.isnan(rows["possible_shortfall_nats"])),
    }
    extra = extra_columns(policies, hides=hides)
    if hides:
        given[HIDDEN_COLUMN] = pa.array(rows["hidden"].copy())
    if policies:
        given["policy"] = pa.array(np.array(policies, dtype=object)[rows["policy"]], pa.string())
        given["log_prob_policy"] = pa.array(rows["log_prob_policy"].copy())
    columns = [given[c.name] if c.name in given else _numbers(rows[c.name], c) for c in CASES]
    cases = pa.Table.from_arrays([*columns, *(given[name] for name in extra)], schema=arrow_schema(CASES, extra))
    kept, decided = rows["n_kept"].astype(np.int64), rows["n_decisions"]
    numbers = kept * rows["n_frames"]
    reals = dict(zip(REALS, h.reals, strict=True))
    stored = {one.name: reals[one.name] if one.name in reals else getattr(h, one.name) for one in SERIES}
    tracks = {
        "case_id": given["case_id"],
        "n_frames": pa.array(rows["n_frames"].copy()),
        "slot": _lists(h.slot, kept),
        **{body.column.name: _lists(getattr(h, body.name), kept) for body in BODY},
        **{series.column.name: _lists(stored[series.name], numbers) for series in SERIES},
        "action": _lists(h.action, kept * decided),
        "critical_bv": _lists(h.critical_bv, decided),
        "decision_log_prob_nde": _lists(h.log_prob, decided),
    }
    named = TRACKS
    if starts:
        named = SCRIPTED_TRACKS
        states = [scripted.start_values(start).ravel() for start in starts]
        tracks["start"] = _lists(np.concatenate(states), np.array([state.size for state in states]))
    if poses:
        named = RAILS_TRACKS
        tracks["rails"] = _lists(np.concatenate([one.ravel() for one in poses]), np.array([one.size for one in poses]))
    return cases, pa.Table.from_arrays([tracks[c.name] for c in named], schema=arrow_schema(named))


def _numbers(values: NDArray[Any], column: Field) -> pa.Array:
    """Copy numbers into a column; buffers are reused, so nothing may point into them."""
    return pa.array(values.copy(), type=arrow_type(column.type), from_pandas=column.nullable)


def _lists(flat: NDArray[Any], sizes: NDArray[Any]) -> pa.ListArray:
    """Make lists of these sizes, one after the other in `flat`."""
    offsets = np.zeros(sizes.size + 1, dtype=np.int32)
    np.cumsum(sizes, out=offsets[1:])
    return pa.ListArray.from_arrays(pa.array(offsets), pa.array(flat[: offsets[-1]].copy()))


def _digests(h: harvest.Harvest) -> list[str]:
    """Compute `sim.recorder.scenario_digest` of each case."""
    found = []
    exact = marks = 0
    for row in h.rows[: h.n_cases]:
        size = int(row["n_frames"]) * int(row["n_vehicles"])
        reals = len(REALS) * size
        rest = 2 * size + int(row["n_decisions"]) * (int(row["n_vehicles"]) + 2)
        digest = hashlib.sha256(h.exact[exact : exact + reals].data)
        digest.update(h.marks[marks : marks + rest].data)
        found.append(digest.hexdigest())
        exact += reals
        marks += rest
    if (exact, marks) != h.digested:
        raise AssertionError("the harvest's layout changed")
    return found


def parquet_bytes(table: pa.Table, row_group: int | None = None) -> memoryview:
    """Write a table as a Parquet file in memory, zstd-compressed.

    Floats are split into byte planes first: sign and exponent bytes of a trajectory hardly change and compress well.
    """
    planes = [_leaf(field) for field in table.schema if pa.types.is_floating(_value_type(field.type))]
    words = [_leaf(field) for field in table.schema if not pa.types.is_floating(_value_type(field.type))]
    sink = pa.BufferOutputStream()
    pq.write_table(
        table, sink, compression="zstd", compression_level=1, row_group_size=row_group,
        use_dictionary=words, use_byte_stream_split=planes, write_statistics=False,
    )  # fmt: skip
    return memoryview(sink.getvalue())


def _value_type(kind: pa.DataType) -> pa.DataType:
    return kind.value_type if pa.types.is_nested(kind) else kind


def _leaf(field: pa.Field) -> str:
    return f"{field.name}.list.element" if pa.types.is_nested(field.type) else str(field.name)


def restore(case: Mapping[str, Any], tracks: pa.Table, row: int, odd: Odd) -> Scenario:
    """Restore the stored part of a scenario: the stored vehicles, with positions rounded to float32.

    Args:
        case: The case's row of `schema.CASES`.
        tracks: Rows of `schema.TRACKS`.
        row: The case's row in `tracks`.
        odd: Road and rules of the library.
    """

    def values(name: str) -> NDArray[Any]:
        return cast("NDArray[Any]", tracks.column(name)[row].values.to_numpy(zero_copy_only=False))

    slot = values("slot")
    shape = (len(slot), -1)

    def series(column: Field) -> NDArray[Any]:
        flat = values(column.name).reshape(shape).T
        return np.ascontiguousarray(flat, dtype=np.float64 if column.type == "float32" else None)

    return Scenario(
        seed=case["seed"],
        test=case["test"],
        odd=odd,
        slot=slot,
        **{one.name: series(one.column) for one in SERIES},
        **{body.name: values(body.column.name) for body in BODY},
        action=np.ascontiguousarray(values("action").reshape(shape).T),
        critical_bv=values("critical_bv"),
        log_prob_nde=values("decision_log_prob_nde"),
        crash=Crash(time=case["crash_time_s"], slot_a=0, slot_b=case["bv_slot"]),
        hidden=int(case.get(HIDDEN_COLUMN) or 0),
        signals_s=None if odd.site is None or "start" not in tracks.column_names else float(values("start")[-1]),
    )


def script_of(scenario: Scenario, tracks: pa.Table, row: int) -> Script | None:
    """Restore the script of a scripted case; None for a test of a seed.

    Args:
        scenario: What `restore` gave.
        tracks, row: As for `restore`.

    Raises:
        FileFormatError: An earlier version wrote the start, of fewer numbers.
        InputError: What is stored is no script.
    """
    if "start" not in tracks.column_names:
        return None
    fields = tracks.column("start")[row].values.to_numpy(zero_copy_only=False).reshape(scenario.slot.size, -1)
    if fields.shape[1] < len(scripted.START_FIELDS):
        raise FileFormatError(f"Case {scenario.case_id} has a start of an earlier version; {MIGRATE}.")
    poses = None
    if "rails" in tracks.column_names:
        flat = tracks.column("rails")[row].values.to_numpy(zero_copy_only=False)
        poses = flat.reshape(-1, scenario.slot.size, POSE_NUMBERS).copy()
    return Script(scenario.slot, scripted.scripted_start(fields), scenario.action, scenario.seed, scenario.test, poses)
