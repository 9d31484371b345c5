"""Acts of BVs near the AV that would endanger it in the coming second, how likely, and how dangerous each is.

An *act* is a thing that happens or not: a BV begins to change lanes, turns back or goes on in a lane change, or its
driver looks away; at a site, it goes where it has to choose. Its chance is that with which `decide_bvs`, or
`decide_at_site`, draws it, an exact count of random words (`sim.steering`). Acts of one random word form a *group*, of
which at most one happens; the other words are the group's rest. Groups are independent of each other.

Nothing here changes how a vehicle drives. `splitting` and `tilt` use it to find out where copies of a world are worth
driving.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.rates.branching.at_site import note_agent
from cornerforge.rates.branching.danger import (
    N_SEEN,
    REACH,
    WIDTH,
    Ahead,
    Intent,
    add_ahead,
    danger,
    look_ahead,
    look_at,
)
from cornerforge.road.straight import ahead_by, lane_of
from cornerforge.sim import braking, chances, neighbours, steering
from cornerforge.site.tables import at_site

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.rates.branching.danger import Network
    from cornerforge.sim import Setting, World

__all__ = [
    "BEGINS", "GOES_ON", "LOOKS_AWAY", "MOST_ACTS", "TURNS_BACK", "TWO", "Survey", "allocate_survey", "begins_ahead",
    "chance_of", "intent_now", "intent_of", "last_of", "list_acts", "list_pairs", "look_around",
]  # fmt: skip

LOOKS_AWAY, BEGINS, TURNS_BACK, GOES_ON, TWO = range(1, 6)
"""Kinds of acts. TWO stands for two acts in one second."""
MOST_NEAR = 40
"""Largest number of BVs near the AV that are looked at; further ones are left to chance."""
MOST_ACTS = 60
"""Largest number of acts listed in one second; further ones are left to chance."""
_PER_WORD = 1.0 / steering.ALL_WORDS
_RARE_WORDS = steering.ALL_WORDS // 20
"""At a site a likelier act is left to nature: agents choose again each second, and trees would branch without end."""
_ACTS_OF_ONE = 3
_PAIRS_RISE = 2.0
_NEAR_BEHIND = 2.0  # 40 m, as `danger.look_at` writes gaps

NEAR = np.dtype(
    [
        ("slot", "i8"),
        ("lane", "i8"),
        ("old_lane", "i8"),
        ("low", "i8"),
        ("high", "i8"),
        ("left", "f8"),
        ("away", "f8"),
        ("toward", "f8"),
        ("danger", "f8"),
    ]
)
"""A BV near the AV. lane: its target lane; old_lane: the lane to which it may turn back, -1 for none; low, high: of its
words about lanes those below `low` begin a change left, those up to `high` one right; in a lane change those below
`low` turn back; left: rest of its lane change [s]; away: chance that it looks away; toward: chance that it moves
towards the AV's lane; danger: `danger.danger` of it."""

ACT = np.dtype(
    [
        ("slot", "i8"),
        ("near", "i8"),
        ("kind", "i8"),
        ("word", "i8"),
        ("first", "i8"),
        ("count", "i8"),
        ("is_last", "i8"),
        ("rest_first", "i8"),
        ("rest_count", "i8"),
        ("lane", "i8"),
        ("left", "f8"),
        ("danger", "f8"),
    ]
)
"""An act. slot, near: of which BV, and its place in `Survey.near`; word: LANE or AWAY; first, count: the random words
with which it happens; is_last: 1 for the last act of its group, which has rest_first and rest_count, the words with
which none of the group happens; lane, left: target lane and rest of the lane change [s] once it is known that it
happens; danger: of all BVs together then."""


class Choice(NamedTuple):
    """Acts of a near BV: its place in `Survey.near`, and fields of ACT; words: its count."""

    near: int
    kind: int
    word: int
    first: int
    words: int
    lane: int
    left: float


class Survey(NamedTuple):
    """Surroundings of the AV at the begin of a second.

    Attributes:
        near: BVs near the AV, of NEAR; seen: what is seen of each, float32 (MOST_NEAR, N_SEEN).
        acts: What they may do, of ACT.
        pairs: Danger of all BVs together if acts k < m both happen, float64 (MOST_ACTS, MOST_ACTS); 0: not looked at.
        n_near, n_acts, n_left_out: How many there are, and how many acts found no room so far, int64 (1,).
        follower: Place in `near` of the next BV behind the AV in its lanes, -1 for none, int64 (1,).
        soon: Mean rise of the danger within a second, float64 (1,).
        look, layers: Scratch.
    """

    near: NDArray[np.void]
    seen: NDArray[np.float32]
    acts: NDArray[np.void]
    pairs: NDArray[np.float64]
    n_near: NDArray[np.int64]
    n_acts: NDArray[np.int64]
    n_left_out: NDArray[np.int64]
    follower: NDArray[np.int64]
    soon: NDArray[np.float64]
    look: NDArray[np.float32]
    layers: NDArray[np.float32]


def allocate_survey() -> Survey:
    """Allocate a survey."""
    return Survey(
        near=np.zeros(MOST_NEAR, dtype=NEAR),
        seen=np.zeros((MOST_NEAR, N_SEEN), dtype=np.float32),
        acts=np.zeros(MOST_ACTS, dtype=ACT),
        pairs=np.zeros((MOST_ACTS, MOST_ACTS)),
        n_near=np.zeros(1, dtype=np.int64),
        n_acts=np.zeros(1, dtype=np.int64),
        n_left_out=np.zeros(1, dtype=np.int64),
        follower=np.zeros(1, dtype=np.int64),
        soon=np.zeros(1),
        look=np.zeros(N_SEEN, dtype=np.float32),
        layers=np.zeros((2, WIDTH), dtype=np.float32),
    )


# Which BVs are near


@inlined_kernel
def _note_words(w: World, i: int, setting: Setting, near: Any) -> None:
    """Note with which words BV i begins a lane change, or turns back in its own, and what that means for the AV."""
    v = w.vehicles
    road, tables = setting.road, setting.tables
    av_lane = v[0].target_lane
    near.old_lane = -1
    near.low = 0
    near.high = 0
    near.left = 0.0
    near.toward = 0.0
    if v[i].duration == 0.0:
        left, right = chances.lane_wishes(w, i, road, tables)
        near.low = steering.words_below(left)
        near.high = steering.words_below(left + right)
        if av_lane > near.lane:
            near.toward = left
        elif av_lane < near.lane:
            near.toward = right
        return
    near.left = v[i].duration - v[i].clock
    old = lane_of(v[i].y, road.lane_width)
    if old == near.lane:
        near.toward = 1.0 if near.lane == av_lane else 0.0
        return
    back = chances.return_chance(w, i, tables.overlook, road, tables)
    near.old_lane = old
    near.low = steering.words_below(back)
    near.toward = 1.0 - back if abs(near.lane - av_lane) < abs(old - av_lane) else back


@kernel
def _look_at_site(w: World, setting: Setting, network: Network, s: Survey) -> float:
    """Note all agents that meet the AV soon and how dangerous each is; return their dangers together."""
    total, n = 0.0, 0
    s.follower[0] = -1
    nothing = Ahead(0.0, 10.0)
    for k in range(w.state[0].n_current):
        i = w.current[k]
        if i == 0 or n == MOST_NEAR or not note_agent(w, i, setting.road.site, s.near[n]):
            continue
        near = s.near[n]
        look_at(w, i, intent_now(near), near.away, nothing, setting.road, s.seen[n])
        near.danger = danger(network, s.seen[n], s.layers)
        total += near.danger
        n += 1
    s.n_near[0] = n
    return total


@kernel
def look_around(w: World, setting: Setting, network: Network, s: Survey) -> tuple[float, Ahead]:
    """Note all BVs near the AV and how dangerous each is.

    Returns:
        Their dangers together; what is ahead of the AV.
    """
    if at_site(setting.road.site):
        return _look_at_site(w, setting, network, s), Ahead(0.0, 10.0)
    v = w.vehicles
    neighbours.sort_by_x(w)
    ahead = look_ahead(w)
    total = 0.0
    n = 0
    nearest = -np.inf
    s.follower[0] = -1
    for i in range(1, w.state[0].n_vehicles):
        dx = ahead_by(v, 0, i)
        if v[i].present == 0 or abs(dx) >= REACH or n == MOST_NEAR:
            continue
        if abs(v[i].target_lane - v[0].target_lane) > 1 and abs(dx) > 0.5 * REACH:
            continue
        near = s.near[n]
        near.slot = i
        near.lane = v[i].target_lane
        near.away = braking.looks_away_chance(v, i, setting.road, setting.tables.memory)
        _note_words(w, i, setting, near)
        look_at(w, i, intent_now(near), near.away, ahead, setting.road, s.seen[n])
        near.danger = danger(network, s.seen[n], s.layers)
        total += near.danger
        if v[i].lanes & v[0].lanes and nearest < dx < 0.0:
            nearest = dx
            s.follower[0] = n
        n += 1
    s.n_near[0] = n
    return total, ahead


# What they may do


@inlined_kernel
def intent_now(near: Any) -> Intent:
    """Say what is known of a near BV before it decides."""
    return Intent(near.lane, near.left, 0.0, near.toward)


@inlined_kernel
def intent_of(act: Any, s: Survey) -> Intent:
    """Say what is known of a BV once it is known that an act of its happens."""
    if act.kind == LOOKS_AWAY:
        near = s.near[act.near]
        return Intent(act.lane, act.left, 1.0, near.toward if near.left > 0.0 else 0.0)
    return Intent(act.lane, act.left, 0.0 if act.kind == GOES_ON else -1.0, 1.0)


@inlined_kernel
def begins_ahead(w: World, act: Any) -> bool:
    """Does an act bring a BV from ahead into the AV's lanes?"""
    v = w.vehicles
    enters = v[act.slot].lanes & v[0].lanes == 0 and (1 << act.lane) & v[0].lanes != 0
    begins: bool = enters and ahead_by(v, 0, act.slot) > 0.0
    return begins


@inlined_kernel
def _danger_if(
    w: World, near: int, intent: Intent, ahead: Ahead, setting: Setting, network: Network, s: Survey
) -> float:
    """Compute the danger of a near BV that does as `intent` says."""
    look_at(w, s.near[near].slot, intent, s.near[near].away, ahead, setting.road, s.look)
    return danger(network, s.look, s.layers)


@inlined_kernel
def _minds_what_is_ahead(seen: NDArray[np.float32]) -> bool:
    """Is a BV behind the AV, in its lane or the next one, near enough that the AV's braking may endanger both?"""
    minds: bool = seen[2] < 0.0 and seen[0] < _NEAR_BEHIND and seen[7] + seen[8] > 0.0
    return minds


@inlined_kernel
def _add_act(
    w: World, choice: Choice, total: float, ahead: Ahead, setting: Setting, network: Network, s: Survey
) -> float:
    """Put an act behind the last listed one, without counting it yet; return its chance times the danger it adds."""
    near = choice.near
    act = s.acts[s.n_acts[0]]
    act.slot = s.near[near].slot
    act.near = near
    act.kind = choice.kind
    act.word = choice.word
    act.first = choice.first
    act.count = choice.words
    act.is_last = 0
    act.lane = choice.lane
    act.left = choice.left
    act.danger = total - s.near[near].danger + _danger_if(w, near, intent_of(act, s), ahead, setting, network, s)
    if begins_ahead(w, act):
        more = add_ahead(w, act.slot, ahead)
        for m in range(s.n_near[0]):
            if m != near and _minds_what_is_ahead(s.seen[m]):
                act.danger += _danger_if(w, m, intent_now(s.near[m]), more, setting, network, s) - s.near[m].danger
    rise: float = max(0.0, act.danger - total) * act.count * _PER_WORD
    return rise


@inlined_kernel
def _is_pair(w: World, front: Any, rear: Any) -> bool:
    """Does `front` bring a BV in ahead of the AV, and make what `rear`, of another BV behind the AV, does dangerous?

    That one begins a change into the AV's lanes, or its driver, in the AV's lanes or coming there, looks away.
    """
    v = w.vehicles
    if (
        front.kind != BEGINS
        or front.slot == rear.slot
        or ahead_by(v, 0, rear.slot) >= 0.0
        or not begins_ahead(w, front)
    ):
        return False
    comes: bool = (rear.kind == BEGINS or rear.kind == LOOKS_AWAY) and (1 << rear.lane) & v[0].lanes != 0
    return comes


@inlined_kernel
def _danger_of_pair(
    w: World, front: Any, rear: Any, ahead: Ahead, setting: Setting, network: Network, s: Survey
) -> float:
    """Compute the danger of all BVs together if both acts of a pair happen."""
    more = add_ahead(w, front.slot, ahead)
    then = _danger_if(w, rear.near, intent_of(rear, s), more, setting, network, s)
    pair: float = front.danger + max(0.0, then - s.near[rear.near].danger)
    return pair


@kernel
def _is_listed(w: World, least: float, ahead: Ahead, setting: Setting, network: Network, s: Survey) -> bool:
    """Is the act behind the last listed one dangerous enough, alone or in a pair with a listed one?"""
    act = s.acts[s.n_acts[0]]
    if act.danger > least:
        return True
    for m in range(s.n_acts[0]):
        rear = s.acts[m]
        much = _PAIRS_RISE * max(rear.danger, least)
        if _is_pair(w, act, rear) and _danger_of_pair(w, act, rear, ahead, setting, network, s) > much:
            return True
    return False


@inlined_kernel
def _close_group(s: Survey, first: int, count: int) -> None:
    """Make the act behind the last listed one the last of its group, and count it; `first`, `count`: the rest."""
    act = s.acts[s.n_acts[0]]
    act.is_last = 1
    act.rest_first = first
    act.rest_count = count
    s.n_acts[0] += 1


@inlined_kernel
def _list_act(
    w: World, choice: Choice, total: float, least: float, ahead: Ahead, setting: Setting, network: Network, s: Survey
) -> float:
    """List an act that is alone in its group, of the first random words, if it is dangerous enough.

    Returns:
        Its chance times the danger it adds.
    """
    rise = _add_act(w, choice, total, ahead, setting, network, s)
    if _is_listed(w, least, ahead, setting, network, s):
        _close_group(s, choice.words, steering.ALL_WORDS - choice.words)
    return rise


@kernel
def _list_acts_at_site(
    w: World,
    n: int,
    total: float,
    least: float,
    ahead: Ahead,
    setting: Setting,
    network: Network,
    s: Survey,
) -> float:
    """List what the n-th near agent of a site may do: go, where it seldom does, and look away.

    Returns:
        Their chances times the dangers they add.
    """
    soon = 0.0
    near = s.near[n]
    away = steering.words_below(near.away)
    if 0 < near.low < _RARE_WORDS:
        goes = Choice(n, GOES_ON, steering.LANE, 0, near.low, near.lane, near.left)
        soon += _list_act(w, goes, total, least, ahead, setting, network, s)
    if 0 < away < _RARE_WORDS:
        looks = Choice(n, LOOKS_AWAY, steering.AWAY, 0, away, near.lane, near.left)
        soon += _list_act(w, looks, total, least, ahead, setting, network, s)
    return soon


@kernel
def list_acts(
    w: World, total: float, least: float, ahead: Ahead, setting: Setting, network: Network, s: Survey
) -> None:
    """List what near BVs may do in the coming second that would raise the danger of all together above `least`.

    What brings a BV in ahead of the AV is listed too where it at least doubles the danger of an act behind the AV;
    so BVs behind come first. What is left out is drawn as nature does, and so is what happens for sure. Call
    `look_around` first; `total` and `ahead` are what it returned.
    """
    s.n_acts[0] = 0
    soon = 0.0
    for turn in range(2 * s.n_near[0]):
        n = turn % s.n_near[0]
        is_ahead = s.seen[n, 2] > 0.0
        if is_ahead != (turn >= s.n_near[0]):
            continue
        if s.n_acts[0] > MOST_ACTS - _ACTS_OF_ONE:
            s.n_left_out[0] += 1
            break
        near = s.near[n]
        time = w.vehicles[near.slot].change_time
        away = steering.words_below(near.away)
        if at_site(setting.road.site):
            soon += _list_acts_at_site(w, n, total, least, ahead, setting, network, s)
            continue
        if 0 < away < steering.ALL_WORDS:
            looks = Choice(n, LOOKS_AWAY, steering.AWAY, 0, away, near.lane, near.left)
            soon += _list_act(w, looks, total, least, ahead, setting, network, s)
        if near.left == 0.0 and near.high < steering.ALL_WORDS:
            left_listed = False
            if near.low > 0:
                choice = Choice(n, BEGINS, steering.LANE, 0, near.low, near.lane + 1, time)
                soon += _add_act(w, choice, total, ahead, setting, network, s)
                left_listed = _is_listed(w, least, ahead, setting, network, s)
            if near.high > near.low:  # the rest of both groups must be one stretch of words: with the right the left
                s.n_acts[0] += 1 if near.low > 0 else 0
                choice = Choice(n, BEGINS, steering.LANE, near.low, near.high - near.low, near.lane - 1, time)
                soon += _add_act(w, choice, total, ahead, setting, network, s)
                if _is_listed(w, least, ahead, setting, network, s):
                    _close_group(s, near.high, steering.ALL_WORDS - near.high)
                    continue
                s.n_acts[0] -= 1 if near.low > 0 else 0
            if left_listed:
                _close_group(s, near.low, steering.ALL_WORDS - near.low)
        elif near.left > 0.0 and 0 < near.low < steering.ALL_WORDS:
            if 2 * near.low < steering.ALL_WORDS:
                choice = Choice(n, TURNS_BACK, steering.LANE, 0, near.low, near.old_lane, time)
                soon += _add_act(w, choice, total, ahead, setting, network, s)
                rest = (near.low, steering.ALL_WORDS - near.low)
            else:
                choice = Choice(
                    n, GOES_ON, steering.LANE, near.low, steering.ALL_WORDS - near.low, near.lane, near.left
                )
                soon += _add_act(w, choice, total, ahead, setting, network, s)
                rest = (0, near.low)
            if _is_listed(w, least, ahead, setting, network, s):
                _close_group(s, rest[0], rest[1])
    s.soon[0] = soon


@kernel
def list_pairs(w: World, ahead: Ahead, setting: Setting, network: Network, s: Survey) -> None:
    """Note how dangerous two acts of one second are that make a pair (`_is_pair`)."""
    n = s.n_acts[0]
    for k in range(n):
        for m in range(k + 1, n):
            s.pairs[k, m] = 0.0
            if _is_pair(w, s.acts[k], s.acts[m]):
                s.pairs[k, m] = _danger_of_pair(w, s.acts[k], s.acts[m], ahead, setting, network, s)
            elif _is_pair(w, s.acts[m], s.acts[k]):
                s.pairs[k, m] = _danger_of_pair(w, s.acts[m], s.acts[k], ahead, setting, network, s)


@inlined_kernel
def last_of(k: int, s: Survey) -> int:
    """Find the last act of the group of act k."""
    while s.acts[k].is_last == 0:
        k += 1
    return k


@inlined_kernel
def chance_of(words: int) -> float:
    """Compute the chance of a number of random words."""
    return words * _PER_WORD
