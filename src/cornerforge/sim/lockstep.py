"""Many worlds side by side, for AVs that decide outside the kernels: the AV answers for all of them at once.

A batch of B worlds goes on from one decision of its AVs to the next: `see` writes what each AV sees, `act` takes their
answers and moves every world to where its AV decides again. A world stays idle after its test until `begin` gives it
another test. Worlds know nothing of each other, so a test comes out the same in any batch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.actions import ordered_lane
from cornerforge.sim.av_scene import show_to_av
from cornerforge.sim.av_view import VIEW_COLUMNS, VIEW_ROWS
from cornerforge.sim.controllers import STEERED
from cornerforge.sim.loop import AV_MUST_ANSWER, NEVER, OVER, advance, answer_as_av, steer_as_av
from cornerforge.sim.outcome import IDLE, RUNNING
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import World, allocate_worlds, world_row
from cornerforge.types import HIGHEST_COMMAND, LOWEST_COMMAND

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
        views: What each AV sees (`av_scene.show_to_av`), (B, rows, columns); zeros where a world is idle.
    """

    worlds: World
    views: NDArray[Any]


def allocate_batch(
    n_worlds: int, slots: int, views: NDArray[Any] | None = None, road: RoadNumbers | None = None
) -> Batch:
    """A batch of idle worlds; `views` is where what AVs see is written, None: float32 (B, 13, 8).

    `road`: of the tests; None: a road on which the AV sees at once.
    """
    if views is None:
        views = np.zeros((n_worlds, VIEW_ROWS, VIEW_COLUMNS), dtype=np.float32)
    return Batch(allocate_worlds(n_worlds, slots, road), views)


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
def answer_with(w: World, answer: NDArray[np.float64], setting: Setting) -> None:
    """Answer for an AV outside as it gave it, (`Setting.answer_width`,); accelerations [m/s2] are cut to [-8, 2]."""
    if setting.who.av == STEERED:
        steer_as_av(w, answer)
    else:
        command = min(max(answer[0], LOWEST_COMMAND), HIGHEST_COMMAND)
        answer_as_av(w, command, ordered_lane(w, 0, int(np.sign(answer[1])), setting.road))


@kernel
def see(batch: Batch, setting: Setting, s: Scratch) -> None:
    """Write what the AV of each world sees into `batch.views`; zeros for idle worlds."""
    for b in range(batch.views.shape[0]):
        w = world_row(batch.worlds, b)
        if w.state[0].outcome == RUNNING:
            show_to_av(w, setting.road, s.av, batch.views[b])
        else:
            batch.views[b] = 0.0


@kernel
def act(
    answers: NDArray[np.float64], as_lanes: bool, setting: Setting, batch: Batch, s: Scratch, keep: Keep,
    done: NDArray[np.int64],
) -> int:  # fmt: skip
    """Let the AV of every world that is not idle act, and go on to where it decides again or its test ends.

    Args:
        answers: float64 (B, W), finite (`answer_with`).
        as_lanes: Take the second column as a target lane, and accelerations as they are: answers of a built-in AV.
        setting: The run; its AV is OUTSIDE or STEERED.
        batch: The worlds; a test that ends leaves its world idle, with its outcome in the world's state.
        s: Scratch.
        keep: What is kept; frames and decisions only where B is 1.
        done: int64 (B,): receives the worlds with a test that has just ended.

    Returns:
        The number of worlds in `done`.
    """
    ended = 0
    for b in range(answers.shape[0]):
        w = world_row(batch.worlds, b)
        if w.state[0].outcome != RUNNING:
            continue
        if as_lanes:
            answer_as_av(w, answers[b, 0], int(answers[b, 1]))
        else:
            answer_with(w, answers[b], setting)
        if advance(w, setting, s, keep, NEVER) == OVER:
            done[ended] = b
            ended += 1
    return ended


@kernel
def drive_answered(
    w: World, seed: int, test: int, answers: NDArray[np.float64], setting: Setting, s: Scratch, keep: Keep
) -> None:
    """Drive a test once more with the answers that its AV gave, (A, W); it stops where more would be needed."""
    reset_world(w, seed, test, setting)
    for k in range(answers.shape[0]):
        if advance(w, setting, s, keep, NEVER) != AV_MUST_ANSWER:
            return
        answer_with(w, answers[k], setting)
    advance(w, setting, s, keep, NEVER)
