"""Random words that are held to a part of what they may be: what `decide` draws, given that something happens or not.

A BV decides by the random words of its second. The first says whether it begins or turns back in a lane change, the
low halves of the third and fourth whether its driver looks away. A word that is drawn uniformly from the words that
lead to something is distributed as natural words are, given that it happens. So steering changes no law: the chance of
what was steered to, a count of words over 2^32, is the weight of what follows.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

__all__ = [
    "ALL_WORDS", "AWAY", "LANE", "Steering", "allocate_steering", "hold_to", "let_go", "steer", "steer_at_site",
    "words_below",
]  # fmt: skip

ALL_WORDS = 2**32
"""Number of random words."""
LANE, AWAY = range(2)
"""Steered draws: the word about lanes, at a site about going or giving way; the draw about looking away."""
_LOW_HALF, _HIGH_HALF, _HALF, _WHOLE = np.uint64(0xFFFF), np.uint64(0xFFFF0000), np.uint64(16), np.uint64(32)


class Steering(NamedTuple):
    """Acts to which each slot is held in the coming second.

    Attributes:
        on: 1 if any slot is held, int64 (1,).
        first, words: First word and number of words of LANE and AWAY, uint64 (2, N).
    """

    on: NDArray[np.int64]
    first: NDArray[np.uint64]
    words: NDArray[np.uint64]


def allocate_steering(slots: int) -> Steering:
    """Steering that holds no vehicle."""
    return Steering(
        np.zeros(1, dtype=np.int64),
        np.zeros((2, slots), dtype=np.uint64),
        np.full((2, slots), ALL_WORDS, dtype=np.uint64),
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
        for what in range(2):
            steering.first[what, i] = np.uint64(0)
            steering.words[what, i] = np.uint64(ALL_WORDS)


@inlined_kernel
def hold_to(steering: Steering, slot: int, what: int, first: int, count: int) -> None:
    """Hold a slot's LANE or AWAY to `count` words from `first` on; `count` at least 1."""
    steering.on[0] = 1
    steering.first[what, slot] = np.uint64(first)
    steering.words[what, slot] = np.uint64(count)


@inlined_kernel
def _within(word: uint64, first: uint64, count: uint64) -> uint64:
    return first + ((word * count) >> _WHOLE)


@inlined_kernel
def steer(words: NDArray[np.uint64], steering: Steering, slots: int) -> None:
    """Replace the words (4, N) of slots that are held by words of the part that they are held to."""
    for i in range(1, slots):
        words[0, i] = _within(words[0, i], steering.first[LANE, i], steering.words[LANE, i])
        away = (words[2, i] & _LOW_HALF) | ((words[3, i] & _LOW_HALF) << _HALF)
        away = _within(away, steering.first[AWAY, i], steering.words[AWAY, i])
        words[2, i] = (words[2, i] & _HIGH_HALF) | (away & _LOW_HALF)
        words[3, i] = (words[3, i] & _HIGH_HALF) | (away >> _HALF)


@inlined_kernel
def steer_at_site(words: NDArray[np.uint64], steering: Steering, slots: int) -> None:
    """Replace words (4, N) as `steer` does, where the second is about the choice and the third about looking away."""
    for i in range(1, slots):
        words[1, i] = _within(words[1, i], steering.first[LANE, i], steering.words[LANE, i])
        words[2, i] = _within(words[2, i], steering.first[AWAY, i], steering.words[AWAY, i])
