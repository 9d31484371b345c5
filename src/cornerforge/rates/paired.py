"""Two AVs in the same tests: how much more often one of them crashes, and a sequential test that may stop early.

The same tests mean the same random numbers (seed and number of the test), so most crash for both AVs or for neither.
Only tests in which one crashes and the other does not, the *discordant* ones, tell them apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer, check_number

__all__ = ["ALPHA", "BETA", "RATIO", "Verdict", "difference_interval", "sequential_verdict"]

ALPHA = 0.05
"""Largest share of comparisons of equally good AVs that end in "better" or "worse"."""
BETA = 0.1
"""Largest share of comparisons that end in "alike" although the AVs' discordant tests differ by RATIO or more."""
RATIO = 2.0


@dataclass(frozen=True)
class Verdict:
    """Result of a sequential test.

    Attributes:
        word: "worse", "better", "alike" or "open": neither is shown yet.
        tests: After so many tests; all of them if it is open.
    """

    word: str
    tests: int


def difference_interval(new_only: int, old_only: int, tests: int, confidence: float = 0.95) -> tuple[float, float]:
    """Give an interval of the difference of two crash rates, new minus old, from the same tests.

    Args:
        new_only, old_only: Tests in which only the new AV, only the old one crashed.
        tests: All of them, at least 1.
        confidence: In (0, 1).

    Raises:
        InputError: A number is out of range.

    Source: Agresti and Min (2005), "Simple improved confidence intervals for comparing matched proportions", Statistics
    in Medicine 24, 729-740: Wald's interval after adding 1/2 to each of the four cells.

    >>> low, high = difference_interval(2, 8, 100)
    >>> round(low, 4), round(high, 4)
    (-0.1215, 0.0039)
    """
    from scipy.special import ndtri

    check_integer("tests", tests, low=1)
    check_integer("new_only", new_only, low=0, high=tests)
    check_integer("old_only", old_only, low=0, high=tests - new_only)
    check_number("confidence", confidence, low=1e-9, high=1.0 - 1e-9)
    n, b, c = tests + 2.0, new_only + 0.5, old_only + 0.5
    middle = (b - c) / n
    half = float(ndtri(0.5 + 0.5 * confidence)) * math.sqrt(b + c - (b - c) ** 2 / n) / n
    return max(-1.0, middle - half), min(1.0, middle + half)


def sequential_verdict(new: NDArray[np.bool_], old: NDArray[np.bool_]) -> Verdict:
    """Compare two AVs test by test, and say when the first conclusion could be drawn.

    Two of Wald's sequential probability ratio tests run at the same time over the discordant tests: that the new AV
    crashes in RATIO times as many of them as the old one, and in as many times fewer, each against equality. "worse"
    and "better" need a likelihood ratio of 2 / ALPHA, so that AVs that are equally good get one of them with a chance
    of at most ALPHA, however long one looks (Ville's inequality). "alike" needs both ratios to be BETA or less: AVs
    that differ by RATIO or more get it with a chance of at most BETA.

    Args:
        new, old: Whether each crashed, in the order of tests, shape (N,).

    Source: Wald (1945), "Sequential tests of statistical hypotheses", Annals of Mathematical Statistics 16, 117-186.

    >>> crashes = np.ones(40, np.bool_)
    >>> sequential_verdict(crashes, ~crashes)
    Verdict(word='worse', tests=13)
    """
    sign = new.astype(np.int64) - old.astype(np.int64)
    more = np.cumsum(sign == 1)
    fewer = np.cumsum(sign == -1)
    likely, unlikely = math.log(2.0 * RATIO / (1.0 + RATIO)), math.log(2.0 / (1.0 + RATIO))
    worse, better = more * likely + fewer * unlikely, fewer * likely + more * unlikely
    enough, little = math.log(2.0 / ALPHA), math.log(BETA)
    ends = {"worse": worse >= enough, "better": better >= enough, "alike": (worse <= little) & (better <= little)}
    first = {word: int(np.argmax(reached)) for word, reached in ends.items() if reached.any()}
    if not first:
        return Verdict("open", int(sign.size))
    word = min(first, key=first.__getitem__)
    return Verdict(word, first[word] + 1)
