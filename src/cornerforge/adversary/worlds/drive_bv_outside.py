"""One second of driving as a learning step of the adversary, against an AV that decides outside the kernels.

Like `drive_bv.collect`, in pieces: `begin_seconds` lets the critical BVs choose, `look` and `go_on` take turns with the
AV until the second is over, `end_seconds` completes the transitions. Worlds are named by their rows in `Actors`; an AV
that is asked for some of them has a seat for each, a row of its views and answers.

An AV that was made anew must be shown what it saw in tests that go on: `look_back` and `go_on_again` drive these tests
again in other worlds, from their starts, with the actions and answers of then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import kernel
from cornerforge.adversary.worlds.drive_bv import advance_again, choose, settle, start_next
from cornerforge.sim import (
    World,
    advance,
    answer_as_bv,
    av_scene,
    lockstep,
    look_as_bv,
    outcome,
    reset_world,
    world_row,
)  # fmt: skip

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.adversary.worlds.drive_bv import Actors, Exploring, Transitions
    from cornerforge.adversary.worlds.rewards import RewardNumbers
    from cornerforge.sim import Keep, Scratch, Setting

__all__ = [
    "abandon", "begin_seconds", "begin_to_steer", "early", "end_seconds", "go_on", "go_on_again", "look", "look_back",
    "running",
]  # fmt: skip


def early(rows: NDArray[np.int64], actors: Actors) -> NDArray[np.int64]:
    """List the seats in whose worlds the adversary does not steer yet, ascending."""
    state = actors.worlds.state[rows, 0]
    return np.flatnonzero(state["decisions"] < state["steers_from"])


def running(rows: NDArray[np.int64], actors: Actors) -> NDArray[np.int64]:
    """List the seats whose worlds drive a test, ascending; rows[seat] is the world's row."""
    return np.flatnonzero(actors.worlds.state["outcome"][rows, 0] == outcome.RUNNING)


def abandon(rows: NDArray[np.int64], actors: Actors) -> None:
    """Give up the tests of some worlds, because the AV failed in them."""
    actors.worlds.state["outcome"][rows] = outcome.AV_FAULT


@kernel
def begin_seconds(rows: NDArray[np.int64], exploring: Exploring, actors: Actors, s: Scratch, out: Transitions) -> None:
    """Let the critical BV of each row choose, and note what it sees and does in the row's transition."""
    for k in range(rows.size):
        b = rows[k]
        answer_as_bv(world_row(actors.worlds, b), choose(b, exploring, actors, s, out))


@kernel
def look(
    rows: NDArray[np.int64], seats: NDArray[np.int64], worlds: World, setting: Setting, s: Scratch,
    views: NDArray[np.float32],
) -> None:  # fmt: skip
    """Write what the AV of world rows[seat] sees into views[seat], for `seats`; zeros into all others."""
    views[:] = 0.0
    for k in range(seats.size):
        w = world_row(worlds, rows[seats[k]])
        av_scene.show_to_av(w, setting.road, s.av, views[seats[k]])


@kernel
def go_on(
    rows: NDArray[np.int64], seats: NDArray[np.int64], answers: NDArray[np.float64], actors: Actors, setting: Setting,
    s: Scratch, keep: Keep,
) -> None:  # fmt: skip
    """Let the AV of world rows[seat] act as answers[seat] says, for `seats`, until it must answer again.

    A world stands still at the end of the second that it is in. The answers (S, W) are as for
    `lockstep.answer_with`, and are noted in the history.
    """
    history = actors.history
    for k in range(seats.size):
        seat = seats[k]
        b = rows[seat]
        w = world_row(actors.worlds, b)
        for k in range(answers.shape[1]):
            history.answers[b, history.answered[b], k] = answers[seat, k]
        history.answered[b] += 1
        until = w.state[0].decisions + (1 if w.state[0].substep == 0 else 0)
        lockstep.answer_with(w, answers[seat], setting)
        advance(w, setting, s, keep, until)


@kernel
def end_seconds(
    rows: NDArray[np.int64], exploring: Exploring, setting: Setting, reward: RewardNumbers, actors: Actors, s: Scratch,
    keep: Keep, out: Transitions,
) -> None:  # fmt: skip
    """Complete the transition of each row, whose second is over, and start its next test if due (`drive_bv.settle`)."""
    for k in range(rows.size):
        settle(rows[k], exploring, setting, reward, actors, s, keep, out)


@kernel
def begin_to_steer(
    rows: NDArray[np.int64], exploring: Exploring, setting: Setting, s: Scratch, keep: Keep, actors: Actors
) -> None:
    """Let the adversary look where it begins to steer now; where a test ended before, or has no BV, begin the next."""
    for b in rows:
        w, seen, allowed = world_row(actors.worlds, b), actors.observation[b], actors.allowed[b]
        runs = w.state[0].outcome == outcome.RUNNING
        if runs and w.state[0].decisions != w.state[0].steers_from:
            continue
        if not runs or look_as_bv(w, setting, s, seen, allowed) < 0:
            start_next(b, exploring, setting, s, keep, actors)


@kernel
def look_back(
    rows: NDArray[np.int64], seats: NDArray[np.int64], actors: Actors, setting: Setting, again: World
) -> None:
    """Put world `seat` of `again`, for `seats`, at the start of the test that world rows[seat] is in."""
    for k in range(seats.size):
        state = world_row(actors.worlds, rows[seats[k]]).state[0]
        reset_world(world_row(again, seats[k]), state.seed, state.test, setting)


@kernel
def go_on_again(
    rows: NDArray[np.int64], seats: NDArray[np.int64], moments: NDArray[np.int64], actors: Actors, setting: Setting,
    s: Scratch, keep: Keep, again: World,
) -> None:  # fmt: skip
    """Let the AV of world `seat` of `again` act as in world rows[seat] at its answer moments[k], for each seats[k]."""
    history = actors.history
    for k in range(seats.size):
        b = rows[seats[k]]
        w = world_row(again, seats[k])
        lockstep.answer_with(w, history.answers[b, moments[k]], setting)
        advance_again(history, b, w, setting, s, keep)
