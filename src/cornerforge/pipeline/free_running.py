"""Free-running natural traffic, and the published facts that it is measured against.

The traffic fills 2400 m of three lanes and drives for 15 s, and again for 34 s. The AV is no natural driver; it starts
at the very rear, so that no counted vehicle follows it. Vehicles are counted in a stretch that starts 350 m from the
rear and ends 465 m from the front, and moves at 30 m/s. The empty road before and behind the traffic neither hides a
leader of a counted vehicle nor has an effect that reaches the stretch within 34 s (effects travel at 10 m/s faster or
slower than 30 m/s). So every counted vehicle has the neighbours that it would have on a longer road.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer, check_number
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads
from cornerforge.road.straight import road_numbers
from cornerforge.sim import statistics
from cornerforge.sim.runner import simulate_chunks, warm_up
from cornerforge.sim.world import n_slots
from cornerforge.types import METRES_PER_MILE, Odd

__all__ = [
    "MILES",
    "WINDOWS",
    "FreeRunning",
    "Window",
    "free_running_odd",
    "quantities_of",
    "simulate_free_running",
    "upper_rate",
]

MILES = 2e6
"""Vehicle-miles of BVs in each window. At 6 times the human rate (1.2e-5 crashes per mile) the upper bound is then
below 2e-5 with a chance of 95 %."""
TRAFFIC_LENGTH = 2400.0
COUNTED = (350.0, 1935.0)
"""Ends of the stretch in which vehicles are counted, at time 0 [m]."""
DRIFT = 30.0
_LANES = 3
_CHUNK = 64
_BLOCKS = 20


class Window(NamedTuple):
    """Decision times `first` to `until` - 1 [s] after the start."""

    name: str
    first: int
    until: int


WINDOWS = (Window("0-15 s", 0, 15), Window("26-34 s", 26, 34))


@dataclass(frozen=True)
class FreeRunning:
    """The counts of one window.

    Attributes:
        window: The decision times that were counted.
        tests: Worlds that were driven.
        blocks: The same counts in 20 parts of whole worlds, the sampling unit of all intervals.
    """

    window: Window
    tests: int
    blocks: tuple[statistics.Counts, ...]

    def total(self, without: int = -1) -> statistics.Counts:
        """Return the sum of all blocks, without block `without` unless it is -1."""
        total = statistics.allocate_counts()
        for number, block in enumerate(self.blocks):
            if number != without:
                total.add(block)
        return total

    @property
    def miles(self) -> float:
        """Vehicle-miles counted."""
        return miles_of(self.total())

    @property
    def vehicles_per_km(self) -> float:
        """Mean density of the counted stretch, all lanes."""
        seconds = self.tests * (self.window.until - self.window.first)
        return float(self.total().totals[statistics.BV_STATES]) / seconds / (COUNTED[1] - COUNTED[0]) * 1000.0


def miles_of(counts: statistics.Counts) -> float:
    """Return the vehicle-miles of the BVs."""
    return int(counts.totals[statistics.BV_TRAVEL_MM]) / 1000.0 / METRES_PER_MILE


def free_running_odd(window: Window) -> Odd:
    """Return the road on which a window's traffic drives; a world ends by time, never by distance."""
    return Odd(
        name="free-running",
        n_lanes=_LANES,
        test_length=1e5,
        time_limit=float(window.until),
        av_start=0.0,
        traffic_length=TRAFFIC_LENGTH,
    )


def on_road(run: Experiment, odd: Odd) -> Experiment:
    """Return the same experiment on another road."""
    return replace(run, odd=odd, setting=run.setting._replace(road=road_numbers(odd)), slots=n_slots(odd))


def simulate_free_running(
    run: Experiment,
    window: Window,
    *,
    miles: float = MILES,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> FreeRunning:
    """Drive worlds until `miles` vehicle-miles are counted in a window; the same for any number of threads.

    Args:
        run: The experiment, whose own road is not used.
        window: When to count.
        miles: Least number of vehicle-miles, 100 to 1e9; also the largest number of worlds.
        seed: 0 or more.
        threads: None for all cores.
        progress: Told how far it is, in miles.

    Raises:
        InputError: A number is out of range.
    """
    check_number("miles", miles, low=100.0, high=1e9)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    moved = on_road(run, free_running_odd(window))
    census = statistics.Census(True, window.first, window.until, *COUNTED, DRIFT)
    blocks = tuple(statistics.allocate_counts() for _ in range(_BLOCKS))
    warm_up(moved.setting, moved.slots)
    worlds = simulate_chunks(
        moved.setting, moved.slots, seed=seed, first=0, tests=int(miles), threads=check_threads(threads),
        counting=census, chunk=_CHUNK,
    )  # fmt: skip
    tests, done = 0, 0.0
    try:
        for number, (_, out, counts) in enumerate(worlds):
            blocks[number % _BLOCKS].add(counts)
            tests += out.code.size
            done += miles_of(counts)
            progress(f"traffic {window.name}", min(done, miles), miles)
            if done >= miles and number + 1 >= _BLOCKS:
                break
    finally:
        worlds.close()
    return FreeRunning(window, tests, blocks)


def quantities_of(parts: list[FreeRunning]) -> dict[str, tuple[statistics.HistogramGrid, NDArray[np.int64]]]:
    """Sum the quantities by speed class over all windows: name -> grid and counts (41, bins)."""
    joint = sum((part.total().joint for part in parts), np.zeros_like(statistics.allocate_counts().joint))
    return {grid.name: (grid, joint[row, :, : grid.bins]) for row, grid in enumerate(statistics.JOINT)}


def upper_rate(events: int, exposure: float, confidence: float = 0.95) -> float:
    """Return the exact one-sided upper bound of a Poisson rate: 3.0e-6 per mile for 0 events in 1e6 miles.

    Source: Garwood (1936), by the chi-square distribution.

    >>> round(upper_rate(0, 1e6) * 1e6, 3)
    2.996
    """
    from scipy.special import chdtri

    return float(chdtri(2.0 * (events + 1.0), 1.0 - confidence) / 2.0 / exposure)
