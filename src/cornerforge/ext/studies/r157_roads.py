"""How often a cut-in of the regulation's grid happens on real roads, by a fit to recorded cut-ins.

Source: 157,745 closing cut-ins ahead of instrumented cars at the crossing of the lane marking, Safety Pilot Model
Deployment (SPMD, Michigan; published by D. Zhao's group). Their other vehicle drove at 5 to 35 m/s, the gap was at most
75 m. In three bands of its speed, 1/TTC is taken as exponential and 1/gap - 1/75 m as generalised Pareto, independent
of each other, as that group has it; medians and 95 % points of gap and closing speed come out within 15 % of what was
recorded. Of cut-ins at 5-15 m/s the fit has those that close with 11 m/s 2.7 times as often as the records, and with 14
m/s 8 times.

The lateral speed was not recorded; it is assumed. A lane change takes 6.3 s in the mean, standard deviation 2.0 s (Lee,
Olsen and Wierwille 2004, NHTSA), here log-normal, and leads over 3.5 m at one speed. The marking is taken to be crossed
by the vehicle's centre.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["closing_at_least", "cut_in_density"]

_FARTHEST = 75.0
_LANE_WIDTH = 3.5
_TO_MARKING = 0.5 * _LANE_WIDTH
_MEAN_TIME, _SD_TIME = 6.3, 2.0


class _Band(NamedTuple):
    """Speeds of the vehicle that cuts in [m/s], its share of the cut-ins, and the fit there.

    Attributes:
        low, high: The speeds.
        share: Share of the recorded cut-ins.
        urgency: Mean of 1/TTC [1/s].
        shape, scale: Parameters of the generalised Pareto distribution of 1/gap - 1/75 m; scale in [1/m].
    """

    low: float
    high: float
    share: float
    urgency: float
    shape: float
    scale: float


_BANDS = (
    _Band(5.0, 15.0, 0.480, 0.0632, 0.388, 0.00902),
    _Band(15.0, 25.0, 0.238, 0.0302, 0.274, 0.0103),
    _Band(25.0, 35.0, 0.281, 0.0214, 0.201, 0.0112),
)


def _band(speed: float) -> _Band | None:
    return next((band for band in _BANDS if band.low <= speed < band.high), None)


def _gap_density(gap: NDArray[np.float64], band: _Band) -> NDArray[np.float64]:
    """Density of the gap at the marking [1/m]; 0 where none were recorded."""
    there = (gap > 0.0) & (gap <= _FARTHEST)
    r = np.where(there, gap, _FARTHEST)
    z = 1.0 / r - 1.0 / _FARTHEST
    pareto = (1.0 + band.shape * z / band.scale) ** (-1.0 / band.shape - 1.0) / band.scale
    return np.asarray(np.where(there, pareto / r**2, 0.0))


def closing_at_least(other: float, closing: float) -> float | None:
    """Compute the share of closing cut-ins at a speed of the other vehicle that close at least so fast [both m/s].

    None where no cut-in was recorded at this speed.

    >>> round(closing_at_least(27.8, 8.33), 5)
    0.00101
    """
    band = _band(other)
    if band is None:
        return None
    gap = np.linspace(0.05, _FARTHEST, 1500)
    density = _gap_density(gap, band)
    return float((density * np.exp(-closing / (gap * band.urgency))).sum() / density.sum())


def cut_in_density(
    other: float, closing: float, gap: NDArray[np.float64], lateral_speed: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Compute how often cut-ins happen, relative to each other; None: no record at this speed.

    Args:
        other: Speed of the vehicle that cuts in [m/s].
        closing: How much faster the one behind is [m/s], above 0.
        gap: When the lateral speed is reached, a lane's width aside [m], (S,).
        lateral_speed: [m/s], (S,).

    Returns:
        (S,): density in the gap [m], the closing speed and the lateral speed [m/s], times the share of the band of
        `other`; 0 where the other is passed, or farther away than was recorded, when it crosses the marking.
    """
    band = _band(other)
    if band is None:
        return None
    at_marking = gap - closing * _TO_MARKING / lateral_speed
    near = np.where(at_marking > 0.0, at_marking, 1.0)
    of_closing = np.exp(-closing / (near * band.urgency)) / (near * band.urgency)
    return band.share * _gap_density(at_marking, band) * of_closing * _lateral_density(lateral_speed)


def _lateral_density(lateral_speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Density of the lateral speed of a lane change [s/m]."""
    variance = math.log(1.0 + (_SD_TIME / _MEAN_TIME) ** 2)
    mean = math.log(_MEAN_TIME) - 0.5 * variance
    time = _LANE_WIDTH / lateral_speed
    normal = np.exp(-0.5 * (np.log(time) - mean) ** 2 / variance) / math.sqrt(2.0 * math.pi * variance)
    return np.asarray(normal / time * _LANE_WIDTH / lateral_speed**2)
