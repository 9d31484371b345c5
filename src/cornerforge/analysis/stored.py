"""Tables that an analysis wrote, as its readers take them: their columns, and what must hold of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa

from cornerforge._table_checks import read_parquet
from cornerforge._values import table_fault
from cornerforge.analysis.avoidability import AVOIDABILITY_COLUMNS
from cornerforge.analysis.case_table import MECHANISM, VALUE_COLUMNS
from cornerforge.analysis.conduct import CONDUCT_COLUMNS
from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.analysis.fault import FAULT_COLUMNS
from cornerforge.analysis.measures import MEASURES
from cornerforge.analysis.prevented import PREVENTED_COLUMNS
from cornerforge.errors import FileFormatError
from cornerforge.fields import SHORTFALL, Field
from cornerforge.results.analysis import Analysed
from cornerforge.results.stating import from_file

__all__ = ["CASES_FILE", "CASE_COLUMNS", "POINTS_FILE", "POINT_COLUMNS", "WITNESSES_FILE", "read_analysed"]

CASES_FILE = "cases.parquet"
"""Name of the table with all measures of each case."""
POINTS_FILE = "points.parquet"
"""Name of the table with the place and the kind of each case."""
WITNESSES_FILE = "witnesses.parquet"
"""Name of the table with the ways out of the cases that were looked at."""

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
    *POINT_COLUMNS, MECHANISM, *MEASURES, *FAULT_COLUMNS, *CONDUCT_COLUMNS, *PREVENTED_COLUMNS,
    *(column for column in AVOIDABILITY_COLUMNS[1:] if column.name not in _WAY),
    *SHORTFALL, *VALUE_COLUMNS,
)  # fmt: skip
"""Columns of `cases.parquet`; analyses of earlier versions have fewer."""

_COLUMNS = {CASES_FILE: CASE_COLUMNS, POINTS_FILE: POINT_COLUMNS, WITNESSES_FILE: AVOIDABILITY_COLUMNS}


def read_analysed(file: Path, command: str, columns: Sequence[str] | None = None, *, fewer: bool = False) -> pa.Table:
    """Read a table of an analysis and check its values, and its rows against the `analysis.json` beside it, if there.

    Args:
        file: The table: one of the three above.
        command: What writes it again, for messages.
        columns: Columns to read; None: all.
        fewer: Leave out fields that the table lacks, instead of refusing it.

    Raises:
        FileFormatError: The table is missing, damaged or changed, lacks a column, holds a value out of its range, or
            another number of cases than `analysis.json` says: a call that was killed left the one or the other.
    """
    said = file.with_name("analysis.json")
    table = read_parquet(file, command, columns, fewer=fewer)
    fault = table_fault(table, _COLUMNS[file.name])
    if fault is None and file.name != WITNESSES_FILE and said.exists():
        cases = from_file(Analysed, said, command).cases
        if table.num_rows != cases:
            fault = f"it holds {table.num_rows} cases, the analysis.json beside it says {cases}"
    if fault is not None:
        raise FileFormatError(f"{file}: {fault}; write it again with: {command}")
    return table
