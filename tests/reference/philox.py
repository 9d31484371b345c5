"""Philox4x32-10 (Salmon et al., SC 2011) in whole numbers of Python, and how draws are named."""

from __future__ import annotations

import math
from dataclasses import dataclass

from reference.elementary import log, sin_cos

__all__ = ["CLASS", "DECIDE", "EXPLORE", "INITIAL", "TRAITS", "Stream", "normal_pair", "philox", "unit"]

DECIDE, INITIAL, EXPLORE, CLASS, TRAITS = 1, 2, 3, 6, 7
"""What a draw is for."""

_MASK = 2**32 - 1

Words = tuple[int, int, int, int]


def philox(counter: Words, key: tuple[int, int]) -> Words:
    """Ten rounds: multiply two of the words, swap the halves, mix with the key, and bump the key."""
    a, b, c, d = counter
    k, m = key
    for _ in range(10):
        left = 0xD2511F53 * a
        right = 0xCD9E8D57 * c
        a, b, c, d = (right >> 32) ^ b ^ k, right & _MASK, (left >> 32) ^ d ^ m, left & _MASK
        k = (k + 0x9E3779B9) & _MASK
        m = (m + 0xBB67AE85) & _MASK
    return a, b, c, d


@dataclass(frozen=True)
class Stream:
    """All random words of one test."""

    seed: int
    test: int

    def words(self, step: int, vehicle: int, purpose: int) -> Words:
        """The four words of a (step, vehicle, purpose)."""
        return philox(
            (self.test & _MASK, self.test >> 32, step, vehicle | (purpose << 16)), (self.seed & _MASK, self.seed >> 32)
        )


def unit(word: int) -> float:
    """The middle of the word's slot in (0, 1)."""
    return (word + 0.5) * 2.0**-32


def normal_pair(first: int, second: int) -> tuple[float, float]:
    """Box and Muller: two standard normal numbers."""
    radius = math.sqrt(-2.0 * log(unit(first)))
    sine, cosine = sin_cos(2.0 * math.pi * unit(second))
    return radius * cosine, radius * sine
