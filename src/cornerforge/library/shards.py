"""Writing of shards, and reading of shards that are undamaged."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cornerforge._checksums import MIGRATE
from cornerforge._files import check_regular, reason
from cornerforge._table_checks import TableChecks, with_checks
from cornerforge._values import table_fault
from cornerforge.errors import FileFormatError
from cornerforge.fields import CASES, Field
from cornerforge.library.manifest import Manifest, Shard, StoredFile, replace_file, shard_names
from cornerforge.library.schema import own_fields, own_kinds, tracks_fields
from cornerforge.library.tables import ROW_GROUP, parquet_bytes

__all__ = [
    "DamagedShardWarning",
    "EncodedShard",
    "ShardReader",
    "Tracks",
    "encode_tables",
    "write_shard",
]


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
        motion: Columns of the trajectories.
        extra: The caller's own columns, name to a key of `schema.EXTRA_TYPES`.
        contents: The two files.
        sha256: Their checksums, hex.
    """

    cases: int
    seeds: frozenset[int]
    first_test: int
    last_test: int
    ascending: bool
    motion: tuple[str, ...]
    extra: Mapping[str, str]
    contents: tuple[memoryview, memoryview]
    sha256: tuple[str, str]


def encode_tables(cases: pa.Table, tracks: pa.Table) -> EncodedShard:
    """Pack tables for `CaseLibrary.append_shard`; slow, but without the GIL, so that threads can do it in parallel.

    Args:
        cases: Rows of `schema.CASES` and the caller's own columns, at least one.
        tracks: As many rows of `schema.TRACKS`, of the same cases.
    """
    # In one piece, so that the bytes do not depend on how the rows came together.
    tables = (with_checks(cases.combine_chunks()), with_checks(tracks.combine_chunks()))
    contents = (parquet_bytes(tables[0]), parquet_bytes(tables[1], ROW_GROUP))
    hashes = [hashlib.sha256(content).hexdigest() for content in contents]
    tests = cases.column("test").to_numpy()
    seeds = frozenset(np.unique(cases.column("seed").to_numpy()).tolist())
    ascending = bool((np.diff(tests) > 0).all())
    ends = int(tests[0]), int(tests[-1])
    names = tuple(tracks.column_names), own_kinds(cases)
    return EncodedShard(len(tests), seeds, *ends, ascending, *names, contents, (hashes[0], hashes[1]))


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
        checks: The checksums that the file carries.
        found: Called with the fault of the rows that are read, None without fault; returns whether they may be used.
    """

    def __init__(
        self, file: pq.ParquetFile, checks: TableChecks, found: Callable[[pa.Table, int, str | None], bool]
    ) -> None:
        self._file, self._checks, self._found = file, checks, found

    def all(self) -> pa.Table | None:
        """Read all cases; None if something is wrong with them."""
        table = self._file.read()
        return table if self._found(table, 0, self._checks.fault(table)) else None

    def case(self, row: int) -> pa.Table | None:
        """Read the case of a row, as a table of one row; None if something is wrong with it."""
        table = self._file.read_row_group(row // ROW_GROUP).slice(row % ROW_GROUP, 1).combine_chunks()
        return table if self._found(table, row, self._checks.row_fault(table, row)) else None


class ShardReader:
    """Reads the files of a library; a damaged file is named once, in `damaged` and by a warning, and then skipped.

    Attributes:
        damaged: File name to what is wrong with it.
        own_columns: The caller's own columns, name to a key of `schema.EXTRA_TYPES`, as the manifest says.
    """

    def __init__(self, folder: Path, manifest: Manifest) -> None:
        self.damaged: dict[str, str] = {}
        self.own_columns: Mapping[str, str] = manifest.extra or {}
        self._folder, self._tracks = folder, tracks_fields(manifest.run)
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
            FileFormatError: A column or value is not what `fields.CASES` says, or an earlier version wrote it.
        """
        stored = shard.cases_file
        content = self.read(stored)
        if content is None:
            return None
        wanted = None if columns is None else list(columns)
        fields = (*CASES, *own_fields(self.own_columns))
        with self._parsing(stored):
            file = pq.ParquetFile(pa.BufferReader(content))
            checks = self._checks(file, shard, stored, fields)
            table = file.read(wanted)
        key = stored.sha256, None if wanted is None else tuple(wanted)
        if key not in self._checked:
            if (fault := checks.fault(table)) is not None:
                self._note(stored.name, fault)
                return None
            self._check_values(stored, table, fields)
            self._checked.add(key)
        return table

    def tracks(self, shard: Shard) -> Tracks | None:
        """Read a shard's trajectories, or None if the file is damaged.

        The last file's bytes stay in memory, because cases are mostly read one after the other. Each call gets a reader
        of its own: two threads with one would take what it has buffered from each other.

        Raises:
            FileFormatError: The file is no table of trajectories, or an earlier version wrote it; `Tracks` raises it
                where a value is not what `schema.tracks_fields` says.
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
            checks = self._checks(file, shard, stored, self._tracks)

        def found(table: pa.Table, row: int, fault: str | None) -> bool:
            if fault is not None:
                self._note(stored.name, fault)
                return False
            key = f"{stored.sha256} {row} {table.num_rows}", None
            if key not in self._checked:
                self._check_values(stored, table, self._tracks)
                self._checked.add(key)
            return True

        return Tracks(file, checks, found)

    def _checks(self, file: pq.ParquetFile, shard: Shard, stored: StoredFile, fields: Sequence[Field]) -> TableChecks:
        """Give the checksums that a file carries, if it has the columns and rows that it must have."""
        checks, there = TableChecks.of(file.schema_arrow), set(file.schema_arrow.names)
        wanted = {one.name for one in fields}
        if checks is None or there != wanted:
            lacks, more = (f'the column "{min(names)}"' if names else "" for names in (wanted - there, there - wanted))
            what = f"it lacks {lacks}" if lacks else f"it has {more} besides" if more else "it carries no checksums"
            raise FileFormatError(f"{self._folder / stored.name} is of another version: {what}; {MIGRATE}.")
        if file.metadata.num_rows != shard.cases:
            raise self._wrong(stored, f"it holds {file.metadata.num_rows} cases, the manifest says {shard.cases}")
        return checks

    def _check_values(self, stored: StoredFile, table: pa.Table, fields: Sequence[Field]) -> None:
        fault = table_fault(table, fields)
        if fault is not None:
            raise self._wrong(stored, fault)

    def _wrong(self, file: StoredFile, fault: str) -> FileFormatError:
        return FileFormatError(f"{self._folder / file.name}: {fault}; restore it from a copy, or generate it again.")

    @contextmanager
    def _parsing(self, file: StoredFile) -> Iterator[None]:
        """Name the file that Arrow cannot read, although its bytes are unchanged."""
        try:
            yield
        except FileFormatError:
            raise  # it names the file, and what to do
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


def _arrow_bytes(path: Path) -> pa.Buffer:
    """Read a file into memory that Arrow allocates; no Python object owns it.

    Raises:
        OSError: The file cannot be read.
    """
    check_regular(path)
    with path.open("rb") as file:
        buffer = pa.allocate_buffer(os.fstat(file.fileno()).st_size)
        return buffer.slice(0, file.readinto(buffer))
