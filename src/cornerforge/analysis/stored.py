"""Tables that an analysis wrote, as its readers take them: their columns, and what must hold of them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cornerforge._table_checks import read_parquet
from cornerforge._values import Relation, case_namer, table_fault
from cornerforge.analysis.avoidability import AVOIDABILITY_COLUMNS, LABELS
from cornerforge.analysis.case_table import VALUE_COLUMNS
from cornerforge.analysis.conduct import CONDUCT_COLUMNS, CONDUCTS
from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.analysis.fault import FAULT_COLUMNS, FAULTS
from cornerforge.analysis.measures import MEASURES
from cornerforge.analysis.prevented import PREVENTED_COLUMNS
from cornerforge.errors import FileFormatError
from cornerforge.fields import SHORTFALL, Field
from cornerforge.results.analysis import Analysed
from cornerforge.results.reading import open_json

__all__ = ["CASES_FILE", "CASE_COLUMNS", "POINTS_FILE", "POINT_COLUMNS", "WITNESSES_FILE", "read_analysed"]

CASES_FILE = "cases.parquet"
"""Name of the table with all measures of each case."""
POINTS_FILE = "points.parquet"
"""Name of the table with the place and the kind of each case."""
WITNESSES_FILE = "witnesses.parquet"
"""Name of the table with the ways out of the cases that were looked at."""

_CASE_ID = re.compile(r"[0-9]+:[0-9]+")
_PLANE = (-1e9, 1e9)
POINT_COLUMNS: tuple[Field, ...] = (
    Field("case_id", "string", "", "Name of the case, seed:test."),
    Field("pc1", "float64", "", "Along the first principal component.", _PLANE),
    Field("pc2", "float64", "", "Along the second principal component.", _PLANE),
    Field("group", "string", "", "majority or minority."),
    Field("cluster", "int64", "", "Its cluster, as analysis.json numbers them.", (0, 2**31 - 1)),
    Field("crash_type", "string", "", f"{', '.join(CRASH_TYPES.values())}."),
)
"""Columns of `points.parquet`."""

_WAY = [column.name for column in AVOIDABILITY_COLUMNS if column.name.startswith("witness_")]
CASE_COLUMNS: tuple[Field, ...] = (
    *POINT_COLUMNS, *MEASURES, *FAULT_COLUMNS, *CONDUCT_COLUMNS, *PREVENTED_COLUMNS,
    *(column for column in AVOIDABILITY_COLUMNS[1:] if column.name not in _WAY),
    *SHORTFALL, *VALUE_COLUMNS,
)  # fmt: skip
"""Columns of `cases.parquet`; analyses of earlier versions have fewer."""

_COLUMNS = {CASES_FILE: CASE_COLUMNS, POINTS_FILE: POINT_COLUMNS, WITNESSES_FILE: AVOIDABILITY_COLUMNS}


def _one_of(column: str, known: Sequence[str], *, or_null: bool = False) -> Relation:
    allowed = [*known, *([""] if or_null else [])]  # null reads as ""
    return Relation(column, f"one of: {', '.join(known)}", (), lambda v, _: np.isin(v[column].astype(np.str_), allowed))


def _as_long_as(column: str, other: str) -> Relation:
    return Relation(column, f"as long as {other}", (other,), lambda v, _: v[column].sizes == v[other].sizes)


def _there_with(column: str) -> Callable[[Mapping[str, Any], Any], NDArray[np.bool_]]:
    return lambda v, _: (v[column].sizes > 0) == np.isfinite(v["latest_any_s"].astype(np.float64))


def _named(v: Mapping[str, Any], _: Any) -> NDArray[np.bool_]:
    ids = v["case_id"].astype(np.str_)
    _, first = np.unique(ids, return_index=True)
    is_first = np.zeros(ids.size, np.bool_)
    is_first[first] = True
    return is_first & np.array([_CASE_ID.fullmatch(one) is not None for one in ids.tolist()], np.bool_)


_RELATIONS: tuple[Relation, ...] = (
    Relation("case_id", "seed:test, of one row only", (), _named),
    _one_of("group", ("majority", "minority")),
    _one_of("crash_type", tuple(CRASH_TYPES.values())),
    _one_of("fault", FAULTS),
    _one_of("conduct", tuple(CONDUCTS)),
    _one_of("avoidability", tuple(LABELS), or_null=True),
    *(_as_long_as(name, "witness_x_m") for name in ("witness_y_m", "witness_speed_mps", "witness_heading_rad")),
    _as_long_as("witness_lane", "witness_acceleration_mps2"),
    *(
        Relation(name, "there where latest_any_s is, and only there", ("latest_any_s",), _there_with(name))
        for name in ("witness_x_m", "witness_lane")
    ),
)


def read_analysed(file: Path, command: str, columns: Sequence[str] | None = None, *, fewer: bool = False) -> pa.Table:
    """Read a table of an analysis and check its values, also against the `analysis.json` beside it, if that is there.

    Args:
        file: The table: one of the three above.
        command: What writes it again, for messages.
        columns: Columns to read; None: all.
        fewer: Leave out those that the table lacks, instead of refusing it.

    Raises:
        FileFormatError: The table is missing, damaged or changed, lacks a column, holds a value that cannot be, or
            other cases than `analysis.json` counts.
    """
    said = file.with_name("analysis.json")
    table = read_parquet(file, command, columns, fewer=fewer)
    fault = table_fault(table, _COLUMNS[file.name], _RELATIONS, name_of=case_namer(table))
    if fault is None and said.exists():
        found = open_json(said, command).read(Analysed)
        fault = _witnesses_fault(table, found) if file.name == WITNESSES_FILE else _count_fault(table, found)
    if fault is not None:
        raise FileFormatError(f"{file}: {fault}; write it again with: {command}")
    return table


def _witnesses_fault(table: pa.Table, found: Analysed) -> str | None:
    """Say whether there are too few or too many; the most valuable cases are looked at besides those that count."""
    least = 0 if found.avoidability is None else found.avoidability.cases
    if least <= table.num_rows <= found.cases:
        return None
    return f"it holds {table.num_rows} cases, the analysis.json beside it says {least} to {found.cases}"


def _count_fault(table: pa.Table, found: Analysed) -> str | None:
    """Say where a table with a row for each case and `analysis.json` count differently; or None."""
    if table.num_rows != found.cases:
        return f"it holds {table.num_rows} cases, the analysis.json beside it says {found.cases}"
    counts: dict[str, Mapping[Any, int]] = {
        "crash_type": found.crash_types,
        "cluster": {one.id: one.size for one in found.clusters},
        "fault": dict(found.fault),
    }
    if found.own_doing is not None:
        counts["conduct"] = found.own_doing.conducts
    for column, said in counts.items():
        if column not in table.column_names:
            continue
        there = Counter(table.column(column).to_pylist())
        for value in {*said, *there}:
            if there[value] != said.get(value, 0):
                return (
                    f'"{column}" is {value} in {there[value]} case(s), the analysis.json beside it says '
                    f"{said.get(value, 0)}"
                )
    return None
