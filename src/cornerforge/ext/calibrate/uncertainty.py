"""Models as uncertain as the naturalistic model itself is: each uncertain number is drawn, and so are rows of data.

`UNCERTAIN` is the one table of the uncertain numbers, their spread, and its source; `LAWS` goes on with those of the
stated laws of merging and of stopping. A draw multiplies each number by an independent log-normal factor of median 1.
Where a model's own fit states an interval of a number, its width is taken.
See docs/adr/0034-the-models-own-uncertainty.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import FileFormatError, InputError
from cornerforge.ext.calibrate.variations import Variation, counted_decisions, section, varied_model
from cornerforge.ndd.model import NddModel

if TYPE_CHECKING:
    from cornerforge.road.straight import RoadNumbers

__all__ = [
    "DESIGN_EFFECT", "LAWS", "UNCERTAIN", "Uncertain", "check_drawable", "drawn_laws", "drawn_model",
    "drawn_variations", "widths",
]  # fmt: skip

_Z95 = 1.959963984540054


@dataclass(frozen=True)
class Uncertain:
    """One number of the model that is uncertain.

    Attributes:
        part, field: Where it is; as of `Variation`, or the law and a name of `road.straight.LawFactors`.
        width: Standard deviation of its natural logarithm.
        source: Source of the width, in words.
        most, least: Largest and smallest value allowed (of `LAWS`: factor); draws beyond them are cut to them.
        measured: The width comes from data; else it is a judgement.
    """

    part: str
    field: str
    width: float
    source: str
    most: float = math.inf
    least: float = 0.0
    measured: bool = False


_FILES = (
    "fits to I-80, its HOV lane and US-101 one by one (benchmarks/model_widths.py); resampled vehicles scatter less"
)

UNCERTAIN: tuple[Uncertain, ...] = (
    Uncertain("law", "response", 0.17, f"at a gap of 30 m: {_FILES}", measured=True),
    Uncertain("law", "spread", 0.12, _FILES, measured=True),
    Uncertain("law", "degrees", 0.49, f"{_FILES}; at least 3, as no file says less than 4.6", least=3.0, measured=True),
    Uncertain("initial", "noise_spread", 0.49, "bootstrap over drivers, 0 to 0.26 (ADR 70)", 2.0, measured=True),
    Uncertain("safe", "response", 0.25, "set by hand so that BVs crash about as often as people (ADR 24)"),
    Uncertain("model", "overlook", 0.69, "a factor of 2: set by the national mix of crashes (ADR 27)", 1.0),
    Uncertain("model", "overlook_conflict", 0.69, "a factor of 2, as overlook (ADR 27)", 1.0),
    Uncertain("memory", "away", 0.69, "a factor of 2: set so that crashes between BVs stay below 3e-6 (ADR 27)", 1.0),
    Uncertain(
        "memory", "away_again", 0.20, "the share of looks of 3 s and more, 9 %, to a factor of 1.5 (ADR 27)", 0.9
    ),
    Uncertain("initial", "vigilance_sigma", 0.25, "published shares of risk leave 0.5 to 1.3 (ADR 29)", 1.5),
    Uncertain("initial", "signal_share", 0.15, "one published share; 0.6 and 0.75 were tried (ADR 24)", 1.0),
    Uncertain("initial", "desire_share", 0.30, "chosen with simulated traffic in view (ADR 24)", 1.0),
    Uncertain("lane_change", "rate", 0.30, "published 0.36 and 0.20 changes a mile (Lee 2004, Krajewski 2018)", 0.5),
    Uncertain("lane_change", "misjudge", 0.40, "closing cut-ins are two thirds of recorded ones (ADR 70)", 1.0),
    Uncertain("lane_change", "rear_standstill", 0.15, "matched to recorded cut-ins (ADR 70)"),
    Uncertain("lane_change", "lead_standstill", 0.15, "matched by hand to recorded cut-ins (ADR 24)"),
    Uncertain("lane_change", "rear_looming", 0.40, "matched to recorded cut-ins (ADR 70)"),
)
"""Uncertain numbers of the shipped model, and their spread."""
LAWS: tuple[Uncertain, ...] = (
    Uncertain("merging", "urgent_time", 0.35, "signs stand 400 to 800 m before it: 13 to 27 s (RSA 21, MUTCD 2C-4)"),
    Uncertain("merging", "accepts_braking", 0.35, "VISSIM: 1 accepted, 2.5 to 4 m/s2 at most (10.1155/2020/8850591)"),
    Uncertain("merging", "accepts_time", 0.25, "5 % follow within 0.61 s on US-101, 0.80 s in I-80's HOV lane"),
    Uncertain("merging", "lets_in", 0.35, "a judgement: a quarter to all; no published share was found", 2.0),
    Uncertain("merging", "looks_again", 0.69, "a judgement: a factor of 2, as overlook", 10.0),
    Uncertain("stopping", "stops_with", 0.20, "usual stops peak at 2.5 m/s2 (Roenitz 1999), roads allow for 3.4"),
    Uncertain("stopping", "own", 0.15, "a judgement: 6 m/s2 and more; no vehicle here brakes by more than 8", 1.0),
    Uncertain("stopping", "theirs", 0.20, "a judgement: 4 m/s2, the hardest of the tables, to 9 on a dry road"),
    Uncertain("stopping", "warned", 0.69, "a judgement: a factor of 2"),
)
"""Uncertain numbers of the stated laws (ADR 77, 78), and their spread; no source measured one of them as used here."""
DESIGN_EFFECT = 1.12
"""Number of decisions in one state of the table that carry as much information as one of independent drivers: 1.34 are
of one driver, with a correlation of 0.35 (benchmarks/model_widths.py)."""


def widths(model: NddModel) -> tuple[Uncertain, ...]:
    """List what is uncertain of a model: `UNCERTAIN`, with the intervals of the model's own fit where it states some.

    Args:
        model: With its provenance.
    """
    found = {(row.part, row.field): row for row in UNCERTAIN}
    for (part, field), interval in _own_intervals(model.provenance).items():
        known = found.get((part, field))
        low, high = interval
        if 0.0 < low < high:
            width = math.log(high / low) / (2.0 * _Z95)
            source = "95 % interval of the model's own fit"
            limits = (math.inf, 0.0) if known is None else (known.most, known.least)
            found[part, field] = Uncertain(part, field, width, source, *limits, measured=True)
    return tuple(found.values())


def _own_intervals(provenance: Mapping[str, object]) -> dict[tuple[str, str], tuple[float, float]]:
    """Read the intervals that a fit left in the provenance, by part and field.

    Raises:
        FileFormatError: It left something else there.
    """
    found: dict[tuple[str, str], tuple[float, float]] = {}
    noise: Any = provenance.get("noise_spread_fit")
    changes: Any = provenance.get("lane_change_fit")
    try:
        if noise is not None:
            found["initial", "noise_spread"] = _pair(noise)
        if changes is not None:
            for name, number in dict(changes["numbers"]).items():
                found["lane_change", str(name)] = _pair(number)
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"The model's provenance holds no usable intervals of its fit ({error}); fit it again."
        ) from error
    return found


def _pair(number: Mapping[str, Any]) -> tuple[float, float]:
    low, high = number["interval95"]
    return float(low), float(high)


def check_drawable(model: NddModel) -> None:
    """Check, before long work, that models can be drawn about this one.

    Raises:
        InputError: It does not say what it is made of, or its tables are not what it says.
    """
    try:
        drawn_model(model, 0, 0)
    except InputError as error:
        raise InputError(f"The model's own uncertainty cannot be drawn. {error} Or leave out --model-draws.") from error


def drawn_variations(model: NddModel, seed: int, k: int) -> tuple[Variation, ...]:
    """Draw the factors of all uncertain numbers.

    Args:
        model: About which to draw.
        seed: 0 or more.
        k: Number of the draw, 0 or more; each is independent of the others.

    Returns:
        One variation a number that is above 0, in the order of `widths`; a value stays within its allowed range.
    """
    rng = _generator(seed, k, 0)
    found = []
    for row in widths(model):
        factor = math.exp(row.width * float(rng.standard_normal()))
        value = _value(model, row)
        if value > 0.0:  # what already lies beyond a limit stays where it is
            highest, lowest = max(1.0, row.most / value), min(1.0, row.least / value)
            found.append(Variation(row.part, row.field, min(max(factor, lowest), highest)))
    return tuple(found)


def drawn_laws(road: RoadNumbers, seed: int, k: int) -> dict[Uncertain, float]:
    """Draw the factors of the stated laws that hold on a road: none where lanes go on and traffic is free.

    Args:
        road: Constants of the road.
        seed: 0 or more.
        k: Number of the draw, 0 or more.
    """
    rng = _generator(seed, k, 2)
    factors = [(row, math.exp(row.width * float(rng.standard_normal()))) for row in LAWS]
    holds = {"merging": road.lanes.varied, "stopping": road.stops}
    return {row: min(max(factor, row.least), row.most) for row, factor in factors if holds[row.part]}


def drawn_model(model: NddModel, seed: int, k: int) -> NddModel:
    """Draw a model: numbers by `drawn_variations`, and the rows of the following table that decisions stand behind.

    A row is drawn from Dirichlet((n / `DESIGN_EFFECT` + s) row), n its decisions and s the prior's strength; its mean
    is the row, and impossible entries stay impossible. All other rows are what the drawn law says.

    Args:
        model: About which to draw, with its provenance.
        seed: 0 or more.
        k: Number of the draw, 0 or more.

    Raises:
        InputError: The model does not say what it is made of, or its tables are not what it says.
    """
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("k", k, low=0, high=2**31 - 1)
    n, strength = counted_decisions(model), float(section(model, "settings")["prior_strength"])
    varied = varied_model(model, drawn_variations(model, seed, k))
    counted = n > 0.0
    rows = varied.following[counted].astype(np.float64)
    trusted = (n[counted] / DESIGN_EFFECT + strength)[:, None]
    following = varied.following.copy()
    following[counted] = _dirichlet(trusted * rows, _generator(seed, k, 1))
    return replace(varied, following=following)


def _dirichlet(concentration: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw rows of probabilities, shape (n, 31); exact zeros stay."""
    drawn = rng.standard_gamma(concentration)
    return np.asarray(drawn / drawn.sum(axis=-1, keepdims=True), dtype=np.float32)


def _generator(seed: int, k: int, use: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, k, use])))


def _value(model: NddModel, row: Uncertain) -> float:
    """Look up what a number is."""
    if row.part == "model":
        return float(getattr(model, row.field))
    if row.part in ("memory", "initial"):
        return float(getattr(getattr(model, row.part), row.field))
    stated = section(model, "lane_change" if row.part == "lane_change" else "following")
    return float((stated["law"] if row.part == "law" else stated)[row.field])
