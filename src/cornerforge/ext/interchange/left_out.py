"""Objects that a case leaves out: how near they come to the AV, and which of them are in its way.

A case without an object that is in the AV's way would be another case, so its readers refuse the file.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import HEADING, X, Y
from cornerforge.types import FRAME_S

__all__ = ["gaps", "in_lanes", "nearest", "within"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Size = tuple[float, ...]

_BESIDE, _AHEAD = 5.0, 50.0
_CORNERS = ((1.0, 1.0, -1.0, -1.0), (1.0, -1.0, 1.0, -1.0))


def gaps(own: Floats, own_size: Size, pose: Floats, size: Size) -> Floats:
    """Distance of two boxes in each frame [m], (F,), 0 where they touch; inf where one is absent.

    Args:
        own, pose: Poses on rails, (F, `rails.POSE_NUMBERS`); NaN where absent.
        own_size, size: Length and width [m]; what follows them has no effect.
    """
    least, apart = np.full(len(own), np.inf), np.zeros(len(own), dtype=bool)
    for a, a_size, b, b_size in ((own, own_size, pose, size), (pose, size, own, own_size)):
        turn = (b[:, HEADING] - a[:, HEADING])[:, None]
        cos, sin = np.cos(a[:, HEADING]), np.sin(a[:, HEADING])
        dx, dy = b[:, X] - a[:, X], b[:, Y] - a[:, Y]
        front, left = (0.5 * side * np.array(signs) for side, signs in zip(b_size, _CORNERS, strict=False))
        ahead = (dx * cos + dy * sin)[:, None] + front * np.cos(turn) - left * np.sin(turn)
        aside = (dy * cos - dx * sin)[:, None] + front * np.sin(turn) + left * np.cos(turn)
        beyond = [np.maximum(np.abs(at) - 0.5 * side, 0.0) for at, side in zip((ahead, aside), a_size, strict=False)]
        least = np.fmin(least, np.hypot(*beyond).min(axis=1))
        for at, side in zip((ahead, aside), a_size, strict=False):
            apart |= (at.min(axis=1) > 0.5 * side) | (at.max(axis=1) < -0.5 * side)
    least[~apart & np.isfinite(own[:, X]) & np.isfinite(pose[:, X])] = 0.0
    return least


def in_lanes(pose: Floats, size: Size, road_width: float) -> Bools:
    """Frames in which a box lies over the lanes, which reach from y = 0 to `road_width` [m], bool (F,)."""
    cos, sin = np.abs(np.cos(pose[:, HEADING])), np.abs(np.sin(pose[:, HEADING]))
    half = 0.5 * (size[0] * sin + size[1] * cos)
    return np.asarray((pose[:, Y] + half > 0.0) & (pose[:, Y] - half < road_width))


def nearest(gap: Floats, over_lanes: Bools, *, stands: bool = False) -> tuple[int, bool]:
    """Find the frame in which an object is nearest to the AV, and whether it is in the AV's way.

    In the way is what is in the AV's lanes within 50 m, or anywhere within 5 m, unless it stands.

    Args:
        gap: Its distance in each frame [m], (F,); inf where it does not count.
        over_lanes: Frames in which it is `in_lanes`, bool (F,).
        stands: It never moves.

    Returns:
        The frame, of those in which it is in the way if there are any; whether there are.
    """
    near = ((gap < _BESIDE) & (not stands)) | ((gap < _AHEAD) & over_lanes)
    return int(np.argmin(np.where(near, gap, np.inf) if near.any() else gap)), bool(near.any())


def within(gap: Floats, at: int) -> str:
    """Say how near an object comes in a frame."""
    return f"it comes within {gap[at]:.1f} m of the AV (after {FRAME_S * at:.1f} s)"
