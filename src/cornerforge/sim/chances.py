"""The probability of each of a BV's 33 actions, given the state: the distribution from which `decide.py` draws.

Drivers decide independently, with one exception: a driver about to start into a lane may give way to vehicles ahead of
it that start into the same lane at the same moment. So the probability of a lane change depends on what others draw.
Only few of them matter, and their probabilities are summed exactly (`_goes_chance`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import uniform
from cornerforge.drivers.naturalistic import (
    accept_chance,
    following_row,
    free_row,
    lane_change_base,
    turn_back_chance,
)
from cornerforge.drivers.sight import FOLLOWED, HUMAN
from cornerforge.ndd.memory import own_rank, remembered_share, word_at
from cornerforge.road.lanes import may_change, pace_at, side_to_leave_lane, way_left
from cornerforge.road.straight import ahead_by, gap, lane_of
from cornerforge.sim.braking import looks_away_chance
from cornerforge.sim.merging import LOOKS_AGAIN, Wish, heeds, pressed_chance, wish_of
from cornerforge.sim.neighbours import SIGHT, neighbours_in_lane, sort_by_x
from cornerforge.sim.sight import lanes_seen
from cornerforge.sim.site.choice import natural_choice
from cornerforge.sim.site.second import look_around
from cornerforge.sim.trucks import possible_actions
from cornerforge.site.tables import at_site
from cornerforge.types import (
    ACTION_HOLD,
    ACTION_LEFT,
    ACTION_RIGHT,
    FIRST_ACCELERATION,
    IGNORED_FROM,
    N_ACCELERATIONS,
    N_ACTIONS,
    TRUCK,
)

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = [
    "ALONE",
    "MAX_SETS",
    "MAX_STARTERS",
    "StarterScratch",
    "action_probabilities",
    "allocate_starter_scratch",
    "lane_wishes",
    "remember_action",
    "return_chance",
    "side_chance",
]

ALONE = -1
"""Instead of the AV's lane: no other vehicle starts into a lane at this moment. Where conflicts may be overlooked and
not all want to change lanes, the same actions are possible, in less time."""
MAX_STARTERS = 46
"""Largest number of vehicles: a driver and the vehicles that may make it wait; see `StarterScratch.left_out`."""
MAX_SETS = 256
"""Largest number of sets of starters that are kept apart; see `StarterScratch.left_out`."""


_ROOM_TO_RETURN = 3.0
"""None turns back into a lane that ends within so much time [s]."""
_WORDS = 2.0**32
_PER_WORD = 1.0 / _WORDS


class StarterScratch(NamedTuple):
    """Scratch about a driver (number 0) and the vehicles ahead that may start into the same lane, from the rear on.

    Attributes:
        slot: Slot of each vehicle, int64 (MAX_STARTERS,).
        wants: Chance that it starts if no vehicle ahead of it does, float64 (MAX_STARTERS,).
        accepts: accepts[k, m], k < m: chance that k, if attentive, starts although m starts, float64 (MAX_STARTERS,
            MAX_STARTERS).
        sets: Sets of starters, as bit masks; two lists, each made from the other in turn, int64 (2, MAX_SETS).
        chances: The probability of each set, float64 (2, MAX_SETS).
        left_out: How often there were more than MAX_STARTERS or MAX_SETS, int64 (1,). Then the vehicles furthest ahead
            count as not starting, or a further set counts as the last one in the list. Kernels cannot warn:
            `scratch.warn_of_left_out` does.
    """

    slot: NDArray[np.int64]
    wants: NDArray[np.float64]
    accepts: NDArray[np.float64]
    sets: NDArray[np.int64]
    chances: NDArray[np.float64]
    left_out: NDArray[np.int64]


def allocate_starter_scratch() -> StarterScratch:
    """Scratch for one driver at a time."""
    return StarterScratch(
        np.zeros(MAX_STARTERS, dtype=np.int64),
        np.zeros(MAX_STARTERS),
        np.zeros((MAX_STARTERS, MAX_STARTERS)),
        np.zeros((2, MAX_SETS), dtype=np.int64),
        np.zeros((2, MAX_SETS)),
        np.zeros(1, dtype=np.int64),
    )


# What one driver wants, and what it does where it need not give way


@inlined_kernel
def side_chance(
    w: World, i: int, lane: int, wish: Wish, overlook: float, road: RoadNumbers, tables: NddTables
) -> float:
    """Compute P(change to `lane`) of slot i: chance of its wish times acceptance of both neighbours there.

    With `Odd.ignored_rear` even an attentive driver may ignore the one behind. Some lanes are closed to trucks.
    """
    v = w.vehicles
    base = wish.left if lane > v[i].target_lane else wish.right
    if base == 0.0 or (lane >= road.truck_lanes and v[i].kind == TRUCK):
        return 0.0
    if wish.urgency > 0.0:
        overlook *= LOOKS_AGAIN * road.law.looks_again
    lead, rear = neighbours_in_lane(w, i, lane, road.lane_width, HUMAN)
    chance = base
    if lead >= 0:
        room, rate = gap(v, i, lead), v[lead].speed - v[i].speed
        accept = accept_chance(tables.lc_accept, 0, room, rate)
        accept = max(accept, pressed_chance(wish.urgency, room, rate, v[i].speed, road.law))
        chance *= overlook + (1.0 - overlook) * accept
    if rear >= 0:
        room = gap(v, rear, i)
        rate = v[i].speed - v[rear].speed
        accept = accept_chance(tables.lc_accept, 1, room, rate)
        if room >= IGNORED_FROM:
            accept += road.ignored_rear * (1.0 - accept)
        accept = max(accept, pressed_chance(wish.urgency, room, rate, v[rear].speed, road.law))
        chance *= overlook + (1.0 - overlook) * accept
    return chance


@inlined_kernel
def _turn_back_wish(w: World, i: int, lane: int, road: RoadNumbers, tables: NddTables) -> float:
    """Compute the chance that slot i, if attentive, would leave `lane` for its neighbours there: the larger of two."""
    v = w.vehicles
    lead, rear = neighbours_in_lane(w, i, lane, road.lane_width, HUMAN)
    wish = 0.0
    if lead >= 0:
        wish = turn_back_chance(tables.lc_turn_back, gap(v, i, lead), v[lead].speed - v[i].speed)
    if rear >= 0:
        wish = max(wish, turn_back_chance(tables.lc_turn_back, gap(v, rear, i), v[i].speed - v[rear].speed))
    return wish


@inlined_kernel
def _is_blocked(w: World, i: int, road: RoadNumbers) -> bool:
    """Is a vehicle beside slot i in the lane that it changes to, and room left in the old one?"""
    v = w.vehicles
    old = lane_of(v[i].y, road.lane_width)
    if way_left(v, i, old, road) < _ROOM_TO_RETURN * v[i].speed:
        return False
    lead, rear = neighbours_in_lane(w, i, v[i].target_lane, road.lane_width, HUMAN)
    return (lead >= 0 and gap(v, i, lead) <= 0.0) or (rear >= 0 and gap(v, rear, i) <= 0.0)


@inlined_kernel
def return_chance(w: World, i: int, overlook: float, road: RoadNumbers, tables: NddTables) -> float:
    """Compute P(slot i turns back in its running lane change).

    While its centre is still in its old lane, an attentive driver turns back for a neighbour in its target lane with
    the chance of `lc_turn_back`, unless it would certainly turn back from the old lane too. From a lane that it must
    leave it has accepted short gaps, and turns back only where a neighbour has come beside it.
    """
    v = w.vehicles
    old = lane_of(v[i].y, road.lane_width)
    if old == v[i].target_lane:
        return 0.0
    wish = _turn_back_wish(w, i, v[i].target_lane, road, tables)
    if road.lanes.varied and side_to_leave_lane(v, i, old, road)[1] > 0.0 and not _is_blocked(w, i, road):
        return 0.0
    if wish == 0.0 or _turn_back_wish(w, i, old, road, tables) == 1.0:
        return 0.0
    return (1.0 - overlook) * wish


@kernel
def _rounding_limit(v: NDArray[np.void], i: int, lead: int, above: float) -> float:
    """Find the rounding from which the range rate to a lead is rounded up, if it is above `above`; else 1."""
    if lead < 0:
        return 1.0
    rate = v[lead].speed - v[i].speed
    limit: float = 1.0 - (rate - math.floor(rate))
    return limit if limit > above else 1.0


@inlined_kernel
def _add_cumulative(
    v: NDArray[np.void], i: int, leads: tuple[int, int, int], rounding: float, weight: float, road: RoadNumbers,
    tables: NddTables, p: NDArray[np.float64],
) -> None:  # fmt: skip
    """Add `weight` times the distribution function of slot i's acceleration, for a given rounding, to `p`.

    A follower remembers its last quantile; a driver without a lead does not; both have their own noise level. The
    smallest of several look-ups with one random word has the largest of their distribution functions.
    """
    rows = (-1, -1, -1)
    if leads[0] < 0:
        row = free_row(v[i].speed, v[i].desired_speed * pace_at(v, i, road))
        rows = (row, row, row)
    else:
        first = _row_behind(v, i, leads[0], rounding, road, tables)
        second = _row_behind(v, i, leads[1], rounding, road, tables) if leads[1] >= 0 else first
        third = _row_behind(v, i, leads[2], rounding, road, tables) if leads[2] >= 0 else first
        rows = (first, second, third)
    a_total = 0.0
    b_total = 0.0
    c_total = 0.0
    for a in range(N_ACCELERATIONS):
        a_total += tables.p[rows[0], a]
        b_total += tables.p[rows[1], a]
        c_total += tables.p[rows[2], a]
        total = own_rank(max(a_total, max(b_total, c_total)), v[i].noise)
        if leads[0] >= 0:
            total = remembered_share(min(total, 1.0), v[i].quantile, v[i].habit, tables.memory)
        p[FIRST_ACCELERATION + a] += weight * total


@kernel
def _row_behind(v: NDArray[np.void], i: int, lead: int, rounding: float, road: RoadNumbers, tables: NddTables) -> int:
    """Look up the tables' row for slot i behind a lead."""
    speed = v[i].speed
    wanted = v[i].desired_speed * pace_at(v, i, road)
    row: int = following_row(tables, speed, wanted, gap(v, i, lead), v[lead].speed - speed, rounding)
    return row


@inlined_kernel
def remember_action(
    w: World, i: int, action: int, word: uint64, rounding: float, away: float, road: RoadNumbers, tables: NddTables
) -> uint64:
    """Note what slot i remembers of an action chosen by another controller; return its quantile as a random word.

    It is a word with which the slot would have drawn the acceleration. A lane change tells nothing about it: the word
    stays. An impossible acceleration is remembered as where it stands among the possible ones: as the lowest of all
    quantiles if it brakes harder than any driver. A held speed may mean that it looked away: its quantile then stays.

    Args:
        w: The world.
        i: Slot.
        action: Index of the action.
        word: 32 random bits.
        rounding, away: Random numbers in (0, 1): of the range rate, and for whether it looked away.
        road, tables: Constants.
    """
    v = w.vehicles
    looked_away = looks_away_chance(v, i, road, tables.memory)
    v[i].away = 0
    if action < FIRST_ACCELERATION:
        return word
    low, high = _words_of(w, i, action - FIRST_ACCELERATION, rounding, road, tables)
    low = own_rank(low * _PER_WORD, v[i].noise) * _WORDS
    high = own_rank(high * _PER_WORD, v[i].noise) * _WORDS
    if action == ACTION_HOLD and looked_away > 0.0:
        share = (high - low) * _PER_WORD
        if away < looked_away / (looked_away + (1.0 - looked_away) * share):
            v[i].away = 1
            return word_at(v[i].quantile)
    return np.uint64(low + (high - low) * uniform(word))


@inlined_kernel
def _words_of(w: World, i: int, a: int, rounding: float, road: RoadNumbers, tables: NddTables) -> tuple[float, float]:
    """Find the random words of the table, from the first to the last, that give slot i acceleration index `a`."""
    low = 0.0
    high = 0.0
    limits = possible_actions(w, i, road)
    leads = _leads(w, i, road)
    for j in leads:
        if j >= 0:
            row = _row_behind(w.vehicles, i, j, rounding, road, tables)
            low = max(low, _cut(tables, row, a - 1, limits))
            high = max(high, _cut(tables, row, a, limits))
    if leads[0] < 0:
        row = free_row(w.vehicles[i].speed, w.vehicles[i].desired_speed * pace_at(w.vehicles, i, road))
        low = _cut(tables, row, a - 1, limits)
        high = _cut(tables, row, a, limits)
    return low, high


@inlined_kernel
def _cut(tables: NddTables, row: int, a: int, limits: tuple[int, int]) -> float:
    """Read how many of the 2^32 random words give acceleration index a or a smaller one; `limits`: possible actions."""
    if FIRST_ACCELERATION + a < limits[0]:
        return 0.0
    return 4294967295.0 if FIRST_ACCELERATION + a >= limits[1] else float(tables.cut[row, a])


@inlined_kernel
def _leads(w: World, i: int, road: RoadNumbers) -> tuple[int, int, int]:
    """Find slot i's leads in the lanes it occupies (at most three: two under its body, one target), -1 for none."""
    v = w.vehicles
    first = -1
    second = -1
    third = -1
    for lane in range(road.n_lanes):
        if v[i].lanes & (1 << lane):
            j, _ = neighbours_in_lane(w, i, lane, road.lane_width, FOLLOWED)
            if j >= 0 and heeds(v, i, j, lanes_seen(v, j, road.lane_width, FOLLOWED), road):
                third = second
                second = first
                first = j
    return first, second, third


@inlined_kernel
def _wishes(
    w: World, i: int, leads: tuple[int, int, int], overlook: float, road: RoadNumbers, tables: NddTables
) -> tuple[float, float]:
    """Compute P(slot i, which keeps its lane, wants to change left), and the same right, before it gives way.

    Args:
        w: The world.
        i: Slot.
        leads: Its leads, from `_leads`.
        overlook: Its chance to overlook a neighbour.
        road, tables: Constants.
    """
    v = w.vehicles
    room = np.inf
    rate = 0.0
    for j in leads:
        if j >= 0 and gap(v, i, j) < room:
            room = gap(v, i, j)
            rate = v[j].speed - v[i].speed
    wish = wish_of(v, i, lane_change_base(tables, v[i].speed, room, rate), road)
    left = 0.0
    right = 0.0
    if wish.left + wish.right > 0.0:
        lane = v[i].target_lane
        if may_change(v, i, lane + 1, road):
            left = side_chance(w, i, lane + 1, wish, overlook, road, tables)
        if may_change(v, i, lane - 1, road):  # one random number decides on both sides, the left first
            right = min(side_chance(w, i, lane - 1, wish, overlook, road, tables), 1.0 - left)
    return left, right


@inlined_kernel
def lane_wishes(w: World, i: int, road: RoadNumbers, tables: NddTables) -> tuple[float, float]:
    """Compute P(slot i, which keeps its lane and looks at the road, wants to change left), and the same right."""
    return _wishes(w, i, _leads(w, i, road), tables.overlook, road, tables)


@inlined_kernel
def _go_chance(least: float, overlook_conflict: float) -> float:
    """Compute P(a driver that wants to change does not wait); `least`: chance that it accepts the worst starter.

    It is exactly 1 for `least` = 1, and exactly 0 for `least` = 0 and `overlook_conflict` = 0: a zero means
    "impossible".
    """
    return 1.0 - (1.0 - overlook_conflict) * (1.0 - least)


# Giving way: vehicles that may start into the same lane at the same moment


@inlined_kernel
def _start_chance(w: World, j: int, lane: int, av_lane: int, road: RoadNumbers, tables: NddTables) -> float:
    """Compute P(vehicle j starts into `lane` at this moment), if it waits for no other.

    The AV has chosen already (`av_lane`). A BV may change to `lane`, or turn back to it from a running change.
    """
    v = w.vehicles
    if j == 0:
        return 1.0 if av_lane == lane else 0.0
    looks = 1.0 - looks_away_chance(v, j, road, tables.memory)
    if v[j].duration > 0.0:
        back = lane_of(v[j].y, road.lane_width) == lane
        return looks * return_chance(w, j, tables.overlook, road, tables) if back else 0.0
    left, right = _wishes(w, j, _leads(w, j, road), tables.overlook, road, tables)
    return looks * (left if lane > v[j].target_lane else right)


@inlined_kernel
def _may_start(v: NDArray[np.void], j: int, lane: int, av_lane: int) -> bool:
    """Can vehicle j start into `lane` at this moment? Only its target lane is looked at."""
    if v[j].present == 0 or v[j].target_lane == lane:
        return False
    may: bool = av_lane == lane if j == 0 else abs(v[j].target_lane - lane) == 1
    return may


@inlined_kernel
def _somebody_may_start(w: World, i: int, lane: int, av_lane: int, tables: NddTables) -> bool:
    """Can a vehicle that slot i does not accept for sure start into `lane`? Mostly none can; that saves the sum."""
    v = w.vehicles
    for j in range(w.state[0].n_vehicles):
        dx = ahead_by(v, i, j)
        if dx < 0.0 or dx >= SIGHT or (dx == 0.0 and j <= i) or not _may_start(v, j, lane, av_lane):
            continue
        if accept_chance(tables.lc_accept, 0, gap(v, i, j), v[j].speed - v[i].speed) < 1.0:
            return True
    return False


@inlined_kernel
def _find_starters(
    w: World, i: int, lane: int, av_lane: int, road: RoadNumbers, tables: NddTables, c: StarterScratch
) -> int:
    """Number the vehicles that can keep slot i from starting into `lane`, directly or through others; return how many.

    Slot i is number 0 and counts. The walk goes from it to the front. A vehicle matters if it may start into `lane`,
    and if slot i, or a vehicle numbered before that gives way itself, does not accept it for sure.
    """
    v = w.vehicles
    order = w.order
    sort_by_x(w)
    rank = 0
    while order[rank] != i:
        rank += 1
    c.slot[0] = i
    n = 1
    for ahead in range(rank + 1, w.state[0].n_vehicles):
        j = order[ahead]
        if v[j].present == 0:
            continue
        if ahead_by(v, c.slot[n - 1], j) >= SIGHT:
            break
        if not _may_start(v, j, lane, av_lane):
            continue
        if n == MAX_STARTERS:
            c.left_out[0] += 1
            break
        matters = False
        for k in range(n):
            m = c.slot[k]
            dx = ahead_by(v, m, j)
            accepts = 1.0
            if dx < SIGHT and (k == 0 or (m > 0 and v[m].duration == 0.0)):
                accepts = accept_chance(tables.lc_accept, 0, gap(v, m, j), v[j].speed - v[m].speed)
            c.accepts[k, n] = accepts
            matters = matters or accepts < 1.0
        if matters:
            wants = _start_chance(w, j, lane, av_lane, road, tables)
            if wants > 0.0:
                c.slot[n] = j
                c.wants[n] = wants
                n += 1
    return n


@inlined_kernel
def _least_accepted(c: StarterScratch, k: int, starters: int, n: int) -> float:
    """Compute P(driver number k, if attentive, accepts the worst of a set of starters ahead of it); 1 for none."""
    least = 1.0
    for m in range(k + 1, n):
        if starters & (1 << m):
            least = min(least, c.accepts[k, m])
    return least


@inlined_kernel
def _that_matter(c: StarterScratch, starters: int, undecided: int, n: int) -> int:
    """Reduce a set of starters to the members that matter to drivers 0 .. undecided - 1.

    A member is dropped if each of these drivers accepts some other member no more easily. The drivers do the same
    without it, and sets that become equal count as one.
    """
    kept = 0
    for m in range(undecided, n):
        if starters & (1 << m):
            for k in range(undecided):
                if c.accepts[k, m] < _least_accepted(c, k, kept, n):
                    kept |= 1 << m
                    break
    return kept


@inlined_kernel
def _add_set(c: StarterScratch, row: int, count: int, starters: int, chance: float) -> int:
    """Add a set's probability to list `row`, which holds `count` sets; return how many it holds then."""
    for s in range(count):
        if c.sets[row, s] == starters:
            c.chances[row, s] += chance
            return count
    if count == MAX_SETS:
        c.left_out[0] += 1
        c.chances[row, count - 1] += chance
        return count
    c.sets[row, count] = starters
    c.chances[row, count] = chance
    return count + 1


@inlined_kernel
def _goes_chance(
    w: World, i: int, lane: int, overlook_conflict: float, av_lane: int, road: RoadNumbers, tables: NddTables,
    c: StarterScratch,
) -> float:  # fmt: skip
    """Compute P(slot i, which wants to change to `lane`, does not give way); `overlook_conflict` is its own.

    From the front to the rear, each vehicle that matters starts or not, given which vehicles ahead of it start; the
    probabilities of all sets of starters are carried along. Sets that make no difference to the vehicles behind count
    as one, so there are about as many sets as vehicles: for a platoon of 20 about 20 sets, not 2^20.
    """
    n = _find_starters(w, i, lane, av_lane, road, tables, c)
    row = 0
    c.sets[0, 0] = 0
    c.chances[0, 0] = 1.0
    n_sets = 1
    for m in range(n - 1, 0, -1):
        count = 0
        for s in range(n_sets):
            starters = c.sets[row, s]
            starts = c.wants[m] * _go_chance(_least_accepted(c, m, starters, n), tables.overlook_conflict)
            if starts < 1.0:
                stays = _that_matter(c, starters, m, n)
                count = _add_set(c, 1 - row, count, stays, c.chances[row, s] * (1.0 - starts))
            if starts > 0.0:
                more = _that_matter(c, starters | (1 << m), m, n)
                count = _add_set(c, 1 - row, count, more, c.chances[row, s] * starts)
        n_sets = count
        row = 1 - row
    chance = 0.0
    for s in range(n_sets):
        chance += c.chances[row, s] * _go_chance(_least_accepted(c, 0, c.sets[row, s], n), overlook_conflict)
    return min(chance, 1.0)


@kernel
def action_probabilities(
    w: World, i: int, attentive: bool, av_lane: int, road: RoadNumbers, tables: NddTables, c: StarterScratch,
    p: NDArray[np.float64],
) -> None:  # fmt: skip
    """Compute P(action | state) of BV i under the naturalistic model, if all other BVs drive naturally; the sum is 1.

    `decide_bvs` draws the action with this probability. Giving way to simultaneous lane changes is included: a driver
    that gives way takes the acceleration that it would have taken without the wish to change.

    Args:
        w: The world at the moment of the decision; its `order` is sorted.
        i: Slot of the BV.
        attentive: It neither looks away nor overlooks a neighbour or a vehicle that starts at the same moment. The
            other drivers do as the model says.
        av_lane: The target lane that the AV has chosen at this moment; its present one where the AV begins no change,
            or where its choice cannot be known; ALONE: see there.
        road, tables: Constants.
        c: Scratch.
        p: Where the probabilities go, float64 (33,).
    """
    if at_site(road.site):
        look_around(w, i, road.site)
        natural_choice(w, i, road.site, p)
        return
    v = w.vehicles
    if road.stops:
        sort_by_x(w)
    overlook = 0.0 if attentive else tables.overlook
    overlook_conflict = 0.0 if attentive else tables.overlook_conflict
    leads = _leads(w, i, road)
    for a in range(N_ACTIONS):
        p[a] = 0.0
    low = 0.0
    while low < 1.0:  # the rounding of range rates is uniform in (0, 1); between two limits the rows stay the same
        high = min(
            _rounding_limit(v, i, leads[0], low),
            min(_rounding_limit(v, i, leads[1], low), _rounding_limit(v, i, leads[2], low)),
        )
        _add_cumulative(v, i, leads, 0.5 * (low + high), high - low, road, tables, p)
        low = high
    if v[i].duration == 0.0:
        lane = v[i].target_lane
        left, right = _wishes(w, i, leads, overlook, road, tables)
        p[ACTION_LEFT] = left
        p[ACTION_RIGHT] = right
        if left > 0.0 and av_lane != ALONE and _somebody_may_start(w, i, lane + 1, av_lane, tables):
            p[ACTION_LEFT] = left * _goes_chance(w, i, lane + 1, overlook_conflict, av_lane, road, tables, c)
        if right > 0.0 and av_lane != ALONE and _somebody_may_start(w, i, lane - 1, av_lane, tables):
            p[ACTION_RIGHT] = right * _goes_chance(w, i, lane - 1, overlook_conflict, av_lane, road, tables, c)
    else:
        back = ACTION_LEFT if lane_of(v[i].y, road.lane_width) > v[i].target_lane else ACTION_RIGHT
        p[back] = return_chance(w, i, overlook, road, tables)
    if road.limited:
        hardest, strongest = possible_actions(w, i, road)
        for a in range(FIRST_ACCELERATION, hardest):
            p[a] = 0.0
        for a in range(strongest, N_ACTIONS - 1):
            p[a] = p[N_ACTIONS - 1]
    keep = (1.0 - p[ACTION_LEFT] - p[ACTION_RIGHT]) / p[N_ACTIONS - 1]
    for a in range(N_ACTIONS - 1, FIRST_ACCELERATION, -1):
        p[a] = keep * (p[a] - p[a - 1])
    p[FIRST_ACCELERATION] = keep * p[FIRST_ACCELERATION]
    away = 0.0 if attentive else looks_away_chance(v, i, road, tables.memory)
    if away > 0.0:
        for a in range(N_ACTIONS):
            p[a] *= 1.0 - away
        p[ACTION_HOLD] += away
