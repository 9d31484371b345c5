"""Observation of the adversary, and the actions it may take: pure functions of a world."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._elementary import log
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.road.lanes import may_change
from cornerforge.road.straight import ahead_by, distance_left, half_lengths, lane_centre
from cornerforge.sim.actions import nearest_action
from cornerforge.sim.chances import ALONE, action_probabilities
from cornerforge.sim.merging import braking_for_end
from cornerforge.sim.site.choice import possible_actions
from cornerforge.sim.site.second import look_around
from cornerforge.sim.site.views import observe_agent
from cornerforge.site.tables import at_site
from cornerforge.types import ACTION_LEFT, ACTION_RIGHT, N_ACTIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.chances import StarterScratch
    from cornerforge.sim.world import World

__all__ = [
    "N_OBSERVATION",
    "N_OWN",
    "OBSERVATION_VERSION",
    "UNITS_PER_NAT",
    "allowed_actions",
    "budget_units",
    "observe",
    "price",
    "price_from",
    "spend_budget",
]

OBSERVATION_VERSION = 3
"""Raised whenever the meaning of an entry changes; stored with every policy. 2 added what is left of the budget, 3
shows up to 30 nats of it, not 10."""
UNITS_PER_NAT = 1_000_000
"""A likelihood budget is counted in whole units, so that sums are exact and do not depend on their order."""
_NATS_SHOWN = 10.0
N_OWN = 21
_N_OTHERS = 4
_PER_OTHER = 5
N_OBSERVATION = N_OWN + _N_OTHERS * _PER_OTHER


@kernel
def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


@kernel
def _nearest_others(w: World, bv: int, found: NDArray[np.int64]) -> int:
    """List the slots of the BVs nearest to `bv` in `found`, nearest first; return how many, at most 4."""
    v = w.vehicles
    state = w.state[0]
    count = 0
    for j in range(1, state.n_vehicles):
        if j == bv or v[j].present == 0:
            continue
        distance = abs(ahead_by(v, bv, j)) + abs(v[j].y - v[bv].y)
        place = count
        while place > 0:
            before = found[place - 1]
            if abs(ahead_by(v, bv, before)) + abs(v[before].y - v[bv].y) <= distance:
                break
            if place < _N_OTHERS:
                found[place] = before
            place -= 1
        if place < _N_OTHERS:
            found[place] = j
            count = min(count + 1, _N_OTHERS)
    return count


@kernel
def observe(w: World, bv: int, road: RoadNumbers, found: NDArray[np.int64], out: NDArray[np.float32]) -> None:
    """Write the observation of controlled BV `bv` into `out`, float32 (N_OBSERVATION,), entries of order 1.

    Own part: remaining test length / 400 m; AV: (speed - 30) / 10, offset from its target lane / 4 m, lateral speed /
    2, acceleration / 4, lanes free to its left and right (0 or 1); BV: the same without acceleration; relative BV - AV:
    dx / 50 and dx / 10 (clipped to +-3), dy / 4, speed difference / 10, target lanes' difference, lengthwise overlap
    (0 or 1); whether the BV, and the AV, changes lanes (0 or 1); what is left of the likelihood budget / 10 nats, at
    most 3, and 1 without a budget. Then for each of the 4 vehicles nearest to the BV: dx / 50, dy / 4 and speed
    difference / 10 to the BV, target lane minus BV's, and 1; all 0 where there is no vehicle. At a site all but the
    budget is what `views.observe_agent` shows.

    Args:
        w: The world.
        bv: Slot of the controlled BV, at least 1.
        road: Constants.
        found: Scratch, int64 (4,).
        out: Where the entries go.
    """
    for k in range(N_OBSERVATION):
        out[k] = 0.0
    left = w.state[0].budget_left
    out[N_OWN - 1] = min(3.0, (left - 1) / (_NATS_SHOWN * UNITS_PER_NAT)) if left > 0 else 1.0
    if at_site(road.site):
        look_around(w, bv, road.site)
        observe_agent(w, bv, road.site, N_OWN, found, out)
        return
    v = w.vehicles
    dx = ahead_by(v, 0, bv)
    out[0] = distance_left(v, 0, road) / 400.0
    out[1] = (v[0].speed - 30.0) / 10.0
    out[2] = (v[0].y - lane_centre(v[0].target_lane, road.lane_width)) / 4.0
    out[3] = v[0].lateral_speed / 2.0
    out[4] = v[0].acceleration / 4.0
    out[5] = 1.0 if may_change(v, 0, v[0].target_lane + 1, road) else 0.0
    out[6] = 1.0 if may_change(v, 0, v[0].target_lane - 1, road) else 0.0
    out[7] = (v[bv].speed - 30.0) / 10.0
    out[8] = (v[bv].y - lane_centre(v[bv].target_lane, road.lane_width)) / 4.0
    out[9] = v[bv].lateral_speed / 2.0
    out[10] = 1.0 if may_change(v, bv, v[bv].target_lane + 1, road) else 0.0
    out[11] = 1.0 if may_change(v, bv, v[bv].target_lane - 1, road) else 0.0
    out[12] = _clip(dx / 50.0, 3.0)
    out[13] = _clip(dx / 10.0, 3.0)
    out[14] = (v[bv].y - v[0].y) / 4.0
    out[15] = (v[bv].speed - v[0].speed) / 10.0
    out[16] = v[bv].target_lane - v[0].target_lane
    out[17] = 1.0 if abs(dx) < half_lengths(v, 0, bv) else 0.0
    out[18] = 1.0 if v[bv].duration > 0.0 else 0.0
    out[19] = 1.0 if v[0].duration > 0.0 else 0.0
    for k in range(_nearest_others(w, bv, found)):
        j = found[k]
        place = N_OWN + _PER_OTHER * k
        out[place] = _clip(ahead_by(v, bv, j) / 50.0, 3.0)
        out[place + 1] = (v[j].y - v[bv].y) / 4.0
        out[place + 2] = (v[j].speed - v[bv].speed) / 10.0
        out[place + 3] = v[j].target_lane - v[bv].target_lane
        out[place + 4] = 1.0


@inlined_kernel
def _actions_on_road(w: World, bv: int, road: RoadNumbers, allowed: NDArray[np.bool_]) -> None:
    """Write which actions BV `bv` could take on a road, natural or not."""
    v = w.vehicles
    for a in range(N_ACTIONS):
        allowed[a] = True
    lane = v[bv].target_lane
    allowed[ACTION_LEFT] = may_change(v, bv, lane + 1, road)
    allowed[ACTION_RIGHT] = may_change(v, bv, lane - 1, road)
    if v[bv].duration > 0.0:
        if v[bv].c0 < lane_centre(lane, road.lane_width):
            allowed[ACTION_LEFT] = False
        else:
            allowed[ACTION_RIGHT] = False
    braking = braking_for_end(v, bv, road)
    if braking > 0.0:
        for a in range(nearest_action(-braking) + 1, N_ACTIONS):
            allowed[a] = False


@inlined_kernel
def allowed_actions(
    w: World,
    bv: int,
    bounded: int,
    road: RoadNumbers,
    tables: NddTables,
    c: StarterScratch,
    p: NDArray[np.float64],
    allowed: NDArray[np.bool_],
) -> None:
    """Write the adversary's action mask into `allowed`, bool (33,): for acting, exploring and the learning target.

    Unbounded: all actions except lane changes that would leave the road or that repeat the running one, and those with
    which it would not stop where its lane ends; at a site those of a driver or of a person. Bounded (paper,
    equation 12): of these, only actions that a naturalistic driver takes with a positive probability. Human errors are
    among them: to look away, to misjudge, to overlook a neighbour. With a budget (state.budget_left > 0): of these,
    only actions whose `price` is within the rest of the budget. The likeliest action costs nothing, so one is always
    allowed.

    The choices of others at this moment are not known. The other BVs may start into the same lane, with their
    probabilities; the AV is assumed to begin no lane change (docs/adr/0019-giving-way.md).

    Args:
        w: The world.
        bv: Slot of the controlled BV.
        bounded: 1 for the NDD-bounded mask.
        road: Constants.
        tables: The naturalistic model.
        c, p: Scratch; p of shape (33,).
        allowed: Where the mask goes.
    """
    if at_site(road.site):
        possible_actions(w, bv, allowed)
    else:
        _actions_on_road(w, bv, road, allowed)
    if bounded:
        left = w.state[0].budget_left
        surely_keeps = tables.lc_most < 0.5 and not road.lanes.varied
        only_possible = left == 0 and tables.overlook_conflict > 0.0 and surely_keeps
        action_probabilities(w, bv, False, ALONE if only_possible else w.vehicles[0].target_lane, road, tables, c, p)
        for a in range(N_ACTIONS):
            allowed[a] = allowed[a] and p[a] > 0.0
        if left > 0:
            free = price_from(p, w.state[0].budget_most > 0)
            for a in range(N_ACTIONS):
                allowed[a] = allowed[a] and price(p[a], free) < left


@kernel
def price_from(p: NDArray[np.float64], excess: bool) -> float:
    """Compute the log-probability of an action that costs nothing [nats], from the probabilities of all, (33,).

    Of a shortfall that of the likeliest action. Of an excess the mean log-probability of what natural drivers do, minus
    the entropy; never more than the former.
    """
    most = 0.0
    mean = 0.0
    for a in range(N_ACTIONS):
        most = max(most, p[a])
        if excess and p[a] > 0.0:
            mean += p[a] * log(p[a])
    return min(log(most), mean) if excess else log(most)


@inlined_kernel
def price(p: float, free: float) -> int:
    """Compute the cost of an action of probability p > 0, in units of a budget, rounded up; see `price_from`.

    For the likeliest action it is 0 of a shortfall, and at most 0 of an excess.
    """
    return math.ceil((free - log(p)) * UNITS_PER_NAT)


@inlined_kernel
def spend_budget(
    w: World, bv: int, action: int, road: RoadNumbers, tables: NddTables, c: StarterScratch, p: NDArray[np.float64]
) -> None:
    """Take the cost of an allowed action (`price`) from the world's likelihood budget, if it has one.

    What an action gives back to a budget of excess never fills it above its start, so nothing can be saved up. Call it
    before the action is carried out. The probabilities come from `allowed_actions`.

    Args:
        w: The world at the moment of the decision.
        bv: Slot of the controlled BV.
        action: Its choice, one that `allowed_actions` allows.
        road: Constants.
        tables: The naturalistic model.
        c, p: Scratch; p of shape (33,).
    """
    state = w.state[0]
    most = state.budget_most
    if state.budget_left > 1 or most > 0:  # 1: nothing is left of shortfalls, so the action is the likeliest
        action_probabilities(w, bv, False, w.vehicles[0].target_lane, road, tables, c, p)
        left = max(1, state.budget_left - price(p[action], price_from(p, most > 0)))
        state.budget_left = min(left, most) if most > 0 else left


def budget_units(budget: float | None) -> int:
    """Convert a budget [nats] to state.budget_left at the start of a test: 0 for None, no limit.

    >>> budget_units(None), budget_units(0.0), budget_units(2.5)
    (0, 1, 2500001)
    """
    return 0 if budget is None else round(budget * UNITS_PER_NAT) + 1
