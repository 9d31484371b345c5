"""Natural driving where lanes end: drivers want to change, adapt their speed, take shorter gaps, let others in.

The law is stated, not fitted: too few merges are in open data (docs/adr/0077-traffic-on-roads.md has its sources).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.sight import HUMAN
from cornerforge.road.lanes import (
    ROOM_TO_START,
    has_lane,
    hurry,
    on_a_ramp,
    room_to_stop,
    side_to_leave,
    side_to_leave_lane,
    urgent_time,
    way_left,
)
from cornerforge.road.straight import STATED, ahead_by, gap, lane_of
from cornerforge.sim.braking import STANDS_BEHIND, braking_behind, braking_within, safely_behind
from cornerforge.sim.neighbours import SIGHT, neighbours_in_lane

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.sight import SightNumbers
    from cornerforge.road.straight import LawFactors, RoadNumbers
    from cornerforge.sim.world import World

__all__ = [
    "LOOKS_AGAIN",
    "Wish",
    "accepts",
    "braking_for_end",
    "come_beside",
    "heeds",
    "pressed_chance",
    "relaxed",
    "suitable_accelerations",
    "wish_of",
]

_WANTS = 2.0
"""Chance in a second to want to leave a lane that must be left, by urgency."""
LOOKS_AGAIN = 0.1
"""A driver that wants to leave its lane again and again, for some 10 s, overlooks a neighbour so much less often each
time: as often in all as in one lane change elsewhere."""
_ACCEPTS_BRAKING = 2.0
"""Braking of the rear vehicle of a gap at which a driver which must does not take it [m/s2]."""
_SEEN_AFTER = 1.0
"""Time before it begins to brake [s]."""
_ACCEPTS_TIME, _ACCEPTS_GAP = 0.6, 2.0
"""Time gap [s], from a gap [m] on, that a driver which must takes for sure."""
_LETS_IN = 0.5
"""Drivers of a habit below this, the calmer half, let others in."""
_FALLS_BACK, _CLOSES_UP, _MAKES_ROOM = -1.5, 1.0, -1.0
"""Accelerations with which a driver falls back behind a vehicle in the lane that it wants into, draws away from one
there, and lets one in [m/s2]."""
_DRIFT = 2.0
"""Difference of speeds with which it does so [m/s]."""
_ROOM_TIME = 0.35
"""Time gap that they want for that [s]."""
_LET_IN_TIME = 0.8
"""Time gap up to which a driver makes room for another [s]."""
_SLOWER = 5.0
"""A vehicle that is slower by more than this is not let in, and no free way [m/s]."""
_LEFT_AFTER = 0.7
"""Part of a lane change after which the body is out of the old lane."""
_SOFT = 1.0
"""Braking that a near lead alone may cause [m/s2]."""
_STOPS_WITH = 3.4
"""Drivers that must stop wait to brake as long as this is enough a second later [m/s2], and look for a gap."""
_ANTICIPATES = 0.3
"""A driver brakes early for a vehicle that comes into its lane if it will need more than this [m/s2]."""


class Wish(NamedTuple):
    """Wish of a driver to change lanes.

    Attributes:
        left, right: Chance in this second to want a change to each side, gaps apart.
        urgency: How much it must, 0 to 1.
    """

    left: float
    right: float
    urgency: float


# Lane changes


@inlined_kernel
def wish_of(v: NDArray[np.void], i: int, base: float, road: RoadNumbers) -> Wish:
    """Make the wish of vehicle i out of `base`, its chance to want a change to one given side where no lane ends."""
    if not road.lanes.varied:
        return Wish(base, base, 0.0)
    return _wish_where_lanes_end(v, i, base, road)


@kernel
def _wish_where_lanes_end(v: NDArray[np.void], i: int, base: float, road: RoadNumbers) -> Wish:
    """Make the wish of vehicle i on a road where lanes end.

    A driver that must leave its lane wants to with the chance of twice its urgency a second, and not to the other side.
    None wants into a lane that must be left within `urgent_time`, unless that lane goes further than its own.
    """
    if on_a_ramp(v[i].target_lane, v[i].x, road):
        return Wish(0.0, 0.0, 0.0)
    side, urgency = side_to_leave(v, i, road)
    room = room_to_stop(v, i, road) + ROOM_TO_START
    if side != 0 and room < 0.5 * v[i].change_time * hurry(v, i, road) * v[i].speed:
        return Wish(0.0, 0.0, urgency)
    wants = max(base, min(1.0, _WANTS * urgency))
    if side != 0:
        return Wish(wants if side > 0 else 0.0, wants if side < 0 else 0.0, urgency)
    left = base if _goes_on(v, i, v[i].target_lane + 1, road) else 0.0
    right = base if _goes_on(v, i, v[i].target_lane - 1, road) else 0.0
    return Wish(left, right, 0.0)


@kernel
def accepts(w: World, i: int, lane: int, urgency: float, sight: SightNumbers, road: RoadNumbers) -> bool:
    """Say whether an AV that must change to `lane` accepts the gaps there: those whose chance is above 1 - urgency."""
    v = w.vehicles
    lead, rear = neighbours_in_lane(w, i, lane, road.lane_width, sight)
    chance = 1.0
    if lead >= 0:
        chance = pressed_chance(urgency, gap(v, i, lead), v[lead].speed - v[i].speed, v[i].speed, STATED)
    if rear >= 0:
        rate, speed = v[i].speed - v[rear].speed, v[rear].speed
        chance = min(chance, pressed_chance(urgency, gap(v, rear, i), rate, speed, STATED))
    return chance > 1.0 - urgency


@inlined_kernel
def _goes_on(v: NDArray[np.void], i: int, lane: int, road: RoadNumbers) -> bool:
    """Is there a lane that need not be left within `urgent_time`?"""
    if lane < 0 or lane >= road.n_lanes:
        return False
    goes_on: bool = way_left(v, i, lane, road) > urgent_time(i, road) * v[i].speed
    return goes_on


@inlined_kernel
def pressed_chance(urgency: float, room: float, range_rate: float, rear_speed: float, law: LawFactors) -> float:
    """Compute the chance that a driver which must leave its lane takes a gap to one neighbour for that reason.

    It falls evenly with the braking that the rear one of both needs a second later, and with a time gap then below
    0.6 s: the driver of the rear one must see the change first, and who changes lanes holds the speed.

    Args:
        urgency: 0: it need not, and the chance is 0.
        room: Gap [m].
        range_rate: Front minus rear vehicle of the two [m/s].
        rear_speed: Speed of the rear one [m/s].
        law: Factors of the stated numbers.
    """
    closing = min(range_rate, 0.0)
    spare = room - _ACCEPTS_GAP + _SEEN_AFTER * closing
    if urgency == 0.0 or spare <= 0.0:
        return 0.0
    eases = max(0.0, 1.0 - closing * closing / (2.0 * spare * _ACCEPTS_BRAKING * law.accepts_braking))
    return eases * min(1.0, spare / (_ACCEPTS_TIME * law.accepts_time * rear_speed + 1.0))


# Speed


@inlined_kernel
def heeds(v: NDArray[np.void], i: int, j: int, seen: int, road: RoadNumbers) -> bool:
    """Say whether vehicle i heeds j ahead in one of its lanes: in one that it leaves only if it comes so far before.

    `seen`: lanes in which j is seen, a bit mask.
    """
    if not road.lanes.varied or v[i].duration == 0.0 or seen & (1 << v[i].target_lane) != 0:
        return True
    time_left = max(_LEFT_AFTER * v[i].duration - v[i].clock, 0.0)
    closing = v[i].speed - v[j].speed + 0.5 * time_left * max(-v[j].acceleration, 0.0)
    comes_near: bool = gap(v, i, j) - STANDS_BEHIND < time_left * max(closing, 0.0)
    return comes_near


@inlined_kernel
def relaxed(w: World, i: int, command: float, sight: SightNumbers, road: RoadNumbers) -> float:
    """Soften an IDM's braking behind a lead that is near but does not come nearer fast [m/s2].

    An IDM brakes at once as hard as it can for the gap that it would like, and a merge leaves a shorter one. Kesting,
    Treiber and Helbing (2010) let it brake by what the motion of both demands instead; so here, twice that and 1 m/s2.
    """
    if command >= -_SOFT:
        return command
    v = w.vehicles
    softest = 0.0
    for lane in range(road.n_lanes):
        if v[i].lanes & (1 << lane):
            j, _ = neighbours_in_lane(w, i, lane, road.lane_width, sight)
            if j >= 0:
                closing = max(v[i].speed - v[j].speed, 0.0)
                needed = closing * closing / (2.0 * max(gap(v, i, j) - _ACCEPTS_GAP, 0.5))
                softest = min(softest, -_SOFT - 2.0 * needed + min(v[j].acceleration, 0.0))
    return max(command, softest) if softest < 0.0 else command


@inlined_kernel
def braking_for_end(v: NDArray[np.void], i: int, road: RoadNumbers) -> float:
    """Compute the braking that vehicle i needs now to stop where its lane ends [m/s2]; 0: none yet, or it goes on."""
    return braking_within(v[i].speed, room_to_stop(v, i, road), _STOPS_WITH) if road.lanes.varied else 0.0


@inlined_kernel
def suitable_accelerations(w: World, i: int, rank: int, last: int, road: RoadNumbers) -> tuple[float, float]:
    """Find the accelerations between which vehicle i, at a rank, drives where traffic stops [m/s2]; -inf, inf: any.

    It brakes to stop at the end of its lane and behind what stops, and for what comes into its lane. One that must
    leave its lane falls back behind the vehicle beside it in the next lane, or draws away from it. The calmer half make
    room for those that must come over. `order` is sorted; `last`: `braking.last_to_stop`.
    """
    v = w.vehicles
    least, most = -np.inf, np.inf
    side, urgency = side_to_leave(v, i, road)
    if side != 0 and v[i].duration == 0.0 and has_lane(v[i].target_lane + side, v[i].x, road):
        least, most = come_beside(w, i, v[i].target_lane + side, urgency, road)
    lets_in = road.lanes.varied and side == 0 and v[i].duration == 0.0 and v[i].habit < _LETS_IN * road.law.lets_in
    braking = braking_for_end(v, i, road)
    unled, queued = v[i].lanes, 0.0
    aside = _LET_IN_TIME * v[i].speed + road.longest if lets_in else 0.0
    for other in range(rank + 1, w.state[0].n_vehicles):
        j = w.order[other]
        ahead = ahead_by(v, i, j)
        if ahead >= SIGHT or (other > last and unled == 0 and ahead > aside):
            break
        if v[j].present == 0:
            continue
        if v[j].lanes & v[i].lanes != 0:
            if heeds(v, i, j, v[j].lanes, road):
                if v[j].lanes & unled != 0:
                    most = min(most, safely_behind(v, i, j, road))
                braking = max(braking, braking_behind(v, i, j, queued, road))
                if v[j].lanes & (1 << v[i].target_lane):
                    queued += v[j].length + STANDS_BEHIND
            unled &= ~v[j].lanes
            if v[j].duration > 0.0 and v[j].speed < v[i].speed and v[j].target_lane == v[i].target_lane:
                braking = max(braking, _braking_for_entering(v, i, j, road))
        elif lets_in and gap(v, i, j) < _LET_IN_TIME * v[i].speed and _lets_in(v, i, j, road):
            most = min(most, _MAKES_ROOM)
    if braking > 0.0:
        least, most = -np.inf, min(most, -braking)
    return least, most


@kernel
def _braking_for_entering(v: NDArray[np.void], i: int, j: int, road: RoadNumbers) -> float:
    """Compute the braking that vehicle i needs for j, slower and on its way into i's lane because it must [m/s2].

    Drivers expect that where a lane ends, and do not wait until it is half over the line.
    """
    old = lane_of(v[j].y, road.lane_width)
    if old == v[i].target_lane or side_to_leave_lane(v, j, old, road)[1] == 0.0:
        return 0.0
    closing = v[i].speed - v[j].speed
    braking: float = closing * closing / (2.0 * max(gap(v, i, j) - _ACCEPTS_GAP, 0.5))
    return braking if braking > _ANTICIPATES else 0.0


@kernel
def _lets_in(v: NDArray[np.void], i: int, j: int, road: RoadNumbers) -> bool:
    """Does vehicle i make room for j, just ahead in a lane beside it that j must leave to its side?"""
    aside = v[i].target_lane - v[j].target_lane
    if v[j].duration > 0.0 or abs(aside) != 1 or v[j].speed <= v[i].speed - _SLOWER:
        return False
    side, _ = side_to_leave(v, j, road)
    comes: bool = side == aside and has_lane(v[i].target_lane, v[i].x, road)
    return comes


@inlined_kernel
def _is_near(v: NDArray[np.void], rear: int, lead: int) -> bool:
    """Is the gap between both short?"""
    near: bool = gap(v, rear, lead) < _ROOM_TIME * v[rear].speed
    return near


@inlined_kernel
def come_beside(w: World, i: int, lane: int, urgency: float, road: RoadNumbers) -> tuple[float, float]:
    """Find the least and the most acceleration of vehicle i with which it comes beside a gap in a lane [m/s2].

    It falls back behind a vehicle beside it or just ahead, draws away from one just behind if there is more room ahead,
    and catches up with a lane that is faster: the latter two only if its own lane is free. It does so up to twice as
    hard, and with twice the difference of speeds, the more urgent it is.
    """
    v = w.vehicles
    hard = 1.0 + urgency
    lead, rear = neighbours_in_lane(w, i, lane, road.lane_width, HUMAN)
    if lead >= 0 and _is_near(v, i, lead):
        return -np.inf, (_FALLS_BACK * hard if v[i].speed > v[lead].speed - _DRIFT * hard else 0.0)
    own, _ = neighbours_in_lane(w, i, v[i].target_lane, road.lane_width, HUMAN)
    is_free = own < 0 or (gap(v, i, own) > v[i].speed and v[own].speed > v[i].speed - _SLOWER)
    if not is_free:
        return -np.inf, np.inf
    has_room = rear >= 0 and (lead < 0 or gap(v, i, lead) > gap(v, rear, i))
    just_behind = has_room and _is_near(v, rear, i) and v[i].speed < v[rear].speed + _DRIFT * hard
    is_slow = (lead >= 0 and v[i].speed < v[lead].speed - _DRIFT) or (rear >= 0 and v[i].speed < v[rear].speed - _DRIFT)
    return (_CLOSES_UP * hard if just_behind or is_slow else -np.inf), np.inf
