"""Many worlds side by side, for AVs that decide outside the kernels: the AV answers for all of them at once.

A batch of B worlds goes on from one decision of its AVs to the next: `see` writes what each AV sees, `act` takes their
answers and moves every world to where its AV decides again. A world whose test is over stays idle until `begin` gives
it another test. Worlds know nothing of each other, so a test comes out the same in any batch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.actions import HIGHEST_COMMAND, LOWEST_COMMAND, ordered_lane
from cornerforge.sim.av_view import VIEW_COLUMNS, VIEW_ROWS, view_of_av
from cornerforge.sim.loop import AV_MUST_ANSWER, NEVER, OVER, advance, answer_as_av
from cornerforge.sim.sight import VISIBLE
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import IDLE, RUNNING, World, allocate_worlds, world_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.keep import Keep
    from cornerforge.sim.scratch import Scratch
    from cornerforge.sim.setting import Setting

__all__ = [
    "Batch",
    "act",
    "allocate_batch",
    "answer_with",
    "begin",
    "drive_answered",
    "idle",
    "running",
    "see",
    "stop",
]


class Batch(NamedTuple):
    """B worlds in the middle of their tests.

    Attributes:
        worlds: Their states, (B, ...).
        views: What each AV sees, float32 (B, 13, 8); zeros where a world is idle.
    """

    worlds: World
    views: NDArray[np.float32]


def allocate_batch(n_worlds: int, slots: int) -> Batch:
    """A batch of idle worlds."""
    return Batch(allocate_worlds(n_worlds, slots), np.zeros((n_worlds, VIEW_ROWS, VIEW_COLUMNS), dtype=np.float32))


def running(batch: Batch) -> NDArray[np.int64]:
    """List the worlds that drive a test, ascending."""
    return np.flatnonzero(batch.worlds.state["outcome"][:, 0] == RUNNING)


def idle(batch: Batch) -> NDArray[np.int64]:
    """List the worlds that drive no test, ascending."""
    return np.flatnonzero(batch.worlds.state["outcome"][:, 0] != RUNNING)


def stop(batch: Batch, worlds: NDArray[np.int64]) -> None:
    """Make worlds idle in the middle of their tests."""
    batch.worlds.state["outcome"][worlds] = IDLE


@kernel
def begin(seed: int, chosen: NDArray[np.int64], tests: NDArray[np.int64], setting: Setting, batch: Batch) -> None:
    """Put world chosen[k] at the start of test tests[k] of a seed, for each k."""
    for k in range(chosen.size):
        reset_world(world_row(batch.worlds, chosen[k]), seed, tests[k], setting)


@inlined_kernel
def answer_with(w: World, acceleration: float, order: float, road: RoadNumbers) -> None:
    """Answer for an AV outside as it gave it: an acceleration [m/s2], cut to [-8, 2], and a lane order."""
    command = min(max(acceleration, LOWEST_COMMAND), HIGHEST_COMMAND)
    answer_as_av(w, command, ordered_lane(w, 0, int(np.sign(order)), road))


@kernel
def see(batch: Batch, setting: Setting, s: Scratch) -> None:
    """Write what the AV of each world sees into `batch.views`; zeros for idle worlds."""
    for b in range(batch.views.shape[0]):
        w = world_row(batch.worlds, b)
        if w.state[0].outcome == RUNNING:
            view_of_av(w, setting.road, VISIBLE, s.av.found, batch.views[b])
        else:
            for row in range(VIEW_ROWS):
                for column in range(VIEW_COLUMNS):
                    batch.views[b, row, column] = 0.0


@kernel
def act(
    answers: NDArray[np.float64], as_lanes: bool, setting: Setting, batch: Batch, s: Scratch, keep: Keep,
    done: NDArray[np.int64],
) -> int:  # fmt: skip
    """Let the AV of every world that is not idle act, and go on to where it decides again or its test ends.

    Args:
        answers: float64 (B, 2): acceleration [m/s2], cut to [-8, 2], and lane order (`ordered_lane`); finite.
        as_lanes: Take the second column as a target lane, and accelerations as they are: answers of a built-in AV.
        setting: The run, whose AV is OUTSIDE.
        batch: The worlds; a test that ends leaves its world idle, with its outcome in the world's state.
        s: Scratch.
        keep: What is kept; frames and decisions only where B is 1.
        done: int64 (B,): receives the worlds whose test has just ended.

    Returns:
        The number of worlds in `done`.
    """
    road = setting.road
    ended = 0
    for b in range(answers.shape[0]):
        w = world_row(batch.worlds, b)
        if w.state[0].outcome != RUNNING:
            continue
        if as_lanes:
            answer_as_av(w, answers[b, 0], int(answers[b, 1]))
        else:
            answer_with(w, answers[b, 0], answers[b, 1], road)
        if advance(w, setting, s, keep, NEVER) == OVER:
            done[ended] = b
            ended += 1
    return ended


@kernel
def drive_answered(
    w: World, seed: int, test: int, answers: NDArray[np.float64], setting: Setting, s: Scratch, keep: Keep
) -> None:
    """Drive a test once more with the answers that its AV gave, (A, 2); it stops where more would be needed."""
    reset_world(w, seed, test, setting)
    for k in range(answers.shape[0]):
        if advance(w, setting, s, keep, NEVER) != AV_MUST_ANSWER:
            return
        answer_with(w, answers[k, 0], answers[k, 1], setting.road)
    advance(w, setting, s, keep, NEVER)
