"""Driver decisions (the state that a driver saw, its acceleration over the next second) from trajectories at 5-25 Hz.

Shapes: `n` rows of a file, or `n` decisions. Rows are sorted by vehicle and time before they come here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

__all__ = ["Decisions", "concatenate", "decide_each_second", "leader_by_lane", "leader_by_name", "smooth_tracks"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_ORDER = 2
"""Polynomial order of the Savitzky-Golay filter: constant acceleration within the window."""


@dataclass(frozen=True)
class Decisions:
    """Decisions of drivers, one a second, struct-of-arrays of shape (n,).

    Attributes:
        speed: Subject speed [m/s].
        gap: Bumper-to-bumper distance to the leader [m]; +inf without a leader.
        range_rate: Lead minus subject [m/s]; 0 where there is no leader.
        acceleration: Mean over the next second [m/s2].
        vehicle: Number of the driver, unique within the file: the unit to resample in a bootstrap.
        held_out: True for decisions that no fit may use.
        before: The same driver's decision a second before, (n, 4): speed, gap, range rate, acceleration; NaN without
            one. None: no decision has one.
    """

    speed: Floats = field(metadata={"unit": "m/s"})
    gap: Floats = field(metadata={"unit": "m"})
    range_rate: Floats = field(metadata={"unit": "m/s"})
    acceleration: Floats = field(metadata={"unit": "m/s2"})
    vehicle: Ints
    held_out: NDArray[np.bool_]
    before: Floats = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.before is None:
            object.__setattr__(self, "before", np.full((self.speed.size, 4), np.nan))

    @property
    def size(self) -> int:
        """Number of decisions."""
        return int(self.speed.size)

    def where(self, mask: NDArray[np.bool_]) -> Decisions:
        """Return the decisions where `mask`, shape (n,), is true."""
        return Decisions(**{f.name: getattr(self, f.name)[mask] for f in fields(Decisions)})


def concatenate(parts: Sequence[Decisions]) -> Decisions:
    """Join decisions; vehicles of different parts get different numbers. `parts` holds at least one part."""
    columns = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Decisions)}
    first = np.cumsum([0] + [int(part.vehicle.max()) + 1 if part.size else 0 for part in parts[:-1]])
    columns["vehicle"] = np.concatenate([part.vehicle + start for part, start in zip(parts, first, strict=True)])
    return Decisions(**columns)


def _run_starts(vehicle: Ints, tick: Ints) -> Ints:
    """Return the first row of each stretch of one vehicle without a missing tick, shape (k,)."""
    breaks = (np.diff(vehicle) != 0) | (np.diff(tick) != 1)
    return np.concatenate([[0], np.flatnonzero(breaks) + 1]).astype(np.int64)


def smooth_tracks(vehicle: Ints, tick: Ints, position: Floats, step: float, window: float) -> tuple[Floats, Floats]:
    """Smooth position [m] and speed [m/s] by a Savitzky-Golay filter of order 2, each of shape (n,).

    Args:
        vehicle: Number of the vehicle, shape (n,), sorted.
        tick: Time in steps, shape (n,), increasing within a vehicle; the filter never reaches over a missing tick.
        position: Along the road [m], shape (n,).
        step: Length of a tick [s].
        window: Length of the filter [s]; at least three rows.

    Returns:
        NaN in stretches shorter than the window. Source: Savitzky and Golay (1964).
    """
    from scipy.signal import savgol_filter

    length = max(2 * int(window / step / 2.0), _ORDER) + 1
    smooth, speed = np.full(position.shape, np.nan), np.full(position.shape, np.nan)
    starts = _run_starts(vehicle, tick)
    for start, stop in zip(starts, np.append(starts[1:], position.size), strict=True):
        if stop - start >= length:
            track = position[start:stop]
            smooth[start:stop] = savgol_filter(track, length, _ORDER)
            speed[start:stop] = savgol_filter(track, length, _ORDER, deriv=1, delta=step)
    return smooth, speed


def leader_by_lane(recording: Ints, lane: Ints, tick: Ints, position: Floats) -> Ints:
    """Return the row of the next vehicle ahead in the same lane at the same time, shape (n,); -1 for none."""
    order = np.lexsort((position, lane, tick, recording))
    here, ahead = order[:-1], order[1:]
    same = (recording[here] == recording[ahead]) & (lane[here] == lane[ahead]) & (tick[here] == tick[ahead])
    leader = np.full(position.size, -1, dtype=np.int64)
    leader[here[same]] = ahead[same]
    return leader


def leader_by_name(vehicle: Ints, tick: Ints, leader_vehicle: Ints) -> Ints:
    """Return the row of the named leader at the same time, shape (n,); -1 for no name (-1) or no row."""
    span = int(tick.max() - tick.min()) + 1 if tick.size else 1
    key = vehicle * span + (tick - tick.min())
    wanted = leader_vehicle * span + (tick - tick.min())
    place = np.minimum(np.searchsorted(key, wanted), key.size - 1)
    return np.where((leader_vehicle >= 0) & (key[place] == wanted), place, -1)


def decide_each_second(
    decisions: Decisions, tick: Ints, partner: Ints, usable: NDArray[np.bool_], steps: int
) -> Decisions:
    """Thin rows to one decision a second, with the mean acceleration over the second that follows.

    Args:
        decisions: States at every row; their `acceleration` is not read.
        tick: Time in steps, shape (n,).
        partner: Number of what must stay the same for the second (leader and lane), shape (n,).
        usable: Rows that may be used, shape (n,).
        steps: Ticks in a second.

    Returns:
        Decisions at the start of each whole second of every stretch with the same vehicle and partner.
    """
    last = np.flatnonzero(usable)
    if last.size == 0:
        return decisions.where(usable)
    vehicle, ticks, partners = decisions.vehicle[last], tick[last], partner[last]
    breaks = (np.diff(vehicle) != 0) | (np.diff(ticks) != 1) | (np.diff(partners) != 0)
    starts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    stretch = np.concatenate([[0], np.cumsum(breaks)])
    age = np.arange(last.size) - starts[stretch]
    end = np.concatenate([starts[1:], [last.size]])[stretch]
    at = np.flatnonzero((age % steps == 0) & (np.arange(last.size) + steps < end))
    now, later = last[at], last[at + steps]
    columns = {f.name: getattr(decisions, f.name)[now] for f in fields(Decisions)}
    columns["acceleration"] = decisions.speed[later] - decisions.speed[now]
    seen = np.stack([columns[name] for name in ("speed", "gap", "range_rate", "acceleration")], axis=1)
    columns["before"] = np.full(seen.shape, np.nan)
    next_second = np.flatnonzero(np.diff(stretch[at]) == 0) + 1
    columns["before"][next_second] = seen[next_second - 1]
    return Decisions(**columns)
