"""What a naturalistic driver remembers: its acceleration depends on its own last one and on its habit."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import uniform

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

_LAST_WORD = np.uint64(0xFFFFFFFF)
_LOW_HALF, _HALF = np.uint64(0xFFFF), np.uint64(16)
_POINTS = 16
"""Points at which `given_the_past` looks at the quantile of a recorded acceleration, known only to its bin."""


@dataclass(frozen=True)
class Memory:
    """How a follower's acceleration depends on its own past and on its habit; all weights 0: not at all.

    An acceleration is the quantile u of its distribution in the present state. With the weight `near`, u is near the
    quantile of the second before; with `far`, less near; with `habit`, near the driver's habit, a quantile that stays
    the same for the whole test; else uniform. "Near" is uniform within the width, reflected at 0 and 1. So u is uniform
    over all drivers, whatever the weights: the tables stay the distributions over all drivers, and what they call
    impossible stays impossible. (A series with a copula between neighbours: Chen and Fan 2006,
    doi:10.1016/j.jeconom.2005.03.004.)

    With the chance `away` a second, times a factor of its own, a driver looks away from the road, and does so again in
    the next second with the chance `away_again`, the same for all. Who looks away holds its speed, begins no lane
    change and turns back in none.
    """

    near: float = 0.0
    near_width: float = 0.1
    far: float = 0.0
    far_width: float = 0.3
    habit: float = 0.0
    habit_width: float = 0.1
    away: float = 0.0
    away_again: float = 0.0


class MemoryNumbers(NamedTuple):
    """`Memory` as kernels take it: the same names and order."""

    near: float
    near_width: float
    far: float
    far_width: float
    habit: float
    habit_width: float
    away: float = 0.0
    away_again: float = 0.0


def memory_numbers(memory: Memory) -> MemoryNumbers:
    """Make the constants of a memory for the kernels."""
    return MemoryNumbers(*(float(number) for number in astuple(memory)))


@inlined_kernel
def reflected(u: float) -> float:
    """Reflect a quantile between -1 and 2 into 0 to 1."""
    if u < 0.0:
        return -u
    return 2.0 - u if u > 1.0 else u


@inlined_kernel
def word_at(u: float) -> uint64:
    """Find the random word of a quantile u, 0 to 1; that of `uniform(word)` is the word itself."""
    return min(np.uint64(u * 4294967296.0), _LAST_WORD)


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
    """Turn the random word of a driver's own rank into that of the quantile of all drivers: the inverse of `own_rank`.

    With a noise level of 0 it is the word itself.
    """
    rank = uniform(word)
    outer = 0.25 * (1.0 + noise)
    low = rank < 0.5
    from_end = rank if low else 1.0 - rank
    is_outer = from_end < outer
    # Choices of numbers, as below.
    part = (from_end if is_outer else rank - outer) / (1.0 + noise if is_outer else 1.0 - noise)
    end = part if low else 1.0 - part
    return word_at(end if is_outer else 0.25 + part)


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
    remembered = known + memory.habit
    is_near = draw < memory.near
    is_last = draw < known
    is_known = draw < remembered
    # Choices of numbers, not of ways to go: the processor could not guess them.
    low = 0.0 if is_near else memory.near if is_last else known if is_known else remembered
    weight = memory.near if is_near else memory.far if is_last else memory.habit if is_known else 1.0 - remembered
    centre = before if is_last else habit
    width = memory.near_width if is_near else memory.far_width if is_last else memory.habit_width
    part = (draw - low) / weight
    u = reflected(centre + width * (2.0 * part - 1.0)) if is_known else part
    return word_at(u)


@inlined_kernel
def away_chance(before: int, inattention: float, memory: MemoryNumbers) -> float:
    """Compute P(a driver looks away in this second), given whether (1 or 0) it did in the second before.

    `inattention`, 0 or more, is how many times as often as all drivers this one begins to look away.
    """
    return memory.away_again if before else min(1.0, inattention * memory.away)


@inlined_kernel
def away_draw(first: uint64, second: uint64) -> float:
    """Make a number in (0, 1) of the low halves of two random words whose high halves serve something else."""
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
    """Turn probabilities over all drivers into those of drivers whose last acceleration is known to its bin.

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
