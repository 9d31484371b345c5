"""The key numbers of a naturalistic model, beside the published facts and the numbers of decisions behind them.

All numbers are read from the tables at grid points; nothing is simulated (`ndd validate` does that).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError
from cornerforge.ext.calibrate.ivbss_initial import gap_law, speed_law
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel
from cornerforge.types import ACCELERATIONS

__all__ = [
    "FREE_FACTS",
    "GAP_FACTS",
    "SHOWN_SPEEDS",
    "SPEED_FACTS",
    "TIME_GAP_FACTS",
    "counted_states",
    "key_numbers",
    "mean_and_sd",
    "quantiles",
]

Floats = NDArray[np.float64]

SHOWN_SPEEDS = (25.0, 30.0, 35.0)
"""Speeds at which car following is shown [m/s]."""
SHOWN_GAPS = (5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 115.0)
SHOWN_RATES = (-8.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0)
FREE_FACTS = ((20.0, 0.61, 0.06), (30.0, 0.38, 0.008), (36.0, 0.32, 0.004))
"""Speed [m/s], published sd [m/s2] and share at or below -1 m/s2 of free-flow accelerations."""
SPEED_FACTS = {5: 24.0, 25: 28.0, 50: 30.0, 75: 33.0, 95: 35.0}
GAP_FACTS = {5: 16.0, 25: 24.0, 50: 34.0, 75: 54.0, 95: 89.0}
TIME_GAP_FACTS = {5: 0.55, 25: 0.80, 50: 1.14, 75: 1.78, 95: 2.90}
"""Published quantiles (percent -> value) of speed [m/s], gap [m] and time gap [s] while following. All facts: computed
from the IVBSS tables of Feng et al., Nature 615:620 (2023)."""
_HARD = -0.99
"""Limit for "at or below -1 m/s2" [m/s2], with room for rounding."""


def mean_and_sd(rows: NDArray[np.float32]) -> tuple[Floats, Floats]:
    """Mean and standard deviation [m/s2] of rows of probabilities of the 31 accelerations, shape (*d, 31) to (*d)."""
    p = rows.astype(np.float64)
    mean = p @ ACCELERATIONS
    apart = ACCELERATIONS - mean[..., None]  # not mean of squares less square of mean: that cancels
    return mean, np.sqrt((p * apart**2).sum(axis=-1))


def quantiles(values: Floats, weights: Floats) -> dict[int, float]:
    """5, 25, 50, 75 and 95 % points of a discrete distribution: the smallest value with that share at or below it.

    Args:
        values: Any order, shape (n,), n at least 1.
        weights: Not negative, shape (n,), with a positive sum.

    >>> quantiles(np.array([3.0, 1.0, 2.0]), np.array([1.0, 2.0, 1.0]))
    {5: 1.0, 25: 1.0, 50: 1.0, 75: 2.0, 95: 3.0}
    """
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    place = np.searchsorted(share, np.array([0.05, 0.25, 0.5, 0.75, 0.95]) - 1e-12)
    return {percent: float(values[order[i]]) for percent, i in zip((5, 25, 50, 75, 95), place, strict=True)}


def key_numbers(model: NddModel) -> dict[str, Any]:
    """Summary of a model, JSON-compatible.

    Returns:
        `following` (mean and sd of acceleration [m/s2] by speed, gap and range rate), `support` (how many of the 31
        accelerations are possible), `free_flow` by speed, with the published facts, `lane_change`, `initial` with
        quantiles and facts, `memory`, `counted` (decisions that the tables rest on) and `provenance` (attribution,
        licence, files).
    """
    return {
        "following": _following(model),
        "support": _support(model),
        "free_flow": _free_flow(model),
        "lane_change": _lane_change(model),
        "memory": asdict(model.memory),
        "initial": _initial(model.initial),
        "counted": _counted(model),
        "provenance": _origin(model.provenance),
    }


def _at(grid: Floats, values: tuple[float, ...]) -> NDArray[np.int64]:
    return np.searchsorted(grid, np.array(values)).astype(np.int64)


def _rounded(values: Floats, digits: int = 4) -> Any:
    return np.round(values, digits).tolist()


def _following(model: NddModel) -> dict[str, Any]:
    mean, sd = mean_and_sd(model.following)
    chosen = np.ix_(_at(SPEEDS, SHOWN_SPEEDS), _at(GAPS, SHOWN_GAPS), _at(RANGE_RATES, SHOWN_RATES))
    return {
        "speed_mps": list(SHOWN_SPEEDS),
        "gap_m": list(SHOWN_GAPS),
        "range_rate_mps": list(SHOWN_RATES),
        "mean_mps2": _rounded(mean[chosen]),
        "sd_mps2": _rounded(sd[chosen]),
    }


def _support(model: NddModel) -> dict[str, Any]:
    possible = (model.following > 0).sum(axis=-1)
    lowest = np.where(model.following > 0, ACCELERATIONS, np.inf).min(axis=-1)
    return {
        "following_possible_min": int(possible.min()),
        "following_possible_mean": round(float(possible.mean()), 3),
        "following_possible_max": int(possible.max()),
        "following_states_with_one": int((possible == 1).sum()),
        "following_states_that_allow_hardest_braking": round(float((lowest <= ACCELERATIONS[0]).mean()), 4),
        "free_possible_min": int((model.free > 0).sum(axis=-1).min()),
        "free_possible_max": int((model.free > 0).sum(axis=-1).max()),
    }


def _free_flow(model: NddModel) -> dict[str, Any]:
    mean, sd = mean_and_sd(model.free)
    hard = model.free[:, ACCELERATIONS <= _HARD].sum(axis=-1, dtype=np.float64)
    return {
        "speed_mps": SPEEDS.tolist(),
        "mean_mps2": _rounded(mean),
        "sd_mps2": _rounded(sd),
        "share_braking_1_mps2": _rounded(hard, 6),
        "published": [
            {"speed_mps": speed, "sd_mps2": fact_sd, "share_braking_1_mps2": share, "mean_mps2": [0.02, 0.05]}
            for speed, fact_sd, share in FREE_FACTS
        ],
        "pull_per_s": model.free_pull,
    }


def _lane_change(model: NddModel) -> dict[str, Any]:
    rates = _at(RANGE_RATES, SHOWN_RATES)
    return {
        "base_per_decision_and_side": [round(float(model.lc_base.min()), 6), round(float(model.lc_base.max()), 6)],
        "desire_free": model.lc_desire_free,
        "gap_m": list(SHOWN_GAPS),
        "range_rate_mps": list(SHOWN_RATES),
        "desire": _rounded(model.lc_desire[np.ix_(_at(GAPS, SHOWN_GAPS), rates)].astype(np.float64)),
        "gap_accepted_half_lead_m": [_half_gap(model.lc_accept_lead[:, rate]) for rate in rates],
        "gap_accepted_half_rear_m": [_half_gap(model.lc_accept_rear[:, rate]) for rate in rates],
        "gap_always_refused_rear_m": [_all_up_to(model.lc_accept_rear[:, rate] == 0.0) for rate in rates],
        "gap_turned_back_for_m": [_all_up_to(model.lc_turn_back[:, rate] == 1.0) for rate in rates],
        "overlook": model.overlook,
        "overlook_conflict": model.overlook_conflict,
        "duration_median_s": model.initial.change_median or None,
        "signal_share": model.initial.signal_share,
        "away_per_second": model.memory.away,
        "away_again": model.memory.away_again,
    }


def _half_gap(accept: NDArray[np.float32]) -> float | None:
    """Smallest gap [m] accepted with a chance of one half or more; None if no gap of the grid is accepted."""
    enough = np.flatnonzero(accept >= 0.5)
    return float(GAPS[enough[0]]) if enough.size else None


def _all_up_to(holds: NDArray[np.bool_]) -> float | None:
    """Largest gap [m] up to which something holds at every gap; None if it does not at the smallest."""
    others = np.flatnonzero(~holds)
    if others.size == 0:
        return float(GAPS[-1])
    return float(GAPS[others[0] - 1]) if others[0] > 0 else None


def _initial(initial: InitialState) -> dict[str, Any]:
    speeds = speed_law(initial)
    joint = speeds[:, None, None] * gap_law(initial)
    total = float(joint.sum())
    gap = joint.sum(axis=(0, 2)) / total
    rate = joint.sum(axis=(0, 1)) / total
    by_speed = joint.sum(axis=2) / total
    speed_mean = float(speeds @ SPEEDS)
    rate_mean = float(rate @ RANGE_RATES)
    return {
        "parameters": {name: float(value) for name, value in vars(initial).items()},
        "speed_mps": {
            "mean": round(speed_mean, 4),
            "sd": round(math.sqrt(float(speeds @ (SPEEDS - speed_mean) ** 2)), 4),
            "quantiles": _named(quantiles(SPEEDS, speeds)),
            "published": _named(SPEED_FACTS),
        },
        "gap_m": {"quantiles": _named(quantiles(GAPS, gap)), "published": _named(GAP_FACTS)},
        "time_gap_s": {
            "quantiles": _named(quantiles((GAPS / SPEEDS[:, None]).reshape(-1), by_speed.reshape(-1))),
            "published": _named(TIME_GAP_FACTS),
        },
        "range_rate_sd_mps": round(math.sqrt(float(rate @ (RANGE_RATES - rate_mean) ** 2)), 4),
        "follow_share": initial.follow_share,
    }


def _named(points: Mapping[int, float]) -> dict[str, float]:
    """Return the points with text keys, for JSON."""
    return {str(percent): round(value, 3) for percent, value in points.items()}


def counted_states(model: NddModel) -> NDArray[np.int64] | None:
    """Read the decisions counted in each following state from the provenance.

    Returns:
        Shape (21, 116, 19); None if the provenance says nothing of them.

    Raises:
        FileFormatError: It says something else than counts of states on the grid.
    """
    stated: Any = model.provenance.get("counted")
    if stated is None:
        return None
    counts = np.zeros((SPEEDS.size, GAPS.size, RANGE_RATES.size), dtype=np.int64)
    try:
        state, decisions = (np.array(stated[name], dtype=np.int64) for name in ("state", "decisions"))
        if state.size and state.min() < 0:
            raise ValueError("a state below 0")
        if state.shape != decisions.shape or state.ndim != 1:
            raise ValueError(f"{state.size} states, {decisions.size} numbers of decisions")
        counts.reshape(-1)[state] = decisions
    except (IndexError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise FileFormatError(f"The model's provenance holds no usable counts ({error}); fit it again.") from error
    return counts


def _counted(model: NddModel) -> dict[str, Any] | None:
    counts = counted_states(model)
    if counts is None:
        return None
    settings = model.provenance.get("settings")
    strength = settings.get("prior_strength") if isinstance(settings, Mapping) else None
    free = model.provenance.get("counted_free")
    share = (
        float((counts / (counts + strength)).mean()) if isinstance(strength, (int, float)) and strength > 0 else None
    )
    return {
        "following_decisions": int(counts.sum()),
        "following_states": int((counts > 0).sum()),
        "following_states_total": int(counts.size),
        "following_decisions_by_speed": counts.sum(axis=(1, 2)).tolist(),
        "free_decisions_by_speed": list(free) if isinstance(free, (list, tuple)) else None,
        "prior_strength": strength,
        "data_share_of_states": share,
    }


def _origin(provenance: Mapping[str, object]) -> dict[str, Any]:
    files = provenance.get("files")
    names = [file.get("name") for file in files if isinstance(file, Mapping)] if isinstance(files, list) else []
    filled = provenance.get("filled")
    return {
        "made_by": provenance.get("made_by"),
        "attribution": provenance.get("attribution"),
        "licence": provenance.get("licence"),
        "files": names,
        "filled": filled if isinstance(filled, list) else [],
    }
