"""Output: checks of what may be written where, provenance, and files that are whole or absent."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import platform
import shutil
import stat
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from types import MappingProxyType
from typing import Any

from cornerforge._checks import check_path
from cornerforge._files import is_part_of, reason, writing
from cornerforge._locks import claim_file, claim_folder, command_line, is_lock
from cornerforge.errors import InputError, OutputError
from cornerforge.foreign.interpreter import in_use
from cornerforge.work import code_hash
from cornerforge.work.files import read_json_file, write_json

__all__ = [
    "IDENTITY",
    "SUMMARY",
    "called_with",
    "check_new_file",
    "check_new_folder",
    "code_hash",
    "config_hash",
    "identity_in",
    "is_finished_run",
    "open_output",
    "provenance",
    "read_json_file",
    "remove_folder",
    "version",
    "whole_or_nothing",
    "write_json",
    "write_text",
    "writing",
]

IDENTITY = "provenance.json"
SUMMARY = "summary.json"
"""What `run` writes last into its folder."""
_CALL: ContextVar[Mapping[str, Any]] = ContextVar("call", default=MappingProxyType({}))


def is_finished_run(folder: Path) -> bool:
    """Say whether `run` ended in a folder; a link that leads nowhere is there, too: reading it says what is wrong."""
    return os.path.lexists(folder / SUMMARY)


def version() -> str:
    """Return the installed version of cornerforge."""
    return importlib.metadata.version("cornerforge")


def config_hash(config: Mapping[str, Any]) -> str:
    """Hash JSON-compatible settings (SHA-256, first 16 hex digits); the order of keys does not matter."""
    return hashlib.sha256(json.dumps(config, sort_keys=True, allow_nan=False).encode()).hexdigest()[:16]


def write_text(path: Path, text: str) -> None:
    """Write a text file whole, or not at all.

    Raises:
        OutputError: It cannot be written.
    """
    with writing(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def called_with(stated: Mapping[str, Any]) -> Iterator[None]:
    """Let `provenance` say more of the call, such as its options; for the command line.

    Args:
        stated: What it says, JSON-compatible.
    """
    token = _CALL.set(stated)
    try:
        yield
    finally:
        _CALL.reset(token)


def provenance(identity: Mapping[str, Any], seconds: float | None = None) -> dict[str, Any]:
    """Describe how an output folder was made.

    Args:
        identity: What decides the result: seed, hashes, settings.
        seconds: Wall-clock time of the work [s]; None while it is not done.
    """
    outside = in_use()
    return {
        "cornerforge": version(),
        "command": command_line(),
        **_CALL.get(),
        **({"avs_from_outside": outside} if outside else {}),
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


def check_new_folder(folder: Path) -> None:
    """Claim, before long work, a folder that is new or empty.

    Raises:
        OutputError: It holds something, is no folder, cannot be read or written, or another call writes there.
    """
    names = sorted(_claimed(folder))
    if names:
        raise OutputError(f"{folder} is there already and not empty ({names[0]}); choose a new or empty folder.")


def check_new_file(path: Path, *, overwrite: bool = False) -> None:
    """Claim, before long work, a file that can be written without losing anything.

    Raises:
        OutputError: Something is there already, its folder cannot be written, or another call writes there.
    """
    check_path(path)
    try:
        is_folder = path.is_dir()
        nearest = next((folder for folder in path.absolute().parents if folder.exists()), path)
    except OSError as error:  # for example, the name is too long
        raise OutputError(f"Cannot write {path}: {reason(error)}; choose another place.") from error
    if is_folder:
        raise OutputError(f"{path} is a folder; name a file.")
    if not nearest.is_dir():
        raise OutputError(f"Cannot write {path}: {nearest} is a file; choose another place.")
    if not os.access(nearest, os.W_OK):
        raise OutputError(f"Cannot write {path}: no permission to write into {nearest}; choose another place.")
    claim_file(path)
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists already; remove it, or choose another place.")


def open_output(folder: Path, identity: Mapping[str, Any], *, resume: bool | None) -> bool:
    """Claim an output folder, up to the end of the call, or go on with one.

    Args:
        folder: The folder; its parents are made.
        identity: What decides the result; a resumed folder must have the same identity.
        resume: Go on with the work that the folder holds; None: this command never can.

    Returns:
        True if the folder holds earlier work of the same identity.

    Raises:
        OutputError: The folder holds something else, holds results and `resume` is not True, cannot be written, or
            another call writes there.
        InputError: It holds work of another identity; the first difference is named.
    """
    mark = folder / IDENTITY
    names = _claimed(folder)
    if IDENTITY in names:
        if not resume:
            advice = "remove it" if resume is None else "go on with --resume"
            raise OutputError(f"{folder} holds results already; {advice}, or choose another place.")
        before = identity_in(folder)
        for key, value in identity.items():
            if before.get(key) != value:
                raise InputError(
                    f"{folder} holds a run with {key} = {before.get(key)!r}, not {value!r}; "
                    "choose another place, or remove it."
                )
        return True
    foreign = sorted(name for name in names if not is_part_of(name, mark))  # a kill in the first moment leaves a part
    if foreign:
        raise OutputError(f"{folder} holds something else ({foreign[0]}); choose a new or empty folder.")
    write_json(mark, provenance(identity))
    return False


def identity_in(folder: Path) -> dict[str, Any]:
    """Read the identity of the work that a folder holds; empty if there is none."""
    mark = folder / IDENTITY
    found = read_json_file(mark).get("identity") if mark.exists() else None
    return found if isinstance(found, dict) else {}


@contextmanager
def whole_or_nothing(folder: Path, names: Sequence[str]) -> Iterator[None]:
    """Clear an output folder if the work is ended, so that the same call can be made again.

    Args:
        folder: As `open_output` left it, with nothing in it before.
        names: What the work makes in it besides.
    """
    try:
        yield
    except BaseException:  # Ctrl-C too
        for name in names:
            shutil.rmtree(folder / name, ignore_errors=True)
        with suppress(OSError):
            (folder / IDENTITY).unlink(missing_ok=True)
        raise


def remove_folder(folder: Path) -> None:
    """Remove a folder with all that is in it, if it is there.

    Raises:
        OutputError: It cannot be removed.
    """
    try:
        if not stat.S_ISDIR(folder.lstat().st_mode):  # a pipe would be opened, and waited for
            raise OutputError(f"{folder} is no folder; remove it.")
        shutil.rmtree(folder)
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError(f"Cannot remove {folder}: {reason(error)}; make it writable.") from error


def _claimed(folder: Path) -> set[str]:
    """Claim a folder and return the names in it."""
    check_path(folder)
    _entries(folder)  # a message of its own for what is no folder
    claim_folder(folder)
    return _entries(folder)


def _entries(folder: Path) -> set[str]:
    """Return the names in a folder but those of locks; none if the folder does not exist.

    Raises:
        OutputError: It is no folder, or cannot be read.
    """
    try:
        return {entry.name for entry in folder.iterdir() if not is_lock(entry.name)}
    except FileNotFoundError:
        return set()
    except OSError as error:
        raise OutputError(f"{folder} cannot be used as a folder: {reason(error)}; choose another place.") from error
