"""One decision of a world: everybody decides, then 1 s of motion in 0.1 s substeps with collision checks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._elementary import atan
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.geometry import boxes_overlap, lane_bits, lane_centre, path_at
from cornerforge.sim.actions import apply_action, hold, start_lane_change
from cornerforge.sim.av_kinds import built_in_av_decides, drives_by_idm, sees_everybody
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.reach import bound_motion, choose_current, find_pairs
from cornerforge.sim.world import (
    AV_CRASH,
    BV_CRASH,
    COMPLETED,
    CONTROLLED,
    FRAME,
    N_BV_CRASHES,
    N_CURRENT,
    N_DECISIONS,
    N_SEEN,
    N_VEHICLES,
    OUTCOME,
    RUNNING,
    SLOT_A,
    SLOT_B,
    TIME_UP,
    forget_av_neighbours,
    list_all,
    path_of,
)
from cornerforge.types import ACCELERATIONS, FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.sim.reach import Pairs
    from cornerforge.sim.world import AvNumbers, RoadNumbers, World

__all__ = [
    "FRAME_FIELDS",
    "allocate_recording",
    "av_acts",
    "begin_second",
    "begin_to_act",
    "move_on",
    "move_vehicle",
    "record_frame",
    "step_world",
]

SUBSTEPS = 10
_DT = FRAME_S
_FULL_STEERING_SPEED = 5.0
_ACCELERATIONS = ACCELERATIONS
_HARDEST_BRAKING, _STRONGEST_ACCELERATION = 12.0, 10.0
"""No AV brakes or accelerates harder [m/s2]: what `IdmParams` allows; orders from outside are cut to less."""

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


def allocate_recording(frames: int, slots: int) -> NDArray[np.void]:
    """Room for so many frames, (frames, slots) of FRAME_FIELDS, all absent; 0 frames record nothing."""
    return np.zeros((frames, slots), dtype=FRAME_FIELDS)


@inlined_kernel
def move_vehicle(v: NDArray[np.void], i: int, held: float, road: RoadNumbers) -> None:
    """Put vehicle i where it is `held` seconds after its acceleration began, and its lateral path 0.1 s further.

    Position and speed along the road are functions of `held`, not sums of substeps, so a vehicle that nobody looks at
    in between need not be moved in between. Speeds stay in [0, max_speed]. Below 5 m/s the lateral clock slows in
    proportion, so that a standing car cannot move sideways.
    """
    start = v[i].speed_held
    a = v[i].acceleration
    after = start + a * held
    if after < 0.0:
        v[i].x = v[i].x_held - 0.5 * start * start / a
        after = 0.0
    elif after > road.max_speed:
        until = (road.max_speed - start) / a
        v[i].x = v[i].x_held + 0.5 * (start + road.max_speed) * until + road.max_speed * (held - until)
        after = road.max_speed
    else:
        v[i].x = v[i].x_held + 0.5 * (start + after) * held
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
            v[i].heading = atan(v[i].lateral_speed / after)
    v[i].lanes = lane_bits(v[i].y, 0.5 * road.width, v[i].target_lane, road.lane_width)


@inlined_kernel
def _touch(w: World, a: int, b: int, road: RoadNumbers) -> bool:
    """Are both vehicles there, and do their boxes overlap?"""
    v = w.vehicles
    if v[a].present == 0 or v[b].present == 0:
        return False
    return boxes_overlap(v[a].x, v[a].y, v[a].heading, v[b].x, v[b].y, v[b].heading, road.length, road.width)


@kernel
def _drop_absent(w: World) -> None:
    """Take vehicles that are no longer there off the list of current ones."""
    kept = 0
    seen = 0
    for k in range(w.info[N_CURRENT]):
        if w.vehicles[w.current[k]].present:
            w.current[kept] = w.current[k]
            kept += 1
            if k < w.info[N_SEEN]:
                seen = kept
    w.info[N_CURRENT] = kept
    w.info[N_SEEN] = seen
    forget_av_neighbours(w)


@inlined_kernel
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
    removed = False
    for k in range(n_pairs):
        a = pairs.a[k]
        b = pairs.b[k]
        if a > 0 and _touch(w, a, b, road):
            info[N_BV_CRASHES] += 1
            w.vehicles[a].present = 0
            w.vehicles[b].present = 0
            removed = True
    if removed:
        _drop_absent(w)
    return False


@inlined_kernel
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


@inlined_kernel
def av_acts(w: World, command: float, lane: int, road: RoadNumbers) -> None:
    """The AV holds an acceleration [m/s2] from now on, and begins a change to `lane` if that is another."""
    v = w.vehicles
    hold(v, 0, command)
    if lane != v[0].target_lane:
        start_lane_change(w, 0, lane, road)


@inlined_kernel
def _move(w: World, substep: int, road: RoadNumbers) -> None:
    """Move who is kept current to the end of a substep; at the end of the second everybody.

    What is known of the AV's neighbours holds at the second's end too, when the AV decides next.
    """
    v = w.vehicles
    if substep == SUBSTEPS - 1:
        list_all(w)
    move_vehicle(v, 0, (substep % road.av_substeps + 1) * _DT, road)
    held = (substep + 1) * _DT
    for k in range(1, w.info[N_CURRENT]):
        move_vehicle(v, w.current[k], held, road)


@inlined_kernel
def begin_to_act(
    w: World, command: float, lane: int, everybody: bool, road: RoadNumbers, av: AvNumbers, pairs: Pairs
) -> int:
    """Everybody begins to act: BVs by their `action`, the AV with `command` [m/s2] and target `lane`.

    `w.order` is sorted. Returns, and `everybody`: as for `begin_second`.
    """
    v = w.vehicles
    for i in range(1, w.info[N_VEHICLES]):
        if v[i].present:
            apply_action(w, i, v[i].action, _ACCELERATIONS, road)
    av_acts(w, command, lane, road)
    everybody = everybody or sees_everybody(av)
    bound_by_idm = drives_by_idm(av) and not everybody
    braking = av.idm.max_braking if bound_by_idm else _HARDEST_BRAKING
    acceleration = av.idm.max_acceleration if bound_by_idm else _STRONGEST_ACCELERATION
    bound_motion(w, braking, acceleration, pairs)
    n_pairs = find_pairs(w, road, pairs)
    choose_current(w, pairs, n_pairs, everybody, road)
    w.info[N_DECISIONS] += 1
    return n_pairs


@inlined_kernel
def begin_second(
    w: World, seed: int, test: int, bv_model: int, controlled_action: int, command: float, lane: int, everybody: bool,
    road: RoadNumbers, av: AvNumbers, tables: NddTables, pairs: Pairs,
) -> int:  # fmt: skip
    """All BVs decide, everybody begins to act, the AV with `command` [m/s2] and target `lane`.

    `everybody`: somebody outside the kernels looks at the vehicles within the second, so all are kept current.

    Returns:
        Number of pairs that can touch within the second, for `move_on`.
    """
    decide_bvs(w, seed, test, bv_model, controlled_action, lane, road, av, tables)
    return begin_to_act(w, command, lane, everybody, road, av, pairs)


@inlined_kernel
def move_on(w: World, substep: int, pairs: Pairs, n_pairs: int, road: RoadNumbers, recording: NDArray[np.void]) -> bool:
    """Move to the end of a substep (0..9) of the second begun, look for contacts; True when the test ends with it."""
    info = w.info
    first_frame = SUBSTEPS * (info[N_DECISIONS] - 1)
    frame = first_frame + substep + 1
    record_frame(w, frame - 1, recording)
    _move(w, substep, road)
    ends = _check_contacts(w, pairs, n_pairs, frame, road)
    if not ends and w.vehicles[0].x >= road.av_start + road.test_length:
        info[OUTCOME] = COMPLETED
        info[FRAME] = frame
        ends = True
    if not ends and substep == SUBSTEPS - 1 and info[N_DECISIONS] >= road.max_decisions:
        info[OUTCOME] = TIME_UP
        info[FRAME] = frame
        ends = True
    if ends:
        record_frame(w, frame, recording)
    return ends


@kernel
def step_world(
    w: World, seed: int, test: int, bv_model: int, controlled_action: int, road: RoadNumbers, av: AvNumbers,
    tables: NddTables, pairs: Pairs, recording: NDArray[np.void],
) -> None:  # fmt: skip
    """Advance a running world by one decision (1 s, or less when the test ends); results are in `w.info`.

    Before the call info[CONTROLLED] names the BV that takes `controlled_action`, -1 for none. After a test that ends
    within the second only vehicles near the AV or in contact stand where they are then, unless it is recorded.
    """
    command, lane = built_in_av_decides(w, 0, road, av, pairs.av)
    recorded = recording.shape[0] > SUBSTEPS * w.info[N_DECISIONS]
    n_pairs = begin_second(w, seed, test, bv_model, controlled_action, command, lane, recorded, road, av, tables, pairs)
    for substep in range(SUBSTEPS):
        if substep > 0 and substep % road.av_substeps == 0:
            command, lane = built_in_av_decides(w, substep, road, av, pairs.av)
            av_acts(w, command, lane, road)
        if move_on(w, substep, pairs, n_pairs, road, recording):
            return
