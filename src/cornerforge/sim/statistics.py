"""Distributions over bulk simulation: fixed histograms, counted in integers so that the order of sums does not matter.

A BV is counted in two steps: its state at a decision time (`count_states`), then, after the second, the action that it
chose there and whether it crashed (`count_choices`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.sight import DECIDED
from cornerforge.ndd.grids import GAP_GRID
from cornerforge.road.straight import ahead_by, gap, half_lengths
from cornerforge.sim.crossings import crossing_of, has_crossed, rear_at, state_at
from cornerforge.sim.neighbours import SIGHT, neighbours_in_lane, sort_by_x
from cornerforge.sim.outcome import RUNNING
from cornerforge.types import ACCELERATIONS, FIRST_ACCELERATION, SUBSTEPS

if TYPE_CHECKING:
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = [
    "AV_STATES", "BESIDE", "BV_STATES", "BV_TRAVEL_MM", "CRASHED_BVS", "CUT_INS", "CUT_IN_BANDS", "CUT_IN_PAIRS",
    "EVERYBODY", "EXPOSURE", "FOLLOWING_ACCELERATION", "FOLLOWING_STATES", "FREE_ACCELERATION", "JOINT",
    "LANE_CHANGES", "NOBODY_COUNTED", "SPEED_DIFFERENCE_BESIDE", "TRAFFIC", "TTC_BELOW", "TTC_LIMITS", "Census",
    "Counts", "HistogramGrid", "allocate_counts", "census_of", "count_av", "count_choices", "count_states",
    "count_travel", "grid_edges", "histogram_quantile", "histogram_summary",
]  # fmt: skip


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
"""The AV's exposure once a second (paper, Figure 3): BBD and TTC to the vehicles ahead and behind in its lane, TTC only
when closing. A vehicle that overlaps the AV lengthwise, which changes lanes beside it, is neither ahead nor behind."""
BESIDE = (HistogramGrid("speed_difference_beside", "m/s", -20.0, 0.02, 2000),)
"""Speed of a BV minus the speed of the BV beside it in the next lane to the right. Their centres are at most 10 m apart
along the road, and neither changes lanes."""
JOINT = (
    HistogramGrid("gap", "m", 0.0, 0.5, 240),
    HistogramGrid("time_gap", "s", 0.0, 0.05, 240),
    HistogramGrid("range_rate", "m/s", -12.0, 0.1, 240),
    HistogramGrid("acceleration_following", "m/s2", -4.1, 0.2, 31),
    HistogramGrid("acceleration_free", "m/s2", -4.1, 0.2, 31),
    HistogramGrid("inverse_ttc", "1/s", 0.0, 1.0 / 60.0, 61),
    HistogramGrid("accepted_lead_gap", "m", 0.0, 1.0, 121),
    HistogramGrid("accepted_rear_gap", "m", 0.0, 1.0, 121),
)
"""Quantities of BVs together with their speed, in classes of 1 m/s about 0, 1, ..., 40 m/s, so that traffic can be
compared with data of other speeds. Inverse TTC is 0 when not closing. An accepted gap is the gap in the next lane when
a change begins; it is in the last bin if no vehicle is there within 120 m."""
JOINT_SPEEDS = 41
CUT_INS = (
    HistogramGrid("gap", "m", 0.0, 0.05, 1500),
    HistogramGrid("time_gap", "s", 0.0, 0.005, 2000),
    HistogramGrid("inverse_ttc", "1/s", 0.0, 0.0005, 2000),
    HistogramGrid("closing_speed", "m/s", 0.0, 0.01, 2000),
)
"""Closing cut-ins, at the moment when the centre of a BV crosses into another lane: bumper-to-bumper gap to the nearest
vehicle behind there (at most 75 m, 0 where they overlap lengthwise), that vehicle's time gap, 1/TTC, and its speed
minus the BV's, which is positive. The AV counts neither as the one that changes lanes nor as the one behind."""
CUT_IN_PAIRS = (
    HistogramGrid("gap", "m", 0.0, 1.25, 60),
    HistogramGrid("time_gap", "s", 0.0, 0.1, 60),
    HistogramGrid("inverse_ttc", "1/s", 0.0, 0.0125, 60),
)
"""Two quantities of a closing cut-in, each together with the third."""
CUT_IN_BANDS = (5.0, 15.0, 25.0, 35.0)
"""Edges of the bands of the speed of the vehicle that cuts in [m/s]; other speeds are not counted."""
FARTHEST_CUT_IN = 75.0
_BESIDE_WITHIN = 10.0
TTC_LIMITS = (3.0, 4.0, 5.0, 10.0, 15.0, 20.0)
_N_BINS = 2400
_N_JOINT_BINS = 240
_FOLLOWING_GAP = GAP_GRID.upper
_ACCELERATIONS = ACCELERATIONS
_N_CUT_IN_BINS = 2000
_GRIDS = TRAFFIC + EXPOSURE + BESIDE + JOINT + CUT_INS + CUT_IN_PAIRS
_LOW = np.array([g.low for g in _GRIDS])
_WIDTH = np.array([g.width for g in _GRIDS])
_BINS = np.array([g.bins for g in _GRIDS])
_LIMITS = np.array(TTC_LIMITS)
_BANDS = np.array(CUT_IN_BANDS)
SPEED_DIFFERENCE_BESIDE = len(TRAFFIC) + len(EXPOSURE)
_FIRST_JOINT = SPEED_DIFFERENCE_BESIDE + len(BESIDE)
_FIRST_CUT_IN = _FIRST_JOINT + len(JOINT)
_FIRST_PAIR = _FIRST_CUT_IN + len(CUT_INS)
GAP, TIME_GAP, RANGE_RATE, FOLLOWING_ACCELERATION, FREE_ACCELERATION, INVERSE_TTC, LEAD_GAP, REAR_GAP = range(8)
_NOT_COUNTED, _FREE, _FOLLOWING = range(3)


class Census(NamedTuple):
    """Window of counting: BVs with low <= x - drift * time <= high, at decision times first .. until - 1.

    Attributes:
        on: Count at all; where False, counting costs nothing.
        first, until: Decision times [s].
        low, high: Limits of the counted stretch of road at time 0 [m].
        drift: The stretch moves along the road at this speed [m/s].
    """

    on: bool
    first: int
    until: int
    low: float
    high: float
    drift: float


NOBODY_COUNTED = Census(False, 0, 0, 0.0, 0.0, 0.0)
EVERYBODY = Census(True, 0, 2**31, -math.inf, math.inf, 0.0)


def census_of(counting: bool | Census) -> Census:
    """Turn `counting` into a census: True counts all BVs at all times, False none; a census is returned as it is."""
    if isinstance(counting, Census):
        return counting
    return EVERYBODY if counting else NOBODY_COUNTED


class Counts(NamedTuple):
    """Integer counts.

    Attributes:
        histograms: (10, 2400), rows in the order of TRAFFIC, EXPOSURE, BESIDE.
        joint: (8, 41, 240), rows in the order of JOINT, by speed in classes of 1 m/s.
        cut_ins: (3, 4, 2000), by CUT_IN_BANDS, rows in the order of CUT_INS.
        pairs: (3, 2, 60, 60), by CUT_IN_BANDS, the first two of CUT_IN_PAIRS by the third.
        totals: BV states, following states, lane changes begun, BV travel [mm], AV states, BVs that crashed into each
            other; then states with TTC below each of TTC_LIMITS.
    """

    histograms: NDArray[np.int64]
    joint: NDArray[np.int64]
    cut_ins: NDArray[np.int64]
    pairs: NDArray[np.int64]
    totals: NDArray[np.int64]

    def add(self, other: Counts) -> None:
        """Add the counts of `other` to these."""
        for own, more in zip(self, other, strict=True):
            own += more

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle arrays of zeros as their shapes: a range that counts nothing would send a megabyte of them."""
        return _unpickled, tuple(array if array.any() else array.shape for array in self)


def _unpickled(*arrays: NDArray[np.int64] | tuple[int, ...]) -> Counts:
    return Counts._make(np.zeros(a, dtype=np.int64) if isinstance(a, tuple) else a for a in arrays)


BV_STATES, FOLLOWING_STATES, LANE_CHANGES, BV_TRAVEL_MM, AV_STATES, CRASHED_BVS, TTC_BELOW = range(7)


def allocate_counts(*windows: int) -> Counts:
    """Allocate counts of zero; with a number of windows, that as a leading axis."""
    shapes = (
        (_FIRST_JOINT, _N_BINS),
        (len(JOINT), JOINT_SPEEDS, _N_JOINT_BINS),
        (len(CUT_IN_BANDS) - 1, len(CUT_INS), _N_CUT_IN_BINS),
        (len(CUT_IN_BANDS) - 1, 2, CUT_IN_PAIRS[0].bins, CUT_IN_PAIRS[2].bins),
        (TTC_BELOW + len(TTC_LIMITS),),
    )
    return Counts._make(np.zeros((*windows, *shape), dtype=np.int64) for shape in shapes)


def grid_edges(grid: HistogramGrid) -> NDArray[np.float64]:
    """Compute the bin edges in the grid's unit, shape (bins + 1,)."""
    return np.round(grid.low + grid.width * np.arange(grid.bins + 1), 6)


def histogram_summary(grid: HistogramGrid, counts: NDArray[np.int64]) -> dict[str, object]:
    """Compute n, mean, sd and quantiles of a histogram, exact to half a bin; None, and no quantiles, where n is 0."""
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


def histogram_quantile(grid: HistogramGrid, counts: NDArray[np.int64], percent: float) -> float | None:
    """Compute a quantile of a histogram, interpolated within its bin; None where nothing was counted."""
    cumulative = np.cumsum(counts[: grid.bins])
    if cumulative[-1] == 0:
        return None
    share = np.concatenate([[0.0], cumulative / cumulative[-1]])
    return float(np.interp(percent / 100.0, share, grid_edges(grid)))


@inlined_kernel
def _bin_of(grid: int, value: float) -> int:
    """Find the bin of a value in grid number `grid` of all; the end bins hold what lies beyond."""
    place: int = max(0, min(_BINS[grid] - 1, math.floor((value - _LOW[grid]) / _WIDTH[grid])))
    return place


@kernel
def _count(counts: Counts, row: int, value: float) -> None:
    counts.histograms[row, _bin_of(row, value)] += 1


@kernel
def _count_joint(counts: Counts, row: int, speed: float, value: float) -> None:
    """Count a value of quantity `row` of JOINT, of a vehicle with this speed [m/s]."""
    speed_class = max(0, min(JOINT_SPEEDS - 1, math.floor(speed + 0.5)))
    counts.joint[row, speed_class, _bin_of(_FIRST_JOINT + row, value)] += 1


@inlined_kernel
def _count_beside(v: NDArray[np.void], i: int, j: int, counts: Counts) -> None:
    """Count the speed difference of two vehicles within 10 m of each other, if they are BVs in adjacent lanes."""
    left = v[i].target_lane - v[j].target_lane
    if j > 0 and (left == 1 or left == -1) and v[i].duration == 0.0 and v[j].duration == 0.0:
        _count(counts, SPEED_DIFFERENCE_BESIDE, left * (v[i].speed - v[j].speed))


@kernel
def _look_ahead(w: World, rank: int, counts: Counts) -> int:
    """Find the nearest vehicle ahead in any lane that the vehicle at a rank of `order` occupies; -1 for none.

    BVs beside it, from its centre on ahead, are counted on the way.
    """
    v = w.vehicles
    i = w.order[rank]
    lead = -1
    for other in range(rank + 1, w.state[0].n_vehicles):
        j = w.order[other]
        distance = ahead_by(v, i, j)
        if distance >= SIGHT or (lead >= 0 and distance > _BESIDE_WITHIN):
            break
        if v[j].present == 0:
            continue
        if distance <= _BESIDE_WITHIN:
            _count_beside(v, i, j, counts)
        if lead < 0 and v[j].lanes & v[i].lanes:
            lead = int(j)
    return lead


@inlined_kernel
def _count_following(counts: Counts, speed: float, gap: float, rate: float) -> None:
    """Count a state behind a leader: gap [m], rate: leader minus follower [m/s]."""
    time_gap = gap / max(speed, 0.1)
    counts.totals[FOLLOWING_STATES] += 1
    _count(counts, 1, gap)
    _count(counts, 2, time_gap)
    _count(counts, 3, rate)
    _count_joint(counts, GAP, speed, gap)
    _count_joint(counts, TIME_GAP, speed, time_gap)
    _count_joint(counts, RANGE_RATE, speed, rate)
    inverse = 0.0
    if rate < 0.0:
        inverse = -rate / max(gap, 0.01)
        for k in range(_LIMITS.size):
            if gap < -rate * _LIMITS[k]:
                counts.totals[TTC_BELOW + k] += 1
    _count_joint(counts, INVERSE_TTC, speed, inverse)


@inlined_kernel
def count_states(w: World, time: int, counts: Counts, census: Census) -> float:
    """Count the states of a census's BVs at decision time `time` [s], and note them in `w.seen` for `count_choices`.

    Returns:
        The sum of their speeds, which is their travel in the coming second [m] to first order.
    """
    v = w.vehicles
    state = w.state[0]
    low = census.low + census.drift * time
    high = census.high + census.drift * time
    travel = 0.0
    sort_by_x(w)  # as the BVs' decisions will do: a second sorting changes nothing
    for rank in range(state.n_vehicles):
        i = w.order[rank]
        seen = w.seen[i]
        seen.x = v[i].x
        seen.y = v[i].y
        seen.speed = v[i].speed
        seen.lateral_speed = v[i].lateral_speed
        seen.lanes = v[i].lanes if v[i].present else 0
        seen.as_what = _NOT_COUNTED
        if i == 0 or v[i].present == 0 or not (low <= v[i].x <= high):
            continue
        counts.totals[BV_STATES] += 1
        travel += v[i].speed
        _count(counts, 0, v[i].speed)
        seen.as_what = _FREE
        lead = _look_ahead(w, rank, counts)
        if lead >= 0 and gap(v, i, lead) <= _FOLLOWING_GAP:
            seen.as_what = _FOLLOWING
            _count_following(counts, v[i].speed, gap(v, i, lead), v[lead].speed - v[i].speed)
    return travel


@kernel
def _count_accepted(w: World, i: int, target: int, counts: Counts) -> None:
    """Count the gaps ahead and behind in lane `target` that slot i had when it began to change there."""
    seen = w.seen
    bit = 1 << target
    lead_gap = math.inf
    rear_gap = math.inf
    for j in range(w.state[0].n_vehicles):
        if j == i or seen[j].lanes & bit == 0:
            continue
        dx = ahead_by(seen, i, j)
        if dx > 0.0:
            lead_gap = min(lead_gap, dx - half_lengths(w.vehicles, i, j))
        else:
            rear_gap = min(rear_gap, -dx - half_lengths(w.vehicles, i, j))
    _count_joint(counts, LEAD_GAP, seen[i].speed, min(lead_gap, 1e6))
    _count_joint(counts, REAR_GAP, seen[i].speed, min(rear_gap, 1e6))


@kernel
def _count_cut_in(w: World, i: int, road: RoadNumbers, counts: Counts) -> None:
    """Count slot i, which crossed into another lane in the second that is over, if it cut in on a faster BV."""
    when, lane = crossing_of(w, i, road.lane_width)
    x, speed = state_at(w, i, when)
    band = -1
    for k in range(_BANDS.size - 1):
        if _BANDS[k] <= speed < _BANDS[k + 1]:
            band = k
    rear = rear_at(w, i, lane, when, road.lane_width)
    if band < 0 or rear <= 0:
        return
    rear_x, rear_speed = state_at(w, rear, when)
    closing = rear_speed - speed
    room = max(0.0, x - rear_x - half_lengths(w.vehicles, rear, i))
    if closing <= 0.0 or room > FARTHEST_CUT_IN:
        return
    values = (room, room / max(rear_speed, 0.1), closing / max(room, 0.01), closing)
    for k in range(len(values)):
        counts.cut_ins[band, k, _bin_of(_FIRST_CUT_IN + k, values[k])] += 1
    for k in range(2):
        counts.pairs[band, k, _bin_of(_FIRST_PAIR + k, values[k]), _bin_of(_FIRST_PAIR + 2, values[2])] += 1


@kernel
def count_choices(w: World, road: RoadNumbers, counts: Counts) -> None:
    """Count the actions of the BVs that `count_states` counted, their cut-ins, and their crashes in the second since.

    A lane change holds the speed: it counts as acceleration 0. A counted BV that is absent now counts as crashed if
    there was any crash between BVs in that second. Cut-ins of a second in which the test ended early are not counted:
    some vehicles then stand where it began.
    """
    v = w.vehicles
    n = w.state[0].n_vehicles
    has_crash = w.state[0].bv_crashes > w.state[0].bv_crashes_before
    is_whole = w.state[0].outcome == RUNNING or w.state[0].frame == SUBSTEPS * w.state[0].decisions
    for i in range(1, n):
        if w.seen[i].as_what == _NOT_COUNTED:
            continue
        if has_crash and v[i].present == 0:
            counts.totals[CRASHED_BVS] += 1
        if is_whole and v[i].present and has_crossed(w, i, road.lane_width):
            _count_cut_in(w, i, road, counts)
        acceleration = 0.0
        if v[i].action >= FIRST_ACCELERATION:
            acceleration = _ACCELERATIONS[v[i].action - FIRST_ACCELERATION]
        elif w.seen[i].lanes & (1 << v[i].target_lane) == 0:  # to turn back is no lane change
            counts.totals[LANE_CHANGES] += 1
            _count_accepted(w, i, v[i].target_lane, counts)
        _count(counts, 4, acceleration)
        row = FOLLOWING_ACCELERATION if w.seen[i].as_what == _FOLLOWING else FREE_ACCELERATION
        _count_joint(counts, row, w.seen[i].speed, acceleration)


@inlined_kernel
def count_travel(w: World, counts: Counts) -> None:
    """Count the distance that the counted BVs drove since it was last counted, cut to whole millimetres."""
    counts.totals[BV_TRAVEL_MM] += int(w.state[0].travel * 1000.0)
    w.state[0].travel = 0.0


@kernel
def _count_pair(counts: Counts, row: int, gap: float, rate: float) -> None:
    """Count a neighbour of the AV in EXPOSURE: its BBD in row `row`, its TTC two rows further when closing."""
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
    lead, rear = neighbours_in_lane(w, 0, v[0].target_lane, road.lane_width, DECIDED)
    if lead >= 0:
        _count_pair(counts, 0, gap(v, 0, lead), v[lead].speed - v[0].speed)
    if rear >= 0:
        _count_pair(counts, 1, gap(v, rear, 0), v[0].speed - v[rear].speed)
