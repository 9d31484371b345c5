"""Oriented boxes and lateral paths: scalar kernels of plain numbers."""

from __future__ import annotations

import math
from typing import NamedTuple

from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel

__all__ = ["Box", "boxes_overlap", "path_at", "plan_path", "quintic"]

Path = tuple[float, float, float, float, float, float]
"""A quintic lateral path: coefficients of t^0 .. t^5 [m, m/s, ...]."""


class Box(NamedTuple):
    """The outline of a vehicle: centre [m], heading, counter-clockwise [rad], and size [m]."""

    x: float
    y: float
    heading: float
    length: float
    width: float


@inlined_kernel
def boxes_overlap(a: Box, b: Box) -> bool:
    """Do two boxes share a point? Separating axes (Gottschalk et al. 1996); touching edges do not count."""
    dx = b.x - a.x
    dy = b.y - a.y
    if a.heading == 0.0 and b.heading == 0.0:
        return abs(dx) < 0.5 * (a.length + b.length) and abs(dy) < 0.5 * (a.width + b.width)
    reach = 0.5 * (
        math.sqrt(a.length * a.length + a.width * a.width) + math.sqrt(b.length * b.length + b.width * b.width)
    )
    if abs(dx) >= reach or abs(dy) >= reach:
        return False
    sa, ca = sin_cos(a.heading)
    sb, cb = sin_cos(b.heading)
    cos_between = abs(ca * cb + sa * sb)
    sin_between = abs(ca * sb - sa * cb)
    return (
        abs(dx * ca + dy * sa) < _half_cover(a.length, b, cos_between, sin_between)
        and abs(dy * ca - dx * sa) < _half_cover(a.width, b, sin_between, cos_between)
        and abs(dx * cb + dy * sb) < _half_cover(b.length, a, cos_between, sin_between)
        and abs(dy * cb - dx * sb) < _half_cover(b.width, a, sin_between, cos_between)
    )


@inlined_kernel
def _half_cover(own: float, other: Box, of_length: float, of_width: float) -> float:
    """Compute half of a box's `own` side plus half of the other box's projection on that side [m].

    `of_length`, `of_width`: |cosine| of the angles between that side and the other box's length and width.
    """
    return 0.5 * own + 0.5 * other.length * of_length + 0.5 * other.width * of_width


@inlined_kernel
def path_at(path: Path, t: float) -> tuple[float, float, float]:
    """Compute lateral position [m], speed [m/s] and acceleration [m/s2] on a quintic path at time t [s] from its start.

    Args:
        path: Coefficients of t^0 .. t^5.
        t: Within the path's duration.
    """
    c0, c1, c2, c3, c4, c5 = path
    position = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    speed = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    acceleration = 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))
    return position, speed, acceleration


@kernel
def path_peak_acceleration(path: Path, duration: float) -> float:
    """Find the largest |lateral acceleration| [m/s2] on a path: at its ends or where the jerk, a quadratic, is zero."""
    peak = max(abs(path_at(path, 0.0)[2]), abs(path_at(path, duration)[2]))
    a = 60.0 * path[5]
    b = 24.0 * path[4]
    c = 6.0 * path[3]
    discriminant = b * b - 4.0 * a * c
    if discriminant > 0.0 and a != 0.0:
        root = math.sqrt(discriminant)
        for t in ((-b + root) / (2.0 * a), (-b - root) / (2.0 * a)):
            if 0.0 < t < duration:
                peak = max(peak, abs(path_at(path, t)[2]))
    elif a == 0.0 and b != 0.0:
        t = -c / b
        if 0.0 < t < duration:
            peak = max(peak, abs(path_at(path, t)[2]))
    return peak


@kernel
def quintic(y: float, speed: float, acceleration: float, y_end: float, duration: float) -> Path:
    """Compute the quintic from a lateral state (position, speed, acceleration) to rest at `y_end` in `duration` [s]."""
    t = duration
    a0 = 0.5 * acceleration
    rest = y_end - y - speed * t - a0 * t * t
    rest_speed = -speed - 2.0 * a0 * t
    rest_acceleration = -2.0 * a0
    return (
        y,
        speed,
        a0,
        (10.0 * rest - 4.0 * rest_speed * t + 0.5 * rest_acceleration * t * t) / (t * t * t),
        (-15.0 * rest + 7.0 * rest_speed * t - rest_acceleration * t * t) / (t * t * t * t),
        (6.0 * rest - 3.0 * rest_speed * t + 0.5 * rest_acceleration * t * t) / (t * t * t * t * t),
    )


@kernel
def plan_path(
    y: float, speed: float, acceleration: float, y_end: float, duration: float, max_acceleration: float
) -> tuple[Path, float]:
    """Plan the quintic from the present lateral state to rest at `y_end`; return it and its duration [s].

    The duration grows by a tenth at a time until the peak lateral acceleration is at most `max_acceleration`, or at
    most the present one, which no plan can undo; it stops growing at 8 times the desired duration.

    Args:
        y, speed, acceleration: Present lateral state [m], [m/s], [m/s2].
        y_end: Where to come to rest [m].
        duration: Desired duration [s].
        max_acceleration: Bound of the lateral acceleration [m/s2].
    """
    limit = max(max_acceleration, abs(acceleration)) + 1e-9
    longest = 8.0 * duration
    path = quintic(y, speed, acceleration, y_end, duration)
    while duration < longest and path_peak_acceleration(path, duration) > limit:
        duration = 1.1 * duration
        path = quintic(y, speed, acceleration, y_end, duration)
    return path, duration
