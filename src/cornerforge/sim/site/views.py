"""Critical agent at a site, and what an adversary that steers it sees of it and the AV.

`observe`, `neighbours` and `adversaries` of `sim` call it where a road has its own.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.site.moves import seconds_of
from cornerforge.sim.world import NO_VEHICLE
from cornerforge.site.network import TURNS
from cornerforge.site.tables import (
    CROSS,
    MEETINGS,
    NO_ZONE,
    SHARED,
    longer,
    mapped,
)
from cornerforge.types import PERSON, TRUCK

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.world import World

__all__ = [
    "ACCELERATION", "AHEAD", "AV_ACCELERATION", "AV_CHANGES", "AV_LIGHT", "AV_ROOM", "AV_SPEED", "AV_TIME", "CHANGES",
    "CHOOSES", "CLASS", "FREE", "LATER", "LIGHT", "MERGES", "PER_METRE", "PER_MPS", "PER_SECOND", "ROOM", "SPEED",
    "TIME", "TURN", "YIELDS", "Meeting", "critical_agent", "meeting_with_av", "observe_agent",
]  # fmt: skip

(
    AV_TIME, AV_ROOM, AV_SPEED, AV_ACCELERATION, TIME, ROOM, SPEED, ACCELERATION, LATER, CLASS, TURN, AHEAD, MERGES,
    YIELDS, AV_LIGHT, AV_CHANGES, LIGHT, CHANGES, CHOOSES, FREE,
) = range(20)  # fmt: skip
"""Entries of the observation at a site (`observe_agent`)."""
PER_SECOND, PER_METRE, PER_MPS = 0.2, 1.0 / 30.0, 0.1
"""Entries per second, metre, and metre per second."""
_LATER_COUNTS = 0.2
"""A meeting that is so much later counts like one at which the times differ by a second more."""
_SETS_OFF = 1.5
"""Acceleration with which a vehicle that is slower than its limit is thought to go on [m/s2]."""
_LEFT, _RIGHT = TURNS.index("left"), TURNS.index("right")
_LIGHTS = np.array([-1.0, -0.5, 1.0, 0.5])
_MOST = 3.0


class Meeting(NamedTuple):
    """Place and time at which the AV and another agent would meet.

    Attributes:
        apart: By how much their times differ; in one lane the time gap [s]; +inf: they do not meet.
        av_time, time: Times until the AV and the other are at their common zone [s], 0 within it; in one lane that of
            the one behind is the time gap.
        av_room, room: Distances likewise [m].
        begins: Where the zone begins along the other's route [m].
        kind: Kind of the zone; SHARED: in one lane; NO_ZONE: they do not meet.
        ahead: In one lane 1 if the other is ahead of the AV, and -1 if it is behind; else 0.
        yields: 1 if the AV must yield to the other, -1 if the other must, 0 if neither or both.
    """

    apart: float
    av_time: float
    time: float
    av_room: float
    room: float
    begins: float
    kind: int
    ahead: float
    yields: float


@inlined_kernel
def _time_over(room: float, speed: float, top: float) -> float:
    """Compute how long a vehicle takes for a distance [s] that goes on at its speed, or sets off up to `top` [m/s]."""
    if room <= 0.0:
        return 0.0
    if speed >= top:
        return room / speed
    way = 0.5 * (top * top - speed * speed) / _SETS_OFF
    if way >= room:
        return (math.sqrt(speed * speed + 2.0 * _SETS_OFF * room) - speed) / _SETS_OFF
    return (top - speed) / _SETS_OFF + (room - way) / top


@inlined_kernel
def _in_one_lane(w: World, j: int, there: float) -> Meeting:
    """Meet slot j in the AV's lane, where it is at `there` [m] along the AV's route."""
    v = w.vehicles
    behind = 0 if there > w.agents[0].s else j
    room = max(abs(there - w.agents[0].s) - 0.5 * (v[0].length + v[j].length), 0.0)
    time = room / max(v[behind].speed, 1.0)
    of_av, other = (time, 0.0) if behind == 0 else (0.0, time)
    return Meeting(time, of_av, other, room, room, 0.0, SHARED, 1.0 if behind == 0 else -1.0, 0.0)


@kernel
def meeting_with_av(w: World, j: int, site: NDArray[np.void]) -> Meeting:
    """Find the meeting of the agent in slot j with the AV at which their times differ least, sooner ones preferred."""
    one, v, av, other = site[0], w.vehicles, w.agents[0], w.agents[j]
    found = Meeting(np.inf, np.inf, np.inf, np.inf, np.inf, 0.0, NO_ZONE, 0.0, 0.0)
    walks = v[j].kind == PERSON
    if other.route == av.route:
        return _in_one_lane(w, j, other.s)
    row, theirs = one.route[other.route], longer(v[j].length, walks)
    nearest = np.inf
    for meeting in range(MEETINGS):
        zone = one.zone[av.route, other.route, meeting]
        if zone.kind == NO_ZONE:
            break
        mine = longer(v[0].length, False)
        if av.s > zone.end + mine or other.s > zone.other_end + theirs:
            continue
        av_room, room = zone.begin - mine - av.s, zone.other_begin - theirs - other.s
        if zone.kind != CROSS and av_room <= 0.0 and room <= 0.0:
            return _in_one_lane(w, j, mapped(zone, other.s))
        av_time = _time_over(av_room, v[0].speed, one.route[av.route].limit)
        if walks:
            time = max(room, 0.0) / max(v[j].speed, v[j].desired_speed)
        else:
            time = _time_over(room, v[j].speed, row.limit)
        apart = abs(av_time - time)
        if apart + _LATER_COUNTS * av_time < nearest:
            nearest = apart + _LATER_COUNTS * av_time
            yields = float(zone.yields - zone.goes_first)
            found = Meeting(
                apart, av_time, time, max(av_room, 0.0), max(room, 0.0), zone.other_begin, zone.kind, 0.0, yields
            )
    return found


@kernel
def critical_agent(w: World, site: NDArray[np.void]) -> int:
    """Find the vehicle or person that meets the AV nearest in time; the nearest one if none meets it; -1 for none.

    Times to the common zone of both differ least, or it is ahead or behind in the AV's lane by the least time gap;
    sooner meetings are preferred: 5 s of time count like 1 s of difference.
    """
    v = w.vehicles
    best, nearest = NO_VEHICLE, np.inf
    aside, closest = NO_VEHICLE, np.inf
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if j == 0:
            continue
        met = meeting_with_av(w, j, site)
        if met.kind != NO_ZONE:
            value = met.apart + _LATER_COUNTS * min(met.av_time, met.time)
            if value < nearest:
                best, nearest = j, value
        dx, dy = v[j].x - v[0].x, v[j].y - v[0].y
        if dx * dx + dy * dy < closest:
            aside, closest = j, dx * dx + dy * dy
    return best if best >= 0 else aside


@inlined_kernel
def _light_of(site: NDArray[np.void], route: int, clock: float) -> tuple[float, float]:
    """Show the light of a route, and for how long it stays [s], at most a cycle; 0 and 0 without one."""
    one = site[0]
    signal = one.route[route].signal
    if signal < 0 or one.phases == 0:
        return 0.0, 0.0
    time = clock % one.cycle
    phase = 0
    while phase < one.phases - 1 and time >= one.phase_ends[phase]:
        phase += 1
    now = one.letters[phase, signal]
    stays = one.phase_ends[phase] - time
    for later in range(1, one.phases):
        p = (phase + later) % one.phases
        if one.letters[p, signal] != now:
            break
        stays += one.phase_ends[p] - (one.phase_ends[p - 1] if p > 0 else 0.0)
    return _LIGHTS[now], stays


@inlined_kernel
def _clip(value: float) -> float:
    return max(-_MOST, min(_MOST, value))


@inlined_kernel
def _show(w: World, bv: int, j: int, place: int, out: NDArray[np.float32]) -> None:
    """Show slot j to slot bv, in its frame, from entry `place` on."""
    v = w.vehicles
    sine, cosine = sin_cos(v[bv].heading)
    across, along = sin_cos(v[j].heading - v[bv].heading)
    dx, dy = v[j].x - v[bv].x, v[j].y - v[bv].y
    out[place] = _clip((dx * cosine + dy * sine) * PER_METRE)
    out[place + 1] = _clip((dy * cosine - dx * sine) * PER_METRE)
    out[place + 2] = _clip((v[j].speed * along - v[bv].speed) * PER_MPS)
    out[place + 3] = _clip(v[j].speed * across * PER_MPS)
    out[place + 4] = 0.5 if v[j].kind == PERSON else 1.0


@inlined_kernel
def _show_way(w: World, slot: int, time: float, room: float, at: int, out: NDArray[np.float32]) -> None:
    """Show time, distance, speed and acceleration of a slot on its way to the common zone, from entry `at` on."""
    out[at] = _clip(time * PER_SECOND)
    out[at + 1] = _clip(room * PER_METRE)
    out[at + 2] = w.vehicles[slot].speed * PER_MPS
    out[at + 3] = 0.25 * w.vehicles[slot].acceleration


@kernel
def observe_agent(
    w: World, bv: int, site: NDArray[np.void], first: int, found: NDArray[np.int64], out: NDArray[np.float32]
) -> None:
    """Write what an adversary sees of the agent in slot `bv`, which has looked around, and of the AV.

    Nothing tells critical gaps or traits. Entries of `out`, which is 0 before:

    0 to 3, of the AV: time to the common zone / 5 s, distance to it / 30 m, speed / 10 m/s, acceleration / 4 m/s2.
    4 to 7: the same of the agent. In one lane the one behind has time gap and gap, and the one ahead 0 s.
    8: by how much the agent is later there / 2 s. 9: its class, 0 a car, 0.5 a truck, 1 a person. 10: it turns left (1)
    or right (-1). 11: in one lane, 1 ahead of the AV, -1 behind. 12: 1 if the two merge, 0 if they cross. 13: 1 if the
    AV must yield, -1 if the agent must. 14, 15: the AV's light: 0 none, -1 red, -0.5 yellow, 1 green, 0.5 green that
    yields, and the time until it changes / 10 s. 16, 17: the same of the agent's light. 18: 1 if the agent has to
    choose between going and giving way. 19: acceleration / 4 m/s2, of a person speed / 4 m/s, with which it would go.
    From `first` on, what is there of the AV and of the three agents nearest to the agent, in its frame: ahead / 30 m,
    to the left / 30 m, by how much it is faster along the agent's heading, and its speed to the left / 10 m/s, and 1
    for a vehicle, 0.5 for a person. Entries are cut off at 3, and -3.

    Args:
        w: The world.
        bv: Slot of the agent.
        site: The site.
        first: Where the entries about others begin.
        found: Scratch, int64 (4,).
        out: Where the entries go.
    """
    me, own = w.vehicles[bv], w.agents[bv]
    met = meeting_with_av(w, bv, site)
    clock = w.state[0].clock + seconds_of(w)
    _show_way(w, 0, met.av_time, met.av_room, AV_TIME, out)
    _show_way(w, bv, met.time, met.room, TIME, out)
    if met.kind != NO_ZONE:
        out[LATER] = _clip(0.5 * (met.time - met.av_time))
        out[AHEAD] = met.ahead
        out[MERGES] = 0.0 if met.kind == CROSS else 1.0
        out[YIELDS] = met.yields
    turn = site[0].route[own.route].turn
    out[CLASS] = 1.0 if me.kind == PERSON else (0.5 if me.kind == TRUCK else 0.0)
    out[TURN] = 1.0 if turn == _LEFT else (-1.0 if turn == _RIGHT else 0.0)
    out[AV_LIGHT], stays = _light_of(site, w.agents[0].route, clock)
    out[AV_CHANGES] = _clip(0.1 * stays)
    out[LIGHT], stays = _light_of(site, own.route, clock)
    out[CHANGES] = _clip(0.1 * stays)
    out[CHOOSES] = own.chooses
    out[FREE] = 0.25 * own.free
    _show(w, bv, 0, first, out)
    for n in range(_nearest_agents(w, bv, found)):
        _show(w, bv, found[n], first + 5 * (n + 1), out)


@inlined_kernel
def _nearest_agents(w: World, bv: int, found: NDArray[np.int64]) -> int:
    """List the slots of the three agents nearest to slot `bv`, but for the AV; return how many there are."""
    v = w.vehicles
    count, last = 0, -1.0
    while count < 3:
        nearest, best = np.inf, NO_VEHICLE
        for k in range(w.state[0].n_current):
            j = w.current[k]
            dx, dy = v[j].x - v[bv].x, v[j].y - v[bv].y
            squared = dx * dx + dy * dy
            if j > 0 and j != bv and last < squared < nearest:
                nearest, best = squared, j
        if best < 0:
            break
        found[count] = best
        last = nearest
        count += 1
    return count
