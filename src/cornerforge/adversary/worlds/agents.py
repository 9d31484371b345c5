"""Worlds in which an agent outside the kernels decides, for the controlled BV or for the AV (`cornerforge.ext.gym`).

Many worlds go one step in one call. Every world has its own seed and test number, so what happens in it does not depend
on the worlds beside it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.adversary.worlds.drive_bv import MAX_TRIES, History, Series, reward_of, start_with_bv
from cornerforge.road.straight import driven
from cornerforge.sim import (
    NEVER,
    World,
    actions,
    advance,
    allocate_worlds,
    answer_as_av,
    answer_as_bv,
    av_scene,
    av_view,
    bring_up_to_date,
    look_as_bv,
    observe,
    outcome,
    reset_world,
    world_row,
)
from cornerforge.site.tables import at_site
from cornerforge.types import ACTION_HOLD, FIRST_ACCELERATION, N_ACTIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.adversary.worlds.rewards import RewardNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim import Keep, Scratch, Setting

__all__ = [
    "MAX_TRIES",
    "NOBODY_LEFT",
    "SITE_ROWS",
    "AvAgents",
    "BvAgents",
    "allocate_av_agents",
    "allocate_bv_agents",
    "begin_step_as_bv",
    "drive_on_as_av",
    "end_step_as_bv",
    "start_as_av",
    "start_as_bv",
    "step_as_bv",
    "substitute_action",
]

SITE_ROWS = av_scene.FIRST_AGENT + 16
"""Rows of what an agent that is the AV at a site sees: of the 16 nearest agents."""
NOBODY_LEFT = 8
"""Outcome besides the codes of `sim.outcome`, none of which is 8: no BV is left to control."""


@kernel
def substitute_action(wished: int, allowed: NDArray[np.bool_]) -> int:
    """Replace an action that the mask forbids.

    An allowed action stays. Otherwise the allowed acceleration nearest to the wished one (to 0 for a lane change; the
    lower of two equally near), and where no acceleration is allowed the first allowed action.

    Args:
        wished: Action index, 0 to 32.
        allowed: The mask, bool (33,), with at least one True.
    """
    if allowed[wished]:
        return wished
    goal = wished if wished >= FIRST_ACCELERATION else ACTION_HOLD
    for away in range(N_ACTIONS):
        for action in (goal - away, goal + away):
            if FIRST_ACCELERATION <= action < N_ACTIONS and allowed[action]:
                return action
    return 0 if allowed[0] else 1


class BvAgents(NamedTuple):
    """B worlds in which an agent is the BV nearest to the AV.

    Attributes:
        worlds: Their states.
        chosen: Which worlds a call is for, bool (B,).
        seeds, tests: Name of each world's test, int64 (B,).
        action: The agent's wish before a step, the action carried out after it, int64 (B,).
        observation: What the agent sees (`observe.observe`), float32 (B, N_OBSERVATION).
        allowed: Action mask, bool (B, 33).
        outcome: Codes of `sim.outcome`, or NOBODY_LEFT, int64 (B,).
        reward: For the last step, float64 (B,).
    """

    worlds: World
    chosen: NDArray[np.bool_]
    seeds: NDArray[np.int64]
    tests: NDArray[np.int64]
    action: NDArray[np.int64]
    observation: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    outcome: NDArray[np.int64]
    reward: NDArray[np.float64]


def allocate_bv_agents(n_worlds: int, slots: int, road: RoadNumbers | None = None) -> BvAgents:
    """Allocate `n_worlds` idle worlds of `slots` vehicle slots, of an AV that sees so late [0.1 s]."""
    return BvAgents(
        allocate_worlds(n_worlds, slots, road),
        np.zeros(n_worlds, dtype=np.bool_),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros((n_worlds, observe.N_OBSERVATION), dtype=np.float32),
        np.zeros((n_worlds, N_ACTIONS), dtype=np.bool_),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros(n_worlds),
    )


@kernel
def start_as_bv(begin: int, end: int, setting: Setting, agents: BvAgents, s: Scratch, keep: Keep) -> None:
    """Put the chosen worlds of [begin, end) at the start of their tests; fill the critical BV's observation and mask.

    A test without any BV is passed over: tests[b] becomes the next test that has one.

    Raises:
        InputError: MAX_TRIES tests in a row have none.
    """
    for b in range(begin, end):
        if agents.chosen[b]:
            agents.tests[b] = start_with_bv(
                world_row(agents.worlds, b), Series(agents.seeds[b], agents.tests[b], 1, 0), setting, s, keep,
                agents.observation[b], agents.allowed[b],
            )  # fmt: skip


@kernel
def begin_step_as_bv(begin: int, end: int, agents: BvAgents, history: History) -> None:
    """Let the critical BV of each chosen world of [begin, end) answer with the agent's action (`step_as_bv`)."""
    for b in range(begin, end):
        if agents.chosen[b]:
            w = world_row(agents.worlds, b)
            action = substitute_action(agents.action[b], agents.allowed[b])
            agents.action[b] = action
            history.action[b, w.state[0].decisions] = action
            answer_as_bv(w, action)


@kernel
def end_step_as_bv(
    begin: int, end: int, setting: Setting, reward: RewardNumbers, agents: BvAgents, history: History, s: Scratch
) -> None:
    """Give reward, outcome, and the new observation and mask of each chosen world, whose second is over."""
    for b in range(begin, end):
        if not agents.chosen[b]:
            continue
        w = world_row(agents.worlds, b)
        agents.reward[b] = reward_of(w, b, setting, reward, history, s)
        code = w.state[0].outcome
        if code != outcome.RUNNING:
            bring_up_to_date(w, setting.road)
        if look_as_bv(w, setting, s, agents.observation[b], agents.allowed[b]) < 0 and code == outcome.RUNNING:
            code = NOBODY_LEFT
        agents.outcome[b] = code


@kernel
def step_as_bv(
    begin: int, end: int, setting: Setting, reward: RewardNumbers, agents: BvAgents, history: History, s: Scratch,
    keep: Keep,
) -> None:  # fmt: skip
    """Drive the chosen worlds of [begin, end) for one decision (1 s), in which the critical BV does the agent's action.

    Args:
        begin, end: Range of worlds.
        setting: The run, whose critical BV is TOLD.
        reward: Which crashes are paid.
        agents: `action` holds the wishes, and afterwards the actions carried out (`substitute_action`). `observation`
            and `allowed` become those of the new moment; where a test ended, of its end.
        history: Each world's actions are written; its own world and frames are scratch.
        s: Scratch.
        keep: Nothing is kept.
    """
    begin_step_as_bv(begin, end, agents, history)
    for b in range(begin, end):
        if agents.chosen[b]:
            advance(world_row(agents.worlds, b), setting, s, keep, NEVER)
    end_step_as_bv(begin, end, setting, reward, agents, history, s)


class AvAgents(NamedTuple):
    """B worlds in which an agent is the AV.

    Attributes:
        worlds, chosen, seeds, tests, outcome: As in `BvAgents`.
        command: Acceleration that the AV holds [m/s2], float64 (B,).
        order: Lane order, int64 (B,), see `actions.ordered_lane`.
        seen: What the AV sees, float32 (B, VIEW_ROWS, VIEW_COLUMNS); at a site (B, SITE_ROWS, SITE_COLUMNS).
        metres: What the AV drove in the last step, float64 (B,).
    """

    worlds: World
    chosen: NDArray[np.bool_]
    seeds: NDArray[np.int64]
    tests: NDArray[np.int64]
    command: NDArray[np.float64]
    order: NDArray[np.int64]
    seen: NDArray[np.float32]
    outcome: NDArray[np.int64]
    metres: NDArray[np.float64]


def allocate_av_agents(n_worlds: int, slots: int, road: RoadNumbers | None = None) -> AvAgents:
    """Allocate `n_worlds` idle worlds of `slots` vehicle slots, of an AV that sees so late [0.1 s]."""
    at_a_site = road is not None and road.site.size > 0
    shape = (SITE_ROWS, av_scene.SITE_COLUMNS) if at_a_site else (av_view.VIEW_ROWS, av_view.VIEW_COLUMNS)
    return AvAgents(
        allocate_worlds(n_worlds, slots, road),
        np.zeros(n_worlds, dtype=np.bool_),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros(n_worlds),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros((n_worlds, *shape), dtype=np.float32),
        np.zeros(n_worlds, dtype=np.int64),
        np.zeros(n_worlds),
    )


@inlined_kernel
def _way(w: World, road: RoadNumbers) -> float:
    """Compute how far the AV has driven [m], from any place."""
    if at_site(road.site):
        way: float = w.agents[0].s
        return way
    return driven(w.vehicles, 0, road)


@kernel
def start_as_av(begin: int, end: int, setting: Setting, agents: AvAgents, s: Scratch) -> None:
    """Put the chosen worlds of [begin, end) at the start of their tests and fill the AV's view."""
    for b in range(begin, end):
        if agents.chosen[b]:
            w = world_row(agents.worlds, b)
            reset_world(w, agents.seeds[b], agents.tests[b], setting)
            av_scene.show_to_av(w, setting.road, s.av, agents.seen[b])


@kernel
def drive_on_as_av(begin: int, end: int, setting: Setting, agents: AvAgents, s: Scratch, keep: Keep) -> None:
    """Drive the chosen worlds of [begin, end) from one decision of the AV to the next.

    Args:
        begin, end: Range of worlds.
        setting: The run, whose AV is OUTSIDE.
        agents: `command` and `order` are read, `seen`, `outcome` and `metres` written.
        s: Scratch.
        keep: Nothing is kept.
    """
    for b in range(begin, end):
        if not agents.chosen[b]:
            continue
        w = world_row(agents.worlds, b)
        before = _way(w, setting.road)
        answer_as_av(w, agents.command[b], actions.ordered_lane(w, 0, agents.order[b], setting.road))
        advance(w, setting, s, keep, NEVER)
        agents.outcome[b] = w.state[0].outcome
        agents.metres[b] = _way(w, setting.road) - before
        av_scene.show_to_av(w, setting.road, s.av, agents.seen[b])
