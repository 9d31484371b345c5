"""World as its AV perceives it: others late, unseen or displaced, by `perception.Perception`.

What is lost, and by how much a vehicle is displaced, is drawn of the test's name, the second and the vehicle, never of
the branch of a tree: in all branches of a test the AV's sensors err alike. At a site agents are seen late and displaced
along their routes, and aside of them. An adversary with a likelihood budget may
also make the AV lose the BV that it controls, at the price of a natural loss (`lose_controlled`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._elementary import log, sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import PURPOSE_PERCEIVE, block, normal_pair, uniform
from cornerforge.fields import FRAME_FIELDS, REALS
from cornerforge.road.straight import ahead_by, go_further, lane_bits, lane_centre, road_numbers
from cornerforge.sim.observe import price
from cornerforge.sim.world import NO_VEHICLE, World, all_current, allocate_worlds, world_of
from cornerforge.site.tables import MEETINGS, NO_ZONE, at_site, beside, nearest_place, pose_at
from cornerforge.types import FRAME_S, PERSON, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import AvScratch
    from cornerforge.types import Scenario

__all__ = [
    "MOST_HIDDEN",
    "begin_to_remember",
    "hidden_by",
    "lose_controlled",
    "losses_price",
    "perceived",
    "remember",
    "show_as_is",
    "show_as_seen",
]

MOST_HIDDEN = 63
"""Seconds that can be told of a case: its file has a bit for each."""
_ACROSS = 1.0 / 3.0
"""Noise across the road over noise along it."""
_RAYS = 5
_INSET = 0.02
_NEAR_S, _BESIDE_M = 2.0, 15.0
"""An adversary hides a BV that is within so much of the AV's way ahead [s], or in the next lane within so much [m]."""
_SOON_S, _WALKING = 4.0, 1.5
"""At a site one whose route meets the AV's within so much of its way [s], at this speed or more [m/s]."""


@inlined_kernel
def _tenth(w: World, substep: int) -> int:
    """Count the tenths of a second since the start."""
    state = w.state[0]
    second: int = state.decisions if substep == 0 else state.decisions - 1
    return SUBSTEPS * second + substep


@inlined_kernel
def _parts(w: World) -> int:
    """Count the parts of `World.seen` that hold the past."""
    parts: int = w.seen.size // w.order.size - 1
    return parts


@inlined_kernel
def _past(w: World, part: int, i: int) -> int:
    """Find the place in `World.seen` of vehicle i in one of these parts."""
    place: int = (1 + part) * w.order.size + i
    return place


@inlined_kernel
def _note(w: World, part: int) -> None:
    v = w.vehicles
    for i in range(w.state[0].n_vehicles):
        then = w.seen[_past(w, part, i)]
        then.x = v[i].x
        then.y = v[i].y
        then.speed = v[i].speed
        then.lateral_speed = v[i].lateral_speed
        then.heading = v[i].heading
        then.acceleration = v[i].acceleration
        then.target_lane = v[i].target_lane
        then.lanes = v[i].lanes
        then.as_what = 1 if v[i].duration > 0.0 else 0
        if w.agents.size > 0:
            then.x = w.agents[i].s
            then.as_what = v[i].present


@kernel
def begin_to_remember(w: World, road: RoadNumbers) -> None:
    """Note the start of a test as all that was before it, where the AV sees late.

    Raises:
        RuntimeError: The world was allocated without room for it (`world.allocate_worlds`).
    """
    if _parts(w) <= road.perception.late:
        raise RuntimeError("a world without room for what its AV sees late")
    for part in range(_parts(w)):
        _note(w, part)


@kernel
def remember(w: World, substep: int) -> None:
    """Note where all are now, for an AV that sees late; once more at the same moment changes nothing."""
    _note(w, _tenth(w, substep) % _parts(w))


@inlined_kernel
def _carry_on(w: World, i: int, part: int, time: float, road: RoadNumbers) -> None:
    """Put vehicle i where one would expect it that saw it `time` [s] ago: on the way and at the speeds of then.

    At a site one that had not come then is not seen.
    """
    v, then = w.vehicles, w.seen[_past(w, part, i)]
    v[i].speed = then.speed
    if at_site(road.site):
        v[i].acceleration = then.acceleration
        v[i].present = then.as_what
        _put_on_route(w, i, then.x, time * then.speed, 0.0, road.site)
        return
    v[i].x = then.x
    go_further(v, i, time * then.speed)
    v[i].lateral_speed = then.lateral_speed
    v[i].y = then.y + time * then.lateral_speed
    v[i].heading = then.heading
    v[i].acceleration = then.acceleration
    v[i].target_lane = then.target_lane
    v[i].duration = 1.0 if then.as_what else 0.0
    _leave_on_straight_path(w, i, road)


@kernel
def _put_on_route(w: World, i: int, s: float, further: float, aside: float, site: NDArray[np.void]) -> None:
    """Put the agent in slot i so much further than s [m] along its route, and so far to the left of it [m]."""
    own, me = w.agents[i], w.vehicles[i]
    own.s = max(0.0, min(s + further, site[0].route[own.route].length))
    me.x, me.y, me.heading = beside(pose_at(site, own.route, own.s), aside)


@inlined_kernel
def _leave_on_straight_path(w: World, i: int, road: RoadNumbers) -> None:
    """Let vehicle i be on a lateral path of constant speed, if it changes lanes, and in the lanes that it touches."""
    v = w.vehicles
    v[i].clock = 0.0
    v[i].c0 = v[i].y
    v[i].c1 = v[i].lateral_speed
    v[i].c2 = v[i].c3 = v[i].c4 = v[i].c5 = 0.0
    v[i].lanes = lane_bits(v[i].y, 0.5 * v[i].width, v[i].target_lane, road.lane_width)


@inlined_kernel
def _displace(w: World, i: int, second: int, share: float, road: RoadNumbers) -> None:
    """Displace vehicle i by an error that goes evenly from that of this second to that of the next."""
    state, v = w.state[0], w.vehicles
    words = block(state.seed, state.test, second, i, PURPOSE_PERCEIVE)
    x_now, y_now = normal_pair(words[0], words[1])
    words = block(state.seed, state.test, second + 1, i, PURPOSE_PERCEIVE)
    x_next, y_next = normal_pair(words[0], words[1])
    along, across = road.perception.noise, _ACROSS * road.perception.noise
    if at_site(road.site):
        further, aside = along * (x_now + share * (x_next - x_now)), across * (y_now + share * (y_next - y_now))
        v[i].speed = max(0.0, v[i].speed + along * (x_next - x_now))
        _put_on_route(w, i, w.agents[i].s, further, aside, road.site)
        return
    go_further(v, i, along * (x_now + share * (x_next - x_now)))
    v[i].speed = max(0.0, v[i].speed + along * (x_next - x_now))
    v[i].y += across * (y_now + share * (y_next - y_now))
    v[i].lateral_speed += across * (y_next - y_now)
    _leave_on_straight_path(w, i, road)


@inlined_kernel
def _is_lost(w: World, i: int, second: int, road: RoadNumbers) -> bool:
    """Is nothing seen of vehicle i in this second, by chance or as an adversary has chosen?"""
    state, p = w.state[0], road.perception
    if state.hidden == i:
        return True
    if p.dropout == 0.0:
        return False
    lost: bool = uniform(block(state.seed, state.test, second, i, PURPOSE_PERCEIVE)[2]) < p.dropout
    return lost


@inlined_kernel
def _enters(at: float, way: float, low: float, high: float, first: float, last: float) -> tuple[float, float]:
    """Narrow the part of a ray, from `first` to `last` of its length, to where one coordinate is in [low, high]."""
    if way == 0.0:
        return (first, last) if low <= at <= high else (1.0, 0.0)
    one, other = (low - at) / way, (high - at) / way
    return max(first, min(one, other)), min(last, max(one, other))


@kernel
def _hider(w: World, i: int, turned: bool) -> int:
    """Find the vehicle that hides vehicle i from the AV's middle, if others hide it wholly; else NO_VEHICLE.

    Boxes are opaque; people hide nothing. Where several hide it together, the one before its middle.

    `turned`: boxes stand as their headings say, at a site; else along the road.
    """
    v = w.vehicles
    dx, dy = ahead_by(v, 0, i), v[i].y - v[0].y
    sine, cosine = sin_cos(v[i].heading) if turned else (0.0, 1.0)
    half, wide = 0.5 * v[i].length, 0.5 * v[i].width
    away = dx * dx + dy * dy
    # the two corners that are farthest apart as seen from the AV
    low = high = 0.0
    low_x = high_x = dx
    low_y = high_y = dy
    for corner in range(4):
        along, across = (half if corner & 1 else -half), (wide if corner & 2 else -wide)
        x = dx + (along * cosine - across * sine)
        y = dy + (along * sine + across * cosine)
        aside = (dx * y - dy * x) / math.sqrt((x * x + y * y) * away)
        if aside < low:
            low, low_x, low_y = aside, x, y
        if aside > high:
            high, high_x, high_y = aside, x, y
    hider = NO_VEHICLE
    for ray in range(_RAYS):
        part = _INSET + (1.0 - 2.0 * _INSET) * ray / (_RAYS - 1)
        x = low_x + part * (high_x - low_x)
        y = low_y + part * (high_y - low_y)
        free = True
        for j in range(1, w.state[0].n_vehicles):
            if j == i or v[j].present == 0 or v[j].kind == PERSON:
                continue
            ahead, aside = ahead_by(v, 0, j), v[j].y - v[0].y
            if ahead * ahead + aside * aside >= away:
                continue
            way, over = x, y
            if turned:
                up, on = sin_cos(v[j].heading)
                ahead, aside = ahead * on + aside * up, aside * on - ahead * up
                way, over = x * on + y * up, y * on - x * up
            first, last = _enters(0.0, way, ahead - 0.5 * v[j].length, ahead + 0.5 * v[j].length, 0.0, 1.0)
            first, last = _enters(0.0, over, aside - 0.5 * v[j].width, aside + 0.5 * v[j].width, first, last)
            if first < last:
                free = False
                if ray <= _RAYS // 2:
                    hider = j
                break
        if free:
            return NO_VEHICLE
    return hider


@inlined_kernel
def _is_seen(w: World, i: int, second: int, road: RoadNumbers) -> bool:
    v, p = w.vehicles, road.perception
    dx, dy = ahead_by(v, 0, i), v[i].y - v[0].y
    if dx * dx + dy * dy > p.range * p.range or _is_lost(w, i, second, road):
        return False
    return not (p.occlusion and _hider(w, i, at_site(road.site)) != NO_VEHICLE)


@kernel
def show_as_seen(w: World, substep: int, road: RoadNumbers, s: AvScratch) -> None:
    """Put the vehicles where the AV perceives them, those that it does not see as absent, until `show_as_is`.

    Args:
        w: The world; the state of every vehicle must be that of this moment (`step.begin_to_act` with `everybody`).
        substep: How many tenths of the present second have passed, 0 to 9.
        road: Constants.
        s: Scratch; keeps the vehicles as they are.
    """
    if not road.perception.on:
        return
    v = w.vehicles
    tenth = _tenth(w, substep)
    second = tenth // SUBSTEPS
    late = min(road.perception.late, tenth)
    for i in range(w.state[0].n_vehicles):
        s.vehicles[i] = v[i]
        if at_site(road.site):
            w.agents[i].kept = w.agents[i].s
        s.is_seen[i] = i == 0 or (v[i].present != 0 and _is_seen(w, i, second, road))
    for i in range(1, w.state[0].n_vehicles):
        if not s.is_seen[i]:
            v[i].present = 0
            continue
        if late > 0:
            _carry_on(w, i, (tenth - late) % _parts(w), late * FRAME_S, road)
        if road.perception.noise > 0.0 and v[i].present:
            _displace(w, i, second, (tenth - SUBSTEPS * second) * FRAME_S, road)
    all_current(w)


@kernel
def show_as_is(w: World, road: RoadNumbers, s: AvScratch) -> None:
    """Put the vehicles back where they are, after `show_as_seen`."""
    if road.perception.on:
        for i in range(w.state[0].n_vehicles):
            w.vehicles[i] = s.vehicles[i]
            if at_site(road.site):
                w.agents[i].s, w.agents[i].kept = w.agents[i].kept, 0.0
        all_current(w)


@inlined_kernel
def losses_price(road: RoadNumbers) -> int:
    """Compute what it costs to make the AV lose a vehicle for a second, in units of a likelihood budget."""
    p = road.perception.dropout
    return price(p, log(1.0 - p))


@kernel
def _matters_at_site(w: World, i: int, site: NDArray[np.void]) -> bool:
    """Does the route of agent i meet the AV's within its next seconds of way, before either is through?"""
    own, other = w.agents[0], w.agents[i]
    reach = own.s + _SOON_S * max(w.vehicles[0].speed, _WALKING) + w.vehicles[0].length
    if other.route == own.route:
        ahead: bool = own.s < other.s < reach
        return ahead
    for meeting in range(MEETINGS):
        zone = site[0].zone[own.route, other.route, meeting]
        if zone.kind != NO_ZONE and own.s < zone.end and zone.begin < reach and other.s < zone.other_end:
            return True
    return False


@inlined_kernel
def _matters(w: World, bv: int, road: RoadNumbers) -> bool:
    """Is a BV near ahead in the AV's way, or beside the AV in the next lane?"""
    if at_site(road.site):
        return _matters_at_site(w, bv, road.site)
    v = w.vehicles
    dx = ahead_by(v, 0, bv)
    if v[0].lanes & v[bv].lanes:
        near: bool = 0.0 < dx < _NEAR_S * v[0].speed + v[0].length
        return near
    aside = abs(v[bv].y - lane_centre(v[0].target_lane, road.lane_width))
    beside: bool = abs(dx) < _BESIDE_M and aside < 1.5 * road.lane_width
    return beside


@inlined_kernel
def lose_controlled(w: World, bv: int, road: RoadNumbers) -> None:
    """Make the AV lose the controlled BV for a second, if the adversary has the budget and the BV matters to the AV.

    The second is that of the AV's next ten looks: at the second's begin the AV has looked already. In seconds from
    `MOST_HIDDEN` on it does not.
    """
    state = w.state[0]
    if (
        state.budget_left > 0
        and state.decisions < MOST_HIDDEN
        and road.perception.dropout > 0.0
        and _matters(w, bv, road)
    ):
        cost = losses_price(road)
        if cost < state.budget_left:
            state.budget_left -= cost
            state.hidden = bv


@kernel
def _put(
    w: World, frame: int, shown: NDArray[np.void], hidden: NDArray[np.int64], road: RoadNumbers
) -> None:  # fmt: skip
    """Put a world where a recording has all at a frame; `hidden`: slot lost by an adversary in each second, or -1."""
    state, v = w.state[0], w.vehicles
    second, substep = frame // SUBSTEPS, frame % SUBSTEPS
    state.decisions = second if substep == 0 else second + 1
    told = second - 1 if substep == 0 else second
    state.hidden = hidden[told] if 0 <= told < hidden.size else NO_VEHICLE
    for i in range(state.n_vehicles):
        cell = shown[i]
        v[i].present = cell.present
        v[i].x = cell.x
        v[i].y = cell.y
        v[i].speed = cell.speed
        sine, cosine = sin_cos(cell.heading)
        v[i].lateral_speed = cell.speed * sine / cosine
        v[i].heading = cell.heading
        v[i].acceleration = cell.acceleration
        v[i].target_lane = cell.target_lane
        if at_site(road.site):
            v[i].lateral_speed = 0.0
            w.agents[i].route = cell.target_lane
            w.agents[i].s = nearest_place(road.site, cell.target_lane, cell.x, cell.y) if cell.present else 0.0
            continue
        v[i].duration = 1.0 if cell.heading != 0.0 else 0.0
        _leave_on_straight_path(w, i, road)
    if road.perception.late > 0:
        if frame == 0:
            begin_to_remember(w, road)
        remember(w, substep)


@kernel
def _hide(w: World, pose: NDArray[np.float64], who: int, out: NDArray[np.int64]) -> None:
    v = w.vehicles
    for frame in range(pose.shape[0]):
        for i in range(w.state[0].n_vehicles):
            v[i].present = 0 if math.isnan(pose[frame, i, 0]) else 1
            v[i].x, v[i].y, v[i].heading = pose[frame, i, 0], pose[frame, i, 1], pose[frame, i, 2]
        out[frame] = _hider(w, who, True) if v[who].present else NO_VEHICLE


def hidden_by(
    road: RoadNumbers, pose: NDArray[np.float64], sizes: NDArray[np.float64], kind: NDArray[np.int64], who: int
) -> NDArray[np.int64]:
    """Say which vehicle of a site hid an agent from the AV's middle, whatever the AV perceived.

    Args:
        road: Constants of the site.
        pose: x, y [m] and heading [rad] of each agent, the AV first, (T, N, 3); NaN where it is not there.
        sizes: Length and width of each [m], (N, 2).
        kind: Class of each, (N,).
        who: Column of the agent.

    Returns:
        Column of the vehicle that hides it wholly, alone or with others, (T,); NO_VEHICLE where none does.
    """
    w = world_of(allocate_worlds(1, len(sizes), road))
    w.state[0]["n_vehicles"] = len(sizes)
    w.vehicles["length"], w.vehicles["width"], w.vehicles["kind"] = sizes[:, 0], sizes[:, 1], kind
    out = np.empty(len(pose), np.int64)
    _hide(w, pose, who, out)
    return out


@kernel
def _perceive(
    w: World, frames: NDArray[np.void], hidden: NDArray[np.int64], road: RoadNumbers, s: AvScratch,
    out: NDArray[np.float64],
) -> None:  # fmt: skip
    for frame in range(frames.shape[0]):
        _put(w, frame, frames[frame], hidden, road)
        show_as_seen(w, frame % SUBSTEPS, road, s)
        for i in range(w.state[0].n_vehicles):
            if w.vehicles[i].present:
                out[frame, i, 0] = w.vehicles[i].x
                out[frame, i, 1] = w.vehicles[i].y
        show_as_is(w, road, s)


def perceived(scenario: Scenario) -> NDArray[np.float64]:
    """Say where the AV saw each vehicle of a recording [m], x and y, (T, N, 2); NaN where it did not see it.

    What a recording leaves out hides nothing here: libraries store the vehicles within 150 m of the AV.
    """
    from cornerforge.sim.scratch import allocate_av_scratch

    road, slots = road_numbers(scenario.odd), int(scenario.slot.max()) + 1
    w = world_of(allocate_worlds(1, slots, road))
    state = w.state[0]
    state["seed"], state["test"], state["n_vehicles"] = scenario.seed, scenario.test, slots
    for body in ("length", "width", "kind"):
        w.vehicles[body][scenario.slot] = getattr(scenario, body)
    frames = np.zeros((len(scenario.x), slots), dtype=FRAME_FIELDS)
    for name in FRAME_FIELDS.names or ():
        values = getattr(scenario, name)
        frames[name][:, scenario.slot] = np.where(scenario.present, values, 0) if name in REALS else values
    out = np.full((*frames.shape, 2), np.nan)
    _perceive(w, frames, scenario.hidden_slots.astype(np.int64), road, allocate_av_scratch(slots), out)
    return out[:, scenario.slot]
