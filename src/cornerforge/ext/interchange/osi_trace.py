"""Traces of ASAM OSI ground truth: `.osi` (each message behind its length) and MCAP, as tables of objects over time.

Messages are `GroundTruth`, or `SensorView` with a `global_ground_truth`. Every fault names the file and the frame, from
0 on. No length of a file is believed before as much is there, and nothing unpacks to more than it says.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from cornerforge._files import check_regular, reason
from cornerforge.errors import DataError, FileFormatError, InputError, MissingExtraError
from cornerforge.ext.interchange.osi_messages import GROUND_TRUTH, SENSOR_VIEW, message_class

__all__ = ["HEIGHT", "Body", "Trace", "read_trace"]

PLACE = POSITION_X, POSITION_Y, POSITION_Z, YAW, SPEED_X, SPEED_Y, ACCELERATION_X, ACCELERATION_Y = range(8)
"""Columns of `Trace.states`: box centre [m], yaw [rad], velocity [m/s] and acceleration [m/s2], all in the world."""
HEIGHT = 2
"""Column of `Body.size` that holds the height."""
_MOST_MESSAGE, _MOST_FRAMES, _MOST_OBJECTS, _MOST_VALUES = 64 << 20, 100_000, 5_000, 20_000_000
_FARTHEST, _FASTEST, _HARDEST, _LARGEST = 1e7, 1e3, 1e4, 1e4
"""Largest coordinate [m], speed [m/s], acceleration [m/s2] and size [m] of an object."""


@dataclass(frozen=True)
class Body:
    """An object of a trace.

    Attributes:
        ident: Its id.
        name: What the scenario calls it, if the trace says so; else its id.
        kind: Type of a moving object; -1: it is stationary.
        vehicle: Type of the vehicle.
        size: Length, width and height [m].
    """

    ident: int
    name: str
    kind: int
    vehicle: int
    size: tuple[float, float, float]


@dataclass(frozen=True)
class Trace:
    """A trace.

    Attributes:
        version: Of OSI, as the first message says; empty: it does not.
        map_reference: File or place of the road, as the trace says it; empty: it does not.
        host: Id of the host vehicle; None: the trace does not say.
        times: Time of each frame [s], (F,), growing.
        bodies: The moving objects, in order of their first frame.
        states: Where they are, (F, V, 8), NaN where an object is absent; columns as in this module.
        stationary: Objects that do not move, with their x, y, z [m] and yaw [rad].
    """

    version: str
    map_reference: str
    host: int | None
    times: NDArray[np.float64]
    bodies: tuple[Body, ...]
    states: NDArray[np.float64]
    stationary: tuple[tuple[Body, tuple[float, float, float, float]], ...]


def read_trace(path: Path) -> Trace:
    """Read a trace.

    Args:
        path: The file; its ending says the format, .osi or .mcap.

    Raises:
        InputError: The file is missing or cannot be read.
        FileFormatError: It is damaged, or no trace.
        DataError: A value is missing or impossible, time stands or goes back, or nothing moves.
        MissingExtraError: protobuf or mcap is not installed.
    """
    try:
        check_regular(path)
        return _Table(path).read()
    except OSError as error:
        raise InputError(f"Cannot read {path}: {reason(error)}.") from error


class _Table:
    """Collects the frames of a trace."""

    def __init__(self, path: Path) -> None:
        self.path, self.frame = path, 0
        self.times: list[float] = []
        self.bodies: dict[int, Body] = {}
        self.column: dict[int, int] = {}
        self.rows: list[tuple[list[int], list[list[float]]]] = []
        self.stationary: dict[int, tuple[Body, tuple[float, float, float, float]]] = {}
        self.version, self.map_reference = "", ""
        self.host: int | None = None

    def read(self) -> Trace:
        messages = _mcap(self.path) if self.path.suffix.lower() == ".mcap" else _stream(self.path)
        for frame, truth in enumerate(_ground_truths(self.path, messages)):
            self.frame = frame
            if frame >= _MOST_FRAMES:
                self._fault(f"there are more than {_MOST_FRAMES:,} frames; cut the trace")
            self._take(truth)
        if not self.bodies:
            raise DataError(f"{self.path.name}: no frame of {len(self.times):,} holds a moving object.")
        if len(self.times) * len(self.bodies) > _MOST_VALUES:
            raise DataError(f"{self.path.name}: {len(self.bodies):,} objects in {len(self.times):,} frames; cut it.")
        states = np.full((len(self.times), len(self.bodies), len(PLACE)), np.nan)
        for row, (columns, values) in enumerate(self.rows):
            if columns:
                states[row, columns] = values
        return Trace(
            self.version, self.map_reference, self.host, np.array(self.times), tuple(self.bodies.values()), states,
            tuple(self.stationary.values()),
        )  # fmt: skip

    def _fault(self, what: str) -> NoReturn:
        raise DataError(f"{self.path.name}, frame {self.frame}: {what}.")

    def _take(self, truth: Any) -> None:
        time = truth.timestamp.seconds + 1e-9 * truth.timestamp.nanos
        if self.times and time <= self.times[-1]:
            self._fault(f"its time, {time:.9g} s, does not come after {self.times[-1]:.9g} s of the frame before")
        self.times.append(time)
        if not self.version and truth.HasField("version"):
            number = truth.version
            self.version = f"{number.version_major}.{number.version_minor}.{number.version_patch}"
        self.map_reference = self.map_reference or _text(truth.map_reference)
        if truth.HasField("host_vehicle_id"):
            host = truth.host_vehicle_id.value
            if self.host not in (None, host):
                self._fault(f"the host vehicle is {host}, and was {self.host} before")
            self.host = host
        columns: dict[int, list[float]] = {}
        for thing in truth.moving_object:
            ident = thing.id.value
            if not thing.HasField("id"):
                self._fault("a moving object has no id")
            if self.column.get(ident, -1) in columns:
                self._fault(f"object {ident} is there twice")
            if ident not in self.column:
                if len(self.column) >= _MOST_OBJECTS:
                    self._fault(f"there are more than {_MOST_OBJECTS:,} moving objects; cut the trace")
                self.column[ident] = len(self.column)
            x, y, z, yaw = self._placed(thing.base, ident)
            rates = [
                self._number(vector, name, ident, most)
                for vector, most in ((thing.base.velocity, _FASTEST), (thing.base.acceleration, _HARDEST))
                for name in "xy"
            ]
            given = [thing.base.HasField(name) for name in ("velocity", "acceleration")]
            rates = [rate if given[k // 2] else math.nan for k, rate in enumerate(rates)]
            columns[self.column[ident]] = [x, y, z, yaw, *rates]
            self._know(thing, ident)
        for thing in truth.stationary_object:
            ident = thing.id.value
            if ident not in self.stationary:
                if len(self.stationary) >= _MOST_OBJECTS:
                    self._fault(f"there are more than {_MOST_OBJECTS:,} stationary objects; cut the trace")
                body = Body(ident, f"stationary object {ident}", -1, 0, self._size(thing.base, ident))
                self.stationary[ident] = body, self._placed(thing.base, ident)
        self.rows.append((list(columns), list(columns.values())))

    def _know(self, thing: Any, ident: int) -> None:
        """Remember what an object is, and the largest size that it has."""
        size = self._size(thing.base, ident)
        known = self.bodies.get(ident)
        if known is None:
            kind, vehicle = thing.type, thing.vehicle_classification.type
            self.bodies[ident] = Body(ident, _name(thing) or str(ident), kind, vehicle, size)
        elif any(a > b for a, b in zip(size, known.size, strict=True)):
            largest = (max(size[0], known.size[0]), max(size[1], known.size[1]), max(size[2], known.size[2]))
            self.bodies[ident] = Body(ident, known.name, known.kind, known.vehicle, largest)

    def _size(self, base: Any, ident: int) -> tuple[float, float, float]:
        length, width, height = (
            self._number(base.dimension, name, ident, _LARGEST) for name in ("length", "width", "height")
        )
        if min(length, width, height) < 0.0:
            self._fault(f"object {ident} has a size below 0")
        return length, width, height

    def _placed(self, base: Any, ident: int) -> tuple[float, float, float, float]:
        if not base.HasField("position"):
            self._fault(f"object {ident} has no position")
        x, y, z = (self._number(base.position, name, ident, _FARTHEST) for name in "xyz")
        return x, y, z, self._number(base.orientation, "yaw", ident, _FARTHEST)

    def _number(self, holder: Any, name: str, ident: int, most: float) -> float:
        value: float = getattr(holder, name)
        if not abs(value) <= most:
            self._fault(f"{name} of object {ident} is {value:g}; numbers up to {most:g} are read")
        return value


def _text(said: str | bytes) -> str:
    """Return a string of a message; the parser leaves one as bytes that is no UTF-8."""
    return said if isinstance(said, str) else said.decode("utf-8", "replace")


def _name(thing: Any) -> str:
    """Look up what the scenario calls an object; empty: the trace does not say."""
    for source in thing.source_reference:
        words = [_text(word) for word in source.identifier]
        named = next((word.partition(":")[2] for word in words if word.startswith("entity_name:")), "")
        if _text(source.type) == "net.asam.openscenario" and len(words) > 1:
            return named or words[1]
    return ""


def _ground_truths(path: Path, messages: Iterator[tuple[str, bytes]]) -> Iterator[Any]:
    """Parse the messages, in their order; where nothing names their type, it is that in which vehicles are found."""
    waiting: list[tuple[str, bytes]] = []
    frame, known = 0, ""
    for stated, content in messages:
        waiting.append((stated, content))
        known = known or stated or _type_of(path, frame + len(waiting) - 1, content)
        while known and waiting:
            yield _ground_truth(path, frame, known, waiting.pop(0)[1])
            frame += 1
    for _, content in waiting:
        yield _ground_truth(path, frame, GROUND_TRUTH, content)
        frame += 1


def _type_of(path: Path, frame: int, content: bytes) -> str:
    """Tell the type of a message; empty: neither a ground truth nor a sensor view of it shows a moving object."""
    for name in (GROUND_TRUTH, SENSOR_VIEW):
        try:
            if _ground_truth(path, frame, name, content).moving_object:
                return name
        except FileFormatError:
            if name == SENSOR_VIEW:
                raise
    return ""


def _ground_truth(path: Path, frame: int, name: str, content: bytes) -> Any:
    made = message_class(name)
    from google.protobuf.message import DecodeError

    try:
        message = made.FromString(content)
    except DecodeError:
        raise FileFormatError(f"{path.name}, frame {frame}: this is no message of ASAM OSI 3.") from None
    return message.global_ground_truth if name == SENSOR_VIEW else message


def _stream(path: Path) -> Iterator[tuple[str, bytes]]:
    """Read the messages of an .osi file; an empty type: it does not say."""
    message_class(GROUND_TRUTH)
    left, frame = path.stat().st_size, 0
    with path.open("rb") as file:
        while left:
            head = file.read(4)
            size = struct.unpack("<I", head)[0] if len(head) == 4 else 4
            left -= len(head)
            if size > left:
                raise FileFormatError(
                    f"{path.name}, frame {frame}: it is cut off, or this is no OSI trace: {size:,} bytes should "
                    f"follow, and {left:,} are left."
                )
            if size > _MOST_MESSAGE:
                raise FileFormatError(f"{path.name}, frame {frame}: it has {size:,} bytes; {_MOST_MESSAGE:,} are read.")
            yield "", file.read(size)
            left -= size
            frame += 1
    if not frame:
        raise FileFormatError(f"{path.name} is empty.")


def _mcap(path: Path) -> Iterator[tuple[str, bytes]]:
    """Read the messages of an MCAP file, with their types."""
    try:
        import lz4.frame
        import zstandard
        from mcap.exceptions import McapError
        from mcap.records import Channel, Chunk, Message, Schema
        from mcap.stream_reader import StreamReader, breakup_chunk
    except ImportError as error:
        raise MissingExtraError("mcap", "osi") from error

    def opened(chunk: Any) -> list[Any]:
        size, data = chunk.uncompressed_size, chunk.data
        if size > _MOST_MESSAGE:
            raise ValueError(f"a chunk of {size:,} bytes")
        if chunk.compression == "zstd":
            data = zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        if len(data) != size:
            raise ValueError("a chunk of another size than it says")
        chunk.compression, chunk.data = "", data
        records: list[Any] = breakup_chunk(chunk, validate_crc=True)
        return records

    schemas: dict[int, str] = {}
    topics: dict[int, tuple[str, str]] = {}
    frame = 0
    try:
        with path.open("rb") as file:
            reader = StreamReader(file, emit_chunks=True, record_size_limit=_MOST_MESSAGE)
            for outer in reader.records:
                for record in opened(outer) if isinstance(outer, Chunk) else [outer]:
                    if isinstance(record, Schema):
                        schemas[record.id] = record.name
                    elif isinstance(record, Channel):
                        kind = schemas.get(record.schema_id, "")
                        if kind in (GROUND_TRUTH, SENSOR_VIEW) and record.message_encoding == "protobuf":
                            topics[record.id] = record.topic, kind
                            if len(topics) > 1:
                                names = ", ".join(sorted(topic for topic, _ in topics.values()))
                                raise DataError(f"{path.name} holds several traces ({names}); give files of one each.")
                    elif isinstance(record, Message) and record.channel_id in topics:
                        yield topics[record.channel_id][1], record.data
                        frame += 1
    except (
        McapError, struct.error, ValueError, RuntimeError, zstandard.ZstdError, MemoryError, EOFError, KeyError,
        OverflowError,
    ) as error:  # fmt: skip
        if isinstance(error, (DataError, FileFormatError, InputError)):
            raise
        raise FileFormatError(f"{path.name}, frame {frame}: it is no whole MCAP file ({error}).") from None
    if not topics:
        raise FileFormatError(f"{path.name} has no channel of osi3.GroundTruth or osi3.SensorView.")
