"""What trees of tests are kept in: the plan by which they grow, room for their worlds, and what they come to.

`trees` grows them. Nothing here drives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import PURPOSE_ROULETTE, block, uniform
from cornerforge.sim.acts import Survey, allocate_survey, list_acts, list_pairs, look_around
from cornerforge.sim.branches import Branches, allocate_branches
from cornerforge.sim.danger import Network
from cornerforge.sim.lessons import Lessons
from cornerforge.sim.steering import Steering, let_go
from cornerforge.sim.world import World, allocate_worlds

if TYPE_CHECKING:
    from cornerforge.sim.danger import Ahead
    from cornerforge.sim.keep import Keep
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting

__all__ = [
    "BRANCHES", "DRAWS", "LEAF", "LOST", "MOST_PROPOSALS", "NO_TILT", "ROOT", "SECONDS", "Forest", "Leaves", "Nursery",
    "Plan", "Tilt", "allocate_leaves", "allocate_nursery", "draw", "is_tilted", "steering_of", "survey_world",
    "tree_of", "value_of", "wait",
]  # fmt: skip

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

SECONDS, LOST, BRANCHES, DRAWS = range(4)
"""Columns of `Nursery.tally`."""
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
        ratio: Density of what happened to each by each proposal of a tilt, over the natural one, (R, MOST_PROPOSALS).
        proposal: Which one drives each, int64 (R,).
        danger: Of each a second ago, (R,).
        moment: When it was last noted (`lessons`), int64 (R,).
        acts: Acts that led there, as `LEAF.acts`, int64 (R,).
        actions: Actions so far, int8 (R, decisions, N).
        waits: 1 if it must be driven a second on before it is looked at again, int64 (R,).
        steering: To what it is held in that second, (R, ...); of no meaning where it does not wait.
        memory: For a driver of AVs outside: what its AV remembers, -1 for nothing, int64 (R,).
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
    steering: Steering
    memory: NDArray[np.int64]
    top: NDArray[np.int64]
    tally: NDArray[np.int64]
    survey: Survey
    branches: Branches


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
        ratio=np.zeros((rows, MOST_PROPOSALS)),
        proposal=np.zeros(rows, dtype=np.int64),
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
        branches=allocate_branches(),
    )


def allocate_leaves(crashes: int, slots: int, decisions: int) -> Leaves:
    """Allocate room for so many crashes."""
    return Leaves(
        np.zeros(crashes, dtype=LEAF),
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
def survey_world(w: World, forest: Forest) -> tuple[float, Ahead]:
    """Survey a world at the begin of a second: who is near the AV, and what they may do.

    Returns:
        The danger of all near BVs together; what is ahead of the AV.
    """
    plan, setting, survey = forest.plan, forest.setting, forest.nursery.survey
    survey.n_left_out[0] = 0
    total, ahead = look_around(w, setting, plan.network, survey)
    least = total + plan.least_rise * max(total, plan.floor)
    list_acts(w, total, least, ahead, setting, plan.network, survey)
    list_pairs(w, ahead, setting, plan.network, survey)
    return total, ahead


@inlined_kernel
def value_of(total: float, forest: Forest) -> float:
    """Compute what counts as the danger of a surveyed world whose near BVs have a danger of `total`."""
    value: float = total + forest.plan.look_ahead * forest.nursery.survey.soon[0]
    return value


@inlined_kernel
def draw(row: int, nursery: Nursery) -> float:
    """Draw a number in (0, 1) that is the tree's own."""
    state = nursery.worlds.state[row, 0]
    tally = nursery.tally[row // nursery.depth]
    tally[DRAWS] += 1
    return uniform(block(state.seed, state.test, tally[DRAWS], 0, PURPOSE_ROULETTE)[0])


@inlined_kernel
def steering_of(row: int, nursery: Nursery) -> Steering:
    """To what a row is held in the second that it waits for."""
    held = nursery.steering
    return Steering(held.on[row], held.first[row], held.words[row])


@inlined_kernel
def wait(row: int, nursery: Nursery) -> Steering:
    """Let a row wait for its next second, held to nothing; returns its steering, to hold it to something."""
    nursery.waits[row] = 1
    steering = steering_of(row, nursery)
    let_go(steering, nursery.worlds.state[row, 0].n_vehicles)
    return steering
