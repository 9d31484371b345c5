"""Seconds at risk of a lane change in recorded trajectories, and the changes: what `lane_fit` is fitted to.

A *trial* is one second of one vehicle and one side: there is a lane, and the vehicle begins to change to it, or does
not. Seconds in which a change runs are no trials; nor is the end of a track, where a change that begins would not be
seen; nor is a second with a gap in the other lane for which a driver turns back. The second in which a change begins is
one trial, taken at the start of the change.

Shapes: `n` rows of a file, `k` trials before any is left out, `m` trials.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.lane_change import LaneChange
from cornerforge.ext.calibrate.lane_observations import DWELL, LaneTracks, lane_crossings, lane_tracks
from cornerforge.ext.calibrate.readers import Reading
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID
from cornerforge.ndd.model import GAPS

__all__ = ["BEGINS_BEFORE", "LENGTHS", "SecondsAtRisk", "joined_seconds", "seconds_at_risk"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

BEGINS_BEFORE = 2.4
"""Time from the start of a lane change to the crossing [s]: half of the median duration as people measure it."""
_IN_BOTH = 1.0
"""Time before and after the crossing for which a vehicle counts as in both lanes [s], less than `BEGINS_BEFORE`: else a
vehicle that begins to change would block itself."""
LENGTHS = (2.0, 25.0)
"""Lengths of the vehicles that give lane changes and gaps [m]."""
_SIGHT = float(GAPS[-1]) + LENGTHS[1]
"""Distance of centres up to which neighbours are looked for [m]: none beyond it is on the grid of gaps."""
_FINE, _NO_START, _TWICE, _LENGTH, _SPEED, _STRETCH, _CRITICAL = range(7)
_REASONS = {
    _NO_START: f"its start, {BEGINS_BEFORE:g} s before the crossing, is not in the track",
    _TWICE: f"another change within {2 * BEGINS_BEFORE:g} s, or two lanes at once",
    _LENGTH: f"a vehicle is shorter than {LENGTHS[0]:g} m or longer than {LENGTHS[1]:g} m",
    _SPEED: "a speed is not known (the track is too short, or has gaps)",
    _STRETCH: f"the recorded stretch of lane ends within {_SIGHT:g} m, and nobody is seen before",
    _CRITICAL: "a gap for which drivers turn back, so that a change would not be seen",
}
"""The first that holds is reported."""


@dataclass(frozen=True)
class SecondsAtRisk:
    """Trials, struct-of-arrays of shape (m,).

    Attributes:
        vehicle: Number of the driver, unique within the file.
        changed: A change to this side begins.
        speed: Speed of the subject [m/s].
        own_gap: Bumper-to-bumper distance to the leader in the subject's lane [m]; +inf without one in sight.
        own_rate: Leader's speed minus the subject's [m/s]; 0 without one, here and below.
        lead_gap, lead_rate: The same for the vehicle ahead in the lane on this side; 0 or less: the two overlap.
        rear_gap, rear_rate: The same for the one behind; the rate is subject minus rear, negative when the rear closes.
        left_out: Reason -> trials left out, changes among them.
        changes_left_out: Reason -> changes left out.
    """

    vehicle: Ints
    changed: Bools
    speed: Floats = field(metadata={"unit": "m/s"})
    own_gap: Floats = field(metadata={"unit": "m"})
    own_rate: Floats = field(metadata={"unit": "m/s"})
    lead_gap: Floats = field(metadata={"unit": "m"})
    lead_rate: Floats = field(metadata={"unit": "m/s"})
    rear_gap: Floats = field(metadata={"unit": "m"})
    rear_rate: Floats = field(metadata={"unit": "m/s"})
    left_out: Mapping[str, int]
    changes_left_out: Mapping[str, int]

    @property
    def size(self) -> int:
        """Number of trials."""
        return int(self.changed.size)

    @property
    def changes(self) -> int:
        """Number of changes."""
        return int(self.changed.sum())


_COLUMNS = tuple(f.name for f in fields(SecondsAtRisk) if not f.name.endswith("left_out"))


def joined_seconds(parts: Sequence[SecondsAtRisk]) -> SecondsAtRisk:
    """Join the trials of several files, at least one; vehicles of different files get different numbers."""
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS}
    first = np.cumsum([0] + [int(part.vehicle.max(initial=-1)) + 1 for part in parts[:-1]])
    columns["vehicle"] = np.concatenate([part.vehicle + start for part, start in zip(parts, first, strict=True)])
    return SecondsAtRisk(
        **columns,
        left_out=_summed([part.left_out for part in parts]),
        changes_left_out=_summed([part.changes_left_out for part in parts]),
    )


def _summed(counts: Sequence[Mapping[str, int]]) -> dict[str, int]:
    return {
        reason: sum(one.get(reason, 0) for one in counts)
        for reason in _REASONS.values()
        if any(reason in one for one in counts)
    }


def seconds_at_risk(reading: Reading) -> SecondsAtRisk | None:
    """Make the trials of a file; None if its layout does not give each row's lane.

    Vehicles first seen late are left out, as they are held out from the car-following law (`Layout.held_out_from`). A
    neighbour that changes lanes counts in both from 1 s before the crossing until as long after it.
    """
    if reading.layout.kind != "lanes":
        return None
    t = lane_tracks(reading)
    crossings = _crossings(t)
    road = _Road(t, crossings)
    row, lane, changed, fault = _trials(t, crossings, road)
    first_seen = t.tick[np.searchsorted(t.vehicle, t.vehicle[row])]
    seen_early = first_seen <= reading.layout.held_out_from * t.tick.max(initial=0)
    row, lane, changed, fault = (column[seen_early] for column in (row, lane, changed, fault))
    own_gap, own_rate, own_fault = road.neighbour(row, t.lane[row], ahead=True)
    lead_gap, lead_rate, lead_fault = road.neighbour(row, lane, ahead=True)
    rear_gap, rear_rate, rear_fault = road.neighbour(row, lane, ahead=False)
    critical = np.where(_turned_back_for(lead_gap, lead_rate) | _turned_back_for(rear_gap, rear_rate), _CRITICAL, _FINE)
    faults = np.stack([fault, _fault_of(t, row), own_fault, lead_fault, rear_fault, critical])
    why = np.where(faults > _FINE, faults, len(_REASONS) + 1).min(axis=0)
    fine = ~(faults > _FINE).any(axis=0)
    columns = (t.vehicle[row], changed, t.speed[row], own_gap, own_rate, lead_gap, lead_rate, rear_gap, rear_rate)
    return SecondsAtRisk(
        **{name: column[fine] for name, column in zip(_COLUMNS, columns, strict=True)},
        left_out=_counted(why),
        changes_left_out=_counted(why[changed]),
    )


def _counted(why: Ints) -> dict[str, int]:
    return {text: int((why == reason).sum()) for reason, text in _REASONS.items() if (why == reason).any()}


def _fault_of(t: LaneTracks, row: Ints) -> Ints:
    """Return why a vehicle cannot be used at its row, as a subject or as a neighbour, shape of `row`."""
    odd = (t.length[row] < LENGTHS[0]) | (t.length[row] > LENGTHS[1])
    return np.where(odd, _LENGTH, np.where(np.isfinite(t.speed[row]), _FINE, _SPEED))


def _turned_back_for(gap: Floats, rate: Floats) -> Bools:
    """Tell for which gaps a driver that begins now turns back, shape (k,): at its next decision, a second later.

    The gap is then what constant speeds make of it. False where a speed is not known.
    """
    rate = np.nan_to_num(rate)
    later = np.minimum(gap + rate, GAP_GRID.upper)
    return np.asarray(LaneChange().turn_back()[GAP_GRID.place(later), RANGE_RATE_GRID.place(rate)] == 1.0)


class _Crossing(NamedTuple):
    """A lane change.

    Attributes:
        row: First row with the new lane.
        start: Row at which it began; -1 if that is not in the track.
        lane: The new lane.
        first, until: The rows of the vehicle, the first and one beyond the last.
    """

    row: int
    start: int
    lane: int
    first: int
    until: int


def _crossings(t: LaneTracks) -> list[_Crossing]:
    before = _before(t)
    found = []
    for start, lane in lane_crossings(t, (np.diff(t.vehicle) == 0) & (np.diff(t.tick) == 1), before_s=BEGINS_BEFORE):
        row = start + before if start >= 0 else -start
        first, until = np.searchsorted(t.vehicle, [t.vehicle[row], t.vehicle[row] + 1])
        found.append(_Crossing(row, max(start, -1), lane, int(first), int(until)))
    return found


def _before(t: LaneTracks) -> int:
    return round(BEGINS_BEFORE * t.per_second)


def _trials(t: LaneTracks, crossings: Sequence[_Crossing], road: _Road) -> tuple[Ints, Ints, Bools, Ints]:
    """Return each trial's row, the lane on its side, whether a change begins, and why it cannot be used; each (k,).

    A change with a start outside the track stands at the row of its crossing.
    """
    before, dwell = _before(t), max(round(DWELL * t.per_second), 1)
    run = np.concatenate([[0], np.cumsum((np.diff(t.vehicle) != 0) | (np.diff(t.tick) != 1))])
    rows_left = np.searchsorted(run, run, side="right") - np.arange(run.size)
    at_risk = (t.tick % t.per_second == 0) & (t.lane > 0) & (rows_left > before + dwell)
    faults = []
    last_vehicle, free_again = -1, 0
    for one in crossings:
        tick = int(t.tick[one.row])
        since = t.tick[one.first : one.until] - tick
        at_risk[one.first : one.until] &= (since <= -before - t.per_second) | (since >= before)
        twice = one.first == last_vehicle and tick - before < free_again
        two_lanes = abs(one.lane - int(t.lane[one.start])) != 1
        faults.append(_NO_START if one.start < 0 else _TWICE if twice or two_lanes else _FINE)
        last_vehicle, free_again = one.first, tick + before
    begins = [one.row if one.start < 0 else one.start for one in crossings]
    lanes = [one.lane for one in crossings]
    sampled = np.flatnonzero(at_risk)
    row = np.concatenate([sampled, sampled])
    lane_there = np.concatenate([t.lane[sampled] - 1, t.lane[sampled] + 1])
    there = road.has_lane(row, lane_there)
    row = np.concatenate([row[there], np.array(begins, dtype=np.int64)])
    lane_there = np.concatenate([lane_there[there], np.array(lanes, dtype=np.int64)])
    changed = np.arange(row.size) >= row.size - len(begins)
    fault_of = np.zeros(row.size, dtype=np.int64)
    fault_of[changed] = faults
    return row, lane_there, changed, fault_of


class _Road:
    """The rows of a file sorted along each lane at each moment, so that neighbours of many rows are found at once."""

    def __init__(self, t: LaneTracks, crossings: Sequence[_Crossing]) -> None:
        self._t = t
        beside, lane_beside = _in_two_lanes(t, crossings)
        self._row = np.concatenate([np.arange(t.lane.size), beside])
        lane = np.concatenate([t.lane, lane_beside])
        self._origin = float(t.along.min())
        self._span = float(np.ptp(t.along)) + 1.0
        self._ticks = int(t.tick.max()) + 1
        self._width = int(t.lane.max()) + 3
        stretch, along = self._stretch(self._row), t.along[self._row]
        self._ends = _ends(along, stretch)
        self._codes, place = np.unique(self._code(stretch, lane), return_inverse=True)
        self._lane_ends = _ends(along, place)
        group = place * self._ticks + t.tick[self._row]
        key = self._key(group, along)
        order = np.argsort(key, kind="stable")
        self._sorted, self._group, self._row = key[order], group[order], self._row[order]

    def _stretch(self, row: Ints) -> Ints:
        """Number the recording and direction of travel of rows."""
        return self._t.scene[row] * 2 + self._t.forward[row]

    def _code(self, stretch: Ints, lane: Ints) -> Ints:
        return stretch * self._width + lane + 1

    def _key(self, group: Ints, along: Floats) -> Floats:
        return group * self._span + (along - self._origin)

    def _place(self, row: Ints, lane: Ints) -> tuple[Ints, Bools]:
        """Return the number of a lane beside each row, and whether it was ever driven on in this recording."""
        codes = self._code(self._stretch(row), lane)
        place = np.minimum(np.searchsorted(self._codes, codes), self._codes.size - 1)
        return place, (self._codes[place] == codes) & (lane > 0)

    def has_lane(self, row: Ints, lane: Ints) -> Bools:
        """Tell whether there is a lane beside each row: a vehicle drove in it before this place and beyond it."""
        place, known = self._place(row, lane)
        low, high = self._lane_ends
        along = self._t.along[row]
        return known & (along >= low[place]) & (along <= high[place])

    def neighbour(self, row: Ints, lane: Ints, *, ahead: bool) -> tuple[Floats, Floats, Ints]:
        """Return gap [m], front minus rear speed [m/s] and fault of the next vehicle in a lane, each (k,).

        +inf and 0 where none is in sight.
        """
        t = self._t
        place, known = self._place(row, lane)
        group = place * self._ticks + t.tick[row]
        at = np.searchsorted(self._sorted, self._key(group, t.along[row]), side="right") - (0 if ahead else 1)
        entry = np.clip(at, 0, self._row.size - 1)
        other = self._row[entry]
        sign = 1.0 if ahead else -1.0
        apart = sign * (t.along[other] - t.along[row])
        found = (entry == at) & known & (self._group[entry] == group) & (apart < _SIGHT) & (other != row)
        gap = np.where(found, apart - (t.length[row] + t.length[other]) / 2.0, np.inf)
        rate = np.where(found, sign * (t.speed[other] - t.speed[row]), 0.0)
        low, high = self._ends
        stretch = self._stretch(row)
        end = high[stretch] - t.along[row] if ahead else t.along[row] - low[stretch]
        fault = np.where(found, _fault_of(t, other), np.where(end >= _SIGHT, _FINE, _STRETCH))
        return gap, rate, fault


def _in_two_lanes(t: LaneTracks, crossings: Sequence[_Crossing]) -> tuple[Ints, Ints]:
    """Return the rows near a crossing, and the lane beside that the vehicle counts in too."""
    rows, lanes = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for one in crossings:
        since = t.tick[one.first : one.until] - t.tick[one.row]
        running = np.flatnonzero(np.abs(since) < _IN_BOTH * t.per_second)
        rows.append(running + one.first)
        lanes.append(np.where(since[running] < 0, one.lane, t.lane[one.row - 1]))
    return np.concatenate(rows), np.concatenate(lanes)


def _ends(along: Floats, part: Ints) -> tuple[Floats, Floats]:
    """Return the lowest and highest position of each part [m]; `part` numbers each row's, shape (n,)."""
    count = int(part.max()) + 1
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, part, along)
    np.maximum.at(high, part, along)
    return low, high
