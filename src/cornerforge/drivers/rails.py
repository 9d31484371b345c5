"""Manoeuvres of other vehicles that do not depend on the driver behind them: places at every tenth of a second.

Columns of a pose, float64: X, Y of the box's centre [m], along and across the road, SPEED along it and LATERAL_SPEED
across it, to the left positive [m/s], HEADING [rad], ACCELERATION along the road [m/s2], LANE that the vehicle keeps or
goes to.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.types import FRAME_S

__all__ = [
    "ACCELERATION",
    "HEADING",
    "LANE",
    "LATERAL_GAIN",
    "LATERAL_SPEED",
    "POSE_NUMBERS",
    "SPEED",
    "X",
    "Y",
    "frames_before",
    "keeps_on",
    "move_aside",
    "slow_down",
    "way_before",
]

X, Y, SPEED, LATERAL_SPEED, HEADING, ACCELERATION, LANE = range(7)
POSE_NUMBERS = LANE + 1
LATERAL_GAIN = 1.5
"""Acceleration to a lateral speed before it is held [m/s2], as in the public implementation (Mattas et al. 2022)."""
_SLIVER = 1e-9
_DT = FRAME_S


@kernel
def frames_before(lateral_speed: float) -> int:
    """Count the frames in which a vehicle gains its lateral speed."""
    return int(np.floor(lateral_speed / LATERAL_GAIN / _DT + _SLIVER))


@kernel
def way_before(lateral_speed: float) -> float:
    """Compute how far a vehicle moves sideways while it gains its lateral speed [m]."""
    way = 0.0
    for k in range(frames_before(lateral_speed)):
        way += min(LATERAL_GAIN * _DT * (k + 1), lateral_speed) * _DT
    return way


@kernel
def keeps_on(poses: NDArray[np.float64], x: float, y: float, speed: float, lane: int) -> None:
    """Fill the poses (F, POSE_NUMBERS) of a vehicle that keeps its speed and its lane."""
    for f in range(poses.shape[0]):
        poses[f] = 0.0
        poses[f, X] = x + speed * _DT * f
        poses[f, Y] = y
        poses[f, SPEED] = speed
        poses[f, LANE] = lane


@kernel
def move_aside(poses: NDArray[np.float64], way: float, lateral_speed: float, lane: int) -> None:
    """Let a vehicle that keeps its lane begin, at frame 0, to move `way` [m] across the road into a lane.

    It gains its lateral speed, then holds it for the whole way, and stops sideways at once. It does not turn: its box
    stays parallel to the road.

    Args:
        poses: (F, POSE_NUMBERS), as `keeps_on` filled them.
        way: Lateral way, positive to the left [m].
        lateral_speed: Above 0 [m/s].
        lane: Where it ends.
    """
    before = frames_before(lateral_speed)
    until = before + int(np.floor(abs(way) / lateral_speed / _DT + _SLIVER)) + 1
    side = 1.0 if way > 0.0 else -1.0
    y = poses[0, Y]
    for f in range(poses.shape[0]):
        across = 0.0
        if f < before:
            across = min(LATERAL_GAIN * _DT * (f + 1), lateral_speed)
        elif f < until:
            across = lateral_speed
        poses[f, Y] = y
        poses[f, LATERAL_SPEED] = side * across
        poses[f, LANE] = lane
        y += side * across * _DT


@kernel
def slow_down(poses: NDArray[np.float64], braking: float, jerk: float) -> None:
    """Let a vehicle that keeps its speed begin, at frame 0, to brake to a stand.

    Args:
        poses: (F, POSE_NUMBERS), as `keeps_on` filled them.
        braking: Above 0 [m/s2].
        jerk: How fast its deceleration grows to that [m/s3].
    """
    x, speed = poses[0, X], poses[0, SPEED]
    built = 0.0
    for f in range(poses.shape[0]):
        poses[f, X] = x
        poses[f, SPEED] = speed
        poses[f, ACCELERATION] = -built if speed > 0.0 else 0.0
        built = min(built + jerk * _DT, braking)
        after = max(speed - built * _DT, 0.0)
        x += 0.5 * (speed + after) * _DT
        speed = after
