"""Traces of ASAM OSI written and read byte by byte, from the standard's field numbers, without the package's tables."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

Fields: TypeAlias = Sequence[tuple[int, Any]]
"""Numbers and values: int is a varint, float a double, str and bytes are themselves, a sequence is a message."""

VEHICLE, PEDESTRIAN, ANIMAL = 2, 3, 4
CAR, TRUCK, MOTORCYCLE, BICYCLE = 4, 7, 10, 11


def varint(value: int) -> bytes:
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def encoded(fields: Fields) -> bytes:
    out = b""
    for number, value in fields:
        if isinstance(value, float):
            out += varint(number << 3 | 1) + struct.pack("<d", value)
        elif isinstance(value, int):
            out += varint(number << 3) + varint(value)
        else:
            content = value.encode() if isinstance(value, str) else value
            content = content if isinstance(content, bytes) else encoded(content)
            out += varint(number << 3 | 2) + varint(len(content)) + content
    return out


def decoded(content: bytes) -> Iterator[tuple[int, Any]]:
    """Numbers and values; a message stays bytes."""
    at = 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = content[at]
            value |= (byte & 127) << shift
            at, shift = at + 1, shift + 7
            if byte < 128:
                return value

    while at < len(content):
        key = number()
        if key & 7 == 0:
            yield key >> 3, number()
        elif key & 7 == 1:
            yield key >> 3, struct.unpack_from("<d", content, at)[0]
            at += 8
        else:
            size = number()
            yield key >> 3, content[at : at + size]
            at += size


def field(content: bytes, *path: int, default: Any = 0.0) -> Any:
    """The value at a path of numbers; the default where it is not set."""
    for number in path:
        content = dict(decoded(content)).get(number, b"" if number != path[-1] else default)
    return content


@dataclass(frozen=True)
class Thing:
    """A moving object at one time, in the world."""

    ident: int
    x: float
    y: float
    yaw: float = 0.0
    vx: float = 20.0
    vy: float = 0.0
    ax: float = 0.0
    length: float = 5.0
    width: float = 2.0
    kind: int = VEHICLE
    vehicle: int = CAR
    name: str = ""

    def fields(self) -> Fields:
        base = (
            (1, ((1, self.length), (2, self.width), (3, 1.5))),
            (2, ((1, self.x), (2, self.y), (3, 0.75))),
            (3, ((3, self.yaw),)),
            (4, ((1, self.vx), (2, self.vy))),
            (5, ((1, self.ax), (2, 0.0))),
        )
        source = ((2, "net.asam.openscenario"), (3, "Vehicle"), (3, self.name))
        return (
            (1, ((1, self.ident),)), (2, base), (3, self.kind), (6, ((1, self.vehicle),)),
            *(((10, source),) if self.name else ()),
        )  # fmt: skip


def ground_truth(time: float, things: Sequence[Thing], *, host: int | None = None, more: Fields = ()) -> bytes:
    nanos = round(1e9 * time)
    return encoded((
        (1, ((1, 3), (2, 7), (3, 0))), (2, ((1, nanos // 10**9), (2, nanos % 10**9))),
        *(((3, ((1, host),)),) if host is not None else ()), *((5, thing.fields()) for thing in things), *more,
    ))  # fmt: skip


def driven(thing: Thing, time: float) -> Thing:
    """The thing after some time of constant acceleration along the world's x."""
    way = thing.vx * time + 0.5 * thing.ax * time**2
    return replace(thing, x=thing.x + way, y=thing.y + thing.vy * time, vx=thing.vx + thing.ax * time)


def stream(path: Path, messages: Sequence[bytes]) -> Path:
    path.write_bytes(b"".join(struct.pack("<I", len(one)) + one for one in messages))
    return path


def scene(
    path: Path, *things: Thing, times: Sequence[float] = (), spans: Mapping[int, tuple[float, float]] | None = None,
    host: int | None = 0, more: Fields = (),
) -> Path:  # fmt: skip
    """Write a trace of things that keep their acceleration, 5 s at 20 Hz; `spans` says when one is there."""
    times = times or [0.05 * k for k in range(101)]
    spans = spans or {}

    def there(thing: Thing, time: float) -> bool:
        first, last = spans.get(thing.ident, (0.0, 1e9))
        return first - 1e-9 <= time <= last + 1e-9

    frames = [[driven(one, time) for one in things if there(one, time)] for time in times]
    return stream(
        path, [ground_truth(time, frame, host=host, more=more) for time, frame in zip(times, frames, strict=True)]
    )


def road(right: Sequence[str] = (), *, left: Sequence[str] = (), shape: str = "<line/>", begin: int = -500) -> str:
    """An OpenDRIVE road along the world's x; its lanes -1, -2 and -3 of 4 m lie to the right of y = 0."""
    lanes = "".join(right or [lane(-1), lane(-2), lane(-3)])
    return f"""<OpenDRIVE><header revMajor="1" revMinor="8"/><road id="1" length="3000" rule="RHT"><planView>
<geometry s="0" x="{begin}" y="0" hdg="0" length="1000"><line/></geometry>
<geometry s="1000" x="{begin + 1000}" y="0" hdg="0" length="2000">{shape}</geometry></planView><lanes>
<laneSection s="0"><left>{"".join(left)}</left><center><lane id="0" type="none"/></center><right>{lanes}</right>
</laneSection></lanes></road></OpenDRIVE>"""


def lane(ident: int, kind: str = "driving", width: float = 4.0, more: str = "") -> str:
    return f'<lane id="{ident}" type="{kind}" {more}><width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'
