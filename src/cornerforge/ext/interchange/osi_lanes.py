"""Lanes of a trace without a road: where its traffic drives."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import DataError
from cornerforge.ext.interchange.osi_trace import POSITION_X, POSITION_Y, SPEED_X, SPEED_Y, YAW
from cornerforge.ext.interchange.straight_frame import Frame
from cornerforge.types import MAX_LANES

__all__ = ["frame_of_traffic"]

_MOVING, _STEADY = 1.0, 0.2
"""Vehicles show lanes where they go faster than the first and aside slower than the second [m/s]."""
_SAME_WAY = 0.5
"""Cosine of the largest angle between vehicles that drive the same way."""
_TURN = 0.03
"""All vehicles turn by more from their begin to their end: the road bends [rad]."""
_LONE_LANE, _LANE_WIDTHS = 3.6, (2.5, 6.0)
_APART, _WIDEST, _OFF = 1.2, 1.8, 0.5
"""Least gap between the places of two lanes, most room that places take in one, and how far they may be from its
middle [m]."""


def frame_of_traffic(name: str, states: NDArray[np.float64], av: int) -> Frame:
    """Find the lanes in which vehicles drive that go the AV's way.

    The direction is the median of theirs. Lanes lie where vehicles keep their lateral place, side by side and of one
    width; a lone one counts as 3.6 m wide.

    Args:
        name: Of the file, for messages.
        states: Where objects are in the world, (F, V, 8), as in `osi_trace`.
        av: Column of the AV.

    Raises:
        DataError: Vehicles turn as on a bend, nothing moves, or their places are not those of lanes.
    """
    own = states[:, av]
    speed = np.hypot(states[..., SPEED_X], states[..., SPEED_Y])
    turn = np.mod(states[..., YAW] - np.median(own[:, YAW]) + math.pi, 2.0 * math.pi) - math.pi
    same = (np.cos(turn) > _SAME_WAY) & (speed > _MOVING)
    if not same.any():
        raise DataError(f"{name}: nothing drives in it, so its lanes are not known; say on which road it is.")
    ways = [turn[same[:, k], k] for k in np.flatnonzero(same.any(axis=0))]
    bends = np.array([way[-1] - way[0] for way in ways])
    if bends.min() > _TURN or bends.max() < -_TURN:
        raise DataError(f"{name}: all vehicles turn, by {np.abs(bends).min():.2f} rad or more: the road bends.")
    direction = float(np.median(own[:, YAW]) + np.median(turn[same]))
    frame = Frame(float(own[0, POSITION_X]), float(own[0, POSITION_Y]), direction, 1, _LONE_LANE)
    _, y = frame.of_world(states[..., POSITION_X], states[..., POSITION_Y])
    _, aside = frame.turned(states[..., SPEED_X], states[..., SPEED_Y])
    right, lanes, width = _lanes(name, np.sort(y[same & (np.abs(aside) < _STEADY)]))
    note = f"{name} comes without a road: its {lanes} lanes, {width:.2f} m wide, are those in which vehicles drive"
    return Frame(*frame.to_world(0.0, right), frame.direction, lanes, width, (note,))


def _lanes(name: str, y: NDArray[np.float64]) -> tuple[float, int, float]:
    """Right edge [m], number and width [m] of the lanes in which vehicles keep the places y, sorted."""
    if y.size == 0:
        raise DataError(f"{name}: no vehicle keeps its lane, so lanes are not known; say on which road it is.")
    places = np.split(y, np.flatnonzero(np.diff(y) > _APART) + 1)
    room = max(float(np.subtract(*np.percentile(place, [95.0, 5.0]))) for place in places)
    middle = np.array([np.median(place) for place in places])
    width = _LONE_LANE
    if middle.size > 1:
        step = float(np.diff(middle).min())
        width = step / max(1, round(step / _LONE_LANE))
    number = np.rint((middle - middle[0]) / width)
    if middle.size > 1:
        width = float(np.polyfit(number, middle, 1)[0])
    right = float(np.mean(middle - width * number)) - 0.5 * width
    off = float(np.abs(middle - right - (number + 0.5) * width).max())
    lanes = int(number[-1]) + 1
    if room > _WIDEST or off > _OFF or lanes > MAX_LANES or not _LANE_WIDTHS[0] <= width <= _LANE_WIDTHS[1]:
        shown = ", ".join(f"{place:.1f}" for place in (middle - middle[0])[:8])
        raise DataError(f"{name}: vehicles keep places {shown} m across, which are no lanes; say on which road it is.")
    return right, lanes, width
