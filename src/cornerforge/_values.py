"""Checks of tables that were read: each column against its `fields.Field`."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from cornerforge._arrow import arrow_type
from cornerforge.fields import Field

__all__ = ["column_fault", "table_fault"]

_LARGEST = float(np.finfo(np.float64).max)


def column_fault(column: pa.ChunkedArray, field: Field, name_of: Callable[[int], str]) -> str | None:
    """Say what is wrong with a column, or None: its type, a missing value, NaN, infinity, a value out of range.

    Args:
        column: The values; values of lists are checked one by one. The name of a list's values in its type is free.
        field: What it must be.
        name_of: Names a row.
    """
    if column.type != arrow_type(field.type):
        return f'the column "{field.name}" is of type {column.type}; it must be {field.type}'
    if column.null_count and not field.nullable:
        row = int(np.flatnonzero(column.is_null().to_numpy())[0])
        return f'"{field.name}" of {name_of(row)} is missing; it must be {_must(field)}'
    has_lists = pa.types.is_nested(column.type)
    flat = pc.list_flatten(column) if has_lists else column
    missing = flat.is_null().to_numpy()
    wrong = missing & has_lists
    if pa.types.is_integer(flat.type) or pa.types.is_floating(flat.type):
        values = flat.to_numpy()
        low, high = field.within or (-_LARGEST, _LARGEST)
        outside = ~((values >= low) & (values <= high))
        wrong |= outside & ~missing & ~(np.isnan(values) & field.nan)
    if not wrong.any():
        return None
    place = row = int(np.flatnonzero(wrong)[0])
    where = ""
    if has_lists:
        rows = pc.list_parent_indices(column.combine_chunks()).to_numpy()
        row = int(rows[place])
        where = f"[{place - int(np.searchsorted(rows, row))}]"
    found = "missing" if missing[place] else repr(values[place].item())
    return f'"{field.name}"{where} of {name_of(row)} is {found}; it must be {_must(field)}'


def _must(field: Field) -> str:
    if field.allowed:
        return f"{field.allowed} {field.unit}".rstrip()
    if "float" in field.type:
        return "finite" if field.within is None else "a number"
    return field.type


def table_fault(table: pa.Table, fields: Iterable[Field]) -> str | None:
    """Say the first thing that is wrong with a table, or None; columns that `fields` does not name are passed over.

    Args:
        table: Some or all of the columns; messages name a row with its `case_id`, if there is one.
        fields: What each column must be.
    """
    ids = table.column("case_id") if "case_id" in table.column_names else None

    def name_of(row: int) -> str:
        return f"row {row}" if ids is None else f"row {row} (case {ids[row].as_py()})"

    there = (field for field in fields if field.name in table.column_names)
    return next(filter(None, (column_fault(table.column(one.name), one, name_of) for one in there)), None)
