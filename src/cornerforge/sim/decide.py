"""Decisions of background vehicles, once a second: look around, ask the naturalistic model (or the IDM), give way.

All BVs decide at the same time and independently (paper, "Problem formulation"): they see lanes and intentions as they
were before this moment. There is one exception (docs/adr/0019-giving-way.md): a BV that starts into a lane may give way
to a vehicle ahead, the AV included, that starts into it at the same moment, unless it overlooks that vehicle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel, prefetch
from cornerforge._philox import PURPOSE_DECIDE, blocks, uniform
from cornerforge.drivers.naturalistic import (
    FIRST_PROBE,
    accept_chance,
    following_row,
    free_row,
    lane_change_base,
    sample_row,
)
from cornerforge.drivers.sight import FOLLOWED, HUMAN
from cornerforge.ndd.memory import away_draw, own_word, remembering_word, word_at
from cornerforge.road.lanes import may_change, pace_at, side_to_leave
from cornerforge.road.straight import ahead_by, gap, lane_of
from cornerforge.sim.actions import nearest_action
from cornerforge.sim.av import lead_acceleration
from cornerforge.sim.braking import looks_away_chance
from cornerforge.sim.chances import remember_action, return_chance, side_chance
from cornerforge.sim.controllers import IDM_BVS
from cornerforge.sim.merging import heeds, wish_of
from cornerforge.sim.neighbours import SIGHT, sort_by_x
from cornerforge.sim.sight import lanes_seen
from cornerforge.sim.steering import steer
from cornerforge.sim.trucks import cut_all, cut_to_class
from cornerforge.sim.world import NO_VEHICLE, moment_of
from cornerforge.types import ACTION_HOLD, ACTION_LEFT, ACTION_RIGHT, ACTION_SIDES, FIRST_ACCELERATION

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

    from cornerforge.drivers.avs import AvNumbers
    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting
    from cornerforge.sim.world import World

__all__ = ["decide_bvs"]

_WORD_BITS = 32
_WORD_MASK = 0xFFFFFFFF


@inlined_kernel
def _draw_later(tables: NddTables, row: int, word: uint64, noise: float) -> int:
    """Put a table row and a random word into one number, larger than any action, for a look-up by `_drawn`.

    The word gives the driver's own rank; `noise` is its noise level.

    The row is prefetched now: the table is larger than the processor's nearer caches, and the row arrives by the time
    of the look-up.
    """
    prefetch(tables.cut, row, FIRST_PROBE)
    later: int = ((row + 1) << _WORD_BITS) | np.int64(own_word(word, noise))  # type: ignore[assignment]
    return later


@inlined_kernel
def _drawn(tables: NddTables, action: int) -> int:
    """Return the action itself, or do the look-up that `_draw_later` put off."""
    if action <= _WORD_MASK:
        return action
    return FIRST_ACCELERATION + sample_row(tables.cut, (action >> _WORD_BITS) - 1, np.uint64(action & _WORD_MASK))


@inlined_kernel
def _worst_follow(
    w: World, rank: int, road: RoadNumbers, tables: NddTables, word: uint64, follower_word: uint64, rounding: float
) -> tuple[int, float, float]:
    """Draw the acceleration of the vehicle at a rank behind its leads in all lanes that it occupies.

    One random word, `follower_word` (without a lead `word`), and one random rounding of the range rate serve all leads.
    The action is the smallest of the look-ups: a vehicle between two lanes follows both leads.

    Returns:
        Action 2..32, or `_draw_later` where one look-up decides; gap [m] and range rate [m/s] to the nearest lead
        (+inf and 0 for none within sight).
    """
    v = w.vehicles
    order = w.order
    state = w.state[0]
    i = order[rank]
    wanted = v[i].desired_speed * pace_at(v, i, road)
    lanes = v[i].lanes
    action = -1
    nearest_gap = np.inf
    nearest_rate = 0.0
    for other in range(rank + 1, state.n_vehicles):
        j = order[other]
        if ahead_by(v, i, j) >= SIGHT:
            break
        if v[j].present == 0:
            continue
        seen = lanes_seen(v, j, road.lane_width, FOLLOWED)
        if seen & lanes == 0:
            continue
        if not heeds(v, i, j, seen, road):
            lanes &= ~seen
            continue
        room = gap(v, i, j)
        rate = v[j].speed - v[i].speed
        row = following_row(tables, v[i].speed, wanted, room, rate, rounding)
        later = _draw_later(tables, row, follower_word, v[i].noise)
        if room < nearest_gap:
            nearest_gap = room
            nearest_rate = rate
        action = later if action < 0 else min(_drawn(tables, action), _drawn(tables, later))
        lanes &= ~seen
        if lanes == 0:
            break
    if action < 0:
        action = _draw_later(tables, free_row(v[i].speed, wanted), word, v[i].noise)
    return action, nearest_gap, nearest_rate


@inlined_kernel
def _follow(
    w: World, i: int, lead: int, wanted: float, tables: NddTables, word: uint64, follower_word: uint64, rounding: float
) -> tuple[int, float, float]:
    """Do the same as `_worst_follow` for slot i that occupies one lane.

    `lead` is the next ahead there, -1 for none, `wanted` the speed that its driver wants here [m/s].
    """
    v = w.vehicles
    speed = v[i].speed
    if lead < 0 or ahead_by(v, i, lead) >= SIGHT:
        return _draw_later(tables, free_row(speed, wanted), word, v[i].noise), np.inf, 0.0
    room = gap(v, i, lead)
    rate = v[lead].speed - speed
    row = following_row(tables, speed, wanted, room, rate, rounding)
    return _draw_later(tables, row, follower_word, v[i].noise), room, rate


@inlined_kernel
def _decide_naturalistic(w: World, rank: int, road: RoadNumbers, tables: NddTables, s: Scratch) -> int:
    """Draw the action of the BV at a rank: lateral first, then acceleration (paper, NDE).

    The look-up of the acceleration may be put off (`_draw_later`). `s.front` holds the next vehicle ahead in each lane.
    Of the slot's random words the first decides about lanes, the second and fourth about the acceleration, the third
    about giving way. The second becomes the word that was really used.
    """
    v = w.vehicles
    order = w.order
    words = s.words
    i = order[rank]
    word = words[1, i]
    follower_word = remembering_word(word, v[i].quantile, v[i].habit, tables.memory)
    if v[i].lanes == 1 << v[i].target_lane:
        lead = s.front[v[i].target_lane]
        wanted = v[i].desired_speed * pace_at(v, i, road)
        action, gap, rate = _follow(w, i, lead, wanted, tables, word, follower_word, uniform(words[3, i]))
    else:
        action, gap, rate = _worst_follow(w, rank, road, tables, word, follower_word, uniform(words[3, i]))
    if gap < np.inf:
        words[1, i] = follower_word
    if v[i].duration == 0.0:
        draw = uniform(words[0, i])
        if draw >= 2.0 * tables.lc_most and side_to_leave(v, i, road)[0] == 0:  # mostly this spares a look-up
            return action
        wish = wish_of(v, i, lane_change_base(tables, v[i].speed, gap, rate), road)
        if draw < wish.left + wish.right:  # the chance of both sides is at most this: the neighbours need no look
            lane = v[i].target_lane
            left = 0.0
            if may_change(v, i, lane + 1, road):
                left = side_chance(w, i, lane + 1, wish, tables.overlook, road, tables)
                if draw < left:
                    return ACTION_LEFT
            right = may_change(v, i, lane - 1, road)
            if right and draw < left + side_chance(w, i, lane - 1, wish, tables.overlook, road, tables):
                return ACTION_RIGHT
    elif uniform(words[0, i]) < return_chance(w, i, tables.overlook, road, tables):
        return ACTION_LEFT if lane_of(v[i].y, road.lane_width) > v[i].target_lane else ACTION_RIGHT
    return action


@inlined_kernel
def _looks_away(v: NDArray[np.void], i: int, words: NDArray[np.uint64], road: RoadNumbers, tables: NddTables) -> bool:
    """Draw whether slot i looks away in this second, and note it; then the quantile of its acceleration stays."""
    away = away_draw(words[2, i], words[3, i]) < looks_away_chance(v, i, road, tables.memory)
    v[i].away = 1 if away else 0
    if away:
        words[1, i] = word_at(v[i].quantile)
    return away


@inlined_kernel
def _idm_action(w: World, rank: int, road: RoadNumbers, av: AvNumbers) -> int:
    """Choose the action nearest to the IDM's command for the BV at a rank."""
    v = w.vehicles
    order = w.order
    i = order[rank]
    command = lead_acceleration(w, i, v[i].lanes, HUMAN, road, av)
    return cut_to_class(w, i, nearest_action(command), road)


@kernel
def _starts_into(v: NDArray[np.void], j: int, lane: int, av_lane: int) -> bool:
    """Does vehicle j start a change into `lane` at this moment? `av_lane` is the AV's newly chosen target lane."""
    if v[j].present == 0 or v[j].target_lane == lane:
        return False
    if j == 0:
        return av_lane == lane
    action = v[j].action
    starts: bool = 0 <= action < FIRST_ACCELERATION and v[j].target_lane + ACTION_SIDES[action] == lane
    return starts


@kernel
def _gives_way(w: World, i: int, target: int, av_lane: int, setting: Setting, s: Scratch) -> bool:
    """Must slot i, about to change to `target`, wait for a vehicle ahead that starts into it at the same moment?

    It waits unless it accepts the gap to that vehicle as it would to a lead in the target lane, from whichever side the
    vehicle comes. An inattentive driver (`overlook_conflict`) does not wait.
    """
    v = w.vehicles
    state = w.state[0]
    tables = setting.tables
    chance = 1.0
    for j in range(state.n_vehicles):
        dx = ahead_by(v, i, j)
        if dx < 0.0 or dx >= SIGHT or j == i or (dx == 0.0 and j < i) or not _starts_into(v, j, target, av_lane):
            continue
        chance = min(chance, accept_chance(tables.lc_accept, 0, gap(v, i, j), v[j].speed - v[i].speed))
    if chance >= 1.0:
        return False
    waits: bool = uniform(s.words[2, i]) >= tables.overlook_conflict + (1.0 - tables.overlook_conflict) * chance
    return waits


@inlined_kernel
def _all_follow_idm(w: World, controlled_action: int, road: RoadNumbers, av: AvNumbers) -> None:
    """Let every BV choose the acceleration nearest to the IDM's; the controlled one takes `controlled_action`."""
    v = w.vehicles
    controlled = w.state[0].controlled
    for rank in range(w.state[0].n_vehicles):
        i = w.order[rank]
        if i > 0 and v[i].present:
            v[i].action = controlled_action if i == controlled else _idm_action(w, rank, road, av)


@inlined_kernel
def _all_naturalistic(w: World, controlled_action: int, setting: Setting, s: Scratch) -> int:
    """Let every BV draw its action; the controlled one takes `controlled_action`. Return how many begin a lane change.

    The walk goes from the front to the rear and notes the last vehicle of each lane, so that a lead is found at once.
    Look-ups come last, all in one loop without branches: the processor then waits for the table once, not once per BV.
    """
    v = w.vehicles
    state = w.state[0]
    road, tables = setting.road, setting.tables
    controlled = state.controlled
    changes = 0
    blocks(s.words, state.seed, state.test, moment_of(w), state.n_vehicles, PURPOSE_DECIDE)
    if s.steering.on[0]:
        steer(s.words, s.steering, state.n_vehicles)
    for lane in range(road.n_lanes):
        s.front[lane] = NO_VEHICLE
    for rank in range(state.n_vehicles - 1, -1, -1):
        i = w.order[rank]
        if v[i].present == 0:
            continue
        if i > 0:
            if i == controlled:
                action = controlled_action
                away = away_draw(s.words[2, i], s.words[3, i])
                s.words[1, i] = remember_action(w, i, action, s.words[1, i], uniform(s.words[3, i]), away, road, tables)
            elif _looks_away(v, i, s.words, road, tables):
                action = ACTION_HOLD
            else:
                action = _decide_naturalistic(w, rank, road, tables, s)
            v[i].action = action
            if action < FIRST_ACCELERATION:
                changes += 1
        seen = lanes_seen(v, i, road.lane_width, FOLLOWED)
        for lane in range(road.n_lanes):
            if seen & (1 << lane):
                s.front[lane] = i
    for i in range(1, state.n_vehicles):
        v[i].action = _drawn(tables, v[i].action)
        v[i].quantile = uniform(s.words[1, i])
    if road.limited:
        cut_all(w, controlled, road)
    return changes


@inlined_kernel
def decide_bvs(w: World, controlled_action: int, av_lane: int, setting: Setting, s: Scratch) -> None:
    """Write every BV's choice into its `action`; the controlled BV (if any) takes `controlled_action`.

    `av_lane` is the target lane that the AV has just chosen: a BV that starts into it at the same moment sees that.
    Each model has a loop of its own: with the choice of the model inside one loop the compiler makes both slower.
    """
    sort_by_x(w)
    if setting.who.others == IDM_BVS:
        _all_follow_idm(w, controlled_action, setting.road, setting.av)
        return
    changes = _all_naturalistic(w, controlled_action, setting, s)
    if changes + (av_lane != w.vehicles[0].target_lane) > 1:
        _resolve_conflicts(w, av_lane, setting, s)


@kernel
def _resolve_conflicts(w: World, av_lane: int, setting: Setting, s: Scratch) -> None:
    """Turn the lane change of every BV that gives way into the acceleration it drew, from the front to the rear."""
    v = w.vehicles
    order = w.order
    state = w.state[0]
    road, tables = setting.road, setting.tables
    for rank in range(state.n_vehicles - 1, -1, -1):
        i = order[rank]
        if i == 0 or v[i].present == 0 or i == state.controlled or v[i].action < 0 or v[i].action >= FIRST_ACCELERATION:
            continue
        if v[i].duration > 0.0:  # it turns back, because others are in the way
            continue
        target = v[i].target_lane + ACTION_SIDES[v[i].action]
        if _gives_way(w, i, target, av_lane, setting, s):
            word = s.words[1, i]
            action, _, _ = _worst_follow(w, rank, road, tables, word, word, uniform(s.words[3, i]))
            v[i].action = cut_to_class(w, i, _drawn(tables, action), road)
