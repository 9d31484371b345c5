"""Predictions of decisions by laws, tables and baselines, and their scores: mean log-probability of what was observed.

A predictor gives the probabilities of the 31 accelerations. All validation of the tables goes through
`simulated`, which must look states up as the simulator does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.laws import FollowingLaw, IdmLaw, bin_index, bin_probabilities, fit_law, log_likelihood
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID, SPEED_GRID, Grid
from cornerforge.ndd.memory import Memory, given_the_past, memory_numbers
from cornerforge.ndd.model import RANGE_RATES, NddModel
from cornerforge.types import ACCELERATIONS

__all__ = [
    "Predictor",
    "fitted_idms",
    "gap_seen",
    "grid_place",
    "held_out_scores",
    "law_predictor",
    "raw_table_predictor",
    "remembering",
    "simulated",
    "table_log_likelihood",
    "table_probabilities",
    "uniform_predictor",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

Predictor = Callable[[Decisions], Floats]
"""Function from n decisions' states to the probabilities of the 31 accelerations, shape (n, 31)."""

FEWEST_TO_FIT = 200
IDM_FITS = {"idm": 0.0, "idm_fast": 10.0}
"""Two fair IDMs: fitted to decisions at all speeds, and to those above 10 m/s, nearer to what the tables cover."""
_BINS = ACCELERATIONS.size
_FLOOR = 1e-6
_FASTEST_CLOSING = -RANGE_RATE_GRID.low


def gap_seen(gap: Floats, range_rate: Floats) -> Floats:
    """Give the gap [m] at which a state is looked up, as the simulator does; arrays of one shape.

    Closing faster than 10 m/s counts as the gap that needs the same deceleration when 4 m are left: 4 + (gap - 4)
    (10 / closing)^2.
    """
    closing = np.maximum(-range_rate, _FASTEST_CLOSING)
    return np.where(gap > 4.0, 4.0 + (gap - 4.0) * (_FASTEST_CLOSING / closing) ** 2, gap)


def grid_place(decisions: Decisions, speeds: Grid = SPEED_GRID) -> tuple[Ints, Ints, Ints, Bools, Bools]:
    """Nearest place on the model's grid of each decision.

    Returns:
        Index of speed, gap and range rate (clipped to the grid), whether the speed lies on the grid of `speeds`,
        and whether it is free flow (no leader, or beyond 115.5 m); each of shape (n,).
    """
    gap = gap_seen(decisions.gap, decisions.range_rate)
    is_free = gap > GAP_GRID.upper
    speed, gap_index = speeds.place(decisions.speed), GAP_GRID.place(np.where(is_free, 0.0, gap))
    on_grid = (decisions.speed >= speeds.lower) & (decisions.speed < speeds.upper)
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


def remembering(predict: Predictor, memory: Memory) -> Predictor:
    """Return the predictor with a memory: given a follower's own decision a second before, where it is known."""

    def remembered(decisions: Decisions) -> Floats:
        p = np.array(predict(decisions))
        low, high = np.full((2, decisions.size), np.nan)
        known = np.isfinite(decisions.before[:, 3]) & np.isfinite(decisions.gap)
        speed, gap, range_rate, acceleration = decisions.before[known].T
        nobody = np.zeros(speed.size, dtype=np.int64)
        past = Decisions(speed, gap, range_rate, acceleration, nobody, nobody.astype(np.bool_))
        cumulative = np.minimum(np.cumsum(predict(past), axis=-1), 1.0)
        chosen = bin_index(acceleration)
        rows = np.arange(speed.size)
        high[known] = cumulative[rows, chosen]
        low[known] = np.where(chosen > 0, cumulative[rows, chosen - 1], 0.0)
        given_the_past(p, low, high, memory_numbers(memory))
        return p

    return remembered


def simulated(model: NddModel) -> Predictor:
    """Return the predictor of a model's tables as the simulator draws from them."""
    return remembering(partial(table_probabilities, model), model.memory)


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


def law_predictor(law: FollowingLaw) -> Predictor:
    """Return the predictor of a law at the true state; it needs a leader (finite gap)."""

    def predict(d: Decisions) -> Floats:
        state = d.speed, d.gap, d.range_rate
        return bin_probabilities(law.mean(*state), law.scale(*state), law.degrees)

    return predict


def uniform_predictor(d: Decisions) -> Floats:
    """Give every acceleration the same probability."""
    return np.full((d.size, _BINS), 1.0 / _BINS)


def fitted_idms(training: Decisions) -> tuple[dict[str, IdmLaw], list[str]]:
    """Fit the stochastic IDMs of `IDM_FITS` to these decisions (all with a leader); return them with notes.

    If too few decisions are fast enough, an IDM is fitted to all; if these are too few as well, it has its defaults.
    """
    notes: list[str] = []
    fits: dict[int, IdmLaw] = {}
    idms = {}
    for name, above in IDM_FITS.items():
        part = training.where(training.speed > above)
        if part.size < FEWEST_TO_FIT and part.size < training.size:
            notes.append(f"Only {part.size} decisions above {above:g} m/s to fit an IDM on: all speeds were used.")
            part = training
        if part.size < FEWEST_TO_FIT:
            what = f"Only {part.size} decisions are left to fit the IDM on ({FEWEST_TO_FIT} are needed)"
            notes.append(f"{what}: it has defaults.")
            idms[name] = IdmLaw()
            continue
        if part.size not in fits:  # parts of equal size are equal
            fits[part.size] = fit_law(IdmLaw(), part.speed, part.gap, part.range_rate, part.acceleration)
        idms[name] = fits[part.size]
    return idms, list(dict.fromkeys(notes))


def raw_table_predictor(training: Decisions) -> Predictor:
    """Predict by counts per state plus one decision spread uniformly; the model's grid goes on below 20 m/s."""
    states, place = np.unique(_state(training), return_inverse=True)
    counts = np.zeros((states.size + 1, _BINS))  # the last row: never seen
    np.add.at(counts, (place, bin_index(training.acceleration)), 1.0)
    rows = (counts + 1.0 / _BINS) / (counts.sum(axis=-1, keepdims=True) + 1.0)

    def predict(d: Decisions) -> Floats:
        wanted = _state(d)
        at = np.searchsorted(states, wanted)
        known = at < states.size
        known[known] = states[at[known]] == wanted[known]
        return np.asarray(rows[np.where(known, at, states.size)])

    return predict


def _state(d: Decisions) -> NDArray[np.int64]:
    """One number for each state of the grid, shape (n,)."""
    _, gap, range_rate, _, is_free = grid_place(d)
    place = SPEED_GRID.nearest(d.speed) * (GAP_GRID.bins + 1) + np.where(is_free, GAP_GRID.bins, gap)
    return np.asarray(place * RANGE_RATE_GRID.bins + range_rate)
