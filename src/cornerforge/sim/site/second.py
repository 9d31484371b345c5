"""One second at a site: agents come and go, decide, and move; `loop` and `step` call it where a road has its own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel, shared_kernel
from cornerforge._philox import PURPOSE_DECIDE, block, blocks
from cornerforge.sim.actions import nearest_action
from cornerforge.sim.controllers import HIDDEN
from cornerforge.sim.motion import go_on
from cornerforge.sim.outcome import COMPLETED
from cornerforge.sim.site.choice import act_at_site, draw_action, natural_choice
from cornerforge.sim.site.look import look_as_driver
from cornerforge.sim.site.moves import seconds_of
from cornerforge.sim.site.people import look_as_walker
from cornerforge.sim.steering import steer_at_site
from cornerforge.sim.world import COMES, GONE, HERE, NO_ACTION, moment_of
from cornerforge.site.tables import CROSS, longer, mapped, pose_at, speed_at
from cornerforge.types import FRAME_S, N_ACTIONS, PERSON, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = [
    "bring_in",
    "decide_at_site",
    "ends_at_site",
    "find_pairs_at_site",
    "follow_at_site",
    "has_arrived",
    "leave",
    "look_around",
    "move_agent",
    "warm_second",
]

_ROOM, _COMFORTABLE = 3.0, 3.0
"""Room that a vehicle needs to come in behind another [m], and the braking with which it could stop then [m/s2]."""
_CLOSE = 8.0
"""A vehicle does not come while another has to pass a zone that lies nearer than this to where it begins [m]."""
_SPURT = 4.0
"""More than any vehicle gains on its speed in a second by accelerating, and in the reach of its body [m]."""


@inlined_kernel
def look_around(w: World, i: int, site: NDArray[np.void]) -> None:
    """Let the agent in slot i look at the world of the coming decision."""
    clock = w.state[0].clock + seconds_of(w)
    if w.vehicles[i].kind == PERSON:
        look_as_walker(w, i, clock, site)
    else:
        look_as_driver(w, i, clock, True, site)


@shared_kernel
def decide_at_site(w: World, controlled_action: int, setting: Setting, s: Scratch) -> None:
    """Let every agent but the AV look and choose, from the state before any acts; the controlled one is told."""
    state = w.state[0]
    site = setting.road.site
    blocks(s.words, state.seed, state.test, moment_of(w), state.n_vehicles, PURPOSE_DECIDE)
    if s.steering.on[0]:
        steer_at_site(s.words, s.steering, state.n_vehicles)
    for k in range(state.n_current):
        i = w.current[k]
        if i > 0:
            look_around(w, i, site)
            hold = nearest_action(w.vehicles[i].commanded)
            action = draw_action(w, i, s.words[1, i], s.words[2, i], site)
            if i == state.controlled:
                action = controlled_action
                if action != hold:  # whoever does something else looks at the road
                    w.vehicles[i].away = 0
            w.vehicles[i].action = action


@shared_kernel
def follow_at_site(w: World, setting: Setting, s: Scratch, chances: NDArray[np.float64]) -> None:
    """Let every agent but the AV look, and take its action of the script, or where that has none its likeliest.

    The probabilities go into `chances` (K, N, 33) for the first K decisions.
    """
    state = w.state[0]
    step = state.decisions
    for k in range(state.n_current):
        i = w.current[k]
        if i == 0:
            continue
        look_around(w, i, setting.road.site)
        action: int = setting.who.script[step, i]
        recorded = step < chances.shape[0]
        if action >= HIDDEN + NO_ACTION:
            state.hidden = i
            action -= HIDDEN
        if recorded or action == NO_ACTION:
            natural_choice(w, i, setting.road.site, s.choice.p)
            best = 0
            for a in range(N_ACTIONS):
                if s.choice.p[a] > s.choice.p[best]:
                    best = a
                if recorded:
                    chances[step, i, a] = s.choice.p[a]
            if action == NO_ACTION:
                action = best
        w.vehicles[i].action = action


@inlined_kernel
def _room_at_start(w: World, i: int, site: NDArray[np.void]) -> tuple[float, float]:
    """Find the room from the begin of slot i's route to the nearest vehicle on it [m], and its speed [m/s]."""
    v, agents = w.vehicles, w.agents
    route = agents[i].route
    room, speed = np.inf, 0.0
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if v[j].kind == PERSON:
            continue
        ahead = agents[j].s
        if agents[j].route != route:
            zone = site[0].zone[route, agents[j].route, 0]
            if (
                zone.kind == CROSS
                and zone.begin < _CLOSE
                and agents[j].s <= zone.other_end + longer(v[j].length, False)
            ):
                return 0.0, 0.0
            if zone.kind == 0 or zone.begin > 0.0 or agents[j].s > zone.other_end:
                continue
            ahead = mapped(zone, agents[j].s)
        ahead -= 0.5 * (v[i].length + v[j].length)
        if ahead < room:
            room, speed = ahead, v[j].speed
    return room, speed


@kernel
def bring_in(w: World, site: NDArray[np.void]) -> None:
    """Let agents come whose time it is, each where its route begins; a vehicle waits until there is room for it.

    `current` lists all that are there; the new ones join it.
    """
    v, agents, state = w.vehicles, w.agents, w.state[0]
    time = seconds_of(w)
    for i in range(1, state.n_vehicles):
        own = agents[i]
        if own.stage != COMES or own.enters > time:
            continue
        speed = 0.0
        if v[i].kind != PERSON:
            room, ahead = _room_at_start(w, i, site)
            if room < _ROOM:
                continue
            speed = v[i].desired_speed * speed_at(site, own.route, 0.0)
            if room < np.inf:
                speed = min(speed, math.sqrt(ahead * ahead + 2.0 * _COMFORTABLE * (room - _ROOM)))
        own.stage = HERE
        v[i].present = 1
        v[i].speed = speed
        v[i].speed_held = speed
        v[i].x, v[i].y, v[i].heading = pose_at(site, own.route, 0.0)
        w.current[state.n_current] = i
        state.n_current += 1
    state.n_seen = state.n_current


@inlined_kernel
def move_agent(w: World, i: int, held: float, road: RoadNumbers) -> None:
    """Put the agent in slot i where it is `held` seconds after its last decision."""
    me, own = w.vehicles[i], w.agents[i]
    if me.kind == PERSON:
        own.s = min(me.x_held + me.speed * held, road.site[0].route[own.route].length)
    else:
        distance, at_top, after, now = go_on(me.speed_held, me.acceleration_held, me.commanded, held, road)
        own.s = me.x_held + distance + at_top
        me.acceleration = now
        me.speed = after
    me.x, me.y, me.heading = pose_at(road.site, own.route, own.s)


@inlined_kernel
def has_arrived(w: World, i: int, site: NDArray[np.void]) -> bool:
    """Has the agent in slot i come to the end of its route?"""
    done: bool = w.agents[i].s >= site[0].route[w.agents[i].route].length - 1e-9
    return done


@kernel
def leave(w: World, site: NDArray[np.void]) -> None:
    """Let all but the AV go that have come to the end of their routes, and list those that stay."""
    state = w.state[0]
    kept = 0
    for k in range(state.n_current):
        i = w.current[k]
        if i > 0 and w.vehicles[i].present and has_arrived(w, i, site):
            w.vehicles[i].present = 0
        if w.vehicles[i].present:
            w.current[kept] = i
            kept += 1
        else:
            w.agents[i].stage = GONE
    state.n_current = kept
    state.n_seen = kept


@shared_kernel
def find_pairs_at_site(w: World) -> None:
    """List the pairs that can touch within the coming second, two people left out."""
    v, state = w.vehicles, w.state[0]
    found = 0
    for k in range(state.n_current):
        i = w.current[k]
        reach = v[i].speed + _SPURT + 0.5 * v[i].length + 0.5 * v[i].width
        for other in range(k + 1, state.n_current):
            j = w.current[other]
            if v[i].kind == PERSON and v[j].kind == PERSON:
                continue
            both = reach + v[j].speed + _SPURT + 0.5 * v[j].length + 0.5 * v[j].width
            if abs(v[j].x - v[i].x) < both and abs(v[j].y - v[i].y) < both:
                w.pairs[found, 0] = min(i, j)
                w.pairs[found, 1] = max(i, j)
                found += 1
    state.n_pairs = found


@kernel
def warm_second(w: World, road: RoadNumbers) -> None:
    """Drive a second without an AV: of the warm-up, in which vehicles that crash are not taken away."""
    state = w.state[0]
    for k in range(state.n_current):
        i = w.current[k]
        look_around(w, i, road.site)
        words = block(state.seed, state.test, state.decisions, i, PURPOSE_DECIDE)
        w.vehicles[i].action = draw_action(w, i, words[1], words[2], road.site)
    for k in range(state.n_current):
        i = w.current[k]
        act_at_site(w, i, w.vehicles[i].action, road)
    for k in range(state.n_current):
        move_agent(w, w.current[k], SUBSTEPS * FRAME_S, road)
    state.decisions += 1
    leave(w, road.site)


@inlined_kernel
def ends_at_site(w: World, frame: int, whole: bool, site: NDArray[np.void]) -> bool:
    """Has the AV come to the end of its route? At a second's end (`whole`) others come and go."""
    state = w.state[0]
    if has_arrived(w, 0, site):
        state.outcome = COMPLETED
        state.frame = frame
        return True
    if whole:
        leave(w, site)
        bring_in(w, site)
    return False
