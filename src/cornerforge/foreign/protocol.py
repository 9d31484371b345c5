"""The protocol between the simulator and the process of a foreign AV: framed messages over a socket, numbers as bytes.

Nothing is pickled in either direction. A frame is one byte of kind, eight bytes each of a number and a length, and the
body. An answer has the number of its question.
"""

from __future__ import annotations

import json
import select
import struct
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import socket

__all__ = ["ACT", "ANSWER", "FAILED", "LOAD", "MOST_BYTES", "SETUP", "JunkError", "pack", "pack_json",
           "receive", "unpack_json"]  # fmt: skip

LOAD, SETUP, ACT = b"L", b"S", b"A"
"""Messages to the AV's process: load the AV; tell it its world; new tests and views."""
ANSWER, FAILED = b".", b"!"
"""Messages from the AV's process: done; it did not work, and why."""
MOST_BYTES = 1 << 30
"""Longest body of a frame."""
_KINDS = (LOAD, SETUP, ACT, ANSWER, FAILED)
_MOST_AT_ONCE = 1 << 20
_HEAD = struct.Struct("<cQQ")


class JunkError(Exception):
    """Bytes came through the socket that are no message of this protocol."""


def pack(kind: bytes, number: int, *parts: bytes) -> bytes:
    """Make one frame."""
    return b"".join([_HEAD.pack(kind, number, sum(len(part) for part in parts)), *parts])


def pack_json(kind: bytes, number: int, content: dict[str, Any]) -> bytes:
    """Make one frame with a JSON object."""
    return pack(kind, number, json.dumps(content).encode())


def unpack_json(body: bytes | bytearray) -> dict[str, Any]:
    """Read the JSON object of a frame's body.

    Raises:
        JunkError: It is none.
    """
    try:
        content = json.loads(bytes(body))
    except (ValueError, RecursionError) as error:
        raise JunkError(f"{bytes(body[:40])!r} is no JSON") from error
    if not isinstance(content, dict):
        raise JunkError(f"{bytes(body[:40])!r} is no JSON object")
    return content


def receive(
    connection: socket.socket, until: float | None = None, line: socket.socket | None = None
) -> tuple[bytes, int, bytearray]:
    """Read one frame: kind, number, body.

    Args:
        connection: The socket.
        until: When it must have come, by `time.monotonic` [s]; None: never.
        line: Another socket, over which something comes only when no frame will.

    Raises:
        EOFError: The other side has closed the connection, or something came over the line.
        JunkError: It is no frame, or one that is too long.
        TimeoutError: The frame did not come in time.
    """
    poll = select.poll()
    poll.register(connection, select.POLLIN)
    if line is not None:
        poll.register(line, select.POLLIN)

    def exactly(size: int) -> bytearray:
        data = bytearray()
        while len(data) < size:
            ready = dict(poll.poll(None if until is None else max(0.0, 1000.0 * (until - time.monotonic()))))
            if not ready:
                raise TimeoutError
            part = connection.recv(min(size - len(data), _MOST_AT_ONCE)) if connection.fileno() in ready else b""
            if not part:
                raise EOFError
            data += part
        return data

    head = bytes(exactly(_HEAD.size))
    kind, number, size = _HEAD.unpack(head)
    if kind not in _KINDS or size > MOST_BYTES:
        raise JunkError(f"{head!r} begins no message")
    return kind, number, exactly(size)
