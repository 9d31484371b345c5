"""Effects of a decision on a vehicle: the acceleration that it holds, the lateral path that it begins."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.geometry import path_at, plan_path
from cornerforge.road.lanes import hurry, may_change, side_to_leave
from cornerforge.road.straight import begin_along, lane_centre
from cornerforge.sim.braking import acceleration_of, last_to_stop
from cornerforge.sim.merging import suitable_accelerations
from cornerforge.sim.motion import path_of
from cornerforge.sim.neighbours import rank_of
from cornerforge.types import (
    ACCELERATION_STEP,
    ACCELERATIONS,
    ACTION_SIDES,
    FIRST_ACCELERATION,
    FRAME_S,
    LOWEST_COMMAND,
    N_ACCELERATIONS,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
from cornerforge.sim.world import World

__all__ = [
    "apply_action",
    "hold",
    "hold_from",
    "nearest_action",
    "ordered_lane",
    "start_lane_change",
]

_HARDEST = float(ACCELERATIONS[0])
_SIXTH = 1.0 / 6.0
_PLACES_PER_MPS2 = round(1.0 / ACCELERATION_STEP)


@kernel
def start_lane_change(w: World, i: int, target_lane: int, road: RoadNumbers) -> None:
    """Plan the lateral path of slot i from where it is to the centre of `target_lane`, in its own `change_time`.

    A driver that must leave its lane hurries, the more the sooner it must, and sets the indicator.
    """
    v = w.vehicles
    acceleration = 0.0
    speed = 0.0
    time = v[i].change_time * hurry(v, i, road)
    if v[i].duration > 0.0:
        _, speed, acceleration = path_at(path_of(v, i), v[i].clock)
    if road.lanes.varied and side_to_leave(v, i, road)[1] > 0.0:
        v[i].signals |= 1
    v[i].target_lane = target_lane
    v[i].clock = 0.0
    path, duration = plan_path(
        v[i].y,
        speed,
        acceleration,
        lane_centre(target_lane, road.lane_width),
        time,
        road.max_lateral_acceleration,
    )
    v[i].duration = duration
    v[i].c0, v[i].c1, v[i].c2, v[i].c3, v[i].c4, v[i].c5 = path
    v[i].lanes |= 1 << target_lane


@inlined_kernel
def hold(v: NDArray[np.void], i: int, acceleration: float, road: RoadNumbers) -> None:
    """Let vehicle i go to an acceleration [m/s2] from now on, at the ODD's jerk, and hold it."""
    begin_along(v, i, hold_from(v, i, acceleration, road))


@inlined_kernel
def hold_from(v: NDArray[np.void], i: int, acceleration: float, road: RoadNumbers) -> float:
    """Let vehicle i go to an acceleration, as `hold`; return how far ahead of it that would have begun [m].

    A ramp that is over within a substep, away from the limits of speed, is put into the place and the speed that the
    held acceleration would have begun with: from the ramp's end on the motion is the same, and nothing reads it
    earlier.
    """
    v[i].commanded = acceleration
    if road.ramp_time == 0.0:
        v[i].acceleration = acceleration
    now = v[i].acceleration
    change = acceleration - now
    ramp = abs(change) * road.ramp_time
    most = max(abs(now), abs(acceleration)) * ramp
    speed = v[i].speed
    if ramp <= FRAME_S and most <= speed and speed + most <= road.max_speed:
        v[i].acceleration_held = acceleration
        v[i].speed_held = speed - 0.5 * change * ramp
        further: float = _SIXTH * change * ramp * ramp
        return further
    v[i].acceleration_held = now
    v[i].speed_held = speed
    return 0.0


@inlined_kernel
def ordered_lane(w: World, i: int, side: int, road: RoadNumbers) -> int:
    """Find the target lane of slot i after a lane order: 1 left, 0 keep, -1 right.

    While a lane change runs, an order against it returns to the lane that the vehicle came from; an order in its
    direction changes nothing. An order that would leave the road is not carried out.
    """
    v = w.vehicles
    lane: int = v[i].target_lane
    if side == 0:
        return lane
    if v[i].duration > 0.0:
        running = 1 if v[i].c0 < lane_centre(lane, road.lane_width) else -1
        if running == side:
            return lane
    return lane + side if may_change(v, i, lane + side, road) else lane


@inlined_kernel
def nearest_action(acceleration: float) -> int:
    """Index of the action with the acceleration nearest to a wish [m/s2]; of two equally near the larger."""
    place = math.floor((acceleration - _HARDEST) * _PLACES_PER_MPS2 + 0.5)
    return FIRST_ACCELERATION + max(0, min(N_ACCELERATIONS - 1, place))


@inlined_kernel
def apply_action(w: World, i: int, action: int, accelerations: NDArray[np.float64], road: RoadNumbers) -> None:
    """Carry out an action for slot i: an acceleration, or a lane change (see `ordered_lane`), which holds the speed.

    Where traffic stops it brakes meanwhile if it must.
    """
    v = w.vehicles
    if action >= FIRST_ACCELERATION:
        hold(v, i, acceleration_of(w, i, action, accelerations, road), road)
        return
    target = ordered_lane(w, i, ACTION_SIDES[action], road)
    if target != v[i].target_lane:
        start_lane_change(w, i, target, road)
    command = 0.0
    if road.stops:
        command = max(
            LOWEST_COMMAND, min(0.0, suitable_accelerations(w, i, rank_of(w, i), last_to_stop(w, road), road)[1])
        )
    hold(v, i, command, road)
