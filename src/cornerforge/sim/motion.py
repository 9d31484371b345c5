"""Motion of one vehicle from one decision to the next: along the road by its acceleration, across it by its path.

An AV that steers moves otherwise (`bicycle`), along its way by the same law (`go_on`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cornerforge._elementary import atan
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.geometry import path_at
from cornerforge.road.straight import go_along, go_further, lane_bits, lane_centre
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.geometry import Path
    from cornerforge.road.straight import RoadNumbers

__all__ = ["go_on", "move_vehicle", "path_of"]

_DT = FRAME_S
_FULL_STEERING_SPEED = 5.0
_SIXTH = 1.0 / 6.0


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

    Speeds stay in [0, max_speed]: a vehicle that brakes stays at 0, one that accelerates at its highest speed.

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
def path_of(v: NDArray[np.void], i: int) -> Path:
    """Take the coefficients of vehicle i's lateral path."""
    return v[i].c0, v[i].c1, v[i].c2, v[i].c3, v[i].c4, v[i].c5
