"""The neighbours of a vehicle: nearest in a lane, nearest to the AV, order along the road."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.road.straight import ahead_by
from cornerforge.sim.sight import lanes_seen
from cornerforge.sim.site.views import critical_agent
from cornerforge.sim.world import NO_VEHICLE, UNKNOWN
from cornerforge.site.tables import at_site

if TYPE_CHECKING:
    from cornerforge.drivers.sight import SightNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = ["SIGHT", "nearest_bv", "neighbours_in_lane", "rank_of", "sort_by_x"]

SIGHT = 200.0
"""No driver sees a vehicle further ahead or behind than this [m, centre to centre]."""


@inlined_kernel
def _known_neighbours(w: World, lane: int) -> tuple[int, int]:
    """Look up the AV's lead and rear in a lane where `reach` has noted them; -1 for none within sight."""
    v = w.vehicles
    lead = w.av[0].lead[lane]
    rear = w.av[0].rear[lane]
    if lead >= 0 and ahead_by(v, 0, lead) >= SIGHT:
        lead = NO_VEHICLE
    if rear >= 0 and ahead_by(v, rear, 0) >= SIGHT:
        rear = NO_VEHICLE
    return lead, rear


@inlined_kernel
def neighbours_in_lane(w: World, i: int, lane: int, lane_width: float, sight: SightNumbers) -> tuple[int, int]:
    """Find the nearest vehicles ahead of and behind slot i in a lane: (lead, rear), -1 for none within sight.

    `sight` says which lanes a vehicle is in. Vehicles at the same x are ordered by slot.
    """
    if i == 0 and w.av[0].lead[lane] != UNKNOWN:
        return _known_neighbours(w, lane)
    v = w.vehicles
    state = w.state[0]
    lead = NO_VEHICLE
    rear = NO_VEHICLE
    bit = 1 << lane
    best_lead = SIGHT
    best_rear = SIGHT
    for k in range(state.n_seen):
        j = w.current[k]
        if j == i:
            continue
        dx = ahead_by(v, i, j)
        if dx > best_lead or -dx > best_rear:
            continue
        if lanes_seen(v, j, lane_width, sight) & bit == 0:
            continue
        if dx > 0.0 or (dx == 0.0 and j > i):
            if dx < best_lead:
                best_lead = dx
                lead = j
        elif -dx < best_rear:
            best_rear = -dx
            rear = j
    return lead, rear


@kernel
def nearest_bv(w: World, road: RoadNumbers) -> int:
    """Find the critical BV (paper): the slot of the BV with its centre nearest to the AV's; -1 when there is none.

    At a site it is the vehicle or person that meets the AV nearest in time (`views.critical_agent`).
    """
    if at_site(road.site):
        return critical_agent(w, road.site)
    v = w.vehicles
    state = w.state[0]
    best = NO_VEHICLE
    best_squared = np.inf
    for j in range(1, state.n_vehicles):
        if v[j].present:
            dx = ahead_by(v, 0, j)
            dy = v[j].y - v[0].y
            squared = dx * dx + dy * dy
            if squared < best_squared:
                best_squared = squared
                best = j
    return best


@inlined_kernel
def sort_by_x(w: World) -> None:
    """Sort `order` by x, ties by slot. Insertion sort: traffic is nearly sorted, so this costs about one pass."""
    v = w.vehicles
    order = w.order
    state = w.state[0]
    for rank in range(1, state.n_vehicles):
        i = order[rank]
        x = v[i].x
        place = rank
        while place > 0:
            before = order[place - 1]
            if v[before].x < x or (v[before].x == x and before < i):
                break
            order[place] = before
            place -= 1
        order[place] = i


@inlined_kernel
def rank_of(w: World, i: int) -> int:
    """Find the place of slot i in `order`, which is sorted."""
    v = w.vehicles
    low, high = 0, w.state[0].n_vehicles - 1
    while low < high:
        middle = (low + high) // 2
        j = w.order[middle]
        if ahead_by(v, j, i) > 0.0 or (ahead_by(v, j, i) == 0.0 and j < i):
            low = middle + 1
        else:
            high = middle
    return low
