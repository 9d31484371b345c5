"""Lights of a site over time, for pages and judges; kernels ask `tables.letter_at` and `walk_letter`, which say the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel
from cornerforge._philox import PURPOSE_INITIAL, block, uniform
from cornerforge.site.network import Site
from cornerforge.site.tables import CHANGE_TIME, SLOW_WALK

__all__ = ["clock_of", "first_clock", "letters_over"]


@inlined_kernel
def first_clock(cycle: float, seed: int, test: int) -> float:
    """Draw at which time of its programme a site's signals are when a test begins [s]; the name of the test decides."""
    return cycle * uniform(block(seed, test, 0, 0, PURPOSE_INITIAL)[2])


def clock_of(site: Site, seed: int, test: int) -> float:
    """Compute at which time of its programme a site's signals are when a test begins [s]; 0 without signals."""
    return float(first_clock(sum(phase.seconds for phase in site.programme), seed, test))


def letters_over(site: Site, route: int, times: NDArray[np.float64]) -> NDArray[np.str_]:
    """Look up the light of a route at times of the programme [s]: G, g, y or r, (T,); G without a signal.

    Of people G is Walk, y a flashing Don't Walk.
    """
    one = site.routes[route]
    if one.signal < 0 or not site.programme:
        return np.full(len(times), "G")
    letters = np.array([phase.states[one.signal] for phase in site.programme])
    ends = np.cumsum([phase.seconds for phase in site.programme])

    def at(moments: NDArray[np.float64]) -> NDArray[np.str_]:
        return np.asarray(letters[np.searchsorted(ends[:-1], moments % ends[-1], side="right")])

    shown = at(times)
    if one.turn != "walk":
        return shown
    needed = max(one.length / SLOW_WALK - CHANGE_TIME, 0.0)
    may, soon = np.isin(shown, ("G", "g")), np.isin(at(times + needed), ("G", "g"))
    return np.where(may & soon, "G", np.where(may, "y", "r"))
