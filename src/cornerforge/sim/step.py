"""One decision of a world: everybody decides, then 1 s of motion in 0.1 s substeps with collision checks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.geometry import boxes_overlap, lane_bits, lane_centre, path_at
from cornerforge.sim.decide import apply_action, av_decide, decide_bvs, start_lane_change
from cornerforge.sim.world import (
    AV_CRASH,
    BV_CRASH,
    COMPLETED,
    CONTROLLED,
    FRAME,
    N_BV_CRASHES,
    N_DECISIONS,
    N_VEHICLES,
    OUTCOME,
    RUNNING,
    SLOT_A,
    SLOT_B,
    TIME_UP,
    path_of,
)
from cornerforge.types import ACCELERATIONS, FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.sim.world import AvNumbers, RoadNumbers, World

__all__ = ["FRAME_FIELDS", "Pairs", "allocate_pairs", "allocate_recording", "move_vehicle", "step_world"]

SUBSTEPS = 10
_DT = FRAME_S
_FULL_STEERING_SPEED = 5.0
_ACCELERATIONS = ACCELERATIONS
MAX_RELATIVE_GAIN = 7.0
"""Two vehicles whose accelerations differ by at most 14 m/s2 (what `IdmParams` and the actions allow) come nearer to
each other by at most this much more than at constant speeds in 1 s [m]."""


class Pairs(NamedTuple):
    """Scratch: pairs of slots that can touch within the coming second, each (capacity,)."""

    a: NDArray[np.int64]
    b: NDArray[np.int64]


FRAME_FIELDS = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("speed", "f8"),
        ("heading", "f8"),
        ("acceleration", "f8"),
        ("target_lane", "i1"),
        ("present", "i1"),
    ],
    align=True,
)
"""One vehicle in one recorded frame; units as in `world.VEHICLE`."""


def allocate_pairs(slots: int) -> Pairs:
    """Scratch for worlds of so many slots."""
    return Pairs(np.zeros(8 * slots, dtype=np.int64), np.zeros(8 * slots, dtype=np.int64))


def allocate_recording(frames: int, slots: int) -> NDArray[np.void]:
    """Room for so many frames, (frames, slots) of FRAME_FIELDS, all absent; 0 frames record nothing."""
    return np.zeros((frames, slots), dtype=FRAME_FIELDS)


@kernel
def move_vehicle(w: World, i: int, road: RoadNumbers) -> None:
    """Advance one vehicle by 0.1 s: constant acceleration along the road, its path across it.

    Speeds stay in [0, max_speed]. Below 5 m/s the lateral clock slows in proportion, so that a standing car cannot move
    sideways.
    """
    v = w.vehicles
    speed = v[i].speed
    a = v[i].acceleration
    after = speed + a * _DT
    if after < 0.0:
        v[i].x += -0.5 * speed * speed / a
        after = 0.0
    else:
        after = min(after, road.max_speed)
        v[i].x += 0.5 * (speed + after) * _DT
    v[i].speed = after
    if v[i].duration == 0.0:
        return
    pace = min(1.0, after / _FULL_STEERING_SPEED)
    v[i].clock += _DT * pace
    if v[i].clock >= v[i].duration - 1e-9:
        v[i].y = lane_centre(v[i].target_lane, road.lane_width)
        v[i].lateral_speed = 0.0
        v[i].heading = 0.0
        v[i].duration = 0.0
    else:
        y, lateral_speed, _ = path_at(path_of(v, i), v[i].clock)
        v[i].y = y
        v[i].lateral_speed = lateral_speed * pace
        if after > 0.0:
            v[i].heading = math.atan(v[i].lateral_speed / after)
    v[i].lanes = lane_bits(v[i].y, 0.5 * road.width, v[i].target_lane, road.lane_width)


@kernel
def _lateral_reach(w: World, i: int, road: RoadNumbers) -> float:
    """Upper bound of the sideways movement of slot i within the coming second [m]."""
    v = w.vehicles
    if i > 0 and v[i].duration == 0.0:
        return 0.0
    return road.lane_width if road.lane_change_duration >= 2.0 else 2.0 * road.lane_width


@kernel
def _find_pairs(w: World, road: RoadNumbers, pairs: Pairs) -> int:
    """List the pairs of vehicles that can touch within the coming second; returns their number.

    A conservative bound on relative motion: testing only these is bitwise the same as testing all.
    """
    v = w.vehicles
    order = w.order
    info = w.info
    n = info[N_VEHICLES]
    found = 0
    fastest = 0.0
    for i in range(n):
        if v[i].present:
            fastest = max(fastest, v[i].speed)
    for rank in range(n):
        i = order[rank]
        if v[i].present == 0:
            continue
        reach = _lateral_reach(w, i, road)
        limit = road.length + 1.0 + MAX_RELATIVE_GAIN + fastest
        for other in range(rank + 1, n):
            j = order[other]
            dx = v[j].x - v[i].x
            if dx > limit:
                break
            if v[j].present == 0 or dx > road.length + 1.0 + MAX_RELATIVE_GAIN + max(0.0, v[i].speed - v[j].speed):
                continue
            if abs(v[j].y - v[i].y) < road.width + 1.0 + reach + _lateral_reach(w, j, road) and found < pairs.a.size:
                pairs.a[found] = min(i, j)
                pairs.b[found] = max(i, j)
                found += 1
    return found


@kernel
def _touch(w: World, a: int, b: int, road: RoadNumbers) -> bool:
    """Are both vehicles there, and do their boxes overlap?"""
    v = w.vehicles
    if v[a].present == 0 or v[b].present == 0:
        return False
    return boxes_overlap(v[a].x, v[a].y, v[a].heading, v[b].x, v[b].y, v[b].heading, road.length, road.width)


@kernel
def _check_contacts(w: World, pairs: Pairs, n_pairs: int, frame: int, road: RoadNumbers) -> bool:
    """Look for contacts at this frame; returns True when one ends the test.

    A crash of the AV goes before all others, then one of the controlled BV. Only if neither happens are BVs that crash
    into each other counted and removed, so that the last frame of a crash still shows everybody.
    """
    info = w.info
    for k in range(n_pairs):
        a = pairs.a[k]
        b = pairs.b[k]
        is_av = a == 0
        if not is_av and (info[OUTCOME] != RUNNING or (info[CONTROLLED] != a and info[CONTROLLED] != b)):
            continue
        if info[OUTCOME] != AV_CRASH and _touch(w, a, b, road):
            info[OUTCOME] = AV_CRASH if is_av else BV_CRASH
            info[SLOT_A] = a
            info[SLOT_B] = b
            info[FRAME] = frame
    if info[OUTCOME] != RUNNING:
        if info[OUTCOME] == BV_CRASH:
            info[N_BV_CRASHES] += 1
        return True
    for k in range(n_pairs):
        a = pairs.a[k]
        b = pairs.b[k]
        if a > 0 and _touch(w, a, b, road):
            info[N_BV_CRASHES] += 1
            w.vehicles[a].present = 0
            w.vehicles[b].present = 0
    return False


@kernel
def record_frame(w: World, frame: int, recording: NDArray[np.void]) -> None:
    """Write the present state as a frame, if there is room."""
    if frame >= recording.shape[0]:
        return
    v = w.vehicles
    for i in range(w.info[N_VEHICLES]):
        if v[i].present:
            cell = recording[frame, i]
            cell.x = v[i].x
            cell.y = v[i].y
            cell.speed = v[i].speed
            cell.heading = v[i].heading
            cell.acceleration = v[i].acceleration
            cell.target_lane = v[i].target_lane
            cell.present = 1


@kernel
def _av_acts(w: World, command: float, lane: int, road: RoadNumbers) -> None:
    v = w.vehicles
    v[0].acceleration = command
    if lane != v[0].target_lane:
        start_lane_change(w, 0, lane, road)


@kernel
def step_world(
    w: World, seed: int, test: int, bv_model: int, controlled_action: int, road: RoadNumbers, av: AvNumbers,
    tables: NddTables, pairs: Pairs, recording: NDArray[np.void],
) -> None:  # fmt: skip
    """Advance a running world by one decision (1 s, or less when the test ends); results are in `w.info`.

    Before the call info[CONTROLLED] names the BV that takes `controlled_action`, -1 for none.
    """
    v = w.vehicles
    info = w.info
    n = info[N_VEHICLES]
    first_frame = SUBSTEPS * info[N_DECISIONS]
    command, lane = av_decide(w, road, av)
    decide_bvs(w, seed, test, bv_model, controlled_action, road, av, tables)
    for i in range(1, n):
        if v[i].present:
            apply_action(w, i, v[i].action, _ACCELERATIONS, road)
    _av_acts(w, command, lane, road)
    n_pairs = _find_pairs(w, road, pairs)
    info[N_DECISIONS] += 1
    for substep in range(SUBSTEPS):
        if substep > 0 and substep % road.av_substeps == 0:
            command, lane = av_decide(w, road, av)
            _av_acts(w, command, lane, road)
        record_frame(w, first_frame + substep, recording)
        for i in range(n):
            if v[i].present:
                move_vehicle(w, i, road)
        frame = first_frame + substep + 1
        ends = _check_contacts(w, pairs, n_pairs, frame, road)
        if not ends and v[0].x >= road.av_start + road.test_length:
            info[OUTCOME] = COMPLETED
            info[FRAME] = frame
            ends = True
        if ends:
            record_frame(w, frame, recording)
            return
    if info[N_DECISIONS] >= road.max_decisions:
        info[OUTCOME] = TIME_UP
        info[FRAME] = first_frame + SUBSTEPS
        record_frame(w, first_frame + SUBSTEPS, recording)
