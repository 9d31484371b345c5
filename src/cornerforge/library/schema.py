"""Schemas of the case library's files, made from the lists in `fields.py`.

A shard is two Parquet files with the same rows in the same order: `cases-NNNNNN.parquet`, one small row a case (what
statistics and queries read), and `tracks-NNNNNN.parquet`, the trajectories (what one replay reads).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated

import msgspec
import pyarrow as pa

from cornerforge._arrow import arrow_fields, arrow_type
from cornerforge._schema import Declared, Hex, Whole, meant
from cornerforge.errors import InputError
from cornerforge.fields import CASES, SIZES, TRACKS, Field
from cornerforge.sim import scripted

__all__ = [
    "AV_SIZES",
    "EXTRA_TYPES",
    "ON_RAILS",
    "RAILS_TRACKS",
    "SCHEMA_VERSION",
    "SCRIPTED",
    "SCRIPTED_TRACKS",
    "ExtraType",
    "RunIdentity",
    "arrow_schema",
    "check_extra_name",
    "own_fields",
    "own_kinds",
    "schema_version",
    "tracks_fields",
]

SCHEMA_VERSION = 3
"""Version of the files; it rises when a reader of the version before would misread a file. 1: every case is a test of a
seed. 2: cases may be scripted. 3: their other vehicles may be on rails. A library has the lowest version that can read
it, so one of tests still has 1."""

SCRIPTED = "scripted"
"""Key, with the value true, in the identity of a library of scripted cases only: their start and actions are stored in
their tracks, not drawn from their seed."""

SCRIPTED_TRACKS: tuple[Field, ...] = (
    *TRACKS,
    Field(
        "start", "list of float64", "m, m/s, rad, m/s2, s",
        f"State of each stored vehicle at frame 0, one after the other, exactly: {', '.join(scripted.START_FIELDS)}.",
        (-1e6, 1e6),
    ),
)  # fmt: skip
"""Columns of the tracks file of a library of scripted cases. Stored: all vehicles; `action` is the script."""

ON_RAILS = "on_rails"
"""Key, with the value true, in the identity of a library of scripted cases with the other vehicles on rails."""

RAILS_TRACKS: tuple[Field, ...] = (
    *SCRIPTED_TRACKS,
    Field(
        "rails", "list of float64", "m, m/s, rad, m/s2",
        "Where each vehicle is told to be at each frame, exactly: frame after frame, in it vehicle after vehicle, of "
        "each x, y, speed along and across the road, heading, acceleration and lane; NaN for the AV and where it is "
        "absent.", (-1e6, 1e6), nan=True,
    ),
)  # fmt: skip
"""Columns of the tracks file of a library of cases on rails; `action` has no effect there."""

_EXTRA = {"bool": "bool", "int": "int64", "float": "float64", "str": "string"}
EXTRA_TYPES: dict[str, pa.DataType] = {name: arrow_type(kind) for name, kind in _EXTRA.items()}
"""Types that a caller's own columns may have, by the name that the manifest uses."""
ExtraType = Annotated[str, msgspec.Meta(pattern=f"^({'|'.join(_EXTRA)})$")]
"""One of these names."""

AV_SIZES: tuple[Field, ...] = (
    Field("av_length_m", "float64", "m", "Length of the AV of the case.", SIZES),
    Field("av_width_m", "float64", "m", "Width of the AV of the case.", SIZES),
)
"""Own columns of libraries with AVs that are not as large as the ODD's cars."""


class RunIdentity(Declared):
    """Identity of an experiment: `run` of a manifest, and `identity` of a provenance; commands add keys."""

    seed: Annotated[Whole, meant("Seed of the tests.")]
    odd: Annotated[str, meant("Name of the ODD.")]
    lanes: Annotated[int, meant("Lanes of the road.", "", 1, 6)]
    av: Annotated[str, meant("The AV, as it was named.")]
    av_hash: Annotated[Hex | None, meant("Hash of its parameters, weights or code; null: several AVs.")]
    model_hash: Annotated[Hex, meant("Hash of what decides how the naturalistic model drives.")]
    bv: Annotated[str, meant("What drives the BVs.")]
    bounded: Annotated[bool, meant("The adversary takes only actions that the naturalistic model can take.")]
    budget: Annotated[float, meant("Likelihood budget; null: no limit.", "nats", 0.0, 1e6)] | None
    budget_of: Annotated[str, meant("What the budget limits; missing: the shortfall.")] = "shortfall"
    steers_from: Annotated[int, meant("Second from which the adversary steers; missing: 0.", "s", 0, 60)] = 0
    acting: Annotated[str, meant("How policies act: greedily, at random, or as they learned to.")]
    policies: Annotated[int, meant("How many policies drive, in turn.", "", 0, 10_000)]
    policy_hash: Annotated[Hex | None, meant("Hash of them; null: none.")]
    av_steers: Annotated[bool, meant("The AV steers; missing: it does not.")] = False
    config_hash: Annotated[Hex | None, meant("Hash of the settings.")] = None
    cornerforge: Annotated[str | None, meant("Version that drove.")] = None
    code: Annotated[Hex | None, meant("Hash of the code that drove.")] = None
    scripted: Annotated[bool, meant("All cases are scripted; missing: they are tests of the seed.")] = False
    on_rails: Annotated[bool, meant("The other vehicles are on rails; missing: they drive.")] = False
    moving_cases: Annotated[Hex | None, meant("Hash of how others move in cases of recordings or other tools.")] = None
    source: Annotated[Hex | None, meant("Hash of the identity of the library that was shrunk.")] = None
    source_bv: Annotated[str | None, meant("What drove the BVs there.")] = None


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


def own_kinds(cases: pa.Table) -> dict[str, str]:
    """Give the caller's own columns of a table of cases, name to a key of `EXTRA_TYPES`."""
    kinds, known = {type_: name for name, type_ in EXTRA_TYPES.items()}, {column.name for column in CASES}
    return {field.name: kinds[field.type] for field in cases.schema if field.name not in known}


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
