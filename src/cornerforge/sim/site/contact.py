"""Labels of a contact at a site, where a road has its own (`harvest`): extremes of motion, time to collision, jumps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._elementary import sin_cos
from cornerforge._jit import kernel
from cornerforge.types import FRAME_S, PERSON

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["most_at_site", "never_jumps", "shortest_at_site"]

_SLACK = 0.05
"""Rounding of places, and what a chord is shorter than its way [m]."""
_AXES = 4


@kernel
def most_at_site(
    recording: NDArray[np.void], frame: int, i: int, bodies: NDArray[np.void]
) -> tuple[float, float, float]:
    """Find the largest acceleration, braking and |lateral acceleration| [m/s2] of slot i up to a frame.

    The last is speed times the turn of the heading in a tenth of a second. NaN of people, who change their speed at
    once, and where the slot is present in fewer than 2 frames in a row.
    """
    along, braking, across, known = 0.0, 0.0, 0.0, 0
    for t in range(frame):
        here, after = recording[t, i], recording[t + 1, i]
        if here.present == 0 or after.present == 0 or bodies[i].kind == PERSON:
            continue
        known += 1
        change = (after.speed - here.speed) / FRAME_S
        along, braking = max(along, change), max(braking, -change)
        turn = (after.heading - here.heading + math.pi) % (2.0 * math.pi) - math.pi
        across = max(across, abs(turn) / FRAME_S * 0.5 * (here.speed + after.speed))
    if known == 0:
        return math.nan, math.nan, math.nan
    return along, braking, across


@kernel
def never_jumps(recording: NDArray[np.void], frame: int, i: int) -> bool:
    """Does slot i never come farther in a tenth of a second than at the larger of its speeds then and after?"""
    for t in range(frame):
        here, after = recording[t, i], recording[t + 1, i]
        if here.present == 0 or after.present == 0:
            continue
        most = max(here.speed, after.speed) * FRAME_S + _SLACK
        dx, dy = after.x - here.x, after.y - here.y
        if dx * dx + dy * dy > most * most:
            return False
    return True


@kernel
def _until_touch(a: Any, b: Any, size_a: Any, size_b: Any) -> float:
    """Compute when two boxes touch that go on straight at their speeds [s]; 0: they do; +inf: never.

    On each of the four axes of the boxes their shadows overlap for one interval of time; they touch from when the last
    of these begins, if that is before the first ends.
    """
    sine_a, cosine_a = sin_cos(a.heading)
    sine_b, cosine_b = sin_cos(b.heading)
    dx, dy = b.x - a.x, b.y - a.y
    vx, vy = b.speed * cosine_b - a.speed * cosine_a, b.speed * sine_b - a.speed * sine_a
    begin, end = 0.0, math.inf
    for k in range(_AXES):
        nx, ny = (cosine_a, sine_a) if k < 2 else (cosine_b, sine_b)
        if k % 2:
            nx, ny = -ny, nx
        reach = 0.5 * (
            size_a.length * abs(nx * cosine_a + ny * sine_a) + size_a.width * abs(ny * cosine_a - nx * sine_a)
            + size_b.length * abs(nx * cosine_b + ny * sine_b) + size_b.width * abs(ny * cosine_b - nx * sine_b)
        )  # fmt: skip
        apart, rate = dx * nx + dy * ny, vx * nx + vy * ny
        if abs(rate) < 1e-9:
            if abs(apart) > reach:
                return math.inf
            continue
        one, two = (-reach - apart) / rate, (reach - apart) / rate
        begin, end = max(begin, min(one, two)), min(end, max(one, two))
    return begin if begin <= end else math.inf


@kernel
def shortest_at_site(recording: NDArray[np.void], frame: int, n: int, bodies: NDArray[np.void]) -> float:
    """Find the AV's smallest time to collision [s] before `frame`, if both go on straight; NaN if it never closes."""
    shortest = math.inf
    for t in range(frame):
        for j in range(1, n):
            if recording[t, j].present:
                shortest = min(shortest, _until_touch(recording[t, 0], recording[t, j], bodies[0], bodies[j]))
    return shortest if shortest < math.inf else math.nan
