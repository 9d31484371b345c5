"""Validating a model on decisions it was not fitted to: how likely it finds them, against fairly made baselines.

Two things are scored: the `law` that the model's provenance states, on every following decision (also below 20 m/s,
where tables end), and the `table`, which is what the simulator drives by, on the grid. Each is compared with a
stochastic IDM, with a table of raw counts, and with uniform guessing, decision by decision, on the same decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_number
from cornerforge.errors import DataError, FileFormatError, InputError
from cornerforge.ndd.decisions import Decisions, concatenate
from cornerforge.ndd.laws import FollowingLaw, IdmLaw, LogLaw, bin_index, bin_probabilities, fit_law
from cornerforge.ndd.model import NddModel
from cornerforge.ndd.prior import SafeLaw
from cornerforge.ndd.readers import Reading
from cornerforge.ndd.scores import grid_place, table_probabilities
from cornerforge.types import ACCELERATIONS

__all__ = ["GATES", "Comparison", "PartScore", "Validation", "bootstrap_mean", "stated_law", "validate_readings"]

Floats = NDArray[np.float64]
Predictor = Callable[[Decisions], Floats]
"""From n decisions' states to the probabilities of the 31 accelerations, shape (n, 31)."""

GATES = ("idm", "uniform")
"""Baselines that a model must beat. The raw table is shown only: on states it has never seen, it guesses."""
RESAMPLES = 1000
FEWEST_VEHICLES = 10
"""With fewer vehicles a bootstrap over them says nothing."""
_FEWEST_TO_FIT = 200
_SEED = 2021
_FLOOR = 1e-6
"""What is (almost) impossible to a predictor counts as this probability, as in `laws.log_likelihood`."""
_CHUNK = 50_000
_BINS = ACCELERATIONS.size
_BIN_WIDTH = 0.2


@dataclass(frozen=True)
class Comparison:
    """Mean difference of log-likelihood per decision, model minus a baseline, with its 95 % interval."""

    difference: float
    interval95: tuple[float, float]

    @property
    def better(self) -> bool:
        """The model is better, and not by chance."""
        return self.interval95[0] > 0.0


@dataclass(frozen=True)
class PartScore:
    """Law or table on the decisions of one file.

    Attributes:
        decisions: How many were scored.
        vehicles: Drivers who made them.
        model: Log-likelihood per decision [nat]; uniform guessing has -3.43.
        baselines: The same of each baseline.
        model_minus: The comparison with each baseline.
        wasserstein: Earth mover's distance between observed and predicted accelerations, over all states together,
            both in the model's 31 bins.
        kolmogorov_smirnov: Largest difference of their distribution functions, 0 to 1.
    """

    decisions: int
    vehicles: int
    model: float
    baselines: Mapping[str, float]
    model_minus: Mapping[str, Comparison]
    wasserstein: float = field(metadata={"unit": "m/s2"})
    kolmogorov_smirnov: float

    @property
    def passed(self) -> bool:
        """Better than every baseline of `GATES`."""
        return all(self.model_minus[name].better for name in GATES)


@dataclass(frozen=True)
class Validation:
    """What validation found.

    Attributes:
        files: File -> part ("law", "table") -> score; every file has at least one part.
        idm: The IDM that was compared with.
        notes: What a reader must know, one plain sentence each.
    """

    files: Mapping[str, Mapping[str, PartScore]]
    idm: IdmLaw
    notes: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Every part of every file passed."""
        return all(score.passed for parts in self.files.values() for score in parts.values())

    def to_json(self) -> dict[str, object]:
        """The keys `log_likelihood_per_decision`, `distances`, `idm` and `notes`, JSON-compatible."""
        distances = ("wasserstein", "kolmogorov_smirnov")
        every = {name: {part: asdict(score) for part, score in parts.items()} for name, parts in self.files.items()}
        return {
            "log_likelihood_per_decision": {
                name: {part: {key: score[key] for key in score if key not in distances} for part, score in row.items()}
                for name, row in every.items()
            },
            "distances": {
                "acceleration": {
                    name: {part: {key: score[key] for key in distances} for part, score in row.items()}
                    for name, row in every.items()
                }
            },
            "idm": asdict(self.idm),
            "notes": list(self.notes),
        }


def stated_law(model: NddModel) -> SafeLaw | None:
    """The car-following law that a model was made from, out of its provenance; None if that states none.

    Raises:
        FileFormatError: What it states is no such law.
    """
    stated = model.provenance.get("following")
    if stated is None:
        return None
    try:
        numbers = dict(stated)  # type: ignore[call-overload]
        inner = {name: check_number(name, value, low=-1e6, high=1e6) for name, value in numbers.pop("law").items()}
        outer = {name: check_number(name, value, low=-1e6, high=1e6) for name, value in numbers.items()}
        return SafeLaw(LogLaw(**inner), **outer)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"The model's provenance states no usable following law ({error}); fit it again."
        ) from error


def bootstrap_mean(values: Floats, vehicle: NDArray[np.int64]) -> tuple[float, float]:
    """95 % interval of a mean over decisions, by resampling whole vehicles: one driver's decisions are alike.

    Args:
        values: One number per decision, shape (n,), n at least 1.
        vehicle: Who made it, shape (n,).

    Returns:
        The 2.5 and 97.5 % points over 1000 resamples with a fixed seed; equal if there is but one vehicle.

    Source: percentile bootstrap over clusters, Efron and Tibshirani (1993).
    """
    _, owner = np.unique(vehicle, return_inverse=True)
    sums, sizes = np.bincount(owner, weights=values), np.bincount(owner)
    rng = np.random.Generator(np.random.Philox(_SEED))
    means = np.empty(RESAMPLES)
    for i in range(RESAMPLES):
        chosen = rng.integers(sums.size, size=sums.size)
        means[i] = sums[chosen].sum() / sizes[chosen].sum()
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def validate_readings(model: NddModel, readings: Sequence[Reading]) -> Validation:
    """Score a model on the held-out following decisions of files; on all of a file that holds out none.

    The baselines are fitted to the decisions of these files that are not scored.

    Raises:
        InputError: No file, or one twice.
        DataError: A file has decisions of too few vehicles.
        FileFormatError: The model's provenance cannot be read.
    """
    names = _names(readings)
    law = stated_law(model)
    scored, unscored = zip(*(_split(reading.decisions) for reading in readings), strict=True)
    training = concatenate(unscored)
    idm, notes = _fitted_idm(training)
    baselines = {"idm": _law_predictor(idm), "raw_table": _raw_table(training), "uniform": _uniform}
    if law is None:
        notes.append("The model states no following law: only decisions on its grid (19.5 m/s and above) are scored.")
    files = {}
    for name, reading, decisions in zip(names, readings, scored, strict=True):
        if not decisions.held_out.any():
            notes.append(_in_sample_note(name, reading, model))
        files[name] = _score_file(name, model, law, decisions, baselines)
        if "table" not in files[name]:
            notes.append(f"{name}: fewer than {FEWEST_VEHICLES} vehicles on the grid; its table is not scored.")
    return Validation(files, idm, tuple(notes))


def _split(decisions: Decisions) -> tuple[Decisions, Decisions]:
    """Following decisions: those to score (held out, or all where none is), and the others."""
    following = decisions.where(np.isfinite(decisions.gap))
    to_score = following.held_out if following.held_out.any() else np.ones(following.size, dtype=bool)
    return following.where(to_score), following.where(~to_score)


def _names(readings: Sequence[Reading]) -> list[str]:
    """File names, in full where two files bear the same."""
    if not readings:
        raise InputError("No trajectory file to validate against; name at least one with --against.")
    digests = [reading.sha256 for reading in readings]
    for i, digest in enumerate(digests):
        if digest in digests[:i]:
            twin = readings[digests.index(digest)].path
            raise InputError(f"{readings[i].path} and {twin} are the same file; name it once.")
    short = [reading.path.name for reading in readings]
    return [name if short.count(name) == 1 else str(r.path) for name, r in zip(short, readings, strict=True)]


def _in_sample_note(name: str, reading: Reading, model: NddModel) -> str:
    """What weakens the evidence of a file that holds nothing out."""
    fitted = model.provenance.get("files")
    digests = [file.get("sha256") for file in fitted if isinstance(file, dict)] if isinstance(fitted, list) else []
    if reading.sha256 in digests:
        return f"{name} holds nothing out, and the model was fitted to it: its scores are no evidence."
    return f"{name} holds nothing out: all its decisions are scored."


def _score_file(
    name: str, model: NddModel, law: SafeLaw | None, decisions: Decisions, baselines: Mapping[str, Predictor]
) -> dict[str, PartScore]:
    on_grid = grid_place(decisions)[3]
    parts = {}
    if law is not None and np.unique(decisions.vehicle).size >= FEWEST_VEHICLES:
        parts["law"] = _score(_law_predictor(law), decisions, baselines)
    if np.unique(decisions.vehicle[on_grid]).size >= FEWEST_VEHICLES:
        parts["table"] = _score(_table_predictor(model), decisions.where(on_grid), baselines)
    if not parts:
        where = "" if law is not None else " at 19.5 m/s and above"
        raise DataError(
            f"{name} has following decisions to score{where} of fewer than {FEWEST_VEHICLES} vehicles; "
            "name a longer recording."
        )
    return parts


def _score(predict: Predictor, decisions: Decisions, baselines: Mapping[str, Predictor]) -> PartScore:
    log_p, predicted = _predict(predict, decisions)
    others = {name: _predict(baseline, decisions)[0] for name, baseline in baselines.items()}
    observed = np.bincount(bin_index(decisions.acceleration), minlength=_BINS) / decisions.size
    apart = np.abs(np.cumsum(observed) - np.cumsum(predicted))
    return PartScore(
        decisions=decisions.size,
        vehicles=int(np.unique(decisions.vehicle).size),
        model=float(log_p.mean()),
        baselines={name: float(other.mean()) for name, other in others.items()},
        model_minus={
            name: Comparison(float((log_p - other).mean()), bootstrap_mean(log_p - other, decisions.vehicle))
            for name, other in others.items()
        },
        wasserstein=float(apart.sum() * _BIN_WIDTH),
        kolmogorov_smirnov=float(apart.max()),
    )


def _predict(predict: Predictor, decisions: Decisions) -> tuple[Floats, Floats]:
    """Log-probability of each observed bin, shape (n,), and the predicted shares of the bins, shape (31,)."""
    log_p = np.empty(decisions.size)
    total = np.zeros(_BINS)
    chosen = bin_index(decisions.acceleration)
    for start in range(0, decisions.size, _CHUNK):  # so that millions of decisions fit in memory
        part = np.arange(start, min(start + _CHUNK, decisions.size))
        rows = predict(Decisions(**{name: column[part] for name, column in vars(decisions).items()}))
        log_p[part] = np.log(np.maximum(rows[np.arange(part.size), chosen[part]], _FLOOR))
        total += rows.sum(axis=0)
    return log_p, total / decisions.size


def _law_predictor(law: FollowingLaw) -> Predictor:
    def predict(d: Decisions) -> Floats:
        state = d.speed, d.gap, d.range_rate
        return bin_probabilities(law.mean(*state), law.scale(*state), law.degrees)

    return predict


def _table_predictor(model: NddModel) -> Predictor:
    return lambda d: table_probabilities(model, d)


def _uniform(d: Decisions) -> Floats:
    return np.full((d.size, _BINS), 1.0 / _BINS)


def _fitted_idm(training: Decisions) -> tuple[IdmLaw, list[str]]:
    """The stochastic IDM that these decisions make most likely."""
    if training.size < _FEWEST_TO_FIT:
        note = (
            f"Only {training.size} decisions are left to fit the IDM on ({_FEWEST_TO_FIT} are needed): it has defaults."
        )
        return IdmLaw(), [note]
    return fit_law(IdmLaw(), training.speed, training.gap, training.range_rate, training.acceleration), []


def _raw_table(training: Decisions) -> Predictor:
    """Counts per state, with one decision's worth of uniform guessing; the model's grid, carried on below 20 m/s."""
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
    speed = np.floor(d.speed + 0.5).astype(np.int64)
    return np.asarray((speed * 117 + np.where(is_free, 116, gap)) * 19 + range_rate)
