"""Random words that are held to a part of what they may be: what `decide` draws, given that something happens or not.

A BV decides by the random words of its second. The first says whether it begins or turns back in a lane change, the
low halves of the third and fourth whether its driver looks away. A word that is drawn uniformly from the words that
lead to something is distributed as natural words are, given that it happens. So steering changes no law: the chance of
what was steered to, a count of words over 2^32, is the weight of what follows.

The second word gives the quantile of its acceleration, in one of four ways (`ndd.memory.remembering_word`). Words that
lead to a high quantile are several stretches. So this word is held by its place in another order (`word_at_place`), in
which those are the first.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

    from cornerforge.ndd.memory import MemoryNumbers

__all__ = [
    "ACCELERATION", "ALL_WORDS", "AWAY", "HIGH", "LANE", "N_STEERED", "Steering", "allocate_steering", "hold_to",
    "let_go", "places_up_to", "steer", "word_at_place", "words_below",
]  # fmt: skip

ALL_WORDS = 2**32
"""Number of random words."""
N_STEERED = 3
LANE, AWAY, ACCELERATION = range(N_STEERED)
"""Steered draws: the word about lanes; the draw about looking away; the place of the word about acceleration."""
HIGH = (0.98, 0.9)
"""Quantiles of an acceleration from which on it is very high, and high."""
_RINGS = (1.0 - HIGH[0], 1.0 - HIGH[1], 3.0)
"""Distances from the top of a quantile before it is reflected, at most 2: very high, high, any."""
_LOW_HALF, _HIGH_HALF, _HALF, _WHOLE = np.uint64(0xFFFF), np.uint64(0xFFFF0000), np.uint64(16), np.uint64(32)


class Steering(NamedTuple):
    """Acts to which each slot is held in the coming second.

    Attributes:
        on: 1 if any slot is held, int64 (1,).
        first, words: First word and number of words of LANE and AWAY, of ACCELERATION first place and number of
            places, uint64 (N_STEERED, N).
    """

    on: NDArray[np.int64]
    first: NDArray[np.uint64]
    words: NDArray[np.uint64]


def allocate_steering(slots: int) -> Steering:
    """Steering that holds no vehicle."""
    return Steering(
        np.zeros(1, dtype=np.int64),
        np.zeros((N_STEERED, slots), dtype=np.uint64),
        np.full((N_STEERED, slots), ALL_WORDS, dtype=np.uint64),
    )


@inlined_kernel
def words_below(chance: float) -> int:
    """Count the random words with `uniform` below a chance."""
    return math.ceil(min(max(chance, 0.0), 1.0) * 4294967296.0 - 0.5)


@inlined_kernel
def let_go(steering: Steering, slots: int) -> None:
    """Release all of the first `slots` slots."""
    steering.on[0] = 0
    for i in range(slots):
        for what in range(N_STEERED):
            steering.first[what, i] = np.uint64(0)
            steering.words[what, i] = np.uint64(ALL_WORDS)


@inlined_kernel
def hold_to(steering: Steering, slot: int, what: int, first: int, count: int) -> None:
    """Hold a slot's LANE, AWAY or ACCELERATION to `count` words, or places, from `first` on; `count` at least 1."""
    steering.on[0] = 1
    steering.first[what, slot] = np.uint64(first)
    steering.words[what, slot] = np.uint64(count)


@inlined_kernel
def _within(word: uint64, first: uint64, count: uint64) -> uint64:
    return first + ((word * count) >> _WHOLE)


@inlined_kernel
def _stretch(ring: int, way: int, before: float, habit: float, memory: MemoryNumbers) -> tuple[int, int]:
    """Find the words of a way to remember that lead to a ring or one further in: the first, and their end."""
    known, m = memory.near + memory.far, memory.ways
    begins = (0.0, memory.near, known, known + memory.habit, 1.0)
    start, end = words_below(begins[way]), words_below(begins[way + 1])
    top = 1.0 - m[way, 0] - m[way, 1] * before - m[way, 2] * habit
    first = words_below((top - _RINGS[ring]) / m[way, 3])
    last = words_below((top + _RINGS[ring]) / m[way, 3])
    return min(max(first, start), end), min(max(last, start), end)


@kernel
def places_up_to(ring: int, before: float, habit: float, memory: MemoryNumbers) -> int:
    """Count the words that lead to a quantile of HIGH[ring] or more: theirs are the first places.

    Args:
        ring: 0 or 1; 2 counts all words.
        before: Quantile of the driver's acceleration in the second before.
        habit: Its habit, a quantile.
        memory: Weights and widths; of widths above 0.9 some words that are reflected at 0 are left out.
    """
    count = 0
    for way in range(4):
        first, end = _stretch(ring, way, before, habit, memory)
        count += end - first
    return count


@kernel
def word_at_place(place: int, before: float, habit: float, memory: MemoryNumbers) -> int:
    """Find the word at a place, 0 to 2^32 - 1, in the order of the rings; arguments as for `places_up_to`."""
    for ring in range(3):
        for way in range(4):
            first, end = _stretch(ring, way, before, habit, memory)
            hole, hole_end = _stretch(ring - 1, way, before, habit, memory) if ring > 0 else (first, first)
            if place < hole - first:
                return first + place
            place -= hole - first
            if place < end - hole_end:
                return hole_end + place
            place -= end - hole_end
    return ALL_WORDS - 1  # not reached: the rings hold all words


@inlined_kernel
def steer(
    words: NDArray[np.uint64], steering: Steering, slots: int, v: NDArray[np.void], memory: MemoryNumbers
) -> None:
    """Replace the words (4, N) of slots that are held by words of the part that they are held to; `v`: all vehicles."""
    for i in range(1, slots):
        if steering.words[ACCELERATION, i] < ALL_WORDS:
            place = _within(words[1, i], steering.first[ACCELERATION, i], steering.words[ACCELERATION, i])
            words[1, i] = np.uint64(word_at_place(np.int64(place), v[i].quantile, v[i].habit, memory))
        words[0, i] = _within(words[0, i], steering.first[LANE, i], steering.words[LANE, i])
        away = (words[2, i] & _LOW_HALF) | ((words[3, i] & _LOW_HALF) << _HALF)
        away = _within(away, steering.first[AWAY, i], steering.words[AWAY, i])
        words[2, i] = (words[2, i] & _HIGH_HALF) | (away & _LOW_HALF)
        words[3, i] = (words[3, i] & _HIGH_HALF) | (away >> _HALF)
