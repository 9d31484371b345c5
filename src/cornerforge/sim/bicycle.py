"""Motion of an AV that steers: the kinematic bicycle, a tenth of a second at a time, within a car's limits.

The middle of the rear axle moves where the vehicle points; the front wheels' angle d gives the curvature of its way,
tan(d) / wheelbase. Within a step the curvature is constant, so the rear axle moves on an arc of a circle; the speed
goes as for every vehicle (`motion.go_on`): the acceleration follows its command at the ODD's jerk.

Cut to what a car can do on dry asphalt: curvature 0.2 /m; lateral acceleration 8 m/s2, as much as it brakes; front
wheels turn by 0.7 rad/s. The heading stays within 0.8 rad of the road's direction: the wheels are held there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.road.straight import RoadNumbers, begin_along, go_along, lane_bits, lane_centre, lane_of
from cornerforge.sim.motion import go_on
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from cornerforge.sim.world import World

__all__ = [
    "HARDEST_TURN",
    "LARGEST_HEADING",
    "MOST_LATERAL_ACCELERATION",
    "STEERING_RATE",
    "Motion",
    "rear_axle_behind",
    "roll",
    "steer_on",
    "wheelbase_of",
]

HARDEST_TURN = 0.2
"""Largest curvature [1/m]: a turning circle of 10 m, as cars have."""
MOST_LATERAL_ACCELERATION = 8.0
"""Largest lateral acceleration of an AV that steers [m/s2]."""
STEERING_RATE = 0.7
"""How fast its front wheels turn [rad/s]: 10 rad/s at a steering wheel geared 15 to 1."""
LARGEST_HEADING = 0.8
"""Largest angle to the road [rad]."""
_WHEELBASE_SHARE = 0.6
_STANDARD_OFFSET = 0.375
_MOVES_ACROSS = 0.1
_DT = FRAME_S


@inlined_kernel
def wheelbase_of(length: float) -> float:
    """Distance of the axles [m] of a vehicle of a length [m]; the box's centre is halfway between them."""
    return _WHEELBASE_SHARE * length


@inlined_kernel
def rear_axle_behind(length: float) -> float:
    """Compute how far the rear axle is behind the box's centre [m]."""
    return 0.5 * _WHEELBASE_SHARE * length


class Motion(NamedTuple):
    """How a vehicle that steers moves.

    Attributes:
        ahead, y, heading: Pose of its box's centre: along the road from anywhere [m], across it [m], [rad].
        speed: Speed of its rear axle, where it points [m/s], in [0, max_speed].
        acceleration: Acceleration of the rear axle too [m/s2].
        curvature: Curvature of its way now, positive to the left [1/m].
    """

    ahead: float
    y: float
    heading: float
    speed: float
    acceleration: float
    curvature: float


@kernel
def roll(m: Motion, command: float, wish: float, length: float, road: RoadNumbers) -> Motion:
    """Drive a vehicle that steers for a tenth of a second.

    Args:
        m: Its motion before.
        command: Acceleration to which it goes [m/s2].
        wish: Curvature that it wants, to which it goes within its limits [1/m].
        length: Length of the vehicle [m].
        road: Constants.

    Returns:
        Its motion after.
    """
    heading, speed = m.heading, m.speed
    behind = rear_axle_behind(length)
    step = STEERING_RATE * _DT / wheelbase_of(length)
    turned = min(max(wish, m.curvature - step), m.curvature + step)
    most = HARDEST_TURN
    if most * speed * speed > MOST_LATERAL_ACCELERATION:
        most = MOST_LATERAL_ACCELERATION / (speed * speed)
    turned = min(max(turned, -most), most)
    gone, at_top, after, now = go_on(speed, m.acceleration, command, _DT, road)
    way = gone + at_top
    angle = turned * way
    if heading + angle > LARGEST_HEADING:
        angle = max(0.0, LARGEST_HEADING - heading)
    elif heading + angle < -LARGEST_HEADING:
        angle = min(0.0, -LARGEST_HEADING - heading)
    if way > 0.0:
        turned = angle / way
    half = 0.5 * angle
    chord = way * (1.0 - half * half / 6.0) if abs(half) < 1e-4 else way * sin_cos(half)[0] / half
    sine, cosine = sin_cos(heading)
    across, along = sin_cos(heading + half)
    sine_after, cosine_after = sin_cos(heading + angle)
    ahead = m.ahead + (chord * along + behind * (cosine_after - cosine))
    y = m.y + (chord * across + behind * (sine_after - sine))
    return Motion(ahead, y, heading + angle, after, now, turned)


@inlined_kernel
def _show_course(w: World, lateral_acceleration: float, road: RoadNumbers) -> None:
    """Note what others see of the lanes of an AV that steers: it has no plan that they could know, only its motion.

    It enters the next lane when it moves towards it and its body is over the line, or its centre is 0.375 m off the
    centre of its lane.
    """
    v = w.vehicles
    y, width = v[0].y, road.lane_width
    own = min(max(lane_of(y, width), 0), road.n_lanes - 1)
    side = 0
    if v[0].lateral_speed > _MOVES_ACROSS:
        side = 1
    elif v[0].lateral_speed < -_MOVES_ACROSS:
        side = -1
    off = y - lane_centre(own, width)
    lane = own
    if side != 0 and (lane_of(y + side * 0.5 * v[0].width, width) != own or side * off >= _STANDARD_OFFSET):
        lane = min(max(own + side, 0), road.n_lanes - 1)
    changes = lane != own or (side != 0 and abs(off) >= _STANDARD_OFFSET)
    v[0].target_lane = lane
    v[0].duration = 1.0 if changes else 0.0
    v[0].clock = 0.0
    v[0].c0 = y
    v[0].c1 = v[0].lateral_speed
    v[0].c2 = 0.5 * lateral_acceleration
    v[0].c3 = 0.0
    v[0].c4 = 0.0
    v[0].c5 = 0.0
    v[0].lanes = lane_bits(y, 0.5 * v[0].width, lane, width) & ((1 << road.n_lanes) - 1)


@kernel
def steer_on(w: World, command: float, wish: float, road: RoadNumbers) -> None:
    """Move the AV, which steers, on by a tenth of a second, to an acceleration [m/s2] and a curvature [1/m]."""
    v, av = w.vehicles, w.av[0]
    heading = v[0].heading
    sine, cosine = sin_cos(heading)
    speed = min(max(v[0].speed * cosine + v[0].lateral_speed * sine, 0.0), road.max_speed)
    begin_along(v, 0, 0.0)
    before = Motion(0.0, v[0].y, heading, speed, v[0].acceleration, av.curvature)
    ahead, y, heading, speed, now, curvature = roll(before, command, wish, v[0].length, road)
    sine, cosine = sin_cos(heading)
    swing = rear_axle_behind(v[0].length) * speed * curvature
    go_along(v, 0, ahead)
    v[0].y = y
    v[0].heading = heading
    v[0].speed = min(max(speed * cosine - swing * sine, 0.0), road.max_speed)
    v[0].lateral_speed = speed * sine + swing * cosine
    v[0].acceleration = now
    v[0].commanded = command
    av.curvature = curvature
    _show_course(w, speed * speed * curvature * cosine + now * sine, road)
