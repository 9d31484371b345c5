"""The ledger of the ground truth: results of long counts so far, in one committed file that any machine continues.

An entry holds all that tests 0 .. n-1 of a setting gave, and the hashes of what they were driven with: natural traffic
of the same model, AV, road, simulation code and seed gives the same tests to the bit, so test n follows on any machine.
Counts of different hashes never mix. One exception, on request and checked (`Entry.driven_by`): simulation code that
was rewritten, say for speed, and still drives the same bits.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cornerforge
from cornerforge._checksums import KEY, json_checksum
from cornerforge.analysis.mechanism import MECHANISMS
from cornerforge.errors import FileFormatError, InputError
from cornerforge.experiment.output import read_json_file, write_text
from cornerforge.rates.crashes import CrashStudy
from cornerforge.rates.exposure import BvTravel
from cornerforge.rates.monte_carlo import MonteCarlo

__all__ = [
    "SCHEMA", "Entry", "agree", "furthest", "read_entry", "read_ledger", "simulation_hash", "trees_hash",
    "write_entry", "write_ledger",
]  # fmt: skip

SCHEMA = 1
_SIMULATION = (
    "_jit.py", "_philox.py", "_elementary.py", "fields.py", "geometry.py", "types.py", "ndd/grids.py", "ndd/memory.py",
    "drivers/*.py", "road/*.py", "sim/*.py", "sim/site/*.py", "site/*.py",
)  # fmt: skip
_NOT_NATURAL = (
    "policy.py", "adversaries.py", "observe.py", "recorder.py", "statistics.py", "avs.py", "__init__.py",
)  # fmt: skip
"""Natural traffic does not depend on these; an AV's numbers have a hash of their own."""
_TREES = ("rates/branching/*.py", "rates/teaching.py")
_CRASH_COLUMNS = (
    "test", "time", "crash_type", "mechanism", "at_start", "rarest_chance", "rare_action", "overlooked",
    "looked_away",
)  # fmt: skip
_BEFORE_LOOKING_AWAY = _CRASH_COLUMNS[:-1]
"""Columns of entries from before drivers looked away."""


def _skeleton(node: object) -> Iterator[str]:
    """A syntax tree without places, comments and docstrings, and without what Python versions write differently."""
    if isinstance(node, ast.AST):
        yield type(node).__name__
        for name, value in ast.iter_fields(node):
            if value is None or value == []:
                continue
            yield f"{name}("
            if name == "body" and isinstance(value, list):
                value = [item for item in value if not _is_text(item)]
            yield from _skeleton(value)
            yield ")"
    elif isinstance(node, list):
        for item in node:
            yield from _skeleton(item)
    else:
        yield repr(node)


def _is_text(statement: ast.AST) -> bool:
    """Is a statement a docstring, or a text that documents the constant above it?"""
    return isinstance(statement, ast.Expr) and isinstance(getattr(statement.value, "value", None), str)


def simulation_hash(package: Path | None = None) -> str:
    """SHA-256 (first 16 hex digits) over the code that decides how natural traffic drives; comments do not count."""
    return _hash(_SIMULATION, _NOT_NATURAL, package)


def trees_hash(package: Path | None = None) -> str:
    """The same over the code that decides how tests branch into trees, beside that."""
    return _hash(_TREES, (), package)


def _hash(patterns: Sequence[str], but: Sequence[str], package: Path | None) -> str:
    package = package or Path(cornerforge.__file__).parent
    digest = hashlib.sha256()
    for pattern in patterns:
        for path in sorted(package.glob(pattern)):
            if path.name not in but:
                digest.update(f"{path.relative_to(package).as_posix()}\n".encode())
                digest.update(" ".join(_skeleton(ast.parse(path.read_text(encoding="utf-8")))).encode())
    return digest.hexdigest()[:16]


@dataclass(frozen=True)
class Entry:
    """What one setting came to.

    Attributes:
        identity: Names and hashes of what was driven.
        counts: Tests 0 .. n-1, whole blocks only.
        first_block: Digest of block 0 alone: to see whether another machine computes the same bits.
        travel: Distance of BVs, from a counted sample; None before the first block.
        crashes: `test`, `time` into it [s] and the `CrashStudy` columns of every AV crash, in the order of the tests.
        earlier_simulations: Hashes of the simulation code that counted before that of `identity`, oldest first; each
            was seen to drive the same bits as the next.
    """

    identity: dict[str, Any]
    counts: MonteCarlo = field(default_factory=MonteCarlo)
    first_block: str = ""
    travel: BvTravel | None = None
    crashes: tuple[dict[str, Any], ...] = ()
    earlier_simulations: tuple[str, ...] = ()

    def driven_by(self, simulation: str) -> Entry:
        """This entry as one of other simulation code, which drives the same bits: the caller has seen that it does."""
        if simulation == self.identity["simulation"]:
            return self
        earlier = (*self.earlier_simulations, str(self.identity["simulation"]))
        return replace(self, identity={**self.identity, "simulation": simulation}, earlier_simulations=earlier)

    def with_crash(self, test: int, time: float, study: CrashStudy) -> Entry:
        """This entry with one more crash described, `time` [s] into its test."""
        columns = study.columns()
        if columns["rarest_chance"] is not None:
            columns["rarest_chance"] = float(f"{columns['rarest_chance']:.3g}")
        return replace(self, crashes=(*self.crashes, {"test": test, "time": round(time, 1), **columns}))

    def to_text(self) -> str:
        """JSON with one line a crash, so that a diff of the file shows what came new."""
        counts = {key: value for key, value in self.counts.to_json().items() if key != "crashed"}
        for key in ("seconds", "cpu_seconds"):
            counts[key] = round(counts[key], 1)
        travel = None if self.travel is None else vars(self.travel)
        parts = {
            "identity": self.identity,
            "earlier_simulations": self.earlier_simulations,
            "counts": counts,
            "first_block": self.first_block,
            "bv_travel": travel,
        }
        lines = [f'"{name}": {json.dumps(value, allow_nan=False)}' for name, value in parts.items()]
        rows = [json.dumps([crash[name] for name in _CRASH_COLUMNS]) for crash in self.crashes]
        crashes = "[\n" + ",\n".join(rows) + "\n]" if rows else "[]"
        lines += [f'"crash_columns": {json.dumps(_CRASH_COLUMNS)}', f'"crashes": {crashes}']
        return "{\n" + ",\n".join(lines) + "\n}"


def _entry(content: Mapping[str, Any], where: str) -> Entry:
    try:
        names = content["crash_columns"]
        crashes = tuple(dict(zip(names, row, strict=True)) for row in content["crashes"])
        travel = content["bv_travel"]
        counts = MonteCarlo.from_json({**content["counts"], "crashed": [crash["test"] for crash in crashes]})
        unknown = {crash["mechanism"] for crash in crashes} - set(MECHANISMS)
        if unknown or tuple(names) not in (_CRASH_COLUMNS, _BEFORE_LOOKING_AWAY):
            raise ValueError(f"unknown {unknown or names}")
        crashes = tuple({"looked_away": False} | crash for crash in crashes)
        return Entry(
            dict(content["identity"]),
            counts,
            str(content["first_block"]),
            None if travel is None else BvTravel(**travel),
            crashes,
            tuple(str(name) for name in content.get("earlier_simulations", ())),
        )
    except (KeyError, TypeError, ValueError, FileFormatError) as error:
        raise FileFormatError(f"{where} is no entry of a ledger of this version ({error}); remove it.") from error


def read_ledger(path: Path) -> dict[str, Entry]:
    """All entries of a ledger by the setting's name; none if there is no file.

    Raises:
        FileFormatError: It is damaged or of another schema.
    """
    if not path.exists():
        return {}
    content = read_json_file(path)
    if content.get("schema") != SCHEMA or not isinstance(content.get("settings"), dict):
        raise FileFormatError(f"{path} is no ledger of schema {SCHEMA}; choose another with --ledger.")
    return {name: _entry(entry, f"{path}: {name}") for name, entry in content["settings"].items()}


def write_ledger(path: Path, entries: Mapping[str, Entry]) -> None:
    """Write a ledger with its checksum, whole or not at all; settings in the order of their names."""
    body = ",\n".join(f"{json.dumps(name)}: {entries[name].to_text()}" for name in sorted(entries))
    _write(path, f'{{"schema": {SCHEMA}, "settings": {{\n{body}\n}}}}')


def write_entry(path: Path, entry: Entry) -> None:
    """Write an entry to a file of its own with its checksum, whole or not at all."""
    _write(path, entry.to_text())


def _write(path: Path, text: str) -> None:
    """Write the text of a JSON object, with its checksum as last key."""
    write_text(path, f'{text[:-1]}, "{KEY}": "{json_checksum(json.loads(text))}"}}\n')


def read_entry(path: Path) -> Entry | None:
    """One entry from a file of its own; None if there is none."""
    return _entry(read_json_file(path), str(path)) if path.exists() else None


def agree(entry: Entry, identity: Mapping[str, Any], where: str) -> None:
    """Check that an entry was made with the same model, AV, road, code and seed.

    Raises:
        InputError: It was not; the message names all that differs.
    """
    keys = [key for key in {**entry.identity, **identity} if entry.identity.get(key) != identity.get(key)]
    if keys:
        differences = ", ".join(f"{key} {entry.identity.get(key)} (here {identity.get(key)})" for key in keys)
        raise InputError(
            f"{where} was counted with other {differences}. Such counts do not mix: "
            + ("try whether both drive the same with --same-bits, " if keys == ["simulation"] else "")
            + "go back to that version, or begin this setting anew with --restart."
        )


def furthest(
    entries: Mapping[str, Entry | None], identity: Mapping[str, Any], *, restart: bool, same_bits: bool = False
) -> Entry:
    """The entry with the most tests among those of the same identity; a new one if there is none.

    With `same_bits` it may be one of other simulation code: compare its identity.

    Args:
        entries: By where they lie.
        identity: What is to be driven now.
        restart: Forget entries of another identity instead of refusing them.
        same_bits: Take entries that differ in nothing but the simulation code, too; the caller compares the bits.

    Raises:
        InputError: One is of another identity, and `restart` is False.
    """
    best = Entry(dict(identity))
    for where, entry in entries.items():
        if entry is None:
            continue
        try:
            agree(entry.driven_by(identity["simulation"]) if same_bits else entry, identity, where)
        except InputError:
            if not restart:
                raise
            continue
        best = entry if entry.counts.tests > best.counts.tests else best
    return best
