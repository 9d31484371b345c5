"""How a person at a site sees the traffic: the light, and vehicles that come, before the kerb and on the road.

`look_as_walker` writes it into the person's `world.AGENT`, as `look.look_as_driver` does for a driver; `free` and `stops`
are speeds here. The laws are in docs/sites.md.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import kernel
from cornerforge.sim.site.look import BLIND, LOOKED, OBEYS, room_before, sure, will_stop
from cornerforge.sim.world import NO_VEHICLE
from cornerforge.site.tables import CROSS, GREEN, RED, YELLOW, letter_at, longer, walk_letter
from cornerforge.types import PERSON

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.world import World

__all__ = ["AT_KERB", "look_as_walker"]

AT_KERB = 0.05
"""A person within so much of its route's begin has not left the kerb [m]."""
_STANDS = 0.5
_JUDGED = 0.2
"""Spread with which people judge the time until a vehicle comes."""
_CAN_BRAKE = 6.0
"""Twice the braking that a person trusts a driver to do a second later [m/s2]."""
_STOPS_WITHIN = 1.5
"""A person stops for a vehicle that stands in its way so far ahead [s]."""
_BRAKES = 0.3
_NEEDED = 2.5
"""A vehicle that must brake harder than this for a person on the road is a threat [m/s2]."""


@kernel
def look_as_walker(w: World, i: int, clock: float, site: NDArray[np.void]) -> None:
    """Let the person of slot i look around; `clock` is the time of the signals [s].

    At the kerb it leaves on Walk, unless a vehicle is about to pass; on Don't Walk, unless it obeys, if the gap is
    enough. On the road it may stop for a vehicle that does not.
    """
    one, v, agents = site[0], w.vehicles, w.agents
    me, own = v[i], agents[i]
    row = one.route[own.route]
    place, wished = own.s, me.desired_speed
    waits = place <= AT_KERB
    light = walk_letter(site, own.route, clock)
    goes_first = row.signal >= 0 and light == GREEN
    worst, threat, needed, blocked = np.inf, NO_VEHICLE, 0.0, False
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if v[j].kind == PERSON:
            continue
        other = agents[j]
        zone = one.zone[own.route, other.route, 0]
        if zone.kind != CROSS:
            continue
        theirs = longer(v[j].length, False)
        left = zone.other_end + theirs - other.s
        if place > zone.end or left < 0.0:
            continue
        if row.signal < 0 and zone.goes_first:
            goes_first = True
        enters, leaves = (zone.begin - place) / wished, (zone.end - place) / wished
        room = zone.other_begin - theirs - other.s
        speed = v[j].speed
        if place >= zone.begin and not waits:
            blocked = blocked or (room <= 0.0 and room_before(w, i, j) < wished)
            continue
        arrival, ratio_from = 0.0, 0.0
        if room <= 0.0:
            if left / max(speed, 0.3) < enters:
                continue
            blocked = blocked or (not waits and enters < _STOPS_WITHIN)
        else:
            if speed < _STANDS or _is_stopping(w, j, room, clock, site):
                continue
            arrival = _soonest(room, speed)
            if left / speed < enters:
                continue
            ratio_from = arrival - enters
            if arrival < leaves + 0.5 and room < (speed + 1.5) * (1.2 + (speed + 1.5) / _CAN_BRAKE):
                ratio_from = 0.0
        gap = max(ratio_from, 0.0)
        if gap < worst and arrival < leaves + 6.0:
            worst = gap
            threat = j
            needed = 0.5 * speed * speed / max(room, 0.1)
    own.chooses = 1
    own.free = wished
    own.stops = 0.0
    own.for_whom = threat
    own.until = row.length
    own.unseen = 0
    if blocked:
        own.goes = 0.0
    elif own.marks & BLIND:
        own.goes = 1.0
    elif not waits:
        frightened = threat >= 0 and worst < one.gives_way * own.manners and needed > _NEEDED
        own.goes = 1.0 - one.steps_back if frightened else 1.0
    else:
        own.goes = _leaves_chance(one, own, worst, goes_first, light != RED or row.signal < 0)


@kernel
def _leaves_chance(one: NDArray[np.void], own: NDArray[np.void], worst: float, first: bool, may: bool) -> float:
    """Compute the chance that a person leaves the kerb now; `worst`: the smallest time to spare before a vehicle [s]."""
    chance = 1.0
    if first:
        chance = sure(worst / (one.gives_way * own.manners), _JUDGED) if worst < np.inf else 1.0
    elif not may and own.marks & OBEYS:
        chance = 0.0
    elif worst < np.inf:
        chance = sure(worst / (one.gap_walk * own.gaps), one.gap_error)
    if own.marks & LOOKED == 0 and chance < 1.0:
        own.unseen = 1 if chance < one.walks_blindly else 0
        chance += (1.0 - chance) * one.walks_blindly
    return chance


@kernel
def _soonest(room: float, speed: float) -> float:
    """Compute when a vehicle is there that accelerates by 1 m/s2 [s]."""
    return math.sqrt(speed * speed + 2.0 * room) - speed


@kernel
def _is_stopping(w: World, j: int, room: float, clock: float, site: NDArray[np.void]) -> bool:
    """Can a person tell that vehicle j will stop: it brakes enough, or has a red light and can?"""
    row = site[0].route[w.agents[j].route]
    speed = w.vehicles[j].speed
    to_line = row.stop - w.agents[j].s - 0.5 * w.vehicles[j].length
    if row.signal >= 0 and to_line > 0.0:
        letter = letter_at(site, w.agents[j].route, clock)
        if (letter == RED or letter == YELLOW) and will_stop(speed, to_line):
            return True
    braking = -w.vehicles[j].acceleration
    return braking > _BRAKES and 0.5 * speed * speed / braking < room
