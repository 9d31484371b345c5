"""Shards on disk: written whole, read only when they are what was written."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from cornerforge.library.manifest import Shard, StoredFile, replace_file, shard_names
from cornerforge.library.record import CaseRecord
from cornerforge.library.tables import ROW_GROUP, cases_table, parquet_bytes, tracks_table

__all__ = ["DamagedShardWarning", "ShardReader", "write_shard"]


class DamagedShardWarning(UserWarning):
    """A file of a shard is missing or not what was written; its cases are left out."""


def write_shard(folder: Path, index: int, cases: Sequence[CaseRecord], extra: Mapping[str, str]) -> Shard:
    """Write the two files of a shard; it counts only when a manifest that lists it is committed.

    Args:
        folder: Of the library.
        index: Of the shard, which names its files.
        cases: At least one.
        extra: The caller's own columns, name to a key of `schema.EXTRA_TYPES`.

    Raises:
        OutputError: The folder cannot be written.
        InputError: A record's own columns are not those of `extra`.
    """
    contents = (parquet_bytes(cases_table(cases, extra)), parquet_bytes(tracks_table(cases), ROW_GROUP))
    files = [StoredFile.of(name, content) for name, content in zip(shard_names(index), contents, strict=True)]
    for file, content in zip(files, contents, strict=True):
        replace_file(folder / file.name, content)
    first, last = (int(record.case_id.partition(":")[2]) for record in (cases[0], cases[-1]))
    return Shard(len(cases), first, last, *files)


class ShardReader:
    """Reads the files of a library; one that is damaged is named once, in `damaged` and by a warning, and then skipped.

    Attributes:
        damaged: File name to what is wrong with it.
    """

    def __init__(self, folder: Path) -> None:
        self.damaged: dict[str, str] = {}
        self._folder = folder
        self._last_tracks: tuple[str, pq.ParquetFile] | None = None

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

    def read(self, file: StoredFile) -> bytes | None:
        """A file's content if it is what was written, else None. The bytes checked are the bytes parsed."""
        if file.name in self.damaged:
            return None
        try:
            content = (self._folder / file.name).read_bytes()
        except OSError as error:
            self._note(file.name, f"cannot be read ({error.strerror})")
            return None
        fault = file.fault(content)
        if fault is not None:
            self._note(file.name, fault)
            return None
        return content

    def cases(self, shard: Shard, columns: Sequence[str] | None) -> pa.Table | None:
        """Columns (None: all) of a shard's cases, or None if the file is damaged."""
        content = self.read(shard.cases_file)
        if content is None:
            return None
        return pq.read_table(pa.BufferReader(content), columns=None if columns is None else list(columns))

    def tracks(self, shard: Shard) -> pq.ParquetFile | None:
        """A shard's trajectories, or None if the file is damaged.

        The last one is kept, because cases are mostly asked for one after the other.
        """
        if self._last_tracks is None or self._last_tracks[0] != shard.tracks_file.name:
            content = self.read(shard.tracks_file)
            if content is None:
                return None
            self._last_tracks = (shard.tracks_file.name, pq.ParquetFile(pa.BufferReader(content)))
        return self._last_tracks[1]

    def _note(self, name: str, fault: str) -> None:
        self.damaged[name] = fault
        warnings.warn(f"{self._folder / name} {fault}; what it holds is left out.", DamagedShardWarning, stacklevel=3)
