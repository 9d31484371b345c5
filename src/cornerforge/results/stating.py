"""Conversion of results to JSON and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from cornerforge._checksums import read_json
from cornerforge._schema import read
from cornerforge.errors import FileFormatError
from cornerforge.results.consistent import contradiction

__all__ = ["as_json", "from_file", "from_json"]

T = TypeVar("T")


def as_json(result: Any) -> dict[str, Any]:
    """Make what `--json` prints: a result's fields in their order, results within it as objects, tuples as lists.

    A field whose default is None is left out where it is None. Numbers stay as they are; JSON has no NaN
    and infinity, and the writer refuses them.

    Args:
        result: One of the dataclasses of this package.
    """
    values = ((one, getattr(result, one.name)) for one in fields(result))
    return {one.name: _plain(value) for one, value in values if value is not None or one.default is not None}


def from_json(kind: type[T], content: Mapping[str, Any]) -> T:
    """Make a result of what `as_json` made of it; NaN is kept, and lists may be tuples.

    Args:
        kind: Its class: one of the dataclasses of this package.
        content: The object; its own keys are those of the class.

    Raises:
        FileFormatError: Keys are missing or unknown, or a value is of another type or range.
    """
    place = f"This is no {kind.__name__}"
    if unknown := set(content) - {one.name for one in fields(kind)}:  # type: ignore[arg-type]
        raise FileFormatError(f'{place}: "{min(unknown)}" is unknown.')
    return read(kind, json.loads(json.dumps(content)), place)  # numbers of NumPy are plain ones then


def from_file(kind: type[T], path: Path, command: str) -> T:
    """Read a result, or another dataclass, of a JSON file with its checksum; keys without a field are passed over.

    Args:
        kind: The dataclass.
        path: The file.
        command: What writes it, for messages.

    Raises:
        FileFormatError: The file is missing, unreadable, no JSON, no object, or has been changed; or a value in it is
            missing, or of another type or range, or contradicts another: the message names its place.
    """
    content = read_json(path, f"write it with: {command}")
    found = read(kind, content, str(path), f"write the file again with: {command}")
    fault = contradiction(found)
    if fault is not None:
        raise FileFormatError(f"{path}: {fault}, which cannot be true; write the file again with: {command}")
    return found


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return as_json(value)
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return value
