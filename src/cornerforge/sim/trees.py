"""Trees of tests: worlds are copied where something dangerous may happen, and weighted so that every mean stays true.

A tree grows from one test. At the begin of each second

1. the *window* looks at weight times danger: a world that is worth little is dropped with a chance and else gets more
   weight (roulette); one that is worth much is copied, and the copies share its weight (splitting);
2. for every act on the list (`acts`) a copy is made in which it happens, with the weight times the act's chance, if
   roulette lets it; the world itself goes on without any of them, with the weight times the chance of that.

Each step leaves the expected weight of every future what it was, whatever the danger is taken to be. So the weights of
the crashes of a tree sum up to a number whose mean is the crash rate per test (Booth and Hendricks 1984 call this
weight windows; for exactness see docs/adr/0030-natural-rates.md). Only its variance depends on the network.

All random numbers are functions of seed, test, and what happened in the tree before, so a tree grows alike everywhere.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import PURPOSE_ROULETTE, block, uniform
from cornerforge.sim.acts import (
    BEGINS,
    TWO,
    Survey,
    allocate_survey,
    chance_of,
    last_of,
    list_acts,
    list_pairs,
    look_around,
)
from cornerforge.sim.danger import Network
from cornerforge.sim.lessons import NO_MOMENT, Lessons, crashed, note_act, note_moment
from cornerforge.sim.loop import AV_MUST_ANSWER, advance
from cornerforge.sim.steering import Steering, hold_to, let_go
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import AV_CRASH, MAX_BRANCH, RUNNING, World, allocate_worlds, world_row
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from cornerforge.sim.danger import Ahead
    from cornerforge.sim.keep import Keep
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting

__all__ = [
    "LEAF",
    "ROOT",
    "Forest",
    "Leaves",
    "Nursery",
    "Plan",
    "allocate_leaves",
    "allocate_nursery",
    "branch_out",
    "drive_on",
    "grow_range",
    "plant",
]

ROOT = np.dtype(
    [("weight", "f8"), ("ended", "f8"), ("danger", "f8"), ("crashes", "i8"), ("seconds", "i8"), ("lost", "i8")]
)
"""A whole tree. weight: sum over its crashes, the estimate of the chance of a crash; ended: sum over all its ends, of
mean 1; danger: at its start; crashes: how many; seconds: world-seconds driven; lost: copies or acts for which there was
no room: must be 0."""

LEAF = np.dtype(
    [
        ("root", "i8"),
        ("weight", "f8"),
        ("time", "f8"),
        ("partner", "i8"),
        ("acts", "i8"),
        ("begun", "i8"),
        ("memory", "i8"),
    ]
)
"""A crash at the end of a branch. root: its test; weight; time into the test [s]; partner: slot; acts: the kinds of
the acts that led there, as decimal digits; begun: decisions taken; memory: as of `Nursery`."""

MOST_COPIES = 10
"""A window makes at most so many copies of a world in a second."""
_ROULETTE_BELOW, _SPLIT_ABOVE, _SEVERAL_ABOVE = 0.5, 2.0, 1.5
_MOST_DIGITS = 10**15
_EXPLORED_DEPTH = 100
_SECONDS, _LOST, _BRANCHES, _DRAWS = range(4)


class Plan(NamedTuple):
    """How a tree grows.

    Attributes:
        target: What weight times danger should be; the smaller, the more is driven.
        floor: Least danger of a world: no world is dropped with a larger chance than its weight times this over
            `target`.
        least_rise: An act is listed if it raises the danger by more than this share.
        explore: Largest chance with which an act is followed that does not look dangerous.
        windows: 0: no windows and no roulette but for acts: to learn.
        forget: A world's danger falls at most by this factor in a second: if the network misjudges a world that was
            dangerous just now, roulette does not make its weight large at once.
        look_ahead: For how many seconds the mean rise of the danger by acts counts as danger [s].
        network: Of the danger.
    """

    target: float
    floor: float
    least_rise: float
    explore: float
    windows: int
    forget: float
    look_ahead: float
    network: Network


class Leaves(NamedTuple):
    """Crashes found; with no room none is noted.

    Attributes:
        crashes: (K,) of LEAF.
        actions: Actions of all vehicles at each decision, int8 (K, decisions, N): with the test's start they give the
            crash again (`scripted`).
        used: How many there are, int64 (1,).
    """

    crashes: NDArray[np.void]
    actions: NDArray[np.int8]
    used: NDArray[np.int64]


class Nursery(NamedTuple):
    """Worlds of trees that grow side by side, T trees of a stack of R / T rows each, and what is known of each world.

    Attributes:
        depth: Rows of a tree: tree t has those from t * depth on.
        worlds: A batch of R worlds.
        weight: Of each, (R,).
        danger: Of each a second ago, (R,).
        moment: When it was last noted (`lessons`), int64 (R,).
        acts: Acts that led there, as `LEAF.acts`, int64 (R,).
        actions: Actions so far, int8 (R, decisions, N).
        waits: 1 if it must be driven a second on before it is looked at again, int64 (R,).
        steering: To what it is held in that second, (R, ...); of no meaning where it does not wait.
        memory: For a driver of AVs outside: what its AV remembers, -1 for nothing, int64 (R,).
        top: Rows in use of each tree, int64 (T,).
        tally: Seconds driven, copies lost, branches and roulette draws of each tree, int64 (T, 4).
        survey: What is around the AV.
    """

    depth: int
    worlds: World
    weight: NDArray[np.float64]
    danger: NDArray[np.float64]
    moment: NDArray[np.int64]
    acts: NDArray[np.int64]
    actions: NDArray[np.int8]
    waits: NDArray[np.int64]
    steering: Steering
    memory: NDArray[np.int64]
    top: NDArray[np.int64]
    tally: NDArray[np.int64]
    survey: Survey


class Forest(NamedTuple):
    """All that trees are grown with.

    Attributes:
        plan: How they grow.
        setting: The run: an AV of the kernels, naturalistic BVs, no adversary.
        scratch, keep: Scratch; keep nothing.
        nursery: Room for worlds.
        leaves, lessons: What is found.
    """

    plan: Plan
    setting: Setting
    scratch: Scratch
    keep: Keep
    nursery: Nursery
    leaves: Leaves
    lessons: Lessons


def allocate_nursery(depth: int, slots: int, decisions: int, places: int = 1) -> Nursery:
    """Allocate room for `places` trees of `depth` worlds each, of `slots` vehicles; it takes memory when it is used."""
    rows = places * depth
    return Nursery(
        depth=depth,
        worlds=allocate_worlds(rows, slots),
        weight=np.zeros(rows),
        danger=np.zeros(rows),
        moment=np.zeros(rows, dtype=np.int64),
        acts=np.zeros(rows, dtype=np.int64),
        actions=np.zeros((rows, decisions, slots), dtype=np.int8),
        waits=np.zeros(rows, dtype=np.int64),
        steering=Steering(
            np.zeros((rows, 1), dtype=np.int64),
            np.zeros((rows, 2, slots), dtype=np.uint64),
            np.zeros((rows, 2, slots), dtype=np.uint64),
        ),
        memory=np.zeros(rows, dtype=np.int64),
        top=np.zeros(places, dtype=np.int64),
        tally=np.zeros((places, 4), dtype=np.int64),
        survey=allocate_survey(),
    )


def allocate_leaves(crashes: int, slots: int, decisions: int) -> Leaves:
    """Allocate room for so many crashes."""
    return Leaves(
        np.zeros(crashes, dtype=LEAF),
        np.zeros((crashes, decisions, slots), dtype=np.int8),
        np.zeros(1, dtype=np.int64),
    )


@inlined_kernel
def _draw(row: int, nursery: Nursery) -> float:
    """Draw a number in (0, 1) for roulette."""
    state = nursery.worlds.state[row, 0]
    tally = nursery.tally[row // nursery.depth]
    tally[_DRAWS] += 1
    return uniform(block(state.seed, state.test, tally[_DRAWS], 0, PURPOSE_ROULETTE)[0])


@inlined_kernel
def _room(row: int, top: int, nursery: Nursery) -> int:
    """Count for how many more copies the tree of a row has room, and a branch with random words of its own."""
    place = row // nursery.depth
    room: int = min((place + 1) * nursery.depth - top, MAX_BRANCH - nursery.tally[place, _BRANCHES])
    return room


@inlined_kernel
def _steering_of(row: int, nursery: Nursery) -> Steering:
    """To what a row is held in the second that it waits for."""
    held = nursery.steering
    return Steering(held.on[row], held.first[row], held.words[row])


@inlined_kernel
def _copies(worth: float) -> int:
    """Say how many copies a world is worth."""
    return math.floor(min(worth, MOST_COPIES) + 0.5)


@kernel
def _copy(nursery: Nursery, a: int, b: int) -> None:
    """Copy row a to row b, at the begin of a second, and give the copy a future of its own."""
    worlds = nursery.worlds
    n = worlds.state[a, 0].n_vehicles
    worlds.state[b, 0] = worlds.state[a, 0]
    for i in range(n):
        worlds.vehicles[b, i] = worlds.vehicles[a, i]
        worlds.order[b, i] = worlds.order[a, i]
        worlds.current[b, i] = worlds.current[a, i]
    for lane in range(worlds.av_lead.shape[1]):
        worlds.av_lead[b, lane] = worlds.av_lead[a, lane]
        worlds.av_rear[b, lane] = worlds.av_rear[a, lane]
    for second in range(worlds.state[a, 0].decisions):
        for i in range(n):
            nursery.actions[b, second, i] = nursery.actions[a, second, i]
    nursery.weight[b] = nursery.weight[a]
    nursery.danger[b] = nursery.danger[a]
    nursery.moment[b] = nursery.moment[a]
    nursery.acts[b] = nursery.acts[a]
    nursery.waits[b] = 0
    nursery.memory[b] = nursery.memory[a]
    tally = nursery.tally[b // nursery.depth]
    tally[_BRANCHES] += 1
    worlds.state[b, 0].branch = tally[_BRANCHES]


@inlined_kernel
def _wait(row: int, nursery: Nursery) -> Steering:
    """Let a row wait for its next second, held to nothing; returns its steering, to hold it to something."""
    nursery.waits[row] = 1
    steering = _steering_of(row, nursery)
    let_go(steering, nursery.worlds.state[row, 0].n_vehicles)
    return steering


@inlined_kernel
def _take_over(source: Steering, steering: Steering, slots: int) -> None:
    """Hold the first `slots` slots to what `source` holds them to."""
    steering.on[0] = source.on[0]
    if source.on[0]:
        for what in range(2):
            for i in range(slots):
                steering.first[what, i] = source.first[what, i]
                steering.words[what, i] = source.words[what, i]


@kernel
def drive_on(row: int, forest: Forest) -> int:
    """Drive a row that waits to the end of its second, or until its AV outside must answer.

    Returns:
        As `loop.advance`: MILESTONE or OVER, and then the row does not wait any more; or AV_MUST_ANSWER.
    """
    nursery, steering = forest.nursery, forest.scratch.steering
    w = world_row(nursery.worlds, row)
    state = w.state[0]
    until = state.decisions + 1 if state.substep == 0 else state.decisions
    _take_over(_steering_of(row, nursery), steering, state.n_vehicles)
    why = advance(w, forest.setting, forest.scratch, forest.keep, until)
    let_go(steering, state.n_vehicles)
    if why != AV_MUST_ANSWER:
        nursery.waits[row] = 0
        nursery.tally[row // nursery.depth, _SECONDS] += 1
        for i in range(state.n_vehicles):
            nursery.actions[row, until - 1, i] = w.vehicles[i].action
    return why


@kernel
def _end(row: int, forest: Forest, root: Any) -> None:
    """Count a row whose test is over: in all its ends the AV crashed, arrived, or ran out of time."""
    nursery, leaves = forest.nursery, forest.leaves
    w = world_row(nursery.worlds, row)
    state = w.state[0]
    weight = nursery.weight[row]
    root.ended += weight
    if state.outcome != AV_CRASH:
        return
    root.weight += weight
    root.crashes += 1
    crashed(state.slot_b, weight, nursery.moment[row], forest.lessons)
    k = leaves.used[0]
    if k >= leaves.crashes.size:
        return
    leaves.used[0] += 1
    leaf = leaves.crashes[k]
    leaf.root = state.test
    leaf.weight = weight
    leaf.time = state.frame * FRAME_S
    leaf.partner = state.slot_b
    leaf.acts = nursery.acts[row]
    leaf.begun = state.decisions
    leaf.memory = nursery.memory[row]
    for second in range(state.decisions):
        for i in range(state.n_vehicles):
            leaves.actions[k, second, i] = nursery.actions[row, second, i]


@kernel
def _pass_window(row: int, top: int, value: float, plan: Plan, nursery: Nursery) -> int:
    """Drop a world or copy it, by what it is worth; return the new top of the stack, `row` if it is dropped."""
    nursery.danger[row] = max(value, plan.floor, nursery.danger[row] / plan.forget)
    worth = nursery.weight[row] * nursery.danger[row] / plan.target
    if worth < _ROULETTE_BELOW:
        if _draw(row, nursery) >= worth:
            return row
        nursery.weight[row] /= worth
    elif worth > _SPLIT_ABOVE:
        copies = max(1, min(_copies(worth), _room(row, top, nursery)))
        nursery.weight[row] /= copies
        for _ in range(1, copies):
            _copy(nursery, row, top)
            top += 1
    return top


@inlined_kernel
def _chance_to_explore(act: Any, plan: Plan, s: Survey) -> float:
    """Compute the chance to follow an act that does not look dangerous; it falls with the gap in some seconds."""
    nearness = s.seen[act.near, -1]
    follower = s.follower[0]
    if follower >= 0 and act.kind == BEGINS and s.seen[act.near, 2] > 0.0:
        nearness = max(nearness, min(s.seen[follower, -1], 3.0 * nearness))
    chance: float = plan.explore * nearness * nearness
    return chance


@inlined_kernel
def _is_paired(k: int, last: int, s: Survey) -> bool:
    """Is any act of the group that ends with `last` looked at together with act k?"""
    m = last
    while m > k and (m == last or s.acts[m].is_last == 0):
        if s.pairs[k, m] > 0.0:
            return True
        m -= 1
    return False


@inlined_kernel
def _hold_to_rest(last: int, steering: Steering, s: Survey) -> None:
    """Let nothing of the group happen that ends with act `last`."""
    act = s.acts[last]
    hold_to(steering, act.slot, act.word, act.rest_first, act.rest_count)


@inlined_kernel
def _hold_to_act(k: int, steering: Steering, s: Survey) -> None:
    """Let act k happen."""
    act = s.acts[k]
    hold_to(steering, act.slot, act.word, act.first, act.count)


@kernel
def _follow(
    row: int, top: int, weight: float, danger: float, acts: tuple[int, int], ahead: Ahead, forest: Forest
) -> int:
    """Make copies of a row in whose next second the first of `acts` happens, and the second if that is not -1.

    Acts of groups before the first do not happen; of the groups paired with it those before the second, or with -1
    all, do not happen. All others are left to nature. `weight` is the row's, times the chance of all this.

    Returns:
        The new top of the stack.
    """
    plan, nursery = forest.plan, forest.nursery
    first, second = acts
    survey = nursery.survey
    share = weight * max(danger, plan.floor) / plan.target if plan.windows else weight / nursery.weight[row]
    if nursery.acts[row] < _EXPLORED_DEPTH:
        share = max(share, _chance_to_explore(survey.acts[first], plan, survey))
    copies = 1
    if share > _SEVERAL_ABOVE:
        copies = _copies(share)
    share = copies if share > 1.0 else share
    if share < 1.0 and _draw(row, nursery) >= share:
        return top
    if copies > _room(row, top, nursery):
        nursery.tally[row // nursery.depth, _LOST] += copies
        return top
    w = world_row(nursery.worlds, row)
    moment = note_act(
        w, nursery.moment[row], weight / share * copies, acts, ahead, forest.setting, survey, forest.lessons
    )
    own = last_of(first, survey)
    until = survey.n_acts[0] if second < 0 else last_of(second, survey)
    kind = survey.acts[first].kind if second < 0 else TWO
    for _ in range(copies):
        _copy(nursery, row, top)
        nursery.weight[top] = weight / share
        nursery.danger[top] = danger
        nursery.moment[top] = moment
        if nursery.acts[top] < _MOST_DIGITS:
            nursery.acts[top] = 10 * nursery.acts[top] + kind
        steering = _wait(top, nursery)
        for m in range(until):
            if survey.acts[m].is_last and m != own and (m < first or _is_paired(first, m, survey)):
                _hold_to_rest(m, steering, survey)
        _hold_to_act(first, steering, survey)
        if second >= 0:
            _hold_to_act(second, steering, survey)
        top += 1
    return top


@kernel
def _branch(row: int, top: int, ahead: Ahead, forest: Forest) -> int:
    """Let a row go on without any listed act, and copies in which they happen; return the new top."""
    nursery = forest.nursery
    survey = nursery.survey
    n = survey.n_acts[0]
    rest = nursery.weight[row]
    for k in range(n):
        act = survey.acts[k]
        weight = rest * chance_of(act.count)
        for m in range(last_of(k, survey) + 1, n):
            other = survey.acts[m]
            if _is_paired(k, last_of(m, survey), survey):
                danger = max(survey.pairs[k, m], act.danger)
                both = weight * chance_of(other.count)
                top = _follow(row, top, both, danger, (k, m), ahead, forest)
                if other.is_last:
                    weight *= chance_of(other.rest_count)
        top = _follow(row, top, weight, act.danger, (k, -1), ahead, forest)
        if act.is_last:
            rest *= chance_of(act.rest_count)
    nursery.weight[row] = rest
    steering = _wait(row, nursery)
    for k in range(n):
        if survey.acts[k].is_last:
            _hold_to_rest(k, steering, survey)
    return top


@kernel
def plant(seed: int, test: int, place: int, forest: Forest, root: Any) -> None:
    """Begin the tree of a test at a place: its first world, to be looked at."""
    nursery = forest.nursery
    row = place * nursery.depth
    reset_world(world_row(nursery.worlds, row), seed, test, forest.setting)
    nursery.weight[row] = 1.0
    nursery.danger[row] = 0.0
    nursery.moment[row] = NO_MOMENT
    nursery.acts[row] = 0
    nursery.waits[row] = 0
    nursery.memory[row] = -1
    nursery.top[place] = 1
    nursery.tally[place] = 0
    root.weight = 0.0
    root.ended = 0.0
    root.crashes = 0
    root.danger = -1.0


@kernel
def branch_out(place: int, forest: Forest, root: Any) -> int:
    """End and branch out the topmost worlds of a tree, until the topmost one waits for its second.

    Returns:
        Its row; -1 if none is left: then `root` is complete.
    """
    plan, setting, nursery = forest.plan, forest.setting, forest.nursery
    survey, tally = nursery.survey, nursery.tally[place]
    bottom = place * nursery.depth
    top: int = bottom + nursery.top[place]
    while top > bottom:
        row = top - 1
        if nursery.waits[row]:
            nursery.top[place] = top - bottom
            return row
        w = world_row(nursery.worlds, row)
        if w.state[0].outcome != RUNNING:
            _end(row, forest, root)
            top = row
            continue
        survey.n_left_out[0] = 0
        total, ahead = look_around(w, setting, plan.network, survey)
        least = total + plan.least_rise * max(total, plan.floor)
        list_acts(w, total, least, ahead, setting, plan.network, survey)
        list_pairs(w, ahead, setting, plan.network, survey)
        tally[_LOST] += survey.n_left_out[0]
        value = total + plan.look_ahead * survey.soon[0]
        if root.danger < 0.0:
            root.danger = value
        if plan.windows:
            top = _pass_window(row, top, value, plan, nursery)
            if top == row:
                continue
        copies = top - row
        moment = note_moment(w, nursery.moment[row], nursery.weight[row] * copies, survey, forest.lessons)
        for copy in range(row + copies - 1, row - 1, -1):
            nursery.moment[copy] = moment
            top = _branch(copy, top, ahead, forest)
    nursery.top[place] = 0
    root.seconds = tally[_SECONDS]
    root.lost = tally[_LOST]
    return -1


@kernel
def grow_range(seed: int, first: int, forest: Forest, roots: NDArray[np.void]) -> None:
    """Grow the trees of tests first, first + 1, ..., as many as there are `roots` (of ROOT), one after the other."""
    for k in range(roots.size):
        plant(seed, first + k, 0, forest, roots[k])
        row = branch_out(0, forest, roots[k])
        while row >= 0:
            drive_on(row, forest)
            row = branch_out(0, forest, roots[k])
