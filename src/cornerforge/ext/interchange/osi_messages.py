"""Messages of ASAM OSI 3 by which a trace says where moving objects are, made of the standard's field numbers.

Fields that are not listed are skipped by the parser, so lanes and signs that a trace repeats cost little. Enumerations
are whole numbers here, as they are on the wire.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from cornerforge.errors import MissingExtraError

__all__ = ["GROUND_TRUTH", "PEDESTRIAN", "SENSOR_VIEW", "VEHICLE", "VERSION", "message_class", "schema_bytes"]

GROUND_TRUTH, SENSOR_VIEW = "osi3.GroundTruth", "osi3.SensorView"
VEHICLE, PEDESTRIAN = 2, 3
"""Types of moving objects; of the others, 4 is an animal."""
VERSION = (3, 7, 0)
"""Version of OSI that is written; all of OSI 3 is read."""
_PACKAGE = "osi3"
_XYZ = {"x": (1, "double"), "y": (2, "double"), "z": (3, "double")}
_BASE = {"dimension": (1, "Dimension3d"), "position": (2, "Vector3d"), "orientation": (3, "Orientation3d")}
_NOW = {"version": (1, "InterfaceVersion"), "timestamp": (2, "Timestamp")}
_MESSAGES: dict[str, dict[str, tuple[int, str]]] = {
    "InterfaceVersion": {
        "version_major": (1, "uint32"), "version_minor": (2, "uint32"), "version_patch": (3, "uint32"),
    },
    "Timestamp": {"seconds": (1, "int64"), "nanos": (2, "uint32")},
    "Identifier": {"value": (1, "uint64")},
    "Vector3d": _XYZ,
    "Dimension3d": {"length": (1, "double"), "width": (2, "double"), "height": (3, "double")},
    "Orientation3d": {"roll": (1, "double"), "pitch": (2, "double"), "yaw": (3, "double")},
    "ExternalReference": {"reference": (1, "string"), "type": (2, "string"), "identifier": (3, "string*")},
    "BaseStationary": _BASE,
    "BaseMoving": {**_BASE, "velocity": (4, "Vector3d"), "acceleration": (5, "Vector3d")},
    "StationaryObject": {"id": (1, "Identifier"), "base": (2, "BaseStationary")},
    "MovingObject": {
        "id": (1, "Identifier"), "base": (2, "BaseMoving"), "type": (3, "int32"),
        "vehicle_attributes": (5, "MovingObject.VehicleAttributes"),
        "vehicle_classification": (6, "MovingObject.VehicleClassification"),
        "source_reference": (10, "ExternalReference*"),
    },
    "MovingObject.VehicleAttributes": {
        "driver_id": (1, "Identifier"), "bbcenter_to_rear": (4, "Vector3d"), "bbcenter_to_front": (5, "Vector3d"),
    },
    "MovingObject.VehicleClassification": {"type": (1, "int32"), "role": (5, "int32")},
    "TrafficLight": {
        "id": (1, "Identifier"), "base": (2, "BaseStationary"), "classification": (3, "TrafficLight.Classification"),
    },
    "TrafficLight.Classification": {
        "color": (1, "int32"), "icon": (2, "int32"), "mode": (3, "int32"), "assigned_lane_id": (5, "Identifier*"),
    },
    "Lane": {"id": (1, "Identifier"), "classification": (2, "Lane.Classification")},
    "Lane.Classification": {
        "type": (1, "int32"), "centerline": (3, "Vector3d*"), "centerline_is_driving_direction": (4, "bool"),
        "lane_pairing": (7, "Lane.Classification.LanePairing*"),
    },
    "Lane.Classification.LanePairing": {
        "antecessor_lane_id": (1, "Identifier"), "successor_lane_id": (2, "Identifier"),
    },
    "GroundTruth": {
        **_NOW, "host_vehicle_id": (3, "Identifier"), "stationary_object": (4, "StationaryObject*"),
        "moving_object": (5, "MovingObject*"), "traffic_light": (7, "TrafficLight*"), "lane": (10, "Lane*"),
        "map_reference": (15, "string"),
    },
    "SensorView": {**_NOW, "global_ground_truth": (7, "GroundTruth")},
}  # fmt: skip
"""Message -> field -> number and type; a type that ends in * is repeated, a name with a dot is of a nested message."""


@cache
def _file() -> Any:
    try:
        from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field
        from google.protobuf.descriptor_pb2 import FileDescriptorProto
    except ImportError as error:
        raise MissingExtraError("protobuf", "osi") from error
    file = FileDescriptorProto(name="cornerforge_osi.proto", package=_PACKAGE)
    made: dict[str, Any] = {}
    for name, fields in _MESSAGES.items():
        outer, _, own = name.rpartition(".")
        made[name] = (made[outer].nested_type if outer else file.message_type).add(name=own)
        for field, (number, stated) in fields.items():
            kind = stated.rstrip("*")
            part = made[name].field.add(
                name=field, number=number,
                label=Field.LABEL_REPEATED if stated.endswith("*") else Field.LABEL_OPTIONAL,
            )  # fmt: skip
            if kind in _MESSAGES:
                part.type, part.type_name = Field.TYPE_MESSAGE, f".{_PACKAGE}.{kind}"
            else:
                part.type = getattr(Field, f"TYPE_{kind.upper()}")
    return file


@cache
def message_class(name: str) -> Any:
    """Make the class of a message, such as `GROUND_TRUTH`.

    Raises:
        MissingExtraError: protobuf is not installed.
    """
    file = _file()
    from google.protobuf import descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def schema_bytes() -> bytes:
    """Return the messages as a serialised `FileDescriptorSet`, which MCAP files hold."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    written: bytes = FileDescriptorSet(file=[_file()]).SerializeToString(deterministic=True)
    return written
