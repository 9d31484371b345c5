"""The plain built-in AV: how IDM and MOBIL decide, as often as the ODD lets them (other kinds: `av_kinds.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.flawed import MERGES_BLIND, STOPS_AT_END
from cornerforge.drivers.idm import free_acceleration, idm_acceleration
from cornerforge.drivers.mobil import mobil_gain
from cornerforge.road.lanes import has_lane, may_change, on_a_ramp, pace_at, room_to_stop, side_to_leave, takes_exit
from cornerforge.road.straight import ahead_by, gap, half_lengths, lane_of
from cornerforge.sim.merging import accepts, braking_for_end, come_beside, relaxed, wish_of
from cornerforge.sim.neighbours import neighbours_in_lane
from cornerforge.sim.sight import lane_entered, lanes_seen
from cornerforge.types import SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.avs import AvNumbers
    from cornerforge.drivers.sight import SightNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = [
    "av_decide", "drives_by_its_law", "lead_acceleration", "may_try", "merge", "must_give_way", "side_gain",
]  # fmt: skip

CONFLICT_GAP = 10.0
"""Largest lengthwise gap [m] at which the AV gives way to a vehicle that enters its target lane from the far side."""
WAITS = 5
"""How long the AV that stops where its lane ends stands there before it looks for a gap [s]."""
_STANDS = 0.5
"""An AV that is slower than this stands [m/s]."""
_SIDES = (1, -1)
_MERGES_BLIND, _STOPS_AT_END = MERGES_BLIND, STOPS_AT_END


@inlined_kernel
def may_try(v: NDArray[np.void], side: int, road: RoadNumbers) -> bool:
    """May the AV change to a side because it likes to: is there a lane that goes on, and is it free in its choice?"""
    if not may_change(v, 0, v[0].target_lane + side, road):
        return False
    if not road.lanes.varied:
        return True
    wish = wish_of(v, 0, 1.0, road)
    return wish.urgency == 0.0 and (wish.left if side > 0 else wish.right) > 0.0


@inlined_kernel
def _has_waited(w: World) -> bool:
    """Has the AV that stops where its lane ends stood there for `WAITS`? It notes since when (`alarmed`)."""
    own, now = w.av[0], SUBSTEPS * w.state[0].decisions + 1
    if own.alarmed == 0 and w.vehicles[0].speed < _STANDS:
        own.alarmed = now
    has_waited: bool = own.alarmed > 0 and now - own.alarmed >= WAITS * SUBSTEPS
    return has_waited


@inlined_kernel
def drives_by_its_law(v: NDArray[np.void], command: float, road: RoadNumbers) -> bool:
    """Is there nothing for `merge` to do: does the AV's lane go on, without a limit, and does it hardly brake?"""
    if not road.lanes.varied and road.lanes.pace.shape[1] == 0:
        return True
    goes_on = (road.lanes.go_on >> v[0].target_lane) & 1 and not takes_exit(v, 0)
    return bool(goes_on and command >= -1.0 and pace_at(v, 0, road) == 1.0)


@kernel
def merge(w: World, command: float, lane: int, av: AvNumbers, road: RoadNumbers) -> tuple[float, int]:
    """Let a built-in AV do on a road of which its law knows nothing: where lanes end, and limits change.

    It slows down for limits and curves as others do, follows more softly, adapts to the lane that it must change to and
    changes if it accepts both gaps, brakes to stop where its lane ends, and leaves to its law what is not urgent.

    Args:
        w: The world.
        command, lane: Acceleration [m/s2] and target lane by its law.
        av: The AV.
        road: Constants.
    """
    v = w.vehicles
    if road.lanes.varied:
        command = relaxed(w, 0, command, av.sight, road)
    pace = pace_at(v, 0, road)
    if pace < 1.0:
        command = min(command, free_acceleration(v[0].speed / pace, av.idm))
    side, urgency = side_to_leave(v, 0, road)
    if v[0].duration == 0.0 and urgency > 0.0 and not on_a_ramp(v[0].target_lane, v[0].x, road):
        wish = wish_of(v, 0, 0.0, road)
        lane = v[0].target_lane
        beside = lane + (1 if side > 0 else -1)
        wants = wish.left + wish.right > 0.0 and may_change(v, 0, beside, road)
        if av.flaw == _STOPS_AT_END and room_to_stop(v, 0, road) < np.inf:
            wants = _has_waited(w) and wants
        if wants and (av.flaw == _MERGES_BLIND or accepts(w, 0, beside, wish.urgency, av.sight, road)):
            lane = beside
        elif av.flaw != _MERGES_BLIND and has_lane(beside, v[0].x, road):
            least, most = come_beside(w, 0, beside, wish.urgency, road)
            command = min(max(command, least) if command >= 0.0 else command, most)
    braking = braking_for_end(v, 0, road)
    return (min(command, -braking) if braking > 0.0 else command), lane


@inlined_kernel
def lead_acceleration(w: World, i: int, lanes: int, sight: SightNumbers, road: RoadNumbers, av: AvNumbers) -> float:
    """IDM acceleration of slot i behind the worst of its leads in all lanes of the bit mask."""
    v = w.vehicles
    speed = v[i].speed
    command = free_acceleration(speed, av.idm)
    for lane in range(road.n_lanes):
        if lanes & (1 << lane):
            lead, _ = neighbours_in_lane(w, i, lane, road.lane_width, sight)
            if lead >= 0:
                room = gap(v, i, lead)
                command = min(command, idm_acceleration(speed, room, v[lead].speed - speed, av.idm))
    return command


@inlined_kernel
def side_gain(w: World, lane: int, acceleration_now: float, needed: float, road: RoadNumbers, av: AvNumbers) -> float:
    """Compute the AV's MOBIL gain [m/s2] of changing to `lane`; `needed` where it is certainly not above `needed`."""
    v = w.vehicles
    speed = v[0].speed
    lead, rear = neighbours_in_lane(w, 0, lane, road.lane_width, av.sight)
    lead_gap = np.inf
    lead_speed = speed
    rear_gap = np.inf
    rear_speed = speed
    rear_now = 0.0
    if lead >= 0:
        lead_gap = gap(v, 0, lead)
        lead_speed = v[lead].speed
    if av.mobil.politeness == 0.0:
        own_after = idm_acceleration(speed, lead_gap, lead_speed - speed, av.idm)
        if own_after - acceleration_now <= needed:
            return needed
    if rear >= 0:
        rear_gap = gap(v, rear, 0)
        rear_speed = v[rear].speed
        if av.mobil.politeness > 0.0:
            lanes = lanes_seen(v, rear, road.lane_width, av.sight)
            rear_now = lead_acceleration(w, rear, lanes, av.sight, road, av)
    return mobil_gain(
        speed, acceleration_now, (lead_gap, lead_speed), (rear_gap, rear_speed), rear_now, av.idm, av.mobil
    )


@kernel
def must_give_way(w: World, road: RoadNumbers, sight: SightNumbers) -> bool:
    """Is another vehicle seen to enter the AV's target lane from the far side while the AV is in its old lane?"""
    v = w.vehicles
    state = w.state[0]
    target = v[0].target_lane
    old = lane_of(v[0].y, road.lane_width)
    if old == target:
        return False
    for k in range(state.n_current):
        j = w.current[k]
        if j > 0 and lane_entered(v, j, road.lane_width, sight) == target:
            other = lane_of(v[j].y, road.lane_width)
            if other != target and other != old and abs(ahead_by(v, 0, j)) < half_lengths(v, 0, j) + CONFLICT_GAP:
                return True
    return False


@inlined_kernel
def av_decide(w: World, road: RoadNumbers, av: AvNumbers) -> tuple[float, int]:
    """Decide for the plain built-in AV by IDM and MOBIL: acceleration [m/s2] and target lane. Changes nothing."""
    v = w.vehicles
    command = lead_acceleration(w, 0, v[0].lanes, av.sight, road, av)
    lane = v[0].target_lane
    if v[0].duration > 0.0:
        if must_give_way(w, road, av.sight):
            return command, lane_of(v[0].y, road.lane_width)
        return command, lane
    best_gain = av.mobil.min_gain
    # No lane is better than a free one: an AV that its lead hardly slows need not look at the other lanes.
    if av.mobil.politeness == 0.0 and free_acceleration(v[0].speed, av.idm) - command <= best_gain:
        return command, lane
    best_lane = lane
    for side in _SIDES:
        if may_try(v, side, road):
            gain = side_gain(w, lane + side, command, best_gain, road, av)
            if gain > best_gain:
                best_gain = gain
                best_lane = lane + side
    return command, best_lane
