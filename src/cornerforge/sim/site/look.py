"""How a driver at a site sees the world: who is ahead, whose way crosses, whether the gap is enough, the light.

`look_as_driver` writes it into the driver's `world.AGENT`: an acceleration with which it goes, one with which it gives
way, and, where it has to choose between the two, the chance that it goes. The laws are in docs/sites.md.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._elementary import exp, log, sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.idm import IdmNumbers, free_acceleration, idm_acceleration
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.sim.world import ALL_OF_THEM, NO_VEHICLE
from cornerforge.site.network import TURNS
from cornerforge.site.tables import (
    CROSS,
    DIVERGE,
    GREEN,
    MEETINGS,
    MERGE,
    NO_ZONE,
    RED,
    SHARED,
    WARM_UP,
    YELLOW,
    letter_at,
    longer,
    mapped,
    pose_at,
    speed_at,
    walk_letter,
    when_green,
)
from cornerforge.types import PERSON

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.world import World

__all__ = [
    "BLIND",
    "LOOKED",
    "OBEYS",
    "STOPS",
    "TURNS_ON_RED",
    "look_as_driver",
    "room_before",
    "seconds_of",
    "sure",
    "will_stop",
]

OBEYS, TURNS_ON_RED, STOPS, LOOKED, BLIND = (1 << k for k in range(5))
"""Bits of `AGENT.marks`. Of a person: it never leaves the kerb on Don't Walk. Of a driver: it turns right on red; it has
decided to stop at this light. Of a person: it has looked at the traffic once; it looks no more."""
WARM_STEP = 1 << 15
"""Numbers of decisions from here on are those of the warm-up."""
_HARDEST = 8.0
_EXPECTED = 4.0
"""A vehicle that needs to brake harder than this is thought not to stop [m/s2]."""
_STEP, _FARTHEST, _SOON = 0.5, 8.0, 3.0
_CLOSE = 0.3
"""Room that is kept to what stands ahead in a zone that both are in [m]."""
_MARGIN = 0.5
"""Drivers stop so far before the place in which they would be in the way [m], and leave so many seconds behind others."""
_PAST_LINE = 0.5
_CRAWLS, _UNDER_WAY = 2.0, 1.0
_STANDS = 0.5
"""Below this speed a vehicle stands [m/s]."""
_AT_LINE = 5.0
_LEFT, _RIGHT = TURNS.index("left"), TURNS.index("right")
_SETS_OFF = 1.0
"""Acceleration at which others are thought to drive off [m/s2]."""
_NO_DOUBT = 3.0
"""A gap so many times the critical one is taken."""
_OWN_BRAKES, _LEAD_BRAKES, _LEAVES, _DELAY = 7.0, 6.0, 0.5, 0.6
"""How hard a driver brakes if it must, and its lead [m/s2], what it leaves between them [m], and how late it is [s]."""
_RAMP = 0.2
"""Braking begins so late, because the acceleration must change first [s]."""
_SURE = 1.7
"""A logistic law of this steepness is near the normal one."""


@inlined_kernel
def seconds_of(w: World) -> float:
    """Compute the time since the start of the test at the coming decision [s], less than 0 in the warm-up."""
    state = w.state[0]
    if state.decisions >= WARM_STEP:
        return float(state.decisions - WARM_STEP) - WARM_UP
    return float(state.decisions)


@inlined_kernel
def sure(ratio: float, spread: float) -> float:
    """Compute the chance that a gap of this ratio to the critical one is taken, if it is judged with such a spread."""
    if ratio <= 0.0:
        return 0.0
    away = -_SURE * log(ratio) / spread
    chance = 1.0 / (1.0 + exp(min(away, 60.0)))
    return chance if chance > 1e-12 else 0.0


@inlined_kernel
def will_stop(speed: float, room: float) -> bool:
    """Can a vehicle of a speed [m/s] be thought to stop within a room [m]?"""
    return speed < _STANDS or 0.5 * speed * speed <= _EXPECTED * max(room, 0.0)


@inlined_kernel
def _to_stop(speed: float, room: float, braking: float) -> float:
    """Compute the acceleration with which a vehicle stops within a room [m], if it decides again in a second [m/s2].

    Gipps's (1981) rule with comfortable braking, or the braking that is needed.
    """
    room = max(room - _RAMP * speed, 0.0)
    b = max(braking, 1.05 * 0.5 * speed * speed / max(room, 0.05))
    inside = b * b + b * (2.0 * room - speed)
    safe = -b + math.sqrt(max(inside, 0.0))
    return max(-_HARDEST, max(safe, 0.0) - speed)


@inlined_kernel
def _time_to(room: float, speed: float, wanted: float, a: float) -> float:
    """Compute the time over a distance [s] of a vehicle that accelerates from a speed to the wanted one [m/s]."""
    if room <= 0.0:
        return 0.0
    if speed >= wanted:
        return room / max(speed, 0.3)
    way = 0.5 * (wanted * wanted - speed * speed) / a
    if way >= room:
        return (math.sqrt(speed * speed + 2.0 * a * room) - speed) / a
    return (wanted - speed) / a + (room - way) / wanted


@inlined_kernel
def _follow(w: World, i: int, j: int, room: float, wanted: float, own: IdmNumbers, free: float) -> float:
    """Bound the acceleration `free` of slot i behind slot j at a room [m], and note what is safe in `most` [m/s2]."""
    me, lead = w.vehicles[i], w.vehicles[j]
    free = min(free, idm_acceleration(me.speed, room, lead.speed - me.speed, own))
    other = max(lead.speed + min(lead.acceleration, 0.0), 0.0)
    room += 0.5 * (lead.speed + other) + other * other / (2.0 * _LEAD_BRAKES) - 0.5 * me.speed - _LEAVES
    speed = _OWN_BRAKES * (math.sqrt(max(_DELAY * _DELAY + 2.0 * room / _OWN_BRAKES, 0.0)) - _DELAY)
    w.agents[i].most = min(w.agents[i].most, max(-_HARDEST, speed - me.speed))
    return free


@kernel
def room_before(w: World, i: int, j: int) -> float:
    """Compute the room straight ahead of the agent in slot i to the box of slot j [m]; +inf if that is not ahead."""
    me, other = w.vehicles[i], w.vehicles[j]
    sine, cosine = sin_cos(me.heading)
    dx, dy = other.x - me.x, other.y - me.y
    ahead = dx * cosine + dy * sine
    aside = abs(dy * cosine - dx * sine)
    across, along = sin_cos(other.heading - me.heading)
    half_along = 0.5 * (abs(along) * other.length + abs(across) * other.width)
    half_across = 0.5 * (abs(across) * other.length + abs(along) * other.width)
    if ahead <= 0.0 or aside >= 0.5 * me.width + half_across + _CLOSE:
        return np.inf
    room: float = ahead - 0.5 * me.length - half_along
    return room


@kernel
def _room_along(w: World, i: int, j: int, strength: float, site: NDArray[np.void]) -> float:
    """Compute the room along the route of slot i to the box of slot j [m]; +inf if it is not within `_FARTHEST`.

    `strength`: the acceleration of slot i [m/s2], while j is thought to drive on until a second later; 0: j is thought
    to stay where it is.
    """
    me, other, own, theirs = w.vehicles[i], w.vehicles[j], w.agents[i], w.agents[j]
    steps = 1
    while steps * _STEP <= _FARTHEST:
        room = steps * _STEP
        x, y, heading = pose_at(site, own.route, own.s + room)
        mine = Box(x, y, heading, me.length + _CLOSE, me.width + _CLOSE)
        time = _time_to(room, me.speed, 2.0 * me.speed + 5.0, strength) if strength > 0.0 else 0.0
        for late in range(3 if strength > 0.0 else 1):
            ox, oy, turned = pose_at(site, theirs.route, theirs.s + other.speed * (time + 0.5 * late))
            if boxes_overlap(mine, Box(ox, oy, turned, other.length + _CLOSE, other.width + _CLOSE)):
                return room - _STEP
        steps += 1
    return np.inf


@inlined_kernel
def _light(w: World, i: int, clock: float, site: NDArray[np.void]) -> tuple[float, bool]:
    """Look at the light of slot i, and note whether it has to choose because of it.

    Returns:
        Room to where it stops because of it [m], +inf if it need not; it turns on red.
    """
    one, me, own = site[0], w.vehicles[i], w.agents[i]
    row = one.route[own.route]
    room: float = row.stop - own.s - 0.5 * me.length
    if row.signal < 0 or room < -_PAST_LINE or own.cleared >= row.stop:
        return np.inf, False
    letter = letter_at(site, own.route, clock)
    needed = 0.5 * me.speed * me.speed / max(room, 0.1)
    if letter != RED and letter != YELLOW:
        own.marks &= ~STOPS
        standing = me.speed < _STANDS and room < _AT_LINE
        late = standing and when_green(site, own.route, clock) < one.start_up * own.headway
        return (room if late else np.inf), False
    if letter == RED and row.turn == _RIGHT and own.marks & TURNS_ON_RED and me.speed < 1.0 and room < _AT_LINE:
        return np.inf, True
    must_now = room - me.speed < 0.5 * me.speed * me.speed / one.braking
    if own.marks & STOPS == 0 and must_now and me.speed >= _STANDS:
        own.chooses = 1
        own.for_whom = NO_VEHICLE
        own.until = row.stop + 0.01
        own.goes = one.runs_red
        if letter == YELLOW:
            stays = exp(min((one.amber_braking - needed) / max(one.amber_spread, 0.01), 60.0))
            own.goes += (1.0 - one.runs_red) / (1.0 + stays)
        if needed > _HARDEST:
            own.goes = 1.0
    return room, False


@inlined_kernel
def _kept_free(w: World, i: int, j: int, there: float, site: NDArray[np.void]) -> float:
    """Compute the room to the stop line [m] of slot i, which keeps the junction free behind slot j; +inf: it need not.

    `there`: where slot j, ahead, is along slot i's route [m]. A driver does not enter behind one that crawls and leaves
    no room for it behind the junction.
    """
    row, me = site[0].route[w.agents[i].route], w.vehicles[i]
    room: float = row.stop - w.agents[i].s - 0.5 * me.length
    rear = there - 0.5 * w.vehicles[j].length
    if room < -_PAST_LINE or there < row.stop or w.vehicles[j].speed > _CRAWLS or rear > row.leaves + me.length + 1.0:
        return np.inf
    return room


@inlined_kernel
def _arrival(
    w: World, i: int, j: int, zone: Any, room: float, clock: float, on_red: bool, site: NDArray[np.void]
) -> tuple[int, float]:
    """Say what slot i owes slot j, which has `room` [m] to their zone, and when that will be there [s].

    Returns:
        2: it must give way; 1: the other has to, and does not; 0: nothing. Time, +inf if the other will stop.
    """
    one, agents, v = site[0], w.agents, w.vehicles
    other, row = agents[j], one.route[agents[j].route]
    speed = v[j].speed
    if v[j].kind == PERSON:
        walks = max(speed, 0.7 * v[j].desired_speed)
        if other.s > 0.05 and (speed > 0.0 or other.marks & BLIND):
            return 2, room / walks
        may_walk = row.signal < 0 or walk_letter(site, other.route, clock) == GREEN
        return (2, room / walks) if (zone.yields or other.s > 0.05) and may_walk else (0, np.inf)
    to_line = row.stop - other.s - 0.5 * v[j].length
    stopped = False
    if row.signal >= 0 and to_line > -_PAST_LINE:
        letter = letter_at(site, other.route, clock)
        if letter == RED or letter == YELLOW:
            if will_stop(speed, to_line):
                return 0, np.inf
            stopped = True
    arrival = _time_to(room, speed, max(row.limit, speed), _SETS_OFF)
    if (zone.yields or on_red) and not stopped:
        return 2, arrival
    goes = not will_stop(speed, room - _MARGIN) or (room < 1.0 and speed > _STANDS)
    return (1 if goes else 0), arrival


@inlined_kernel
def _critical_gap(w: World, i: int, j: int, kind: int, site: NDArray[np.void]) -> float:
    """Look up the gap that the driver of slot i needs before slot j [s]."""
    one, own = site[0], w.agents[i]
    if w.vehicles[j].kind == PERSON:
        gap: float = one.to_people * own.manners
        return gap
    turn = one.route[own.route].turn
    usual = one.gap_cross
    if turn == _LEFT:
        usual = one.gap_left
    elif turn == _RIGHT:
        usual = one.gap_right
    if kind == MERGE and one.route[own.route].signal < 0 and turn != _LEFT:
        usual = one.gap_enter
    gap = usual * own.gaps
    return gap


@kernel
def look_as_driver(w: World, i: int, clock: float, site: NDArray[np.void]) -> None:
    """Let the driver of slot i look around; `clock` is the time of the signals [s].

    A vehicle that is ahead on the same way is followed, by the IDM and no faster than is safe. In a zone that another
    is in it is not driven. Where it must give way, it needs a gap: time until the other arrives, less its own until it
    could wait before the zone. Zones without room to wait between them count as one. Once it has decided to go, it
    brakes only for what comes into its way all the same.

    Args:
        w: The world; `current` lists all that are there.
        i: Slot of a vehicle.
        clock: Time of the programme of the signals [s].
        site: The site.
    """
    one, v, agents = site[0], w.vehicles, w.agents
    me, own = v[i], agents[i]
    speed, place = me.speed, own.s
    wanted = max(0.5, me.desired_speed * speed_at(site, own.route, place + 0.5 * speed))
    strength = one.acceleration if me.kind == 0 else 0.6 * one.acceleration
    idm = IdmNumbers(strength, one.braking, one.standstill, one.headway * own.headway, wanted, _HARDEST)
    free = free_acceleration(speed, idm) if speed <= wanted else max(-one.braking, wanted - speed)
    own.chooses = 0
    own.goes = 1.0
    own.for_whom = NO_VEHICLE
    own.until = place
    own.unseen = 0
    own.most = np.inf
    if place > own.cleared and own.overlooks >= 0:
        own.overlooks = NO_VEHICLE
    room, on_red = _light(w, i, clock, site)
    lit = room < np.inf
    nearest = np.inf
    until = 0.0
    for k in range(w.state[0].n_current):
        j = w.current[k]
        agents[j].ratio = np.inf
        if j == i or own.overlooks == j or own.overlooks == ALL_OF_THEM:
            continue
        other = agents[j]
        half = 0.5 * (me.length + v[j].length)
        if other.route == own.route:
            if other.s > place or (other.s == place and j < i):
                free = _follow(w, i, j, other.s - place - half, wanted, idm, free)
                room = min(room, _kept_free(w, i, j, other.s, site))
            continue
        for meeting in range(MEETINGS):
            zone = one.zone[own.route, other.route, meeting]
            if zone.kind == NO_ZONE:
                break
            theirs = longer(v[j].length, v[j].kind == PERSON)
            to_other = zone.other_begin - theirs - other.s
            end = zone.end + longer(me.length, False)
            if other.s > zone.other_end + theirs or place > end:
                continue
            to_zone = zone.begin - longer(me.length, False) - place
            enters = _time_to(to_zone, speed, wanted, strength)
            crossing = zone.other_end + theirs - other.s
            if to_other <= 0.0:
                there = mapped(zone, other.s)
                if zone.kind != CROSS and (there > place or (there == place and j < i)):
                    free = _follow(w, i, j, there - place - half, wanted, idm, free)
                    room = min(room, _kept_free(w, i, j, there, site))
                    continue
                if zone.kind != CROSS and to_zone < 0.0:
                    continue
                if to_zone >= 0.0 and enters < crossing / max(v[j].speed, 0.3) + _MARGIN:
                    own.most = min(own.most, _to_stop(speed, to_zone - _MARGIN, one.braking))
            if to_zone < 0.0 and to_other <= _SOON * v[j].speed + _MARGIN:
                waits = zone.goes_first == 0 and (zone.yields != 0 or j < i)
                ahead = _room_along(w, i, j, strength if waits else 0.0, site)
                if ahead < np.inf:
                    own.most = min(own.most, _to_stop(speed, ahead - _CLOSE, one.braking))
            if to_other <= 0.0 or to_zone < 0.0 or (zone.kind == DIVERGE or zone.kind == SHARED):
                continue
            owes, arrival = _arrival(w, i, j, zone, to_other, clock, on_red, site)
            if owes == 0 and zone.yields == 0 and zone.goes_first == 0 and arrival < enters:
                owes = 1
            if owes == 0 or arrival + (crossing - to_other) / max(v[j].speed, 1.0) + _MARGIN < enters:
                continue
            if owes == 1 or (zone.begin < own.cleared and speed >= _UNDER_WAY):
                leaves = enters + (end - place - to_zone) / max(speed, 2.0)
                if arrival < leaves + _MARGIN and arrival < enters + 1.0:
                    own.most = min(own.most, _to_stop(speed, to_zone - _MARGIN, one.braking))
                continue
            reaches = max(0.0, to_zone - 1.0) / max(speed, 3.0)
            ratio = (arrival - reaches) / _critical_gap(w, i, j, zone.kind, site)
            if ratio < agents[j].ratio:
                agents[j].ratio = ratio
                agents[j].begins = zone.begin
            if ratio < _NO_DOUBT and zone.begin < nearest:
                nearest = zone.begin
                until = zone.until
    if nearest < np.inf and not lit:
        worst = _worst(w, i, until)
        left = nearest - longer(me.length, False) - place - _MARGIN
        now = (speed < 1.0 and left < _AT_LINE) or left - speed < 0.5 * speed * speed / one.braking
        room = min(room, left)
        if now and 0.5 * speed * speed <= _HARDEST * max(left, 0.1):
            taken = sure(agents[worst].ratio, one.gap_error)
            misses = one.overlooks_person if v[worst].kind == PERSON else one.overlooks_vehicle
            if own.heeds == worst:
                misses = 0.0
            own.chooses = 1
            own.goes = taken + (1.0 - taken) * misses
            own.for_whom = worst
            own.until = until
            own.unseen = 1 if taken < misses else 0
    own.free = min(free, own.most)
    own.stops = min(own.free, _to_stop(speed, room, one.braking)) if room < np.inf else own.free
    if own.chooses == 0:
        own.free = own.stops
        if room < np.inf:
            own.most = own.stops


@inlined_kernel
def _worst(w: World, i: int, until: float) -> int:
    """Find the slot with the smallest ratio of gap and critical gap, of those whose zones begin before `until` [m]."""
    agents, found = w.agents, NO_VEHICLE
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if (
            j != i
            and agents[j].ratio < np.inf
            and agents[j].begins <= until
            and (found < 0 or agents[j].ratio < agents[found].ratio)
        ):
            found = j
    return found
