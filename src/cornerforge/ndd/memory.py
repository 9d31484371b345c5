"""Memory of a naturalistic driver: its acceleration depends on its own last one and on its habit."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import uniform
from cornerforge._schema import Share, meant

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

__all__ = [
    "Memory",
    "MemoryNumbers",
    "away_chance",
    "away_draw",
    "given_the_past",
    "memory_numbers",
    "own_rank",
    "own_word",
    "reflected",
    "remembered_share",
    "remembering_word",
    "word_at",
]

_LAST_WORD = np.int64(0xFFFFFFFF)
_FINEST = 2.0**-32
"""Steps of random numbers."""
_LOW_HALF, _HALF = np.uint64(0xFFFF), np.uint64(16)
_POINTS = 16
"""Points at which `given_the_past` looks at the quantile of a recorded acceleration, known only to its bin."""
_Width = Annotated[float, meant("Of a neighbourhood.", "", 0.001, 1)]


@dataclass(frozen=True)
class Memory:
    """How a follower's acceleration depends on its own past and on its habit; all weights 0: not at all.

    An acceleration is the quantile u of its distribution in the present state. With the weight `near`, u is near the
    quantile of the second before; with `far`, less near; with `habit`, near the driver's habit, a quantile that stays
    the same for the whole test; else uniform. "Near" is uniform within the width, reflected at 0 and 1. So u is uniform
    over all drivers, for any weights: the tables stay the distributions over all drivers, and what they call impossible
    stays impossible. (A series with a copula between neighbours: Chen and Fan 2006, doi:10.1016/j.jeconom.2005.03.004.)

    With the chance `away` a second, times a factor of its own, a driver looks away from the road, and does so again in
    the next second with the chance `away_again`, the same for all. A driver that looks away holds its speed, begins no
    lane change and turns back in none.
    """

    near: Share = 0.0
    near_width: _Width = 0.1
    far: Share = 0.0
    far_width: _Width = 0.3
    habit: Share = 0.0
    habit_width: _Width = 0.1
    away: Share = 0.0
    away_again: Share = 0.0


class MemoryNumbers(NamedTuple):
    """`Memory` as kernels take it: the same names and order, and one thing that follows from them.

    Attributes:
        ways: The quantile, before it is reflected, is linear in what it depends on. A row for each way to remember
            (near, far, habit, not at all): a constant, and the factors of the quantile of the second before, of the
            habit and of the random number, (4, 4).
    """

    near: float
    near_width: float
    far: float
    far_width: float
    habit: float
    habit_width: float
    away: float
    away_again: float
    ways: NDArray[np.float64]


def memory_numbers(memory: Memory) -> MemoryNumbers:
    """Make the constants of a memory for the kernels."""
    m = memory
    ways = np.zeros((4, 4))
    low = 0.0
    for way, (weight, width, factor) in enumerate(
        ((m.near, m.near_width, 1), (m.far, m.far_width, 1), (m.habit, m.habit_width, 2))
    ):
        ways[way, factor] = 1.0
        ways[way, 3] = 2.0 * width / max(weight, _FINEST)
        ways[way, 0] = -width - ways[way, 3] * low
        low += weight
    ways[3, 3] = 1.0 / max(1.0 - low, _FINEST)
    ways[3, 0] = -ways[3, 3] * low
    said = {name: float(number) for name, number in asdict(memory).items()}
    return MemoryNumbers(**said, ways=ways)


@inlined_kernel
def reflected(u: float) -> float:
    """Reflect a quantile between -1 and 2 into 0 to 1."""
    u = abs(u)
    return min(u, 2.0 - u)


@inlined_kernel
def word_at(u: float) -> uint64:
    """Find the random word of a quantile u, 0 to 1; `uniform(word)` gives the word itself."""
    return np.uint64(min(np.int64(u * 4294967296.0), _LAST_WORD))


@inlined_kernel
def own_rank(share: float, noise: float) -> float:
    """Compute P(a driver's acceleration is below a quantile of all drivers), for a driver of some noise level.

    It uses the outer quarters of the distribution with density 1 + noise, the middle half with 1 - noise. So drivers of
    levels symmetric about 0 have the distribution of all drivers together, exactly, and each has its support.

    Args:
        share: The quantile, P(acceleration is below) over all drivers, 0 to 1.
        noise: The driver's noise level, above -1, below 1; 0: as all drivers, and `share` to the bit.
    """
    return share + noise * max(min(share, 0.5 - share), share - 1.0)


@inlined_kernel
def own_word(word: uint64, noise: float) -> uint64:
    """Turn the random word of a driver's own rank into the word of the quantile of all drivers: inverse of `own_rank`.

    With a noise level of 0 it is the word itself.
    """
    off = uniform(word) - 0.5
    middle = min(abs(off), 0.25 * (1.0 - noise))
    stretch = 1.0 / (1.0 - noise * noise)
    # From the median the density is 1 - noise, then 1 + noise: sums, and no way to go that the processor must guess.
    way = (1.0 + noise) * stretch * middle + (1.0 - noise) * stretch * (abs(off) - middle)
    return word_at(0.5 + math.copysign(way, off))


@inlined_kernel
def remembering_word(word: uint64, before: float, habit: float, memory: MemoryNumbers) -> uint64:
    """Turn a random word into one that remembers (`ndd.model.Memory`); without memory it stays as it is.

    Args:
        word: 32 random bits.
        before: Quantile of the driver's acceleration in the second before.
        habit: Its habit, a quantile.
        memory: Weights and widths.
    """
    draw = uniform(word)
    known = memory.near + memory.far
    # A row of numbers, not ways to go: the processor could not guess them.
    way = np.int64(draw >= memory.near) + np.int64(draw >= known) + np.int64(draw >= known + memory.habit)
    m = memory.ways
    return word_at(reflected(m[way, 0] + m[way, 1] * before + m[way, 2] * habit + m[way, 3] * draw))


@inlined_kernel
def away_chance(before: int, inattention: float, memory: MemoryNumbers) -> float:
    """Compute P(a driver looks away in this second), given whether (1 or 0) it did in the second before.

    `inattention`, 0 or more, is how many times as often as all drivers this one begins to look away.
    """
    return memory.away_again if before else min(1.0, inattention * memory.away)


@inlined_kernel
def away_draw(first: uint64, second: uint64) -> float:
    """Make a number in (0, 1) of the low halves of two random words; their high halves serve something else."""
    return uniform((first & _LOW_HALF) | ((second & _LOW_HALF) << _HALF))


@inlined_kernel
def _share_near(u: float, centre: float, width: float) -> float:
    """Compute P(U <= u) for U uniform within `width` of `centre`, reflected at 0 and 1; u in 0 to 1."""
    low = centre - width
    scale = 0.5 / width
    inside = min(1.0, max(0.0, (u - low) * scale)) - min(1.0, max(0.0, (-u - low) * scale))
    return inside + min(1.0, max(0.0, (2.0 + u - low) * scale)) - min(1.0, max(0.0, (2.0 - u - low) * scale))


@inlined_kernel
def remembered_share(u: float, before: float, habit: float, memory: MemoryNumbers) -> float:
    """Compute P(U <= u) for the quantile U that `remembering_word` draws; u itself without memory."""
    share = (1.0 - memory.near - memory.far - memory.habit) * u
    if memory.near > 0.0:
        share += memory.near * _share_near(u, before, memory.near_width)
    if memory.far > 0.0:
        share += memory.far * _share_near(u, before, memory.far_width)
    if memory.habit > 0.0:
        share += memory.habit * _share_near(u, habit, memory.habit_width)
    return share


@kernel
def given_the_past(
    p: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64], memory: MemoryNumbers
) -> None:
    """Turn probabilities over all drivers into probabilities given the bin of the last acceleration.

    The quantile was uniform within its bin. The habit is not known, so its part stays that over all drivers.

    Args:
        p: P(acceleration) in the present state, float64 (n, 31), rows sum to 1; replaced.
        low, high: Ends of the last acceleration's bin as quantiles in the state that it was chosen in, (n,); NaN where
            the past is not known, and then the row stays.
        memory: Weights and widths.
    """
    weight = 1.0 / _POINTS
    blank = 1.0 - memory.near - memory.far
    for row in range(p.shape[0]):
        if not low[row] <= high[row]:
            continue
        total = 0.0
        before = 0.0
        for a in range(p.shape[1]):
            total += p[row, a]
            u = min(total, 1.0)
            share = blank * u
            for point in range(_POINTS):
                centre = low[row] + (high[row] - low[row]) * (point + 0.5) * weight
                if memory.near > 0.0:
                    share += weight * memory.near * _share_near(u, centre, memory.near_width)
                if memory.far > 0.0:
                    share += weight * memory.far * _share_near(u, centre, memory.far_width)
            p[row, a] = share - before
            before = share
