"""Memory of drivers: how long time gaps last, and whether one second's acceleration predicts the next one's.

Shapes: K worlds, T seconds, N slots; m pairs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.judging import judged, spread
from cornerforge.ndd.grids import GAP_GRID
from cornerforge.results.validation import FactFound
from cornerforge.road.straight import along

__all__ = ["PERSISTENCE", "Pairs", "compare_persistence", "pairs_of", "residuals"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STARTS = (10, 20, 30)
LAGS = (10, 20, 30, 40)
SECONDS = (10, 20, 30, 40, 50)
"""Seconds after the start at which pairs and accelerations are looked at."""
_TIMES = sorted({s + k for s in SECONDS for k in (0, 1, 2)} | {s + lag for s in STARTS for lag in LAGS})
_IN_LANE = 0.05
_FEWEST = 20
_NO_LEAD = -1
PERSISTENCE = {10: (0.92, 0.87, 0.97), 20: (0.80, 0.72, 0.88), 30: (0.66, 0.56, 0.76)}
"""Correlation of ln time gap after so many seconds, and the range allowed."""
RESIDUAL_ALLOWED = (0.2, 0.9)


class Pairs(NamedTuple):
    """Counts of followers' behaviour in one block of worlds.

    Attributes:
        time_gaps: Lag -> ln time gap of the same follower and leader, first and so many seconds later, (2, m).
        seconds: Two successive seconds of a follower: speed [m/s], gap [m], range rate [m/s] when each begins, and the
            acceleration over it [m/s2], (2, 4, m).
    """

    time_gaps: dict[int, Floats]
    seconds: Floats


def _leaders(states: NDArray[np.void], length: Floats, lane_width: float) -> tuple[Ints, Floats]:
    """Find each vehicle's leader (the nearest centre ahead in its lane, -1 for none) and the gap [m]."""
    shape = states.shape
    lane = np.floor(states["y"] / lane_width).astype(np.int64)
    scene = np.arange(shape[0] * shape[1]).reshape(shape[0], shape[1], 1)
    key = np.where(states["present"] == 1, scene * 16 + lane, -1).ravel()
    order = np.lexsort((states["x"].ravel(), key))
    behind, ahead = order[:-1], order[1:]
    same = (key[behind] == key[ahead]) & (key[behind] >= 0)
    flat = np.full(key.size, _NO_LEAD, dtype=np.int64)
    flat[behind[same]] = ahead[same] % shape[2]
    lead: Ints = flat.reshape(shape)
    k, t = np.ogrid[: shape[0], : shape[1]]
    lead_x = states["x"][k[..., None], t[..., None], lead]
    own = np.broadcast_to(length[:, None, :], shape)
    gap = along(states["x"], lead_x) - 0.5 * (own + length[k[..., None], lead])
    return lead, np.where(lead == _NO_LEAD, np.inf, gap)


def pairs_of(states: NDArray[np.void], length: Floats, counted: NDArray[np.bool_], lane_width: float) -> Pairs:
    """Find pairs of leader and follower in noted states.

    Args:
        states: Vehicles after 0, 1, ... whole seconds, (K, T, N) of `fields.FRAME_FIELDS`; slot 0 is the AV.
        length: Length of the vehicles [m], (K, N).
        counted: Which followers count, (K, T, N).
        lane_width: [m].
    """
    times = [time for time in _TIMES if time < states.shape[1]]
    at = {time: place for place, time in enumerate(times)}
    chosen = states[:, times]
    lead, gap = _leaders(chosen, length, lane_width)
    speed = chosen["speed"]
    follows = counted[:, times] & (lead > 0) & (gap > 0.0) & (gap <= GAP_GRID.upper)
    follows[..., 0] = False
    log_gap = np.log(np.maximum(gap, 0.01) / np.maximum(speed, 0.1))
    time_gaps = {}
    for lag in LAGS:
        found = []
        for start in STARTS:
            if start + lag in at:
                a, b = at[start], at[start + lag]
                same = follows[:, a] & (lead[:, a] == lead[:, b]) & (gap[:, b] > 0.0)
                found.append(np.array([log_gap[:, a][same], log_gap[:, b][same]]))
        time_gaps[lag] = np.concatenate(found, axis=1) if found else np.zeros((2, 0))
    lead_speed = np.take_along_axis(speed, np.maximum(lead, 0), axis=2)
    keeps = (chosen["present"] == 1) & (np.abs(chosen["y"] - lane_width * (chosen["target_lane"] + 0.5)) < _IN_LANE)
    rows = []
    for second in SECONDS:
        if second + 2 not in at:
            continue
        a, b, c = (at[second + k] for k in range(3))
        lane = chosen["target_lane"]
        use = follows[:, a] & (lead[:, a] == lead[:, b]) & (gap[:, b] > 0.0) & (gap[:, b] <= GAP_GRID.upper)
        use &= keeps[:, a] & keeps[:, b] & keeps[:, c] & (lane[:, a] == lane[:, b]) & (lane[:, b] == lane[:, c])
        two = [
            [speed[:, i][use], gap[:, i][use], (lead_speed - speed)[:, i][use], (speed[:, j] - speed[:, i])[use]]
            for i, j in ((a, b), (b, c))
        ]
        rows.append(np.array(two))
    return Pairs(time_gaps, np.concatenate(rows, axis=2) if rows else np.zeros((2, 4, 0)))


def residuals(seconds: Floats) -> Floats:
    """Compute accelerations less their mean in like states, (2, m); NaN in states that hold fewer than 20.

    Like states: speed in classes of 2 m/s, ln time gap in classes of 0.15, range rate in classes of 0.5 m/s. So what
    remains is what the present state does not explain, in simulated and in recorded traffic alike.

    Args:
        seconds: As in `Pairs`.
    """
    speed, gap, rate, acceleration = np.moveaxis(seconds, 1, 0)
    classes = np.array(
        [np.floor(speed / 2.0), np.floor(np.log(gap / np.maximum(speed, 0.1)) / 0.15), np.floor(rate / 0.5)]
    ).reshape(3, -1)
    _, cell = np.unique(classes, axis=1, return_inverse=True)
    size = np.bincount(cell.ravel())
    mean = np.bincount(cell.ravel(), weights=acceleration.ravel()) / size
    mean[size < _FEWEST] = np.nan
    return np.asarray(acceleration - mean[cell].reshape(acceleration.shape))


def _sums(first: Floats, second: Floats) -> Floats:
    """Sums from which a correlation is computed, (6,)."""
    known = np.isfinite(first) & np.isfinite(second)
    a, b = first[known], second[known]
    return np.array([a.size, a.sum(), b.sum(), (a * a).sum(), (b * b).sum(), (a * b).sum()])


def _correlation(sums: Floats) -> float | None:
    n, a, b, aa, bb, ab = sums
    variances = (n * aa - a * a) * (n * bb - b * b)
    return float((n * ab - a * b) / np.sqrt(variances)) if n > 2 and variances > 0.0 else None


def compare_persistence(blocks: Sequence[Pairs]) -> list[FactFound]:
    """Compare how long time gaps last, and how alike the residual accelerations of successive seconds are, with data.

    Args:
        blocks: Pairs by block of worlds, the sampling unit of the intervals.
    """
    rows = []
    for lag in LAGS:
        published, *allowed = PERSISTENCE.get(lag, (0.57,))
        source = "a motorway with 37 followers" if allowed else "NGSIM I-80 (congested), US DOT FHWA; shown only"
        rows.append(
            _row(
                f"correlation of ln time gap after {lag} s", published, tuple(allowed) or None, source,
                [_sums(*block.time_gaps[lag]) for block in blocks], "10-60 s",
            )
        )  # fmt: skip
    left = residuals(np.concatenate([block.seconds for block in blocks], axis=2))
    ends = np.cumsum([block.seconds.shape[2] for block in blocks])[:-1]
    sums = [_sums(*part) for part in np.split(left, ends, axis=1)]
    name = "correlation of residual acceleration with that of the next second"
    source = "recorded drivers .4 to .9 (NGSIM, US DOT FHWA; smoothing inflates it)"
    return [*rows, _row(name, (0.4, 0.9), RESIDUAL_ALLOWED, source, sums, "10-52 s")]


def _row(name: str, published: Any, allowed: Any, source: str, sums: list[Floats], when: str) -> FactFound:
    total = np.sum(sums, axis=0)
    found = _correlation(total)
    interval = spread(found, [_correlation(total - some) for some in sums])
    return judged(
        found, allowed, theme="persistence", when=when, fact=name, unit="", published=published, source=source,
        n=int(total[0]), interval95=interval,
    )  # fmt: skip
