"""JSON files of cornerforge, edited by somebody who makes the checksum anew, so that the values are tried."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from cornerforge._checksums import with_checksum
from cornerforge._table_checks import with_checks
from cornerforge.library.tables import ROW_GROUP

__all__ = ["edit_object", "rewrite_shard", "write_object"]


def write_object(path: Path, content: Mapping[str, Any]) -> None:
    """Write an object with its checksum."""
    path.write_text(json.dumps(with_checksum(content)), encoding="utf-8")


def edit_object(path: Path, **changes: Any) -> None:
    """Change keys of an object, and its checksum with them."""
    write_object(path, json.loads(path.read_text(encoding="utf-8")) | changes)


def rewrite_shard(folder: Path, index: int, kind: str, change: Callable[[pa.Table], pa.Table]) -> None:
    """Change the table "cases" or "tracks" of a shard of a library, and make all checksums anew."""
    path = folder / f"{kind}-{index:06}.parquet"
    pq.write_table(with_checks(change(pq.read_table(path))), path, row_group_size=ROW_GROUP)
    shards = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["shards"]
    content = path.read_bytes()
    shards[index][f"{kind}_file"] |= {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    edit_object(folder / "manifest.json", shards=shards)
