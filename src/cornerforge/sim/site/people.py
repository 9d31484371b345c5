"""How a person at a site sees the traffic: the light, and vehicles that come, before the kerb and on the road.

`look_as_walker` writes it into the person's `world.AGENT`, as `look.look_as_driver` does for a driver; `free` and
`stops` are speeds here. The laws are in docs/sites.md.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.site.claims import BLIND, EARLY, LOOKED, has_committed, is_held
from cornerforge.sim.site.look import room_before
from cornerforge.sim.site.moves import held_then_stops_within, seconds_of, stops_within, sure
from cornerforge.sim.world import NO_VEHICLE
from cornerforge.site.network import TURNS
from cornerforge.site.tables import GREEN, MEETINGS, NO_ZONE, RED, longer, walk_letter
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
_STRONGEST = 2.0
"""Strongest acceleration of a driver [m/s2]."""
_SLOWS = 1.0
"""A vehicle that passes before a person may become so much slower [m/s]."""
_STOPS_WITHIN = 1.5
"""A person stops for a vehicle that stands in its way so far ahead [s]."""
_BRAKES = 0.3
_SOON, _HALF = 2.5, 0.5
"""Walk is about to come so long before it does; time at a whole second is compared with this margin [s]."""
_STRAIGHT = TURNS.index("straight")
_NEEDED = 2.5
"""A vehicle that must brake harder than this for a person on the road is a threat [m/s2]."""


@kernel
def look_as_walker(w: World, i: int, clock: float, site: NDArray[np.void]) -> None:  # noqa: PLR0915
    """Let the person of slot i look around; `clock` is the time of the signals [s].

    At the kerb it leaves on Walk or while Don't Walk flashes, unless a vehicle is about to pass; on Don't Walk, unless
    it obeys or has waited long, if the gap is enough. At lights the gap before a vehicle that turns is that on Walk,
    and it waits a while behind one that has passed. On the road it may stop for a vehicle that does not.
    """
    one, v, agents = site[0], w.vehicles, w.agents
    me, own = v[i], agents[i]
    row = one.route[own.route]
    place, wished = own.s, me.desired_speed
    waits = place <= AT_KERB
    light = walk_letter(site, own.route, clock)
    goes_first = row.signal >= 0 and light != RED
    least, spread, threat, needed, blocked, near = np.inf, _JUDGED, NO_VEHICLE, 0.0, False, NO_VEHICLE
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if v[j].kind == PERSON:
            continue
        other = agents[j]
        for meeting in range(MEETINGS):
            zone = one.zone[own.route, other.route, meeting]
            if zone.kind == NO_ZONE:
                break
            theirs = longer(v[j].length, False)
            left = zone.other_end + theirs - other.s
            if place > zone.end or left < 0.0:
                continue
            if row.signal < 0 and zone.goes_first:
                goes_first = True
            enters, leaves = max(zone.begin - place, 0.0) / wished, (zone.end - place) / wished
            room = zone.other_begin - theirs - other.s
            speed = v[j].speed
            turns = row.signal >= 0 and one.route[other.route].turn != _STRAIGHT
            yields = not waits or goes_first or turns
            if room <= 0.0:
                near = j
                if waits and yields and row.signal >= 0:
                    behind = max(0.0, one.after_vehicles * own.manners - enters)
                    own.resumes = max(own.resumes, seconds_of(w) + left / max(speed, 1.0) + behind)
            if place >= zone.begin and not waits:
                blocked = blocked or (room <= 0.0 and room_before(w, i, j) < wished)
                continue
            if left / max(speed - _SLOWS, 0.3) < enters:
                continue
            gap, arrival = 0.0, 0.0
            if room <= 0.0:
                blocked = blocked or (not waits and enters < _STOPS_WITHIN)
            else:
                waits_too = goes_first and _may_wait(w, j, zone, room)
                if is_held(w, j, clock, site) or (waits_too and _shows_it(w, j, room)):
                    continue
                arrival = _soonest(room, speed)
                if waits_too or held_then_stops_within(speed, v[j].acceleration, _STRONGEST) <= room:
                    gap = max(arrival - enters, 0.0)
            ratio = gap / (one.gives_way * own.manners if yields else one.gap_walk * own.gaps)
            if ratio < least and arrival < leaves + 6.0:
                least, spread = ratio, _JUDGED if yields else one.gap_error
                threat = j
                needed = 0.5 * speed * speed / max(room, 0.1)
    own.chooses = 1
    own.free = wished
    own.stops = 0.0
    own.for_whom = threat if threat >= 0 else near
    own.until = row.length
    own.unseen = 0
    if blocked:
        own.goes = 0.0
    elif own.marks & BLIND:
        own.goes = 1.0
    elif not waits:
        frightened = threat >= 0 and least < 1.0 and needed > _NEEDED
        own.goes = 1.0 - one.steps_back if frightened else 1.0
    else:
        may = light != RED or row.signal < 0 or _minds_no_light(w, i, clock, site)
        if may and own.resumes < seconds_of(w) + _HALF:
            own.goes = sure(least, spread) if least < np.inf else 1.0
        else:
            own.goes = 0.0
        if own.marks & LOOKED == 0 and own.goes < 1.0:
            own.unseen = 1 if own.goes < one.walks_blindly else 0
            own.goes += (1.0 - own.goes) * one.walks_blindly


@inlined_kernel
def _minds_no_light(w: World, i: int, clock: float, site: NDArray[np.void]) -> bool:
    """Does a person at the kerb look for a gap on Don't Walk: it has not waited long yet, or Walk is about to come?"""
    own = w.agents[i]
    early = own.marks & EARLY != 0 and walk_letter(site, own.route, clock + _SOON) == GREEN
    return early or seconds_of(w) - own.enters < own.headway


@kernel
def _soonest(room: float, speed: float) -> float:
    """Compute when a vehicle is there that accelerates by 1 m/s2 [s]."""
    return math.sqrt(speed * speed + 2.0 * room) - speed


@inlined_kernel
def _may_wait(w: World, j: int, zone: Any, room: float) -> bool:
    """Can vehicle j still stop before a zone that it has `room` [m] to, and has not decided to go?"""
    me = w.vehicles[j]
    return not has_committed(w, j, zone.other_begin) and stops_within(me.speed, me.acceleration) <= room


@inlined_kernel
def _shows_it(w: World, j: int, room: float) -> bool:
    """Can a person tell that vehicle j will stop: it stands, or brakes enough?"""
    me = w.vehicles[j]
    enough = me.acceleration < -_BRAKES and -0.5 * me.speed * me.speed / me.acceleration < room
    shows: bool = me.speed < _STANDS or enough
    return shows
