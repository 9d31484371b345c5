"""The manifest: what a library holds and how far its run has come. Replacing it commits a shard.

A kill leaves either the old manifest or the new one (`_files`). After a power failure checksums tell which shards did
not reach the disk; waiting for the disk at each shard would protect against nothing else.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, TypeAlias, get_type_hints

import msgspec

from cornerforge._checksums import KEY, check_json, with_checksum
from cornerforge._files import read_bytes, reason, writing
from cornerforge._schema import Whole, meant, parse, read
from cornerforge._words import shown
from cornerforge.errors import FileFormatError, InputError
from cornerforge.library.schema import ON_RAILS, SCHEMA_VERSION, SCRIPTED, ExtraType, RunIdentity, schema_version
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
_PartOfIdentity = msgspec.defstruct(
    "_PartOfIdentity",
    [
        (name, kind | msgspec.UnsetType, msgspec.UNSET)
        for name, kind in get_type_hints(RunIdentity, include_extras=True).items()
    ],
)
"""What `run` may hold of a `RunIdentity`: libraries of other programs lack some of it."""
_OURS = re.compile(rf"{_SHARD_FILE}|\.({_SHARD_FILE}|manifest\.json)(\.[0-9a-f]{{8}})?\.part")


@dataclass(frozen=True)
class StoredFile:
    """A file of a shard."""

    name: Annotated[str, meant("In the library's folder.")]
    size: Annotated[Whole, meant("Of the file.", "bytes")]
    sha256: Annotated[str, meant("Of the file, 64 hex digits.")]

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
    """Cases that were committed together."""

    cases: Annotated[int, meant("How many cases it holds.", "", 1, 2**31 - 1)]
    first_test: Annotated[Whole, meant("Its first test.")]
    last_test: Annotated[Whole, meant("Its last test.")]
    cases_file: Annotated[StoredFile, meant("The file of its cases.")]
    tracks_file: Annotated[StoredFile, meant("The file of its trajectories.")]


@dataclass(frozen=True)
class Manifest:
    """All that a library stores besides its cases; two libraries with equal `run` and `odd` hold the same cases."""

    created_by: Annotated[str, meant("Version of cornerforge that created it.")]
    run: Annotated[Identity, meant("What names the run: flat, with a whole `seed`.")]
    odd: Annotated[Odd, meant("Road and rules of all cases; what does not occur may be left out.")]
    extra: Annotated[Mapping[str, ExtraType] | None, meant("Own columns, type by name; null: no case yet.")]
    shards: Annotated[tuple[Shard, ...], meant("The shards, ascending by test.")]
    next_test: Annotated[Whole, meant("All tests below it are done.")]
    tests: Annotated[Whole, meant("Tests done.")]
    crashes: Annotated[Whole, meant("AV crashes among them; may exceed the cases stored.")]
    finished: Annotated[bool, meant("The run reached its target.")]

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
        FileFormatError: The manifest is missing, damaged, or of another schema.
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
    place, advice = f"{path} is damaged", "restore it from a copy."
    try:
        found = read(Manifest, {**rest, "odd": Odd.of_stated(rest["odd"])}, place, advice)
        check_identity(found.run)
    except (KeyError, TypeError, InputError) as error:
        raise FileFormatError(f"{place}: {str(error).rstrip('.')}; {advice}") from error
    read(_PartOfIdentity, found.run, place, advice)
    for index, shard in enumerate(found.shards):  # input, which must not lead to files outside its folder
        names = shard.cases_file.name, shard.tracks_file.name
        if names not in (shard_names(index), shard_names(index, growing=True)):
            raise FileFormatError(f"{place}: shard {index} names the files {list(names)}; {advice}")
    return found, content


def first_difference(theirs: Manifest, run: Identity, odd: Odd) -> str | None:
    """Give the first difference between a library's run and another, as text, or None."""
    for key in [*theirs.run, *(key for key in run if key not in theirs.run)]:
        if key not in theirs.run or key not in run or theirs.run[key] != run[key]:
            return f"{key} is {theirs.run.get(key)!r} there and {run.get(key)!r} here"
    for name in (one.name for one in fields(odd)):
        there, here = getattr(theirs.odd, name), getattr(odd, name)
        if there == here:
            continue
        if name == "road" and there and here:  # all of both would fill a page
            other = "another road of this name" if there.name == here.name else here.name
            return f"odd.road is {there.name} there and {other} here"
        return f"odd.{name} is {there!r} there and {here!r} here"
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
