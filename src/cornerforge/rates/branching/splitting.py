"""Importance splitting: particles are copied where it is dangerous, and weighted so that every mean stays true.

A particle is a world with a weight. The particles of one test are its tree. At the begin of each second

1. the *window* looks at weight times danger: a world that is worth little is dropped with a chance and else gets more
   weight (roulette); one that is worth much is copied, and the copies share its weight (splitting);
2. for every act on the list (`acts`) a copy is made in which it happens, with the weight times the act's chance, if
   roulette lets it; the world itself goes on without any of them, with the weight times the chance of that.

No step changes the expected weight of a future, for any estimate of the danger. So the sum of the weights of a tree's
crashes has the crash rate per test as its mean (Booth and Hendricks 1984 call this weight windows; for exactness see
docs/adr/0030-natural-rates.md). Only its variance depends on the network.

All random numbers are functions of seed, test, and what happened in the tree before, so a tree is the same everywhere.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.rates.branching.acts import BEGINS, TWO
from cornerforge.rates.branching.branches import hold_to_branch, hold_to_no_act, list_branches
from cornerforge.rates.branching.population import (
    BRANCHES,
    LOST,
    SECONDS,
    draw,
    is_tilted,
    steering_of,
    survey_world,
    value_of,
    wait,
)
from cornerforge.rates.branching.tilt import draw_branch, draw_start
from cornerforge.rates.branching.training_data import NO_MOMENT, note_act, note_crash, note_moment
from cornerforge.sim import AV_MUST_ANSWER, MAX_BRANCH, advance, outcome, reset_world, steering, world_row
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.rates.branching.acts import Survey
    from cornerforge.rates.branching.danger import Ahead
    from cornerforge.rates.branching.population import Plan, Pool, Population

__all__ = ["branch_out", "drive_on", "drive_tree_range", "start_tree"]

MOST_COPIES = 10
"""A window makes at most so many copies of a world in a second."""
_ROULETTE_BELOW, _SPLIT_ABOVE, _SEVERAL_ABOVE = 0.5, 2.0, 1.5
_MOST_DIGITS = 10**15
_EXPLORED_DEPTH = 100


@inlined_kernel
def _room(row: int, top: int, pool: Pool) -> int:
    """Count for how many more copies the tree of a row has room, and a branch with random words of its own."""
    place = row // pool.depth
    room: int = min((place + 1) * pool.depth - top, MAX_BRANCH - pool.tally[place, BRANCHES])
    return room


@inlined_kernel
def _copies(worth: float) -> int:
    """Say how many copies a world is worth."""
    return math.floor(min(worth, MOST_COPIES) + 0.5)


@kernel
def _copy(pool: Pool, a: int, b: int) -> None:
    """Copy row a to row b, at the begin of a second, and give the copy a future of its own."""
    worlds = pool.worlds
    n = worlds.state[a, 0].n_vehicles
    worlds.state[b, 0] = worlds.state[a, 0]
    worlds.av[b, 0] = worlds.av[a, 0]
    for i in range(n):
        worlds.vehicles[b, i] = worlds.vehicles[a, i]
        worlds.noticed[b, i] = worlds.noticed[a, i]
        worlds.order[b, i] = worlds.order[a, i]
        worlds.current[b, i] = worlds.current[a, i]
        if worlds.agents.shape[1]:
            worlds.agents[b, i] = worlds.agents[a, i]
        for place in range(worlds.order.shape[1] + i, worlds.seen.shape[1], worlds.order.shape[1]):
            worlds.seen[b, place] = worlds.seen[a, place]
    for second in range(worlds.state[a, 0].decisions):
        for i in range(n):
            pool.actions[b, second, i] = pool.actions[a, second, i]
    pool.weight[b] = pool.weight[a]
    pool.danger[b] = pool.danger[a]
    pool.moment[b] = pool.moment[a]
    pool.acts[b] = pool.acts[a]
    pool.waits[b] = 0
    pool.memory[b] = pool.memory[a]
    tally = pool.tally[b // pool.depth]
    tally[BRANCHES] += 1
    worlds.state[b, 0].branch = tally[BRANCHES]


@inlined_kernel
def _take_over(source: steering.Steering, held: steering.Steering, slots: int) -> None:
    """Hold the first `slots` slots to what `source` holds them to."""
    held.on[0] = source.on[0]
    if source.on[0]:
        for what in range(2):
            for i in range(slots):
                held.first[what, i] = source.first[what, i]
                held.words[what, i] = source.words[what, i]


@kernel
def drive_on(row: int, population: Population) -> int:
    """Drive a row that waits to the end of its second, or until its AV outside must answer.

    Returns:
        As `loop.advance`: MILESTONE or OVER, and then the row does not wait any more; or AV_MUST_ANSWER.
    """
    pool, held = population.pool, population.scratch.steering
    w = world_row(pool.worlds, row)
    state = w.state[0]
    until = state.decisions + 1 if state.substep == 0 else state.decisions
    _take_over(steering_of(row, pool), held, state.n_vehicles)
    why = advance(w, population.setting, population.scratch, population.keep, until)
    steering.let_go(held, state.n_vehicles)
    if why != AV_MUST_ANSWER:
        pool.waits[row] = 0
        pool.tally[row // pool.depth, SECONDS] += 1
        for i in range(state.n_vehicles):
            pool.actions[row, until - 1, i] = w.vehicles[i].action
    return why


@kernel
def _end(row: int, population: Population, tree: Any) -> None:
    """Count a row with a test that is over: in all its ends the AV crashed, arrived, or ran out of time."""
    pool, terminal = population.pool, population.terminal
    w = world_row(pool.worlds, row)
    state = w.state[0]
    weight = pool.weight[row]
    tree.ended += weight
    if state.outcome != outcome.AV_CRASH:
        return
    tree.weight += weight
    tree.crashes += 1
    note_crash(state.slot_b, weight, pool.moment[row], population.training)
    k = terminal.used[0]
    if k >= terminal.crashes.size:
        return
    terminal.used[0] += 1
    end = terminal.crashes[k]
    end.test = state.test
    end.weight = weight
    end.time = state.frame * FRAME_S
    end.partner = state.slot_b
    end.acts = pool.acts[row]
    end.begun = state.decisions
    end.memory = pool.memory[row]
    # All of the row: an earlier crash may have left its actions in it.
    for second in range(terminal.actions.shape[1]):
        for i in range(terminal.actions.shape[2]):
            acted = second < state.decisions and i < state.n_vehicles
            terminal.actions[k, second, i] = pool.actions[row, second, i] if acted else 0


@kernel
def _pass_window(row: int, top: int, value: float, plan: Plan, pool: Pool) -> int:
    """Drop a world or copy it, by what it is worth; return the new top of the stack, `row` if it is dropped."""
    pool.danger[row] = max(value, plan.floor, pool.danger[row] / plan.forget)
    worth = pool.weight[row] * pool.danger[row] / plan.target
    if worth < _ROULETTE_BELOW:
        if draw(row, pool) >= worth:
            return row
        pool.weight[row] /= worth
    elif worth > _SPLIT_ABOVE:
        copies = max(1, min(_copies(worth), _room(row, top, pool)))
        pool.weight[row] /= copies
        for _ in range(1, copies):
            _copy(pool, row, top)
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
    row: int, top: int, weight: float, danger: float, acts: tuple[int, int], ahead: Ahead, population: Population
) -> int:
    """Make copies of a row; in their next second the first of `acts` happens, and the second if that is not -1.

    Acts of groups before the first do not happen; of the groups paired with it those before the second, or with -1
    all, do not happen. All others are left to nature. `weight` is the row's, times the chance of all this.

    Returns:
        The new top of the stack.
    """
    plan, pool = population.plan, population.pool
    first, second = acts
    survey = pool.survey
    share = weight * max(danger, plan.floor) / plan.target if plan.windows else weight / pool.weight[row]
    if pool.acts[row] < _EXPLORED_DEPTH:
        share = max(share, _chance_to_explore(survey.acts[first], plan, survey))
    copies = 1
    if share > _SEVERAL_ABOVE:
        copies = _copies(share)
    share = copies if share > 1.0 else share
    if share < 1.0 and draw(row, pool) >= share:
        return top
    if copies > _room(row, top, pool):
        pool.tally[row // pool.depth, LOST] += copies
        return top
    w = world_row(pool.worlds, row)
    moment = note_act(
        w, pool.moment[row], weight / share * copies, acts, ahead, population.setting, survey, population.training
    )
    kind = survey.acts[first].kind if second < 0 else TWO
    for _ in range(copies):
        _copy(pool, row, top)
        pool.weight[top] = weight / share
        pool.danger[top] = danger
        pool.moment[top] = moment
        if pool.acts[top] < _MOST_DIGITS:
            pool.acts[top] = 10 * pool.acts[top] + kind
        hold_to_branch(first, second, wait(top, pool), survey)
        top += 1
    return top


@kernel
def _branch(row: int, top: int, ahead: Ahead, population: Population) -> int:
    """Let a row go on without any listed act, and copies in which they happen; return the new top."""
    pool = population.pool
    branches = pool.branches
    list_branches(pool.weight[row], pool.survey, branches)
    for k in range(branches.n[0]):
        branch = branches.listed[k]
        acts = (branch.first, branch.second)
        top = _follow(row, top, branch.chance, branch.danger, acts, ahead, population)
    pool.weight[row] = branches.rest[0]
    hold_to_no_act(wait(row, pool), pool.survey)
    return top


@kernel
def start_tree(seed: int, test: int, place: int, population: Population, tree: Any) -> None:
    """Begin the tree of a test at a place: its first world, to be looked at."""
    pool = population.pool
    row = place * pool.depth
    pool.tally[place] = 0
    if is_tilted(population.plan):
        draw_start(seed, test, row, population)
    else:
        reset_world(world_row(pool.worlds, row), seed, test, population.setting)
        pool.weight[row] = 1.0
    pool.danger[row] = 0.0
    pool.moment[row] = NO_MOMENT
    pool.acts[row] = 0
    pool.waits[row] = 0
    pool.memory[row] = -1
    pool.top[place] = 1
    tree.weight = 0.0
    tree.ended = 0.0
    tree.crashes = 0
    tree.danger = -1.0


@kernel
def branch_out(place: int, population: Population, tree: Any) -> int:
    """End and branch out the topmost worlds of a tree, until the topmost one waits for its second.

    Returns:
        Its row; -1 if none is left: then `tree` is complete.
    """
    plan, pool = population.plan, population.pool
    survey, tally = pool.survey, pool.tally[place]
    bottom = place * pool.depth
    top: int = bottom + pool.top[place]
    while top > bottom:
        row = top - 1
        if pool.waits[row]:
            pool.top[place] = top - bottom
            return row
        w = world_row(pool.worlds, row)
        if w.state[0].outcome != outcome.RUNNING:
            _end(row, population, tree)
            top = row
            continue
        total, ahead = survey_world(w, population)
        tally[LOST] += survey.n_left_out[0]
        value = value_of(total, population)
        if tree.danger < 0.0:
            tree.danger = value
        if is_tilted(plan):
            draw_branch(row, total, population)
            continue
        if plan.windows:
            top = _pass_window(row, top, value, plan, pool)
            if top == row:
                continue
        copies = top - row
        moment = note_moment(w, pool.moment[row], pool.weight[row] * copies, survey, population.training)
        for copy in range(row + copies - 1, row - 1, -1):
            pool.moment[copy] = moment
            top = _branch(copy, top, ahead, population)
    pool.top[place] = 0
    tree.seconds = tally[SECONDS]
    tree.lost = tally[LOST]
    return -1


@kernel
def drive_tree_range(seed: int, first: int, population: Population, trees: NDArray[np.void]) -> None:
    """Drive the trees of tests first, first + 1, ..., as many as there are `trees` (of TREE), one after the other."""
    for k in range(trees.size):
        start_tree(seed, first + k, 0, population, trees[k])
        row = branch_out(0, population, trees[k])
        while row >= 0:
            drive_on(row, population)
            row = branch_out(0, population, trees[k])
