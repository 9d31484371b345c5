"""Trees of an AV outside the kernels, side by side: which worlds to drive next, what their AVs see, what they answer.

Any world that waits for its second may be driven, in any order: a tree looks at its worlds from the top of its stack
only, so it comes out the same. So many worlds of many trees wait for one answer of the AV together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge.sim.av_scene import show_to_av
from cornerforge.sim.lockstep import answer_with
from cornerforge.sim.loop import AV_MUST_ANSWER
from cornerforge.sim.trees import branch_out, drive_on, plant
from cornerforge.sim.world import world_row

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.forest import Forest

__all__ = ["NO_TREE", "Grove", "allocate_grove", "answer", "look", "plant_at", "tend"]

NO_TREE = -1


class Grove(NamedTuple):
    """Places where trees grow, and rows of their worlds (`forest.Nursery`).

    Attributes:
        root: Index of the tree at each place, NO_TREE for none, int64 (T,).
        moves: 1 for each row that waits and was handed out to be driven, int64 (R,).
        rows, ranks: Rows that wait to be driven, and how far each is below the top of its stack, int64 (R,).
        ready: Places whose tree is complete, int64 (T,).
    """

    root: NDArray[np.int64]
    moves: NDArray[np.int64]
    rows: NDArray[np.int64]
    ranks: NDArray[np.int64]
    ready: NDArray[np.int64]


def allocate_grove(places: int, depth: int) -> Grove:
    """Allocate empty places for trees with so many rows each."""
    rows = places * depth
    return Grove(
        root=np.full(places, NO_TREE),
        moves=np.zeros(rows, dtype=np.int64),
        rows=np.zeros(rows, dtype=np.int64),
        ranks=np.zeros(rows, dtype=np.int64),
        ready=np.zeros(places, dtype=np.int64),
    )


@kernel
def plant_at(
    places: NDArray[np.int64], seed: int, first: int, index: int, forest: Forest, grove: Grove, roots: NDArray[np.void]
) -> None:
    """Begin the trees of `roots` from `index` on at free places, one each; tree k is that of test first + k."""
    for m in range(places.size):
        place = places[m]
        plant(seed, first + index + m, place, forest, roots[index + m])
        grove.root[place] = index + m


@kernel
def tend(forest: Forest, grove: Grove, roots: NDArray[np.void]) -> tuple[int, int]:
    """Branch out every tree whose topmost world has been driven, and list all worlds that wait to be driven.

    Returns:
        How many `grove.rows` wait, and how many places are `ready`: their roots are complete, and they are free.
    """
    nursery = forest.nursery
    waiting = 0
    ready = 0
    for place in range(grove.root.size):
        if grove.root[place] == NO_TREE:
            continue
        bottom = place * nursery.depth
        is_driven = nursery.waits[bottom + nursery.top[place] - 1] == 0
        if is_driven and branch_out(place, forest, roots[grove.root[place]]) < 0:
            grove.root[place] = NO_TREE
            grove.ready[ready] = place
            ready += 1
            continue
        top = bottom + nursery.top[place]
        for row in range(top - 1, bottom - 1, -1):
            if nursery.waits[row] and grove.moves[row] == 0:
                grove.rows[waiting] = row
                grove.ranks[waiting] = top - 1 - row
                waiting += 1
    return waiting, ready


@kernel
def look(rows: NDArray[np.int64], seats: NDArray[np.int64], forest: Forest, views: NDArray[np.float32]) -> None:
    """Write what the AV of each row sees into views[seat]."""
    for k in range(rows.size):
        w = world_row(forest.nursery.worlds, rows[k])
        show_to_av(w, forest.setting.road, forest.scratch.av.found, views[seats[k]])


@kernel
def answer(
    rows: NDArray[np.int64], answers: NDArray[np.float64], forest: Forest, grove: Grove, driven: NDArray[np.bool_]
) -> None:
    """Let the AV of each row act as it answers, and go on to where it must answer again or its second ends.

    Args:
        rows: Rows that wait.
        answers: As for `lockstep.act`, one a row.
        forest: Its setting's AV is OUTSIDE or STEERED.
        grove: Of the same rows; those driven move no more.
        driven: Receives for each row whether its second, or its test, is over.
    """
    for k in range(rows.size):
        row = rows[k]
        w = world_row(forest.nursery.worlds, row)
        answer_with(w, answers[k], forest.setting)
        driven[k] = drive_on(row, forest) != AV_MUST_ANSWER
        grove.moves[row] = 0 if driven[k] else 1
