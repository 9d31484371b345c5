"""Columns of the case library: the one list from which files, documentation and checks are made.

A shard is two Parquet files with the same rows in the same order: `cases-NNNNNN.parquet`, one small row a case (what
statistics and queries read), and `tracks-NNNNNN.parquet`, the trajectories (what one replay reads).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import pyarrow as pa

from cornerforge.errors import InputError
from cornerforge.sim.scripted import START_FIELDS

__all__ = [
    "CASES",
    "EXTRA_TYPES",
    "HISTORY_SHAPE",
    "SCHEMA_VERSION",
    "SCRIPTED",
    "SCRIPTED_TRACKS",
    "TRACKS",
    "Column",
    "arrow_schema",
    "check_extra_name",
    "schema_markdown",
    "schema_version",
]

SCHEMA_VERSION = 2
"""Rises whenever a reader of the version before would misread a file. 1: every case is a test of a seed. 2: the cases
may be scripted. A library bears the lowest version whose readers understand it, so one of tests still bears 1."""

SCRIPTED = "scripted"
"""What names the run has this key, and true, where all cases of a library are scripted: what their replay starts from
and does is in their tracks, not drawn from their seed."""

HISTORY_SHAPE = (16, 2, 4)
"""Seconds 0..15 before the contact; AV, crash partner; x [m], y [m], speed [m/s], heading [rad]."""


@dataclass(frozen=True)
class Column:
    """One column of a shard.

    Attributes:
        name: As in the file; ends in its unit where it has one.
        type: Arrow type.
        unit: Of the values, "" for none.
        meaning: One sentence, with the edge values.
    """

    name: str
    type: pa.DataType
    unit: str
    meaning: str


_FLAT = "vehicle by vehicle: vehicle i at frame t stands at i * n_frames + t"
_N_HISTORY = HISTORY_SHAPE[0] * HISTORY_SHAPE[1] * HISTORY_SHAPE[2]


def _limits(who: str, name: str) -> tuple[Column, ...]:
    real = pa.float64()
    return (
        Column(f"{who}_max_acceleration_mps2", real, "m/s2", f"Largest acceleration of {name}; null below 2 frames."),
        Column(f"{who}_max_braking_mps2", real, "m/s2", f"Largest braking of {name}, positive; null below 2 frames."),
        Column(
            f"{who}_max_lateral_acceleration_mps2", real, "m/s2",
            f"Largest |lateral acceleration| of {name}, second differences of y; null below 3 frames.",
        ),
    )  # fmt: skip


CASES: tuple[Column, ...] = (
    Column("case_id", pa.string(), "", "Name of the case, seed:test."),
    Column("seed", pa.int64(), "", "Seed of the run."),
    Column("test", pa.int64(), "", "Index of the test within the seed."),
    Column("crash_time_s", pa.float64(), "s", "First contact, since the start of the test."),
    Column("duration_s", pa.float64(), "s", "Length of the recording."),
    Column("bv_slot", pa.int16(), "", "Slot of the crash partner, the BV that the AV touches first."),
    Column("av_speed_mps", pa.float64(), "m/s", "Speed of the AV at contact."),
    Column("bv_speed_mps", pa.float64(), "m/s", "Speed of the crash partner at contact."),
    Column("impact_speed_difference_mps", pa.float64(), "m/s", "Partner's speed minus the AV's at contact."),
    Column("relative_heading_rad", pa.float64(), "rad", "Partner's heading minus the AV's at contact, in [-pi, pi)."),
    Column("relative_lon_m", pa.float64(), "m", "Partner's centre minus the AV's along the road at contact."),
    Column("relative_lat_m", pa.float64(), "m", "Partner's centre minus the AV's, to the left, at contact."),
    Column("av_lane", pa.int8(), "", "Lane that holds the AV's centre at contact, 0 = rightmost."),
    Column("relative_lane", pa.int8(), "", "Lane of the partner's centre minus the AV's at contact."),
    *_limits("av", "the AV"),
    *_limits("bv", "the crash partner"),
    Column("physically_plausible", pa.bool_(), "", "AV, partner: -8.5..4 m/s2 along, 4 m/s2 across the road."),
    Column("min_ttc_s", pa.float64(), "s", "Smallest TTC of the AV before contact; null: never closing."),
    Column("n_vehicles", pa.int16(), "", "Vehicles in the test, the AV among them."),
    Column("n_decisions", pa.int16(), "", "Decisions (one a second) in the test."),
    Column("log_prob_nde", pa.float64(), "", "ln P(critical BV's actions) in the NDE; null: P = 0."),
    Column("n_impossible", pa.int16(), "", "Critical BV's decisions of probability 0 in the NDE."),
    Column("trajectory_digest", pa.string(), "", "Of all vehicles at full precision; for `replay --check`."),
    Column("critical_bv_action", pa.list_(pa.int8()), "", "Critical BV's action at each decision; -1: no BV."),
    Column(
        "history", pa.list_(pa.float32(), _N_HISTORY), "m, m/s, rad",
        "[second 0..15 before contact][AV, partner][x, y, speed, heading], flat; NaN before the test began.",
    ),
)  # fmt: skip
"""Columns of a cases file."""

TRACKS: tuple[Column, ...] = (
    Column("case_id", pa.string(), "", "Name of the case, seed:test."),
    Column("n_frames", pa.int32(), "", "Frames, 0.1 s apart, from the start of the test to contact."),
    Column("slot", pa.list_(pa.int16()), "", "Slots of the stored vehicles; the AV first."),
    Column("x_m", pa.list_(pa.float32()), "m", f"Box centre along the road, {_FLAT}; NaN where absent."),
    Column("y_m", pa.list_(pa.float32()), "m", "Box centre, to the left of the right road edge; likewise."),
    Column("speed_mps", pa.list_(pa.float32()), "m/s", "Along the road; likewise."),
    Column("heading_rad", pa.list_(pa.float32()), "rad", "Counter-clockwise from the road's direction; likewise."),
    Column("acceleration_mps2", pa.list_(pa.float32()), "m/s2", "Held from this frame to the next; likewise."),
    Column("target_lane", pa.list_(pa.int8()), "", "Lane kept or changed to; -1 where absent; likewise."),
    Column("present", pa.list_(pa.bool_()), "", "The vehicle exists; likewise."),
    Column("action", pa.list_(pa.int8()), "", "Decision k of vehicle i at i * n_decisions + k; -1: none."),
    Column("critical_bv", pa.list_(pa.int16()), "", "Critical BV's index into `slot` at each decision; -1: none."),
    Column("decision_log_prob_nde", pa.list_(pa.float64()), "", "ln P(its action) in the NDE; 0: no BV."),
)  # fmt: skip
"""Columns of a tracks file. Stored: the AV, its crash partner, critical BVs, and who comes within 150 m of the AV."""

SCRIPTED_TRACKS: tuple[Column, ...] = (
    *TRACKS,
    Column(
        "start", pa.list_(pa.float64()), "m, m/s, rad, m/s2, s",
        f"State of each stored vehicle at frame 0, one after the other, exactly: {', '.join(START_FIELDS)}.",
    ),
)  # fmt: skip
"""Columns of the tracks file of a library of scripted cases. Stored: all vehicles; `action` is the script."""

EXTRA_TYPES: dict[str, pa.DataType] = {
    "bool": pa.bool_(),
    "int": pa.int64(),
    "float": pa.float64(),
    "str": pa.string(),
}
"""Types that a caller's own columns may have, by the name that the manifest uses."""


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


def arrow_schema(columns: tuple[Column, ...], extra: Mapping[str, str] | None = None) -> pa.Schema:
    """Arrow schema with unit and meaning as field metadata.

    Args:
        columns: `CASES`, `TRACKS` or `SCRIPTED_TRACKS`.
        extra: Caller's own columns, name to a key of `EXTRA_TYPES`.
    """
    fields = [
        pa.field(c.name, c.type, metadata={"unit": c.unit, "meaning": c.meaning} if c.unit else {"meaning": c.meaning})
        for c in columns
    ]
    fields += [pa.field(name, EXTRA_TYPES[kind]) for name, kind in (extra or {}).items()]
    version = schema_version(scripted=columns is SCRIPTED_TRACKS)
    return pa.schema(fields, metadata={"cornerforge_schema_version": str(version)})


def schema_version(*, scripted: bool) -> int:
    """The lowest version whose readers understand a library.

    Args:
        scripted: Its cases are scripted.
    """
    return SCHEMA_VERSION if scripted else 1


def schema_markdown(columns: tuple[Column, ...]) -> str:
    """Columns as a Markdown table: name, type, unit, meaning; for the documentation.

    >>> print(schema_markdown(CASES[:1]))
    | column | type | unit | meaning |
    | --- | --- | --- | --- |
    | `case_id` | string |  | Name of the case, seed:test. |
    """
    rows = [f"| `{c.name}` | {_type_name(c.type)} | {c.unit} | {c.meaning} |" for c in columns]
    return "\n".join(["| column | type | unit | meaning |", "| --- | --- | --- | --- |", *rows])


def _type_name(kind: pa.DataType) -> str:
    if pa.types.is_fixed_size_list(kind):
        return f"{kind.value_type}[{kind.list_size}]"
    return f"list of {kind.value_type}" if pa.types.is_list(kind) else str(kind)
