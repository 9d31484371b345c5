"""JSON files of cornerforge, edited by somebody who makes the checksum anew, so that the values are tried."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cornerforge._checksums import with_checksum

__all__ = ["edit_object", "write_object"]


def write_object(path: Path, content: Mapping[str, Any]) -> None:
    """Write an object with its checksum."""
    path.write_text(json.dumps(with_checksum(content)), encoding="utf-8")


def edit_object(path: Path, **changes: Any) -> None:
    """Change keys of an object, and its checksum with them."""
    write_object(path, json.loads(path.read_text(encoding="utf-8")) | changes)
