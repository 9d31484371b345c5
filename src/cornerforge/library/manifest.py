"""The manifest: what a library holds and how far its run has come. Replacing it commits a shard.

A kill leaves either the old manifest or the new one (`_files`). After a power failure checksums tell which shards did
not reach the disk; waiting for the disk at each shard would protect against nothing else.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

from cornerforge._checksums import KEY, check_json, with_checksum
from cornerforge._files import read_bytes, reason, writing
from cornerforge._objects import object_fault
from cornerforge._strict_json import parse
from cornerforge._words import shown
from cornerforge.errors import FileFormatError, InputError
from cornerforge.library.schema import (
    EXTRA_TYPES,
    FILE_FIELDS,
    IDENTITY_FIELDS,
    MANIFEST_FIELDS,
    ON_RAILS,
    SCHEMA_VERSION,
    SCRIPTED,
    SHARD_FIELDS,
    schema_version,
)  # fmt: skip
from cornerforge.types import Odd

__all__ = [
    "MANIFEST",
    "Identity",
    "Manifest",
    "Shard",
    "StoredFile",
    "check_identity",
    "first_difference",
    "is_leftover",
    "read_manifest",
    "replace_file",
    "shard_names",
    "write_manifest",
]

Identity: TypeAlias = Mapping[str, str | int | float | bool | None]

MANIFEST = "manifest.json"
_FORMAT = "cornerforge case library"
_SHARD_FILE = r"(cases|tracks)-\d{6,}(-growing)?\.parquet"
_OURS = re.compile(rf"{_SHARD_FILE}|\.({_SHARD_FILE}|manifest\.json)(\.[0-9a-f]{{8}})?\.part")


@dataclass(frozen=True)
class StoredFile:
    """A file of a shard: its name in the library's folder, its size in bytes and its SHA-256 (hex)."""

    name: str
    size: int
    sha256: str

    @classmethod
    def of(cls, name: str, content: memoryview) -> StoredFile:
        """Describe a file by its content."""
        return cls(name, content.nbytes, hashlib.sha256(content).hexdigest())

    def fault(self, content: memoryview) -> str | None:
        """Say what is wrong with the content read back, or None."""
        if content.nbytes != self.size:
            return f"has {content.nbytes} of {self.size} bytes"
        return None if hashlib.sha256(content).hexdigest() == self.sha256 else "has been changed (SHA-256 differs)"


@dataclass(frozen=True)
class Shard:
    """Cases that were committed together: how many, their first and last test, and their two files."""

    cases: int
    first_test: int
    last_test: int
    cases_file: StoredFile
    tracks_file: StoredFile


@dataclass(frozen=True)
class Manifest:
    """All that a library stores besides its cases.

    Attributes:
        created_by: Version of cornerforge that created it.
        run: What names the run; two libraries with equal `run` and `odd` hold the same cases.
        odd: Road and rules of all cases.
        extra: Caller's own columns, name to a key of `EXTRA_TYPES`; None before the first case.
        shards: Ascending by test.
        next_test: All tests below it are done.
        tests: Tests done.
        crashes: AV crashes among them; may exceed the cases stored.
        finished: The run reached its target.
    """

    created_by: str
    run: Identity
    odd: Odd
    extra: Mapping[str, str] | None = None
    shards: tuple[Shard, ...] = ()
    next_test: int = 0
    tests: int = 0
    crashes: int = 0
    finished: bool = False

    @property
    def scripted(self) -> bool:
        """Whether all cases are scripted (True), or tests of a seed."""
        return self.run.get(SCRIPTED) is True

    @property
    def on_rails(self) -> bool:
        """Whether the other vehicles of all cases are on rails."""
        return self.run.get(ON_RAILS) is True


def shard_names(index: int, *, growing: bool = False) -> tuple[str, str]:
    """File names of shard `index`; the second pair is for a last shard that grows (`CaseLibrary.fill`).

    >>> shard_names(7)
    ('cases-000007.parquet', 'tracks-000007.parquet')
    """
    end = "-growing.parquet" if growing else ".parquet"
    return f"cases-{index:06d}{end}", f"tracks-{index:06d}{end}"


def is_leftover(name: str, manifest: Manifest | None) -> bool:
    """Say whether a file was left by a killed run: its name is one of ours, but it is not listed."""
    listed = {file.name for s in manifest.shards for file in (s.cases_file, s.tracks_file)} if manifest else set()
    return _OURS.fullmatch(name) is not None and name not in listed


def replace_file(path: Path, content: bytes | memoryview) -> None:
    """Write a file as a whole or not at all.

    Raises:
        OutputError: The place cannot be written.
    """
    with writing(path) as part:
        part.write_bytes(content)


def write_manifest(folder: Path, manifest: Manifest) -> bytes:
    """Commit a manifest; returns the bytes written."""
    version = schema_version(scripted=manifest.scripted, on_rails=manifest.on_rails)
    content = {"format": _FORMAT, "schema_version": version, **asdict(manifest), "odd": manifest.odd.stated()}
    text = json.dumps(with_checksum(content), indent=1, allow_nan=False) + "\n"
    replace_file(folder / MANIFEST, text.encode())
    return text.encode()


def read_manifest(folder: Path, *, old: bool = False) -> tuple[Manifest, bytes]:
    """Read a library's manifest; returns it and its bytes.

    Args:
        folder: The library.
        old: It may be one without a checksum, as version 0.1 wrote it.

    Raises:
        FileFormatError: There is none, it is damaged, or of another schema.
    """
    path = folder / MANIFEST
    try:
        content = read_bytes(path)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FileFormatError(f"{folder} is no case library: it holds no {MANIFEST}; `generate` makes one.") from error
    except OSError as error:
        raise FileFormatError(f"Cannot read {path}: {reason(error)}.") from error
    try:
        parsed = parse(content.decode())
    except ValueError as error:
        raise FileFormatError(f"{path} is damaged: {error}; restore it from a copy.") from error
    if not isinstance(parsed, dict) or parsed.get("format") != _FORMAT:
        raise FileFormatError(f"{path} is not the manifest of a case library; give the folder that `generate` made.")
    if old and KEY not in parsed:
        parsed = with_checksum(parsed)
    version = parsed.get("schema_version")
    if version not in range(1, SCHEMA_VERSION + 1):
        newer = isinstance(version, int) and version > SCHEMA_VERSION
        advice = "upgrade cornerforge" if newer else "restore the manifest from a copy"
        raise FileFormatError(
            f"{folder} has library schema {version!r}, written by cornerforge {parsed.get('created_by')}; "
            f"this version reads schemas 1 to {SCHEMA_VERSION}: {advice}."
        )
    rest = check_json(path, parsed)
    fault = object_fault(parsed, MANIFEST_FIELDS) or _shards_fault(parsed["shards"])
    fault = fault or object_fault(parsed["run"], [one for one in IDENTITY_FIELDS if one.name in parsed["run"]], "run")
    if fault is not None:
        raise FileFormatError(f"{path} is damaged: {fault}; restore it from a copy.")
    try:
        return _parse(rest), content
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise FileFormatError(f"{path} is damaged: {error}; restore it from a copy.") from error


def _shards_fault(shards: Sequence[Mapping[str, Any]]) -> str | None:
    """Say what is wrong with one of the shards of a manifest, or None."""
    for i, shard in enumerate(shards):
        place = f"shards[{i}]"
        fault = object_fault(shard, SHARD_FIELDS, place)
        for key in ("cases_file", "tracks_file") if fault is None else ():
            fault = fault or object_fault(shard[key], FILE_FIELDS, f"{place}.{key}")
        if fault is not None:
            return fault
    return None


def _parse(content: dict[str, Any]) -> Manifest:
    values = {name: content[name] for name in (field.name for field in fields(Manifest))}
    shards = tuple(_parse_shard(i, shard) for i, shard in enumerate(values.pop("shards")))
    check_identity(values["run"])
    extra = values["extra"] or {}
    if not set(map(str, extra.values())) <= set(EXTRA_TYPES):
        raise ValueError(f'"extra" is {extra}; its types must be {", ".join(EXTRA_TYPES)}')
    return Manifest(**values | {"odd": Odd.of_stated(values["odd"]), "shards": shards})


def _parse_shard(index: int, content: dict[str, Any]) -> Shard:
    both = [content[key] for key in ("cases_file", "tracks_file")]
    files = [StoredFile(file["name"], file["size"], file["sha256"]) for file in both]
    # A manifest is input: it must not lead to files outside its folder.
    if tuple(file.name for file in files) not in (shard_names(index), shard_names(index, growing=True)):
        raise ValueError(f"shard {index} names the files {[file.name for file in files]}")
    return Shard(content["cases"], content["first_test"], content["last_test"], *files)


def first_difference(theirs: Manifest, run: Identity, odd: Odd) -> str | None:
    """Give the first difference between a library's run and another, as text, or None."""
    for key in [*theirs.run, *(key for key in run if key not in theirs.run)]:
        if key not in theirs.run or key not in run or theirs.run[key] != run[key]:
            return f"{key} is {theirs.run.get(key)!r} there and {run.get(key)!r} here"
    for name, value in asdict(odd).items():
        if getattr(theirs.odd, name) != value:
            return f"odd.{name} is {getattr(theirs.odd, name)!r} there and {value!r} here"
    return None


def check_identity(run: Identity) -> dict[str, str | int | float | bool | None]:
    """Return a copy of what names a run, if it is flat JSON with a whole number `seed`.

    Raises:
        InputError: It is not.
    """
    if not isinstance(run, Mapping):
        raise InputError(f"A library's identity is a dictionary, not {shown(run)}.")
    if isinstance(run.get("seed"), bool) or not isinstance(run.get("seed"), int):
        raise InputError(f'A library\'s identity needs a whole number "seed"; it is {run.get("seed")!r}.')
    for key, value in run.items():
        is_nan_or_inf = isinstance(value, float) and not math.isfinite(value)
        holds_nul = isinstance(value, str) and "\0" in value
        if not isinstance(value, (str, int, float, bool, type(None))) or is_nan_or_inf or holds_nul:
            raise InputError(
                f"identity[{key!r}] = {value!r} is not a text without NUL, finite number, true, false or null."
            )
    return dict(run)
