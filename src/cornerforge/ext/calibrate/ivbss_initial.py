"""The published distributions of traffic at the start, reduced to the law of `InitialState` by maximum likelihood.

Speeds: P(speed), 21 values. Gap and range rate of the next vehicle ahead: P(gap, range rate | speed of the follower).
Each grid value stands for the interval of half a step to both sides. `InitialState` is a law of few parameters; its
error is reported as `misfit`, the total variation distance between the table and the law (0 to 1).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID, SPEED_GRID
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS

__all__ = ["fit_gaps", "fit_speeds", "gap_law", "speed_law"]

Floats = NDArray[np.float64]

_TINY = 1e-300
_FLOOR = 1e-9
"""Least probability of a state in the fit, so that a few states that the law calls impossible do not decide it."""
_OPTIONS = {"xatol": 1e-7, "fatol": 1e-10, "maxiter": 4000}


def speed_law(initial: InitialState) -> Floats:
    """Compute P(speed) on the grid, shape (21,): the normal, cut to [speed_low, speed_high]."""
    from scipy.special import ndtr

    edges = np.clip(SPEED_GRID.edges(), initial.speed_low, initial.speed_high)
    mass = np.diff(ndtr((edges - initial.speed_mean) / math.hypot(initial.stream_sd, initial.speed_sd)))
    return np.asarray(mass / max(float(mass.sum()), _TINY))


def gap_law(initial: InitialState) -> Floats:
    """Compute P(gap, range rate | speed) of a following vehicle on the grid, shape (21, 116, 19); gap 0 is impossible.

    The stream's mean speed is not known; given the speed it is normal.

    As in the simulator, times to collision below `min_ttc` and leaders slower than `speed_low` or faster than
    `speed_high` are impossible. A speed at which nothing is possible has a row of zeros.
    """
    from scipy.special import ndtr

    speed, gap = SPEEDS[:, None], GAPS[None, 1:]
    beyond = np.maximum(GAP_GRID.edges()[None, 1:] / speed - initial.time_gap_shift, _TINY)
    edges = np.log(beyond / initial.time_gap_median)
    by_gap = np.diff(ndtr(edges / initial.time_gap_sigma), axis=1)
    scale = np.minimum(initial.rr_scale * (gap / 20.0) ** initial.rr_exponent, initial.speed_sd)[..., None]
    kept = np.sqrt(1.0 - (scale / initial.speed_sd) ** 2)
    between = initial.stream_sd**2 / (initial.stream_sd**2 + initial.speed_sd**2)
    centre = (kept - 1.0) * (1.0 - between) * (speed[..., None] - initial.speed_mean)
    scale = np.hypot(scale, (1.0 - kept) * initial.speed_sd * math.sqrt(between))
    rates = RANGE_RATE_GRID.edges()
    by_rate = np.diff(ndtr((rates - centre) / scale), axis=2)
    mass = np.zeros((SPEEDS.size, GAPS.size, RANGE_RATES.size))
    mass[:, 1:] = by_gap[..., None] * by_rate
    mass *= _possible(initial)
    total = mass.sum(axis=(1, 2), keepdims=True)
    return np.asarray(np.divide(mass, total, out=np.zeros_like(mass), where=total > 0.0))


def _possible(initial: InitialState) -> NDArray[np.bool_]:
    """Tell which states the limits of the law allow, shape (21, 116, 19)."""
    lead = SPEEDS[:, None, None] + RANGE_RATES
    slow_enough = GAPS[:, None] >= -initial.min_ttc * RANGE_RATES
    inside = (lead >= initial.speed_low) & (lead <= initial.speed_high)
    return np.asarray(inside & slow_enough & (GAPS[:, None] > 0.0))


def fit_speeds(table: Floats, start: InitialState) -> tuple[InitialState, dict[str, float]]:
    """Fit the mean and spread of speeds that make P(speed), shape (21,), most likely.

    Returns:
        `start` with mean and spread fitted, and `misfit`, `mean` and `sd` (of the table itself [m/s]).
    """
    from scipy.optimize import minimize

    def loss(x: Floats) -> float:
        law = speed_law(replace(start, speed_mean=float(x[0]), speed_sd=float(np.exp(x[1]))))
        return -float(table @ np.log(np.maximum(law, _FLOOR)))

    best = minimize(loss, [start.speed_mean, np.log(start.speed_sd)], method="Nelder-Mead", options=_OPTIONS).x
    fitted = replace(
        start, speed_mean=float(np.clip(best[0], 0.0, 60.0)), speed_sd=float(np.exp(np.clip(best[1], -3, 3)))
    )
    mean = float(table @ SPEEDS)
    sd = float(np.sqrt(table @ (SPEEDS - mean) ** 2))
    return fitted, {"misfit": 0.5 * float(np.abs(table - speed_law(fitted)).sum()), "mean": mean, "sd": sd}


def fit_gaps(table: Floats, speeds: Floats, start: InitialState) -> tuple[InitialState, dict[str, float]]:
    """Fit the law of gap and range rate that makes P(gap, range rate | speed), shape (21, 116, 19), most likely.

    Args:
        table: Rows (one for each speed) sum to 1, or are 0 without data.
        speeds: Weights of the speeds, shape (21,).
        start: Its speeds, TTC limit and follow share are kept.

    Returns:
        `start` with time gap and range rate fitted, `misfit` (mean over speeds), and `impossible`: the share of the
        table that the law's limits rule out (gap 0, TTC below `min_ttc`, leaders outside the speed range).
    """
    from scipy.optimize import minimize

    joint = table * speeds[:, None, None]
    kept = joint * _possible(start)
    impossible = float(joint.sum() - kept.sum()) / max(float(joint.sum()), _TINY)
    if kept.sum() <= 0.0:
        return start, {"misfit": 1.0, "impossible": 1.0}

    def law_of(x: Floats) -> InitialState:
        median, sigma, scale = (float(value) for value in np.exp(np.clip(x[:3], -5.0, 5.0)))
        return replace(
            start,
            time_gap_median=median,
            time_gap_sigma=sigma,
            rr_scale=scale,
            rr_exponent=float(np.clip(x[3], 0.0, 3.0)),
        )

    def loss(x: Floats) -> float:
        return -float(np.sum(kept * np.log(np.maximum(gap_law(law_of(x)), _FLOOR))))

    first = [*np.log([start.time_gap_median, start.time_gap_sigma, start.rr_scale]), start.rr_exponent]
    fitted = law_of(minimize(loss, first, method="Nelder-Mead", options=_OPTIONS).x)
    row = kept.sum(axis=(1, 2))
    apart = 0.5 * np.abs(kept - gap_law(fitted) * row[:, None, None]).sum()
    return fitted, {"misfit": float(apart / row.sum()), "impossible": impossible}
