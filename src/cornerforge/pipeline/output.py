"""Output places: what may be written where, provenance, and files that are whole or absent."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cornerforge.errors import FileFormatError, InputError, OutputError

__all__ = [
    "check_new_file",
    "code_hash",
    "open_output",
    "provenance",
    "read_json_file",
    "version",
    "write_json",
    "write_text",
]

IDENTITY = "provenance.json"


def version() -> str:
    """The installed version of cornerforge."""
    return importlib.metadata.version("cornerforge")


@functools.cache
def code_hash() -> str:
    """SHA-256 (first 16 hex digits) over the package's Python sources: results of other code are never mixed in."""
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def write_text(path: Path, text: str) -> None:
    """Write a text file whole: beside its place first, then renamed.

    Raises:
        OutputError: It cannot be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise OutputError(f"Cannot write {path}: {error.strerror}; choose another place.") from error


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file whole; NaN and infinity are refused."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_json_file(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Raises:
        FileFormatError: It is damaged.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path} is damaged ({error}); remove it, or choose another place.") from error
    if not isinstance(content, dict):
        raise FileFormatError(f"{path} holds no JSON object; remove it, or choose another place.")
    return content


def provenance(identity: Mapping[str, Any], seconds: float | None = None) -> dict[str, Any]:
    """What an output folder says of its making.

    Args:
        identity: What decides the result: seed, hashes, settings.
        seconds: Wall-clock of the work, when it is done.
    """
    return {
        "cornerforge": version(),
        "command": " ".join(["cornerforge", *sys.argv[1:]]),
        "identity": dict(identity),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "seconds": seconds,
        "machine": {
            "system": platform.system(),
            "processor": platform.machine(),
            "cores": os.cpu_count(),
            "python": platform.python_version(),
        },
    }


def check_new_file(path: Path, *, overwrite: bool = False) -> None:
    """Check that a file can be written at `path` without losing anything.

    Raises:
        OutputError: Something is there already, or its folder cannot be written.
    """
    if path.is_dir():
        raise OutputError(f"{path} is a folder; name a file.")
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists already; remove it, or choose another place.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        probe = path.with_name(f".{path.name}.part")
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"Cannot write {path}: {error.strerror}; choose another place.") from error


def open_output(folder: Path, identity: Mapping[str, Any], *, resume: bool) -> bool:
    """Make an output folder ours, or take it up again.

    Args:
        folder: The place; parents are made.
        identity: What decides the result; a resumed folder must have the same.
        resume: Go on with what is there.

    Returns:
        Whether earlier work of the same identity is there.

    Raises:
        OutputError: The folder holds something else, holds results and `resume` is False, or cannot be written.
        InputError: It holds work of another identity; the first difference is named.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file; name a folder.")
    mark = folder / IDENTITY
    if mark.exists():
        if not resume:
            raise OutputError(f"{folder} holds results already; go on with --resume, or choose another place.")
        before = read_json_file(mark).get("identity")
        before = before if isinstance(before, dict) else {}
        for key, value in identity.items():
            if before.get(key) != value:
                raise InputError(
                    f"{folder} holds a run with {key} = {before.get(key)!r}, not {value!r}; "
                    "choose another place, or remove it."
                )
        return True
    if folder.is_dir() and any(folder.iterdir()):
        raise OutputError(f"{folder} is not empty and holds no run of cornerforge; choose another place.")
    write_json(mark, provenance(identity))
    return False
