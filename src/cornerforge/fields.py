"""Recorded data: names, types, units and meanings of a test's series and of a case's columns, in one list each.

These lists make the record of one vehicle in one frame (`FRAME_FIELDS`), the order of a digest, the columns that the
kernel fills (`CASE_ROW`), the Parquet schemas, their documentation, and the loops of all code that reads recordings. A
new series or column is added here first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

__all__ = [
    "BEFORE_CONTACT",
    "BODY",
    "CASES",
    "FRAME_FIELDS",
    "HISTORY_SHAPE",
    "POSE",
    "SERIES",
    "SIZES",
    "TRACKS",
    "Field",
    "Series",
]


# Ranges, wide enough for recordings: they tell damage, not what is rare.
_ANY = float("inf")
_ENDLESS = 2**31 - 1
_METRES = (-1e5, 1e5)
_SPEEDS = (-100.0, 200.0)
_ANGLES = (-4.0 * np.pi, 4.0 * np.pi)
_SHARPNESS = (-1e5, 1e5)
SIZES = (0.1, 100.0)
"""Of lengths and widths of vehicles [m]."""
_SIZE_OF_TWO = (-100.0, 100.0)
_POSITIVE = (0.0, _ANY)
_LARGEST = float(np.finfo(np.float64).max)
"""Bound of what may be as large as it likes, but not infinite."""
_GREATEST = (0.0, 1e6)
_MOST_LANES, _MOST_ROUTES = 6, 64
_INT16, _INT64 = 2**15 - 1, 2**63 - 1
BEFORE_CONTACT = (0.0, 1e5)
"""Of moments before the contact [s]."""


@dataclass(frozen=True)
class Field:
    """One column of a file.

    Attributes:
        name: As in the file; ends in its unit where it has one.
        type: Of a value: "string", "bool", "int8" and so on, "list of T", or "T[n]" for lists of n.
        unit: Of the values, "" for none.
        meaning: One sentence, with the edge values.
        within: Smallest and largest value, inclusive; None: any. NaN and null have rules of their own.
        nullable: A value may be null; NaN stands for it in arrays.
        nan: A value, or one in a list, may be NaN.
    """

    name: str
    type: str
    unit: str
    meaning: str
    within: tuple[float, float] | None = None
    nullable: bool = False
    nan: bool = False

    @property
    def allowed(self) -> str:
        """The range in words, without the unit; "" where any value is allowed.

        >>> Field("age", "int64", "s", "How old it is.", (0, float("inf"))).allowed
        'at least 0'
        """
        if self.within is None or self.within == (-_ANY, _ANY):
            return ""
        low, high = self.within
        if high >= _ENDLESS or low <= -_LARGEST:
            return f"at least {low:g}" if high >= _ENDLESS else f"at most {high:g}"
        return f"{low:g} to {high:g}"


@dataclass(frozen=True)
class Series:
    """A quantity that is recorded of every vehicle, in every frame or once.

    Attributes:
        name: As in `types.Scenario`.
        column: The column of `TRACKS` that stores it; its type is that of one value.
    """

    name: str
    column: Field

    @property
    def recorded(self) -> str:
        """NumPy type in a recording and in a digest."""
        return "<f8" if "float" in self.column.type else "i1"


_FLAT = "vehicle by vehicle: vehicle i at frame t stands at i * n_frames + t"

SERIES: tuple[Series, ...] = (
    Series("x", Field(
        "x_m", "float32", "m", f"Box centre along the road, at a site to the east, {_FLAT}; NaN where absent.",
        _METRES, nan=True)),
    Series("y", Field(
        "y_m", "float32", "m", "Box centre, to the left of the right road edge, at a site to the north; NaN where "
        "absent.", _METRES, nan=True)),
    Series("speed", Field("speed_mps", "float32", "m/s", "Along the road, at a site along the own way; NaN "
          "where absent.", _SPEEDS, nan=True)),
    Series("heading", Field(
        "heading_rad", "float32", "rad", "Counter-clockwise from the road's direction, at a site from the east; "
        "NaN where "
        "absent.", _ANGLES,
        nan=True)),
    Series("acceleration", Field(
        "acceleration_mps2", "float32", "m/s2", "Along the road, at this frame; NaN where absent.", _SHARPNESS,
        nan=True)),
    Series("target_lane", Field(
        "target_lane", "int8", "", "Lane kept or changed to, or the route; -1 where absent.", (-1, _MOST_ROUTES - 1))),
    Series("present", Field("present", "bool", "", "The vehicle exists.")),
)  # fmt: skip
"""The series of a frame, in the order of a digest: first the real numbers, 0 where absent, then lane and presence."""

BODY: tuple[Series, ...] = (
    Series("kind", Field(
        "kind", "int8", "", "Class of each stored vehicle: 0 car, 1 truck, 2 motorcycle, 3 person.", (0, 3))),
    Series("length", Field("length_m", "float64", "m", "Length of each stored vehicle.", SIZES)),
    Series("width", Field("width_m", "float64", "m", "Width of each stored vehicle.", SIZES)),
    Series("change_time", Field(
        "change_time_s", "float64", "s", "How long an undisturbed lane change of each stored vehicle takes.",
        (0.0, 1e4))),
)  # fmt: skip
"""The quantities recorded of every vehicle once."""

REALS: tuple[str, ...] = tuple(series.name for series in SERIES if series.recorded == "<f8")
"""Names of the real-valued series."""

FRAME_FIELDS = np.dtype([(series.name, series.recorded.lstrip("<")) for series in SERIES], align=True)
"""One vehicle in one recorded frame; where `present` is 0 it is absent, and the rest means nothing."""

POSE = ("x", "y", "speed", "heading")
"""Names of the series that say where a vehicle is and how it moves, in the order of a case's history."""

HISTORY_SHAPE = (16, 2, len(POSE))
"""Shape of a case's history: seconds 0..15 before the contact; AV, crash partner; `POSE`."""


def _limits(who: str, name: str) -> tuple[Field, ...]:
    real = "float64"
    return (
        Field(
            f"{who}_max_acceleration_mps2", real, "m/s2", f"Largest acceleration of {name}; null below 2 "
            f"frames, and of people.",
            _GREATEST, nullable=True,
        ),
        Field(
            f"{who}_max_braking_mps2", real, "m/s2", f"Largest braking of {name}, positive; null below 2 "
            f"frames, and of people.",
            _GREATEST, nullable=True,
        ),
        Field(
            f"{who}_max_lateral_acceleration_mps2", real, "m/s2",
            f"Largest |lateral acceleration| of {name}, second differences of y, null below 3 frames; at a site speed "
            "times the turn of the heading, null of people and below 2 frames.", _GREATEST,
            nullable=True,
        ),
    )  # fmt: skip


SHORTFALL: tuple[Field, ...] = (
    Field(
        "shortfall_nats", "float64", "nats",
        "How far ln P(critical BV's actions), human errors included, falls short of the likeliest ones'; inf: one was "
        "impossible; null: not recorded.", _POSITIVE, nullable=True,
    ),
    Field(
        "possible_shortfall_nats", "float64", "nats",
        "The same of the possible actions alone; null: not recorded.", _POSITIVE, nullable=True,
    ),
    Field(
        "n_implausible", "int64", "",
        "Critical BV's decisions that no natural driver makes, not even in error; null: not recorded.", (0, _INT16),
        nullable=True,
    ),
    Field(
        "excess_nats", "float64", "nats",
        "How far -ln P(critical BV's actions), human errors included, exceeds its expected value, the entropy, in the "
        "worst run of decisions; inf: one was impossible; null: not recorded.", _POSITIVE, nullable=True,
    ),
)  # fmt: skip
"""Log-probability of the critical BV's actions against the likeliest ones (ADR 12), and against its expected value
(ADR 71)."""

PARTNER: tuple[Field, ...] = (
    Field("bv_kind", "int8", "", "Class of the crash partner: 0 car, 1 truck, 2 motorcycle, 3 person.", (0, 3)),
    Field("bv_length_m", "float64", "m", "Length of the crash partner.", SIZES),
    Field("bv_width_m", "float64", "m", "Width of the crash partner.", SIZES),
)
"""Class and size of the crash partner."""

CASES: tuple[Field, ...] = (
    Field("case_id", "string", "", "Name of the case, seed:test."),
    Field("seed", "int64", "", "Seed of the run.", (0, _INT64)),
    Field("test", "int64", "", "Index of the test within the seed.", (0, _INT64)),
    Field("crash_time_s", "float64", "s", "First contact, since the start of the test.", (0.0, 1e5)),
    Field("duration_s", "float64", "s", "Length of the recording.", (0.0, 1e5)),
    Field("bv_slot", "int16", "", "Slot of the crash partner, the BV that the AV touches first.", (1, _INT16)),
    Field("av_speed_mps", "float64", "m/s", "Speed of the AV at contact.", _SPEEDS),
    Field("bv_speed_mps", "float64", "m/s", "Speed of the crash partner at contact.", _SPEEDS),
    Field(
        "impact_speed_difference_mps", "float64", "m/s", "Partner's speed minus the AV's at contact.", (-300.0, 300.0)
    ),
    Field(
        "relative_heading_rad", "float64", "rad", "Partner's heading minus the AV's at contact, in [-pi, pi).",
        (-np.pi, np.pi),
    ),
    Field("relative_lon_m", "float64", "m", "Partner's centre minus the AV's along the road, at a site along "
          "the AV's heading, at contact.", _SIZE_OF_TWO),
    Field("relative_lat_m", "float64", "m", "Partner's centre minus the AV's, to the left of the road, at a "
          "site of the AV's heading, at contact.", _SIZE_OF_TWO),
    Field("av_lane", "int8", "", "Lane that holds the AV's centre at contact, 0 = rightmost; at a site the AV's "
          "route.", (-100, 100)),
    Field(
        "relative_lane", "int8", "", "Lane of the partner's centre minus the AV's at contact; at a site the "
        "routes' indices likewise.",
        (-100, 100),
    ),
    *_limits("av", "the AV"),
    *_limits("bv", "the crash partner"),
    Field("physically_plausible", "bool", "", "AV, partner: -8.5..4 m/s2 along, 4 m/s2 across the road; at a "
          "site, of vehicles: -8.5..4 "
          "along, 7 across their way, and none, people included, moves farther in a frame than its speed lets it."),
    Field("min_ttc_s", "float64", "s", "Smallest TTC of the AV before contact, to vehicles in its path, at a "
          "site to all, if both "
          "go on straight; null: never closing.", (0.0, _LARGEST),
          nullable=True),
    Field("n_vehicles", "int16", "", "Vehicles in the test, the AV among them.", (2, _INT16)),
    Field("n_decisions", "int16", "", "Decisions (one a second) in the test.", (0, _INT16)),
    Field("log_prob_nde", "float64", "", "ln P(critical BV's actions) in the NDE; null: P = 0.", (-_LARGEST, 0.0),
          nullable=True),
    Field("n_impossible", "int16", "", "Critical BV's decisions of probability 0 in the NDE.", (0, _INT16)),
    Field("trajectory_digest", "string", "", "Of all vehicles at full precision; for `replay --check`."),
    Field("critical_bv_action", "list of int8", "", "Critical BV's action at each decision; -1: no BV.", (-1, 32)),
    Field(
        "history", f"float32[{HISTORY_SHAPE[0] * HISTORY_SHAPE[1] * HISTORY_SHAPE[2]}]", "m, m/s, rad",
        f"[second 0..15 before contact][AV, partner][{', '.join(POSE)}], flat; NaN before the test began.", _METRES,
        nan=True,
    ),
    *SHORTFALL,
    *PARTNER,
)  # fmt: skip
"""Columns of a library's cases, one row a case."""

TRACKS: tuple[Field, ...] = (
    Field("case_id", "string", "", "Name of the case, seed:test."),
    Field("n_frames", "int32", "", "Frames, 0.1 s apart, from the start of the test to contact.", (1, 2**31 - 1)),
    Field("slot", "list of int16", "", "Slots of the stored vehicles; the AV first.", (0, _INT16)),
    *(replace(one.column, type=f"list of {one.column.type}") for one in (*BODY, *SERIES)),
    Field("action", "list of int8", "", "Decision k of vehicle i at i * n_decisions + k; -1: none.", (-1, 32)),
    Field(
        "critical_bv", "list of int16", "", "Critical BV's index into `slot` at each decision; -1: none.", (-1, _INT16)
    ),
    Field("decision_log_prob_nde", "list of float64", "", "ln P(its action) in the NDE; 0: no BV.", (-_ANY, 0.0)),
)
"""Columns of a library's tracks. They hold the AV, its crash partner, critical BVs, and every vehicle that comes within
150 m of the AV."""

_NUMBERS = {"bool": "u1"}


def _row(fields: Sequence[Field]) -> list[tuple[str, str]]:
    """List the numeric columns of a case, as fields of a NumPy record."""
    kinds = {field.name: _NUMBERS.get(field.type, field.type) for field in fields}
    return [(name, kind) for name, kind in kinds.items() if kind[0] in "uif" and kind[-1] != "]"]


CASE_ROW = np.dtype(
    [
        *_row(CASES),
        ("log_prob_policy", "f8"),
        ("policy", "i8"),
        ("hidden", "i8"),
        ("n_frames", "i4"),
        ("n_kept", "i4"),
    ],
    align=True,
)
"""One case as the kernel makes it: the numeric columns of `CASES`, NaN for null; ln P of the critical BV's actions
under the policy; index of the policy in the mixture; seconds in which an adversary made the AV lose the critical BV,
bit k for second k; numbers of frames and of stored vehicles."""
