"""Cases as ASAM OSI ground-truth traces, `.osi` or MCAP, with their road as OpenDRIVE.

One `GroundTruth` each tenth of a second. The world is that of the road's file; where the case has no road of its own, x
goes along the straight one, and y to the left from its right edge. The AV is the host vehicle; ids are slots.
`map_reference` names the road's file beside the trace. At a site the world is the site's plane, people are
pedestrians, the first frame holds the lanes, and each frame what the lights show. MCAP files hold the case's facts
too, as metadata; an .osi file has no place for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from cornerforge._files import writing
from cornerforge.errors import MissingExtraError
from cornerforge.ext.interchange.differences import rates
from cornerforge.ext.interchange.opendrive import write_road_once
from cornerforge.ext.interchange.opendrive_lanes import InWorld, in_world
from cornerforge.ext.interchange.osi_messages import (
    GROUND_TRUTH,
    PEDESTRIAN,
    VEHICLE,
    VERSION,
    message_class,
    schema_bytes,
)
from cornerforge.ext.interchange.osi_site import SiteInOsi, add_site, site_in_osi
from cornerforge.library.out_case import OutCase
from cornerforge.types import FRAME_S, Scenario

__all__ = ["write_osi"]

_NANOS = 1_000_000_000
_TYPES = (4, 7, 10, None)
"""Of a car, a heavy truck and a motorcycle, by class; people are no vehicles."""
_CIVIL = 2
"""Role of a vehicle."""
_HEIGHTS = (1.5, 3.5, 1.5, 1.75)
_AXLE = 0.3
"""Distance of an axle from the middle, as a part of the length."""
_TRACE = "net.asam.osi.trace"
"""Prefix of the names under which the standard wants versions in an MCAP file."""


def write_osi(case: OutCase, path: Path) -> tuple[str, str]:
    """Write a case as a trace, and its road into the same folder.

    Args:
        case: The case.
        path: The trace; its ending says the format, .osi or .mcap.

    Returns:
        Names of the two files.

    Raises:
        MissingExtraError: protobuf, or mcap for .mcap, is not installed.
        OutputError: A file cannot be written.
    """
    scenario = case.scenario
    made = message_class(GROUND_TRUTH)
    there = scenario.x[scenario.present]
    road = write_road_once(scenario.odd, path.parent, float(there.min()), float(there.max()))
    world = in_world(scenario.odd, scenario.x, scenario.y, scenario.heading)
    site = None if scenario.odd.site is None else site_in_osi(scenario, scenario.odd.site)
    messages = (
        _message(made, scenario, world, frame, road, site).SerializeToString(deterministic=True)
        for frame in range(len(scenario.x))
    )
    with writing(path, "the trace") as part, part.open("wb") as file:
        if path.suffix == ".mcap":
            _write_mcap(file, case, messages)
        else:
            file.writelines(len(content).to_bytes(4, "little") + content for content in messages)
    return path.name, road


def _time(frame: int) -> int:
    """Time of a frame, in whole nanoseconds."""
    return frame * _NANOS // round(1.0 / FRAME_S)


def _write_mcap(file: BinaryIO, case: OutCase, messages: Iterator[bytes]) -> None:
    try:
        from google.protobuf import __version__ as protobuf
        from mcap.writer import Writer
    except ImportError as error:
        raise MissingExtraError("mcap", "osi") from error
    version = ".".join(map(str, VERSION))
    of = {"osi_version": version, "protobuf_version": protobuf}
    writer = Writer(file)
    writer.start()
    bounds = {f"{end}_{name}": said for end in ("min", "max") for name, said in of.items()}
    writer.add_metadata(_TRACE, {"version": version, **bounds})
    writer.add_metadata("cornerforge", {name: str(fact) for name, fact in case.facts.items() if fact is not None})
    schema = writer.register_schema(GROUND_TRUTH, "protobuf", schema_bytes())
    about = {f"{_TRACE}.channel.{name}": said for name, said in of.items()}
    channel = writer.register_channel("ground_truth", "protobuf", schema, about)
    for frame, content in enumerate(messages):
        writer.add_message(channel, _time(frame), content, _time(frame))
    writer.finish()


def _message(made: Any, scenario: Scenario, world: InWorld, frame: int, road: str, site: SiteInOsi | None) -> Any:
    message = made(map_reference=road)
    number = message.version
    number.version_major, number.version_minor, number.version_patch = VERSION
    message.timestamp.seconds, message.timestamp.nanos = divmod(_time(frame), _NANOS)
    message.host_vehicle_id.value = int(scenario.slot[0])
    for column in np.flatnonzero(scenario.present[frame]).tolist():
        kind, length = int(scenario.kind[column]), float(scenario.length[column])
        of_vehicle = _TYPES[kind]
        thing = message.moving_object.add(type=PEDESTRIAN if of_vehicle is None else VEHICLE)
        thing.id.value = int(scenario.slot[column])
        base = thing.base
        size, place = base.dimension, base.position
        size.length, size.width, size.height = length, float(scenario.width[column]), _HEIGHTS[kind]
        x, y, heading, direction, bend, stretch = (float(part[frame, column]) for part in world)
        place.x, place.y, place.z = x, y, 0.5 * _HEIGHTS[kind]
        base.orientation.yaw = heading
        along = float(scenario.speed[frame, column]) * stretch
        near = slice(max(0, frame - 1), frame + 2)
        across = 0.0 if scenario.odd.site else float(rates(scenario.y[near, column])[min(frame, 1)])
        ahead = float(scenario.acceleration[frame, column]) * stretch
        base.velocity.x, base.velocity.y = _turned(along, across, direction)
        base.acceleration.x, base.acceleration.y = _turned(ahead, along**2 * bend, direction)
        if of_vehicle is None:
            continue
        for axle, way in (
            (thing.vehicle_attributes.bbcenter_to_rear, -1.0),
            (thing.vehicle_attributes.bbcenter_to_front, 1.0),
        ):
            axle.x, axle.z = way * _AXLE * length, -0.25 * _HEIGHTS[kind]
        about = thing.vehicle_classification
        about.type, about.role = of_vehicle, _CIVIL
    if site is not None:
        add_site(message, site, frame)
    return message


def _turned(along: float, across: float, direction: float) -> tuple[float, float]:
    """Turn a vector along and across the road into one of the world."""
    cos, sin = math.cos(direction), math.sin(direction)
    return along * cos - across * sin, along * sin + across * cos
