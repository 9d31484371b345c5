"""Driving where traffic stops: no driver comes so near that it could not brake, and all stop behind what stands.

The law is stated; how it was chosen: docs/adr/0078-traffic-that-stops.md.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.sight import DECIDED
from cornerforge.ndd.memory import away_chance
from cornerforge.road.straight import gap
from cornerforge.sim.neighbours import neighbours_in_lane
from cornerforge.types import ACCELERATIONS, FIRST_ACCELERATION, LOWEST_COMMAND

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.ndd.memory import MemoryNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = [
    "STANDS_BEHIND",
    "acceleration_of",
    "braking_behind",
    "braking_within",
    "last_to_stop",
    "looks_away_chance",
    "safely_behind",
]

STANDS_BEHIND = 2.0
"""Gap between standing vehicles that a driver leaves at least [m]; it begins to move when there is `_NO_ROOM` more.
I-80 has 2.2, 3.0, 4.1 m (25, 50, 75 %; 9,881 states below 0.3 m/s)."""
_NO_ROOM, _STANDS = 1.0, 4.0
"""With less room than this [m] a vehicle stands, or brakes with this [m/s2]."""
_STOPS_WITH = 2.5
"""Drivers wait to brake for what stops as long as this is enough a second later [m/s2]."""
_BRAKES, _SLOW = 1.5, 5.0
"""A vehicle ahead is thought to come to a stop if it brakes by more than this [m/s2], or is slower than this [m/s]."""
_OWN, _THEIRS = -LOWEST_COMMAND, 6.0
"""Braking of the driver, and of the vehicle ahead, at which it must not come to a contact [m/s2]."""
_LATE = 0.5
"""Time after which it would brake so [s]."""
_MARGIN, _LEAST_ROOM = 0.5, 0.5
"""Gap that is left then, and least room that is reckoned with [m]."""
_WARNED = -1.0
"""A driver that brakes harder than this for what it sees does not begin to look away [m/s2]."""
_HARDEST = float(ACCELERATIONS[0])


@inlined_kernel
def acceleration_of(w: World, i: int, action: int, accelerations: NDArray[np.float64], road: RoadNumbers) -> float:
    """Compute the acceleration of slot i's action, one of an acceleration [m/s2].

    Where traffic stops, the hardest action means: 4 m/s2, or as much more as avoids a contact, up to 8.
    """
    if road.stops and action == FIRST_ACCELERATION:
        return -_needed(w, i, road)
    acceleration: float = accelerations[action - FIRST_ACCELERATION]
    return acceleration


@kernel
def _needed(w: World, i: int, road: RoadNumbers) -> float:
    """Compute how hard slot i brakes at its hardest [m/s2], 4 to 8: enough for its leads if these go on as now.

    A vehicle that has decided to come into its lane is one of them.
    """
    v = w.vehicles
    needed = -_HARDEST
    for lane in range(road.n_lanes):
        if v[i].lanes & (1 << lane):
            j, _ = neighbours_in_lane(w, i, lane, road.lane_width, DECIDED)
            if j >= 0 and v[i].speed > v[j].speed:
                closing = v[i].speed - v[j].speed
                room = max(gap(v, i, j) - _MARGIN, _LEAST_ROOM)
                needed = max(needed, closing * closing / (2.0 * room) - min(v[j].acceleration, 0.0))
    return min(needed, _OWN)


@inlined_kernel
def braking_within(speed: float, room: float, stops_with: float) -> float:
    """Compute the braking [m/s2] that stops a vehicle within a room [m]; 0 where it may wait for another second.

    Args:
        speed: Its speed [m/s].
        room: [m].
        stops_with: It waits as long as this is enough a second later [m/s2].
    """
    if room < _NO_ROOM:
        return _STANDS
    squared = 0.5 * speed * speed
    return squared / room if squared >= stops_with * (room - speed) else 0.0


@inlined_kernel
def comes_to_stop(v: NDArray[np.void], j: int) -> bool:
    """Is vehicle j thought to come to a stop?"""
    stops: bool = v[j].acceleration < -_BRAKES or v[j].speed < _SLOW
    return stops


@inlined_kernel
def last_to_stop(w: World, road: RoadNumbers) -> int:
    """Find the rank of the foremost vehicle that comes to a stop, where traffic stops; -1: none does.

    None ahead of it makes others brake. `order` is sorted.
    """
    for rank in range(w.state[0].n_vehicles - 1 if road.stops else -1, -1, -1):
        j = w.order[rank]
        if w.vehicles[j].present and comes_to_stop(w.vehicles, j):
            return rank
    return -1


@inlined_kernel
def braking_behind(v: NDArray[np.void], i: int, j: int, queued: float, road: RoadNumbers) -> float:
    """Compute the braking with which vehicle i stops behind j if that goes on to brake [m/s2]; 0: none yet.

    `queued`: room that the vehicles between them take when they stand [m]. The tables of the naturalistic model say
    nothing of how hard the lead brakes, and see no further than the lead.
    """
    if not comes_to_stop(v, j):
        return 0.0
    way = v[j].speed * v[j].speed / (2.0 * max(-v[j].acceleration, _BRAKES))
    room = max(gap(v, i, j) - STANDS_BEHIND - queued + way, 0.1)
    return braking_within(v[i].speed, room, _STOPS_WITH * road.law.stops_with)


@inlined_kernel
def safely_behind(v: NDArray[np.void], i: int, j: int, road: RoadNumbers) -> float:
    """Compute the largest acceleration of vehicle i with which, a second later, it can still stop behind j [m/s2].

    The vehicle ahead is thought to brake by 6 m/s2 then, and i half a second later by 8: Gipps's (1981) rule with
    harder braking, so that it binds only those that come very near. Of I-80's and US-101's decisions 0.1 to 0.6 % by
    speed are above it.
    """
    own, theirs = _OWN * road.law.own, _THEIRS * road.law.theirs
    other = max(v[j].speed + v[j].acceleration, 0.0)
    room = gap(v, i, j) - _MARGIN + 0.5 * (v[j].speed + other) + other * other / (2.0 * theirs) - 0.5 * v[i].speed
    delay = _LATE + 0.5
    speed = own * (math.sqrt(max(delay * delay + 2.0 * room / own, 0.0)) - delay)
    safe: float = max(speed, 0.0) - v[i].speed
    return safe


@inlined_kernel
def looks_away_chance(v: NDArray[np.void], i: int, road: RoadNumbers, memory: MemoryNumbers) -> float:
    """Compute P(the driver of slot i looks away in this second)."""
    if road.stops and v[i].away == 0 and v[i].commanded < _WARNED * road.law.warned:
        return 0.0
    chance: float = away_chance(v[i].away, v[i].inattention, memory)
    return chance
