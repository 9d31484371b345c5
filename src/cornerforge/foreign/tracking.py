"""How an AV follows a trajectory that it planned: the law of tracking, and the controls that come of it.

The trajectory is a list of timed poses of the box's centre; between them it is a cubic in time (Hermite), so the
vehicle has a place, a velocity and an acceleration to aim at, at any time. The rear axle, b behind the centre, has to
be where the centre was b / v before. At each tenth of a second the errors are taken, and

    curvature = that of the trajectory - 2 w sin(e_h) / v - w^2 e_y / v^2,     w = 5 /s
    acceleration = that of the trajectory + 2 k (v_t - v) + k^2 e_x,           k = 2 /s

where e_h is the error of the heading, e_y how far the rear axle is left of the trajectory, e_x how far the centre is
behind it, and v is at least 3 m/s. So small errors die out as of a critically damped oscillator (Samson 1992; Kanayama
et al. 1990 have the same terms). What the trajectory does is taken in the middle of the step. The vehicle then moves by
`bicycle.roll`, with its limits: a trajectory that no car can follow is followed as far as a car can.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cornerforge._elementary import atan, sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim import av_scene, bicycle
from cornerforge.types import FRAME_S, HIGHEST_COMMAND, LOWEST_COMMAND

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers

__all__ = ["POSE_COLUMNS", "bend", "follow", "place_at", "track", "wheelbase"]

POSE_COLUMNS = 5
"""Columns of a trajectory: time from now [s], x [m], y [m], heading [rad], speed [m/s]; the last two may be NaN."""
_LATERAL, _ALONG = 5.0, 2.0
_SLOWEST = 3.0
_STEEPEST = 1.4
_STANDS = 0.5
_DT = FRAME_S


@kernel
def wheelbase(length: float) -> float:
    """Distance of the axles [m] of a vehicle of a length [m]."""
    distance: float = bicycle.wheelbase_of(length)
    return distance


@kernel
def bend(answers: NDArray[np.float64], length: float) -> None:
    """Turn front wheels' angles into curvatures, tan(angle) / wheelbase, in column 1 of answers (B, 2).

    Args:
        answers: Accelerations, and angles [rad]; an angle beyond 1.4 rad becomes NaN.
        length: Of the vehicle [m].
    """
    for b in range(answers.shape[0]):
        angle = answers[b, 1]
        answers[b, 1] = math.nan
        if abs(angle) < _STEEPEST:
            sine, cosine = sin_cos(angle)
            answers[b, 1] = sine / (cosine * bicycle.wheelbase_of(length))


@inlined_kernel
def _slope(plan: NDArray[np.float64], j: int, n: int, axis: int) -> float:
    """Estimate the velocity along an axis (1: x, 2: y) at pose j of n, by the polynomial through four poses there.

    Through all poses if there are fewer. Divided differences, after Newton.
    """
    k = min(max(j - 1, 0), max(n - 4, 0))
    now, a, b = plan[j, 0], plan[k, 0], plan[k + 1, 0]
    ab = (plan[k + 1, axis] - plan[k, axis]) / (b - a)
    slope: float = ab
    if n > 2:
        c = plan[k + 2, 0]
        bc = (plan[k + 2, axis] - plan[k + 1, axis]) / (c - b)
        abc = (bc - ab) / (c - a)
        slope += abc * ((now - a) + (now - b))
        if n > 3:
            d = plan[k + 3, 0]
            cd = (plan[k + 3, axis] - plan[k + 2, axis]) / (d - c)
            abcd = ((cd - bc) / (d - b) - abc) / (d - a)
            slope += abcd * ((now - b) * (now - c) + (now - a) * (now - c) + (now - a) * (now - b))
    return slope


@inlined_kernel
def _velocity(plan: NDArray[np.float64], j: int, n: int) -> tuple[float, float]:
    """Velocity along x and y at pose j of n [m/s]: as stated, else estimated."""
    if abs(plan[j, 3]) < math.inf and abs(plan[j, 4]) < math.inf:  # neither is NaN
        sine, cosine = sin_cos(plan[j, 3])
        return plan[j, 4] * cosine, plan[j, 4] * sine
    return _slope(plan, j, n, 1), _slope(plan, j, n, 2)


@inlined_kernel
def _cubic(p0: float, v0: float, p1: float, v1: float, h: float, t: float) -> tuple[float, float, float]:
    """Evaluate the cubic with given places and velocities at its ends, h apart, at t: place, velocity, acceleration."""
    mean = (p1 - p0) / h
    a = (3.0 * mean - 2.0 * v0 - v1) / h
    b = (v0 + v1 - 2.0 * mean) / (h * h)
    return p0 + t * (v0 + t * (a + t * b)), v0 + t * (2.0 * a + 3.0 * t * b), 2.0 * a + 6.0 * t * b


@kernel
def place_at(plan: NDArray[np.float64], n: int, t: float) -> tuple[float, float, float, float, float, float]:
    """Evaluate a trajectory at a time.

    Args:
        plan: Poses, (M, POSE_COLUMNS), times ascending.
        n: How many of them there are, at least 2.
        t: Time from now [s]; before the first pose its first cubic goes on, after the last one it goes straight on.

    Returns:
        x, y [m]; velocity along both [m/s]; acceleration along both [m/s2].
    """
    j = 0
    while j < n - 2 and t >= plan[j + 1, 0]:
        j += 1
    vx, vy = _velocity(plan, j, n)
    ux, uy = _velocity(plan, j + 1, n)
    if t > plan[n - 1, 0]:
        since = t - plan[n - 1, 0]
        return plan[n - 1, 1] + since * ux, plan[n - 1, 2] + since * uy, ux, uy, 0.0, 0.0
    h, since = plan[j + 1, 0] - plan[j, 0], t - plan[j, 0]
    x, wx, ax = _cubic(plan[j, 1], vx, plan[j + 1, 1], ux, h, since)
    y, wy, ay = _cubic(plan[j, 2], vy, plan[j + 1, 2], uy, h, since)
    return x, y, wx, wy, ax, ay


@inlined_kernel
def _control(plan: NDArray[np.float64], n: int, t: float, m: bicycle.Motion, length: float) -> tuple[float, float]:
    """Choose acceleration [m/s2] and curvature [1/m] for the step that begins at time t, by the law of tracking."""
    ahead, y, heading, speed = m.ahead, m.y, m.heading, m.speed
    behind = bicycle.rear_axle_behind(length)
    v = max(speed, _SLOWEST)
    late = behind / v
    px, py, vx, vy, _, _ = place_at(plan, n, t)
    sine, cosine = sin_cos(atan(vy / vx) if vx > _STANDS else heading)
    lacks = cosine * (px - ahead) + sine * (py - y)
    wanted = vx * cosine + vy * sine
    _, _, mx, my, ax, ay = place_at(plan, n, t + 0.5 * _DT)
    swift = math.sqrt(mx * mx + my * my)
    push = (mx * ax + my * ay) / swift if swift > _STANDS else 0.0
    acceleration = push + 2.0 * _ALONG * (wanted - speed) + _ALONG * _ALONG * lacks
    rx, ry, vx, vy, _, _ = place_at(plan, n, t - late)
    course = atan(vy / vx) if vx > _STANDS else heading
    sine, cosine = sin_cos(course)
    own_sine, own_cosine = sin_cos(heading)
    left = cosine * (y - behind * own_sine - ry) - sine * (ahead - behind * own_cosine - rx)
    bent = (mx * ay - my * ax) / (swift * swift * swift) if swift > _STANDS else 0.0
    turned = sin_cos(heading - course)[0]
    curvature = bent - 2.0 * _LATERAL * turned / v - _LATERAL * _LATERAL * left / (v * v)
    return min(max(acceleration, LOWEST_COMMAND), HIGHEST_COMMAND), curvature


@kernel
def track(
    own: NDArray[np.float64], plan: NDArray[np.float64], n: int, road: RoadNumbers, controls: NDArray[np.float64]
) -> None:
    """Follow a trajectory until the AV answers again.

    Args:
        own: Row 0 of the AV's scene, (SCENE_COLUMNS,).
        plan: Poses, (M, POSE_COLUMNS), in the scene's coordinates; times from now [s], ascending.
        n: How many of them there are, at least 2.
        road: Constants.
        controls: Receives an acceleration [m/s2] and a curvature [1/m] for each tenth of a second (`loop.steer_as_av`).
    """
    length = own[av_scene.LENGTH]
    sine, cosine = sin_cos(own[av_scene.HEADING])
    speed = min(max(own[av_scene.VX] * cosine + own[av_scene.VY] * sine, 0.0), road.max_speed)
    m = bicycle.Motion(
        own[av_scene.X], own[av_scene.Y], own[av_scene.HEADING], speed, own[av_scene.AX], own[av_scene.CURVATURE]
    )
    for k in range(controls.size // 2):
        command, wish = _control(plan, n, k * _DT, m, length)
        controls[2 * k] = command
        controls[2 * k + 1] = wish
        m = bicycle.roll(m, command, wish, length, road)


@kernel
def follow(
    scenes: NDArray[np.float64], plans: NDArray[np.float64], poses: NDArray[np.int64], road: RoadNumbers,
    controls: NDArray[np.float64],
) -> None:  # fmt: skip
    """Let the AVs of B worlds follow their trajectories (`track`): plans (B, M, 5), poses (B,) in use, 0 for none."""
    for b in range(poses.size):
        if poses[b] >= 2:
            track(scenes[b, 0], plans[b], poses[b], road, controls[b])
