"""Distributions over bulk simulation: fixed histograms, counted in integers so that no order of summation matters."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge.sim.decide import SIGHT, neighbours_in_lane
from cornerforge.sim.world import N_VEHICLES
from cornerforge.types import ACCELERATIONS

if TYPE_CHECKING:
    from cornerforge.sim.world import RoadNumbers, World

__all__ = [
    "EXPOSURE",
    "TRAFFIC",
    "Counts",
    "HistogramGrid",
    "allocate_counts",
    "count_av",
    "count_traffic",
    "grid_edges",
    "histogram_summary",
]


class HistogramGrid(NamedTuple):
    """Equal bins; values outside are counted in the end bins."""

    name: str
    unit: str
    low: float
    width: float
    bins: int


TRAFFIC = (
    HistogramGrid("speed", "m/s", 0.0, 0.02, 2001),
    HistogramGrid("gap", "m", 0.0, 0.05, 2400),
    HistogramGrid("time_gap", "s", 0.0, 0.005, 2400),
    HistogramGrid("range_rate", "m/s", -20.0, 0.02, 2000),
    HistogramGrid("acceleration", "m/s2", -4.1, 0.2, 31),
)
"""Quantities of BVs at decision times; gap, time gap and range rate only while following (gap of at most 115.5 m)."""
EXPOSURE = (
    HistogramGrid("bbd_front", "m", 0.0, 2.0, 61),
    HistogramGrid("bbd_rear", "m", 0.0, 2.0, 61),
    HistogramGrid("ttc_front", "s", 0.0, 0.5, 41),
    HistogramGrid("ttc_rear", "s", 0.0, 0.5, 41),
)
"""What the AV is exposed to once a second (paper, Figure 3): to the vehicles ahead and behind in its lane; TTC when
closing. Vehicles that overlap it lengthwise, beside it while one of the two changes lanes, are neither ahead nor
behind."""
TTC_LIMITS = (3.0, 4.0, 5.0, 10.0, 15.0, 20.0)
_N_BINS = 2400
_FOLLOWING_GAP = 115.5
_ACCELERATIONS = ACCELERATIONS
_LOW = np.array([g.low for g in TRAFFIC + EXPOSURE])
_WIDTH = np.array([g.width for g in TRAFFIC + EXPOSURE])
_BINS = np.array([g.bins for g in TRAFFIC + EXPOSURE])
_LIMITS = np.array(TTC_LIMITS)


class Counts(NamedTuple):
    """Integer counts; `histograms` (9, 2400) rows in the order of TRAFFIC then EXPOSURE.

    `totals`: BV states, following states, lane changes begun, BV travel [mm], AV decisions; then states with TTC below
    each limit.
    """

    histograms: NDArray[np.int64]
    totals: NDArray[np.int64]


BV_STATES, FOLLOWING_STATES, LANE_CHANGES, BV_TRAVEL_MM, AV_STATES = range(5)


def allocate_counts() -> Counts:
    """Zero counts."""
    return Counts(
        np.zeros((len(TRAFFIC) + len(EXPOSURE), _N_BINS), dtype=np.int64), np.zeros(5 + len(TTC_LIMITS), dtype=np.int64)
    )


def grid_edges(grid: HistogramGrid) -> NDArray[np.float64]:
    """Bin edges in the grid's unit, shape (bins + 1,)."""
    return np.round(grid.low + grid.width * np.arange(grid.bins + 1), 6)


def histogram_summary(grid: HistogramGrid, counts: NDArray[np.int64]) -> dict[str, object]:
    """n, mean, sd and quantiles of a histogram, exact to half a bin; NaN-free: null where n is 0."""
    counts = counts[: grid.bins]
    n = int(counts.sum())
    if n == 0:
        return {"n": 0, "mean": None, "sd": None, "quantiles": {}}
    centres = grid.low + grid.width * (np.arange(grid.bins) + 0.5)
    mean = float(counts @ centres) / n
    variance = float(counts @ (centres - mean) ** 2) / n
    cumulative = np.cumsum(counts)
    quantiles = {
        str(q): round(float(centres[int(np.searchsorted(cumulative, n * q / 100.0))]), 4)
        for q in (1, 5, 25, 50, 75, 95, 99)
    }
    return {"n": n, "mean": round(mean, 5), "sd": round(variance**0.5, 5), "quantiles": quantiles}


@kernel
def _count(counts: Counts, row: int, value: float) -> None:
    place = int((value - _LOW[row]) / _WIDTH[row])
    counts.histograms[row, max(0, min(_BINS[row] - 1, place))] += 1


@kernel
def count_traffic(w: World, road: RoadNumbers, counts: Counts) -> float:
    """Count all BVs at a decision time; their accelerations and lane changes are those of the second before.

    Returns:
        The sum of their speeds, which is their travel in the coming second [m] to first order.
    """
    v = w.vehicles
    info = w.info
    travel = 0.0
    for i in range(1, info[N_VEHICLES]):
        if v[i].present == 0:
            continue
        counts.totals[BV_STATES] += 1
        travel += v[i].speed
        _count(counts, 0, v[i].speed)
        if 0 <= v[i].action < 2:
            counts.totals[LANE_CHANGES] += 1
            _count(counts, 4, 0.0)
        elif v[i].action >= 2:
            _count(counts, 4, _ACCELERATIONS[v[i].action - 2])
        gap = SIGHT
        rate = 0.0
        for lane in range(road.n_lanes):
            if v[i].lanes & (1 << lane):
                lead, _ = neighbours_in_lane(w, i, lane, road.lane_width, 1)
                if lead >= 0 and v[lead].x - v[i].x - road.length < gap:
                    gap = v[lead].x - v[i].x - road.length
                    rate = v[lead].speed - v[i].speed
        if gap > _FOLLOWING_GAP:
            continue
        counts.totals[FOLLOWING_STATES] += 1
        _count(counts, 1, gap)
        _count(counts, 2, gap / max(v[i].speed, 0.1))
        _count(counts, 3, rate)
        for k in range(_LIMITS.size):
            if rate < 0.0 and gap < -rate * _LIMITS[k]:
                counts.totals[5 + k] += 1
    return travel


@kernel
def _count_pair(counts: Counts, row: int, gap: float, rate: float) -> None:
    """One neighbour of the AV: its distance in row `row`, its TTC two rows on when closing."""
    if gap <= 0.0:
        return
    _count(counts, 5 + row, gap)
    if rate < 0.0:
        _count(counts, 7 + row, gap / -rate)


@kernel
def count_av(w: World, road: RoadNumbers, counts: Counts) -> None:
    """Count the AV's distances and TTC to the vehicles ahead and behind in its target lane."""
    v = w.vehicles
    counts.totals[AV_STATES] += 1
    lead, rear = neighbours_in_lane(w, 0, v[0].target_lane, road.lane_width, 1)
    if lead >= 0:
        _count_pair(counts, 0, v[lead].x - v[0].x - road.length, v[lead].speed - v[0].speed)
    if rear >= 0:
        _count_pair(counts, 1, v[0].x - v[rear].x - road.length, v[0].speed - v[rear].speed)
