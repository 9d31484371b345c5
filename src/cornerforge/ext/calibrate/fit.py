"""Fitting the naturalistic model: counts of real decisions, shrunk towards the parametric prior with a stated strength.

row = (counts + strength * prior) / (n + strength), the mean of a Dirichlet posterior. An acceleration is possible if it
is in the prior's support or was observed. The main grid starts at 20 m/s: slower decisions (most of NGSIM) enter the
prior's law, the likelihoods, and the rows for traffic that stops, which are made in the same way.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in, check_number
from cornerforge.errors import DataError, InputError
from cornerforge.ext.calibrate.decisions import Decisions, concatenate
from cornerforge.ext.calibrate.lane_change import LaneChange
from cornerforge.ext.calibrate.lane_fit import LANE_CHANGE_CHOICES, fit_lane_changes, notes_on
from cornerforge.ext.calibrate.laws import FollowingLaw, IdmLaw, LogLaw, bin_index, fit_law, log_likelihood
from cornerforge.ext.calibrate.parts import parts_of
from cornerforge.ext.calibrate.prior import (
    FREE_PULL,
    MEMORY,
    SUPPORT_SD,
    FreeFlow,
    SafeLaw,
    following_prior,
    free_prior,
)
from cornerforge.ext.calibrate.readers import Reading, read_decisions, reading_names
from cornerforge.ext.calibrate.scores import fitted_idms, grid_place, held_out_scores
from cornerforge.ext.calibrate.traits import NoiseSpread, fit_noise_spread
from cornerforge.ndd.grids import SLOW_GRID, SPEED_GRID, Grid
from cornerforge.ndd.initial import InitialState
from cornerforge.ndd.model import GAPS, RANGE_RATES, NddModel
from cornerforge.results import as_json
from cornerforge.results.naturalistic import BadRows, FitReport, FittedLaneChanges
from cornerforge.types import ACCELERATIONS

__all__ = ["DEFAULT_PRIOR_STRENGTH", "fit_model"]

Floats = NDArray[np.float64]

DEFAULT_PRIOR_STRENGTH = 200.0
"""Weight of the prior, in pseudo-decisions per state. Log-likelihood on the HOV lane's held-out half from 19.5 m/s on:
-2.440 at strength 1, -2.290 at 10, -2.275 at 100, -2.274 from 200 on. There are too few counts to help."""
_FEWEST = 200
"""Least number of following decisions to fit a law of nine parameters; with fewer the shipped law is used."""
_CALM = (0.2, 3.0)
"""Between these the factor of the noise at motorway speeds is sought."""
_LEAST_SPREAD = 0.05
"""Least spread [m/s2], a quarter of the step between two accelerations: less looks the same as none."""
_ATTRIBUTION = {
    "ngsim": "NGSIM, US DOT FHWA",
    "tgsim": "TGSIM, US DOT FHWA",
    "highd": "highD, RWTH Aachen University (Krajewski et al. 2018), unless the files only have its form",
}
_LICENCE = {
    "ngsim": "open government data",
    "tgsim": "open government data",
    "highd": "highD's own licence (non-commercial), unless the files only have its form",
}
_UNSTATED = "as stated by the publisher of the files"


def fit_model(
    paths: Sequence[Path],
    data_format: str,
    *,
    prior_strength: float = DEFAULT_PRIOR_STRENGTH,
    window_factor: float = 1.0,
    lane_changes: str = "fit",
    progress: Callable[[str], None] | None = None,
) -> tuple[NddModel, FitReport]:
    """Fit a naturalistic model from trajectory files; the same files give the same model, to the bit.

    Args:
        paths: Trajectory files, at least one; their order does not matter.
        data_format: One of `readers.DATA_FORMATS`.
        prior_strength: Weight of the prior, in pseudo-decisions per state, 1 to 1e6.
        window_factor: As for `read_decisions`.
        lane_changes: "fit": fit the lane changes too, where the files tell enough of them; "prior": keep the shipped
            ones (see `lane_fit`).
        progress: Called with a sentence on each step of the work.

    Returns:
        The model, and a report on its data and on how well it predicts held-out decisions.

    Raises:
        UnknownNameError: The format or the choice of lane changes is unknown.
        InputError: There is no file, a file is given twice, or a strength is out of range.
        DataError: A file cannot be read, or no decision is left to fit on.
    """
    strength = check_number("prior_strength", prior_strength, low=1.0, high=1e6)
    check_in("choice of lane changes", lane_changes, LANE_CHANGE_CHOICES)
    if not paths:
        raise InputError("No trajectory file to fit on; name at least one.")
    tell = progress or (lambda _: None)
    tell(f"Reading {len(paths)} file(s)")
    readings = sorted(
        read_decisions(paths, data_format, window_factor=window_factor),
        key=lambda reading: (reading.path.name, reading.sha256),
    )
    reading_names(readings)  # refuses a file that is given twice
    decisions = concatenate([reading.decisions for reading in readings])
    training = decisions.where(~decisions.held_out)
    if training.size == 0:
        raise _nothing_to_fit(readings, decisions.size)
    tell(f"Fitting the car-following law to {training.size} decisions")
    log_law, baselines, too_few, notes = _fit_laws(training)
    idms = {name: asdict(idm) for name, idm in baselines.items()}
    tell("Fitting the lane changes")
    lane_change, changes = fit_lane_changes(readings, lane_changes)
    noise = fit_noise_spread(training, log_law)
    safe, fast = _calmed(SafeLaw(log_law), training)
    laws: dict[str, FollowingLaw] = {"log": log_law, **baselines, "model": safe}
    tell("Making the tables")
    origin = _provenance(readings, data_format, strength, safe, lane_change, changes, noise) | {"idm": idms}
    initial = replace(InitialState(), noise_spread=noise.spread)
    model, counted, counted_free = _assemble(safe, lane_change, initial, training, strength, origin)
    parts = parts_of(
        training, too_few=too_few, fast=fast, counted=int(counted.sum()), counted_free=counted_free,
        strength=strength, changes=changes, noise=noise,
    )  # fmt: skip
    tell("Scoring the decisions held out")
    scores = held_out_scores(laws, model, {reading.path.name: reading.decisions for reading in readings})
    total = int(counted.sum())
    fastest = float(np.percentile(training.speed, 99.0))
    weighted = float((counted * counted / (counted + strength)).sum() / total) if total else 0.0
    more = [note for reading in readings for note in reading.notes]
    return model, FitReport(
        rows_read=sum(reading.table.rows_read for reading in readings),
        rows_used=sum(reading.rows_used for reading in readings),
        bad_rows={reading.path.name: _bad_rows(reading) for reading in readings},
        decisions_fitted=training.size,
        decisions_on_grid=total,
        states=int((counted > 0).sum()),
        states_total=int(counted.size),
        data_share_of_states=float((counted / (counted + strength)).mean()),
        data_share_where_data=weighted,
        speed_99_percent=fastest,
        held_out_log_likelihood=scores,
        notes=(*notes, *more, *_always_true(fastest, total), *notes_on(changes)),
        parts=parts,
        lane_changes=changes,
        sensitivity=(),
    )


def _bad_rows(reading: Reading) -> dict[str, BadRows]:
    return {reason: BadRows(rows=n, first_line=line) for reason, (n, line) in reading.table.bad.reasons.items()}


def _nothing_to_fit(readings: Sequence[Reading], held_out: int) -> DataError:
    """Make the error for files with rows that give no decision to fit on."""
    used, read = sum(reading.rows_used for reading in readings), sum(reading.table.rows_read for reading in readings)
    made = f"{held_out} decision(s), all held out" if held_out else "no decision"
    vehicles = sum(reading.vehicles for reading in readings)
    faults = [
        f"{reading.path.name}: {reason} ({bad.rows} row(s), first at line {bad.first_line})"
        for reading in readings
        for reason, bad in _bad_rows(reading).items()
    ]
    return DataError(
        f"No decision is left to fit on: {used} usable of {read} row(s) make {made}. They are of {vehicles} "
        "vehicle(s). A decision needs a second of rows of one vehicle without a break, in a lane that is known (0 is "
        "not), and its leader's rows in the same file; "
        f"a fitted law needs {_FEWEST} decisions." + (f" Left out: {'; '.join(faults)}." if faults else "")
    )


def _fit_laws(training: Decisions) -> tuple[LogLaw, dict[str, IdmLaw], str, list[str]]:
    """Fit the prior's law, at all speeds, and the IDMs to compare it with.

    Returns:
        Law, IDMs, why the law is the shipped one (empty if it was fitted), notes.
    """
    following = training.where(np.isfinite(training.gap))
    if following.size < _FEWEST:
        too_few = (
            f"Only {following.size} following decisions, {_FEWEST - following.size} too few (at least {_FEWEST} are "
            "needed): the car-following law is the shipped one, not fitted to these files."
        )
        return LogLaw(), {}, too_few, []
    law = fit_law(LogLaw(), *_arrays(following))
    notes = []
    if law.spread < _LEAST_SPREAD:
        notes.append(
            f"The accelerations scatter by only {law.spread:.2g} m/s2 about the fitted law, far less than drivers do "
            f"({LogLaw().spread:.2g} in the shipped model's data): are these trajectories simulated, or smoothed?"
        )
    return law, fitted_idms(following)[0], "", notes


def _calmed(safe: SafeLaw, training: Decisions) -> tuple[SafeLaw, int]:
    """Fit by how much noise shrinks at motorway speeds, where there are enough decisions.

    The shipped value is for laws that were fitted to slow traffic, and extrapolated.

    Returns:
        The law, how many decisions it was calmed by (0: the shipped value).
    """
    from scipy.optimize import minimize_scalar

    fast = training.where(np.isfinite(training.gap) & (training.speed >= safe.motorway_full))
    if fast.size < _FEWEST:
        return safe, 0
    best = minimize_scalar(
        lambda calm: -log_likelihood(replace(safe, calm=calm), *_arrays(fast)), bounds=_CALM, method="bounded"
    )
    return replace(safe, calm=float(format(best["x"], ".3g"))), fast.size


def _arrays(decisions: Decisions) -> tuple[Floats, Floats, Floats, Floats]:
    return decisions.speed, decisions.gap, decisions.range_rate, decisions.acceleration


def _assemble(
    safe: SafeLaw,
    lane_change: LaneChange,
    initial: InitialState,
    training: Decisions,
    strength: float,
    provenance: dict[str, object],
) -> tuple[NddModel, NDArray[np.int64], int]:
    """Make tables from prior and counts.

    Returns:
        The model, the decisions counted in each following state, (21, 116, 19), and those in free flow.
    """
    following, free = _counts(training, SPEED_GRID)
    slow, _ = _counts(training, SLOW_GRID)
    counted = following.sum(axis=-1)
    model = NddModel(
        following=_rows(following_prior(safe), following, strength),
        free=_rows(free_prior(FreeFlow()), free, strength),
        free_pull=FREE_PULL,
        lc_base=_few_bits(lane_change.base()),
        lc_desire=_few_bits(lane_change.desire()),
        lc_desire_free=lane_change.desire_free,
        lc_accept_lead=_few_bits(lane_change.accept_lead()),
        lc_accept_rear=_few_bits(lane_change.accept_rear()),
        lc_turn_back=_few_bits(lane_change.turn_back()),
        overlook=lane_change.overlook,
        overlook_conflict=lane_change.overlook_conflict,
        memory=MEMORY,
        initial=initial,
        provenance=provenance | {"counted": _sparse(counted), "counted_free": [int(n) for n in free.sum(axis=-1)]},
        slow=_rows(following_prior(safe, SLOW_GRID.points()), slow, strength),
    )
    return model, counted, int(free.sum())


def _counts(training: Decisions, speeds: Grid) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Count each acceleration in each state: following (speeds, 116, 19, 31) and free (speeds, 31)."""
    speed, gap, range_rate, on_grid, is_free = grid_place(training, speeds)
    chosen = bin_index(training.acceleration)
    following = np.zeros((speeds.bins, GAPS.size, RANGE_RATES.size, ACCELERATIONS.size), dtype=np.int64)
    free = np.zeros((speeds.bins, ACCELERATIONS.size), dtype=np.int64)
    led, alone = on_grid & ~is_free, on_grid & is_free
    np.add.at(following, (speed[led], gap[led], range_rate[led], chosen[led]), 1)
    np.add.at(free, (speed[alone], chosen[alone]), 1)
    return following, free


def _rows(prior: Floats, counts: NDArray[np.int64], strength: float) -> NDArray[np.float32]:
    """Return the posterior mean of each row, float32; rows sum to 1 within rounding, exact zeros stay."""
    rows = (counts + strength * prior) / (counts.sum(axis=-1, keepdims=True) + strength)
    rows = _few_bits(rows).astype(np.float64)
    peak = rows.argmax(axis=-1)[..., None]
    np.put_along_axis(
        rows, peak, np.take_along_axis(rows, peak, axis=-1) + 1.0 - rows.sum(axis=-1, keepdims=True), axis=-1
    )
    return rows.astype(np.float32)


def _few_bits(values: Floats) -> NDArray[np.float32]:
    """Keep 10 bits (0.05 %) of each number: far below any statistical error, and the file shrinks to a third."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.rint(mantissa * 1024.0) / 1024.0, exponent).astype(np.float32)


def _sparse(counted: NDArray[np.int64]) -> dict[str, list[int]]:
    """List states with data (flat index, decisions); with the strength they give a row's Dirichlet spread."""
    state = np.flatnonzero(counted)
    return {"state": [int(i) for i in state], "decisions": [int(n) for n in counted.reshape(-1)[state]]}


def _provenance(
    readings: Sequence[Reading],
    data_format: str,
    strength: float,
    safe: SafeLaw,
    lane_change: LaneChange,
    changes: FittedLaneChanges,
    noise: NoiseSpread,
) -> dict[str, object]:
    """Describe the model's origin, without times and folders, so that the same data give the same file."""
    fitted = {"lane_change_fit": as_json(changes)} if changes.fitted else {}
    fitted |= {"noise_spread_fit": asdict(noise)} if noise.fitted else {}
    return fitted | {
        "made_by": f"cornerforge {importlib.metadata.version('cornerforge')}",
        "attribution": _ATTRIBUTION.get(data_format, _UNSTATED),
        "licence": _LICENCE.get(data_format, _UNSTATED),
        "format": data_format,
        "files": [
            {
                "name": reading.path.name,
                "sha256": reading.sha256,
                "layout": reading.layout.name,
                "smoothing_window_s": reading.layout.window,
                "rows_read": reading.table.rows_read,
                "rows_used": reading.rows_used,
                "decisions_fitted": int((~reading.decisions.held_out).sum()),
                "decisions_held_out": int(reading.decisions.held_out.sum()),
            }
            for reading in readings
        ],
        "settings": {"prior_strength": strength, "support_sd": SUPPORT_SD},
        "following": asdict(safe),
        "free": asdict(FreeFlow()),
        "lane_change": asdict(lane_change),
    }


def _always_true(fastest: float, on_grid: int) -> tuple[str, ...]:
    return (
        f"99 % of the fitted decisions are slower than {fastest:.1f} m/s: above that the model extrapolates the "
        "fitted law, with published facts for free flow and initial traffic, and a safe response near the leader.",
        f"{on_grid} decisions lie on the grid (19.5 m/s and above); all others shape only the law.",
        "Laws are scored at the true state, also below 20 m/s where the tables end; the table from 19.5 m/s on.",
    )
