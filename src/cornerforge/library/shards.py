"""Writing of shards, and reading of shards that are undamaged."""

from __future__ import annotations

import hashlib
import math
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from cornerforge._arrow import arrow_field
from cornerforge._files import check_regular, reason
from cornerforge._table_checks import TableChecks, with_checks
from cornerforge._values import values_of
from cornerforge.errors import FileFormatError, InputError
from cornerforge.fields import BODY, CASES, PARTNER, SHORTFALL, TRACKS
from cornerforge.library.manifest import Manifest, Shard, StoredFile, replace_file, shard_names
from cornerforge.library.record import CaseRecord, extra_kinds
from cornerforge.library.schema import EXTRA_TYPES, own_fields
from cornerforge.library.tables import ROW_GROUP, parquet_bytes
from cornerforge.library.values import ShardFacts, cases_fault, tracks_fault

__all__ = [
    "DamagedShardWarning",
    "EncodedShard",
    "ShardReader",
    "Tracks",
    "encode_shard",
    "encode_tables",
    "joined",
    "write_shard",
]


_LATER = (*SHORTFALL, *PARTNER)
"""Columns of cases that early libraries lack."""
_LATER_TRACKS = tuple({body.column.name for body in BODY[first:]} for first in (0, 3))
"""Columns of tracks that early libraries lack together; what is on rails is not so old."""


class DamagedShardWarning(UserWarning):
    """A file of a shard is missing or not what was written; its cases are left out."""


@dataclass(frozen=True)
class EncodedShard:
    """A shard in memory, ready to be written.

    Attributes:
        cases: How many.
        seeds: Seeds of the cases, as a set; one in an undamaged library.
        first_test, last_test: Its first and last test.
        ascending: Each test is larger than the one before.
        extra: The caller's own columns, name to a key of `schema.EXTRA_TYPES`.
        contents: The two files.
        sha256: Their checksums, hex.
    """

    cases: int
    seeds: frozenset[int]
    first_test: int
    last_test: int
    ascending: bool
    extra: Mapping[str, str]
    contents: tuple[memoryview, memoryview]
    sha256: tuple[str, str]


def encode_tables(cases: pa.Table, tracks: pa.Table, extra: Mapping[str, str]) -> EncodedShard:
    """Pack tables for `CaseLibrary.append_shard`; slow, but without the GIL, so that threads can do it in parallel.

    Args:
        cases: Rows of `schema.CASES` and the caller's own columns, at least one.
        tracks: As many rows of `schema.TRACKS`, of the same cases.
        extra: The caller's own columns, name to a key of `schema.EXTRA_TYPES`.
    """
    # In one piece, so that the bytes do not depend on how the rows came together.
    tables = (with_checks(cases.combine_chunks()), with_checks(tracks.combine_chunks()))
    contents = (parquet_bytes(tables[0]), parquet_bytes(tables[1], ROW_GROUP))
    hashes = [hashlib.sha256(content).hexdigest() for content in contents]
    tests = cases.column("test").to_numpy()
    seeds = frozenset(np.unique(cases.column("seed").to_numpy()).tolist())
    ascending = bool((np.diff(tests) > 0).all())
    ends = int(tests[0]), int(tests[-1])
    return EncodedShard(len(tests), seeds, *ends, ascending, dict(extra), contents, (hashes[0], hashes[1]))


def joined(cases: Sequence[CaseRecord], extra: Mapping[str, str]) -> tuple[pa.Table, pa.Table]:
    """Give the tables of at least one record: cases with the caller's own columns, and tracks.

    Raises:
        InputError: A record's own columns are not those of `extra`.
    """
    for record in cases:
        kinds = extra_kinds(record)
        if kinds != dict(extra):
            raise InputError(
                f"Case {record.case_id} has the extra columns {kinds}, this library has {dict(extra)}; "
                "all cases need the same columns of the same types."
            )
    rows = pa.concat_tables([record.cases for record in cases])
    for name, kind in extra.items():
        rows = rows.append_column(name, pa.array([record.extra[name] for record in cases], EXTRA_TYPES[kind]))
    return rows, pa.concat_tables([record.tracks for record in cases])


def encode_shard(cases: Sequence[CaseRecord], extra: Mapping[str, str]) -> EncodedShard:
    """Pack at least one record; errors as of `joined`."""
    return encode_tables(*joined(cases, extra), extra)


def write_shard(folder: Path, index: int, shard: EncodedShard, *, growing: bool = False) -> Shard:
    """Write the two files of a shard; it counts only when a manifest that lists it is committed.

    Args:
        folder: Folder of the library.
        index: Index of the shard.
        shard: Its content.
        growing: Use the second pair of names (`shard_names`).

    Raises:
        OutputError: The folder cannot be written.
    """
    files = []
    for name, content, sha256 in zip(shard_names(index, growing=growing), shard.contents, shard.sha256, strict=True):
        replace_file(folder / name, content)
        files.append(StoredFile(name, content.nbytes, sha256))
    return Shard(shard.cases, shard.first_test, shard.last_test, *files)


class Tracks:
    """The trajectories of an undamaged shard.

    Args:
        file: Its file.
        checks: The checksums that the file carries, if any.
        found: Is told what is wrong with the rows that are read, None for nothing; says whether they may be used.
    """

    def __init__(
        self, file: pq.ParquetFile, checks: TableChecks | None, found: Callable[[pa.Table, int, str | None], bool]
    ) -> None:
        self._file, self._checks, self._found = file, checks, found

    def all(self) -> pa.Table | None:
        """Read all cases; None if something is wrong with them."""
        table = self._file.read()
        fault = None if self._checks is None else self._checks.fault(table)
        return table if self._found(table, 0, fault) else None

    def case(self, row: int) -> pa.Table | None:
        """Read the case of a row, as a table of one row; None if something is wrong with it."""
        table = self._file.read_row_group(row // ROW_GROUP).slice(row % ROW_GROUP, 1).combine_chunks()
        fault = None if self._checks is None else self._checks.row_fault(table, row)
        return table if self._found(table, row, fault) else None


class ShardReader:
    """Reads the files of a library; a damaged file is named once, in `damaged` and by a warning, and then skipped.

    Attributes:
        damaged: File name to what is wrong with it.
        own_columns: The caller's own columns, name to a key of `schema.EXTRA_TYPES`, as the manifest says.
    """

    def __init__(self, folder: Path, manifest: Manifest) -> None:
        self.damaged: dict[str, str] = {}
        self.own_columns: Mapping[str, str] = manifest.extra or {}
        self._folder, self._odd = folder, manifest.odd
        self._seed = int(str(manifest.run["seed"]))
        self._scripted, self._on_rails = manifest.scripted, manifest.on_rails
        self._last_tracks: tuple[str, pa.Buffer, pq.FileMetaData] | None = None
        self._checked: set[tuple[str, tuple[str, ...] | None]] = set()

    def check_sizes(self, shards: Iterable[Shard]) -> None:
        """Look for files that are missing or truncated; checksums are compared when a file is read."""
        for shard in shards:
            for file in (shard.cases_file, shard.tracks_file):
                path = self._folder / file.name
                size = path.stat().st_size if path.is_file() else None
                if size is None:
                    self._note(file.name, "is missing")
                elif size != file.size:
                    self._note(file.name, self._difference(path) or f"has {size} of {file.size} bytes")

    def _difference(self, path: Path) -> str | None:
        """Find where a file of another size has been changed, if it can be read."""
        try:
            return _where(_arrow_bytes(path))
        except OSError as error:
            return f"cannot be read ({reason(error)})"

    def read(self, file: StoredFile) -> pa.Buffer | None:
        """Give a file's content if it is undamaged, else None. The bytes checked are the bytes parsed.

        The memory is Arrow's own. One of its threads may be the last to release it, and to free a Python object a
        thread needs the GIL: if the interpreter is ending by then, the process aborts.
        """
        if file.name in self.damaged:
            return None
        try:
            content = _arrow_bytes(self._folder / file.name)
        except OSError as error:
            self._note(file.name, f"cannot be read ({reason(error)})")
            return None
        fault = file.fault(memoryview(content))
        if fault is not None:
            self._note(file.name, _where(content) or fault)
            return None
        return content

    def cases(self, shard: Shard, columns: Sequence[str] | None) -> pa.Table | None:
        """Read columns (None: all) of a shard's cases, or None if the file is damaged.

        Raises:
            FileFormatError: A value is not what `fields.CASES` and `values.CASE_RELATIONS` say.
        """
        content = self.read(shard.cases_file)
        if content is None:
            return None
        wanted = None if columns is None else list(columns)
        with self._parsing(shard.cases_file):
            schema = pq.read_schema(pa.BufferReader(content))
            there = schema.names
            is_early = not all(field.name in there for field in _LATER)
            missing = {field.name for field in CASES} - {field.name for field in _LATER} - set(there)
            if missing:
                raise self._wrong(shard.cases_file, f'it lacks the column "{min(missing)}"')
            surplus = set(there) - {field.name for field in CASES} - set(self.own_columns)
            if surplus:
                raise self._wrong(shard.cases_file, f'it has the column "{min(surplus)}", which is not in the manifest')
            for name, kind in self.own_columns.items():
                if name not in there or schema.field(name).type != EXTRA_TYPES[kind]:
                    raise self._wrong(
                        shard.cases_file, f'it has no column "{name}" of {kind}, which is in the manifest'
                    )
            table = pq.read_table(pa.BufferReader(content), columns=None if is_early else wanted)
            checks = TableChecks.of(table.schema)
        if table.num_rows != shard.cases:
            raise self._wrong(shard.cases_file, f"it holds {table.num_rows} cases, the manifest says {shard.cases}")
        key = shard.cases_file.sha256, None if wanted is None else tuple(wanted)
        if key not in self._checked:
            if checks is not None and (fault := checks.fault(table)) is not None:
                self._note(shard.cases_file.name, fault)
                return None
            fault = cases_fault(table, self._facts(shard), own_fields(self.own_columns))
            if fault is not None:
                raise self._wrong(shard.cases_file, fault)
            self._checked.add(key)
        if not is_early:
            return table
        table = _with_partner(_with_shortfall(table))
        return table if wanted is None else table.select(wanted)

    def tracks(self, shard: Shard, cases: pa.Table) -> Tracks | None:
        """Read a shard's trajectories, or None if the file is damaged.

        The last file's bytes stay in memory, because cases are mostly read one after the other. Each call gets a reader
        of its own: two threads with one would take what it has buffered from each other.

        Args:
            shard: The shard.
            cases: All columns of its cases.

        Raises:
            FileFormatError: The file is no table of trajectories; `Tracks` raises it where a value is not what
                `schema.RAILS_TRACKS` and `values.TRACK_RELATIONS` say.
        """
        last, stored = self._last_tracks, shard.tracks_file
        with self._parsing(stored):
            if last is None or last[0] != stored.sha256:
                content = self.read(stored)
                if content is None:
                    return None
                last = stored.sha256, content, pq.read_metadata(pa.BufferReader(content))
                self._last_tracks = last
            file = pq.ParquetFile(pa.BufferReader(last[1]), metadata=last[2])
            checks = TableChecks.of(file.schema_arrow)
        missing = {field.name for field in TRACKS} - set(file.schema_arrow.names)
        if missing and missing not in ([] if self._on_rails else _LATER_TRACKS):
            raise self._wrong(stored, f'it lacks the column "{min(missing)}"')
        for name, wanted in (("start", self._scripted), ("rails", self._on_rails)):
            if (name in file.schema_arrow.names) != wanted:
                there = "lacks" if wanted else "has"
                raise self._wrong(stored, f'it {there} the column "{name}", which does not fit what the manifest says')
        if file.metadata.num_rows != shard.cases:
            raise self._wrong(stored, f"it holds {file.metadata.num_rows} cases, the manifest says {shard.cases}")

        def found(table: pa.Table, row: int, fault: str | None) -> bool:
            if fault is not None:
                self._note(stored.name, fault)
                return False
            key = f"{stored.sha256} {row} {table.num_rows}", None
            if key not in self._checked:
                rows = cases.slice(row, table.num_rows)
                known = {name: values_of(rows.column(name)) for name in rows.column_names if name != "history"}
                fault = tracks_fault(table, self._facts(shard, known))
                if fault is not None:
                    raise self._wrong(stored, fault)
                self._checked.add(key)
            return True

        return Tracks(file, checks, found)

    def _facts(self, shard: Shard, cases: Mapping[str, Any] | None = None) -> ShardFacts:
        return ShardFacts(self._seed, self._odd, shard.first_test, shard.last_test, cases)

    def _wrong(self, file: StoredFile, fault: str) -> FileFormatError:
        return FileFormatError(f"{self._folder / file.name}: {fault}; restore it from a copy, or generate it again.")

    @contextmanager
    def _parsing(self, file: StoredFile) -> Iterator[None]:
        """Name the file that Arrow cannot read, although its bytes are those that were written."""
        try:
            yield
        except (pa.ArrowException, OSError, ValueError, KeyError) as error:
            raise self._wrong(file, f"it is no table of cases ({type(error).__name__}: {error})") from error

    def _note(self, name: str, fault: str) -> None:
        self.damaged[name] = fault
        warnings.warn(f"{self._folder / name} {fault}; what it holds is left out.", DamagedShardWarning, stacklevel=3)


def _where(content: pa.Buffer) -> str | None:
    """Find where a file of other bytes than were written has been changed: the column that cannot be read, or cells."""
    try:
        file = pq.ParquetFile(pa.BufferReader(content))
        checks = TableChecks.of(file.schema_arrow)
    except (pa.ArrowException, OSError, ValueError):
        return None
    for name in file.schema_arrow.names:
        try:
            file.read(columns=[name])
        except (pa.ArrowException, OSError, ValueError):
            return f'has been changed: its column "{name}" cannot be read'
    try:
        return None if checks is None else checks.fault(file.read())
    except (pa.ArrowException, OSError, ValueError):  # each column can be read, but they do not fit together
        return "has been changed: its columns are not of one length"


def _with_partner(table: pa.Table) -> pa.Table:
    """Add the columns `PARTNER` to the cases of an early library: cars of the ODD's size."""
    for field in PARTNER:
        if field.name not in table.column_names:
            kind = arrow_field(field).type
            values = pa.array([0] * table.num_rows, kind) if field is PARTNER[0] else pa.nulls(table.num_rows, kind)
            table = table.append_column(arrow_field(field), values)
    return table


def _with_shortfall(table: pa.Table) -> pa.Table:
    """Add the columns `SHORTFALL` to the cases of an early library; null where it lacks them.

    Its `shortfall_nats`, if any, is that of the possible actions, even where another was impossible.
    """
    if all(field.name in table.column_names for field in SHORTFALL):
        return table
    whole, possible, count = SHORTFALL
    unknown = pa.nulls(table.num_rows, pa.float64())
    known = table.column(whole.name).combine_chunks() if whole.name in table.column_names else unknown
    n = table.column(count.name) if count.name in table.column_names else pa.nulls(table.num_rows, pa.int64())
    truth = pc.if_else(pc.greater(n, 0), pa.scalar(math.inf), known)
    for field, values in ((whole, truth), (possible, known), (count, n)):
        if field.name in table.column_names:
            table = table.drop_columns([field.name])
        table = table.append_column(arrow_field(field), values)
    return table


def _arrow_bytes(path: Path) -> pa.Buffer:
    """Read a file into memory that Arrow allocates; no Python object owns it.

    Raises:
        OSError: The file cannot be read.
    """
    check_regular(path)
    with path.open("rb") as file:
        buffer = pa.allocate_buffer(os.fstat(file.fileno()).st_size)
        return buffer.slice(0, file.readinto(buffer))
