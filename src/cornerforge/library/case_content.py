"""Types of a case file, key by key: they check what is read, and its JSON Schema is made of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_type_hints

import msgspec
from msgspec import UNSET, Meta, UnsetType

from cornerforge._schema import Closed, Hex, Share, Whole, meant
from cornerforge.library.out_case import NAME_PATTERN
from cornerforge.types import LATER, Odd

__all__ = [
    "FORMAT",
    "VERSION",
    "AgentContent",
    "CaseContent",
    "HappenedContent",
    "PosesContent",
    "StartContent",
    "VehicleContent",
    "case_schema",
]

FORMAT, VERSION = "cornerforge case", 1

T = TypeVar("T")
_Along = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Across = Annotated[float, Meta(ge=-1e5, le=1e5)]
_Speed = Annotated[float, Meta(ge=-100, le=100)]
_Angle = Annotated[float, Meta(ge=-7, le=7)]
_Acceleration = Annotated[float, Meta(ge=-1000, le=1000)]
_Time = Annotated[float, Meta(ge=0, le=100)]
_Lane = Annotated[float, Meta(ge=0, le=63)]
_Flag = Annotated[int, Meta(ge=0, le=1)]
_Slot = Annotated[int, Meta(ge=0, le=32767)]
_Seconds = Annotated[int, Meta(ge=1, le=3600)]
_Action = Annotated[int, Meta(ge=-1, le=32)]
_Name = Annotated[str, Meta(max_length=1000)]
_Fact = (
    Annotated[str, Meta(max_length=10_000)] | Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
    | Annotated[float, Meta(ge=-1e300, le=1e300)] | bool | None
)  # fmt: skip
_Series: TypeAlias = T | Annotated[list[T | None], Meta(max_length=36031)]
"""A value for each frame, null where the vehicle is absent; or one that stays the same."""


class AvContent(Closed, frozen=True):
    """AV of the case."""

    name: Annotated[
        _Name | None, meant("Its name; null: not known. recorded: whatever was there moves as it was recorded.")
    ]
    hash: Annotated[Hex | None, meant("Its hash; null: not known.")]


class PoseContent(Closed, frozen=True):
    """Place and motion of a vehicle in the frame of the contact."""

    x_m: _Along
    y_m: _Across
    speed_mps: Annotated[_Speed, meant("Along the road.", "m/s")]
    heading_rad: _Angle


class HappenedContent(Closed, frozen=True):
    """Outcome of the case with its AV; without contact nothing but `contact` is there."""

    contact: Annotated[bool, meant("Did the AV touch another vehicle, or was it touched?")]
    time_s: (
        Annotated[float, meant("Time of the contact since the start; the frame is 10 times that.", "s", 0, 3600)]
        | UnsetType
    ) = UNSET
    partner: Annotated[int, meant("Slot of the other vehicle.", "", 1, 32767)] | UnsetType = UNSET
    av: Annotated[PoseContent, meant("The AV.")] | UnsetType = UNSET
    other: Annotated[PoseContent, meant("The other vehicle.")] | UnsetType = UNSET


class AgentContent(Closed, frozen=True):
    """State of a vehicle or person at a site at the start, besides its motion."""

    present: Annotated[_Flag, meant("0: it comes later, or has gone.")]
    s_m: Annotated[_Along, meant("Centre of the box along its route.", "m")]
    route: Annotated[int, meant("Index of its route.", "", 0, 63)]
    stage: Annotated[int, meant("0: it has not come yet; 1: it is there; 2: it has left.", "", 0, 2)]
    marks: Annotated[int, meant("What it is like and has decided: `sim.site.claims`.", "", 0, 63)]
    enters_s: Annotated[float, meant("When it comes.", "s", -1e6, 1e6)]
    headway: Annotated[float, meant("Its factor of the time gap that it keeps.", "", 0, 1e3)]
    gaps: Annotated[float, meant("Its factor of critical gaps.", "", 0, 1e3)]
    manners: Annotated[float, meant("Its factor of the gap left to people; of a person, to vehicles.", "", 0, 1e3)]
    cleared_m: Annotated[_Along, meant("It has decided to go as far as this along its route.", "m")]
    overlooks: Annotated[int, meant("Slot that it overlooks; -1: none, -2: all.", "", -2, 32767)]
    heeds: Annotated[int, meant("Slot that it has given way to last; -1: none.", "", -1, 32767)]
    lights_s: Annotated[float, meant("Time of the programme of the signals.", "s", -1e6, 1e6)]
    resumes_s: Annotated[
        float, meant("Until then it waits behind people that it let go, since the start.", "s", -1e6, 1e6)
    ] = -1e6


class StartContent(Closed, frozen=True):
    """State of a vehicle at the start; what is left out is 0. On rails what the poses say comes first."""

    x_m: Annotated[_Along, meant("Centre of the box along the road.", "m")]
    y_m: Annotated[_Across, meant("Centre of the box, to the left of the right edge of the road.", "m")]
    speed_mps: Annotated[_Speed, meant("Along the road.", "m/s")]
    lanes: Annotated[int, meant("Lanes that it is in: the sum of 2^lane.", "", 1, 63)]
    lateral_speed_mps: Annotated[_Speed, meant("To the left.", "m/s")] = 0.0
    heading_rad: Annotated[_Angle, meant("Counter-clockwise from the road's direction.", "rad")] = 0.0
    acceleration_mps2: Annotated[_Acceleration, meant("Along the road.", "m/s2")] = 0.0
    clock_s: Annotated[_Time, meant("Since the lane change began.", "s")] = 0.0
    duration_s: Annotated[_Time, meant("How long the lane change takes; 0: none.", "s")] = 0.0
    c0: Annotated[_Along, meant("y = c0 + c1 t + ... + c5 t^5 during the lane change: c0.")] = 0.0
    c1: _Along = 0.0
    c2: _Along = 0.0
    c3: _Along = 0.0
    c4: _Along = 0.0
    c5: _Along = 0.0
    target_lane: Annotated[
        int, meant("Lane that it keeps or changes to; 0 is the rightmost. At a site its route.", "", 0, 63)
    ] = 0
    quantile: Annotated[Share, meant("Of its last acceleration among those of drivers in its state.")] = 0.0
    habit: Annotated[Share, meant("The quantile that its driver tends to.")] = 0.0
    desired_speed_mps: Annotated[float, meant("Desired speed.", "m/s", 0, 1000)] = 0.0
    change_time_s: Annotated[_Time, meant("How long its undisturbed lane changes take.", "s")] = 0.0
    signals: Annotated[
        int, meant("1: it sets the indicator before it changes lanes; plus 2: it takes the exit.", "", 0, 3)
    ] = 0
    away: Annotated[_Flag, meant("1: its driver looked away in the last second.")] = 0
    noise: Annotated[float, meant("Its driver's noise level.", "", -1, 1)] = 0.0
    inattention: Annotated[float, meant("How many times as often as others it looks away.", "", 0, 1e6)] = 0.0
    at_site: Annotated[AgentContent | UnsetType, meant("What it is at a site; on a road it is not there.")] = UNSET


class PosesContent(Closed, frozen=True):
    """Places of a vehicle at every tenth of a second, from `first_frame` on. Of the AV: what it did when recorded.

    A number instead of a list stays the same; null: it is absent.
    """

    first_frame: Annotated[
        int, meant("Frame of the first entries; before it the vehicle is absent. Frame 0 is the start.", "", 0, 36030)
    ]
    frames: Annotated[int, meant("Frames from there on; afterwards the vehicle is absent.", "", 1, 36031)]
    x_m: Annotated[_Series[_Along], meant("Centre of the box along the road.", "m")]
    y_m: Annotated[_Series[_Across], meant("Centre of the box, to the left of the right edge of the road.", "m")]
    speed_mps: Annotated[_Series[_Speed], meant("Along the road.", "m/s")]
    lateral_speed_mps: Annotated[_Series[_Speed], meant("To the left; not known: 0.", "m/s")]
    heading_rad: Annotated[_Series[_Angle], meant("Counter-clockwise from the road's direction.", "rad")]
    acceleration_mps2: Annotated[
        _Series[_Acceleration], meant("Along the road; a step of 80 m/s within a frame is 800.", "m/s2")
    ]
    lane: Annotated[_Series[_Lane], meant("Lane that it keeps or changes to.")]


class VehicleContent(Closed, frozen=True):
    """A vehicle."""

    slot: Annotated[_Slot, meant("Its number; the AV is 0.")]
    kind: Annotated[Literal["car", "truck", "motorcycle", "person"], meant("What it is.")] = msgspec.field(name="class")
    length_m: Annotated[float, meant("Of its box.", "m", 0.5, 30)]
    width_m: Annotated[float, meant("Of its box.", "m", 0.3, 4)]
    start: StartContent
    actions: (
        Annotated[
            _Action | Annotated[list[_Action], Meta(max_length=3600)],
            meant(
                "What it decides at each second: 0 and 1 change to the left and right, 2 to 32 accelerate with -4 to "
                "2 m/s2 in steps of 0.2, -1 is the likeliest action of the naturalistic model; a number instead of a "
                "list stays the same. Not of the AV, which decides by itself, and not on rails."
            ),
        ]
        | UnsetType
    ) = UNSET
    poses: PosesContent | UnsetType = UNSET


RoadContent = msgspec.defstruct(
    "RoadContent",
    [
        (name, kind | UnsetType, UNSET) if name in LATER else (name, kind)
        for name, kind in get_type_hints(Odd, include_extras=True).items()
    ],
    namespace={"__doc__": "Road and limits (an ODD); what is left out does not occur."},
    frozen=True, kw_only=True, forbid_unknown_fields=True,
)  # fmt: skip


class CaseContent(Closed, frozen=True):
    """One driving case, whole.

    The road, the vehicles at the start, how the others move from there on, and what became of it with the AV
    that was in it. x goes along the road, y to the left from its right edge, headings counter-clockwise, a frame is
    0.1 s. The numbers of recorded AVs are those of float32, all others of float64: read and written again they are the
    same bits.
    """

    format: Annotated[Literal["cornerforge case"], meant("What this is.")]
    version: Annotated[Literal[1], meant("It rises when a reader of the version before would misread a file.")]
    name: Annotated[str, Meta(pattern=NAME_PATTERN + r"(?!\n)", description="Of the case: letters, digits, - and _.")]
    made_by: Annotated[str, Meta(max_length=200, description="Program that wrote the file.")]
    licence: Annotated[
        str,
        Meta(max_length=4000, description="What may be done with it, or with what it was made of; empty: not told."),
    ]
    model: Annotated[
        Hex | None, meant("Hash of the naturalistic model that the actions of the others depend on; null: of none.")
    ]
    notes: Annotated[
        list[_Name],
        Meta(max_length=10_000, description="What could not be carried over from where the case comes from."),
    ]
    facts: Annotated[
        dict[str, _Fact], Meta(max_length=1000, description="What else is known of it; names end in their unit.")
    ]
    av: AvContent
    happened: Annotated[HappenedContent | None, meant("What became of it with that AV; null: not known.")]
    road: RoadContent  # type: ignore[valid-type]
    seed: Annotated[Whole, meant("With test: name of the test that it was, and what an AV from outside is told.")]
    test: Annotated[int, meant("See seed.", "", 0, 2**62)]
    others: Annotated[
        Literal["act", "rails"], meant("act: they decide once a second. rails: they are where their poses say.")
    ]
    seconds: Annotated[_Seconds, meant("The drive lasts so long at most.", "s")]
    set_speed_mps: (
        Annotated[
            float, meant("At which speed the AV is set to drive; null: at its own. On rails only.", "m/s", 0, 1000)
        ]
        | None
    )
    frames: Annotated[int, meant("Frames of the rails; null where others act.", "", 11, 36031)] | None
    vehicles: Annotated[
        list[VehicleContent],
        Meta(
            min_length=1, max_length=751,
            description="All vehicles by ascending slot, the AV first: as many as the road has room for, one for every "
            "40 m of traffic_length in each lane, and the AV.",
        ),
    ]  # fmt: skip


def case_schema() -> dict[str, Any]:
    """Make the schema of case files (JSON Schema, draft 2020-12)."""
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, "title": "Case file of cornerforge, version 1", **msgspec.json.schema(CaseContent)}
