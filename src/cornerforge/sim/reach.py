"""Vehicles that can touch each other within the coming second, or that the AV can see: only these move in substeps.

All bounds of motion hold for certain, so leaving out the other vehicles changes no bit of any result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel
from cornerforge.road.straight import ahead_by
from cornerforge.sim.neighbours import SIGHT
from cornerforge.sim.world import NO_VEHICLE, UNKNOWN, all_current

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.world import World

__all__ = ["bound_motion", "choose_current", "find_pairs", "pairs_of_av"]

_ROUNDING = 0.01
"""Added to bounds of motion [m], far more than rounding errors."""
_SWING = 2.5
"""Half length of a body for which the other bounds already cover its swing in a turn [m]; longer bodies get more."""
_HARDEST_TURNING = 12.0
"""More than any AV that steers accelerates in any direction [m/s2]: 8 along its way and 8 across it."""
_UNSURE = 1
"""Mark of a vehicle that may leave its lane or the road within the second."""
_ALL_LANES = -1


@inlined_kernel
def _lateral_reach(w: World, i: int, road: RoadNumbers) -> float:
    """Bound from above how far slot i, a long body's ends included, moves sideways within the coming second [m]."""
    v = w.vehicles
    if i == 0 and w.av[0].steers:
        far: float = abs(v[0].lateral_speed) + 0.5 * _HARDEST_TURNING + v[0].length
        return far
    if i > 0 and v[i].duration == 0.0:
        return 0.0
    swing: float = max(0.0, 0.5 * v[i].length - _SWING)
    return swing + (road.lane_width if v[i].change_time >= 2.0 else 2.0 * road.lane_width)


@inlined_kernel
def bound_motion(w: World, braking: float, acceleration: float, s: Scratch) -> None:
    """Write bounds of how far each vehicle drives within the coming second into `s.least` and `s.most`.

    A BV's acceleration lies between the one it has and the commanded one, or is 0 at standstill and at the highest
    speed. The AV may decide again: it brakes with at most `braking` and accelerates with at most `acceleration` [m/s2],
    or as now. At any time within the second, the lead of one vehicle over another changes by no more than the
    difference of their bounds at its end: t (d + c t / 2) for 0 <= t <= 1 and c >= 0 is at most max(0, d + c / 2).
    """
    v = w.vehicles
    for i in range(w.state[0].n_vehicles):
        s.least[i] = v[i].speed + 0.5 * min(0.0, min(v[i].commanded, v[i].acceleration))
        s.most[i] = v[i].speed + 0.5 * max(0.0, max(v[i].commanded, v[i].acceleration))
    s.least[0] = v[0].speed - 0.5 * max(braking, -v[0].acceleration)
    s.most[0] = v[0].speed + 0.5 * max(acceleration, v[0].acceleration)


@inlined_kernel
def find_pairs(w: World, road: RoadNumbers, s: Scratch) -> None:
    """List the pairs of vehicles that can touch within the coming second.

    By the bounds of `bound_motion`: testing only these pairs gives the same bits as testing all.
    """
    v = w.vehicles
    order = w.order
    state = w.state[0]
    n = state.n_vehicles
    found = 0
    least = np.inf
    for i in range(n):
        if v[i].present:
            least = min(least, s.least[i])
    for rank in range(n):
        i = order[rank]
        if v[i].present == 0:
            continue
        reach = _lateral_reach(w, i, road)
        limit = road.longest + 1.0 + max(0.0, s.most[i] - least)
        for other in range(rank + 1, n):
            j = order[other]
            dx = ahead_by(v, i, j)
            if dx > limit:
                break
            if v[j].present == 0 or dx > road.longest + 1.0 + max(0.0, s.most[i] - s.least[j]):
                continue
            if abs(v[j].y - v[i].y) < road.widest + 1.0 + reach + _lateral_reach(w, j, road):
                w.pairs[found, 0] = min(i, j)
                w.pairs[found, 1] = max(i, j)
                found += 1
    state.n_pairs = found


@inlined_kernel
def pairs_of_av(w: World) -> None:
    """List all pairs of the AV with another vehicle: on rails there is no bound of motion."""
    state = w.state[0]
    for j in range(1, state.n_vehicles):
        w.pairs[j - 1, 0] = 0
        w.pairs[j - 1, 1] = j
    state.n_pairs = max(0, state.n_vehicles - 1)


@inlined_kernel
def _falls_back(s: Scratch, j: int) -> float:
    """Bound from above how far vehicle j falls back against the AV within the coming second [m]."""
    loss: float = max(0.0, s.most[0] - s.least[j]) + _ROUNDING
    return loss


@inlined_kernel
def _gains(s: Scratch, j: int) -> float:
    """Bound from above how far vehicle j gains on the AV within the coming second [m]."""
    gain: float = max(0.0, s.most[j] - s.least[0]) + _ROUNDING
    return gain


@inlined_kernel
def _bound_av_neighbours(w: World, s: Scratch, road: RoadNumbers) -> None:
    """Bound how far ahead and behind the AV's nearest vehicle of each lane can be within the coming second.

    The bound is the nearest vehicle that certainly stays in the lane, and certainly ahead (or behind). That is not
    certain of a vehicle that changes lanes, or that may crash and be taken off the road.
    """
    v = w.vehicles
    for lane in range(road.n_lanes):
        s.ahead[lane] = SIGHT
        s.behind[lane] = SIGHT
    for j in range(1, w.state[0].n_vehicles):
        lane = v[j].target_lane
        if v[j].present and s.is_watched[j] != _UNSURE and v[j].lanes == 1 << lane:
            dx = ahead_by(v, 0, j)
            if dx > _falls_back(s, j):
                s.ahead[lane] = min(s.ahead[lane], dx + _gains(s, j))
            elif -dx > _gains(s, j):
                s.behind[lane] = min(s.behind[lane], _falls_back(s, j) - dx)


@inlined_kernel
def _lanes_to_come(v: NDArray[np.void], j: int) -> int:
    """Find the lanes that vehicle j may be seen in within the coming second, as a bit mask.

    Lateral paths are planned between two seconds. One that began at rest leads straight from lane to lane. One that was
    planned again on the way may swing first: that vehicle may be seen in any lane.
    """
    if v[j].duration > 0.0 and (v[j].c1 != 0.0 or v[j].c2 != 0.0):
        return _ALL_LANES
    lanes: int = v[j].lanes
    return lanes


@inlined_kernel
def _is_seen(w: World, j: int, s: Scratch, road: RoadNumbers) -> bool:
    """Can vehicle j be the AV's nearest one ahead or behind in some lane within the coming second?"""
    v = w.vehicles
    dx = ahead_by(v, 0, j)
    nearest = dx - _falls_back(s, j)
    farthest = dx + _gains(s, j)
    lane = v[j].target_lane
    if v[j].duration == 0.0 and v[j].lanes == 1 << lane:
        seen: bool = nearest <= s.ahead[lane] and farthest >= -s.behind[lane]
        return seen
    lanes = _lanes_to_come(v, j)
    for lane in range(road.n_lanes):
        if lanes & (1 << lane) and nearest <= s.ahead[lane] and farthest >= -s.behind[lane]:
            return True
    return False


@inlined_kernel
def _note_av_neighbour(w: World, j: int, s: Scratch) -> None:
    """Note vehicle j, which the AV may see and which keeps its lane, as the AV's lead or rear there.

    Where it could be both within the second, or is not the only one, the lane becomes UNKNOWN: all must be looked at.
    """
    v = w.vehicles
    lane = v[j].target_lane
    dx = ahead_by(v, 0, j)
    nearest = w.av[0].lead if dx > 0.0 else w.av[0].rear
    if -_gains(s, j) <= dx <= _falls_back(s, j) or nearest[lane] != NO_VEHICLE:
        w.av[0].lead[lane] = UNKNOWN
    else:
        nearest[lane] = j


@inlined_kernel
def choose_current(w: World, s: Scratch, everybody: bool, road: RoadNumbers) -> None:
    """List the vehicles that are kept current within the second, into `w.current`.

    First the AV and the vehicles that it may look at, then the vehicles that may touch another or that change lanes;
    with `everybody`, all.
    """
    if everybody:
        all_current(w)
        return
    v = w.vehicles
    state = w.state[0]
    n = state.n_vehicles
    for i in range(n):
        s.is_watched[i] = _UNSURE if v[i].duration > 0.0 else 0
    for k in range(state.n_pairs):
        s.is_watched[w.pairs[k, 0]] = _UNSURE
        s.is_watched[w.pairs[k, 1]] = _UNSURE
    _bound_av_neighbours(w, s, road)
    for lane in range(road.n_lanes):
        w.av[0].lead[lane] = NO_VEHICLE
        w.av[0].rear[lane] = NO_VEHICLE
    w.current[0] = 0
    unsure = 0
    found = 1
    for j in range(1, n):
        if v[j].present and _is_seen(w, j, s, road):
            s.is_watched[j] = 0
            w.current[found] = j
            found += 1
            if v[j].duration == 0.0 and v[j].lanes == 1 << v[j].target_lane:
                _note_av_neighbour(w, j, s)
            else:
                unsure |= _lanes_to_come(v, j)
    state.n_seen = found
    for lane in range(road.n_lanes):
        if unsure & (1 << lane):
            w.av[0].lead[lane] = UNKNOWN
    for j in range(1, n):
        if s.is_watched[j] and v[j].present:
            w.current[found] = j
            found += 1
    state.n_current = found
