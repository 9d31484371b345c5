"""How two boxes came to touch: which face of which box was reached first.

At the first frame of contact (frames are 0.1 s apart) boxes already overlap by up to a few metres, so the shallowest
overlap does not tell the face: a rear-end crash at 20 m/s is 2 m deep, and may overlap by less sideways. So both boxes
are moved back along their velocities to the moment at which they touched; the contact is on the axis of separation that
closed last. (Separating axes: Gottschalk et al. 1996; swept: Eberly, "Dynamic Collision Detection".)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_finite, check_number
from cornerforge.errors import InputError

__all__ = ["FRONT", "REAR", "SIDE", "Contact", "find_contact", "impact_speed"]

FRONT, REAR, SIDE = 0, 1, 2
"""Faces of a box; both sides count as one."""

_TOUCH_TOLERANCE_M = 0.1
_ALONG_ROAD = 0.5
"""Cosine of 60 degrees: up to there a heading counts as along the road."""
_FACING = 0.5
"""Cosine of 60 degrees: a front or rear takes part if its normal is closer than that to facing the other face."""


@dataclass(frozen=True)
class Contact:
    """First contact of the AV's and the BV's box.

    Attributes:
        av_sector: FRONT, REAR or SIDE of the AV's box, int8, shape (S,); SIDE where the centres fall together.
        bv_sector: The same for the BV's box.
        relative_heading: Angle between the headings [rad], in [0, pi], shape (S,).
        av_approach: Speed at which the AV's motion across the road closes in on the BV [m/s], shape (S,).
        bv_approach: The same for the BV's motion towards the AV.
        normal: Unit vector across the touching faces, from the AV to the BV, [along, across the road], shape (S, 2).
    """

    av_sector: NDArray[np.int8]
    bv_sector: NDArray[np.int8]
    relative_heading: NDArray[np.float64]
    av_approach: NDArray[np.float64]
    bv_approach: NDArray[np.float64]
    normal: NDArray[np.float64]


def impact_speed(pose: NDArray[np.floating]) -> NDArray[np.float64]:
    """Size of the velocity of two vehicles relative to each other [m/s], (*d).

    Args:
        pose: [x m, y m, speed along the road m/s, heading rad] of both, (*d, 2, 4).

    >>> float(impact_speed(np.array([[0.0, 0.0, 30.0, 0.0], [5.0, 0.0, 22.0, 0.0]])))
    8.0
    """
    lengthwise = pose[..., 2].astype(np.float64)
    across = lengthwise * np.tan(pose[..., 3])
    relative = np.stack([lengthwise[..., 1] - lengthwise[..., 0], across[..., 1] - across[..., 0]])
    return np.asarray(np.hypot(*relative))


def find_contact(
    pose: NDArray[np.floating], length: float | NDArray[np.floating], width: float | NDArray[np.floating]
) -> Contact:
    """Find the faces of first contact from the poses at the first frame of overlap.

    Args:
        pose: [x m, y m, speed along the road m/s, heading rad] of the AV (0) and the BV (1), shape (S, 2, 4), finite.
        length: Length of the boxes [m], one number or shape (S, 2), each 0.1 to 50.
        width: Width of the boxes [m], in the same form.

    Raises:
        InputError: A shape is wrong, a value is not finite or out of range, or two boxes are more than 0.1 m apart.
    """
    if pose.ndim != 3 or pose.shape[1:] != (2, 4):
        raise InputError(f"pose has shape {pose.shape}; allowed: (cases, 2, 4).")
    check_finite("pose", pose)
    half_length = _halves("vehicle_length", length, len(pose))
    half_width = _halves("vehicle_width", width, len(pose))
    values = pose.astype(np.float64)
    place, speed, heading = values[..., :2], values[..., 2], values[..., 3]
    forward = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    # the recorded speed is that along the road; only a vehicle far from the road's direction is given its path speed
    along = forward[..., :1]
    velocity = speed[..., None] * forward / np.where(along > _ALONG_ROAD, along, 1.0)
    left = np.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    # order of the axes: both boxes' lengths before both widths, so that a contact corner on corner counts as lengthwise
    axes = np.concatenate([forward, left], axis=1)
    offset = place[:, 1] - place[:, 0]
    touching = _touching_axis(offset, velocity[:, 1] - velocity[:, 0], axes, half_length, half_width)
    axis = np.take_along_axis(axes, touching[:, None, None], axis=1)[:, 0]
    side = np.sign(_dot(offset, axis))[:, None]
    sectors = _sectors(side * axis, forward)
    across = np.sign(offset[:, 1])
    return Contact(
        av_sector=sectors[:, 0],
        bv_sector=sectors[:, 1],
        relative_heading=np.arccos(np.clip(_dot(forward[:, 0], forward[:, 1]), -1.0, 1.0)),
        av_approach=velocity[:, 0, 1] * across,
        bv_approach=-velocity[:, 1, 1] * across,
        normal=np.where(side == 0.0, 1.0, side) * axis,
    )


def _halves(name: str, size: float | NDArray[np.floating], cases: int) -> NDArray[np.float64]:
    """Half of a length or width, checked, shape (S, 2)."""
    sizes = np.asarray(size, np.float64)
    if sizes.shape not in ((), (cases, 2)):
        raise InputError(f"{name} has shape {sizes.shape}; allowed: one number, or ({cases}, 2) as there are cases.")
    for value in np.unique(sizes).tolist():
        check_number(name, value, low=0.1, high=50.0, unit="m")
    return np.broadcast_to(0.5 * sizes, (cases, 2))


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1], np.float64)


def _touching_axis(
    offset: NDArray[np.float64],
    velocity: NDArray[np.float64],
    axes: NDArray[np.float64],
    half_length: NDArray[np.float64],
    half_width: NDArray[np.float64],
) -> NDArray[np.intp]:
    """Index 0..3 of the axis that closed last, shape (S,); at rest the axis of shallowest overlap."""
    apart = _dot(offset[:, None], axes)
    reach = _shadow(half_length, axes, axes[:, :2]) + _shadow(half_width, axes, axes[:, 2:])
    overlap = reach - np.abs(apart)
    gap = -overlap.min(axis=1)
    if (gap > _TOUCH_TOLERANCE_M).any():
        row = int(np.argmax(gap > _TOUCH_TOLERANCE_M))
        raise InputError(
            f"The boxes of case {row} are {gap[row]:.2f} m apart at the contact; check the vehicle's length and width."
        )
    speed = _dot(velocity[:, None], axes)
    closing = np.where(apart == 0.0, np.abs(speed), -speed * np.sign(apart))  # from dead centre, back is apart
    since = np.full(overlap.shape, np.inf)
    np.divide(np.maximum(overlap, 0.0), closing, out=since, where=closing > 1e-6)
    axis = np.where(np.isfinite(since).any(axis=1), since.argmin(axis=1), overlap.argmin(axis=1))
    return np.asarray(axis, np.intp)


def _shadow(
    half: NDArray[np.float64], axes: NDArray[np.float64], sides: NDArray[np.float64]
) -> NDArray[np.float64]:  # fmt: skip
    """Give what half lengths (or half widths) of both boxes add to their extent on each axis [m], shape (S, 4)."""
    av, bv = (np.abs(_dot(axes, sides[:, [i]])) for i in (0, 1))
    # The sum of half times share, so written that equal boxes give the bits of half * (av + bv).
    mean, difference = (0.5 * (half[:, :1] + sign * half[:, 1:]) for sign in (1.0, -1.0))
    return np.asarray(mean * (av + bv) + difference * (av - bv), np.float64)


def _sectors(towards_bv: NDArray[np.float64], forward: NDArray[np.float64]) -> NDArray[np.int8]:
    """Sectors of the AV (column 0) and the BV (column 1), shape (S, 2)."""
    # how much each front faces the other vehicle: 1 straight ahead, -1 straight behind
    facing = np.stack([_dot(towards_bv, forward[:, 0]), -_dot(towards_bv, forward[:, 1])], axis=1)
    sectors = np.where(facing >= _FACING, FRONT, np.where(facing <= -_FACING, REAR, SIDE))
    return sectors.astype(np.int8)
