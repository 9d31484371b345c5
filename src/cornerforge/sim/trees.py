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
from typing import TYPE_CHECKING, Any

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.acts import BEGINS, TWO
from cornerforge.sim.branches import hold_to_branch, hold_to_no_act, list_branches
from cornerforge.sim.forest import BRANCHES, LOST, SECONDS, draw, is_tilted, steering_of, survey_world, value_of, wait
from cornerforge.sim.lessons import NO_MOMENT, crashed, note_act, note_moment
from cornerforge.sim.loop import AV_MUST_ANSWER, advance
from cornerforge.sim.steering import let_go
from cornerforge.sim.tilt import draw_branch, draw_start
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import AV_CRASH, MAX_BRANCH, RUNNING, world_row
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.sim.acts import Survey
    from cornerforge.sim.danger import Ahead
    from cornerforge.sim.forest import Forest, Nursery, Plan
    from cornerforge.sim.steering import Steering

__all__ = ["branch_out", "drive_on", "grow_range", "plant"]

MOST_COPIES = 10
"""A window makes at most so many copies of a world in a second."""
_ROULETTE_BELOW, _SPLIT_ABOVE, _SEVERAL_ABOVE = 0.5, 2.0, 1.5
_MOST_DIGITS = 10**15
_EXPLORED_DEPTH = 100


@inlined_kernel
def _room(row: int, top: int, nursery: Nursery) -> int:
    """Count for how many more copies the tree of a row has room, and a branch with random words of its own."""
    place = row // nursery.depth
    room: int = min((place + 1) * nursery.depth - top, MAX_BRANCH - nursery.tally[place, BRANCHES])
    return room


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
    tally[BRANCHES] += 1
    worlds.state[b, 0].branch = tally[BRANCHES]


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
    _take_over(steering_of(row, nursery), steering, state.n_vehicles)
    why = advance(w, forest.setting, forest.scratch, forest.keep, until)
    let_go(steering, state.n_vehicles)
    if why != AV_MUST_ANSWER:
        nursery.waits[row] = 0
        nursery.tally[row // nursery.depth, SECONDS] += 1
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
    # All of the row: an earlier crash may have left its actions in it.
    for second in range(leaves.actions.shape[1]):
        for i in range(leaves.actions.shape[2]):
            acted = second < state.decisions and i < state.n_vehicles
            leaves.actions[k, second, i] = nursery.actions[row, second, i] if acted else 0


@kernel
def _pass_window(row: int, top: int, value: float, plan: Plan, nursery: Nursery) -> int:
    """Drop a world or copy it, by what it is worth; return the new top of the stack, `row` if it is dropped."""
    nursery.danger[row] = max(value, plan.floor, nursery.danger[row] / plan.forget)
    worth = nursery.weight[row] * nursery.danger[row] / plan.target
    if worth < _ROULETTE_BELOW:
        if draw(row, nursery) >= worth:
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
    if share < 1.0 and draw(row, nursery) >= share:
        return top
    if copies > _room(row, top, nursery):
        nursery.tally[row // nursery.depth, LOST] += copies
        return top
    w = world_row(nursery.worlds, row)
    moment = note_act(
        w, nursery.moment[row], weight / share * copies, acts, ahead, forest.setting, survey, forest.lessons
    )
    kind = survey.acts[first].kind if second < 0 else TWO
    for _ in range(copies):
        _copy(nursery, row, top)
        nursery.weight[top] = weight / share
        nursery.danger[top] = danger
        nursery.moment[top] = moment
        if nursery.acts[top] < _MOST_DIGITS:
            nursery.acts[top] = 10 * nursery.acts[top] + kind
        hold_to_branch(first, second, wait(top, nursery), survey)
        top += 1
    return top


@kernel
def _branch(row: int, top: int, ahead: Ahead, forest: Forest) -> int:
    """Let a row go on without any listed act, and copies in which they happen; return the new top."""
    nursery = forest.nursery
    branches = nursery.branches
    list_branches(nursery.weight[row], nursery.survey, branches)
    for k in range(branches.n[0]):
        branch = branches.listed[k]
        acts = (branch.first, branch.second)
        top = _follow(row, top, branch.chance, branch.danger, acts, ahead, forest)
    nursery.weight[row] = branches.rest[0]
    hold_to_no_act(wait(row, nursery), nursery.survey)
    return top


@kernel
def plant(seed: int, test: int, place: int, forest: Forest, root: Any) -> None:
    """Begin the tree of a test at a place: its first world, to be looked at."""
    nursery = forest.nursery
    row = place * nursery.depth
    nursery.tally[place] = 0
    if is_tilted(forest.plan):
        draw_start(seed, test, row, forest)
    else:
        reset_world(world_row(nursery.worlds, row), seed, test, forest.setting)
        nursery.weight[row] = 1.0
    nursery.danger[row] = 0.0
    nursery.moment[row] = NO_MOMENT
    nursery.acts[row] = 0
    nursery.waits[row] = 0
    nursery.memory[row] = -1
    nursery.top[place] = 1
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
    plan, nursery = forest.plan, forest.nursery
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
        total, ahead = survey_world(w, forest)
        tally[LOST] += survey.n_left_out[0]
        value = value_of(total, forest)
        if root.danger < 0.0:
            root.danger = value
        if is_tilted(plan):
            draw_branch(row, total, forest)
            continue
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
    root.seconds = tally[SECONDS]
    root.lost = tally[LOST]
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
