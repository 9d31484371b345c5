"""What every vehicle of a world decides, once a second for BVs: gather neighbours, ask the driver models, apply.

All BVs decide at the same time and independently (paper, "Problem formulation"): they see lanes and intentions as they
were before this moment. The one exception, stated in docs/adr, is that a driver who starts into a lane minds who starts
into it at the same moment ahead of it, the AV too, unless it overlooks it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import PURPOSE_DECIDE, block, uniform
from cornerforge.drivers.idm import idm_acceleration
from cornerforge.drivers.mobil import mobil_gain
from cornerforge.drivers.naturalistic import (
    accept_chance,
    following_row,
    free_row,
    lane_change_base,
    sample_row,
)
from cornerforge.geometry import lane_centre, lane_of, path_at, plan_path
from cornerforge.sim.world import CONTROLLED, N_CURRENT, N_DECISIONS, N_SEEN, N_VEHICLES, path_of

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.sim.world import AvNumbers, RoadNumbers, World

__all__ = [
    "SIGHT",
    "action_probabilities",
    "apply_action",
    "av_decide",
    "decide_bvs",
    "hold",
    "nearest_bv",
    "neighbours_in_lane",
    "start_lane_change",
]

SIGHT = 200.0
"""Vehicles further ahead or behind than this [m, centre to centre] are not seen by anyone."""
CONFLICT_GAP = 10.0
"""The AV gives way to a vehicle that enters its target lane from the far side when less than this lies between them
lengthwise [m]."""
IDM_BVS = 1
"""Value of `bv_model` for BVs that follow the IDM without lane changes; 0 is the naturalistic model."""
_SIDES = (1, -1)
_WORD_BITS = 32
_WORD_MASK = 0xFFFFFFFF


@inlined_kernel
def neighbours_in_lane(w: World, i: int, lane: int, lane_width: float, sees_intentions: int) -> tuple[int, int]:
    """Nearest vehicles ahead of and behind slot i in a lane: (lead, rear), -1 for none within sight.

    Where `sees_intentions` is 0 a vehicle is in the lane that holds its centre and in no other. Vehicles at the same x
    are ordered by slot.
    """
    v = w.vehicles
    info = w.info
    lead = -1
    rear = -1
    bit = 1 << lane
    best_lead = SIGHT
    best_rear = SIGHT
    for k in range(info[N_SEEN]):
        j = w.current[k]
        if j == i:
            continue
        dx = v[j].x - v[i].x
        if dx > best_lead or -dx > best_rear:
            continue
        if sees_intentions:
            if v[j].lanes & bit == 0:
                continue
        elif lane_of(v[j].y, lane_width) != lane:
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
def start_lane_change(w: World, i: int, target_lane: int, road: RoadNumbers) -> None:
    """Plan the lateral path of slot i from where it is to the centre of `target_lane`."""
    v = w.vehicles
    acceleration = 0.0
    speed = 0.0
    if v[i].duration > 0.0:
        _, speed, acceleration = path_at(path_of(v, i), v[i].clock)
    v[i].target_lane = target_lane
    v[i].clock = 0.0
    path, duration = plan_path(
        v[i].y,
        speed,
        acceleration,
        lane_centre(target_lane, road.lane_width),
        road.lane_change_duration,
        road.max_lateral_acceleration,
    )
    v[i].duration = duration
    v[i].c0, v[i].c1, v[i].c2, v[i].c3, v[i].c4, v[i].c5 = path
    v[i].lanes |= 1 << target_lane


@kernel
def nearest_bv(w: World) -> int:
    """Slot of the BV whose centre is nearest to the AV's; -1 when there is none (paper: the critical BV)."""
    v = w.vehicles
    info = w.info
    best = -1
    best_squared = np.inf
    for j in range(1, info[N_VEHICLES]):
        if v[j].present:
            dx = v[j].x - v[0].x
            dy = v[j].y - v[0].y
            squared = dx * dx + dy * dy
            if squared < best_squared:
                best_squared = squared
                best = j
    return best


@inlined_kernel
def _lead_acceleration(w: World, i: int, lanes: int, road: RoadNumbers, av: AvNumbers) -> float:
    """IDM acceleration of slot i behind the worst of its leads in all lanes of the bit mask."""
    v = w.vehicles
    speed = v[i].speed
    command = idm_acceleration(speed, np.inf, 0.0, av.idm)
    for lane in range(road.n_lanes):
        if lanes & (1 << lane):
            lead, _ = neighbours_in_lane(w, i, lane, road.lane_width, av.sees_intentions)
            if lead >= 0:
                gap = v[lead].x - v[i].x - road.length
                command = min(command, idm_acceleration(speed, gap, v[lead].speed - speed, av.idm))
    return command


@inlined_kernel
def _side_gain(w: World, lane: int, acceleration_now: float, needed: float, road: RoadNumbers, av: AvNumbers) -> float:
    """The AV's MOBIL gain [m/s2] of changing to `lane`, or `needed` where it is sure to be no more than that."""
    v = w.vehicles
    speed = v[0].speed
    lead, rear = neighbours_in_lane(w, 0, lane, road.lane_width, av.sees_intentions)
    lead_gap = np.inf
    lead_speed = speed
    rear_gap = np.inf
    rear_speed = speed
    rear_now = 0.0
    if lead >= 0:
        lead_gap = v[lead].x - v[0].x - road.length
        lead_speed = v[lead].speed
    if av.mobil.politeness == 0.0:
        own_after = idm_acceleration(speed, lead_gap, lead_speed - speed, av.idm)
        if own_after - acceleration_now <= needed:
            return needed
    if rear >= 0:
        rear_gap = v[0].x - v[rear].x - road.length
        rear_speed = v[rear].speed
        if av.mobil.politeness > 0.0:
            rear_now = _lead_acceleration(w, rear, v[rear].lanes, road, av)
    return mobil_gain(speed, acceleration_now, lead_gap, lead_speed, rear_gap, rear_speed, rear_now, av.idm, av.mobil)


@kernel
def _must_give_way(w: World, road: RoadNumbers) -> bool:
    """Does another vehicle enter the AV's target lane from the far side while the AV's centre is in its old lane?"""
    v = w.vehicles
    info = w.info
    target = v[0].target_lane
    old = lane_of(v[0].y, road.lane_width)
    if old == target:
        return False
    for k in range(info[N_CURRENT]):
        j = w.current[k]
        if j > 0 and v[j].target_lane == target:
            other = lane_of(v[j].y, road.lane_width)
            if other != target and other != old and abs(v[j].x - v[0].x) < road.length + CONFLICT_GAP:
                return True
    return False


@inlined_kernel
def av_decide(w: World, road: RoadNumbers, av: AvNumbers) -> tuple[float, int]:
    """The built-in AV, IDM and MOBIL: acceleration [m/s2] and target lane. Reads the world, changes nothing."""
    v = w.vehicles
    command = _lead_acceleration(w, 0, v[0].lanes, road, av)
    lane = v[0].target_lane
    if v[0].duration > 0.0:
        if av.sees_intentions and _must_give_way(w, road):
            return command, lane_of(v[0].y, road.lane_width)
        return command, lane
    best_gain = av.mobil.min_gain
    # No lane is better than a free one: an AV that is hardly hindered need not look at the others.
    if av.mobil.politeness == 0.0 and idm_acceleration(v[0].speed, np.inf, 0.0, av.idm) - command <= best_gain:
        return command, lane
    best_lane = lane
    for side in _SIDES:
        if 0 <= lane + side < road.n_lanes:
            gain = _side_gain(w, lane + side, command, best_gain, road, av)
            if gain > best_gain:
                best_gain = gain
                best_lane = lane + side
    return command, best_lane


@inlined_kernel
def _draw_later(row: int, word: uint64) -> int:
    """Row and random word in one number, which is larger than any action."""
    later: int = ((row + 1) << _WORD_BITS) | np.int64(word)  # type: ignore[assignment]
    return later


@inlined_kernel
def _drawn(tables: NddTables, action: int) -> int:
    """The action itself, or that of a look-up put off by `_draw_later`."""
    if action <= _WORD_MASK:
        return action
    return 2 + sample_row(tables.cut, (action >> _WORD_BITS) - 1, np.uint64(action & _WORD_MASK))


@inlined_kernel
def _worst_follow(
    w: World, rank: int, road: RoadNumbers, tables: NddTables, word: uint64, rounding: float
) -> tuple[int, float, float]:
    """Acceleration of the vehicle at a rank behind its leads in all lanes that it occupies.

    One random word, and one random rounding of the range rate, serve all leads, so the index is the smallest of the
    look-ups (a vehicle between two lanes minds both).

    Returns:
        Action 2..32, or `_draw_later` where one look-up decides; gap [m] and range rate [m/s] to the nearest lead
        (+inf and 0 for none within sight).
    """
    v = w.vehicles
    order = w.order
    info = w.info
    i = order[rank]
    wanted = v[i].lanes
    action = -1
    nearest_gap = np.inf
    nearest_rate = 0.0
    for other in range(rank + 1, info[N_VEHICLES]):
        j = order[other]
        dx = v[j].x - v[i].x
        if dx >= SIGHT:
            break
        if v[j].present == 0 or v[j].lanes & wanted == 0:
            continue
        gap = dx - road.length
        rate = v[j].speed - v[i].speed
        later = _draw_later(following_row(v[i].speed, gap, rate, rounding), word)
        if action < 0:
            nearest_gap = gap
            nearest_rate = rate
            action = later
        else:
            action = min(_drawn(tables, action), _drawn(tables, later))
        wanted &= ~v[j].lanes
        if wanted == 0:
            break
    if action < 0:
        action = _draw_later(free_row(v[i].speed), word)
    return action, nearest_gap, nearest_rate


@inlined_kernel
def _side_chance(
    w: World, i: int, lane: int, base: float, overlook: float, road: RoadNumbers, tables: NddTables
) -> float:
    """P(change to `lane`) of slot i: base chance times acceptance of both neighbours there."""
    v = w.vehicles
    lead, rear = neighbours_in_lane(w, i, lane, road.lane_width, 1)
    chance = base
    if lead >= 0:
        gap = v[lead].x - v[i].x - road.length
        accept = accept_chance(tables.lc_accept, 0, gap, v[lead].speed - v[i].speed)
        chance *= overlook + (1.0 - overlook) * accept
    if rear >= 0:
        gap = v[i].x - v[rear].x - road.length
        accept = accept_chance(tables.lc_accept, 1, gap, v[i].speed - v[rear].speed)
        chance *= overlook + (1.0 - overlook) * accept
    return chance


@inlined_kernel
def _return_chance(w: World, i: int, overlook: float, road: RoadNumbers, tables: NddTables) -> float:
    """P(slot i turns back in its running lane change).

    An attentive driver whose centre is still in its old lane turns back when it would refuse the gaps in the target
    lane outright, and would not refuse those in the old one.
    """
    v = w.vehicles
    old = lane_of(v[i].y, road.lane_width)
    if old == v[i].target_lane or _side_chance(w, i, v[i].target_lane, 1.0, 0.0, road, tables) > 0.0:
        return 0.0
    if _side_chance(w, i, old, 1.0, 0.0, road, tables) == 0.0:
        return 0.0
    return 1.0 - overlook


@inlined_kernel
def _decide_naturalistic(w: World, rank: int, seed: int, test: int, road: RoadNumbers, tables: NddTables) -> int:
    """Draw the action of the BV at a rank: lateral first, then acceleration (paper, NDE), which may be put off."""
    v = w.vehicles
    order = w.order
    info = w.info
    i = order[rank]
    words = block(seed, test, info[N_DECISIONS], i, PURPOSE_DECIDE)
    action, gap, rate = _worst_follow(w, rank, road, tables, words[1], uniform(words[3]))
    if v[i].duration == 0.0:
        draw = uniform(words[0])
        base = lane_change_base(tables, v[i].speed, gap, rate)
        if draw < 2.0 * base:  # the chance of both sides together is at most this: the neighbours need no look
            lane = v[i].target_lane
            left = 0.0
            if lane + 1 < road.n_lanes:
                left = _side_chance(w, i, lane + 1, base, tables.overlook, road, tables)
                if draw < left:
                    return 0
            if lane > 0 and draw < left + _side_chance(w, i, lane - 1, base, tables.overlook, road, tables):
                return 1
    elif uniform(words[0]) < _return_chance(w, i, tables.overlook, road, tables):
        return 0 if lane_of(v[i].y, road.lane_width) > v[i].target_lane else 1
    return action


@kernel
def _idm_index(w: World, rank: int, road: RoadNumbers, av: AvNumbers) -> int:
    """Acceleration index nearest to the IDM's command for the BV at a rank."""
    v = w.vehicles
    order = w.order
    i = order[rank]
    command = _lead_acceleration(w, i, v[i].lanes, road, av)
    return max(0, min(30, math.floor((command + 4.0) * 5.0 + 0.5)))


@kernel
def _rounding_limit(v: NDArray[np.void], i: int, lead: int, above: float) -> float:
    """From which rounding on the range rate to a lead is rounded up, if that lies above `above`; else 1."""
    if lead < 0:
        return 1.0
    rate = v[lead].speed - v[i].speed
    limit: float = 1.0 - (rate - math.floor(rate))
    return limit if limit > above else 1.0


@kernel
def _add_cumulative(
    v: NDArray[np.void], i: int, leads: tuple[int, int, int], rounding: float, weight: float,
    road: RoadNumbers, tables: NddTables, p: NDArray[np.float64],
) -> None:  # fmt: skip
    """Add to p[2:] `weight` times the distribution function of slot i's acceleration for a given rounding.

    The smallest of several look-ups by one word has the largest of their distribution functions.
    """
    rows = (-1, -1, -1)
    if leads[0] < 0:
        row = free_row(v[i].speed)
        rows = (row, row, row)
    else:
        first = _row_behind(v, i, leads[0], rounding, road)
        second = _row_behind(v, i, leads[1], rounding, road) if leads[1] >= 0 else first
        third = _row_behind(v, i, leads[2], rounding, road) if leads[2] >= 0 else first
        rows = (first, second, third)
    a_total = 0.0
    b_total = 0.0
    c_total = 0.0
    for a in range(31):
        a_total += tables.p[rows[0], a]
        b_total += tables.p[rows[1], a]
        c_total += tables.p[rows[2], a]
        p[2 + a] += weight * max(a_total, max(b_total, c_total))


@kernel
def _row_behind(v: NDArray[np.void], i: int, lead: int, rounding: float, road: RoadNumbers) -> int:
    """Row of the tables for slot i behind a lead."""
    gap = v[lead].x - v[i].x - road.length
    row: int = following_row(v[i].speed, gap, v[lead].speed - v[i].speed, rounding)
    return row


@kernel
def _leads(w: World, i: int, road: RoadNumbers) -> tuple[int, int, int]:
    """Leads of slot i in the lanes it occupies (three at most: two under its body, and its target), -1 for none."""
    v = w.vehicles
    first = -1
    second = -1
    third = -1
    for lane in range(road.n_lanes):
        if v[i].lanes & (1 << lane):
            j, _ = neighbours_in_lane(w, i, lane, road.lane_width, 1)
            if j >= 0:
                third = second
                second = first
                first = j
    return first, second, third


@kernel
def action_probabilities(
    w: World, i: int, overlook: float, road: RoadNumbers, tables: NddTables, p: NDArray[np.float64]
) -> None:
    """P(action | state) of BV i under the naturalistic model, into `p`, shape (33,); sums to 1.

    With `overlook` = 0 it is the attentive driver, whose zeros are what "impossible" means for the NDD-bounded
    adversary (paper, equation 12). The giving way to simultaneous lane changes, which needs the others' draws, is left
    out.
    """
    v = w.vehicles
    leads = _leads(w, i, road)
    for a in range(33):
        p[a] = 0.0
    low = 0.0
    while low < 1.0:  # the rounding of range rates is uniform in (0, 1); between two limits the rows stay the same
        high = min(
            _rounding_limit(v, i, leads[0], low),
            min(_rounding_limit(v, i, leads[1], low), _rounding_limit(v, i, leads[2], low)),
        )
        _add_cumulative(v, i, leads, 0.5 * (low + high), high - low, road, tables, p)
        low = high
    nearest_gap = np.inf
    nearest_rate = 0.0
    for j in leads:
        if j >= 0 and v[j].x - v[i].x - road.length < nearest_gap:
            nearest_gap = v[j].x - v[i].x - road.length
            nearest_rate = v[j].speed - v[i].speed
    if v[i].duration == 0.0:
        base = lane_change_base(tables, v[i].speed, nearest_gap, nearest_rate)
        lane = v[i].target_lane
        if lane + 1 < road.n_lanes:
            p[0] = _side_chance(w, i, lane + 1, base, overlook, road, tables)
        if lane > 0:
            p[1] = _side_chance(w, i, lane - 1, base, overlook, road, tables)
    else:
        back = 0 if lane_of(v[i].y, road.lane_width) > v[i].target_lane else 1
        p[back] = _return_chance(w, i, overlook, road, tables)
    keep = (1.0 - p[0] - p[1]) / p[32]
    for a in range(32, 2, -1):
        p[a] = keep * (p[a] - p[a - 1])
    p[2] = keep * p[2]


@kernel
def _starts_into(v: NDArray[np.void], j: int, lane: int, av_lane: int) -> bool:
    """Does vehicle j start a change into `lane` at this moment? `av_lane` is the AV's newly chosen target lane."""
    if v[j].present == 0 or v[j].target_lane == lane:
        return False
    if j == 0:
        return av_lane == lane
    starts: bool = 0 <= v[j].action <= 1 and v[j].target_lane + 1 - 2 * v[j].action == lane
    return starts


@kernel
def _gives_way(
    w: World, i: int, target: int, av_lane: int, seed: int, test: int, road: RoadNumbers, tables: NddTables
) -> bool:
    """Must slot i, about to change to `target`, wait for one ahead that starts into it at the same moment?

    It waits unless it accepts the gap to that one as to a lead in the target lane, from whichever side it comes. An
    inattentive driver (`overlook_conflict`) does not wait.
    """
    v = w.vehicles
    info = w.info
    chance = 1.0
    for j in range(info[N_VEHICLES]):
        dx = v[j].x - v[i].x
        if dx < 0.0 or dx >= SIGHT or j == i or (dx == 0.0 and j > i) or not _starts_into(v, j, target, av_lane):
            continue
        chance = min(chance, accept_chance(tables.lc_accept, 0, dx - road.length, v[j].speed - v[i].speed))
    if chance >= 1.0:
        return False
    words = block(seed, test, info[N_DECISIONS], i, PURPOSE_DECIDE)
    waits: bool = uniform(words[2]) >= tables.overlook_conflict + (1.0 - tables.overlook_conflict) * chance
    return waits


@inlined_kernel
def hold(v: NDArray[np.void], i: int, acceleration: float) -> None:
    """Vehicle i holds an acceleration [m/s2] from now on."""
    v[i].acceleration = acceleration
    v[i].x_held = v[i].x
    v[i].speed_held = v[i].speed


@inlined_kernel
def apply_action(w: World, i: int, action: int, accelerations: NDArray[np.float64], road: RoadNumbers) -> None:
    """Carry out an action index for slot i: 0 left, 1 right (speed held), 2.. acceleration.

    A change against the running one returns to the lane it came from; one in its direction changes nothing.
    A change that would leave the road is not carried out.
    """
    v = w.vehicles
    if action >= 2:
        hold(v, i, accelerations[action - 2])
        return
    hold(v, i, 0.0)
    side = 1 - 2 * action
    target = v[i].target_lane + side
    if v[i].duration > 0.0:
        running = 1 if v[i].c0 < lane_centre(v[i].target_lane, road.lane_width) else -1
        if running == side:
            return
    if 0 <= target < road.n_lanes:
        start_lane_change(w, i, target, road)


@inlined_kernel
def sort_by_x(w: World) -> None:
    """Insertion sort of `order`; ties by slot. Traffic is nearly sorted, so this costs about one pass."""
    v = w.vehicles
    order = w.order
    info = w.info
    for rank in range(1, info[N_VEHICLES]):
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


@kernel
def _all_follow_idm(w: World, controlled_action: int, road: RoadNumbers, av: AvNumbers) -> None:
    """Every BV chooses the acceleration nearest to the IDM's; the controlled one takes `controlled_action`."""
    v = w.vehicles
    controlled = w.info[CONTROLLED]
    for rank in range(w.info[N_VEHICLES]):
        i = w.order[rank]
        if i > 0 and v[i].present:
            v[i].action = controlled_action if i == controlled else 2 + _idm_index(w, rank, road, av)


@inlined_kernel
def _all_naturalistic(
    w: World, seed: int, test: int, controlled_action: int, road: RoadNumbers, tables: NddTables
) -> int:
    """Every BV draws its action; the controlled one takes `controlled_action`. Returns how many begin a lane change.

    Look-ups come last, all in one loop without branches: the processor then waits for the table once, not once a BV.
    """
    v = w.vehicles
    controlled = w.info[CONTROLLED]
    changes = 0
    for rank in range(w.info[N_VEHICLES]):
        i = w.order[rank]
        if i == 0 or v[i].present == 0:
            continue
        action = controlled_action if i == controlled else _decide_naturalistic(w, rank, seed, test, road, tables)
        v[i].action = action
        if action < 2:
            changes += 1
    for i in range(1, w.info[N_VEHICLES]):
        v[i].action = _drawn(tables, v[i].action)
    return changes


@inlined_kernel
def decide_bvs(
    w: World,
    seed: int,
    test: int,
    bv_model: int,
    controlled_action: int,
    av_lane: int,
    road: RoadNumbers,
    av: AvNumbers,
    tables: NddTables,
) -> None:
    """Let all BVs choose, into their `action`. The controlled BV (info[CONTROLLED], if any) takes `controlled_action`.

    `av_lane` is the target lane that the AV has just chosen: who starts into it at the same moment sees that.

    One loop for each model: with the choice inside the loop the compiler makes both slower.
    """
    sort_by_x(w)
    if bv_model == IDM_BVS:
        _all_follow_idm(w, controlled_action, road, av)
        return
    changes = _all_naturalistic(w, seed, test, controlled_action, road, tables)
    if changes + (av_lane != w.vehicles[0].target_lane) > 1:
        _resolve_conflicts(w, av_lane, seed, test, road, tables)


@kernel
def _resolve_conflicts(w: World, av_lane: int, seed: int, test: int, road: RoadNumbers, tables: NddTables) -> None:
    """Turn the lane change of every BV that gives way into the acceleration it drew, from the front to the rear."""
    v = w.vehicles
    order = w.order
    info = w.info
    for rank in range(info[N_VEHICLES] - 1, -1, -1):
        i = order[rank]
        if i == 0 or v[i].present == 0 or i == info[CONTROLLED] or v[i].action < 0 or v[i].action > 1:
            continue
        if v[i].duration > 0.0:  # it turns back, because others are in the way
            continue
        target = v[i].target_lane + 1 - 2 * v[i].action
        if _gives_way(w, i, target, av_lane, seed, test, road, tables):
            words = block(seed, test, info[N_DECISIONS], i, PURPOSE_DECIDE)
            action, _, _ = _worst_follow(w, rank, road, tables, words[1], uniform(words[3]))
            v[i].action = _drawn(tables, action)
