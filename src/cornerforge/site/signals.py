"""Lights of a site over time, for pages and judges; in kernels `tables.letter_at` and `walk_letter` say the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel
from cornerforge._philox import PURPOSE_INITIAL, block, uniform
from cornerforge.site.network import Site
from cornerforge.site.tables import CHANGE_TIME, SLOW_WALK

if TYPE_CHECKING:
    from cornerforge.types import Scenario

__all__ = ["clock_of", "first_clock", "letters_over"]


@inlined_kernel
def first_clock(cycle: float, seed: int, test: int) -> float:
    """Draw at which time of its programme a site's signals are when a test begins [s]; the name of the test decides."""
    return cycle * uniform(block(seed, test, 0, 0, PURPOSE_INITIAL)[2])


def clock_of(scenario: Scenario) -> float:
    """Say at which time of their programme signals are at the first frame of a recording [s]; 0 without any."""
    if scenario.signals_s is not None:
        return scenario.signals_s
    programme = () if scenario.odd.site is None else scenario.odd.site.programme
    return float(first_clock(sum(phase.seconds for phase in programme), scenario.seed, scenario.test))


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
