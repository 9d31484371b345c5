"""Lanes that begin and end, for kernels: which lanes are there, where each must be left, and how urgent that is.

Kernels read one table a road (`RoadNumbers.lanes`), in the simulator's x. On a road all of whose lanes go on (`varied`
is False) none of it is looked up.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.road.network import MOST_LANES, Lane, LaneKind, Road

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.types import Odd

__all__ = [
    "EXITS",
    "NO_PLACE",
    "PACE_STEP",
    "ROOM_TO_START",
    "URGENT_TIME",
    "LaneTable",
    "av_lanes_at",
    "has_lane",
    "has_left",
    "hurry",
    "lane_table",
    "lanes_of",
    "may_change",
    "must_leave_by",
    "on_a_ramp",
    "pace_at",
    "room_to_stop",
    "side_to_leave",
    "side_to_leave_lane",
    "takes_exit",
    "urgent_time",
    "way_left",
]  # fmt: skip

URGENT_TIME = 20.0
"""Time before the end of a lane from which drivers want to leave it [s]: at 30 m/s 600 m, the distance at which German
and US signs announce that a lane ends (RSA 21: 400 to 800 m; MUTCD 2009, table 2C-4: 400 m at 70 mph)."""
EXITS = 2
"""Bit of `sim.world.VEHICLE`'s `signals`: it takes the exit."""
NO_PLACE = math.inf
ROOM_TO_START = 20.0
"""Drivers that must stop at the end of a lane leave so much of it to start from [m]."""
_LEAST_SPEED = 5.0
"""Speed with which urgency is reckoned at least [m/s]."""
_SLOW = 8.0
"""Below this speed a lane change takes longer [m/s]."""
_HURRY = 0.55
"""At full urgency a lane change takes so much less of its time."""
PACE_STEP = 25.0
_USUAL, _TO_THE_SIDE, _EASES = 30.0, 2.5, 1.0
_STRETCHES = MOST_LANES
_BEGIN, _END, _LEAVE_BY, _RAMP = range(4)
_NOWHERE = -math.inf


class LaneTable(NamedTuple):
    """Lanes of a road as kernels take them.

    Attributes:
        stretches: By slot and stretch: begin, end, where a vehicle that drives through must have left it (inf:
            nowhere) [m], and 1 for a ramp; one that is not there ends before it begins, (n_lanes, MOST_LANES, 4).
        varied: Some lane begins, ends or may not be left.
        go_on: Lanes that go on from end to end of the road, a bit mask.
        exit_slot: Slot of the lane that leads to the exit, -1: there is no exit.
        exit_by: Where a vehicle that takes the exit must be in that slot [m].
        pace: By slot and every `PACE_STEP` from `pace_from` on: share of its own speed that a driver wants there, at
            most 1, (n_lanes, k); k is 0 where that is 1 on the whole road.
        pace_from: [m].
    """

    stretches: NDArray[np.float64]
    varied: bool
    go_on: int
    exit_slot: int
    exit_by: float
    pace: NDArray[np.float64]
    pace_from: float


def lanes_of(odd: Odd) -> tuple[Lane, ...]:
    """Give the lanes of an ODD's road by slot and begin, along the simulator's x; a straight road's from -inf to inf.

    The first and last lanes of a road from a file go on beyond its ends, as traffic does there too.
    """
    road = odd.road
    if road is None:
        return tuple(Lane(slot, -math.inf, math.inf) for slot in range(odd.n_lanes))
    return tuple(
        replace(
            lane,
            begin=lane.begin - odd.road_at if lane.begin > 0.0 else -math.inf,
            end=lane.end - odd.road_at if lane.end < road.length else math.inf,
            left=tuple(replace(line, s=line.s - odd.road_at) for line in lane.left),
            right=tuple(replace(line, s=line.s - odd.road_at) for line in lane.right),
        )
        for lane in road.lanes
    )


def _leave_by(road: Road, lane: Lane) -> float:
    """Find where a vehicle that drives through must have left a lane; inf: it may stay to the road's end or exit."""
    while lane.end < road.length:
        after = road.open_after(lane)
        if lane.kind == "deceleration" or (after is None and lane.kind != "ramp"):
            return lane.end
        if after is None:
            return math.inf
        lane = after
    return math.inf


def lane_table(odd: Odd) -> LaneTable:
    """Make the table of an ODD's lanes."""
    road = odd.road
    table = np.zeros((odd.n_lanes, _STRETCHES, 4))
    table[:, :, _BEGIN], table[:, :, _END], table[:, :, _LEAVE_BY] = math.inf, -math.inf, math.inf
    if road is None:
        table[:, 0, _BEGIN], table[:, 0, _END] = -math.inf, math.inf
        return LaneTable(table, False, (1 << odd.n_lanes) - 1, -1, math.inf, np.ones((odd.n_lanes, 0)), 0.0)
    exit_slot, exit_by = -1, math.inf
    for slot in range(odd.n_lanes):
        rows: list[list[float]] = []
        for lane, shown in zip(road.lanes, lanes_of(odd), strict=True):
            if lane.slot != slot or lane.kind == "closed":
                continue
            by, is_ramp = _leave_by(road, lane) - odd.road_at, float(lane.kind == "ramp")
            if lane.kind == "deceleration":
                exit_slot, exit_by = slot, shown.end
            if rows and rows[-1][_END] == shown.begin and rows[-1][2:] == [by, is_ramp]:
                rows[-1][_END] = shown.end
            else:
                rows.append([shown.begin, shown.end, by, is_ramp])
        table[slot, : len(rows)] = np.reshape(rows, (-1, 4))  # a slot may be closed all along
    whole = (table[:, 0, _BEGIN] == -math.inf) & (table[:, 0, _END] == math.inf)
    go_on = sum(1 << int(slot) for slot in np.flatnonzero(whole & np.isinf(table[:, 0, _LEAVE_BY])))
    return LaneTable(table, not whole.all(), go_on, exit_slot, exit_by, _paces(road), -odd.road_at)


def _paces(road: Road) -> NDArray[np.float64]:
    """Compute `LaneTable.pace`: less where a lane's limit is below the road's highest, or a curve is tight.

    Drivers drive as fast relative to the limit as elsewhere, and with 2.5 m/s2 to the side at most at 30 m/s; 1 m/s2
    slows them down before.
    """
    s = np.arange(0.0, road.length, PACE_STEP)
    highest = max((lane.limit for lane in road.lanes if lane.limit is not None), default=math.inf)
    found = np.ones((road.slots, s.size))
    for lane in road.lanes:
        if lane.limit is not None:
            found[lane.slot, (s >= lane.begin) & (s < lane.end)] = lane.limit / highest
    bends = np.abs(road.line.at(s).curvature)
    found = np.minimum(found, np.sqrt(_TO_THE_SIDE / np.maximum(bends, 1e-9)) / _USUAL)
    for k in range(s.size - 2, -1, -1):
        eased = np.sqrt(found[:, k + 1] ** 2 + 2.0 * _EASES * PACE_STEP / _USUAL**2)
        found[:, k] = np.minimum(found[:, k], eased)
    return found if (found < 1.0).any() else found[:, :0]


def av_lanes_at(odd: Odd, x: float) -> tuple[int, ...]:
    """Say in which lanes the AV may start at x [m]: on the ramp, or on the road, by its task."""
    wanted: set[LaneKind] = {"ramp", "acceleration"} if odd.task == "ramp" else {"through"}
    return tuple(lane.slot for lane in lanes_of(odd) if lane.kind in wanted and lane.begin <= x < lane.end)


@inlined_kernel
def _stretch(lane: int, x: float, road: RoadNumbers) -> int:
    """Find the stretch of a slot that x lies on, -1: there is no lane."""
    for k in range(_STRETCHES):
        if road.lanes.stretches[lane, k, _BEGIN] <= x < road.lanes.stretches[lane, k, _END]:
            return k
    return -1


@inlined_kernel
def pace_at(v: NDArray[np.void], i: int, road: RoadNumbers) -> float:
    """Find the share of its own speed that vehicle i wants where it is, for limits and curves."""
    steps = road.lanes.pace.shape[1]
    if steps == 0:
        return 1.0
    k = math.floor((v[i].x - road.lanes.pace_from) / PACE_STEP)
    pace: float = road.lanes.pace[v[i].target_lane, k] if 0 <= k < steps else 1.0
    return pace


@inlined_kernel
def takes_exit(v: NDArray[np.void], i: int) -> bool:
    """Does vehicle i take the exit?"""
    exits: bool = v[i].signals & EXITS != 0
    return exits


@inlined_kernel
def has_lane(lane: int, x: float, road: RoadNumbers) -> bool:
    """Is there a lane in a slot at x, open to traffic, ramps too?"""
    if lane < 0 or lane >= road.n_lanes:
        return False
    return not road.lanes.varied or _stretch(lane, x, road) >= 0


@inlined_kernel
def on_a_ramp(lane: int, x: float, road: RoadNumbers) -> bool:
    """Is the lane in a slot at x a ramp, which none may leave?"""
    if not road.lanes.varied:
        return False
    k = _stretch(lane, x, road)
    return k >= 0 and road.lanes.stretches[lane, k, _RAMP] == 1.0


@inlined_kernel
def may_change(v: NDArray[np.void], i: int, lane: int, road: RoadNumbers) -> bool:
    """May vehicle i change from the lane that it keeps to `lane` where it is now? Gaps are not looked at."""
    if lane < 0 or lane >= road.n_lanes:
        return False
    if not road.lanes.varied:
        return True
    return _may_cross(v, i, lane, road)


@kernel
def _may_cross(v: NDArray[np.void], i: int, lane: int, road: RoadNumbers) -> bool:
    there = has_lane(lane, v[i].x, road) and not on_a_ramp(lane, v[i].x, road)
    return there and not on_a_ramp(v[i].target_lane, v[i].x, road)


@inlined_kernel
def must_leave_by(lane: int, x: float, exits: bool, road: RoadNumbers) -> float:
    """Find where a vehicle at x must have left a lane; inf: nowhere; -inf: there is no lane.

    Args:
        lane: Slot.
        x: Where the vehicle is [m].
        exits: It takes the exit.
        road: Constants.
    """
    k = _stretch(lane, x, road)
    if k < 0:
        return _NOWHERE
    if exits and lane == road.lanes.exit_slot:
        return NO_PLACE
    by: float = road.lanes.stretches[lane, k, _LEAVE_BY]
    return by


@inlined_kernel
def way_left(v: NDArray[np.void], i: int, lane: int, road: RoadNumbers) -> float:
    """Compute how far vehicle i might drive in a lane [m]; inf: it goes on; -inf: there is none."""
    left: float = must_leave_by(lane, v[i].x, takes_exit(v, i), road) - v[i].x
    return left


@inlined_kernel
def urgent_time(i: int, road: RoadNumbers) -> float:
    """Compute the time before the end of a lane from which vehicle i wants to leave it [s]; the AV's is never drawn."""
    return URGENT_TIME if i == 0 else URGENT_TIME * road.law.urgent_time


@inlined_kernel
def side_to_leave(v: NDArray[np.void], i: int, road: RoadNumbers) -> tuple[int, float]:
    """Find the side to which vehicle i must change lanes sooner or later, and how urgent that is.

    The urgency grows from 0, `urgent_time` before the lane must be left, to 1 there; for each further lane to cross to
    an exit it begins so much earlier.

    Returns:
        1 left, -1 right, 0: it need not change; urgency from 0 to 1.
    """
    if not road.lanes.varied or (not takes_exit(v, i) and (road.lanes.go_on >> v[i].target_lane) & 1):
        return 0, 0.0
    return side_to_leave_lane(v, i, v[i].target_lane, road)


@kernel
def side_to_leave_lane(v: NDArray[np.void], i: int, lane: int, road: RoadNumbers) -> tuple[int, float]:
    """Do the same as `side_to_leave` for vehicle i in another lane."""
    x, exits = v[i].x, takes_exit(v, i)
    lanes = 1
    if exits and lane != road.lanes.exit_slot:
        by = road.lanes.exit_by
        lanes = abs(lane - road.lanes.exit_slot)
        side = 1 if road.lanes.exit_slot > lane else -1
        if x >= by:  # the exit is missed
            by = NO_PLACE
    else:
        by = must_leave_by(lane, x, exits, road)
        if by == NO_PLACE:
            return 0, 0.0
        left = must_leave_by(lane + 1, x, exits, road) if lane + 1 < road.n_lanes else _NOWHERE
        right = must_leave_by(lane - 1, x, exits, road) if lane > 0 else _NOWHERE
        side = 1 if left >= right else -1
    if not -NO_PLACE < by < NO_PLACE:
        return 0, 0.0
    time = (by - x) / (max(v[i].speed, _LEAST_SPEED) * lanes)
    urgency = min(1.0, 1.0 - time / urgent_time(i, road))
    return (side, urgency) if urgency > 0.0 else (0, 0.0)


@inlined_kernel
def hurry(v: NDArray[np.void], i: int, road: RoadNumbers) -> float:
    """Compute the part of its usual time that a lane change of vehicle i takes: less where it must leave its lane.

    A vehicle that stands takes twice the time, as it must begin to move first.
    """
    urgency = side_to_leave(v, i, road)[1]
    if urgency == 0.0:
        return 1.0
    slow: float = max(0.0, 1.0 - v[i].speed / _SLOW)
    return 1.0 - _HURRY * urgency + slow


@inlined_kernel
def room_to_stop(v: NDArray[np.void], i: int, road: RoadNumbers) -> float:
    """Compute the room in which vehicle i must come to a stop, unless it leaves its lane [m]; inf: its lane goes on."""
    by = must_leave_by(v[i].target_lane, v[i].x, takes_exit(v, i), road)
    if v[i].target_lane == road.lanes.exit_slot:
        by = NO_PLACE  # it takes the exit if it cannot merge
    if by == _NOWHERE:
        return NO_PLACE
    room: float = by - v[i].x - 0.5 * v[i].length - ROOM_TO_START
    return max(room, 0.1)


@inlined_kernel
def has_left(v: NDArray[np.void], i: int, road: RoadNumbers) -> bool:
    """Is vehicle i where no lane is any more? The lane of its centre counts."""
    lane = min(max(math.floor(v[i].y / road.lane_width), 0), road.n_lanes - 1)
    return _stretch(lane, v[i].x, road) < 0
