"""The naturalistic driver: look-ups in the tables of `cornerforge.ndd.model`, compiled.

Sampling compares 32-bit random words with 32-bit cumulative tables, so it is exact to 2.3e-10 and free of rounding.

A range rate between two grid points is rounded at random, up with the chance of its fraction: with one look-up the
distribution is the linear interpolation of the two rows. Rounding to the nearest instead cost 0.04 nat per decision on
held-out drivers above 19.5 m/s; interpolating in speed and gap too gained nothing more (docs/results.md).
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._elementary import exp
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.ndd.grids import GAP_GRID, LACK_GRID, RANGE_RATE_GRID, SLOW_GRID, SPEED_GRID, Grid
from cornerforge.ndd.initial import traffic_at_start
from cornerforge.ndd.memory import MemoryNumbers, memory_numbers
from cornerforge.types import ACCELERATIONS, N_ACCELERATIONS

if TYPE_CHECKING:
    from numpy import uint64

    from cornerforge.ndd.model import NddModel

__all__ = [
    "InitialNumbers",
    "NddTables",
    "accept_chance",
    "following_row",
    "free_row",
    "lane_change_base",
    "sample_row",
    "tables_of",
    "turn_back_chance",
]

MAX_TABLE_CLOSING = -RANGE_RATE_GRID.low
"""Fastest closing on the grid [m/s]; see `table_row`."""
MAX_TABLE_GAP = GAP_GRID.upper
"""Free flow begins here [m]."""
NEAREST = 0.5
"""The rounding that takes the nearest column; used for the lane-change tables, which are smooth."""
FIRST_PROBE = 15
"""The column of `cut` where `sample_row` begins; it shares a cache line with most columns that are read next."""
_FIRST_FREE_ROW = SPEED_GRID.bins * GAP_GRID.bins * RANGE_RATE_GRID.bins
_FIRST_SLOW_ROW = _FIRST_FREE_ROW + SPEED_GRID.bins * LACK_GRID.bins
_SLOWER = SPEED_GRID.lower
"""Below this speed [m/s] the rows of traffic that stops begin."""
_ACCELERATIONS = ACCELERATIONS
_MOST_TILT = 32.0
"""Strongest tilt that is looked for [s2/m]: it puts nearly all weight on the outermost possible acceleration."""
_LAST_WORD = np.uint64(0xFFFFFFFE)
_CRAWLS = 5.0
LEVELS = 1024
"""Number of equally frequent values that stand for the distribution of a trait between drivers."""

Floats = NDArray[np.float64]


class InitialNumbers(NamedTuple):
    """`ndd.initial.InitialState` as kernels take it: the same names, units and order."""

    speed_mean: float
    stream_sd: float
    speed_sd: float
    speed_low: float
    speed_high: float
    follow_share: float
    time_gap_shift: float
    time_gap_median: float
    time_gap_sigma: float
    desire_share: float
    habit_spread: float
    rr_scale: float
    rr_exponent: float
    min_ttc: float
    free_gap_low: float
    free_gap_high: float
    change_median: float
    change_sigma: float
    change_low: float
    change_high: float
    signal_share: float


class NddTables(NamedTuple):
    """The model as kernels take it.

    Attributes:
        p: P(acceleration), float32 (21 * 116 * 19 + 21 * 25, 31): following states, then free flow by speed and lack;
            then, where traffic stops (`slow`), following states below 20 m/s, 20 * 116 * 19 rows.
        cut: Cumulative, scaled to 2^32, uint32 (as many, 32): the last column is never passed.
        slow: Drivers below 20 m/s follow by rows of their own; else as at 20 m/s.
        lc_base: (21,); lc_desire: (116, 19); lc_accept: (2, 116, 19), lead and rear. float32.
        lc_turn_back: (116, 19), float32.
        lc_desire_free, overlook, overlook_conflict: Numbers of the model.
        lc_most: Upper bound of `lane_change_base`.
        memory: How a follower's acceleration depends on its own past.
        initial: Traffic at the start of a test.
        noise: Noise level of each of LEVELS equally frequent kinds of drivers (`ndd.memory.own_rank`), float64.
        inattention: How many times as often as all drivers each of as many kinds begins to look away, float64; mean 1.
    """

    p: NDArray[np.float32]
    cut: NDArray[np.uint32]
    slow: bool
    lc_base: NDArray[np.float32]
    lc_desire: NDArray[np.float32]
    lc_accept: NDArray[np.float32]
    lc_turn_back: NDArray[np.float32]
    lc_desire_free: float
    overlook: float
    overlook_conflict: float
    lc_most: float
    memory: MemoryNumbers
    initial: InitialNumbers
    noise: NDArray[np.float64]
    inattention: NDArray[np.float64]


def _levels() -> Floats:
    """Return the normal quantiles in the middle of LEVELS equal shares, with 9 digits: alike with any C library."""
    return np.array([round(NormalDist().inv_cdf((k + 0.5) / LEVELS), 9) for k in range(LEVELS)])


@kernel
def _log_normal(z: Floats, sigma: float, out: Floats) -> None:
    """Write exp(sigma z), with the kernels' own exp."""
    for k in range(z.size):
        out[k] = exp(sigma * z[k])


def _cuts(p: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Make the cumulative table scaled to 2^32, from the 31st entry on 2^32 - 1; an impossible action has width 0."""
    cumulative = np.cumsum(p, axis=-1, dtype=np.float64)
    cumulative /= cumulative[..., -1:]
    cuts = np.full((p.shape[0], 32), 2**32 - 1, dtype=np.uint32)
    cuts[:, :N_ACCELERATIONS] = np.minimum(np.floor(cumulative * 2.0**32), 2.0**32 - 1.0)
    return cuts


@kernel
def _tilted_mean(row: NDArray[np.float32], theta: float) -> float:
    """Compute the mean acceleration of a row tilted by exp(theta a) [m/s2]."""
    total = 0.0
    weighted = 0.0
    for a in range(N_ACCELERATIONS):
        weight = row[a] * exp(theta * _ACCELERATIONS[a])
        total += weight
        weighted += weight * _ACCELERATIONS[a]
    return weighted / total


@kernel
def _tilt(free: NDArray[np.float32], pull: float, out: NDArray[np.float32]) -> None:
    """Fill (21, 25, 31) with the free accelerations of drivers that lack LACK_GRID's speeds (`NddModel.free_pull`).

    The tilt is found by halving, within what 32 m/s2 of tilt can do; with the kernels' own exp, so that a model gives
    the same bits everywhere.
    """
    for i in range(free.shape[0]):
        mean = _tilted_mean(free[i], 0.0)
        for k in range(LACK_GRID.bins):
            lack = LACK_GRID.low + LACK_GRID.step * k
            low = -_MOST_TILT
            high = _MOST_TILT
            for _ in range(48):
                theta = 0.5 * (low + high)
                if _tilted_mean(free[i], theta) < mean + pull * lack:
                    low = theta
                else:
                    high = theta
            theta = 0.0 if pull * lack == 0.0 else 0.5 * (low + high)
            total = 0.0
            for a in range(N_ACCELERATIONS):
                total += free[i, a] * exp(theta * _ACCELERATIONS[a])
            for a in range(N_ACCELERATIONS):
                tilted = free[i, a] * exp(theta * _ACCELERATIONS[a]) / total
                out[i, k, a] = free[i, a] if theta == 0.0 else tilted


def tables_of(model: NddModel, *, stops: bool = False, traffic: str = "free") -> NddTables:
    """Prepare a model for the kernels (about 20 ms, 12 MB).

    Args:
        model: The model.
        stops: Traffic stops in this world (`RoadNumbers.stops`); rows for that are added if the model has them.
        traffic: Kind of the traffic at the start.
    """
    free = np.empty((SPEED_GRID.bins, LACK_GRID.bins, N_ACCELERATIONS), dtype=np.float32)
    _tilt(model.free, float(model.free_pull), free)
    blocks = [model.following, free, *([model.slow] if stops and model.slow is not None else [])]
    p = np.concatenate([block.reshape(-1, N_ACCELERATIONS) for block in blocks])
    start = traffic_at_start(model.initial, traffic)
    initial = InitialNumbers(**{name: float(getattr(start, name)) for name in InitialNumbers._fields})
    odds, often = np.empty(LEVELS), np.empty(LEVELS)
    _log_normal(_levels(), float(model.initial.noise_spread), odds)
    _log_normal(_levels(), float(model.initial.vigilance_sigma), often)
    return NddTables(
        p=p,
        cut=_cuts(p),
        slow=p.shape[0] > _FIRST_SLOW_ROW,
        lc_base=model.lc_base,
        lc_desire=model.lc_desire,
        lc_accept=np.stack([model.lc_accept_lead, model.lc_accept_rear]),
        lc_turn_back=model.lc_turn_back,
        lc_desire_free=float(model.lc_desire_free),
        overlook=float(model.overlook),
        overlook_conflict=float(model.overlook_conflict),
        lc_most=float(model.lc_base.max()) * max(float(model.lc_desire.max()), float(model.lc_desire_free)),
        memory=memory_numbers(model.memory),
        initial=initial,
        noise=(odds - 1.0) / (odds + 1.0),
        inattention=often / math.fsum(often) * LEVELS,
    )


@inlined_kernel
def _index(grid: Grid, value: float, rounding: float) -> int:
    """Find a grid point: the nearest for a `rounding` of 0.5, an end for values outside the grid; as `Grid.place`."""
    place = math.floor(value / grid.step + rounding) - int(grid.low / grid.step)
    return max(0, min(grid.bins - 1, place))


@kernel
def speed_index(speed: float) -> int:
    """Find the nearest row of the speed grid; speeds outside 20..40 m/s take the end rows."""
    return _index(SPEED_GRID, speed, NEAREST)


@kernel
def gap_index(gap: float) -> int:
    """Find the nearest row of the gap grid; gaps outside 0..115 m take the end rows."""
    return _index(GAP_GRID, gap, NEAREST)


@kernel
def range_rate_index(range_rate: float, rounding: float) -> int:
    """Find the column of the range rate grid; rates outside -10..8 m/s take the end columns.

    Args:
        range_rate: Lead minus subject [m/s].
        rounding: In [0, 1), added before rounding down. 0.5 takes the nearest column; a uniform random number takes the
            upper column with the chance of the rate's fraction.
    """
    return _index(RANGE_RATE_GRID, range_rate, rounding)


@inlined_kernel
def table_row(gap: float, range_rate: float, rounding: float) -> tuple[int, int]:
    """Find the grid place (gap, range rate) of a state; (-1, -1) for free flow (gap above 115.5 m).

    `rounding` as for `range_rate_index`. A state that closes faster than the grid's 10 m/s is looked up at 10 m/s and
    the gap 4 + (gap - 4) (10 / closing)^2, from which stopping the closing with 4 m left needs the same deceleration.
    So no state outside the tables is taken for a milder one.
    """
    closing = -range_rate
    if closing > MAX_TABLE_CLOSING and gap > 4.0:
        scale = MAX_TABLE_CLOSING / closing
        gap = 4.0 + (gap - 4.0) * scale * scale
    if gap > MAX_TABLE_GAP:
        return -1, -1
    return gap_index(gap), range_rate_index(range_rate, rounding)


@inlined_kernel
def free_row(speed: float, desired_speed: float) -> int:
    """Find the row of `p` and `cut` for free flow; `desired_speed`: the driver's [m/s]."""
    return _FIRST_FREE_ROW + speed_index(speed) * LACK_GRID.bins + _index(LACK_GRID, desired_speed - speed, NEAREST)


@inlined_kernel
def following_row(
    tables: NddTables, speed: float, desired_speed: float, gap: float, range_rate: float, rounding: float
) -> int:
    """Find the row of `p` and `cut` for a state behind a lead; the free-flow row beyond the grid."""
    gap_row, rate_row = table_row(gap, range_rate, rounding)
    if gap_row < 0:
        return free_row(speed, desired_speed)
    if tables.slow and speed < _SLOWER:
        place = _index(SLOW_GRID, speed, NEAREST)
        return _FIRST_SLOW_ROW + (place * GAP_GRID.bins + gap_row) * RANGE_RATE_GRID.bins + rate_row
    return (speed_index(speed) * GAP_GRID.bins + gap_row) * RANGE_RATE_GRID.bins + rate_row


@inlined_kernel
def sample_row(cut: NDArray[np.uint32], row: int, word: uint64) -> int:
    """Draw the acceleration index 0..30 of a row with a random word: the first index with a cut above the word.

    The binary search has no branches, which the processor could not predict: it is four times as fast. The smallest
    index of several rows with one word brakes at least as hard as each row alone.
    """
    word = min(word, _LAST_WORD)  # the last cut stands for 2^32: without this an impossible last action could be drawn
    index = FIRST_PROBE + 1 if np.uint64(cut[row, FIRST_PROBE]) <= word else 0
    index += 8 if np.uint64(cut[row, index + 7]) <= word else 0
    index += 4 if np.uint64(cut[row, index + 3]) <= word else 0
    index += 2 if np.uint64(cut[row, index + 1]) <= word else 0
    index += 1 if np.uint64(cut[row, index]) <= word else 0
    return index


@inlined_kernel
def turn_back_chance(turn_back: NDArray[np.float32], gap: float, range_rate: float) -> float:
    """Compute the chance that a driver turns back for one neighbour in its target lane; as for `accept_chance`."""
    if gap <= 0.0:
        return 1.0
    gap_row, rate_row = table_row(gap, range_rate, NEAREST)
    if gap_row < 0:
        return 0.0
    return float(turn_back[gap_row, rate_row])


@inlined_kernel
def lane_change_base(tables: NddTables, speed: float, lead_gap: float, range_rate: float) -> float:
    """Compute the chance to want a change to one given side in this decision, before gap acceptance.

    Args:
        tables: The model.
        speed: Speed of the subject [m/s].
        lead_gap: Gap to the vehicle ahead in its lane [m]; +inf for none.
        range_rate: Lead minus subject [m/s].

    In traffic that stops the chance fades below 5 m/s: a vehicle that stands cannot change lanes.
    """
    gap_row, rate_row = table_row(lead_gap, range_rate, NEAREST)
    desire = tables.lc_desire_free if gap_row < 0 else float(tables.lc_desire[gap_row, rate_row])
    if tables.slow and speed < _CRAWLS:
        desire *= speed / _CRAWLS
    return float(tables.lc_base[speed_index(speed)]) * desire


@inlined_kernel
def accept_chance(accept: NDArray[np.float32], rear: int, gap: float, range_rate: float) -> float:
    """Compute the chance that an attentive driver accepts the gap to one neighbour; 1 for a neighbour beyond the grid.

    Between two columns of range rate the chance is interpolated linearly: taken from the nearest, it would jump at a
    closing speed of 0.5 m/s, where half of all cut-ins are.

    Args:
        accept: `NddTables.lc_accept`.
        rear: 1 for the neighbour behind, 0 for the one ahead.
        gap: Bumper to bumper [m]; +inf for no neighbour; 0 or less, where the two overlap lengthwise: never accepted.
        range_rate: Front vehicle minus rear vehicle of the two [m/s]; negative when closing.
    """
    if gap <= 0.0:
        return 0.0
    gap_row, column = table_row(gap, range_rate, 0.0)
    if gap_row < 0:
        return 1.0
    column = min(column, RANGE_RATE_GRID.bins - 2)
    share = max(0.0, min(1.0, (range_rate - RANGE_RATE_GRID.low) / RANGE_RATE_GRID.step - column))
    return (1.0 - share) * float(accept[rear, gap_row, column]) + share * float(accept[rear, gap_row, column + 1])
