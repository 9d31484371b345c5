"""Cases as ASAM OSI ground-truth traces, `.osi` or MCAP, with their road as OpenDRIVE.

One `GroundTruth` each tenth of a second. The world's axes are ours: x along the road, y to the left of its right edge.
The AV is the host vehicle; ids are slots. `map_reference` names the road's file beside the trace. MCAP files hold the
case's facts too, as metadata; an .osi file has no place for them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from cornerforge._files import writing
from cornerforge.errors import MissingExtraError
from cornerforge.ext.interchange.differences import rates
from cornerforge.ext.interchange.opendrive import write_road_once
from cornerforge.ext.interchange.osi_messages import GROUND_TRUTH, VEHICLE, VERSION, message_class, schema_bytes
from cornerforge.library.out_case import OutCase
from cornerforge.types import FRAME_S, Scenario

__all__ = ["write_osi"]

_NANOS = 1_000_000_000
_TYPES = (4, 7, 10)
"""Of a car, a heavy truck and a motorcycle, by class."""
_CIVIL = 2
"""Role of a vehicle."""
_HEIGHTS = (1.5, 3.5, 1.5)
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
    messages = (
        _message(made, scenario, frame, road).SerializeToString(deterministic=True) for frame in range(len(scenario.x))
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


def _message(made: Any, scenario: Scenario, frame: int, road: str) -> Any:
    message = made(map_reference=road)
    number = message.version
    number.version_major, number.version_minor, number.version_patch = VERSION
    message.timestamp.seconds, message.timestamp.nanos = divmod(_time(frame), _NANOS)
    message.host_vehicle_id.value = int(scenario.slot[0])
    for column in np.flatnonzero(scenario.present[frame]).tolist():
        thing = message.moving_object.add(type=VEHICLE)
        thing.id.value = int(scenario.slot[column])
        kind, length = int(scenario.kind[column]), float(scenario.length[column])
        base = thing.base
        size, place = base.dimension, base.position
        size.length, size.width, size.height = length, float(scenario.width[column]), _HEIGHTS[kind]
        place.x, place.y, place.z = scenario.x[frame, column], scenario.y[frame, column], 0.5 * _HEIGHTS[kind]
        base.orientation.yaw = scenario.heading[frame, column]
        base.velocity.x = scenario.speed[frame, column]
        near = slice(max(0, frame - 1), frame + 2)
        base.velocity.y = rates(scenario.y[near, column])[min(frame, 1)]
        base.acceleration.x = scenario.acceleration[frame, column]
        for axle, way in (
            (thing.vehicle_attributes.bbcenter_to_rear, -1.0),
            (thing.vehicle_attributes.bbcenter_to_front, 1.0),
        ):
            axle.x, axle.z = way * _AXLE * length, -0.25 * _HEIGHTS[kind]
        about = thing.vehicle_classification
        about.type, about.role = _TYPES[kind], _CIVIL
    return message
