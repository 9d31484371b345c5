"""Free-running natural traffic: driven for 62 s, and counted in windows of time.

The traffic fills 3000 m of three lanes. The AV is no natural driver; it starts at the very rear, so that no counted
vehicle follows it. Vehicles are counted in a stretch that starts 640 m from the rear and ends 745 m from the front, and
moves at 30 m/s. The empty road before and behind the traffic neither hides a leader of a counted vehicle nor has an
effect that reaches the stretch within 62 s (effects travel at 10 m/s faster or slower than 30 m/s). So every counted
vehicle has the neighbours that it would have on a longer road.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer, check_number
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.ext.calibrate.persistence import Pairs, pairs_of
from cornerforge.road.straight import along, road_numbers
from cornerforge.sim import n_slots, outcome, runner, statistics
from cornerforge.types import METRES_PER_MILE, Odd
from cornerforge.work import in_order
from cornerforge.work.progress import NO_PROGRESS, Progress

__all__ = [
    "DRIFT_WINDOWS",
    "MILES",
    "PERIODS",
    "WHOLE",
    "FreeRunning",
    "FreeTraffic",
    "Quantity",
    "Window",
    "free_running_odd",
    "is_counted",
    "joined",
    "quantities_of",
    "simulate_free_running",
    "speeds_of",
    "upper_rate",
]

MILES = 4e6
"""Vehicle-miles of BVs in all windows together. Without a crash the upper bound is then below 1e-6 per mile."""
TRAFFIC_LENGTH = 3000.0
COUNTED = (640.0, 2255.0)
"""Ends of the stretch in which vehicles are counted, at time 0 [m]."""
STRETCH_SPEED = 30.0
_LANES = 3
_CHUNK = 128
_BLOCKS = 20
_NOTED = 32
"""Number of worlds in each of the first 20 chunks with states noted every second."""


class Window(NamedTuple):
    """Decision times `first` to `until` - 1 [s] after the start."""

    first: int
    until: int

    @property
    def name(self) -> str:
        """Text for people."""
        return f"{self.first}-{self.until} s"


_ENDS = (0, 2, 5, 7, 10, 12, 30, 32, 60, 62)
_WINDOWS = tuple(Window(first, until) for first, until in pairwise(_ENDS))
DRIFT_WINDOWS = _WINDOWS[::2]
"""Windows in which the traffic is compared with the facts."""
PERIODS = tuple(Window(first, until) for first, until in pairwise((0, 2, 10, 30, 62)))
"""Spans in which crashes are counted; each is a sum of windows."""
WHOLE = Window(_ENDS[0], _ENDS[-1])


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


@dataclass(frozen=True)
class FreeTraffic:
    """Counts of one drive of many worlds.

    Attributes:
        parts: The counts of the windows, which follow on each other.
        pairs: Pairs of leader and follower in some worlds of each of the 20 blocks.
    """

    parts: tuple[FreeRunning, ...]
    pairs: tuple[Pairs, ...]

    def during(self, window: Window) -> FreeRunning:
        """Return the counts of a time that is one of the windows or several in a row."""
        return joined([part for part in self.parts if window.first <= part.window.first < window.until])


def joined(parts: Sequence[FreeRunning]) -> FreeRunning:
    """Join windows of the same worlds that follow on each other; at least one."""
    if len(parts) == 1:
        return parts[0]
    blocks = []
    for same in zip(*(part.blocks for part in parts), strict=True):
        block = statistics.allocate_counts()
        for counts in same:
            block.add(counts)
        blocks.append(block)
    window = Window(parts[0].window.first, parts[-1].window.until)
    return FreeRunning(window, parts[0].tests, tuple(blocks))


def miles_of(counts: statistics.Counts) -> float:
    """Return the vehicle-miles of the BVs, summed over a leading axis if there is one."""
    return int(counts.totals[..., statistics.BV_TRAVEL_MM].sum()) / 1000.0 / METRES_PER_MILE


def free_running_odd() -> Odd:
    """Return the road on which the traffic drives; a world ends by time, never by distance."""
    return Odd(
        name="free-running",
        n_lanes=_LANES,
        test_length=1e5,
        time_limit=float(WHOLE.until),
        av_start=0.0,
        traffic_length=TRAFFIC_LENGTH,
    )


def is_counted(x: NDArray[np.float64], time: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Is a position [m] in the counted stretch at a time [s]? Arrays that broadcast."""
    start = along(STRETCH_SPEED * time, x)
    return (start >= COUNTED[0]) & (start <= COUNTED[1])


def on_road(run: Experiment, odd: Odd) -> Experiment:
    """Return the same experiment on another road."""
    return replace(run, odd=odd, setting=run.setting._replace(road=road_numbers(odd)), slots=n_slots(odd))


def simulate_free_running(
    run: Experiment,
    *,
    miles: float = MILES,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> FreeTraffic:
    """Drive worlds until `miles` vehicle-miles are counted; the same for any number of threads.

    Args:
        run: The experiment; its own road is not used.
        miles: Least number of vehicle-miles in all windows together, 100 to 1e9. At least 2,560 worlds are driven,
            150,000 miles in a few seconds.
        seed: 0 or more.
        threads: None for all cores.
        progress: Called with the miles driven.

    Raises:
        InputError: A number is out of range.
    """
    check_number("miles", miles, low=100.0, high=1e9)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    moved = on_road(run, free_running_odd())
    census = statistics.Census(True, 0, WHOLE.until, *COUNTED, STRETCH_SPEED)
    ends = np.array(_ENDS[1:])
    blocks = [statistics.allocate_counts(len(_WINDOWS)) for _ in range(_BLOCKS)]
    pairs = []
    runner.warm_up(moved.setting, moved.slots)

    def work(first: int, count: int) -> tuple[outcome.Outcomes, statistics.Counts, Pairs | None]:
        noted = min(_NOTED, count) if first < _BLOCKS * _CHUNK else 0
        windows = runner.allocate_windows(ends, noted, moved.slots)
        out = runner.drive_chunk_by_window(moved.setting, moved.slots, seed, first, count, census, windows)
        if not noted:
            return out, windows.counts, None
        counted = is_counted(windows.states["x"], np.arange(WHOLE.until)[:, None]) & (windows.states["present"] == 1)
        return out, windows.counts, pairs_of(windows.states, windows.lengths, counted, moved.odd.lane_width)

    tests, done = 0, 0.0
    worlds = in_order(work, 0, _BLOCKS * _CHUNK + int(miles), chunk=_CHUNK, threads=check_threads(threads))
    try:
        for number, (out, counts, found) in enumerate(worlds):
            blocks[number % _BLOCKS].add(counts)
            tests += out.code.size
            done += miles_of(counts)
            if found is not None:
                pairs.append(found)
            progress("traffic", min(done, miles), miles)
            if done >= miles and number + 1 >= _BLOCKS:
                break
    finally:
        worlds.close()
    rows = ((statistics.Counts._make(array[k] for array in block) for block in blocks) for k in range(len(_WINDOWS)))
    parts = tuple(FreeRunning(window, tests, tuple(row)) for window, row in zip(_WINDOWS, rows, strict=True))
    return FreeTraffic(parts, tuple(pairs))


class Quantity(NamedTuple):
    """A quantity of simulated traffic by speed.

    Attributes:
        unit: Unit of the quantity.
        low, width: First edge and width of the bins.
        counts: States by speed class (0, 1, ... m/s, to the nearest) and bin, shape (41, k); the end bins hold what
            lies beyond.
    """

    unit: str
    low: float
    width: float
    counts: NDArray[np.int64]

    def place(self, values: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the bin of each value, shape (n,)."""
        found = np.floor((np.minimum(values, 1e6) - self.low) / self.width)
        return np.asarray(np.clip(found, 0, self.counts.shape[1] - 1), dtype=np.int64)


def quantities_of(part: FreeRunning) -> dict[str, Quantity]:
    """Give the quantities of a window by name."""
    joint = part.total().joint
    return {
        grid.name: Quantity(grid.unit, grid.low, grid.width, joint[row, :, : grid.bins])
        for row, grid in enumerate(statistics.JOINT)
    }


def speeds_of(quantities: Mapping[str, Quantity], slowest: float = 0.0) -> Quantity:
    """Make the speeds from `slowest` on, in classes of 1 m/s, not matched by speed: one row holds all of them."""
    both = [quantities[f"acceleration_{kind}"].counts.sum(axis=1) for kind in ("following", "free")]
    counts = np.where(np.arange(41) < int(slowest + 0.5), 0, sum(both))
    return Quantity("m/s", -0.5, 1.0, counts[None])


def upper_rate(events: int, exposure: float, confidence: float = 0.95) -> float:
    """Return the exact one-sided upper bound of a Poisson rate: 3.0e-6 per mile for 0 events in 1e6 miles.

    Source: Garwood (1936), by the chi-square distribution.

    >>> round(upper_rate(0, 1e6) * 1e6, 3)
    2.996
    """
    from scipy.special import chdtri

    return float(chdtri(2.0 * (events + 1.0), 1.0 - confidence) / 2.0 / exposure)
