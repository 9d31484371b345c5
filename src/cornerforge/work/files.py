"""Files that hold what a part of a job came to: JSON objects with a checksum, whole or absent."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cornerforge._checksums import read_json, with_checksum
from cornerforge._files import writing

__all__ = ["read_json_file", "write_json"]


def read_json_file(path: Path) -> dict[str, Any]:
    """Read a JSON object that `write_json` wrote; gives it without its checksum.

    Raises:
        FileFormatError: It is damaged, or has been changed.
    """
    return read_json(path, "remove it, or choose another place")


def write_json(path: Path, content: Mapping[str, Any], *, checksum: bool = True) -> None:
    """Write a JSON file whole, with its checksum if wanted; NaN and infinity are refused."""
    told = with_checksum(content) if checksum else dict(content)
    with writing(path) as part:
        part.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n", encoding="utf-8")
