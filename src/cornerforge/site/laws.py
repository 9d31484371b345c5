"""Laws by which people drive and walk at a site, and how many come (docs/adr/0084-traffic-at-sites.md)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from cornerforge._checks import check_number
from cornerforge._schema import check_fields, meant

__all__ = ["ERRORS", "LAWS_FILE", "WALK_SHARES", "Demand", "Laws"]

LAWS_FILE = Path(__file__).with_name("laws.json")
"""Laws that come with cornerforge, as `cornerforge site fit` wrote them."""
ERRORS = ("runs_red", "overlooks_vehicle", "overlooks_person", "looks_away", "walks_blindly")
"""Fields of `Laws` that are chances of human errors."""
WALK_SHARES = (0.0, 0.05, 0.15, 0.5, 0.85, 0.95, 1.0)
"""Shares of people that walk at most as fast as the entries of `Laws.walks`."""


@dataclass(frozen=True)
class Laws:
    """Numbers of the laws. Where none is named, the source is in docs/sites.md.

    "Between drivers" is how far one driver differs from another, once for each; "within" is how far one decision of a
    driver differs from the next.
    """

    headway: Annotated[float, meant("Time gap that a follower keeps (IDM).", "s", 0.3, 4)] = 1.2
    headway_spread: Annotated[float, meant("Standard deviation of its log between drivers.", "", 0, 1)] = 0.25
    standstill: Annotated[float, meant("Gap that it keeps at a stand (IDM).", "m", 0.5, 6)] = 2.0
    acceleration: Annotated[float, meant("Acceleration on a free road from a stand (IDM).", "m/s2", 0.5, 4)] = 1.6
    braking: Annotated[float, meant("Comfortable braking (IDM).", "m/s2", 0.5, 5)] = 2.0
    stopping: Annotated[float, meant("Braking with which it stops at a line or gives way.", "m/s2", 0.5, 5)] = 2.0
    noise: Annotated[float, meant("Standard deviation of a second's acceleration within a driver.", "m/s2", 0, 2)] = 0.4
    pace: Annotated[float, meant("Median of the wished speed, in parts of the limit.", "", 0.5, 1.5)] = 1.0
    pace_spread: Annotated[float, meant("Standard deviation of its log between drivers.", "", 0, 0.5)] = 0.1
    lateral: Annotated[float, meant("Most acceleration across the way in a turn.", "m/s2", 0.5, 6)] = 2.5
    start_up: Annotated[float, meant("Median delay of the first driver after green.", "s", 0, 5)] = 1.5
    amber_braking: Annotated[float, meant("Braking at which half of all drivers stop at amber.", "m/s2", 1, 6)] = 3.0
    amber_spread: Annotated[float, meant("Scale of that logistic law, within.", "m/s2", 0.05, 2)] = 0.4
    gap_left: Annotated[float, meant("Median critical gap of a left turn across traffic.", "s", 1, 12)] = 4.7
    gap_right: Annotated[float, meant("Median critical gap of a right turn into traffic.", "s", 1, 12)] = 4.5
    gap_cross: Annotated[float, meant("Median critical gap of who crosses a street.", "s", 1, 12)] = 5.5
    gap_enter: Annotated[float, meant("Median critical gap into a roundabout.", "s", 1, 12)] = 4.8
    gap_spread: Annotated[float, meant("Standard deviation of the log of critical gaps between drivers.", "", 0, 1)] = (
        0.25
    )
    gap_error: Annotated[
        float, meant("Standard deviation of the log of a gap as it is judged, within.", "", 0.01, 1)
    ] = 0.1
    right_on_red: Annotated[
        float, meant("Share of drivers that turn right on red where that is allowed.", "", 0, 1)
    ] = 0.5
    to_people: Annotated[float, meant("Median gap that a driver leaves to people on their way.", "s", 0.1, 12)] = 2.5
    to_people_spread: Annotated[float, meant("Standard deviation of its log between drivers.", "", 0, 2)] = 0.5
    after_people: Annotated[
        float, meant("Time that a driver who waited leaves behind people, until it is where they were.", "s", 0, 10)
    ] = 2.5
    walks: Annotated[
        tuple[float, ...], meant("Walking speeds, of which `WALK_SHARES` walk at most as fast; 0.2 to 8.", "m/s")
    ] = (0.7, 1.13, 1.31, 1.57, 1.95, 3.0, 4.0)
    walk_change: Annotated[float, meant("Chance that a person changes the speed in a second.", "", 0, 0.5)] = 0.02
    obeys: Annotated[float, meant("Share of people that take no gap on Don't Walk.", "", 0, 1)] = 0.57
    patience: Annotated[
        float, meant("Mean time that a person waits for a gap on Don't Walk, before it waits for Walk.", "s", 0, 1000)
    ] = 15.0
    starts_early: Annotated[
        float, meant("Share of people that leave the kerb up to 2.5 s before Walk, if nothing comes.", "", 0, 1)
    ] = 0.12
    gap_walk: Annotated[float, meant("Median critical gap of a person, for each lane to cross.", "s", 0.5, 15)] = 4.95
    gap_walk_spread: Annotated[float, meant("Standard deviation of its log between people.", "", 0, 1)] = 0.25
    gives_way: Annotated[float, meant("Median gap below which a person on Walk lets a vehicle go.", "s", 0.1, 8)] = 1.5
    gives_way_spread: Annotated[float, meant("Standard deviation of its log between people.", "", 0, 2)] = 0.5
    after_vehicles: Annotated[
        float, meant("Time that a person who waited leaves behind a vehicle, until it is where it was.", "s", 0, 10)
    ] = 5.0
    steps_back: Annotated[
        float, meant("Chance in a second that a person on the road stops for a vehicle that does not.", "", 0, 1)
    ] = 0.5
    runs_red: Annotated[float, meant("Error: chance that a driver who could stop at red does not.", "", 0, 0.1)] = 1e-3
    overlooks_vehicle: Annotated[
        float, meant("Error: chance that a driver overlooks a vehicle, at a decision to go.", "", 0, 0.1)
    ] = 1e-4
    overlooks_person: Annotated[
        float, meant("Error: chance that a driver overlooks a person, at a decision to go.", "", 0, 0.1)
    ] = 2e-4
    looks_away: Annotated[float, meant("Error: chance in a second that a driver begins to look away.", "", 0, 0.5)] = (
        0.02
    )
    looks_back: Annotated[float, meant("Chance in a second that it looks at the road again.", "", 0.05, 1)] = 0.7
    walks_blindly: Annotated[
        float, meant("Error: chance that a person leaves the kerb without looking, at a decision to wait.", "", 0, 0.1)
    ] = 1e-3

    def __post_init__(self) -> None:
        check_fields(self, "laws.")
        for k, speed in enumerate(self.walks):  # a range of a tuple is nothing that msgspec knows
            check_number(f"laws.walks[{k}]", speed, low=0.2, high=8.0)
        object.__setattr__(self, "walks", tuple(float(speed) for speed in self.walks))
        for one in fields(self):
            if isinstance(one.default, float):  # kernels would be compiled once more for a whole number
                object.__setattr__(self, one.name, float(getattr(self, one.name)))


@dataclass(frozen=True)
class Demand:
    """How many vehicles and people come to a site."""

    vehicles: Annotated[float, meant("Vehicles that come by each approach lane.", "1/h", 0, 1800)] = 150.0
    people: Annotated[float, meant("People that come to each end of a crosswalk.", "1/h", 0, 1800)] = 40.0
    trucks: Annotated[float, meant("Share of trucks among the vehicles.", "", 0, 0.5)] = 0.05
    left: Annotated[float, meant("Weight of a left turn, where straight on has 1.", "", 0, 10)] = 0.25
    right: Annotated[float, meant("Weight of a right turn, where straight on has 1.", "", 0, 10)] = 0.25

    def __post_init__(self) -> None:
        check_fields(self, "demand.")
        for one in fields(self):
            object.__setattr__(self, one.name, float(getattr(self, one.name)))
