"""Checks of tables that were read: each column against its `fields.Field`, and relations between columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from cornerforge._arrow import arrow_type
from cornerforge.fields import Field

__all__ = ["Ragged", "Relation", "case_namer", "column_fault", "relation_fault", "table_fault", "values_of"]


@dataclass(frozen=True)
class Ragged:
    """A column of lists.

    Attributes:
        sizes: Length of each list, (n,).
        flat: All values, one list after the other.
    """

    sizes: NDArray[np.int64]
    flat: NDArray[Any]

    @property
    def row(self) -> NDArray[np.int64]:
        """The row of each value."""
        return np.repeat(np.arange(self.sizes.size), self.sizes)

    @property
    def first(self) -> NDArray[np.int64]:
        """Where the values of each row begin in `flat`."""
        return np.concatenate([[0], np.cumsum(self.sizes)[:-1]]).astype(np.int64)


Values = NDArray[Any] | Ragged


@dataclass(frozen=True)
class Relation:
    """Relation between columns of a row, given facts of the file.

    Attributes:
        column: The column that is named where it does not hold.
        must: What that column must be: completes "it must be ...".
        needs: Columns that must be there for the check.
        holds: Says of each row whether it holds, (n,), from the columns by name and the facts of the file.
    """

    column: str
    must: str
    needs: tuple[str, ...]
    holds: Callable[[Mapping[str, Any], Any], NDArray[np.bool_]]


def values_of(column: pa.ChunkedArray) -> Values:
    """Give a column's values; NaN for null numbers, "" for null texts, no value for null lists."""
    kind = column.type
    if pa.types.is_fixed_size_list(kind):
        return Ragged(np.full(len(column), kind.list_size), _plain(pc.list_flatten(column)))
    if pa.types.is_list(kind):
        sizes = pc.list_value_length(column).fill_null(0).to_numpy().astype(np.int64)
        return Ragged(sizes, _plain(pc.list_flatten(column)))
    return _plain(column)


def _plain(column: pa.ChunkedArray) -> NDArray[Any]:
    if pa.types.is_string(column.type):
        return np.asarray(column.fill_null("").to_numpy(zero_copy_only=False))
    return np.asarray(column.to_numpy(zero_copy_only=False))


def _told(value: Any) -> str:
    return repr(value.item() if isinstance(value, np.generic) else value)


def column_fault(column: pa.ChunkedArray, field: Field, name_of: Callable[[int], str]) -> str | None:
    """Say what is wrong with a column, or None: its type, a missing value, NaN, infinity, a value out of range.

    Args:
        column: The values.
        field: What it must be.
        name_of: Names a row.
    """
    wanted = arrow_type(field.type)
    if not _same_type(column.type, wanted):
        return f'the column "{field.name}" is of type {column.type}; it must be {field.type}'
    if column.null_count and not field.nullable:
        row = int(np.flatnonzero(column.is_null().to_numpy())[0])
        return f'"{field.name}" of {name_of(row)} is missing; it must be {_must(field)}'
    values = values_of(column)
    flat = values.flat if isinstance(values, Ragged) else values
    if not isinstance(values, Ragged) and column.null_count:
        flat = np.where(column.is_null().to_numpy(), np.nan, flat) if flat.dtype.kind in "if" else flat
    if flat.dtype.kind not in "if":
        return None
    wrong = _wrong(flat, field)
    if not isinstance(values, Ragged) and column.null_count:
        wrong &= ~column.is_null().to_numpy()  # NaN stands for what is missing, which it may be
    if not wrong.any():
        return None
    place = int(np.flatnonzero(wrong)[0])
    row, where = place, ""
    if isinstance(values, Ragged):
        row = int(values.row[place])
        where = f"[{place - int(values.first[row])}]"
    return f'"{field.name}"{where} of {name_of(row)} is {_told(flat[place])}; it must be {_must(field)}'


def _same_type(found: pa.DataType, wanted: pa.DataType) -> bool:
    """Compare types; the name that a writer gave to a list's values is free."""
    if pa.types.is_fixed_size_list(wanted):
        if not pa.types.is_fixed_size_list(found) or found.list_size != wanted.list_size:
            return False
        return bool(found.value_type == wanted.value_type)
    if pa.types.is_list(wanted):
        return pa.types.is_list(found) and bool(found.value_type == wanted.value_type)
    return bool(found == wanted)


def _wrong(flat: NDArray[Any], field: Field) -> NDArray[np.bool_]:
    if flat.dtype.kind == "i":
        low, high = field.within or (-np.inf, np.inf)
        wrong: NDArray[np.bool_] = (flat < low) | (flat > high)
        return wrong
    low, high = field.within or (np.finfo(np.float64).min, np.finfo(np.float64).max)
    nan = np.isnan(flat)
    wrong = ~nan & ((flat < low) | (flat > high))
    return wrong if field.nan else wrong | nan


def _must(field: Field) -> str:
    if field.allowed:
        return f"{field.allowed} {field.unit}".rstrip()
    if "float" in field.type:
        return "finite" if field.within is None else "a number"
    return field.type


def relation_fault(
    values: Mapping[str, Any], relations: Sequence[Relation], facts: Any, name_of: Callable[[int], str]
) -> str | None:
    """Say which relation does not hold, and of which row; or None. A relation of columns that are not there is skipped.

    Args:
        values: Columns by name, as of `values_of`.
        relations: In the order in which they are looked at: a later one may rely on an earlier one.
        facts: For `Relation.holds`.
        name_of: Names a row.
    """
    for relation in relations:
        if not values.keys() >= {relation.column, *relation.needs}:
            continue
        wrong = np.flatnonzero(~relation.holds(values, facts))
        if wrong.size:
            row, value = int(wrong[0]), values[relation.column]
            if isinstance(value, Ragged):
                is_there = f"has {value.sizes[row]} values"
            elif value.dtype.kind == "f" and np.isnan(value[row]):
                is_there = "is missing"
            else:
                is_there = f"is {_told(value[row])}"
            return f'"{relation.column}" of {name_of(row)} {is_there}; it must be {relation.must}'
    return None


def case_namer(table: pa.Table) -> Callable[[int], str]:
    """Make what names a row of a table in messages: with its `case_id`, if it has one."""
    ids = table.column("case_id") if "case_id" in table.column_names else None
    return lambda row: f"row {row}" if ids is None else f"row {row} (case {ids[row].as_py()})"


def table_fault(
    table: pa.Table,
    fields: Sequence[Field],
    relations: Sequence[Relation] = (),
    facts: Any = None,
    name_of: Callable[[int], str] = "row {}".format,
) -> str | None:
    """Say the first thing that is wrong with a table, or None; columns that `fields` does not name are passed over.

    Args:
        table: Some or all of the columns.
        fields: What each column must be.
        relations: Between them.
        facts: For `Relation.holds`.
        name_of: Names a row.
    """
    for field in fields:
        if field.name in table.column_names:
            fault = column_fault(table.column(field.name), field, name_of)
            if fault is not None:
                return fault
    values = {name: values_of(table.column(name)) for name in table.column_names}
    return relation_fault(values, relations, facts, name_of)
