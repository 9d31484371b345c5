"""What a file is made of: its documents of JSON, its arrays, its table. One way in and one way out for all formats."""

from __future__ import annotations

import copy
import io
import json
import re
import zipfile
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.numpy import save

from cornerforge import _table_checks as table_checks
from cornerforge._checksums import _MEMBER, KEY

__all__ = ["Parts", "parts_of", "text_with_raw", "write_parts"]

_WORLD = b"cornerforge world"


@dataclass
class Parts:
    """Documents and arrays by name, a table, and checksums; what a format does not have is empty."""

    documents: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    table: pa.Table | None = None
    marks: dict[str, str] = field(default_factory=dict)

    @property
    def has_checksums(self) -> bool:
        """Whether the file says what it should hold: then any change can be noticed."""
        marked = self.table is not None and table_checks._KEY in (self.table.schema.metadata or {})
        return (
            bool(self.marks) or marked or any(isinstance(one, dict) and KEY in one for one in self.documents.values())
        )

    def copied(self) -> Parts:
        """Copy what may be changed in place; arrays are replaced, never changed."""
        return Parts(copy.deepcopy(self.documents), dict(self.arrays), self.table, dict(self.marks))


def parts_of(path: Path) -> Parts:
    """Take a whole, undamaged file apart; of other formats, and of damaged files: no parts."""
    try:
        return _parts_of(path, path.stat().st_mtime_ns)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, pa.ArrowException, EOFError):
        return Parts()


@lru_cache(maxsize=256)
def _parts_of(path: Path, _: int) -> Parts:
    match path.suffix:
        case ".json":
            return Parts({"": json.loads(path.read_text(encoding="utf-8"))})
        case ".npy":
            return Parts(arrays={"": np.load(path)})
        case ".npz":
            with np.load(path) as file:
                arrays = {name: file[name] for name in file.files}
            texts = {name: str(a) for name, a in arrays.items() if a.dtype.kind == "U" and a.ndim == 0}
            marks = {name: text for name, text in texts.items() if name == _MEMBER}
            documents = {name: json.loads(text) for name, text in texts.items() if name not in marks}
            return Parts(documents, {name: a for name, a in arrays.items() if name not in texts}, marks=marks)
        case ".safetensors" | ".checkpoint":
            with safe_open(path, framework="numpy") as file:
                metadata = file.metadata() or {}
                arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            return Parts({name: json.loads(text) for name, text in metadata.items()}, arrays)
        case ".world":
            content = path.read_bytes()
            magic, head, body = content[:-32].split(b"\n", 2)
            assert magic == _WORLD
            arrays = {"body": np.frombuffer(body, np.uint8)}
            return Parts({"head": json.loads(head)}, arrays, marks={"sha256": content[-32:].hex()})
        case ".parquet":
            return Parts(table=pq.read_table(pa.BufferReader(path.read_bytes())))
    return Parts()


def write_parts(path: Path, parts: Parts) -> None:
    """Put a file together again, with the checksums that it had; arrays that a format cannot hold become float32."""
    texts = {name: text_with_raw(document) for name, document in parts.documents.items()}
    match path.suffix:
        case ".json":
            path.write_text(texts[""] + "\n", encoding="utf-8")
        case ".npy":
            if parts.arrays:
                np.save(path, next(iter(parts.arrays.values())))
            else:
                path.write_bytes(b"")
        case ".npz":
            arrays = {**{name: np.array(text) for name, text in texts.items()}, **parts.arrays}
            content = io.BytesIO()
            np.savez(content, allow_pickle=False, **{n: np.array(text) for n, text in parts.marks.items()}, **arrays)
            path.write_bytes(content.getvalue())
        case ".safetensors" | ".checkpoint":
            held = {name: np.ascontiguousarray(_storable(array)) for name, array in parts.arrays.items()}
            path.write_bytes(save(held, metadata=texts))
        case ".world":
            body = b"".join(np.ascontiguousarray(array).tobytes() for array in parts.arrays.values())
            whole = b"\n".join([_WORLD, texts["head"].encode(), body])
            path.write_bytes(whole + bytes.fromhex(parts.marks["sha256"]))
        case ".parquet":
            assert parts.table is not None
            pq.write_table(parts.table, path, compression="zstd")


def _storable(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array that safetensors can hold."""
    is_known = array.dtype.kind in "fiub" and array.dtype.isnative
    return array if is_known else np.zeros(array.shape, np.float32)


_RAW = re.compile(r'"@raw:((?:[^"\\]|\\.)*)"')
_TWICE = re.compile(r'"@twice:((?:[^"\\]|\\.)*)"')


def text_with_raw(document: Any) -> str:
    """Write JSON, with what stands in for text that is no JSON value put in as it is.

    >>> text_with_raw({"a": 1, "@twice:a": "@raw:nul"})
    '{"a": 1, "a": nul}'
    """
    text = json.dumps(document)
    text = _RAW.sub(lambda found: json.loads(f'"{found[1]}"'), text)
    return _TWICE.sub(lambda found: f'"{found[1]}"', text)
