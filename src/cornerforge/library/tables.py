"""Records to Arrow tables and Parquet bytes, and rows back to a `Scenario`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.library.record import CaseRecord
from cornerforge.library.schema import CASES, EXTRA_TYPES, SCRIPTED_TRACKS, TRACKS, arrow_schema
from cornerforge.sim.scripted import START_FIELDS, Script, scripted_start
from cornerforge.types import Crash, Odd, Scenario

__all__ = ["ROW_GROUP", "cases_table", "extra_kinds", "parquet_bytes", "restore", "script_of", "tracks_table"]

ROW_GROUP = 100
"""Cases in a row group of a tracks file: what the reading of one case has to unpack."""


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


def cases_table(records: Sequence[CaseRecord], extra: Mapping[str, str]) -> pa.Table:
    """Rows of `schema.CASES` and the caller's own columns.

    Raises:
        InputError: A record's own columns are not those of `extra`.
    """
    for record in records:
        kinds = extra_kinds(record)
        if kinds != dict(extra):
            raise InputError(
                f"Case {record.case_id} has the extra columns {kinds}, this library has {dict(extra)}; "
                "all cases need the same columns of the same types."
            )
    columns = [_column(column.type, [record.case[column.name] for record in records]) for column in CASES]
    columns += [pa.array([r.extra[name] for r in records], type=EXTRA_TYPES[kind]) for name, kind in extra.items()]
    return pa.Table.from_arrays(columns, schema=arrow_schema(CASES, extra))


def tracks_table(records: Sequence[CaseRecord]) -> pa.Table:
    """Rows of `schema.TRACKS`, or of `SCRIPTED_TRACKS` where all are scripted."""
    named = SCRIPTED_TRACKS if records and all(record.scripted for record in records) else TRACKS
    columns = [_column(column.type, [record.tracks[column.name] for record in records]) for column in named]
    return pa.Table.from_arrays(columns, schema=arrow_schema(named))


def _column(kind: pa.DataType, values: Sequence[Any]) -> pa.Array:
    """Lists are built from one flat buffer and offsets: an object per number would take a hundred times as long."""
    if pa.types.is_fixed_size_list(kind):
        return pa.FixedSizeListArray.from_arrays(pa.array(np.concatenate(values), type=kind.value_type), kind.list_size)
    if pa.types.is_list(kind):
        offsets = np.zeros(len(values) + 1, dtype=np.int32)
        np.cumsum([len(value) for value in values], out=offsets[1:])
        flat = pa.array(np.concatenate(values), type=kind.value_type)
        return pa.ListArray.from_arrays(pa.array(offsets), flat)
    return pa.array(values, type=kind)


def parquet_bytes(table: pa.Table, row_group: int | None = None) -> memoryview:
    """A table as a Parquet file in memory, zstd-compressed.

    Floats are split into byte planes first: the sign and exponent bytes of a trajectory hardly change, so they vanish.
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
    """The stored part of a scenario: the kept vehicles, positions rounded to float32 on storing.

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

    def real(name: str) -> NDArray[np.float64]:
        return np.ascontiguousarray(values(name).reshape(shape).T, dtype=np.float64)

    return Scenario(
        seed=case["seed"],
        test=case["test"],
        odd=odd,
        slot=slot,
        x=real("x_m"),
        y=real("y_m"),
        speed=real("speed_mps"),
        heading=real("heading_rad"),
        acceleration=real("acceleration_mps2"),
        target_lane=np.ascontiguousarray(values("target_lane").reshape(shape).T),
        present=np.ascontiguousarray(values("present").reshape(shape).T),
        action=np.ascontiguousarray(values("action").reshape(shape).T),
        critical_bv=values("critical_bv"),
        log_prob_nde=values("decision_log_prob_nde"),
        crash=Crash(time=case["crash_time_s"], slot_a=0, slot_b=case["bv_slot"]),
    )


def script_of(scenario: Scenario, tracks: pa.Table, row: int) -> Script | None:
    """The script of a scripted case, None for a test of a seed.

    Args:
        scenario: What `restore` gave.
        tracks, row: As for `restore`.

    Raises:
        InputError: What is stored is no script.
    """
    if "start" not in tracks.column_names:
        return None
    fields = tracks.column("start")[row].values.to_numpy(zero_copy_only=False)
    return Script(scenario.slot, scripted_start(fields.reshape(-1, len(START_FIELDS))), scenario.action)
