"""Predictions of each decision by a law, a model's table or a baseline: probabilities of the 31 accelerations.

`table_predictor` must look states up as the simulator does; all validation of the tables goes through it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.laws import FollowingLaw, IdmLaw, bin_index, bin_probabilities, fit_law
from cornerforge.ext.calibrate.scores import grid_place, remembered_probabilities, table_probabilities
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID, SPEED_GRID
from cornerforge.ndd.model import NddModel
from cornerforge.types import ACCELERATIONS

__all__ = [
    "FEWEST_TO_FIT",
    "Predictor",
    "fitted_idms",
    "forgetful_predictor",
    "law_predictor",
    "raw_table_predictor",
    "table_predictor",
    "uniform_predictor",
]

Floats = NDArray[np.float64]
Predictor = Callable[[Decisions], Floats]
"""Function from n decisions' states to the probabilities of the 31 accelerations, shape (n, 31)."""

FEWEST_TO_FIT = 200
IDM_FITS = {"idm": 0.0, "idm_fast": 10.0}
"""Two fair IDMs: fitted to decisions at all speeds, and to those above 10 m/s, nearer to what the tables cover."""
_BINS = ACCELERATIONS.size


def law_predictor(law: FollowingLaw) -> Predictor:
    """Return the predictor of a law at the true state; it needs a leader (finite gap)."""

    def predict(d: Decisions) -> Floats:
        state = d.speed, d.gap, d.range_rate
        return bin_probabilities(law.mean(*state), law.scale(*state), law.degrees)

    return predict


def table_predictor(model: NddModel) -> Predictor:
    """Return the predictor of a model's tables, read as in the simulator; speeds off the grid take its end rows.

    A driver's own decision a second before counts as the model's memory says.
    """
    return lambda d: remembered_probabilities(model, d)


def forgetful_predictor(model: NddModel) -> Predictor:
    """Return the predictor of a model's tables that looks at the present state only."""
    return lambda d: table_probabilities(model, d)


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
