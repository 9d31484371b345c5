"""Memory of trees of tests: their plan, the pool of their particles, and the terminal states that are found.

A *particle* is a world with a weight, a row of the pool. `splitting` and `tilt` drive particles; nothing here does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import PURPOSE_ROULETTE, block, uniform
from cornerforge.rates.branching.acts import Survey, allocate_survey, list_acts, list_pairs, look_around
from cornerforge.rates.branching.branches import Branches, allocate_branches
from cornerforge.rates.branching.danger import Network
from cornerforge.rates.branching.training_data import TrainingData
from cornerforge.sim import World, allocate_worlds, steering

if TYPE_CHECKING:
    from cornerforge.rates.branching.danger import Ahead
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim import Keep, Scratch, Setting

__all__ = [
    "BRANCHES",
    "DRAWS",
    "LOST",
    "MOST_PROPOSALS",
    "NO_TILT",
    "SECONDS",
    "TERMINAL_STATE",
    "TREE",
    "Plan",
    "Pool",
    "Population",
    "TerminalStates",
    "Tilt",
    "allocate_pool",
    "allocate_terminal_states",
    "draw",
    "is_tilted",
    "steering_of",
    "survey_world",
    "tree_of",
    "value_of",
    "wait",
]  # fmt: skip

TREE = np.dtype(
    [("weight", "f8"), ("ended", "f8"), ("danger", "f8"), ("crashes", "i8"), ("seconds", "i8"), ("lost", "i8")]
)
"""A whole tree: all particles that come of one test. weight: sum over its crashes, the estimate of the chance of a
crash; ended: sum over all its ends, of mean 1; danger: at its start; crashes: how many; seconds: world-seconds driven;
lost: copies or acts for which there was no room: must be 0."""

TERMINAL_STATE = np.dtype(
    [
        ("test", "i8"),
        ("weight", "f8"),
        ("time", "f8"),
        ("partner", "i8"),
        ("acts", "i8"),
        ("begun", "i8"),
        ("memory", "i8"),
    ]
)
"""A crash at the end of a branch. test: the tree's; weight; time into the test [s]; partner: slot; acts: the kinds of
the acts that led there, as decimal digits; begun: decisions taken; memory: as of `Pool`."""

SECONDS, LOST, BRANCHES, DRAWS = range(4)
"""Columns of `Pool.tally`."""
MOST_PROPOSALS = 4
"""A tilt has at most so many proposals."""


class Tilt(NamedTuple):
    """Instead of copies: one branch is drawn each second, from proposals that favour dangerous ones (`tilt`).

    Attributes:
        shares: Share of tests that each proposal drives, of sum 1, (C,) with C at most MOST_PROPOSALS. With none,
            worlds are copied.
        powers: A proposal draws a branch by its chance times its danger to this power; 0: as nature does, (C,).
        candidates: A test's start is drawn from so many, by their danger to this power.
    """

    shares: NDArray[np.float64]
    powers: NDArray[np.float64]
    candidates: int


NO_TILT = Tilt(np.zeros(0), np.zeros(0), 1)
"""Worlds are copied."""


class Plan(NamedTuple):
    """How a test branches into a tree.

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
        network: Network that estimates the danger.
        tilt: One branch is drawn instead of copies.
    """

    target: float
    floor: float
    least_rise: float
    explore: float
    windows: int
    forget: float
    look_ahead: float
    network: Network
    tilt: Tilt = NO_TILT


class TerminalStates(NamedTuple):
    """Crashes that were found; a crash without room is not noted.

    Attributes:
        crashes: (K,) of TERMINAL_STATE.
        actions: Actions of all vehicles at each decision, int8 (K, decisions, N): with the test's start they give the
            crash again (`scripted`).
        used: How many there are, int64 (1,).
    """

    crashes: NDArray[np.void]
    actions: NDArray[np.int8]
    used: NDArray[np.int64]


class Pool(NamedTuple):
    """Particles of trees that are driven side by side: T trees, a stack of R / T rows each; a row is a particle.

    Attributes:
        depth: Rows of a tree: tree t has those from t * depth on.
        worlds: A batch of R worlds.
        weight: Weight of each particle, (R,).
        ratio: Density of what happened to each by each proposal of a tilt, over the natural one, (R, MOST_PROPOSALS).
        proposal: Which one drives each, int64 (R,).
        danger: Danger of each particle a second ago, (R,).
        moment: When it was last noted (`training_data`), int64 (R,).
        acts: Acts that led there, as `TERMINAL_STATE.acts`, int64 (R,).
        actions: Actions so far, int8 (R, decisions, N).
        waits: 1 if it must be driven a second on before it is looked at again, int64 (R,).
        steering: Words to which it is held in that second, (R, ...); meaningless where it does not wait.
        memory: For AVs outside: what its AV remembers, -1 for nothing, int64 (R,).
        top: Rows in use of each tree, int64 (T,).
        tally: SECONDS driven, copies LOST, BRANCHES and DRAWS of each tree, int64 (T, 4).
        survey: What is around the AV.
        branches: What may happen there.
    """

    depth: int
    worlds: World
    weight: NDArray[np.float64]
    ratio: NDArray[np.float64]
    proposal: NDArray[np.int64]
    danger: NDArray[np.float64]
    moment: NDArray[np.int64]
    acts: NDArray[np.int64]
    actions: NDArray[np.int8]
    waits: NDArray[np.int64]
    steering: steering.Steering
    memory: NDArray[np.int64]
    top: NDArray[np.int64]
    tally: NDArray[np.int64]
    survey: Survey
    branches: Branches


class Population(NamedTuple):
    """All that trees are driven with.

    Attributes:
        plan: How they branch.
        setting: The run: an AV of the kernels, naturalistic BVs, no adversary.
        scratch, keep: Scratch; keep nothing.
        pool: Room for particles.
        terminal, training: What is found.
    """

    plan: Plan
    setting: Setting
    scratch: Scratch
    keep: Keep
    pool: Pool
    terminal: TerminalStates
    training: TrainingData


def allocate_pool(depth: int, slots: int, decisions: int, places: int = 1, road: RoadNumbers | None = None) -> Pool:
    """Allocate room for `places` trees of `depth` particles each, of `slots` vehicles; memory is taken on use.

    `road`: of the tests; None: a road on which the AV sees at once.
    """
    rows = places * depth
    return Pool(
        depth=depth,
        worlds=allocate_worlds(rows, slots, road),
        weight=np.zeros(rows),
        ratio=np.zeros((rows, MOST_PROPOSALS)),
        proposal=np.zeros(rows, dtype=np.int64),
        danger=np.zeros(rows),
        moment=np.zeros(rows, dtype=np.int64),
        acts=np.zeros(rows, dtype=np.int64),
        actions=np.zeros((rows, decisions, slots), dtype=np.int8),
        waits=np.zeros(rows, dtype=np.int64),
        steering=steering.Steering(
            np.zeros((rows, 1), dtype=np.int64),
            np.zeros((rows, 2, slots), dtype=np.uint64),
            np.zeros((rows, 2, slots), dtype=np.uint64),
        ),
        memory=np.zeros(rows, dtype=np.int64),
        top=np.zeros(places, dtype=np.int64),
        tally=np.zeros((places, 4), dtype=np.int64),
        survey=allocate_survey(),
        branches=allocate_branches(),
    )


def allocate_terminal_states(crashes: int, slots: int, decisions: int) -> TerminalStates:
    """Allocate room for so many crashes."""
    return TerminalStates(
        np.zeros(crashes, dtype=TERMINAL_STATE),
        np.zeros((crashes, decisions, slots), dtype=np.int8),
        np.zeros(1, dtype=np.int64),
    )


@inlined_kernel
def is_tilted(plan: Plan) -> bool:
    """Is one branch drawn instead of copies?"""
    tilted: bool = plan.tilt.shares.size > 0
    return tilted


def tree_of(test: int, plan: Plan) -> int:
    """Say to which tree a test belongs: each has as many tests to begin with as its plan has candidates."""
    return test // plan.tilt.candidates


@kernel
def survey_world(w: World, population: Population) -> tuple[float, Ahead]:
    """Survey a world at the begin of a second: which BVs are near the AV, and what they may do.

    Returns:
        The danger of all near BVs together; what is ahead of the AV.
    """
    plan, setting, survey = population.plan, population.setting, population.pool.survey
    survey.n_left_out[0] = 0
    total, ahead = look_around(w, setting, plan.network, survey)
    least = total + plan.least_rise * max(total, plan.floor)
    list_acts(w, total, least, ahead, setting, plan.network, survey)
    list_pairs(w, ahead, setting, plan.network, survey)
    return total, ahead


@inlined_kernel
def value_of(total: float, population: Population) -> float:
    """Compute what counts as the danger of a surveyed world if its near BVs have a danger of `total`."""
    value: float = total + population.plan.look_ahead * population.pool.survey.soon[0]
    return value


@inlined_kernel
def draw(row: int, pool: Pool) -> float:
    """Draw a number in (0, 1) that is the tree's own."""
    state = pool.worlds.state[row, 0]
    tally = pool.tally[row // pool.depth]
    tally[DRAWS] += 1
    return uniform(block(state.seed, state.test, tally[DRAWS], 0, PURPOSE_ROULETTE)[0])


@inlined_kernel
def steering_of(row: int, pool: Pool) -> steering.Steering:
    """Give the words that a row is held to in the second that it waits for."""
    held = pool.steering
    return steering.Steering(held.on[row], held.first[row], held.words[row])


@inlined_kernel
def wait(row: int, pool: Pool) -> steering.Steering:
    """Let a row wait for its next second, held to nothing; returns its steering, to hold it to something."""
    pool.waits[row] = 1
    held = steering_of(row, pool)
    steering.let_go(held, pool.worlds.state[row, 0].n_vehicles)
    return held
