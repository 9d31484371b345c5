"""How a driver at a site sees the world: who is ahead, whose way crosses, whether the gap is enough, the light.

`look_as_driver` writes it into the driver's `world.AGENT`: an acceleration with which it goes, one with which it gives
way, and, where it has to choose between the two, the chance that it goes. The laws are in docs/sites.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._elementary import exp, sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.idm import IdmNumbers, free_acceleration, idm_acceleration
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.sim.site.claims import (
    AT_LINE,
    BLIND,
    GOING,
    PAST_LINE,
    STOPS,
    TURNS_ON_RED,
    UNDER_WAY,
    goes_before,
    stands_still,
    surely_passes,
)
from cornerforge.sim.site.moves import (
    HARDEST,
    STANDS,
    STRONGEST,
    held_then_stops_within,
    seconds_of,
    still_stops,
    stops_within,
    sure,
    time_to,
    to_stop,
    will_stop,
)
from cornerforge.sim.world import ALL_OF_THEM, NO_VEHICLE
from cornerforge.site.network import TURNS
from cornerforge.site.tables import (
    CROSS,
    DIVERGE,
    MEETINGS,
    MERGE,
    NO_ZONE,
    RED,
    SHARED,
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

__all__ = ["look_as_driver", "room_before"]

_STEP, _FARTHEST = 0.5, 8.0
_CLOSE = 0.3
"""Room that is kept to what stands ahead in a zone that both are in [m]."""
_MARGIN = 0.5
"""Drivers stop so far before the place in which they would be in the way [m], and leave others so much time [s]."""
_CRAWLS, _STROLLS = 2.0, 0.5
_HALF = 0.5
"""A driver acts at whole seconds, so it resumes at the nearest one [s]."""
_LEFT, _RIGHT = TURNS.index("left"), TURNS.index("right")
_NO_DOUBT, _TOO_LATE = 3.0, 0.3
"""A gap so many times the critical one is taken; one that chose to go and still waits for the last to pass goes on
unless only so much of it is left."""
_LEAVES, _EDGE = 0.5, 0.1
"""Room that a driver leaves to its lead, and to a zone that is another's, however hard it has to brake [m]."""


@inlined_kernel
def _keep_room(w: World, i: int, room: float) -> None:
    """Let slot i accelerate no more than leaves it able to stop within a room [m], whatever it does in this second."""
    me, own = w.vehicles[i], w.agents[i]
    own.most = still_stops(me.speed, me.acceleration, room, own.most)


@inlined_kernel
def _follow(w: World, i: int, j: int, room: float, least: float, own: IdmNumbers, free: float) -> float:
    """Bound the acceleration `free` of slot i behind slot j at a room [m], and note what is safe in `most` [m/s2].

    Safe is what lets it stop behind slot j if that brakes now as hard as it can, or within `least` [m], before their
    ways meet.
    """
    me, lead = w.vehicles[i], w.vehicles[j]
    _keep_room(w, i, max(room - _LEAVES + lead.speed * lead.speed / (2.0 * HARDEST), least))
    return min(free, idm_acceleration(me.speed, max(room, least), lead.speed - me.speed, own))


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
def _room_along(w: World, i: int, j: int, site: NDArray[np.void]) -> float:
    """Compute the room along the route of slot i to the box of slot j [m]; +inf if it is not within `_FARTHEST`."""
    me, other, own = w.vehicles[i], w.vehicles[j], w.agents[i]
    theirs = Box(other.x, other.y, other.heading, other.length + _CLOSE, other.width + _CLOSE)
    steps = 1
    while steps * _STEP <= _FARTHEST:
        x, y, heading = pose_at(site, own.route, own.s + steps * _STEP)
        if boxes_overlap(Box(x, y, heading, me.length + _CLOSE, me.width + _CLOSE), theirs):
            return (steps - 1) * _STEP
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
    if row.signal < 0 or room < -PAST_LINE or own.cleared >= row.stop:
        return np.inf, False
    letter = letter_at(site, own.route, clock)
    needed = 0.5 * me.speed * me.speed / max(room, 0.1)
    if letter != RED and letter != YELLOW:
        own.marks &= ~STOPS
        standing = me.speed < STANDS and room < AT_LINE
        late = standing and when_green(site, own.route, clock) < one.start_up * own.headway
        return (room if late else np.inf), False
    if letter == RED and row.turn == _RIGHT and own.marks & TURNS_ON_RED and me.speed < 1.0 and room < AT_LINE:
        return np.inf, True
    must_now = room - me.speed < 0.5 * me.speed * me.speed / one.stopping
    if own.marks & STOPS == 0 and must_now and me.speed >= STANDS:
        own.chooses = 1
        own.for_whom = NO_VEHICLE
        own.until = row.stop + 0.01
        own.goes = one.runs_red
        if letter == YELLOW:
            stays = exp(min((one.amber_braking - needed) / max(one.amber_spread, 0.01), 60.0))
            own.goes += (1.0 - one.runs_red) / (1.0 + stays)
        if needed > HARDEST:
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
    if room < -PAST_LINE or there < row.stop or w.vehicles[j].speed > _CRAWLS or rear > row.leaves + me.length + 1.0:
        return np.inf
    return room


@inlined_kernel
def _arrival(
    w: World, j: int, zone: Any, room: float, clock: float, on_red: bool, site: NDArray[np.void]
) -> tuple[int, float]:
    """Say what another owes slot j, which has `room` [m] to their zone, and when that will be there [s].

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
        may_walk = row.signal < 0 or walk_letter(site, other.route, clock) != RED
        return (2, room / walks) if (zone.yields or other.s > 0.05) and may_walk else (0, np.inf)
    to_line = row.stop - other.s - 0.5 * v[j].length
    stopped = False
    if row.signal >= 0 and to_line > -PAST_LINE:
        letter = letter_at(site, other.route, clock)
        if letter in (RED, YELLOW):
            if will_stop(speed, to_line):
                return 0, np.inf
            stopped = True
    top = max(speed_at(site, other.route, zone.other_begin), speed)
    slower = 1.0 - speed / top
    arrival = time_to(room, speed, top, max(one.acceleration * slower * slower, 0.05))
    if (zone.yields or on_red) and not stopped:
        return 2, arrival
    goes = not will_stop(speed, room - _MARGIN) or (room < 1.0 and speed > STANDS)
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
    gap_needed: float = usual * own.gaps
    return gap_needed


@inlined_kernel
def _stays_able(
    w: World, i: int, j: int, meeting: int, ways: tuple[float, float, float], fresh: bool, clock: float,
    site: NDArray[np.void],
) -> bool:  # fmt: skip
    """Keep slot i able to stop before a zone that slot j goes first through.

    `ways`: how far i and j have to that zone [m], and when i leaves it [s].

    Returns:
        It passes before slot j, a person, all the same.
    """
    other = w.agents[j]
    zone = site[0].zone[w.agents[i].route, other.route, meeting]
    to_zone, to_other, leaves = ways
    first = goes_before(w, i, j, zone, to_zone, to_other, clock, site)
    if i == 0 and fresh:
        other.lets_av |= first << meeting
    elif i == 0:
        first = first and (other.lets_av >> meeting) & 1 != 0
    if first:
        return False
    if surely_passes(w, j, to_other, leaves):
        passes: bool = w.vehicles[j].kind == PERSON
        return passes
    _keep_room(w, i, to_zone - _EDGE)
    return False


@inlined_kernel
def _chooses(w: World, i: int, nearest: float, until: float, since: float, site: NDArray[np.void]) -> float:
    """Let slot i choose, if it must now, whether to go through the zones from `nearest` to `until` along its route [m].

    Critical gaps are published as times between two vehicles. So the gap before one that it has not given way to yet
    counts from when the one before that came into their zone, `since` [s]; later only what is left of the gap counts.

    Returns:
        Room to where it gives way [m]; +inf: it cannot any more, and the other has seen that.
    """
    one, me, own = site[0], w.vehicles[i], w.agents[i]
    worst = _worst(w, i, until)
    left: float = nearest - longer(me.length, False) - own.s - _MARGIN
    now = (me.speed < 1.0 and left < AT_LINE) or left - me.speed < 0.5 * me.speed * me.speed / one.stopping
    if me.speed >= UNDER_WAY and stops_within(me.speed, me.acceleration) > left:
        return np.inf
    if now:
        ratio = w.agents[worst].ratio
        sticks = False
        if w.vehicles[worst].kind != PERSON:
            sticks = own.marks & GOING != 0 and own.cleared > nearest and ratio > _TOO_LATE
            if since < np.inf and own.heeds != worst:
                ratio += since / _critical_gap(w, i, worst, CROSS, site)
        taken = 1.0 if sticks else sure(ratio, one.gap_error)
        misses = one.overlooks_person if w.vehicles[worst].kind == PERSON else one.overlooks_vehicle
        if own.heeds == worst:
            misses = 0.0
        own.chooses = 1
        own.goes = taken + (1.0 - taken) * misses
        own.for_whom = worst
        own.until = until
        own.unseen = 1 if taken < misses else 0
    return left


@kernel
def look_as_driver(w: World, i: int, clock: float, fresh: bool, site: NDArray[np.void]) -> None:  # noqa: PLR0915
    """Let the driver of slot i look around.

    A vehicle that is ahead on the same way is followed, by the IDM and no faster than is safe. Before a zone that
    another claims first it stays able to stop. Where it must give way, it needs a gap: time until the other arrives,
    less its own until it could wait before the zone. Zones without room to wait between them count as one. Once it has
    decided to go, it brakes only for what comes into its way all the same. One that stands in the junction goes before
    those that stand and do not set off.

    Args:
        w: The world; `current` lists all that are there.
        i: Slot of a vehicle.
        clock: Time of the programme of the signals [s].
        fresh: All agents decide now; within a second only the AV does.
        site: The site.
    """
    one, v, agents = site[0], w.vehicles, w.agents
    me, own = v[i], agents[i]
    speed, place = me.speed, own.s
    wanted = max(0.5, me.desired_speed * speed_at(site, own.route, place + 0.5 * speed))
    strength = one.acceleration if me.kind == 0 else 0.6 * one.acceleration
    idm = IdmNumbers(strength, one.braking, one.standstill, one.headway * own.headway, wanted, HARDEST)
    free = free_acceleration(speed, idm) if speed <= wanted else max(-one.stopping, wanted - speed)
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
    reach, waits_from, waits_to, since = np.inf, np.inf, np.inf, np.inf
    span = held_then_stops_within(speed, me.acceleration, STRONGEST)
    inside = place > one.route[own.route].stop
    nearest = np.inf
    until = 0.0
    for k in range(w.state[0].n_current):
        j = w.current[k]
        agents[j].ratio = np.inf
        if i == 0 and fresh:
            agents[j].lets_av = 0
        if j == i or own.overlooks == j or own.overlooks == ALL_OF_THEM:
            continue
        other = agents[j]
        half = 0.5 * (me.length + v[j].length)
        if other.route == own.route:
            if other.s > place or (other.s == place and j < i):
                free = _follow(w, i, j, other.s - place - half, -1.0, idm, free)
                room = min(room, _kept_free(w, i, j, other.s, site))
                reach = min(reach, other.s - half + v[j].speed * v[j].speed / (2.0 * HARDEST))
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
            if to_other <= 0.0 and zone.kind != CROSS:
                there = mapped(zone, other.s)
                if to_zone >= 0.0 or there > place or (there == place and j < i):
                    ahead = there - place - half
                    free = _follow(w, i, j, ahead, to_zone - _EDGE, idm, free)
                    room = min(room, _kept_free(w, i, j, there, site))
                    reach = min(reach, place + max(ahead, to_zone) + v[j].speed * v[j].speed / (2.0 * HARDEST))
                continue
            if zone.kind == DIVERGE or zone.kind == SHARED:
                continue
            if to_zone < 0.0:
                if to_other <= 0.0:
                    ahead = _room_along(w, i, j, site)
                    if ahead < np.inf:
                        _keep_room(w, i, ahead - _CLOSE)
                continue
            enters = time_to(to_zone, speed, wanted, strength)
            leaves = enters + (end - place - to_zone) / max(speed, 2.0)
            crossing = zone.other_end + theirs - other.s
            if span > to_zone - _EDGE and _stays_able(
                w, i, j, meeting, (to_zone, to_other, leaves), fresh, clock, site
            ):
                waits_from, waits_to = min(waits_from, to_zone - _EDGE), min(waits_to, end)
            if to_other <= 0.0:
                if v[j].kind == PERSON and speed < UNDER_WAY and to_zone < AT_LINE:
                    behind = one.after_people - enters
                    own.resumes = seconds_of(w) + crossing / max(v[j].speed, _STROLLS) + max(0.0, behind)
                elif zone.yields and v[j].kind != PERSON:
                    since = min(since, -to_other / max(v[j].speed, _CRAWLS))
                if enters < crossing / max(v[j].speed, 0.3) + _MARGIN:
                    own.most = min(own.most, to_stop(speed, to_zone - _MARGIN, one.stopping))
                continue
            if speed < UNDER_WAY and inside and v[j].kind != PERSON and stands_still(v[j]):
                continue
            owes, arrival = _arrival(w, j, zone, to_other, clock, on_red, site)
            if owes == 0 and zone.yields == 0 and zone.goes_first == 0 and arrival < enters:
                owes = 1
            if owes == 0 or arrival + (crossing - to_other) / max(v[j].speed, 1.0) + _MARGIN < enters:
                continue
            if owes == 1 or (zone.begin < own.cleared and speed >= UNDER_WAY):
                if arrival < leaves + _MARGIN and arrival < enters + _MARGIN:
                    own.most = min(own.most, to_stop(speed, to_zone - _MARGIN, one.stopping))
                continue
            reaches = max(0.0, to_zone - 1.0) / max(speed, 3.0)
            ratio = (arrival - reaches) / _critical_gap(w, i, j, zone.kind, site)
            if ratio < agents[j].ratio:
                agents[j].ratio = ratio
                agents[j].begins = zone.begin
            if ratio < _NO_DOUBT and zone.begin < nearest:
                nearest = zone.begin
                until = zone.until
    if reach < waits_to:
        _keep_room(w, i, waits_from)
    if speed < UNDER_WAY and own.resumes > seconds_of(w) + _HALF:
        room = min(room, _LEAVES)
    if nearest < np.inf and not lit:
        room = min(room, _chooses(w, i, nearest, until, since, site))
    own.free = min(free, own.most)
    own.stops = min(own.free, to_stop(speed, room, one.stopping)) if room < np.inf else own.free
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
