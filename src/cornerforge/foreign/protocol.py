"""The protocol between the simulator and the process of a foreign AV: framed messages over a socket, numbers as bytes.

Nothing is pickled in either direction. A frame is one byte of kind, eight bytes of length, and the body.
"""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import socket

__all__ = ["ACT", "ANSWER", "FAILED", "LOAD", "MOST_BYTES", "SETUP", "JunkError", "pack", "pack_json", "receive",
           "unpack_json"]  # fmt: skip

LOAD, SETUP, ACT = b"L", b"S", b"A"
"""Messages to the AV's process: load the AV; tell it its world; new tests and views."""
ANSWER, FAILED = b".", b"!"
"""Messages from the AV's process: done; it did not work, and why."""
MOST_BYTES = 1 << 30
"""Longest body of a frame."""
_KINDS = (LOAD, SETUP, ACT, ANSWER, FAILED)
_HEAD = struct.Struct("<cQ")


class JunkError(Exception):
    """What came through the socket is no message of this protocol."""


def pack(kind: bytes, *parts: bytes) -> bytes:
    """Make one frame."""
    return b"".join([_HEAD.pack(kind, sum(len(part) for part in parts)), *parts])


def pack_json(kind: bytes, content: dict[str, Any]) -> bytes:
    """Make one frame with a JSON object."""
    return pack(kind, json.dumps(content).encode())


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


def _exactly(connection: socket.socket, size: int) -> bytearray:
    data = bytearray(size)
    view = memoryview(data)
    got = 0
    while got < size:
        n = connection.recv_into(view[got:])
        if n == 0:
            raise EOFError
        got += n
    return data


def receive(connection: socket.socket) -> tuple[bytes, bytearray]:
    """Read one frame.

    Raises:
        EOFError: The other side has closed the connection.
        JunkError: It is no frame, or one that is too long.
        TimeoutError: The frame did not come within the socket's timeout.
    """
    head = bytes(_exactly(connection, _HEAD.size))
    kind, size = _HEAD.unpack(head)
    if kind not in _KINDS or size > MOST_BYTES:
        raise JunkError(f"{head!r} begins no message")
    return kind, _exactly(connection, size)
