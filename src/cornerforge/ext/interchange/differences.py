"""Rates that a file does not give, from differences, and rates that contradict them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import LATERAL_SPEED, SPEED, X, Y
from cornerforge.types import FRAME_S

__all__ = ["jumps", "rates"]

_ASTRAY = ((1, 1.0), (10, 2.0))
"""An object jumps if it is farther from where its velocity takes it, in as many frames [m]."""


def rates(values: NDArray[np.float64], *, bent_ends: bool = False) -> NDArray[np.float64]:
    """Take the rate of change of a quantity at each frame, from the frames before and after it.

    At the ends of a stretch, and so in the first frame, it is the difference to the only neighbour; 0 without
    neighbour.

    Args:
        values: One for each tenth of a second, (F,); NaN where it is not known.
        bent_ends: Take the rate at the ends from a parabola through three frames, where there are three.

    Returns:
        Change by second, (F,); NaN where `values` is.

    >>> rates(np.array([np.nan, 0.0, 1.0, 3.0, np.nan, 7.0]))
    array([nan, 10., 15., 20., nan,  0.])
    >>> rates(np.array([0.0, 1.0, 4.0]) / 100.0, bent_ends=True)
    array([0. , 0.2, 0.4])
    """
    found = np.full(values.size, np.nan)
    known = np.flatnonzero(np.isfinite(values))
    for span in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        order: Literal[1, 2] = 2 if bent_ends and span.size > 2 else 1
        found[span] = np.gradient(values[span], FRAME_S, edge_order=order) if span.size > 1 else 0.0
    return found


def jumps(pose: NDArray[np.float64], slack: float = 1.5) -> NDArray[np.bool_]:
    """Mark the frames, bool (F,), within a second of which an object is not where its velocity takes it.

    Args:
        pose: Poses on rails, (F, `rails.POSE_NUMBERS`); NaN where it is absent, which is no jump.
        slack: Factor of 1 m after a frame and 2 m after ten, which are borne; recordings are noisier than simulators.
    """
    far = np.zeros(len(pose), dtype=bool)
    for place, speed in ((X, SPEED), (Y, LATERAL_SPEED)):
        off = np.diff(pose[:, place]) - 0.5 * FRAME_S * (pose[1:, speed] + pose[:-1, speed])
        for frames, most in _ASTRAY:
            sums = np.convolve(np.append(0.0, np.nan_to_num(off)), np.ones(frames))
            for at in np.flatnonzero(np.abs(sums) > slack * most):
                far[max(0, at - frames) : at + 1] = True
    return far & np.isfinite(pose[:, X])
