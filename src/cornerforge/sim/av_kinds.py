"""The built-in AVs that are not plain IDM and MOBIL: watchful, cautious, learned, reference drivers, and flawed ones.

What each does and why is in docs/adr/0009-built-in-avs.md, for reference drivers 0039-reference-drivers.md; the law of
flawed AVs is in `av_flawed.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._jit import inlined_kernel, kernel, kernel_by_code
from cornerforge.drivers.avs import AV_KINDS
from cornerforge.drivers.careful import Threat, braking_demanded, braking_of, own_reaction
from cornerforge.drivers.mobil import NO_CHANGE, mobil_gain
from cornerforge.drivers.policy import best_action, q_values
from cornerforge.drivers.rss import rss_braking, rss_distance
from cornerforge.road.lanes import may_change
from cornerforge.road.straight import ahead_by, gap, half_lengths, half_widths, lane_of
from cornerforge.sim.av import (
    av_decide,
    drives_by_its_law,
    lead_acceleration,
    may_try,
    merge,
    must_give_way,
    side_gain,
)
from cornerforge.sim.av_features import DECIDES_EVERY, av_order, look_as_av
from cornerforge.sim.av_flawed import flawed
from cornerforge.sim.neighbours import SIGHT, neighbours_in_lane
from cornerforge.sim.sight import lane_entered
from cornerforge.types import ACCELERATIONS, FRAME_S, SUBSTEPS

if TYPE_CHECKING:
    from cornerforge.drivers.avs import AvNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import AvScratch
    from cornerforge.sim.world import World

__all__ = [
    "built_in_av_decides",
]

BESIDE = 2.0
"""A vehicle is beside the AV when their boxes overlap lengthwise, or would if one were this much longer [m]."""
_PLAIN, _CAUTIOUS = AV_KINDS["plain"].code, AV_KINDS["cautious"].code
_ACCELERATIONS = ACCELERATIONS
_SIDES = (1, -1)


@inlined_kernel
def _gaps(w: World, lane: int, road: RoadNumbers, av: AvNumbers) -> tuple[float, float, float, float]:
    """Find gap [m] and speed [m/s] of the AV's neighbours in a lane, ahead then behind; for none +inf and the AV's."""
    v = w.vehicles
    lead, rear = neighbours_in_lane(w, 0, lane, road.lane_width, av.sight)
    lead_gap = np.inf
    lead_speed = v[0].speed
    rear_gap = np.inf
    rear_speed = v[0].speed
    if lead >= 0:
        lead_gap = gap(v, 0, lead)
        lead_speed = v[lead].speed
    if rear >= 0:
        rear_gap = gap(v, rear, 0)
        rear_speed = v[rear].speed
    return lead_gap, lead_speed, rear_gap, rear_speed


@kernel
def _is_refused(w: World, lane: int, road: RoadNumbers, av: AvNumbers) -> bool:
    """Is a lane unsafe for the AV, by MOBIL's safety criterion, or for the cautious kind by RSS distances?"""
    lead_gap, lead_speed, rear_gap, rear_speed = _gaps(w, lane, road, av)
    speed = w.vehicles[0].speed
    if av.kind != _CAUTIOUS:
        gain = mobil_gain(speed, 0.0, (lead_gap, lead_speed), (rear_gap, rear_speed), 0.0, av.idm, av.mobil)
        return gain == NO_CHANGE
    p = av.rss
    if lead_gap <= 0.0 or rear_gap <= 0.0:
        return True
    ahead = rss_distance(speed, lead_speed, p.response_time, p.max_acceleration, p.min_braking, p.lead_braking)
    behind = rss_distance(rear_speed, speed, p.rear_response_time, p.rear_acceleration, p.rear_braking, p.lead_braking)
    return lead_gap < ahead or rear_gap < behind


@inlined_kernel
def _turns_back(w: World, road: RoadNumbers, av: AvNumbers) -> bool:
    """Does the AV break off its lane change and return to the lane that its centre is still in?

    It does when the target lane has become unsafe, or when a vehicle enters it from the far side, but not into a
    vehicle beside it.
    """
    v = w.vehicles
    old = lane_of(v[0].y, road.lane_width)
    target = v[0].target_lane
    if old == target or not (must_give_way(w, road, av.sight) or _is_refused(w, target, road, av)):
        return False
    lead_gap, _, rear_gap, _ = _gaps(w, old, road, av)
    return lead_gap > 0.0 and rear_gap > 0.0


@inlined_kernel
def _comes_in_beside(w: World, road: RoadNumbers, av: AvNumbers) -> int:
    """Find the nearest vehicle beside the AV that is seen to enter its target lane, its centre still in another lane.

    Returns:
        Its slot, -1 for none.
    """
    v = w.vehicles
    lane = v[0].target_lane
    found = -1
    nearest = np.inf
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if j > 0 and lane_entered(v, j, road.lane_width, av.sight) == lane != lane_of(v[j].y, road.lane_width):
            distance = abs(ahead_by(v, 0, j))
            if distance < min(nearest, half_lengths(v, 0, j) + BESIDE):
                nearest = distance
                found = j
    return found


@inlined_kernel
def _evade(w: World, other: int, command: float, road: RoadNumbers, av: AvNumbers) -> tuple[float, int]:
    """Evade a vehicle that comes into the AV's lane beside it: acceleration [m/s2] and target lane.

    The AV changes to the lane on the other side if that one is safe. Else it brakes, unless the other's centre is more
    than half a length of the AV behind: then it accelerates, if `command`, what it would do otherwise, is no braking.
    """
    v = w.vehicles
    lane = v[0].target_lane
    away = lane - 1 if lane_of(v[other].y, road.lane_width) > lane else lane + 1
    if v[0].duration == 0.0 and may_change(v, 0, away, road) and not _is_refused(w, away, road, av):
        return command, away
    if ahead_by(v, 0, other) >= -0.5 * v[0].length:
        return min(command, -av.idm.max_braking), lane
    return (av.idm.max_acceleration if command >= 0.0 else command), lane


@inlined_kernel
def _watchful(w: World, _substep: int, road: RoadNumbers, av: AvNumbers, _scratch: AvScratch) -> tuple[float, int]:
    """Decide by IDM and MOBIL, look again while changing lanes, and evade a vehicle that comes in beside the AV."""
    v = w.vehicles
    command, lane = av_decide(w, road, av)
    if v[0].duration > 0.0 and _turns_back(w, road, av):
        return command, lane_of(v[0].y, road.lane_width)
    if lane_of(v[0].y, road.lane_width) == v[0].target_lane:
        other = _comes_in_beside(w, road, av)
        if other >= 0:
            return _evade(w, other, command, road, av)
    return command, lane


@kernel
def _rss_command(w: World, road: RoadNumbers, av: AvNumbers) -> float:
    """Compute the IDM's acceleration [m/s2], or the RSS braking where a lead in one of the AV's lanes is too near."""
    v = w.vehicles
    command = lead_acceleration(w, 0, v[0].lanes, av.sight, road, av)
    for lane in range(road.n_lanes):
        if v[0].lanes & (1 << lane):
            lead_gap, lead_speed, _, _ = _gaps(w, lane, road, av)
            braking = rss_braking(v[0].speed, lead_gap, lead_speed, av.rss)
            if braking > 0.0:
                command = min(command, -braking)
    return command


@kernel
def _cautious(w: World, _substep: int, road: RoadNumbers, av: AvNumbers, _scratch: AvScratch) -> tuple[float, int]:
    """Keep RSS distances: brake when one is violated, change only to a lane where both neighbours leave them."""
    v = w.vehicles
    command = _rss_command(w, road, av)
    lane = v[0].target_lane
    if v[0].duration > 0.0 and _turns_back(w, road, av):
        return command, lane_of(v[0].y, road.lane_width)
    if lane_of(v[0].y, road.lane_width) == lane:
        other = _comes_in_beside(w, road, av)
        if other >= 0:
            return _evade(w, other, command, road, av)
    if v[0].duration > 0.0:
        return command, lane
    best_gain = av.mobil.min_gain
    best_lane = lane
    for side in _SIDES:
        if may_try(v, side, road):
            gain = side_gain(w, lane + side, command, best_gain, road, av)
            if gain > best_gain and not _is_refused(w, lane + side, road, av):
                best_gain = gain
                best_lane = lane + side
    return command, best_lane


@inlined_kernel
def _learned(w: World, substep: int, road: RoadNumbers, av: AvNumbers, s: AvScratch) -> tuple[float, int]:
    """Take the action of the largest Q at substeps 0 and 5 of each second; go on with it in between."""
    v = w.vehicles
    if substep % DECIDES_EVERY != 0:
        return v[0].commanded, v[0].target_lane
    look_as_av(w, road, av.sight, s, s.features, s.allowed)
    q_values(av.network, s.features, s.layers, s.q)
    return av_order(w, best_action(s.q, s.allowed), _ACCELERATIONS)


@inlined_kernel
def _braking_demanded_of_all(w: World, av: AvNumbers) -> float:
    """Ask the reference driver about all vehicles ahead of it: the hardest braking that one of them demands [m/s2]."""
    v = w.vehicles
    demanded = 0.0
    for k in range(w.state[0].n_current):
        j = w.current[k]
        ahead = ahead_by(v, 0, j)
        if j == 0 or not 0.0 < ahead < SIGHT:
            continue
        half = half_lengths(v, 0, j)
        across = v[j].y - v[0].y
        drifts = v[j].lateral_speed - v[0].lateral_speed
        aside = abs(across) - half_widths(v, 0, j)
        threat = Threat(ahead - half, ahead + half, aside, -drifts if across > 0.0 else drifts, v[j].speed)
        demanded = max(demanded, braking_demanded(av.careful, v[0].speed, v[0].acceleration, threat))
    return demanded


@inlined_kernel
def _careful(w: World, substep: int, road: RoadNumbers, av: AvNumbers, _scratch: AvScratch) -> tuple[float, int]:
    """Follow gently, and brake as the reference driver does from when it sees danger until nothing asks for braking."""
    v = w.vehicles
    state, own = w.state[0], w.av[0]
    lane = v[0].target_lane
    gentle = lead_acceleration(w, 0, v[0].lanes, av.sight, road, av)
    demanded = _braking_demanded_of_all(w, av)
    now = SUBSTEPS * (state.decisions if substep == 0 else state.decisions - 1) + substep + 1
    if demanded > 0.0 and own.alarmed == 0:
        own.alarmed = now
    if demanded == 0.0 and gentle >= 0.0:
        own.alarmed = 0
    if own.alarmed == 0:
        return gentle, lane
    since = (now - own.alarmed) * FRAME_S
    step = road.av_substeps * FRAME_S
    hard = braking_of(av.careful, since, demanded, v[0].acceleration, step, own_reaction(av.careful))
    return min(gentle, hard), lane


@inlined_kernel
def _keeps_on(w: World, _substep: int, _road: RoadNumbers, _av: AvNumbers, _scratch: AvScratch) -> tuple[float, int]:
    """Drive on as it is: an AV of sites is refused on a road, and decides in `site.av`."""
    return 0.0, w.vehicles[0].target_lane


_DECISIONS = {
    "watchful": _watchful,
    "cautious": _cautious,
    "learned": _learned,
    "careful": _careful,
    "flawed": flawed,
    "junction": _keeps_on,
}
"""The decision of each law except the plain one. Each takes the world, the substep (0 to 9), road, AV and scratch, and
returns an acceleration [m/s2] and a target lane. It changes nothing but the scratch and, in the world, what the law
remembers; asked again at the same moment it gives the same answer."""
_decision_of: Any = kernel_by_code({name: law.code for name, law in AV_KINDS.items() if name != "plain"}, _DECISIONS)


@inlined_kernel
def _decides_otherwise(w: World, substep: int, road: RoadNumbers, av: AvNumbers, s: AvScratch) -> tuple[float, int]:
    command, lane = _decision_of(av.kind, w, substep, road, av, s)
    return command, lane


@inlined_kernel
def built_in_av_decides(w: World, substep: int, road: RoadNumbers, av: AvNumbers, s: AvScratch) -> tuple[float, int]:
    """Decide for a built-in AV of any kind: acceleration [m/s2] and target lane.

    Changes nothing but the scratch and what the AV remembers; asked again at the same moment it answers the same.

    Args:
        w: The world.
        substep: How many tenths of the present second have passed, 0 to 9.
        road, av: Constants.
        s: Scratch.
    """
    command, lane = av_decide(w, road, av) if av.kind == _PLAIN else _decides_otherwise(w, substep, road, av, s)
    return (command, lane) if drives_by_its_law(w.vehicles, command, road) else merge(w, command, lane, av, road)
