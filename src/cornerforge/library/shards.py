"""Writing of shards, and reading of shards that are undamaged."""

from __future__ import annotations

import hashlib
import math
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from cornerforge._arrow import arrow_field
from cornerforge.errors import InputError
from cornerforge.fields import PARTNER, SHORTFALL
from cornerforge.library.manifest import Shard, StoredFile, replace_file, shard_names
from cornerforge.library.record import CaseRecord, extra_kinds
from cornerforge.library.schema import EXTRA_TYPES
from cornerforge.library.tables import ROW_GROUP, parquet_bytes

__all__ = [
    "DamagedShardWarning",
    "EncodedShard",
    "ShardReader",
    "encode_shard",
    "encode_tables",
    "joined",
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
    tables = (cases.combine_chunks(), tracks.combine_chunks())
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


class ShardReader:
    """Reads the files of a library; a damaged file is named once, in `damaged` and by a warning, and then skipped.

    Attributes:
        damaged: File name to what is wrong with it.
    """

    def __init__(self, folder: Path) -> None:
        self.damaged: dict[str, str] = {}
        self._folder = folder
        self._last_tracks: tuple[str, pa.Buffer, pq.FileMetaData] | None = None

    def check_sizes(self, shards: Iterable[Shard]) -> None:
        """Look for files that are missing or truncated; checksums are compared when a file is read."""
        for shard in shards:
            for file in (shard.cases_file, shard.tracks_file):
                path = self._folder / file.name
                size = path.stat().st_size if path.is_file() else None
                if size is None:
                    self._note(file.name, "is missing")
                elif size != file.size:
                    self._note(file.name, f"has {size} of {file.size} bytes")

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
            self._note(file.name, f"cannot be read ({error.strerror})")
            return None
        fault = file.fault(memoryview(content))
        if fault is not None:
            self._note(file.name, fault)
            return None
        return content

    def cases(self, shard: Shard, columns: Sequence[str] | None) -> pa.Table | None:
        """Read columns (None: all) of a shard's cases, or None if the file is damaged."""
        content = self.read(shard.cases_file)
        if content is None:
            return None
        there = pq.read_schema(pa.BufferReader(content)).names
        wanted = None if columns is None else list(columns)
        if all(field.name in there for field in (*SHORTFALL, *PARTNER)):
            return pq.read_table(pa.BufferReader(content), columns=wanted)
        table = _with_partner(_with_shortfall(pq.read_table(pa.BufferReader(content))))
        return table if wanted is None else table.select(wanted)

    def tracks(self, shard: Shard) -> pq.ParquetFile | None:
        """Read a shard's trajectories, or None if the file is damaged.

        The last file's bytes stay in memory, because cases are mostly read one after the other. Each call gets a reader
        of its own: two threads with one would take what it has buffered from each other.
        """
        last = self._last_tracks
        if last is None or last[0] != shard.tracks_file.sha256:
            content = self.read(shard.tracks_file)
            if content is None:
                return None
            last = shard.tracks_file.sha256, content, pq.read_metadata(pa.BufferReader(content))
            self._last_tracks = last
        return pq.ParquetFile(pa.BufferReader(last[1]), metadata=last[2])

    def _note(self, name: str, fault: str) -> None:
        self.damaged[name] = fault
        warnings.warn(f"{self._folder / name} {fault}; what it holds is left out.", DamagedShardWarning, stacklevel=3)


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
    with path.open("rb") as file:
        buffer = pa.allocate_buffer(os.fstat(file.fileno()).st_size)
        return buffer.slice(0, file.readinto(buffer))
