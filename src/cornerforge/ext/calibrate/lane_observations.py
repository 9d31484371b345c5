"""Lane changes in recorded trajectories: how often, and into which gaps. The file must give each row's lane.

Shapes: `n` rows of a file, sorted by vehicle and time; `c` lane changes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.decisions import smooth_tracks
from cornerforge.ext.calibrate.readers import Reading, ticks
from cornerforge.ext.calibrate.row_checks import MEAN_LENGTH, drivers
from cornerforge.ext.calibrate.whole_tracks import direction_of_travel, position_along
from cornerforge.types import METRES_PER_MILE

__all__ = [
    "DWELL",
    "START_BEFORE",
    "LaneObservations",
    "LaneTracks",
    "Transition",
    "lane_crossings",
    "lane_tracks",
    "observe_lane_changes",
    "transitions_of",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

START_BEFORE = 2.0
"""Time from the start of a lane change (of 4-6 s) to the row that gives the new lane [s]; gaps are taken at the
start."""
DWELL = 0.5
"""Least time in a lane [s]; a shorter stay is noise of the lane number."""
_SEEN_AHEAD = 120.0
_FASTEST = 70.0


@dataclass(frozen=True)
class LaneObservations:
    """Lane changes of one file.

    Attributes:
        vehicles: Number of vehicles with a known lane, with or without a lane change.
        miles: Distance of each, shape (vehicles,).
        miles_fast: Part of it at speed `fast` and above, shape (vehicles,).
        vehicle: Vehicle that changed lanes, 0 to vehicles - 1, shape (c,).
        speed: Speed at the start of the change [m/s], shape (c,). NaN, here and below, where the track begins later.
        lead_gap: Bumper-to-bumper distance to the lead in the new lane [m]; +inf without a lead within 120 m; NaN
            where the recorded stretch of road ends before.
        lead_rate: Lead's speed minus the subject's [m/s]; 0 without a lead.
        rear_gap, rear_rate: The same for the rear; the rate is subject minus rear, negative when the rear closes.
    """

    vehicles: int
    miles: Floats = field(metadata={"unit": "mile"})
    miles_fast: Floats = field(metadata={"unit": "mile"})
    vehicle: Ints
    speed: Floats = field(metadata={"unit": "m/s"})
    lead_gap: Floats = field(metadata={"unit": "m"})
    lead_rate: Floats = field(metadata={"unit": "m/s"})
    rear_gap: Floats = field(metadata={"unit": "m"})
    rear_rate: Floats = field(metadata={"unit": "m/s"})


@dataclass(frozen=True)
class Transition:
    """The vehicles of two lanes at the moment `START_BEFORE` seconds before one of them changed from one to the other.

    Attributes:
        vehicle: Vehicle that changed; unique within the file.
        along: Centres [m], the changed vehicle's first, shape (m,).
        speed: Speeds [m/s], shape (m,).
        length: Lengths [m], shape (m,).
        in_target: Which are in the lane that it changed to, shape (m,).
        to_left: The lane that it changed to has the lower number, as to the left in NGSIM.
        lane: Number of the lane that it left, as the file says.
    """

    vehicle: int
    along: Floats = field(metadata={"unit": "m"})
    speed: Floats = field(metadata={"unit": "m/s"})
    length: Floats = field(metadata={"unit": "m"})
    in_target: NDArray[np.bool_]
    to_left: bool
    lane: int = 0


@dataclass(frozen=True)
class LaneTracks:
    """The usable rows of a file, sorted by vehicle and tick, struct-of-arrays of shape (n,).

    Attributes:
        vehicle: Number of the vehicle, 0 and up.
        tick: Time in steps from the start of the file.
        scene: Number of the recording.
        lane: As the file says; 0: not known.
        along: Centre, growing in the direction of travel [m].
        forward: The file's own positions give the direction of travel.
        speed: NaN where the track is too short to be smoothed [m/s].
        length: Length of the vehicle [m].
        per_second: Ticks in a second.
    """

    vehicle: Ints
    tick: Ints
    scene: Ints
    lane: Ints
    along: Floats = field(metadata={"unit": "m"})
    forward: NDArray[np.bool_]
    speed: Floats = field(metadata={"unit": "m/s"})
    length: Floats = field(metadata={"unit": "m"})
    per_second: int = field(metadata={"unit": "1/s"})


def observe_lane_changes(reading: Reading, *, fast: float) -> LaneObservations | None:
    """Find the lane changes of a file; None if its layout does not give each row's lane.

    Args:
        reading: The file, already read.
        fast: Speed from which miles count as fast [m/s].
    """
    if reading.layout.kind != "lanes":
        return None
    tracks = lane_tracks(reading)
    same = np.diff(tracks.vehicle) == 0
    step = same & (np.diff(tracks.tick) == 1)
    moved = np.where(step, np.maximum(np.diff(tracks.along), 0.0), 0.0) / METRES_PER_MILE
    vehicles = int(tracks.vehicle[-1]) + 1 if tracks.vehicle.size else 0
    owner = tracks.vehicle[:-1]
    is_fast = np.nan_to_num(tracks.speed[:-1]) >= fast
    found = lane_crossings(tracks, step)
    rows = [_gaps_at(tracks, before, new_lane) for before, new_lane in found]
    columns = np.array(rows, dtype=np.float64).reshape(len(rows), 5).T
    return LaneObservations(
        vehicles,
        np.bincount(owner, weights=moved, minlength=vehicles).astype(np.float64),
        np.bincount(owner, weights=moved * is_fast, minlength=vehicles).astype(np.float64),
        np.array([tracks.vehicle[abs(before)] for before, _ in found], dtype=np.int64),
        *columns,
    )


def transitions_of(reading: Reading) -> list[Transition] | None:
    """Find the lane changes with the vehicles that were seen around them; None if the file gives no row's lane.

    A vehicle that was in the new lane `START_BEFORE` seconds before, or was not seen then, is not among them. One
    outside the recorded stretch counts as absent.
    """
    if reading.layout.kind != "lanes":
        return None
    t = lane_tracks(reading)
    found = []
    for row, lane in lane_crossings(t, (np.diff(t.vehicle) == 0) & (np.diff(t.tick) == 1)):
        if row < 0 or not np.isfinite(t.speed[row]) or t.lane[row] == lane:
            continue
        beside = (t.scene == t.scene[row]) & (t.forward == t.forward[row])
        there = np.flatnonzero((t.tick == t.tick[row]) & beside & np.isfinite(t.speed))
        there = there[np.isin(t.lane[there], (lane, t.lane[row])) & (there != row)]
        rows = np.concatenate([[row], there])
        found.append(
            Transition(
                int(t.vehicle[row]), t.along[rows], t.speed[rows], t.length[rows], t.lane[rows] == lane,
                bool(lane < t.lane[row]), int(t.lane[row]),
            )
        )  # fmt: skip
    return found


def lane_tracks(reading: Reading) -> LaneTracks:
    """Return the usable rows of a file, smoothed like its decisions."""
    layout, table = reading.layout, reading.table
    vehicle = drivers(table)
    tick, per_second = ticks(table, vehicle)
    position, _ = position_along(table, layout)
    forward = direction_of_travel(table, position)
    length = table.numbers.get("length", np.full(position.size, MEAN_LENGTH))
    along = np.where(forward, position, -position) - (length / 2.0 if layout.front else 0.0)
    keep = np.concatenate([[True], (np.diff(vehicle) != 0) | (np.diff(tick) > 0)])
    vehicle, tick, along = vehicle[keep], tick[keep], along[keep]
    smooth, speed = smooth_tracks(vehicle, tick, along, 1.0 / per_second, layout.window)
    return LaneTracks(
        vehicle=vehicle, tick=tick, scene=table.texts.get("recording", np.zeros_like(keep, dtype=np.int64))[keep],
        lane=np.rint(table.numbers["lane"][keep]).astype(np.int64), along=np.where(np.isfinite(smooth), smooth, along),
        forward=forward[keep], speed=speed, length=length[keep], per_second=per_second,
    )  # fmt: skip


def lane_crossings(t: LaneTracks, step: NDArray[np.bool_], *, before_s: float = START_BEFORE) -> list[tuple[int, int]]:
    """Return for each lane change the row `before_s` seconds before it, and the new lane.

    Where the track begins later, the value is minus the row of the change itself.
    """
    dwell = max(round(DWELL * t.per_second), 1)
    before = round(before_s * t.per_second)
    crossing = np.flatnonzero(step & (t.lane[1:] != t.lane[:-1]) & (t.lane[1:] > 0) & (t.lane[:-1] > 0)) + 1
    found = []
    for row in crossing:
        old, new = slice(max(row - dwell, 0), row), slice(row, row + dwell)
        steady = all(
            (t.lane[part] == t.lane[at]).all() and (t.vehicle[part] == t.vehicle[row]).all()
            for part, at in ((old, row - 1), (new, row))
        )
        if steady:
            start = row - before
            is_seen = start >= 0 and t.vehicle[start] == t.vehicle[row] and t.tick[start] == t.tick[row] - before
            found.append((int(start) if is_seen else -int(row), int(t.lane[row])))
    return found


def _gaps_at(t: LaneTracks, row: int, lane: int) -> tuple[float, float, float, float, float]:
    """Return speed, lead gap, lead rate, rear gap, rear rate of a row's vehicle in another lane at that row's time."""
    if row < 0 or not np.isfinite(t.speed[row]):
        return (np.nan,) * 5
    beside = (t.scene == t.scene[row]) & (t.forward == t.forward[row])
    at = np.flatnonzero((t.tick == t.tick[row]) & beside)
    stretch = t.along[beside]
    others = at[(t.lane[at] == lane) & (at != row)]
    found = [float(t.speed[row])]
    for side, end in ((1.0, stretch.max() - t.along[row]), (-1.0, t.along[row] - stretch.min())):
        ahead = side * (t.along[others] - t.along[row])
        near = others[(ahead > 0.0) & (ahead < _SEEN_AHEAD)]
        if near.size:
            other = near[np.argmin(side * (t.along[near] - t.along[row]))]
            between = (t.length[row] + t.length[other]) / 2.0
            found += [
                float(side * (t.along[other] - t.along[row]) - between),
                float(side * (t.speed[other] - t.speed[row])),
            ]
        else:
            found += [np.inf if end >= _SEEN_AHEAD else np.nan, 0.0]
    return found[0], found[1], found[2], found[3], found[4]
