"""Motion for the search for a way out: a recording is continued after the contact, and the AV taken over at a moment.

`sim.motion.move_vehicle`, the simulator's own law, makes all motion here (docs/adr/0014-avoidability.md).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.counterfactual.braking import lateral_plan
from cornerforge.road.straight import lane_centre, lane_of
from cornerforge.sim import World, actions, allocate_worlds, motion, world_of
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.recordings import Trajectories
    from cornerforge.road.straight import RoadNumbers


__all__ = [
    "STRONGEST_ACCELERATION",
    "allocate_rows",
    "change_to",
    "continue_recording",
    "take_over",
    "take_over_av",
]

_DT = FRAME_S
_HARDEST = 20.0
STRONGEST_ACCELERATION = 10.0
"""Largest braking and acceleration of any vehicle [m/s2], in any recording: the time to stop depends on it."""
_PEAK = 10.0 / math.sqrt(3.0)
_SHORTEST = 0.5
_SAME_M = 1e-3
"""Positions across the road closer than this [m] are the same: more than rounding to 32 bits, less than matters."""


def allocate_rows(rows: int) -> World:
    """Allocate vehicles for the kernels of motion, (rows,), in a world in which nothing else is used."""
    return world_of(allocate_worlds(1, rows))


@kernel
def _retrace(w: World, row: int, frames: NDArray[np.void], frame: int, slot: int, road: RoadNumbers) -> bool:
    """Find the lateral path that a vehicle is on at a frame: plan all its lane changes up to there again.

    The lateral part of row `row` of `w` is written; its `change_time` is read. False if the path does not lead along
    the recorded positions: the recording may begin within a lane change, or another simulator may have made it.
    """
    v = w.vehicles
    first = frame
    while first > 0 and frames[first - 1, slot].present:
        first -= 1
    v[row].y = frames[first, slot].y
    v[row].target_lane = frames[first, slot].target_lane
    v[row].duration = 0.0
    v[row].clock = 0.0
    v[row].heading = 0.0
    v[row].lateral_speed = 0.0
    settled = abs(v[row].y - lane_centre(v[row].target_lane, road.lane_width)) <= _SAME_M
    for f in range(first, frame):
        lane = frames[f, slot].target_lane
        if lane != v[row].target_lane or (f == first and not settled):
            actions.start_lane_change(w, row, lane, road)
        v[row].x = 0.0
        v[row].speed = frames[f + 1, slot].speed  # the lateral clock goes by the speed at the end of a frame
        actions.hold(v, row, 0.0, road)
        motion.move_vehicle(v, row, 0.0, road)
        if abs(v[row].y - frames[f + 1, slot].y) > _SAME_M:
            return False
    if frames[frame, slot].target_lane != v[row].target_lane:
        actions.start_lane_change(w, row, frames[frame, slot].target_lane, road)
    return True


@kernel
def take_over(
    w: World, row: int, test: Trajectories, frame: int, slot: int, acceleration: float, road: RoadNumbers
) -> None:
    """Put a recorded vehicle, as it is at a frame, into a row of `w`; it goes on to an acceleration [m/s2].

    Across the road it follows the path that it is on: exactly if its recorded lane changes were planned as the
    simulator plans them, else by differences of its last positions (`braking.lateral_plan`).

    Args:
        w: From `allocate_rows`.
        row: The row to write.
        test: The recording.
        frame, slot: Moment and vehicle.
        acceleration: Acceleration that it approaches from its own, at the ODD's jerk [m/s2].
        road: Constants.
    """
    v = w.vehicles
    frames = test.frames
    v[row].change_time = test.bodies[slot].change_time
    if not _retrace(w, row, frames, frame, slot, road):
        path, duration = lateral_plan(frames, slot, frame, v[row].change_time, road)
        v[row].target_lane = frames[frame, slot].target_lane
        v[row].heading = frames[frame, slot].heading if duration > 0.0 else 0.0
        v[row].lateral_speed = path[1]
        v[row].c0, v[row].c1, v[row].c2, v[row].c3, v[row].c4, v[row].c5 = path
        v[row].clock = 0.0
        v[row].duration = duration
    v[row].x = frames[frame, slot].x
    v[row].y = frames[frame, slot].y
    v[row].speed = min(max(frames[frame, slot].speed, 0.0), road.max_speed)  # stored in 32 bits it may be a hair beyond
    v[row].acceleration = min(max(frames[frame, slot].acceleration, -_HARDEST), STRONGEST_ACCELERATION)
    actions.hold(v, row, acceleration, road)


@inlined_kernel
def change_to(w: World, row: int, lane: int, parts: int, evasive: RoadNumbers) -> None:
    """Let the AV of a row begin to move to the centre of lane `lane` of the road `evasive`.

    An AV that steers, with lanes that are parts of lanes, takes as long as the way needs at the largest lateral
    acceleration: a path from rest to rest over a way w within T has the peak 10 / sqrt(3) w / T^2.
    """
    if parts > 1:
        way = abs(lane_centre(lane, evasive.lane_width) - w.vehicles[row].y)
        needed = math.sqrt(_PEAK * way / evasive.max_lateral_acceleration)
        w.vehicles[row].change_time = max(_SHORTEST, needed)
    actions.start_lane_change(w, row, lane, evasive)


@kernel
def take_over_av(
    w: World, row: int, test: Trajectories, frame: int, parts: int, road: RoadNumbers, evasive: RoadNumbers
) -> None:
    """Put the AV, as it is at a frame before the last, into a row of `w`, ready for decisions on the road `evasive`.

    An AV that orders lanes goes on along its lane change. One that steers has no lane change: it comes to rest at the
    nearest of its places that is ahead of it across the road.

    Args:
        w: From `allocate_rows`.
        row: The row to write.
        test: The recording.
        frame: The moment.
        parts: Places in a lane at which the AV may drive: 1, or 3 for one that steers; `evasive` has so many times as
            many lanes, each so much narrower.
        road, evasive: Constants of the recording; constants of the AV's decisions.
    """
    take_over(w, row, test, frame, 0, 0.0, road)
    v = w.vehicles
    v[row].change_time = evasive.lane_change_duration
    if parts == 1:
        return
    frames = test.frames
    before = max(frame - 1, 0)
    now, y0, y2 = frames[frame, 0].y, frames[before, 0].y, frames[frame + 1, 0].y
    across = (y2 - y0) / ((frame + 1 - before) * _DT)
    bent = (y2 - 2.0 * now + y0) / (_DT * _DT) if before < frame else 0.0
    v[row].y = now
    v[row].c0, v[row].c1, v[row].c2, v[row].c3, v[row].c4, v[row].c5 = now, across, 0.5 * bent, 0.0, 0.0, 0.0
    v[row].lateral_speed = across
    v[row].heading = frames[frame, 0].heading
    v[row].clock = 0.0
    v[row].duration = 1.0
    rest = now + across * abs(across) / (2.0 * evasive.max_lateral_acceleration)
    lane = min(max(lane_of(rest, evasive.lane_width), 0), evasive.n_lanes - 1)
    change_to(w, row, lane, parts, evasive)


@kernel
def continue_recording(
    test: Trajectories,
    last: int,
    until: int,
    partner: int,
    only_partner: int,
    road: RoadNumbers,
    w: World,
) -> None:
    """Write the motion of the other vehicles after the contact into the frames last + 1 .. until; none reacts.

    Each completes its running lane change and keeps its speed; the partner brakes on if it braked. The AV and vehicles
    absent at the contact are absent.

    Args:
        test: Recording with at least until + 1 frames.
        last: Frame of the contact.
        until: Last frame to write.
        partner: Slot that the AV touched.
        only_partner: 1: all vehicles except the partner vanish after the contact, as for the reward `avoidable`.
        road: Constants.
        w: Scratch, one row at least.
    """
    v = w.vehicles
    frames = test.frames
    for j in range(test.n):
        there = j > 0 and frames[last, j].present != 0 and (only_partner == 0 or j == partner)
        if there:
            braking = min(frames[last, j].acceleration, 0.0) if j == partner else 0.0
            take_over(w, 0, test, last, j, braking, road)
        for f in range(last + 1, until + 1):
            frames[f, j].present = 1 if there else 0
            if there:
                motion.move_vehicle(v, 0, (f - last) * _DT, road)
                frames[f, j].x = v[0].x
                frames[f, j].y = v[0].y
                frames[f, j].speed = v[0].speed
                frames[f, j].heading = v[0].heading
                frames[f, j].acceleration = v[0].acceleration
                frames[f, j].target_lane = v[0].target_lane
