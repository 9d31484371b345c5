"""Lists of `fields.py` as Arrow schemas, for all modules that write tables."""

from __future__ import annotations

import functools
from collections.abc import Iterable

import pyarrow as pa

from cornerforge.fields import Field

__all__ = ["arrow_field", "arrow_fields", "arrow_type"]


@functools.cache
def arrow_type(name: str) -> pa.DataType:
    """Translate a type's name (`fields.Field.type`) to Arrow's type.

    >>> arrow_type("list of int8"), arrow_type("float32[128]")
    (ListType(list<item: int8>), FixedSizeListType(fixed_size_list<item: float>[128]))
    """
    if name.startswith("list of "):
        return pa.list_(arrow_type(name.removeprefix("list of ")))
    if name.endswith("]"):
        kind, _, size = name[:-1].partition("[")
        return pa.list_(arrow_type(kind), int(size))
    return pa.type_for_alias(name)


@functools.cache
def arrow_field(column: Field) -> pa.Field:
    """Make Arrow's field of a column, with unit and meaning as metadata."""
    about = {"unit": column.unit, "meaning": column.meaning} if column.unit else {"meaning": column.meaning}
    return pa.field(column.name, arrow_type(column.type), metadata=about)


def arrow_fields(columns: Iterable[Field]) -> list[pa.Field]:
    """Make Arrow's fields of several columns."""
    return [arrow_field(column) for column in columns]
