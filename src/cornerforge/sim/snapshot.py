"""Worlds that are copied, stored, sent and continued: all that the future of a test depends on, to the bit.

A world may be taken wherever `advance` returns; in the same setting it goes on as if it had not been interrupted. With
another `branch` its past stays and its future is drawn again, as splitting needs.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any, cast

import numpy as np

from cornerforge._checks import check_integer
from cornerforge._schema import parse
from cornerforge.errors import FileFormatError, InputError
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import MAX_BRANCH, VEHICLE, World, allocate_like, n_slots, world_of
from cornerforge.sim.world_values import world_fault
from cornerforge.types import SUBSTEPS

__all__ = ["branch_of", "copy_of", "packed", "unpacked"]

SNAPSHOT_SCHEMA = 5
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
    head = json.dumps({"schema_version": SNAPSHOT_SCHEMA, "arrays": _layout(world)}).encode() + b"\n"
    content = _MAGIC + head + b"".join(np.ascontiguousarray(array).tobytes() for array in world)
    return content + hashlib.sha256(content).digest()


def unpacked(content: bytes, setting: Setting | None = None) -> World:
    """Unpack a world that `packed` made bytes of.

    Args:
        content: The bytes.
        setting: The run in which the world is driven on; it must have the world's road. None: not checked.

    Raises:
        FileFormatError: The bytes are no world, damaged, of a version with another state, or hold a value that no
            world can have.
        InputError: The world is of a road with another number of lanes or of vehicle slots than the setting's.
    """
    body, digest = content[:-_DIGEST_BYTES], content[-_DIGEST_BYTES:]
    if not content.startswith(_MAGIC):
        raise FileFormatError("These bytes are no stored world of cornerforge.")
    if hashlib.sha256(body).digest() != digest:
        raise FileFormatError("This stored world is damaged: its checksum does not fit.")
    head, _, rest = body[len(_MAGIC) :].partition(b"\n")
    world = _allocated(head, len(rest))
    place = 0
    for array in world:
        array[...] = np.frombuffer(rest, dtype=array.dtype, count=array.size, offset=place).reshape(array.shape)
        place += array.nbytes
    late = 0 if setting is None else int(setting.road.perception.late)
    if setting is not None and world.seen.size != world.vehicles.size * (late + 2 if late else 1):
        raise InputError(
            "The AV of this stored world sees later, or earlier, than the setting's; drive it on as it was."
        )
    if setting is not None and world.vehicles.size != n_slots(setting.road):
        raise InputError(
            f"This stored world has {world.vehicles.size} vehicle slots, the setting's road of {setting.road.n_lanes} "
            f"lanes has {n_slots(setting.road)}: drive it on in the ODD that it was stored in."
        )
    fault = world_fault(world) if setting is None else world_fault(world, setting.road.n_lanes)
    if fault is not None:
        raise FileFormatError(f"This stored world is damaged: {fault}. Drive its test again.")
    return world


def _layout(world: World) -> dict[str, Any]:
    """Describe the arrays of a world as JSON holds it: fields and shape by name."""
    layout = {
        name: {"fields": np.lib.format.dtype_to_descr(array.dtype), "shape": list(array.shape)}
        for name, array in world._asdict().items()
    }
    return cast("dict[str, Any]", json.loads(json.dumps(layout)))


def _allocated(head: bytes, size: int) -> World:
    """Allocate the world that a head describes, of which `size` bytes follow.

    Raises:
        FileFormatError: It describes no world of this version.
    """
    try:
        header = parse(head.decode())
        version = header["schema_version"]
    except (ValueError, KeyError, TypeError) as error:
        raise FileFormatError("This stored world is damaged: its first line cannot be read.") from error
    if version != SNAPSHOT_SCHEMA:
        raise FileFormatError(
            f"This stored world has schema version {version}; this cornerforge reads {SNAPSHOT_SCHEMA}. "
            "Drive its test again."
        )
    try:
        slots = int(header["arrays"]["vehicles"]["shape"][0])
        parts = int(header["arrays"]["seen"]["shape"][0]) // slots
        agents = slots if header["arrays"]["agents"]["shape"][0] else 0
    except (LookupError, TypeError, ValueError, OverflowError, ZeroDivisionError):
        slots = parts = agents = 0
    if 0 < slots <= size // VEHICLE.itemsize and 1 <= parts <= SUBSTEPS + 2:
        world = world_of(allocate_like(1, slots, max(0, parts - 2), agents))
        if header["arrays"] == _layout(world) and sum(array.nbytes for array in world) == size:
            return world
    raise FileFormatError(
        "This stored world has other fields than this cornerforge's, or is none or several. Drive its test again."
    )
