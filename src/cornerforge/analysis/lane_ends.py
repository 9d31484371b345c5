"""Mistakes of an AV where lanes end, read from the recorded motion and the road (`conduct`, rules 7 to 9)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.mechanism import VISIBLE_M
from cornerforge.analysis.pair import AV, BV, PairMotion
from cornerforge.recordings import Recordings
from cornerforge.road.lanes import URGENT_TIME, lane_table
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Odd

__all__ = ["blocks_since", "ends_soon", "stops_since"]

_READY, _BRAKES, _ENTERED = 8, -1.0, 0.4
"""Frames within which an AV must begin to brake for one that comes in, with how much, and how far that one moves in."""
_COMES_IN, _BEFORE, _GAINS = 50, 30, 0.5
"""Frames that coming in may take at most, frames before that, and how much speed an AV gains in these [m/s]."""
_STOPPED, _LATELY = 8.0, 100
"""An AV has stopped where it is slower than this [m/s]; only so many frames before the contact count."""
_PRESSING = 10.0
"""Time before the end of a lane from which a gap must be taken [s]: half of `URGENT_TIME`."""
_GAP_TIME, _GAP_FRAMES, _GAP_BRAKING = 1.0, 10, 0.5
"""A gap has this time [s] to both neighbours for so many frames, and lets the rear one brake as little [m/s2]."""


def _lanes(y: NDArray[np.float64], odd: Odd) -> NDArray[np.int64]:
    """Slots at y [m], those of the road's edge beyond it."""
    return np.clip(np.floor(y / odd.lane_width), 0, odd.n_lanes - 1).astype(np.int64)


def _leave_by(x: NDArray[np.float64], lane: NDArray[np.int64], odd: Odd) -> NDArray[np.float64]:
    """Where one at x must have left a lane [m], inf: nowhere; NaN: there is no lane, or it is a ramp."""
    rows = lane_table(odd).stretches[np.clip(lane, 0, odd.n_lanes - 1)]
    begin, end, by, ramp = np.moveaxis(rows, -1, 0)
    there = (begin <= x[..., None]) & (x[..., None] < end) & (ramp == 0.0) & (lane >= 0)[..., None]
    there &= (lane < odd.n_lanes)[..., None]
    return np.where(there.any(axis=-1), np.where(there, by, -np.inf).max(axis=-1), np.nan)


def ends_soon(
    x: NDArray[np.float64], y: NDArray[np.float64], speed: NDArray[np.float64], odd: Odd, within: float = URGENT_TIME
) -> NDArray[np.bool_]:
    """Mark where the lane of a vehicle's centre ends within so many seconds; arrays of one shape [m, m, m/s]."""
    return np.asarray(along(x, _leave_by(x, _lanes(y, odd), odd)) < within * np.maximum(speed, 1.0))


def blocks_since(m: PairMotion, soon: NDArray[np.bool_], prevented: NDArray[np.bool_], odd: Odd) -> NDArray[np.int64]:
    """Find since when an AV closes the gap to one that comes over from a lane that ends, (S,) frames; -1: it does not.

    Args:
        m: S cases.
        soon: The lane of the AV, and of the other, ends soon, (2, S, T).
        prevented: Some reference driver would have prevented the crash, (S,).
        odd: Road and rules.
    """
    last, lane = m.x.shape[2] - 1, _lanes(m.y, odd)
    settled = np.abs(m.y[BV] - (lane[BV] + 0.5) * odd.lane_width) < VISIBLE_M
    before_it = soon[BV] & settled & m.recorded & (np.abs(lane[BV] - lane[AV, :, -1:]) == 1)
    since = np.full(prevented.size, -1, np.int64)
    for c in np.flatnonzero(before_it.any(axis=1) & prevented):
        at, speed = int(np.flatnonzero(before_it[c])[-1]), m.speed[AV, c]
        before = max(at - _BEFORE, int(np.argmax(m.recorded[c])))
        if not _READY <= last - at <= _COMES_IN or np.ptp(m.y[AV, c, at:]) > _ENTERED:
            continue
        is_ahead = m.x[BV, c, at] > m.x[AV, c, at] and m.free_along[c, at] > 0.0
        comes_in = abs(m.y[BV, c, last] - m.y[BV, c, at]) > _ENTERED
        brakes = np.diff(speed[at : at + _READY + 1]).min() <= _BRAKES * FRAME_S
        if is_ahead and comes_in and not brakes and speed[at] - speed[before] >= _GAINS:
            since[c] = before
    return since


def stops_since(r: Recordings, m: PairMotion, soon: NDArray[np.bool_], odd: Odd) -> NDArray[np.int64]:
    """Find since when an AV had a gap and then stopped where its lane ends, (S,) frames; -1: no gap, or it did not.

    Args:
        r, m: S cases, all vehicles and the pairs.
        soon: The lane of the AV, and of the other, ends soon, (2, S, T).
        odd: Road and rules.
    """
    frames = m.x.shape[2]
    stopped = soon[AV] & m.recorded & (m.speed[AV] < _STOPPED)
    since = np.full(r.n_cases, -1, np.int64)
    for c in np.flatnonzero(stopped[:, -_LATELY:].any(axis=1)):
        first = frames - 1 - int(r.last[c])
        gap = _gaps(r, int(c), odd)[: max(int(np.argmax(stopped[c])) - first, 0)]
        runs = np.convolve(gap, np.ones(_GAP_FRAMES), "valid") >= _GAP_FRAMES if gap.size >= _GAP_FRAMES else gap
        at = int(np.argmax(runs)) + first
        if runs.any() and np.ptp(m.y[AV, c, at : int(np.argmax(stopped[c])) + 1]) < VISIBLE_M:
            since[c] = at
    return since


def _gaps(r: Recordings, c: int, odd: Odd) -> NDArray[np.bool_]:
    """Mark the frames of a case in which its AV, in a lane that ends, had a gap in a next lane that goes on."""
    shape = int(r.vehicles[c]), int(r.frames[c])
    rows = slice(int(r.at[c]), int(r.at[c]) + shape[0] * shape[1])
    x, y, speed = (getattr(r, name)[rows].reshape(shape).astype(np.float64) for name in ("x", "y", "speed"))
    present = r.present[rows].reshape(shape)[1:]
    length = r.length[int(r.vehicle_at[c]) :][: shape[0], None]
    lane = _lanes(np.nan_to_num(y), odd)
    ahead = along(x[:1], x[1:])
    room = np.abs(ahead) - 0.5 * (length[:1] + length[1:])
    rear = np.where(ahead > 0.0, speed[:1], speed[1:])
    closing = np.maximum(np.sign(ahead) * (speed[:1] - speed[1:]), 0.0)
    near = present & ((room < _GAP_TIME * rear) | (closing**2 > 2.0 * _GAP_BRAKING * np.maximum(room, 0.0)))
    free = np.zeros(shape[1], np.bool_)
    for beside in (lane[0] - 1, lane[0] + 1):
        free |= (_leave_by(x[0], beside, odd) == np.inf) & ~(near & (lane[1:] == beside)).any(axis=0)
    return np.asarray(free & ends_soon(x[0], y[0], speed[0], odd, _PRESSING))
