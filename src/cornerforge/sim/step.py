"""Motion and contacts within a second, after all vehicles have decided; `loop.advance` calls it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import literal_unroll

from cornerforge._elementary import atan
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.fields import FRAME_FIELDS, SERIES
from cornerforge.geometry import Box, boxes_overlap, path_at
from cornerforge.road.straight import distance_left, go_along, go_further, lane_bits, lane_centre
from cornerforge.sim.actions import apply_action, hold, start_lane_change
from cornerforge.sim.reach import bound_motion, choose_current, find_pairs
from cornerforge.sim.setting import BUILT_IN
from cornerforge.sim.world import (
    AV_CRASH,
    BV_CRASH,
    COMPLETED,
    RUNNING,
    TIME_UP,
    all_current,
    forget_av_neighbours,
    list_all,
    path_of,
)
from cornerforge.types import ACCELERATIONS, FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "SUBSTEPS",
    "allocate_recording",
    "av_acts",
    "begin_to_act",
    "bring_up_to_date",
    "forget_frames",
    "go_on",
    "move_on",
    "move_vehicle",
    "record_frame",
]

SUBSTEPS = 10
_DT = FRAME_S
_FULL_STEERING_SPEED = 5.0
_SIXTH = 1.0 / 6.0
_ACCELERATIONS = ACCELERATIONS
_RECORDED = tuple(series.name for series in SERIES)
_HARDEST_BRAKING, _STRONGEST_ACCELERATION = 12.0, 10.0
"""Limits assumed for an AV that does not drive by its own law [m/s2]; commands from outside are cut to less."""


def allocate_recording(frames: int, slots: int) -> NDArray[np.void]:
    """Allocate a recording, (frames, slots) of `fields.FRAME_FIELDS`, all absent; 0 frames record nothing."""
    return np.zeros((frames, slots), dtype=FRAME_FIELDS)


@inlined_kernel
def _met_after(room: float, rate: float, growth: float) -> float:
    """Compute when a speed meets its limit [s].

    Args:
        room: From the speed to the limit [m/s], at least 0.
        rate: How fast the room shrinks [m/s2].
        growth: How fast that rate grows [m/s3].
    """
    root = math.sqrt(max(0.0, rate * rate + 2.0 * growth * room))
    return 2.0 * room / (root + rate) if rate > 0.0 else (root - rate) / growth


@inlined_kernel
def _way(start: float, a: float, jerk: float, time: float) -> float:
    return time * (start + time * (0.5 * a + _SIXTH * jerk * time))


@kernel
def _ramp(start: float, a: float, jerk: float, time: float, max_speed: float) -> tuple[float, float]:
    """Compute distance [m] and speed [m/s] after `time` [s] of a jerk [m/s3] from the acceleration `a` [m/s2] on.

    A vehicle that has come to a stand, or to its highest speed, stays there until its acceleration leads away from it.
    """
    gone = 0.0
    turn = -a / jerk
    if 0.0 < turn < time and not 0.0 <= start + 0.5 * a * turn <= max_speed:
        limit = 0.0 if a < 0.0 else max_speed
        until = _met_after(start, -a, -jerk) if a < 0.0 else _met_after(max_speed - start, a, jerk)
        gone = _way(start, a, jerk, until) + limit * (turn - until)
        start, a, time = limit, 0.0, time - turn
    after = start + time * (a + 0.5 * jerk * time)
    if 0.0 <= after <= max_speed:
        return gone + _way(start, a, jerk, time), after
    limit = 0.0 if after < 0.0 else max_speed
    until = _met_after(start, -a, -jerk) if after < 0.0 else _met_after(max_speed - start, a, jerk)
    return gone + (_way(start, a, jerk, until) + limit * (time - until)), limit


@inlined_kernel
def go_on(start: float, a: float, command: float, time: float, road: RoadNumbers) -> tuple[float, float, float, float]:
    """Compute how a vehicle drives on that goes from one acceleration to another at the ODD's jerk, and holds it.

    Speeds stay in [0, max_speed]: a vehicle that brakes stands when it has come to a stand, its highest speed likewise.

    Args:
        start: Its speed now [m/s], in [0, max_speed].
        a: Its acceleration now [m/s2].
        command: Where its acceleration goes [m/s2].
        time: From now on [s].
        road: Constants.

    Returns:
        Distance [m], in two parts to be added one by one; speed [m/s]; acceleration [m/s2]: without a limit of jerk the
        command, else 0 where the speed is at its limit.
    """
    gone = 0.0
    at_top = 0.0
    ramp = abs(command - a) * road.ramp_time
    now = command
    if ramp > 0.0:
        jerk = road.max_jerk if command > a else -road.max_jerk
        if time < ramp:
            now = a + jerk * time
        within = min(time, ramp)
        most = max(abs(a), abs(command)) * within
        if most <= start and start + most <= road.max_speed:  # no limit of speed is near: the rest is for few
            gone = _way(start, a, jerk, within)
            start = start + within * (a + 0.5 * jerk * within)
        else:
            gone, start = _ramp(start, a, jerk, within, road.max_speed)
        time -= within
    after = start + command * time
    if after < 0.0:
        gone += -0.5 * start * start / command
        after = 0.0
    elif after > road.max_speed:
        until = (road.max_speed - start) / command
        gone += 0.5 * (start + road.max_speed) * until
        at_top = road.max_speed * (time - until)
        after = road.max_speed
    else:
        gone += 0.5 * (start + after) * time
    if road.ramp_time > 0.0 and ((after == 0.0 and now < 0.0) or (after == road.max_speed and now > 0.0)):
        now = 0.0
    return gone, at_top, after, now


@inlined_kernel
def move_vehicle(v: NDArray[np.void], i: int, held: float, road: RoadNumbers) -> None:
    """Put vehicle i where it is `held` seconds after its last decision, and its lateral path 0.1 s further.

    Position and speed along the road are functions of `held`, not sums of substeps, so a vehicle that no other looks at
    within the second need not be moved within it (`go_on`). Below 5 m/s the lateral clock slows in proportion, so that
    a standing car cannot move sideways.
    """
    distance, at_top, after, now = go_on(v[i].speed_held, v[i].acceleration_held, v[i].commanded, held, road)
    go_along(v, i, distance)
    go_further(v, i, at_top)
    v[i].acceleration = now
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
    v[i].lanes = lane_bits(v[i].y, 0.5 * v[i].width, v[i].target_lane, road.lane_width)


@inlined_kernel
def _touch(w: World, a: int, b: int, road: RoadNumbers) -> bool:
    """Are both vehicles there, and do their boxes overlap?"""
    v = w.vehicles
    if v[a].present == 0 or v[b].present == 0:
        return False
    if road.one_size:  # two numbers instead of four look-ups: 3 % of all time
        return boxes_overlap(
            Box(v[a].x, v[a].y, v[a].heading, road.length, road.width),
            Box(v[b].x, v[b].y, v[b].heading, road.length, road.width),
        )
    return boxes_overlap(
        Box(v[a].x, v[a].y, v[a].heading, v[a].length, v[a].width),
        Box(v[b].x, v[b].y, v[b].heading, v[b].length, v[b].width),
    )


@kernel
def _drop_absent(w: World) -> None:
    """Remove absent vehicles from `w.current`."""
    kept = 0
    seen = 0
    for k in range(w.state[0].n_current):
        if w.vehicles[w.current[k]].present:
            w.current[kept] = w.current[k]
            kept += 1
            if k < w.state[0].n_seen:
                seen = kept
    w.state[0].n_current = kept
    w.state[0].n_seen = seen
    forget_av_neighbours(w)


@inlined_kernel
def _check_contacts(w: World, frame: int, road: RoadNumbers) -> bool:
    """Look for contacts at this frame; returns True when one ends the test.

    A crash of the AV comes before all others, then a crash of the controlled BV. Only if neither happens, BVs that
    crash into each other are counted and removed, so the last frame of a test that ends in a crash shows all vehicles.
    """
    state = w.state[0]
    for k in range(state.n_pairs):
        a = w.pair_a[k]
        b = w.pair_b[k]
        is_av = a == 0
        if not is_av and (state.outcome != RUNNING or (state.controlled != a and state.controlled != b)):
            continue
        if state.outcome != AV_CRASH and _touch(w, a, b, road):
            state.outcome = AV_CRASH if is_av else BV_CRASH
            state.slot_a = a
            state.slot_b = b
            state.frame = frame
    if state.outcome != RUNNING:
        if state.outcome == BV_CRASH:
            state.bv_crashes += 1
        return True
    removed = False
    for k in range(state.n_pairs):
        a = w.pair_a[k]
        b = w.pair_b[k]
        if a > 0 and _touch(w, a, b, road):
            state.bv_crashes += 1
            w.vehicles[a].present = 0
            w.vehicles[b].present = 0
            removed = True
    if removed:
        _drop_absent(w)
    return False


@inlined_kernel
def record_frame(w: World, frame: int, recording: NDArray[np.void]) -> None:
    """Write the present state as a frame; a recording with fewer frames stays as it is."""
    if frame >= recording.shape[0]:
        return
    v = w.vehicles
    for i in range(w.state[0].n_vehicles):
        if v[i].present:
            cell, vehicle = recording[frame, i], v[i]
            for name in literal_unroll(_RECORDED):
                cell[name] = vehicle[name]


@inlined_kernel
def av_acts(w: World, command: float, lane: int, road: RoadNumbers) -> None:
    """Let the AV go to an acceleration [m/s2] from now on, and begin a change to `lane` if that is another lane."""
    v = w.vehicles
    hold(v, 0, command, road)
    if lane != v[0].target_lane:
        start_lane_change(w, 0, lane, road)


@inlined_kernel
def _move(w: World, substep: int, road: RoadNumbers) -> None:
    """Move the vehicles that are kept current to the end of a substep; in the last substep all vehicles.

    What is known of the AV's neighbours still holds at the second's end, when the AV decides next.
    """
    v = w.vehicles
    if substep == SUBSTEPS - 1:
        list_all(w)
    move_vehicle(v, 0, (substep % road.av_substeps + 1) * _DT, road)
    held = (substep + 1) * _DT
    for k in range(1, w.state[0].n_current):
        move_vehicle(v, w.current[k], held, road)


@inlined_kernel
def begin_to_act(w: World, command: float, lane: int, everybody: bool, setting: Setting, s: Scratch) -> None:
    """Let all vehicles begin to act: BVs by their `action`, the AV with `command` [m/s2] and target `lane`.

    `w.order` must be sorted. `everybody`: keep all vehicles current, because a recording, a script, or a controller
    outside the kernels looks at them within the second.
    """
    v = w.vehicles
    road, av = setting.road, setting.av
    for i in range(1, w.state[0].n_vehicles):
        if v[i].present:
            apply_action(w, i, v[i].action, _ACCELERATIONS, road)
    av_acts(w, command, lane, road)
    by_its_law = setting.who.av == BUILT_IN
    braking = av.hardest_braking if by_its_law else _HARDEST_BRAKING
    acceleration = av.strongest_acceleration if by_its_law else _STRONGEST_ACCELERATION
    bound_motion(w, braking, acceleration, s)
    find_pairs(w, road, s)
    choose_current(w, s, everybody or av.sees_everybody != 0, road)
    w.state[0].decisions += 1


@inlined_kernel
def move_on(w: World, substep: int, road: RoadNumbers, recording: NDArray[np.void]) -> bool:
    """Move to the end of a substep (0..9) of the running second, look for contacts; True when the test ends there."""
    state = w.state[0]
    first_frame = SUBSTEPS * (state.decisions - 1)
    frame = first_frame + substep + 1
    record_frame(w, frame - 1, recording)
    _move(w, substep, road)
    ends = _check_contacts(w, frame, road)
    if not ends and distance_left(w.vehicles, 0, road) <= 0.0:
        state.outcome = COMPLETED
        state.frame = frame
        ends = True
    if not ends and substep == SUBSTEPS - 1 and state.decisions >= road.max_decisions:
        state.outcome = TIME_UP
        state.frame = frame
        ends = True
    if ends:
        record_frame(w, frame, recording)
    return ends


@kernel
def bring_up_to_date(w: World, road: RoadNumbers) -> None:
    """Bring every vehicle to the moment at which the test ended.

    `move_on` leaves vehicles that nobody can touch or see at their position from the start of the second.
    """
    state = w.state[0]
    substeps = state.frame - SUBSTEPS * (state.decisions - 1)
    for j in range(1, state.n_vehicles):
        if w.vehicles[j].present == 0:
            continue
        is_current = False
        for k in range(state.n_current):
            is_current = is_current or w.current[k] == j
        if not is_current:
            move_vehicle(w.vehicles, j, substeps * _DT, road)
    all_current(w)


@kernel
def forget_frames(recording: NDArray[np.void], frames: int, slots: int) -> None:
    """Mark all vehicles absent in the first frames of a recording; the next test then sees no trace of this one."""
    for f in range(min(frames, recording.shape[0])):
        for i in range(slots):
            recording[f, i].present = 0
