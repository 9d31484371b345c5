"""Scores of laws and models on decisions that no fit used: mean log-probability of the observed accelerations."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.laws import FollowingLaw, bin_index, log_likelihood
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID, SPEED_GRID
from cornerforge.ndd.memory import given_the_past, memory_numbers
from cornerforge.ndd.model import RANGE_RATES, NddModel
from cornerforge.types import ACCELERATIONS

__all__ = ["grid_place", "held_out_scores", "remembered_probabilities", "table_log_likelihood", "table_probabilities"]

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_FLOOR = 1e-6
_FASTEST_CLOSING = -RANGE_RATE_GRID.low


def grid_place(decisions: Decisions) -> tuple[Ints, Ints, Ints, Bools, Bools]:
    """Nearest place on the model's grid of each decision.

    Closing faster than 10 m/s is looked up, as the simulator does, at the gap that needs the same deceleration when 4 m
    are left: 4 + (gap - 4) (10 / closing)^2.

    Returns:
        Index of speed, gap and range rate (clipped to the grid), whether the speed lies on the grid (19.5 to 40.5 m/s),
        and whether it is free flow (no leader, or beyond 115.5 m); each of shape (n,).
    """
    closing = np.maximum(-decisions.range_rate, _FASTEST_CLOSING)
    gap = decisions.gap
    gap = np.where(gap > 4.0, 4.0 + (gap - 4.0) * (_FASTEST_CLOSING / closing) ** 2, gap)
    is_free = gap > GAP_GRID.upper
    speed, gap_index = SPEED_GRID.place(decisions.speed), GAP_GRID.place(np.where(is_free, 0.0, gap))
    on_grid = (decisions.speed >= SPEED_GRID.lower) & (decisions.speed < SPEED_GRID.upper)
    return speed, gap_index, RANGE_RATE_GRID.place(decisions.range_rate), on_grid, is_free


def table_probabilities(model: NddModel, decisions: Decisions) -> NDArray[np.float64]:
    """The model's probabilities of the 31 accelerations at each decision, shape (n, 31), as the simulator draws them.

    Nearest speed and gap; linear between the two nearest range rates (`drivers.naturalistic.range_rate_index`).
    """
    speed, gap, _, _, is_free = grid_place(decisions)
    rate = np.clip(decisions.range_rate, RANGE_RATES[0], RANGE_RATES[-1]) - RANGE_RATES[0]
    lower = np.floor(rate).astype(np.int64)
    upper = np.minimum(lower + 1, RANGE_RATES.size - 1)
    share = (rate - lower)[:, None]
    rows = (1.0 - share) * model.following[speed, gap, lower] + share * model.following[speed, gap, upper]
    return np.asarray(np.where(is_free[:, None], model.free[speed], rows), dtype=np.float64)


def remembered_probabilities(model: NddModel, decisions: Decisions) -> NDArray[np.float64]:
    """The same as the simulator draws them: given a follower's own decision a second before, where it is known."""
    p = table_probabilities(model, decisions)
    low, high = np.full((2, decisions.size), np.nan)
    known = np.isfinite(decisions.before[:, 3]) & np.isfinite(decisions.gap)
    speed, gap, range_rate, acceleration = decisions.before[known].T
    nobody = np.zeros(speed.size, dtype=np.int64)
    past = Decisions(speed, gap, range_rate, acceleration, nobody, nobody.astype(np.bool_))
    cumulative = np.minimum(np.cumsum(table_probabilities(model, past), axis=-1), 1.0)
    chosen = bin_index(acceleration)
    rows = np.arange(speed.size)
    high[known] = cumulative[rows, chosen]
    low[known] = np.where(chosen > 0, cumulative[rows, chosen - 1], 0.0)
    given_the_past(p, low, high, memory_numbers(model.memory))
    return p


def table_log_likelihood(model: NddModel, decisions: Decisions) -> tuple[float, int]:
    """Mean natural log of the model's probability of the observed accelerations, on the grid (19.5 to 40.5 m/s).

    Returns:
        The mean (NaN if no decision lies on the grid; an impossible one counts as 1e-6), and the number of decisions.
    """
    on_grid = decisions.where(grid_place(decisions)[3])
    if on_grid.size == 0:
        return math.nan, 0
    p = table_probabilities(model, on_grid)[np.arange(on_grid.size), bin_index(on_grid.acceleration)]
    return float(np.log(np.maximum(p, _FLOOR)).mean()), on_grid.size


def held_out_scores(
    laws: Mapping[str, FollowingLaw], model: NddModel, decisions: Mapping[str, Decisions]
) -> dict[str, dict[str, float]]:
    """Scores of laws and model on the held-out following decisions of each file; files without any are left out.

    Returns:
        For each file: `decisions` (their number), `uniform`, each law's name, and, where at least one lies on the grid,
        `table_decisions`, `table`, and each law on the decisions on the grid, named `..._on_grid`.
    """
    scores: dict[str, dict[str, float]] = {}
    for name, all_decisions in decisions.items():
        held = all_decisions.where(all_decisions.held_out & np.isfinite(all_decisions.gap))
        if held.size == 0:
            continue
        row: dict[str, float] = {"decisions": held.size, "uniform": -math.log(ACCELERATIONS.size)}
        row |= {law_name: _score(law, held) for law_name, law in laws.items()}
        table, number = table_log_likelihood(model, held)
        if number:
            *_, on_grid, _ = grid_place(held)
            row |= {"table_decisions": number, "table": table}
            row |= {f"{law_name}_on_grid": _score(law, held.where(on_grid)) for law_name, law in laws.items()}
        scores[name] = row
    return scores


def _score(law: FollowingLaw, held: Decisions) -> float:
    return log_likelihood(law, held.speed, held.gap, held.range_rate, held.acceleration)
