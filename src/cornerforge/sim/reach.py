"""Who can touch whom within the coming second, and whom the AV can see: nobody else need be moved in between.

All by bounds of motion that surely hold, so what is left out changes no bit of any result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel
from cornerforge.sim.av_kinds import AvScratch, allocate_av_scratch
from cornerforge.sim.neighbours import SIGHT
from cornerforge.sim.world import (
    AV_LEADS,
    AV_REARS,
    N_CURRENT,
    N_SEEN,
    N_VEHICLES,
    UNKNOWN,
    all_current,
    forget_av_neighbours,
)
from cornerforge.types import MAX_LANES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.world import RoadNumbers, World

__all__ = ["Pairs", "allocate_pairs", "bound_motion", "choose_current", "find_pairs"]

_ROUNDING = 0.01
"""Added to bounds of motion [m], far more than rounding errors."""
_UNSURE = 1
"""Mark of a vehicle that may leave its lane or the road within the second."""


class Pairs(NamedTuple):
    """Scratch: pairs of slots that can touch within the coming second, (capacity,), and who must be moved in between.

    Attributes:
        a, b: Slots of each pair, a < b.
        least, most: How far a slot drives within the second at least and at most, (N,) [m].
        is_watched: _UNSURE for slots that change lanes or may touch somebody, else 0, (N,).
        ahead, behind: How far off the AV's nearest vehicle of each lane is at most, (MAX_LANES,) [m].
        av: Scratch of the AV.
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    least: NDArray[np.float64]
    most: NDArray[np.float64]
    is_watched: NDArray[np.int64]
    ahead: NDArray[np.float64]
    behind: NDArray[np.float64]
    av: AvScratch


def allocate_pairs(slots: int) -> Pairs:
    """Scratch for worlds of so many slots."""
    a, b, is_watched = (np.zeros(size * slots, dtype=np.int64) for size in (8, 8, 1))
    least, most, ahead, behind = (np.zeros(size) for size in (slots, slots, MAX_LANES, MAX_LANES))
    return Pairs(a, b, least, most, is_watched, ahead, behind, av=allocate_av_scratch())


@inlined_kernel
def _lateral_reach(w: World, i: int, road: RoadNumbers) -> float:
    """Upper bound of the sideways movement of slot i within the coming second [m]."""
    v = w.vehicles
    if i > 0 and v[i].duration == 0.0:
        return 0.0
    return road.lane_width if road.lane_change_duration >= 2.0 else 2.0 * road.lane_width


@inlined_kernel
def bound_motion(w: World, braking: float, acceleration: float, pairs: Pairs) -> None:
    """Bound how far everybody drives within the coming second, into `pairs.least` and `pairs.most`.

    Accelerations are constant or change at most to 0 (at standstill and at the highest speed), but the AV may decide
    anew: it brakes with at most `braking` and accelerates with at most `acceleration` [m/s2]. The lead of one vehicle
    over another then changes by no more than the difference of their bounds at the second's end, at any time within it:
    t (d + c t / 2) for 0 <= t <= 1 and c >= 0 is at most max(0, d + c / 2).
    """
    v = w.vehicles
    for i in range(w.info[N_VEHICLES]):
        pairs.least[i] = v[i].speed + 0.5 * min(0.0, v[i].acceleration)
        pairs.most[i] = v[i].speed + 0.5 * max(0.0, v[i].acceleration)
    pairs.least[0] = v[0].speed - 0.5 * braking
    pairs.most[0] = v[0].speed + 0.5 * acceleration


@inlined_kernel
def find_pairs(w: World, road: RoadNumbers, pairs: Pairs) -> int:
    """List the pairs of vehicles that can touch within the coming second; returns their number.

    By the bounds of `bound_motion`: testing only these is bitwise the same as testing all.
    """
    v = w.vehicles
    order = w.order
    info = w.info
    n = info[N_VEHICLES]
    found = 0
    least = np.inf
    for i in range(n):
        if v[i].present:
            least = min(least, pairs.least[i])
    for rank in range(n):
        i = order[rank]
        if v[i].present == 0:
            continue
        reach = _lateral_reach(w, i, road)
        limit = road.length + 1.0 + max(0.0, pairs.most[i] - least)
        for other in range(rank + 1, n):
            j = order[other]
            dx = v[j].x - v[i].x
            if dx > limit:
                break
            if v[j].present == 0 or dx > road.length + 1.0 + max(0.0, pairs.most[i] - pairs.least[j]):
                continue
            if abs(v[j].y - v[i].y) < road.width + 1.0 + reach + _lateral_reach(w, j, road) and found < pairs.a.size:
                pairs.a[found] = min(i, j)
                pairs.b[found] = max(i, j)
                found += 1
    return found


@inlined_kernel
def _falls_back(pairs: Pairs, j: int) -> float:
    """Upper bound of what vehicle j loses against the AV within the coming second [m]."""
    loss: float = max(0.0, pairs.most[0] - pairs.least[j]) + _ROUNDING
    return loss


@inlined_kernel
def _gains(pairs: Pairs, j: int) -> float:
    """Upper bound of what vehicle j gains on the AV within the coming second [m]."""
    gain: float = max(0.0, pairs.most[j] - pairs.least[0]) + _ROUNDING
    return gain


@inlined_kernel
def _bound_av_neighbours(w: World, pairs: Pairs, road: RoadNumbers) -> None:
    """Bound how far ahead and behind the AV's nearest vehicle of each lane can be within the coming second.

    The nearest vehicle that surely stays in the lane, and surely ahead (or behind), is the bound. Who changes lanes or
    may crash (and be taken off the road) is not sure.
    """
    v = w.vehicles
    for lane in range(road.n_lanes):
        pairs.ahead[lane] = SIGHT
        pairs.behind[lane] = SIGHT
    for j in range(1, w.info[N_VEHICLES]):
        lane = v[j].target_lane
        if v[j].present and pairs.is_watched[j] != _UNSURE and v[j].lanes == 1 << lane:
            dx = v[j].x - v[0].x
            if dx > _falls_back(pairs, j):
                pairs.ahead[lane] = min(pairs.ahead[lane], dx + _gains(pairs, j))
            elif -dx > _gains(pairs, j):
                pairs.behind[lane] = min(pairs.behind[lane], _falls_back(pairs, j) - dx)


@inlined_kernel
def _is_seen(w: World, j: int, pairs: Pairs, road: RoadNumbers) -> bool:
    """Can vehicle j be the AV's nearest one ahead or behind in some lane within the coming second?"""
    v = w.vehicles
    dx = v[j].x - v[0].x
    nearest = dx - _falls_back(pairs, j)
    farthest = dx + _gains(pairs, j)
    lane = v[j].target_lane
    if v[j].lanes == 1 << lane:
        seen: bool = nearest <= pairs.ahead[lane] and farthest >= -pairs.behind[lane]
        return seen
    for lane in range(road.n_lanes):
        if v[j].lanes & (1 << lane) and nearest <= pairs.ahead[lane] and farthest >= -pairs.behind[lane]:
            return True
    return False


@inlined_kernel
def _note_av_neighbour(w: World, j: int, pairs: Pairs) -> None:
    """Note vehicle j, which the AV may see and which keeps its lane, as the AV's lead or rear there.

    A lane where it could be either within the second, or is not the only one, is left to a look at all.
    """
    v = w.vehicles
    info = w.info
    lane = v[j].target_lane
    dx = v[j].x - v[0].x
    place = AV_LEADS + lane if dx > 0.0 else AV_REARS + lane
    if -_gains(pairs, j) <= dx <= _falls_back(pairs, j) or info[place] != -1:
        info[AV_LEADS + lane] = UNKNOWN
    else:
        info[place] = j


@inlined_kernel
def choose_current(w: World, pairs: Pairs, n_pairs: int, everybody: bool, road: RoadNumbers) -> None:
    """List whose state is kept current: AV, whom it may look at, then who may touch somebody or changes lanes."""
    if everybody:
        all_current(w)
        return
    v = w.vehicles
    info = w.info
    n = info[N_VEHICLES]
    for i in range(n):
        pairs.is_watched[i] = _UNSURE if v[i].duration > 0.0 else 0
    for k in range(n_pairs):
        pairs.is_watched[pairs.a[k]] = _UNSURE
        pairs.is_watched[pairs.b[k]] = _UNSURE
    _bound_av_neighbours(w, pairs, road)
    for lane in range(road.n_lanes):
        info[AV_LEADS + lane] = -1
        info[AV_REARS + lane] = -1
    steady = True
    w.current[0] = 0
    found = 1
    for j in range(1, n):
        if v[j].present and _is_seen(w, j, pairs, road):
            pairs.is_watched[j] = 0
            w.current[found] = j
            found += 1
            steady = steady and v[j].duration == 0.0 and v[j].lanes == 1 << v[j].target_lane
            _note_av_neighbour(w, j, pairs)
    info[N_SEEN] = found
    if not steady:
        forget_av_neighbours(w)
    for j in range(1, n):
        if pairs.is_watched[j] and v[j].present:
            w.current[found] = j
            found += 1
    info[N_CURRENT] = found
