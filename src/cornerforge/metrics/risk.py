"""Time to collision of the AV and the vehicle it crashes with, frame by frame."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cornerforge.fields import POSE
from cornerforge.metrics import bbd, ttc
from cornerforge.road.straight import along
from cornerforge.types import Scenario

__all__ = ["contact_time", "lane_ttc", "plane_ttc"]

_Size: TypeAlias = float | NDArray[np.float64]


def lane_ttc(scenario: Scenario, partner: int) -> NDArray[np.float64]:
    """Time to collision along the lane of the AV and a vehicle that shares its lane [s].

    They share a lane when they head for the same one or their bodies overlap across the road.

    Args:
        scenario: The test.
        partner: Column of the other vehicle.

    Returns:
        Shape (T,), in [0, inf], never NaN: +inf where they share no lane, stand side by side, or do not close.
    """
    dx = along(scenario.x[:, 0], scenario.x[:, partner])
    dy, dv = (a[:, partner] - a[:, 0] for a in (scenario.y, scenario.speed))
    beside = np.abs(dy) < 0.5 * (scenario.width[0] + scenario.width[partner])
    lengths = float(scenario.length[0]), float(scenario.length[partner])
    shared = beside | (scenario.target_lane[:, partner] == scenario.target_lane[:, 0])
    # Side by side in two lanes, one behind the other is not what is going to happen: the measure would say 0.
    use = scenario.present[:, partner] & shared & (beside | (np.abs(dx) > 0.5 * sum(lengths)))
    result = np.full(len(dx), np.inf)
    gap = bbd(np.zeros(int(use.sum())), np.abs(dx[use]), *lengths)
    result[use] = ttc(gap, np.sign(dx[use]) * dv[use])
    return result


def plane_ttc(scenario: Scenario, partner: int) -> NDArray[np.float64]:
    """Time to collision in the plane of the AV and another vehicle [s]; see `contact_time`.

    Args:
        scenario: The test.
        partner: Column of the other vehicle.

    Returns:
        Shape (T,), in [0, inf], +inf where the other vehicle is absent.
    """
    x, y, speed, heading = (a[:, [0, partner]] for a in (getattr(scenario, name) for name in POSE))
    # The recorded speed is the one along the road and the heading is the path's tangent, hence the lateral speed; at a
    # site it is the one along the path.
    if scenario.odd.site is not None:
        speed = speed * np.cos(heading)
    lateral = speed * np.tan(heading)
    offset = np.stack([along(x[:, 0], x[:, 1]), y[:, 1] - y[:, 0]], axis=1)
    velocity = np.stack([speed[:, 1] - speed[:, 0], lateral[:, 1] - lateral[:, 0]], axis=1)
    lengths, widths = ((float(size[0]), float(size[partner])) for size in (scenario.length, scenario.width))
    values = contact_time(offset, velocity, heading[:, 0], heading[:, 1], lengths, widths)
    return np.where(scenario.present[:, partner], values, np.inf)


def contact_time(
    offset: NDArray[np.float64],
    velocity: NDArray[np.float64],
    heading_a: NDArray[np.float64],
    heading_b: NDArray[np.float64],
    lengths: tuple[_Size, _Size],
    widths: tuple[_Size, _Size],
) -> NDArray[np.float64]:
    """Give the time until two boxes touch if both keep their velocity and heading [s]: TTC in the plane.

    For vehicles in one lane it equals the usual TTC; for vehicles side by side it sees the lateral approach, which the
    usual one cannot.

    Args:
        offset: Centre of B minus centre of A [m], shape (T, 2), not infinite.
        velocity: Velocity of B minus velocity of A [m/s], shape (T, 2), not infinite.
        heading_a: Heading of A, counter-clockwise [rad], shape (T,), not infinite.
        heading_b: Heading of B, shape (T,).
        lengths, widths: Lengths and widths of A and B [m], numbers or (T,).

    Returns:
        Shape (T,), in [0, inf]: 0 where the boxes overlap, +inf where they never touch or only graze each other, NaN
        where a position, velocity or heading is NaN.

    Source: separating axes with linear motion (Eberly, "Dynamic Collision Detection Using Oriented Bounding Boxes").

    >>> contact_time(np.array([[25.0, 0.0]]), np.array([[-5.0, 0.0]]), np.zeros(1), np.zeros(1), (5.0, 5.0), (2.0, 2.0))
    array([4.])
    """
    enter = np.full(len(offset), -np.inf)
    leave = np.full(len(offset), np.inf)
    for angle in (heading_a, heading_a + math.pi / 2, heading_b, heading_b + math.pi / 2):
        reach = _half_extent(angle - heading_a, lengths[0], widths[0])
        reach = reach + _half_extent(angle - heading_b, lengths[1], widths[1])
        distance = offset[:, 0] * np.cos(angle) + offset[:, 1] * np.sin(angle)
        rate = velocity[:, 0] * np.cos(angle) + velocity[:, 1] * np.sin(angle)
        moving = np.abs(rate) > 1e-12
        safe_rate = np.where(moving, rate, 1.0)
        bounds = np.sort(np.stack([(-reach - distance) / safe_rate, (reach - distance) / safe_rate]), axis=0)
        always = np.where(np.abs(distance) < reach, np.inf, -np.inf)
        enter = np.maximum(enter, np.where(moving, bounds[0], -always))
        leave = np.minimum(leave, np.where(moving, bounds[1], always))
    result = np.where((enter < leave) & (leave > 0.0), np.maximum(enter, 0.0), np.inf)
    unknown = np.isnan(offset).any(axis=1) | np.isnan(velocity).any(axis=1) | np.isnan(heading_a + heading_b)
    return np.where(unknown, np.nan, result)


def _half_extent(angle: NDArray[np.float64], length: _Size, width: _Size) -> NDArray[np.float64]:
    """Half the box's shadow [m] on an axis that stands at `angle` [rad] to the box's length."""
    return 0.5 * (length * np.abs(np.cos(angle)) + width * np.abs(np.sin(angle)))
