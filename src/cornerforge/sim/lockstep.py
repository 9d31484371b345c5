"""Many worlds side by side, for AVs that decide outside the kernels: all wait until the AV has answered for all.

A batch of B worlds goes on from one decision of its AVs to the next: `see` writes what each AV sees, `act` takes their
answers and moves every world to where its AV decides again. A world whose test is over stays idle until `begin` gives
it another test. Worlds know nothing of each other, so a test comes out the same in any batch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.sim.actions import HIGHEST_COMMAND, LOWEST_COMMAND, ordered_lane
from cornerforge.sim.adversaries import ChoiceScratch
from cornerforge.sim.av_view import VIEW_COLUMNS, VIEW_ROWS, view_of_av
from cornerforge.sim.drive import Decisions, Setting, choose_hostile, record_choice, start_test, world_row
from cornerforge.sim.reach import Pairs, allocate_pairs
from cornerforge.sim.statistics import (
    BV_TRAVEL_MM,
    Census,
    Counts,
    allocate_counts,
    count_av,
    count_choices,
    count_states,
)
from cornerforge.sim.step import SUBSTEPS, av_acts, begin_second, move_on
from cornerforge.sim.world import (
    CONTROLLED,
    N_BV_CRASHES,
    N_DECISIONS,
    OUTCOME,
    RUNNING,
    World,
    allocate_worlds,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.world import RoadNumbers

__all__ = [
    "IDLE",
    "Batch",
    "act",
    "allocate_batch",
    "begin",
    "see",
]

IDLE = -1
"""Test number of a world that drives none."""


class Batch(NamedTuple):
    """B worlds in the middle of their tests.

    Attributes:
        worlds: Their states, (B, ...).
        pairs, n_pairs: Which vehicles can touch within the running second, (B, ...) and (B,).
        test: Number of the test that each drives, IDLE for none, int64 (B,).
        substep: How many substeps of the running second are over, int64 (B,).
        travel: Metres that the counted BVs of the test drove, float64 (B,).
        crashes: Crashes between BVs before the running second, int64 (B,).
        seen: What is counted of each world's BVs within the running second (`Counts.seen`), (B, N).
        views: What each AV sees, float32 (B, 13, 8); zeros where a world is idle.
        found: Scratch.
    """

    worlds: World
    pairs: Pairs
    n_pairs: NDArray[np.int64]
    test: NDArray[np.int64]
    substep: NDArray[np.int64]
    travel: NDArray[np.float64]
    crashes: NDArray[np.int64]
    seen: NDArray[np.void]
    views: NDArray[np.float32]
    found: NDArray[np.int64]


def allocate_batch(n_worlds: int, slots: int) -> Batch:
    """A batch of idle worlds."""
    one = allocate_pairs(slots)
    return Batch(
        worlds=allocate_worlds(n_worlds, slots),
        pairs=Pairs(
            np.zeros((n_worlds, one.a.size), dtype=np.int64),
            np.zeros((n_worlds, one.b.size), dtype=np.int64),
            np.zeros((n_worlds, slots)),
            np.zeros((n_worlds, slots)),
            np.zeros((n_worlds, one.is_watched.size), dtype=np.int64),
            np.zeros((n_worlds, one.ahead.size)),
            np.zeros((n_worlds, one.behind.size)),
            one.av,
        ),
        n_pairs=np.zeros(n_worlds, dtype=np.int64),
        test=np.full(n_worlds, IDLE, dtype=np.int64),
        substep=np.zeros(n_worlds, dtype=np.int64),
        travel=np.zeros(n_worlds),
        crashes=np.zeros(n_worlds, dtype=np.int64),
        seen=np.zeros((n_worlds, slots), dtype=allocate_counts().seen.dtype),
        views=np.zeros((n_worlds, VIEW_ROWS, VIEW_COLUMNS), dtype=np.float32),
        found=np.zeros(VIEW_ROWS - 1, dtype=np.int64),
    )


@kernel
def begin(seed: int, chosen: NDArray[np.int64], tests: NDArray[np.int64], setting: Setting, batch: Batch) -> None:
    """Put world chosen[k] at the start of test tests[k] of a seed, for each k."""
    for k in range(chosen.size):
        b = chosen[k]
        start_test(world_row(batch.worlds, b), seed, tests[k], setting)
        batch.test[b] = tests[k]
        batch.substep[b] = 0
        batch.travel[b] = 0.0
        batch.crashes[b] = 0


@kernel
def see(batch: Batch, road: RoadNumbers) -> None:
    """Write what the AV of each world sees into `batch.views`; zeros for idle worlds."""
    for b in range(batch.test.size):
        if batch.test[b] == IDLE:
            for row in range(VIEW_ROWS):
                for column in range(VIEW_COLUMNS):
                    batch.views[b, row, column] = 0.0
        else:
            view_of_av(world_row(batch.worlds, b), road, batch.found, batch.views[b])


@kernel
def _begin_second(
    w: World, seed: int, test: int, command: float, lane: int, setting: Setting, pairs: Pairs, s: ChoiceScratch,
    decisions: Decisions,
) -> int:  # fmt: skip
    """The adversary chooses, everybody begins to act; the order of things is that of `drive_test`."""
    step = w.info[N_DECISIONS]
    recorded = step < decisions.controlled.size
    action = -1
    bv = -1
    log_prob_policy = 0.0
    w.info[CONTROLLED] = -1
    if setting.adversary > 0 or recorded:
        bv, action, log_prob_policy = choose_hostile(w, seed, test, setting, lane, recorded, s)
    n_pairs = begin_second(
        w, seed, test, setting.bv_model, action, command, lane, True, setting.road, setting.av, setting.tables, pairs
    )
    if recorded:
        record_choice(w, step, bv, log_prob_policy, s, decisions)
    return n_pairs


@kernel
def act(
    seed: int, answers: NDArray[np.float64], as_lanes: bool, setting: Setting, batch: Batch, s: ChoiceScratch,
    recording: NDArray[np.void], decisions: Decisions, counts: Counts, census: Census, done: NDArray[np.int64],
) -> int:  # fmt: skip
    """Let the AV of every world that is not idle act, and go on to where it decides again or its test ends.

    Args:
        seed: Of all tests.
        answers: float64 (B, 2): acceleration [m/s2], cut to [-8, 2], and lane order (`ordered_lane`); finite.
        as_lanes: The second column is a target lane instead, and accelerations are taken as they are: the answers of a
            built-in AV.
        setting: The run.
        batch: The worlds; a test that ends leaves its world idle, with its outcome in the world's `info`.
        s: Scratch.
        recording, decisions: Of size 0, or large enough for one test when B is 1.
        counts, census: Histograms to add to, and what to count.
        done: int64 (B,): receives the worlds whose test has just ended.

    Returns:
        How many those are.
    """
    road = setting.road
    ended = 0
    for b in range(batch.test.size):
        test = batch.test[b]
        if test == IDLE:
            continue
        w = world_row(batch.worlds, b)
        pairs = Pairs(
            batch.pairs.a[b],
            batch.pairs.b[b],
            batch.pairs.least[b],
            batch.pairs.most[b],
            batch.pairs.is_watched[b],
            batch.pairs.ahead[b],
            batch.pairs.behind[b],
            batch.pairs.av,
        )
        command = answers[b, 0]
        lane = int(answers[b, 1])
        if not as_lanes:
            command = min(max(command, LOWEST_COMMAND), HIGHEST_COMMAND)
            lane = ordered_lane(w, 0, int(np.sign(answers[b, 1])), road)
        step = w.info[N_DECISIONS] - (batch.substep[b] > 0)
        counting = census.on and census.first <= step < census.until
        own = Counts(counts.histograms, counts.joint, counts.totals, batch.seen[b])
        if batch.substep[b] == 0:
            if counting:
                batch.crashes[b] = w.info[N_BV_CRASHES]
                count_av(w, road, counts)
                batch.travel[b] += count_states(w, step, road, own, census)
            batch.n_pairs[b] = _begin_second(w, seed, test, command, lane, setting, pairs, s, decisions)
        else:
            av_acts(w, command, lane, road)
        over = False
        while True:
            over = move_on(w, batch.substep[b], pairs, batch.n_pairs[b], road, recording)
            batch.substep[b] += 1
            if over or batch.substep[b] == SUBSTEPS or batch.substep[b] % road.av_substeps == 0:
                break
        if (over or batch.substep[b] == SUBSTEPS) and counting:
            count_choices(w, batch.crashes[b], road, own)
        if batch.substep[b] == SUBSTEPS:
            batch.substep[b] = 0
        if over or w.info[OUTCOME] != RUNNING:
            if census.on:
                counts.totals[BV_TRAVEL_MM] += int(batch.travel[b] * 1000.0)
            batch.test[b] = IDLE
            done[ended] = b
            ended += 1
    return ended
