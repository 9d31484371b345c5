"""Counter-based random numbers: Philox4x32-10 (Salmon et al., SC 2011).

A draw is a pure function of (seed, test, step, vehicle, purpose). Nothing is carried from draw to draw, so test k of a
seed is the same for any batch, thread count or resume, and any single test can be driven again alone.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._elementary import log, sin_cos
from cornerforge._jit import inlined_kernel

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

__all__ = [
    "PURPOSE_ACT",
    "PURPOSE_CAST",
    "PURPOSE_CLASS",
    "PURPOSE_DECIDE",
    "PURPOSE_EXPLORE",
    "PURPOSE_GUIDE",
    "PURPOSE_INITIAL",
    "PURPOSE_PERCEIVE",
    "PURPOSE_ROULETTE",
    "PURPOSE_TRAITS",
    "block",
    "blocks",
    "normal_pair",
    "philox4x32",
    "uniform",
]

PURPOSE_DECIDE = 1
"""A BV's decision: 4 words = lane change, acceleration, giving way, rounding of the range rate."""
PURPOSE_INITIAL = 2
"""Traffic at the start."""
PURPOSE_EXPLORE = 3
"""Exploration of a learning adversary (2 words used) or a learning AV (3 words), and the plain adversaries."""
PURPOSE_ACT = 4
"""A policy that acts at random by its values: 1 word used."""
PURPOSE_CAST = 5
"""Policy of a mixture that drives a test: 1 word used, step and vehicle 0."""
PURPOSE_CLASS = 6
"""The class of a vehicle of the initial traffic."""
PURPOSE_TRAITS = 7
"""Traits that stay with a driver: 4 words = its first quantile, its habit, its desired speed and change time (2). The
lowest bits of the first two: whether it sets the indicator; its noise level and vigilance."""
PURPOSE_ROULETTE = 8
"""Worlds of a tree of tests that are driven on: 1 word used."""
PURPOSE_GUIDE = 9
"""Whether and how a learning adversary is guided while it explores."""
PURPOSE_PERCEIVE = 10
"""What an AV perceives of a vehicle in a second: 3 words = displacement along and across the road, loss."""

# Trap: in Numba uint64 mixed with a signed integer becomes float64, so every constant here is np.uint64.
_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint64(0x9E3779B9)
_W1 = np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_16 = np.uint64(16)


@inlined_kernel
def philox4x32(
    c0: uint64, c1: uint64, c2: uint64, c3: uint64, k0: uint64, k1: uint64
) -> tuple[uint64, uint64, uint64, uint64]:
    """Do ten Philox rounds on four 32-bit counter words and two key words, each held in a uint64.

    Returns:
        Four independent uniform 32-bit words, each in a uint64.
    """
    for _ in range(10):
        p0 = _M0 * c0
        p1 = _M1 * c2
        c0, c1, c2, c3 = (p1 >> _32) ^ c1 ^ k0, p1 & _LOW, (p0 >> _32) ^ c3 ^ k1, p0 & _LOW
        k0 = (k0 + _W0) & _LOW
        k1 = (k1 + _W1) & _LOW
    return c0, c1, c2, c3


@inlined_kernel
def block(seed: int, test: int, step: int, vehicle: int, purpose: int) -> tuple[uint64, uint64, uint64, uint64]:
    """Draw four uniform 32-bit words for one (seed, test, step, vehicle, purpose).

    Args:
        seed: 0 to 2^63 - 1.
        test: 0 to 2^63 - 1.
        step: Decision number, 0 to 2^32 - 1.
        vehicle: Slot, 0 to 65535.
        purpose: One of the PURPOSE constants.
    """
    s = np.uint64(seed)
    t = np.uint64(test)
    return philox4x32(
        t & _LOW, t >> _32, np.uint64(step), np.uint64(vehicle) | (np.uint64(purpose) << _16), s & _LOW, s >> _32
    )


@inlined_kernel
def blocks(words: NDArray[np.uint64], seed: int, test: int, step: int, n: int, purpose: int) -> None:
    """Write `block` of vehicles 0 .. n - 1 into `words`, shape (4, n or more).

    No turn of this loop depends on the one before, so the processor draws for several vehicles at a time: a whole
    simulation was 4 % faster than with a `block` for each (median of 30 turns).
    """
    s = np.uint64(seed)
    t = np.uint64(test)
    who = np.uint64(purpose) << _16
    for i in range(n):
        words[0, i], words[1, i], words[2, i], words[3, i] = philox4x32(
            t & _LOW, t >> _32, np.uint64(step), np.uint64(i) | who, s & _LOW, s >> _32
        )


@inlined_kernel
def uniform(word: uint64) -> float:
    """Turn a 32-bit word into a number in (0, 1); never 0 or 1."""
    return (np.float64(np.int64(word)) + 0.5) * 2.3283064365386963e-10


@inlined_kernel
def normal_pair(word_a: uint64, word_b: uint64) -> tuple[float, float]:
    """Turn two words into two independent standard normal numbers (Box and Muller 1958); |z| < 6.8."""
    radius = math.sqrt(-2.0 * log(uniform(word_a)))
    sine, cosine = sin_cos(6.283185307179586 * uniform(word_b))
    return radius * cosine, radius * sine
