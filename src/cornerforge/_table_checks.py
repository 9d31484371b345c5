"""Checksums of tables by column and by row, in the metadata of a Parquet file, so that a changed cell can be named.

The checksums are CRC-32 of the values, not of the file's bytes: they stay true when another program writes the same
values again and keeps the metadata.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cornerforge._checksums import NoChecksumError
from cornerforge._files import check_regular, writing
from cornerforge.errors import FileFormatError

__all__ = ["TableChecks", "read_parquet", "with_checks", "write_parquet"]

_KEY = b"cornerforge_checks"
_NULL = -1

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class _Cells:
    """The values of a column as bytes.

    Attributes:
        fixed: One row of bytes a cell: its validity and value; of texts and lists their length, -1 for null. (n, b).
        flat: Bytes of texts and lists, one after the other.
        ends: Where each of them ends in `flat`, (n + 1,), the first 0; None: the column is of fixed size.
    """

    fixed: Bytes
    flat: Bytes
    ends: NDArray[np.int64] | None

    def checksum(self) -> int:
        """CRC-32 of the whole column."""
        return zlib.crc32(self.flat.data, zlib.crc32(np.ascontiguousarray(self.fixed).data))


def _as_bytes(values: NDArray[Any], rows: int) -> Bytes:
    return np.ascontiguousarray(values).view(np.uint8).reshape(rows, -1) if rows else np.zeros((0, 1), np.uint8)


def _numbers(values: pa.Array) -> NDArray[Any]:
    """Give numbers, 0 for null."""
    kind = values.type
    filled = values.fill_null(False if pa.types.is_boolean(kind) else 0) if values.null_count else values
    return np.ascontiguousarray(filled.to_numpy(zero_copy_only=False))


def _is_known(kind: pa.DataType) -> bool:
    """Is it a type of cells that have checksums?"""
    if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        return _is_known(kind.value_type) and not pa.types.is_nested(kind.value_type)
    return bool(
        pa.types.is_boolean(kind) or pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_string(kind)
    )


def _text(values: pa.StringArray) -> Bytes:
    """Give the bytes of texts, one after the other."""
    filled = (values.fill_null("") if values.null_count else values).cast(pa.large_string())
    _, places, data = filled.buffers()
    if data is None:
        return np.zeros(0, np.uint8)
    ends = np.frombuffer(places, np.int64)[filled.offset : filled.offset + len(filled) + 1]
    return np.frombuffer(data, np.uint8)[ends[0] : ends[-1]] if ends.size else np.zeros(0, np.uint8)


def _cells(column: pa.ChunkedArray) -> _Cells:
    values, kind, rows = column.combine_chunks(), column.type, len(column)
    if isinstance(values, pa.ChunkedArray):  # of no chunk at all
        values = pa.array([], kind)
    nothing = np.zeros(0, np.uint8)
    valid = values.is_valid().to_numpy(zero_copy_only=False).astype(np.uint8)
    if pa.types.is_fixed_size_list(kind):
        numbers = _numbers(values.fill_null([0] * kind.list_size).flatten() if values.null_count else values.flatten())
        return _Cells(np.hstack([valid[:, None], _as_bytes(numbers, rows)]), nothing, None)
    if pa.types.is_list(kind) or pa.types.is_string(kind):
        if pa.types.is_list(kind):
            sizes, inner = pc.list_value_length(values), _numbers(values.flatten())
            width = inner.dtype.itemsize
            flat = inner.view(np.uint8).reshape(-1)
        else:
            sizes, width, flat = pc.binary_length(values), 1, _text(values)
        lengths = sizes.fill_null(_NULL).to_numpy(zero_copy_only=False).astype("<i4")
        ends = np.zeros(rows + 1, np.int64)
        np.cumsum(np.maximum(lengths, 0) * width, out=ends[1:])
        return _Cells(_as_bytes(lengths, rows), flat, ends)
    return _Cells(np.hstack([valid[:, None], _as_bytes(_numbers(values), rows)]), nothing, None)


def _row_checksums(cells: Mapping[str, _Cells], rows: int) -> NDArray[np.uint32]:
    """CRC-32 of each row over all columns, in the order of their names."""
    columns = [cells[name] for name in sorted(cells)]
    fixed = np.ascontiguousarray(np.hstack([column.fixed for column in columns])) if columns else np.zeros((rows, 0))
    found = [zlib.crc32(row.data) for row in fixed]
    for column in columns:
        if column.ends is not None:
            flat, ends = column.flat.data, column.ends.tolist()
            found = [zlib.crc32(flat[ends[i] : ends[i + 1]], crc) for i, crc in enumerate(found)]
    return np.array(found, dtype="<u4")


def with_checks(table: pa.Table) -> pa.Table:
    """Add the checksums of a table to its metadata; columns are numbers, texts, and lists of numbers."""
    cells = {name: _cells(table.column(name)) for name in table.column_names}
    stated = {
        "columns": {name: f"{column.checksum():08x}" for name, column in cells.items()},
        "rows": base64.b64encode(_row_checksums(cells, table.num_rows).tobytes()).decode(),
    }
    return table.replace_schema_metadata({**(table.schema.metadata or {}), _KEY: json.dumps(stated).encode()})


@dataclass(frozen=True)
class TableChecks:
    """The checksums that a table carries.

    Attributes:
        columns: CRC-32 of each column, hex.
        rows: CRC-32 of each row, (n,).
    """

    columns: Mapping[str, str]
    rows: NDArray[np.uint32]

    @classmethod
    def of(cls, schema: pa.Schema) -> TableChecks | None:
        """Read the checksums of a table; None where it carries none.

        Raises:
            ValueError: They are damaged.
        """
        text = (schema.metadata or {}).get(_KEY)
        if text is None:
            return None
        try:
            stated = json.loads(text)
            columns = {str(name): str(value) for name, value in stated["columns"].items()}
            return cls(columns, np.frombuffer(base64.b64decode(stated["rows"], validate=True), dtype="<u4"))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"its checksums are damaged ({error})") from error

    def lost(self, schema: pa.Schema) -> str | None:
        """Say which column that was written is not in the file; or None."""
        lost = sorted(self.columns.keys() - set(schema.names))
        return f"has lost the column {lost[0]}" if lost else None

    def fault(self, table: pa.Table) -> str | None:
        """Say which column of a table, which may hold a part of the columns, is not as it was written; or None.

        With all columns the row is named as well.
        """
        if table.num_rows != self.rows.size:
            return f"holds {table.num_rows} rows, {self.rows.size} were written"
        for name in table.column_names:
            if name not in self.columns or not _is_known(table.schema.field(name).type):
                return f'holds a column "{name}" of type {table.schema.field(name).type}, which was not written'
        cells = {name: _cells(table.column(name)) for name in table.column_names}
        wrong = [name for name in cells if f"{cells[name].checksum():08x}" != self.columns[name]]
        if not wrong:
            return None
        changed = f"has been changed in {'the columns' if len(wrong) > 1 else 'the column'} {', '.join(wrong[:5])}"
        if cells.keys() != self.columns.keys():
            return changed
        rows = np.flatnonzero(_row_checksums(cells, table.num_rows) != self.rows)
        if not rows.size:
            return changed
        more = f" and {rows.size - 1} more" if rows.size > 1 else ""
        return f"{changed}, row {int(rows[0])}{more}"

    def row_fault(self, table: pa.Table, first: int) -> str | None:
        """Say which of some rows is not as it was written; or None.

        Args:
            table: All columns of these rows.
            first: The row of the file that comes first in it.
        """
        known = all(_is_known(field.type) for field in table.schema)
        if not known or set(table.column_names) != set(self.columns):
            return "has other columns than were written"
        cells = {name: _cells(table.column(name)) for name in table.column_names}
        there = self.rows[first : first + table.num_rows]
        found = _row_checksums(cells, table.num_rows)
        wrong = [0] if there.size != found.size else np.flatnonzero(found != there).tolist()
        return f"has been changed in row {first + wrong[0]}" if wrong else None


def write_parquet(path: Path, table: pa.Table) -> None:
    """Write a table with its checksums as a Parquet file, whole or not at all.

    Raises:
        OutputError: It cannot be written.
    """
    # Arrow gets an open file: it reads a path like run-10:30 as an address, and ~ as the home folder.
    with writing(path) as part, part.open("wb") as file:
        pq.write_table(with_checks(table), file)


def read_parquet(path: Path, command: str, columns: Sequence[str] | None = None, *, fewer: bool = False) -> pa.Table:
    """Read a table that `write_parquet` wrote.

    Args:
        path: The file.
        command: What writes it, for messages.
        columns: Columns to read; None: all.
        fewer: Leave out fields that the file lacks, instead of refusing it.

    Raises:
        FileFormatError: It is missing, damaged or changed, or lacks a column.
        NoChecksumError: It carries no checksums.
    """
    advice = f"write it again with: {command}"
    if not path.exists():
        raise FileFormatError(f"{path} is missing; write it with: {command}")
    try:
        check_regular(path)
        with path.open("rb") as file:
            whole = pq.ParquetFile(file)
            missing = [name for name in columns or () if name not in whole.schema_arrow.names]
            if missing and not fewer:
                raise FileFormatError(f"{path} lacks the column(s) {', '.join(missing)}; {advice}")
            chosen = None if columns is None else [name for name in columns if name not in missing]
            table, checks = whole.read(chosen), TableChecks.of(whole.schema_arrow)
            fault = None if checks is None else checks.lost(whole.schema_arrow) or checks.fault(table)
    except (pa.ArrowException, OSError, ValueError, KeyError, MemoryError) as error:
        raise FileFormatError(f"{path} is damaged ({error}); {advice}") from None
    if checks is None:
        raise NoChecksumError(path)
    if fault is not None:
        raise FileFormatError(f"{path} {fault} since it was written; {advice}")
    return table
