"""Motion and contacts within a second, after all vehicles have decided; `loop.advance` calls it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel, shared_kernel
from cornerforge.fields import FRAME_FIELDS
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.road.lanes import has_lane, has_left
from cornerforge.road.straight import distance_left
from cornerforge.sim.actions import apply_action, hold, hold_from, start_lane_change
from cornerforge.sim.bicycle import steer_on
from cornerforge.sim.controllers import BUILT_IN, RAILS, RECORDED
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.outcome import AV_CRASH, BV_CRASH, COMPLETED, LEFT_ROAD, RUNNING, TIME_UP
from cornerforge.sim.rails import ride
from cornerforge.sim.reach import bound_motion, choose_current, find_pairs, pairs_of_av
from cornerforge.sim.site.choice import act_at_site
from cornerforge.sim.site.second import ends_at_site, find_pairs_at_site, move_agent
from cornerforge.sim.world import all_current, forget_av_neighbours, list_all
from cornerforge.site.tables import at_site
from cornerforge.types import ACCELERATIONS, FRAME_S, LOWEST_COMMAND, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "allocate_recording",
    "av_acts",
    "begin_to_act",
    "bring_up_to_date",
    "forget_frames",
    "move_on",
    "record_frame",
]

_DT = FRAME_S
_ACCELERATIONS = ACCELERATIONS
_HARDEST_BRAKING, _STRONGEST_ACCELERATION = 12.0, 10.0
"""Limits assumed for an AV that does not drive by its own law [m/s2]; commands from outside are cut to less."""


def allocate_recording(frames: int, slots: int) -> NDArray[np.void]:
    """Allocate a recording, (frames, slots) of `fields.FRAME_FIELDS`, all absent; 0 frames record nothing."""
    return np.zeros((frames, slots), dtype=FRAME_FIELDS)


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
        a = w.pairs[k, 0]
        b = w.pairs[k, 1]
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
        a = w.pairs[k, 0]
        b = w.pairs[k, 1]
        if a > 0 and _touch(w, a, b, road):
            state.bv_crashes += 1
            w.vehicles[a].present = 0
            w.vehicles[b].present = 0
            removed = True
    if removed:
        _drop_absent(w)
    return False


@kernel
def _check_lanes(w: World, frame: int, all_there: bool, road: RoadNumbers) -> bool:
    """Look for vehicles whose lane has ended; returns True when the AV is one.

    BVs of the exit, and a BV whose lane came to an end all the same, leave the world at a second's end (`all_there`:
    all vehicles are where they are now). An AV that took the exit as it should has completed its drive.
    """
    v, state = w.vehicles, w.state[0]
    if has_left(v, 0, road):
        state.outcome = COMPLETED if road.av_exits else LEFT_ROAD
        state.frame = frame
        return True
    removed = False
    for i in range(1, state.n_vehicles if all_there else 0):
        if v[i].present and has_left(v, i, road):
            v[i].present = 0
            removed = True
    if removed:
        _drop_absent(w)
    return False


@inlined_kernel
def record_frame(w: World, frame: int, recording: NDArray[np.void]) -> None:
    """Write the present state as a frame, all of `fields.SERIES`; a recording with fewer frames stays as it is."""
    if frame >= recording.shape[0]:
        return
    v = w.vehicles
    for i in range(w.state[0].n_vehicles):
        if v[i].present:
            cell, vehicle = recording[frame, i], v[i]
            cell.x = vehicle.x
            cell.y = vehicle.y
            cell.speed = vehicle.speed
            cell.heading = vehicle.heading
            cell.acceleration = vehicle.acceleration
            cell.target_lane = vehicle.target_lane
            cell.present = vehicle.present


@inlined_kernel
def av_acts(w: World, command: float, lane: int, road: RoadNumbers) -> None:
    """Let the AV go to an acceleration [m/s2] from now on, and begin a change to `lane` if that is another lane.

    An AV that steers does what its answer says step by step (`bicycle.steer_on`).
    """
    v = w.vehicles
    if w.av[0].steers:
        v[0].commanded = command
        return
    if at_site(road.site):
        v[0].x_held = w.agents[0].s + hold_from(v, 0, max(LOWEST_COMMAND, command), road)
        return
    hold(v, 0, command, road)
    if lane != v[0].target_lane and (not road.lanes.varied or has_lane(lane, v[0].x, road)):
        start_lane_change(w, 0, lane, road)


@shared_kernel
def _move_at_site(w: World, substep: int, road: RoadNumbers) -> None:
    """Move all agents to the end of a substep."""
    move_agent(w, 0, (substep % road.av_substeps + 1) * _DT, road)
    for k in range(w.state[0].n_current):
        if w.current[k] > 0:
            move_agent(w, w.current[k], (substep + 1) * _DT, road)


@inlined_kernel
def _move(w: World, substep: int, setting: Setting) -> None:
    """Move the vehicles that are kept current to the end of a substep; in the last substep all vehicles.

    What is known of the AV's neighbours still holds at the second's end, when the AV decides next.
    """
    v = w.vehicles
    state = w.state[0]
    road = setting.road
    if at_site(road.site):
        _move_at_site(w, substep, road)
        return
    if substep == SUBSTEPS - 1:
        list_all(w)
    since = substep % road.av_substeps
    if setting.who.av == RECORDED:
        pass
    elif w.av[0].steers:
        steer_on(w, w.av[0].controls[2 * since], w.av[0].controls[2 * since + 1], road)
    else:
        move_vehicle(v, 0, (since + 1) * _DT, road)
    if setting.who.others == RAILS:
        first = 0 if setting.who.av == RECORDED else 1
        ride(w, SUBSTEPS * (state.decisions - 1) + substep + 1, setting.who.rails, road, first)
        return
    held = (substep + 1) * _DT
    for k in range(1, state.n_current):
        move_vehicle(v, w.current[k], held, road)


@shared_kernel
def _begin_at_site(w: World, command: float, setting: Setting) -> None:
    """Let all agents begin to act, and the AV with `command` [m/s2]."""
    for k in range(w.state[0].n_current):
        i = w.current[k]
        if i > 0:
            act_at_site(w, i, w.vehicles[i].action, setting.road)
    av_acts(w, command, w.vehicles[0].target_lane, setting.road)
    find_pairs_at_site(w)
    w.state[0].decisions += 1


@inlined_kernel
def begin_to_act(w: World, command: float, lane: int, everybody: bool, setting: Setting, s: Scratch) -> None:
    """Let all vehicles begin to act: BVs by their `action`, the AV with `command` [m/s2] and target `lane`.

    `w.order` must be sorted. `everybody`: keep all vehicles current, because a recording, a script, rails or a
    controller outside the kernels looks at them within the second.
    """
    v = w.vehicles
    road, av = setting.road, setting.av
    on_rails = setting.who.others == RAILS
    if at_site(road.site):
        _begin_at_site(w, command, setting)
        return
    for i in range(1, w.state[0].n_vehicles):
        if v[i].present and not on_rails:
            apply_action(w, i, v[i].action, _ACCELERATIONS, road)
    av_acts(w, command, lane, road)
    by_its_law = setting.who.av == BUILT_IN
    braking = av.hardest_braking if by_its_law else _HARDEST_BRAKING
    acceleration = av.strongest_acceleration if by_its_law else _STRONGEST_ACCELERATION
    if on_rails:
        pairs_of_av(w)
    else:
        bound_motion(w, braking, acceleration, s)
        find_pairs(w, road, s)
    choose_current(w, s, everybody or av.sees_everybody != 0 or road.perception.on, road)
    w.state[0].decisions += 1


@inlined_kernel
def move_on(w: World, substep: int, setting: Setting, recording: NDArray[np.void]) -> bool:
    """Move to the end of a substep (0..9) of the running second, look for contacts; True when the test ends there."""
    state = w.state[0]
    road = setting.road
    first_frame = SUBSTEPS * (state.decisions - 1)
    frame = first_frame + substep + 1
    record_frame(w, frame - 1, recording)
    _move(w, substep, setting)
    ends = _check_contacts(w, frame, road)
    if road.lanes.varied and not ends:
        ends = _check_lanes(w, frame, substep == SUBSTEPS - 1, road)
    if at_site(road.site):
        if not ends:
            ends = ends_at_site(w, frame, substep == SUBSTEPS - 1, road.site)
    elif not ends and distance_left(w.vehicles, 0, road) <= 0.0:
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

    `move_on` leaves vehicles that no other can touch or see at their position from the start of the second.
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
