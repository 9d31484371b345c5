"""Validation of a model on decisions that no fit used: their log-likelihood, compared with fair baselines.

Two parts are scored: the `law` in the model's provenance, on every following decision (also below 20 m/s, where the
tables end), and the `table` that the simulator uses, on the grid, given the driver's own decision a second before.
`table_without_past` shows what that brings, `law_on_grid` how much the look-ups cost. Each part is compared with
stochastic IDMs, with a table of raw counts and with uniform guessing, on the same decisions; a table that remembers is
compared with IDMs and raw counts of the same memory. The IDMs get the true state. The model file holds them, fitted to
the model's own training data; for a file without them, they are fitted to the decisions of the scored files that are
not scored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_number
from cornerforge.errors import DataError, FileFormatError, InputError
from cornerforge.ext.calibrate.decisions import Decisions, concatenate
from cornerforge.ext.calibrate.laws import ENDLESS, IdmLaw, LogLaw, bin_index
from cornerforge.ext.calibrate.prior import SafeLaw
from cornerforge.ext.calibrate.readers import Reading, reading_names
from cornerforge.ext.calibrate.resampling import bootstrap_mean, distance, owner_sums
from cornerforge.ext.calibrate.scores import (
    Predictor,
    fitted_idms,
    grid_place,
    law_predictor,
    raw_table_predictor,
    remembering,
    simulated,
    table_probabilities,
    uniform_predictor,
)
from cornerforge.ndd.model import NddModel
from cornerforge.results.validation import BaselineDifference, PartDistance, PartLikelihood
from cornerforge.types import ACCELERATIONS

__all__ = [
    "FEWEST_VEHICLES",
    "GATED_PARTS",
    "GATES",
    "Validation",
    "better",
    "decisions_to_score",
    "observed_and_predicted",
    "passed",
    "stated_idms",
    "stated_law",
    "validate_readings",
]

Floats = NDArray[np.float64]

GATES = ("idm", "uniform")
"""Baselines that a model must beat. `idm_fast` and the raw table are only shown: the raw table guesses in states that
it has not seen."""
GATED_PARTS = ("law", "table")
FEWEST_VEHICLES = 10
"""Least number of vehicles; a bootstrap over fewer says nothing."""
_FLOOR = 1e-6
"""Least probability of a decision in a log-likelihood, as in `laws.log_likelihood`."""
_CHUNK = 50_000
_BINS = ACCELERATIONS.size
_BIN_WIDTH = 0.2


class Validation(NamedTuple):
    """Findings of a validation.

    Attributes:
        files: File -> part ("law", "table", "table_without_past", "law_on_grid") -> score; every file has at least one
            of `GATED_PARTS`.
        accelerations: Likewise, distance between observed and predicted accelerations, over all states together, both
            in the model's 31 bins.
        idms: The IDMs that were compared with, by name.
        notes: What a reader must know, one plain sentence each.
    """

    files: dict[str, dict[str, PartLikelihood]]
    accelerations: dict[str, dict[str, PartDistance]]
    idms: Mapping[str, IdmLaw]
    notes: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Every gated part of every file passed."""
        return all(
            passed(score) for parts in self.files.values() for part, score in parts.items() if part in GATED_PARTS
        )


def better(versus: BaselineDifference) -> bool:
    """Tell whether the model is better than a baseline, and not by chance."""
    return versus.interval95[0] > 0.0


def passed(score: PartLikelihood) -> bool:
    """Tell whether a part is better than every baseline of `GATES`."""
    return all(better(score.model_minus[name]) for name in GATES)


def stated_law(model: NddModel) -> SafeLaw | None:
    """Read the car-following law that a model was made from in its provenance; None if it states none.

    Raises:
        FileFormatError: The provenance states something else than a law.
    """
    stated = model.provenance.get("following")
    if stated is None:
        return None
    try:
        numbers = dict(stated)  # type: ignore[call-overload]
        inner = {name: check_number(name, value, low=-1e6, high=1e6) for name, value in numbers.pop("law").items()}
        outer = {name: check_number(name, value, low=-1e6, high=1e6) for name, value in numbers.items()}
        return SafeLaw(LogLaw(**{"opening": ENDLESS, **inner}), **outer)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"The model's provenance states no usable following law ({error}); fit it again."
        ) from error


def stated_idms(model: NddModel) -> dict[str, IdmLaw]:
    """Read the IDMs that were fitted to the model's training data, by name; empty if its file holds none.

    Raises:
        FileFormatError: The provenance states something else than IDMs.
    """
    stated = model.provenance.get("idm", {})
    try:
        return {
            str(name): IdmLaw(**{key: check_number(key, value, low=-1e6, high=1e6) for key, value in numbers.items()})
            for name, numbers in dict(stated).items()  # type: ignore[call-overload]
        }
    except (AttributeError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"The model's provenance states no usable IDM baselines ({error}); fit it again."
        ) from error


def validate_readings(model: NddModel, readings: Sequence[Reading]) -> Validation:
    """Score a model on the held-out following decisions of files, or on all decisions of a file without held-out ones.

    The IDMs are the model's own (`stated_idms`), else fitted to the decisions of these files that are not scored, like
    the raw table.

    Raises:
        InputError: No file, or one twice.
        DataError: A file has decisions of too few vehicles.
        FileFormatError: The model's provenance cannot be read.
    """
    if not readings:
        raise InputError("No trajectory file to validate against; name at least one with --against.")
    names = reading_names(readings)
    law = stated_law(model)
    scored, unscored = zip(*(_split(reading.decisions) for reading in readings), strict=True)
    training = concatenate(unscored)
    idms = stated_idms(model)
    notes: list[str] = []
    if not idms:
        idms, notes = fitted_idms(training)
    baselines: dict[str, Predictor] = {name: law_predictor(idm) for name, idm in idms.items()}
    baselines |= {"raw_table": raw_table_predictor(training), "uniform": uniform_predictor}
    if law is None:
        notes.append("The model states no following law: only decisions on its grid (19.5 m/s and above) are scored.")
    files, accelerations = {}, {}
    for name, reading, decisions in zip(names, readings, scored, strict=True):
        if not decisions.held_out.any():
            notes.append(_in_sample_note(name, reading, model))
        parts = _score_file(name, model, law, decisions, baselines)
        files[name] = {part: score for part, (score, _) in parts.items()}
        accelerations[name] = {part: apart for part, (_, apart) in parts.items()}
        if "table" not in parts:
            notes.append(f"{name}: fewer than {FEWEST_VEHICLES} vehicles on the grid; its table is not scored.")
    return Validation(files, accelerations, idms, tuple(notes))


def decisions_to_score(decisions: Decisions) -> Decisions:
    """Return the held-out decisions, or all if none is held out."""
    return decisions.where(decisions.held_out) if decisions.held_out.any() else decisions


def _split(decisions: Decisions) -> tuple[Decisions, Decisions]:
    """Split the following decisions into the ones to score (held out, or all if none is) and the others."""
    following = decisions.where(np.isfinite(decisions.gap))
    to_score = following.held_out if following.held_out.any() else np.ones(following.size, dtype=bool)
    return following.where(to_score), following.where(~to_score)


def _in_sample_note(name: str, reading: Reading, model: NddModel) -> str:
    """Say what weakens the evidence of a file without held-out decisions."""
    fitted = model.provenance.get("files")
    digests = [file.get("sha256") for file in fitted if isinstance(file, dict)] if isinstance(fitted, list) else []
    if reading.sha256 in digests:
        return f"{name} holds nothing out, and the model was fitted to it: its scores are no evidence."
    return f"{name} holds nothing out: all its decisions are scored."


def _score_file(
    name: str, model: NddModel, law: SafeLaw | None, decisions: Decisions, baselines: Mapping[str, Predictor]
) -> dict[str, tuple[PartLikelihood, PartDistance]]:
    on_grid = grid_place(decisions)[3]
    parts = {}
    if law is not None and np.unique(decisions.vehicle).size >= FEWEST_VEHICLES:
        parts["law"] = _score(law_predictor(law), decisions, baselines)
    if np.unique(decisions.vehicle[on_grid]).size >= FEWEST_VEHICLES:
        there = decisions.where(on_grid)
        parts["table"] = _score(simulated(model), there, _remembering(baselines, model))
        parts["table_without_past"] = _score(partial(table_probabilities, model), there, baselines)
        if law is not None:
            parts["law_on_grid"] = _score(law_predictor(law), there, baselines)
    if not parts:
        where = "" if law is not None else " at 19.5 m/s and above"
        raise DataError(
            f"{name} has following decisions to score{where} of fewer than {FEWEST_VEHICLES} vehicles; "
            "name a longer recording."
        )
    return parts


def _remembering(baselines: Mapping[str, Predictor], model: NddModel) -> dict[str, Predictor]:
    """Give all baselines but uniform guessing the model's memory."""
    return {
        name: baseline if baseline is uniform_predictor else remembering(baseline, model.memory)
        for name, baseline in baselines.items()
    }


def _score(
    predict: Predictor, decisions: Decisions, baselines: Mapping[str, Predictor]
) -> tuple[PartLikelihood, PartDistance]:
    log_p, predicted = _predict(predict, decisions)
    others = {name: _predict(baseline, decisions)[0] for name, baseline in baselines.items()}
    score = PartLikelihood(
        decisions=decisions.size,
        vehicles=int(np.unique(decisions.vehicle).size),
        model=float(log_p.mean()),
        interval95=bootstrap_mean(log_p, decisions.vehicle),
        baselines={name: float(other.mean()) for name, other in others.items()},
        model_minus={
            name: BaselineDifference(
                difference=float((log_p - other).mean()), interval95=bootstrap_mean(log_p - other, decisions.vehicle)
            )
            for name, other in others.items()
        },
    )
    return score, distance(_observed(decisions), predicted, _BIN_WIDTH, "m/s2")


def _predict(predict: Predictor, decisions: Decisions) -> tuple[Floats, Floats]:
    """Return each observed bin's log-probability, shape (n,), and the predicted shares by vehicle, shape (V, 31)."""
    log_p = np.empty(decisions.size)
    vehicles, owner = np.unique(decisions.vehicle, return_inverse=True)
    total = np.zeros((vehicles.size, _BINS))
    chosen = bin_index(decisions.acceleration)
    for start in range(0, decisions.size, _CHUNK):  # so that millions of decisions fit in memory
        part = np.arange(start, min(start + _CHUNK, decisions.size))
        rows = predict(Decisions(**{name: column[part] for name, column in vars(decisions).items()}))
        log_p[part] = np.log(np.maximum(rows[np.arange(part.size), chosen[part]], _FLOOR))
        total += owner_sums(rows, owner[part], vehicles.size)
    return log_p, total


def observed_and_predicted(predict: Predictor, decisions: Decisions) -> tuple[Floats, Floats]:
    """Count observed and predicted accelerations by vehicle and bin; each of shape (V, 31)."""
    return _observed(decisions), _predict(predict, decisions)[1]


def _observed(decisions: Decisions) -> Floats:
    """Counts of the observed accelerations by vehicle and bin, shape (V, 31)."""
    vehicles, owner = np.unique(decisions.vehicle, return_inverse=True)
    counts = np.zeros((vehicles.size, _BINS))
    np.add.at(counts, (owner, bin_index(decisions.acceleration)), 1.0)
    return counts
