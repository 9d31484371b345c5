"""Motion at a site in the form in which measures of roads take it: as far along the AV's way as each is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.pair import AV, BV, PairMotion
from cornerforge.analysis.site_case import site_case
from cornerforge.recordings import Recordings
from cornerforge.types import FRAME_S, Odd

__all__ = ["path_velocity", "straightened", "until_both"]

_SECOND = round(1.0 / FRAME_S)


def straightened(recordings: Recordings, odd: Odd) -> Recordings:
    """Put those that are in the AV's lane behind one another on a straight line, and leave out the others."""
    x, y = np.full(recordings.x.size, np.nan), np.zeros(recordings.x.size)
    there = np.zeros(recordings.x.size, np.bool_)
    for block, at in zip(recordings.blocks(1), recordings.at.tolist(), strict=True):
        case = site_case(block, odd)
        frames = int(block.frames[0])
        for j in range(case.route.size):
            begin = at + j * frames
            rows = slice(begin, begin + case.last + 1)
            x[rows] = case.in_line[:, j]
            there[rows] = np.isfinite(case.in_line[:, j])
    return recordings._replace(x=np.where(there, x, np.nan), y=y, present=there)


def path_velocity(motion: PairMotion) -> NDArray[np.float64]:
    """Velocities at the contact where speeds are along the own way, east and north, (2, S, 2) [m/s]."""
    speed, heading = motion.speed[:, :, -1], motion.heading[:, :, -1]
    return np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=-1)


def until_both(motion: PairMotion) -> dict[str, NDArray[np.float64]]:
    """Distance of the boxes' middles less both half lengths, and time to contact by closing of the middles, 1 s before.

    Returns:
        `bbd_1s_m` and `ttc_1s_s`, NaN where it was not recorded, and the latter where they do not close.
    """
    nothing = np.full(motion.x.shape[1], np.nan)
    column = motion.x.shape[2] - 1 - _SECOND
    if column < 0:
        return {"bbd_1s_m": nothing, "ttc_1s_s": nothing}
    known = motion.recorded[:, column]
    heading, speed = motion.heading[:, :, column], motion.speed[:, :, column]
    dx, dy = (v[BV, :, column] - v[AV, :, column] for v in (motion.x, motion.y))
    vx, vy = (speed[BV] * f(heading[BV]) - speed[AV] * f(heading[AV]) for f in (np.cos, np.sin))
    apart = np.hypot(dx, dy)
    closing = -(dx * vx + dy * vy) / np.maximum(apart, 1e-9)
    gap = apart - motion.half_lengths
    with np.errstate(divide="ignore", invalid="ignore"):
        time = np.where(closing > 1e-9, np.maximum(gap, 0.0) / closing, np.nan)
    return {"bbd_1s_m": np.where(known, gap, np.nan), "ttc_1s_s": np.where(known, time, np.nan)}
