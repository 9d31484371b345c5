"""Worlds that are copied, stored, sent and taken up again: all that the future of a test depends on, to the bit.

A world may be taken wherever `advance` returns; in the same setting it goes on as if it had never been left. With
another `branch` its past stays and its future is drawn anew, as splitting needs.
"""

from __future__ import annotations

import hashlib
import json
import math

import numpy as np

from cornerforge._checks import check_integer
from cornerforge.errors import FileFormatError
from cornerforge.sim.world import MAX_BRANCH, World

__all__ = ["branch_of", "copy_of", "packed", "unpacked"]

SNAPSHOT_SCHEMA = 2
_MAGIC = b"cornerforge world\n"
_DIGEST_BYTES = 32


def copy_of(world: World) -> World:
    """Copy a world into memory of its own."""
    return World._make(array.copy() for array in world)


def branch_of(world: World, branch: int) -> World:
    """Copy a world and give the copy other random words from now on; branch 0 keeps the words of the test's name.

    Args:
        world: A world, or a copy of one.
        branch: 0 to 65,535. Copies of one world with the same branch do the same.

    Raises:
        InputError: The branch is out of range.
    """
    check_integer("branch", branch, low=0, high=MAX_BRANCH)
    copy = copy_of(world)
    copy.state["branch"] = branch
    return copy


def packed(world: World) -> bytes:
    """Pack a world into bytes: a line with format and layout, the arrays one after the other, a SHA-256 over all."""
    layout = {
        name: {"fields": np.lib.format.dtype_to_descr(array.dtype), "shape": list(array.shape)}
        for name, array in world._asdict().items()
    }
    head = json.dumps({"schema_version": SNAPSHOT_SCHEMA, "arrays": layout}).encode() + b"\n"
    content = _MAGIC + head + b"".join(np.ascontiguousarray(array).tobytes() for array in world)
    return content + hashlib.sha256(content).digest()


def unpacked(content: bytes) -> World:
    """Unpack a world that `packed` made bytes of.

    Raises:
        FileFormatError: The bytes are no world, damaged, or of a version with another state.
    """
    body, digest = content[:-_DIGEST_BYTES], content[-_DIGEST_BYTES:]
    if not content.startswith(_MAGIC):
        raise FileFormatError("These bytes are no stored world of cornerforge.")
    if hashlib.sha256(body).digest() != digest:
        raise FileFormatError("This stored world is damaged: its checksum does not fit.")
    head, _, rest = body[len(_MAGIC) :].partition(b"\n")
    header = json.loads(head)
    if header["schema_version"] != SNAPSHOT_SCHEMA:
        raise FileFormatError(
            f"This stored world has schema version {header['schema_version']}; this cornerforge reads "
            f"{SNAPSHOT_SCHEMA}. Drive its test again."
        )
    arrays, place = {}, 0
    for name, layout in header["arrays"].items():
        dtype = np.lib.format.descr_to_dtype(layout["fields"])
        shape = tuple(layout["shape"])
        size = math.prod(shape) * dtype.itemsize
        arrays[name] = np.frombuffer(rest[place : place + size], dtype=dtype).reshape(shape).copy()
        place += size
    return World(**arrays)
