"""Built-in AVs of sites: they look as drivers do, every tenth of a second, and take no chance.

By RSS (Shalev-Shwartz, Shammah and Shashua 2017) an AV keeps the safe distance behind what is ahead on its way, and
never gets so near to a place into which another may come that it could not stop before it: "right of way is given, not
taken". The assumptions are those of `drivers.rss.RssParams`: it may accelerate until its response time is over, then
brakes with the least braking; another that is to stop needs its own response time and brakes likewise.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._jit import inlined_kernel, kernel, shared_kernel
from cornerforge.drivers.avs import MANNERS
from cornerforge.drivers.rss import rss_braking
from cornerforge.sim.site.look import look_as_driver
from cornerforge.sim.site.moves import seconds_of
from cornerforge.sim.site.people import AT_KERB
from cornerforge.sim.world import NO_VEHICLE
from cornerforge.site.tables import CROSS, MEETINGS, NO_ZONE, RED, YELLOW, letter_at, longer, mapped, walk_letter
from cornerforge.types import FRAME_S, PERSON

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.avs import AvNumbers
    from cornerforge.drivers.rss import RssNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = ["junction_av_decides"]

_EDGES_FORWARD = np.array([manner.creeps for manner in MANNERS.values()])
_BY_RSS = np.array([manner.rss for manner in MANNERS.values()])
_CREEPS, _NOSE = 1.5, 1.0
"""Speed at which the creeping AV edges forward [m/s], and how far into another's way [m]."""
_CREEP_BRAKES = 2.0
_TAKES = 0.5
_STANDS, _WALKS = 0.5, 1.5
_LEAVES = 0.5
"""By RSS it stops so far before another's way [m]."""
_SETS_OFF = 1.0
"""Acceleration with which it counts on leaving a zone [m/s2]."""


@inlined_kernel
def _to_stop(speed: float, response: float, acceleration: float, braking: float) -> float:
    """Compute the way that a vehicle needs to stop [m] if it accelerates until its response time [s] is over."""
    then = speed + response * acceleration
    return response * speed + 0.5 * acceleration * response * response + then * then / (2.0 * braking)


@inlined_kernel
def _time_over(way: float, speed: float, acceleration: float) -> float:
    """Compute the time over a way [m] at a constant acceleration above 0 [s]."""
    return (math.sqrt(speed * speed + 2.0 * acceleration * max(way, 0.0)) - speed) / acceleration


@kernel
def _may_come(
    w: World, j: int, zone: Any, to_other: float, clock: float, site: NDArray[np.void], p: RssNumbers
) -> bool:
    """Must the AV expect that agent j comes into their zone, `to_other` [m] ahead of it?

    One that goes first, unless it has to stop at its light and can; one that has to yield or to stop, if it cannot.
    """
    other, v = w.agents[j], w.vehicles[j]
    row = site[0].route[other.route]
    if v.kind == PERSON:
        may = row.signal < 0 or walk_letter(site, other.route, clock) != RED
        return other.s > AT_KERB or (zone.yields != 0 and may)
    needed = _to_stop(v.speed, p.rear_response_time, p.rear_acceleration, p.rear_braking)
    to_line = row.stop - other.s - 0.5 * v.length
    if row.signal >= 0 and to_line > 0.0 and letter_at(site, other.route, clock) <= YELLOW:
        cannot: bool = v.speed > _STANDS and needed > to_line
        return cannot
    if zone.yields:
        return True
    runs: bool = v.speed > _STANDS and needed > to_other
    return runs


@kernel
def _rss_bound(w: World, clock: float, site: NDArray[np.void], p: RssNumbers) -> float:
    """Compute the most that the AV may accelerate by RSS [m/s2]; +inf where it is safe."""
    v, agents = w.vehicles, w.agents
    me, own = v[0], agents[0]
    bound = np.inf
    needed = _to_stop(me.speed, p.response_time, p.max_acceleration, p.min_braking)
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if j == 0:
            continue
        other = agents[j]
        ahead = other.s if other.route == own.route else -np.inf
        for meeting in range(MEETINGS if other.route != own.route else 0):
            zone = site[0].zone[own.route, other.route, meeting]
            if zone.kind == NO_ZONE:
                break
            theirs = longer(v[j].length, v[j].kind == PERSON)
            end = zone.end + longer(me.length, False)
            room = zone.begin - longer(me.length, False) - own.s
            to_other = zone.other_begin - theirs - other.s
            if other.s > zone.other_end + theirs or own.s > end:
                continue
            if zone.kind != CROSS and to_other <= 0.0:
                ahead = mapped(zone, other.s)
                continue
            if room <= 0.0 or room - _LEAVES > needed or not _may_come(w, j, zone, to_other, clock, site, p):
                continue
            pace = max(v[j].speed, _WALKS) if v[j].kind == PERSON else v[j].speed
            comes = _time_over(to_other, pace, p.rear_acceleration)
            if _time_over(end - own.s, me.speed, _SETS_OFF) + p.response_time > comes:
                bound = min(bound, -0.5 * me.speed * me.speed / max(room - _LEAVES, 0.1))
        if ahead > own.s:
            braking = rss_braking(me.speed, ahead - own.s - 0.5 * (me.length + v[j].length), v[j].speed, p)
            if braking > 0.0:
                bound = min(bound, -braking)
    return bound


@kernel
def _creeping(w: World) -> float:
    """Compute the acceleration with which the AV edges on into the way of the one that it waits for [m/s2]."""
    own, speed = w.agents[0], w.vehicles[0].speed
    room = w.agents[own.for_whom].begins + _NOSE - longer(w.vehicles[0].length, False) - own.s
    wanted = min(_CREEPS, math.sqrt(2.0 * _CREEP_BRAKES * max(room, 0.0))) - speed
    command: float = max(own.stops, min(own.free, wanted))
    return command


@shared_kernel
def junction_av_decides(w: World, substep: int, road: RoadNumbers, av: AvNumbers) -> float:
    """Decide for a built-in AV at a site: the acceleration that it commands [m/s2].

    It goes where its gap is at least its own critical one, and has then decided to go. A creeping one edges forward
    where it should wait.
    """
    own = w.agents[0]
    seconds = seconds_of(w) - (1.0 if substep > 0 else 0.0) + substep * FRAME_S
    clock = w.state[0].clock + seconds
    look_as_driver(w, 0, clock, substep == 0, road.site)
    command: float = own.stops
    if own.chooses and own.goes >= _TAKES:
        own.cleared = max(own.cleared, own.until)
        command = own.free
    elif not own.chooses:
        command = own.free
    elif _EDGES_FORWARD[av.junction] and own.for_whom != NO_VEHICLE:
        return _creeping(w)
    if _BY_RSS[av.junction]:
        command = min(command, max(-av.hardest_braking, _rss_bound(w, clock, road.site, av.rss)))
    return command
