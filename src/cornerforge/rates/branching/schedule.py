"""Trees of an AV outside the kernels, side by side: which worlds to drive next, what their AVs see, what they answer.

Any world that waits for its second may be driven, in any order: a tree looks at its worlds from the top of its stack
only, so it comes out the same. So many worlds of many trees wait for one answer of the AV together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.rates.branching.splitting import branch_out, drive_on, start_tree
from cornerforge.sim import AV_MUST_ANSWER, av_scene, lockstep, world_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.rates.branching.population import Population

__all__ = ["NO_TREE", "Schedule", "allocate_schedule", "answer", "branch_out_all", "look", "start_trees"]

NO_TREE = -1


class Schedule(NamedTuple):
    """Places for trees, and the rows of their particles (`population.Pool`).

    Attributes:
        tree: Index of the tree at each place, NO_TREE for none, int64 (T,).
        moves: 1 for each row that waits and was handed out to be driven, int64 (R,).
        rows, ranks: Rows that wait to be driven, and how far each is below the top of its stack, int64 (R,).
        ready: Places with a complete tree, int64 (T,).
    """

    tree: NDArray[np.int64]
    moves: NDArray[np.int64]
    rows: NDArray[np.int64]
    ranks: NDArray[np.int64]
    ready: NDArray[np.int64]


def allocate_schedule(places: int, depth: int) -> Schedule:
    """Allocate empty places for trees with so many rows each."""
    rows = places * depth
    return Schedule(
        tree=np.full(places, NO_TREE),
        moves=np.zeros(rows, dtype=np.int64),
        rows=np.zeros(rows, dtype=np.int64),
        ranks=np.zeros(rows, dtype=np.int64),
        ready=np.zeros(places, dtype=np.int64),
    )


@kernel
def start_trees(
    places: NDArray[np.int64],
    seed: int,
    first: int,
    index: int,
    population: Population,
    schedule: Schedule,
    trees: NDArray[np.void],
) -> None:
    """Begin the trees of `trees` from `index` on at free places, one each; tree k belongs to test first + k."""
    for m in range(places.size):
        place = places[m]
        start_tree(seed, first + index + m, place, population, trees[index + m])
        schedule.tree[place] = index + m


@kernel
def branch_out_all(population: Population, schedule: Schedule, trees: NDArray[np.void]) -> tuple[int, int]:
    """Branch out every tree with a driven topmost world, and list all worlds that wait to be driven.

    Returns:
        How many `schedule.rows` wait, and how many places are `ready`: their trees are complete, and they are free.
    """
    pool = population.pool
    waiting = 0
    ready = 0
    for place in range(schedule.tree.size):
        if schedule.tree[place] == NO_TREE:
            continue
        bottom = place * pool.depth
        is_driven = pool.waits[bottom + pool.top[place] - 1] == 0
        if is_driven and branch_out(place, population, trees[schedule.tree[place]]) < 0:
            schedule.tree[place] = NO_TREE
            schedule.ready[ready] = place
            ready += 1
            continue
        top = bottom + pool.top[place]
        for row in range(top - 1, bottom - 1, -1):
            if pool.waits[row] and schedule.moves[row] == 0:
                schedule.rows[waiting] = row
                schedule.ranks[waiting] = top - 1 - row
                waiting += 1
    return waiting, ready


@kernel
def look(rows: NDArray[np.int64], seats: NDArray[np.int64], population: Population, views: NDArray[np.float32]) -> None:
    """Write what the AV of each row sees into views[seat]."""
    for k in range(rows.size):
        w = world_row(population.pool.worlds, rows[k])
        av_scene.show_to_av(w, population.setting.road, population.scratch.av, views[seats[k]])


@kernel
def answer(
    rows: NDArray[np.int64],
    answers: NDArray[np.float64],
    population: Population,
    schedule: Schedule,
    driven: NDArray[np.bool_],
) -> None:
    """Let the AV of each row act as it answers, and go on to where it must answer again or its second ends.

    Args:
        rows: Rows that wait.
        answers: As for `lockstep.act`, one a row.
        population: Its setting's AV is OUTSIDE or STEERED.
        schedule: Schedule of the same rows; those driven move no more.
        driven: Receives for each row whether its second, or its test, is over.
    """
    for k in range(rows.size):
        row = rows[k]
        w = world_row(population.pool.worlds, row)
        lockstep.answer_with(w, answers[k], population.setting)
        driven[k] = drive_on(row, population) != AV_MUST_ANSWER
        schedule.moves[row] = 0 if driven[k] else 1
