"""Schemas of the case library's files and their documentation, made from the lists in `fields.py`.

A shard is two Parquet files with the same rows in the same order: `cases-NNNNNN.parquet`, one small row a case (what
statistics and queries read), and `tracks-NNNNNN.parquet`, the trajectories (what one replay reads).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import pyarrow as pa

from cornerforge._arrow import arrow_fields, arrow_type
from cornerforge.errors import InputError
from cornerforge.fields import CASES, SIZES, TRACKS, Field
from cornerforge.sim import START_FIELDS

__all__ = [
    "AV_SIZES",
    "EXTRA_TYPES",
    "FILE_FIELDS",
    "IDENTITY_FIELDS",
    "MANIFEST_FIELDS",
    "ON_RAILS",
    "RAILS_TRACKS",
    "SCHEMA_VERSION",
    "SCRIPTED",
    "SCRIPTED_TRACKS",
    "SHARD_FIELDS",
    "arrow_schema",
    "check_extra_name",
    "own_fields",
    "schema_markdown",
    "schema_version",
    "tracks_fields",
]

SCHEMA_VERSION = 3
"""Version of the files; it rises when a reader of the version before would misread a file. 1: every case is a test of a
seed. 2: cases may be scripted. 3: their other vehicles may be on rails. A library has the lowest version that can read
it, so one of tests still has 1."""

SCRIPTED = "scripted"
"""Key, with the value true, in the identity of a library whose cases are all scripted: their start and actions are
stored in their tracks, not drawn from their seed."""

SCRIPTED_TRACKS: tuple[Field, ...] = (
    *TRACKS,
    Field(
        "start", "list of float64", "m, m/s, rad, m/s2, s",
        f"State of each stored vehicle at frame 0, one after the other, exactly: {', '.join(START_FIELDS)}.",
        (-1e6, 1e6),
    ),
)  # fmt: skip
"""Columns of the tracks file of a library of scripted cases. Stored: all vehicles; `action` is the script."""

ON_RAILS = "on_rails"
"""Key, with the value true, in the identity of a library of scripted cases whose other vehicles are on rails."""

RAILS_TRACKS: tuple[Field, ...] = (
    *SCRIPTED_TRACKS,
    Field(
        "rails", "list of float64", "m, m/s, rad, m/s2",
        "Where each vehicle is told to be at each frame, exactly: frame after frame, in it vehicle after vehicle, of "
        "each x, y, speed along and across the road, heading, acceleration and lane; NaN for the AV and where it is "
        "absent.", (-1e6, 1e6), nan=True,
    ),
)  # fmt: skip
"""Columns of the tracks file of a library whose cases are on rails; `action` moves nobody there."""

_EXTRA = {"bool": "bool", "int": "int64", "float": "float64", "str": "string"}
EXTRA_TYPES: dict[str, pa.DataType] = {name: arrow_type(kind) for name, kind in _EXTRA.items()}
"""Types that a caller's own columns may have, by the name that the manifest uses."""

AV_SIZES: tuple[Field, ...] = (
    Field("av_length_m", "float64", "m", "Length of the AV of the case.", SIZES),
    Field("av_width_m", "float64", "m", "Width of the AV of the case.", SIZES),
)
"""Own columns of libraries whose AVs are not as large as the ODD's cars."""


_COUNT = (0, 2**63 - 1)
MANIFEST_FIELDS: tuple[Field, ...] = (
    Field("format", "string", "", "Always `cornerforge case library`."),
    Field("schema_version", "int64", "", "The lowest version that can read the library.", (1, SCHEMA_VERSION)),
    Field("created_by", "string", "", "Version of cornerforge that created it."),
    Field(
        "run", "object", "", "What names the run: texts, numbers, true, false or nothing by name, with a whole `seed`."
    ),
    Field(
        "odd",
        "object",
        "",
        "Road and rules: the fields of `cornerforge.Odd`; what does not occur may be left out.",
    ),
    Field("extra", "object", "", "Own columns of the library, type by name; null: no case yet.", nullable=True),
    Field("shards", "list of object", "", "The shards, ascending by test."),
    Field("next_test", "int64", "", "All tests below it are done.", _COUNT),
    Field("tests", "int64", "", "Tests done.", _COUNT),
    Field("crashes", "int64", "", "AV crashes among them; may exceed the cases stored.", _COUNT),
    Field("finished", "bool", "", "The run reached its target."),
    Field("sha256", "string", "", "Of the other keys."),
)
"""What a manifest holds."""

IDENTITY_FIELDS: tuple[Field, ...] = (
    Field("seed", "int64", "", "Seed of the tests.", (0, 2**63 - 1)),
    Field("odd", "string", "", "Name of the ODD."),
    Field("lanes", "int64", "", "Lanes of the road.", (1, 6)),
    Field("av", "string", "", "The AV, as it was named."),
    Field("av_hash", "hex", "", "Hash of its parameters, weights or code; null: several AVs.", nullable=True),
    Field("model_hash", "hex", "", "Hash of what decides how the naturalistic model drives."),
    Field("bv", "string", "", "What drives the BVs."),
    Field("bounded", "bool", "", "The adversary takes only actions that the naturalistic model can take."),
    Field("budget", "float64", "nats", "Likelihood budget; null: no limit.", (0.0, 1e6), nullable=True),
    Field("acting", "string", "", "How policies act: greedily, or at random."),
    Field("policies", "int64", "", "How many policies drive, in turn.", (0, 10_000)),
    Field("policy_hash", "hex", "", "Hash of them; null: none.", nullable=True),
    Field("av_steers", "bool", "", "The AV steers; may be missing: it does not.", optional=True),
    Field("config_hash", "hex", "", "Hash of the settings; may be missing.", optional=True),
    Field("cornerforge", "string", "", "Version that drove; may be missing.", optional=True),
    Field("code", "hex", "", "Hash of the code that drove; may be missing.", optional=True),
    Field("scripted", "bool", "", "All cases are scripted; may be missing: they are tests of the seed.", optional=True),
    Field("on_rails", "bool", "", "The other vehicles are on rails; may be missing: they drive.", optional=True),
    Field(
        "moving_cases",
        "hex",
        "",
        "Hash of how others move in cases of recordings or other tools; may be missing.",
        optional=True,
    ),
    Field("source", "hex", "", "Hash of the identity of the library that was shrunk; may be missing.", optional=True),
    Field("source_bv", "string", "", "What drove the BVs there; may be missing.", optional=True),
)
"""What `run` of a library's manifest, and `identity` of a provenance, hold of an experiment; commands add keys."""

SHARD_FIELDS: tuple[Field, ...] = (
    Field("cases", "int64", "", "How many cases it holds.", (1, 2**31 - 1)),
    Field("first_test", "int64", "", "Its first test.", _COUNT),
    Field("last_test", "int64", "", "Its last test.", _COUNT),
    Field("cases_file", "object", "", "The file of its cases."),
    Field("tracks_file", "object", "", "The file of its trajectories."),
)
"""What a manifest holds of a shard."""

FILE_FIELDS: tuple[Field, ...] = (
    Field("name", "string", "", "In the library's folder."),
    Field("size", "int64", "bytes", "Of the file.", _COUNT),
    Field("sha256", "string", "", "Of the file, 64 hex digits."),
)
"""What a manifest holds of a file."""


def check_extra_name(name: str) -> str:
    """Return the name of a caller's own column if it can stand in SQL and is not taken.

    Raises:
        InputError: It cannot, or it is.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,62}", name):
        raise InputError(f'Extra column "{name}" is not a plain name; use lower-case letters, digits and _.')
    if name in {column.name for column in CASES}:
        raise InputError(f'Extra column "{name}" is the name of a column that every library has; choose another.')
    return name


def own_fields(extra: Mapping[str, str]) -> tuple[Field, ...]:
    """Say what a caller's own columns hold: no value is missing; a real number may be anything.

    Args:
        extra: Name to a key of `EXTRA_TYPES`.
    """
    known = {field.name: field for field in AV_SIZES}
    anything = "One of the caller's own; may be NaN.", (-math.inf, math.inf)
    return tuple(known.get(name) or Field(name, _EXTRA[kind], "", *anything, nan=True) for name, kind in extra.items())


def tracks_fields(run: Mapping[str, object]) -> tuple[Field, ...]:
    """Give the columns of the tracks of a library, by what names its run."""
    return RAILS_TRACKS if run.get(ON_RAILS) is True else SCRIPTED_TRACKS if run.get(SCRIPTED) is True else TRACKS


def arrow_schema(columns: tuple[Field, ...], extra: Mapping[str, str] | None = None) -> pa.Schema:
    """Arrow schema with unit and meaning as field metadata.

    Args:
        columns: `CASES`, `TRACKS`, `SCRIPTED_TRACKS` or `RAILS_TRACKS`.
        extra: Caller's own columns, name to a key of `EXTRA_TYPES`.
    """
    fields = arrow_fields(columns)
    fields += [pa.field(name, EXTRA_TYPES[kind]) for name, kind in (extra or {}).items()]
    version = schema_version(
        scripted=columns is SCRIPTED_TRACKS or columns is RAILS_TRACKS, on_rails=columns is RAILS_TRACKS
    )
    return pa.schema(fields, metadata={"cornerforge_schema_version": str(version)})


def schema_version(*, scripted: bool, on_rails: bool = False) -> int:
    """Give the lowest version that can read a library.

    Args:
        scripted: Whether its cases are scripted.
        on_rails: Whether their other vehicles are on rails.
    """
    if on_rails:
        return SCHEMA_VERSION
    return 2 if scripted else 1


def schema_markdown(columns: tuple[Field, ...]) -> str:
    """Columns as a Markdown table: name, type, unit, allowed values, meaning; for the documentation.

    >>> print(schema_markdown(CASES[:1]))
    | column | type | unit | allowed | meaning |
    | --- | --- | --- | --- | --- |
    | `case_id` | string |  |  | Name of the case, seed:test. |
    """
    rows = [
        f"| `{c.name}` | {c.type} | {c.unit} | {c.allowed} | {c.meaning.replace('|', chr(92) + '|')} |" for c in columns
    ]
    return "\n".join(["| column | type | unit | allowed | meaning |", "| --- | --- | --- | --- | --- |", *rows])
