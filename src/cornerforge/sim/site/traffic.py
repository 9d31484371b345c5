"""Start of a test at a site: who comes when and by which route, the warm-up, and the AV."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._elementary import exp, log
from cornerforge._jit import inlined_kernel, kernel, shared_kernel
from cornerforge._philox import PURPOSE_CLASS, PURPOSE_INITIAL, PURPOSE_TRAITS, block, normal_pair, uniform
from cornerforge.drivers.avs import MANNERS, AvNumbers
from cornerforge.errors import UndrawableError
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.sim.outcome import UNDRAWN
from cornerforge.sim.site.claims import EARLY, TURNS_ON_RED
from cornerforge.sim.site.moves import WARM_STEP
from cornerforge.sim.site.second import bring_in, find_pairs_at_site, warm_second
from cornerforge.sim.world import COMES, GONE, HERE, NO_ACTION, NO_VEHICLE, list_all
from cornerforge.site.laws import WALK_SHARES
from cornerforge.site.signals import first_clock
from cornerforge.site.tables import WALK, WARM_UP, longer, mapped, pose_at, speed_at
from cornerforge.types import CAR, CLASSES, PERSON, TRUCK

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = ["reset_at_site"]

_TOO_MANY = "more vehicles and people came than a world has room for; ask for fewer (site_traffic)."
_CHANGE_TIME = 4.0
"""How long lane changes would take, if there were any [s]: a body of a recording has such a time."""
_LEAST_HEADWAY = 2.0
"""Two vehicles come by one lane at least so long after each other [s]."""
_TRUCK = (7.5, 2.3)
"""Length and width of trucks that come to junctions: of deliveries, for which Mcity's turns have room [m]."""
_PERSON = (CLASSES[PERSON].length, CLASSES[PERSON].width)
_SHARES = np.array(WALK_SHARES)
_MANNERS = np.array([manner[:3] for manner in MANNERS.values()])
_AV_FIRST = 3.0
"""None comes by the AV's lane within so long of it [s]."""
_COMFORTABLE, _ROOM = 3.0, 4.0


@inlined_kernel
def _draw(w: World, slot: int, purpose: int) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    state = w.state[0]
    return block(state.seed, state.test, 0, slot, purpose)


@kernel
def _route_from(site: NDArray[np.void], approach: int, draw: float) -> int:
    """Choose a route of an approach by the shares of routes, with a number in (0, 1)."""
    found = -1
    for route in range(site[0].routes):
        if site[0].route[route].approach == approach:
            found = route
            draw -= site[0].route[route].weight
            if draw < 0.0:
                break
    return found


@kernel
def _walking_speed(site: NDArray[np.void], draw: float) -> float:
    """Look up the walking speed of which a share `draw` of people walk at most as fast [m/s]."""
    k = 0
    while k < _SHARES.size - 2 and draw >= _SHARES[k + 1]:
        k += 1
    walks = site[0].walks
    speed: float = walks[k] + (draw - _SHARES[k]) / (_SHARES[k + 1] - _SHARES[k]) * (walks[k + 1] - walks[k])
    return speed


@kernel
def _give_traits(w: World, i: int, site: NDArray[np.void]) -> None:
    """Draw what the agent in slot i is like; its route is known."""
    one, own, me = site[0], w.agents[i], w.vehicles[i]
    words, more = _draw(w, i, PURPOSE_TRAITS), _draw(w, i, PURPOSE_CLASS)
    z_headway, z_gap = normal_pair(words[0], words[1])
    z_manners, z_pace = normal_pair(words[2], words[3])
    if one.route[own.route].turn == WALK:
        me.kind = PERSON
        me.length, me.width = _PERSON
        me.desired_speed = _walking_speed(site, uniform(more[0]))
        own.gaps = exp(one.gap_walk_spread * z_gap)
        own.manners = exp(one.gives_way_spread * z_manners)
        own.marks = EARLY if uniform(more[3]) < one.starts_early else 0
        own.headway = 0.0 if uniform(more[1]) < one.obeys else -one.patience * log(uniform(more[2]))
        return
    if uniform(more[0]) < one.trucks:
        me.kind = TRUCK
        me.length, me.width = _TRUCK
    own.headway = exp(one.headway_spread * z_headway)
    own.gaps = exp(one.gap_spread * z_gap)
    own.manners = exp(one.to_people_spread * z_manners)
    own.marks = TURNS_ON_RED if uniform(more[1]) < one.right_on_red else 0
    me.desired_speed = one.pace * exp(one.pace_spread * z_pace)


@kernel
def _schedule(w: World, av_approach: int, seconds: float, site: NDArray[np.void], car: tuple[float, float]) -> bool:
    """Draw who comes by each approach in the warm-up and the test, from slot 1 on; False if slots run out.

    Times between arrivals are exponential, those of vehicles of one lane with a least headway.
    """
    one, state = site[0], w.state[0]
    for approach in range(one.approaches):
        walks = one.route[_route_from(site, approach, 0.0)].turn == WALK
        rate = (one.people if walks else one.vehicles) / 3600.0
        least = 0.0 if walks else _LEAST_HEADWAY
        if rate <= 0.0:
            continue
        mean = max(1.0 / rate - least, 0.0)
        time = -WARM_UP
        while True:
            i = state.n_vehicles
            if i >= w.vehicles.size:
                return False
            words = _draw(w, i, PURPOSE_INITIAL)
            time += least - mean * log(uniform(words[0]))
            if time >= seconds:
                break
            if approach == av_approach and abs(time) < _AV_FIRST:
                continue
            _join(w, i, _route_from(site, approach, uniform(words[1])), time, car)
            _give_traits(w, i, site)
            state.n_vehicles += 1
    return True


@kernel
def _join(w: World, i: int, route: int, enters: float, car: tuple[float, float]) -> None:
    """Put an agent that has not come yet into a slot."""
    me, own = w.vehicles[i], w.agents[i]
    me.kind = CAR
    me.length, me.width = car
    me.present = 0
    me.action = NO_ACTION
    me.away = 0
    me.target_lane = route
    own.route = route
    own.stage = COMES
    own.enters = enters
    own.s = 0.0
    own.cleared = 0.0
    own.overlooks = NO_VEHICLE
    own.heeds = NO_VEHICLE
    own.resumes = -WARM_UP
    own.marks = 0
    own.headway = 1.0
    own.gaps = 1.0
    own.manners = 1.0
    me.desired_speed = 1.0
    me.speed = 0.0
    me.acceleration = 0.0
    me.acceleration_held = 0.0
    me.commanded = 0.0
    me.speed_held = 0.0
    me.x_held = 0.0
    me.lateral_speed = 0.0
    me.duration = 0.0
    me.lanes = 1
    me.change_time = _CHANGE_TIME


@kernel
def _put_av(w: World, av: AvNumbers, site: NDArray[np.void]) -> None:
    """Put the AV at the begin of its route, as fast as it may drive there and can behind what is ahead."""
    v, agents = w.vehicles, w.agents
    own = agents[0]
    speed = speed_at(site, own.route, 0.0)
    for j in range(1, w.state[0].n_vehicles):
        if v[j].present == 0 or v[j].kind == PERSON:
            continue
        zone = site[0].zone[own.route, agents[j].route, 0]
        ahead = agents[j].s
        if agents[j].route != own.route:
            begins = zone.other_begin - longer(v[j].length, False)
            if zone.kind == 0 or zone.begin > 0.0 or not begins <= agents[j].s <= zone.other_end:
                continue
            ahead = mapped(zone, agents[j].s)
        room = ahead - 0.5 * (v[0].length + v[j].length) - _ROOM
        if room < 0.0:
            v[j].present = 0
            agents[j].stage = GONE
        else:
            speed = min(speed, math.sqrt(v[j].speed * v[j].speed + 2.0 * _COMFORTABLE * room))
    own.stage = HERE
    own.headway, own.gaps, own.manners = _MANNERS[av.junction, 0], _MANNERS[av.junction, 1], _MANNERS[av.junction, 2]
    v[0].present = 1
    v[0].speed = speed
    v[0].speed_held = speed
    v[0].x, v[0].y, v[0].heading = pose_at(site, own.route, 0.0)


@kernel
def _part(w: World) -> None:
    """Take away one of two that touch after the warm-up, in which contacts are not looked for."""
    v, state = w.vehicles, w.state[0]
    find_pairs_at_site(w)
    for k in range(state.n_pairs):
        a, b = w.pairs[k, 0], w.pairs[k, 1]
        if (
            v[a].present
            and v[b].present
            and boxes_overlap(
                Box(v[a].x, v[a].y, v[a].heading, v[a].length, v[a].width),
                Box(v[b].x, v[b].y, v[b].heading, v[b].length, v[b].width),
            )
        ):
            v[b].present = 0
            w.agents[b].stage = GONE
    list_all(w)


@shared_kernel
def reset_at_site(w: World, setting: Setting) -> None:
    """Put a cleared world at the start of its test at a site: traffic that has driven for a while, and the AV.

    The AV's route is drawn as those of others are. Nothing of the warm-up depends on the AV, but that none comes right
    before it by its lane, and what stands where it starts is taken away.

    Raises:
        UndrawableError: More come than a world has room for, as in one test of 1e9.
    """
    road = setting.road
    site, state = road.site, w.state[0]
    words = _draw(w, 0, PURPOSE_INITIAL)
    lanes = 0
    for route in range(site[0].vehicle_routes):
        lanes = max(lanes, site[0].route[route].approach + 1)
    approach = min(lanes - 1, math.floor(uniform(words[0]) * lanes))
    car = (road.length, road.width)
    _join(w, 0, _route_from(site, approach, uniform(words[1])), 0.0, car)
    state.clock = first_clock(site[0].cycle, state.seed, state.test)
    state.n_vehicles = 1
    if not _schedule(w, approach, float(road.max_decisions), site, car):
        state.outcome = UNDRAWN
        raise UndrawableError(_TOO_MANY)
    state.decisions = WARM_STEP
    for _ in range(int(WARM_UP)):
        bring_in(w, site)
        warm_second(w, road)
    state.decisions = 0
    state.bv_crashes = 0
    state.controlled = NO_VEHICLE
    _put_av(w, setting.av, site)
    list_all(w)
    _part(w)
    bring_in(w, site)
