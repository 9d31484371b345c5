"""The law of AVs made bad on purpose (`drivers.flawed`): IDM and MOBIL that overlook vehicles or change their mind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.flawed import BLIND_SIDE, BLOCKS, FORGETS, HESITATES, LATE, MERGES_BLIND, NOT_BEHIND
from cornerforge.drivers.idm import free_acceleration, idm_acceleration
from cornerforge.drivers.mobil import mobil_gain
from cornerforge.road.lanes import side_to_leave_lane
from cornerforge.road.straight import ahead_by, gap, lane_of
from cornerforge.sim.av import may_try, must_give_way
from cornerforge.sim.neighbours import SIGHT
from cornerforge.sim.sight import lanes_seen
from cornerforge.types import FRAME_S, SUBSTEPS

if TYPE_CHECKING:
    from cornerforge.drivers.avs import AvNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import AvScratch
    from cornerforge.sim.world import World

__all__ = ["flawed"]

LATE_TTC = 1.0
"""Time to collision [s] at which the AV that brakes late notices a vehicle ahead."""
LEFT = 1.0
"""An AV that does not see one side sees no vehicle with its centre further to its left than this [m]."""
REMEMBERS = 2.0
"""How long the forgetful AV knows of a vehicle that has come within `NOTICES` [s]."""
NOTICES = 100.0
"""Distance along the road, ahead or behind, within which the AV knows of other vehicles [m]."""
BEYOND = 1.3
"""How far beyond the line its centre is when the hesitating AV turns back [m]: its body has left the old lane."""
BLOCKED = 40.0
"""Distance ahead up to which the AV that blocks closes the gap to a vehicle that must come over [m]."""
_SIDES = (1, -1)
_LATE, _NOT_BEHIND, _BLIND_SIDE, _FORGETS, _HESITATES = LATE, NOT_BEHIND, BLIND_SIDE, FORGETS, HESITATES
_MERGES_BLIND, _BLOCKS = MERGES_BLIND, BLOCKS


@inlined_kernel
def _notice(w: World, now: int, av: AvNumbers) -> None:
    """Note for all vehicles since when the AV knows of them (`World.noticed`); beyond `NOTICES` it knows of none."""
    v = w.vehicles
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if abs(ahead_by(v, 0, j)) > NOTICES:
            w.noticed[j] = 0
        elif w.noticed[j] == 0:
            room = gap(v, 0, j)
            if av.flaw == _FORGETS or 0.0 < room <= LATE_TTC * (v[0].speed - v[j].speed):
                w.noticed[j] = now


@inlined_kernel
def _must_come_over(w: World, j: int, road: RoadNumbers) -> bool:
    """Is vehicle j, by its centre, in a lane beside the AV's that it must leave to the AV's?"""
    v = w.vehicles
    lane = lane_of(v[j].y, road.lane_width)
    aside = v[0].target_lane - lane
    must: bool = road.lanes.varied and abs(aside) == 1 and side_to_leave_lane(v, j, lane, road)[0] == aside
    return must


@inlined_kernel
def _is_to_be_blocked(w: World, road: RoadNumbers) -> bool:
    """Is a vehicle within `BLOCKED` ahead of the AV that must come over into its lane?"""
    v = w.vehicles
    for k in range(w.state[0].n_current):
        j = w.current[k]
        if j > 0 and 0.0 < ahead_by(v, 0, j) < BLOCKED and _must_come_over(w, j, road):
            return True
    return False


@inlined_kernel
def _overlooks(w: World, j: int, now: int, road: RoadNumbers, av: AvNumbers) -> bool:
    """Does the AV overlook vehicle j?"""
    v = w.vehicles
    overlooked = False
    if av.flaw == _LATE:
        overlooked = w.noticed[j] == 0 and gap(v, 0, j) > 0.0
    elif av.flaw == _NOT_BEHIND:
        overlooked = ahead_by(v, 0, j) < 0.0
    elif av.flaw == _BLIND_SIDE:
        overlooked = v[j].y - v[0].y > LEFT
    elif av.flaw == _FORGETS:
        overlooked = w.noticed[j] > 0 and (now - w.noticed[j]) * FRAME_S > REMEMBERS
    elif av.flaw == _BLOCKS:
        overlooked = _must_come_over(w, j, road)
    return overlooked


@kernel
def _gaps(w: World, lane: int, now: int, road: RoadNumbers, av: AvNumbers) -> tuple[float, float, float, float]:
    """Find gap [m] and speed [m/s] of the known vehicles ahead and behind in a lane; for none +inf and its own."""
    v = w.vehicles
    speed = v[0].speed
    lead_gap, lead_speed, rear_gap, rear_speed = np.inf, speed, np.inf, speed
    best_lead = best_rear = SIGHT
    for k in range(w.state[0].n_current):
        j = w.current[k]
        dx = ahead_by(v, 0, j)
        if j == 0 or dx > best_lead or -dx > best_rear or _overlooks(w, j, now, road, av):
            continue
        if lanes_seen(v, j, road.lane_width, av.sight) & (1 << lane) == 0:
            continue
        if dx >= 0.0:
            best_lead = dx
            lead_gap, lead_speed = gap(v, 0, j), v[j].speed
        else:
            best_rear = -dx
            rear_gap, rear_speed = gap(v, j, 0), v[j].speed
    return lead_gap, lead_speed, rear_gap, rear_speed


@inlined_kernel
def _old_lane(w: World, road: RoadNumbers) -> int:
    """Find the lane that the hesitating AV returns to: the one it has just left; -1 while it is not at that point."""
    v = w.vehicles
    lane = lane_of(v[0].y, road.lane_width)
    if v[0].duration == 0.0 or lane != v[0].target_lane:
        return -1
    side = 1 if v[0].lateral_speed > 0.0 else -1
    line = (lane if side > 0 else lane + 1) * road.lane_width
    return lane - side if side * (v[0].y - line) >= BEYOND else -1


@inlined_kernel
def flawed(w: World, substep: int, road: RoadNumbers, av: AvNumbers, _scratch: AvScratch) -> tuple[float, int]:
    """Decide by IDM and MOBIL with one flaw: acceleration [m/s2] and target lane."""
    v = w.vehicles
    state = w.state[0]
    speed = v[0].speed
    now = SUBSTEPS * (state.decisions if substep == 0 else state.decisions - 1) + substep + 1
    if av.flaw == _FORGETS or av.flaw == _LATE:
        _notice(w, now, av)
    command = free_acceleration(speed, av.idm)
    if av.flaw == _BLOCKS and _is_to_be_blocked(w, road):
        command = av.idm.max_acceleration
    for lane in range(road.n_lanes):
        if v[0].lanes & (1 << lane):
            room, lead_speed, _, _ = _gaps(w, lane, now, road, av)
            if room < np.inf:
                command = min(command, idm_acceleration(speed, room, lead_speed - speed, av.idm))
    target = v[0].target_lane
    if v[0].duration > 0.0:
        if av.flaw == _HESITATES:
            old = _old_lane(w, road)
            return command, old if old >= 0 else target
        looks = av.flaw != _BLIND_SIDE and not (av.flaw == _MERGES_BLIND and road.lanes.varied)
        if looks and must_give_way(w, road, av.sight):
            return command, lane_of(v[0].y, road.lane_width)
        return command, target
    best_gain, best_lane = av.mobil.min_gain, target
    for side in _SIDES:
        if may_try(v, side, road):
            lead_gap, lead_speed, rear_gap, rear_speed = _gaps(w, target + side, now, road, av)
            gain = mobil_gain(speed, command, (lead_gap, lead_speed), (rear_gap, rear_speed), 0.0, av.idm, av.mobil)
            if gain > best_gain:
                best_gain, best_lane = gain, target + side
    return command, best_lane
