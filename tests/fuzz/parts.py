"""What a file is made of: its documents of JSON, its arrays, its table. One way in and one way out for all formats."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import re
import zipfile
from contextlib import suppress
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

from cornerforge import _checksums as checksums
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
        """Whether the file says what it should hold: then a change can be noticed unless they are made anew."""
        marked = self.table is not None and table_checks._KEY in (self.table.schema.metadata or {})
        document = self.documents.get("")
        return bool(self.marks) or marked or (isinstance(document, dict) and KEY in document)

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
            marks = {name: text for name, text in metadata.items() if name == KEY}
            return Parts({n: json.loads(text) for n, text in metadata.items() if n not in marks}, arrays, marks=marks)
        case ".world":
            magic, head, body = path.read_bytes()[:-32].split(b"\n", 2)
            assert magic == _WORLD
            return Parts({"head": json.loads(head)}, {"body": np.frombuffer(body, np.uint8)})
        case ".parquet":
            return Parts(table=pq.read_table(pa.BufferReader(path.read_bytes())))
    return Parts()


def write_parts(path: Path, parts: Parts, *, sealed: bool) -> None:
    """Put a file together again; arrays that a format cannot hold become float32.

    Args:
        path: The file.
        parts: What it is made of.
        sealed: With the checksums of what is in it now, as of somebody who makes them anew; else with those it had.
    """
    texts = {name: text_with_raw(document) for name, document in parts.documents.items()}
    marks = dict(parts.marks)
    match path.suffix:
        case ".json":
            path.write_text((_marked(texts[""]) if sealed else texts[""]) + "\n", encoding="utf-8")
        case ".npy":
            if parts.arrays:
                np.save(path, next(iter(parts.arrays.values())))
            else:
                path.write_bytes(b"")
        case ".npz":
            arrays = {**{name: np.array(text) for name, text in texts.items()}, **parts.arrays}
            if sealed and marks:
                marks[_MEMBER] = json.dumps({name: checksums._of_array(array) for name, array in arrays.items()})
            content = io.BytesIO()
            np.savez(content, allow_pickle=False, **{n: np.array(text) for n, text in marks.items()}, **arrays)
            path.write_bytes(content.getvalue())
        case ".safetensors" | ".checkpoint":
            held = {name: np.ascontiguousarray(_storable(array)) for name, array in parts.arrays.items()}
            if sealed and marks:
                with suppress(ValueError, RecursionError, AttributeError):  # its header is no object: sealed or not
                    (header,) = (json.loads(text) for text in texts.values())
                    marks[KEY] = checksums._header_checksum(header, held)
            path.write_bytes(save(held, metadata=texts | marks))
        case ".world":
            body = b"".join(np.ascontiguousarray(array).tobytes() for array in parts.arrays.values())
            whole = b"\n".join([_WORLD, texts["head"].encode(), body])
            path.write_bytes(whole + hashlib.sha256(whole).digest())
        case ".parquet":
            assert parts.table is not None
            table = parts.table
            if sealed and (table.schema.metadata or {}).get(table_checks._KEY):
                with suppress(
                    pa.ArrowException, TypeError, ValueError, AttributeError
                ):  # of a type that has no checksum
                    table = table_checks.with_checks(table.combine_chunks())
            pq.write_table(table, path, compression="zstd")


def _marked(text: str) -> str:
    """Put the right checksum in the place of an object's own, and leave all else as it stands."""
    with suppress(ValueError, RecursionError, TypeError):
        content = json.loads(text)
        if isinstance(content, dict) and isinstance(content.get(KEY), str):
            return text.replace(json.dumps(content[KEY]), json.dumps(checksums.json_checksum(content)))
    return text


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
