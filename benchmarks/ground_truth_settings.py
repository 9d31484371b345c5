"""What the ground truth is counted for: a fixed list of settings, and how the models of its variations are made.

A variation changes one number. Probabilities of overlooking are numbers of the model. Constants of the prior change the
prior's rows only: a table row is (counts + s prior) / (n + s), so the new row is the old one plus
s (new prior - old prior) / (n + s), with n and s from the model's provenance. Another prior strength needs the data.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.ndd import fit_model
from cornerforge.ndd.lane_change import LaneChange
from cornerforge.ndd.laws import LogLaw
from cornerforge.ndd.model import NddModel
from cornerforge.ndd.prior import SafeLaw, following_prior

__all__ = ["SETTINGS", "Setting", "Variation", "varied_model"]


@dataclass(frozen=True)
class Variation:
    """One number of the model, changed.

    Attributes:
        part: "model" (a number of the model file), "safe" (`SafeLaw`), "law" (`LogLaw`), "lane_change" (`LaneChange`),
            or "fit" (fit again from data).
        field: Its name there; for "fit" `prior_strength`.
        factor: Times what it is; for "fit" the new value.
    """

    part: str
    field: str
    factor: float

    @property
    def text(self) -> str:
        """For people, such as "overlook x 2"."""
        return f"{self.field} {self.factor:g}" if self.part == "fit" else f"{self.field} x {self.factor:g}"


@dataclass(frozen=True)
class Setting:
    """One count.

    Attributes:
        name: Of the entry in the ledger.
        av, lanes: What drives where.
        tests: How many are wanted.
        variation: None for the shipped model.
    """

    name: str
    av: str
    lanes: int
    tests: int
    variation: Variation | None = None


_TESTS = {("idm-mobil", 3): 300_000_000}
_BASE = tuple(
    Setting(f"{av}-{lanes}-lanes", av, lanes, _TESTS.get((av, lanes), 100_000_000))
    for av in ("idm-mobil", "idm-mobil-d2rl", "idm-mobil-blind")
    for lanes in (3, 2)
)
_SENSITIVITY_TESTS = 10_000_000
_VARIED: tuple[tuple[str, str, tuple[float, ...]], ...] = (
    ("model", "overlook", (0.0, 0.5, 2.0, 10.0)),
    ("model", "overlook_conflict", (0.0, 0.5, 2.0, 10.0)),
    ("memory", "away", (0.0, 0.5, 2.0)),
    ("initial", "signal_share", (0.0, 1.5)),
    ("initial", "desire_share", (0.5, 1.5)),
    ("initial", "noise_spread", (0.0, 2.0)),
    ("initial", "vigilance_sigma", (0.0, 1.5)),
    ("fit", "prior_strength", (50.0, 1000.0)),
    ("safe", "response", (0.75, 1.5)),
    ("law", "spread", (0.8, 1.25)),
    ("law", "degrees", (0.6, 3.0)),
    ("lane_change", "rate", (0.5, 2.0)),
    ("lane_change", "rear_reaction", (0.5, 1.5)),
)
"""Part, field, factors (for "fit" values). The shipped model, factor 1 and strength 200, is the base setting."""


def _varied() -> tuple[Setting, ...]:
    variations = [Variation(part, name, factor) for part, name, factors in _VARIED for factor in factors]
    return tuple(
        Setting(f"{v.part}-{v.field}-{v.factor:g}".replace("_", "-"), "idm-mobil", 3, _SENSITIVITY_TESTS, v)
        for v in variations
    )


SETTINGS: tuple[Setting, ...] = (*_BASE, *_varied())
"""In the order of their importance."""

_REBUILT_WITHIN = 2e-3
"""Largest difference between tables and what their provenance rebuilds: 10 bits are kept of each number, and a row's
largest takes what is then missing from 1. One decision in a state without others is worth 1 / 201 at strength 200."""


def varied_model(model: NddModel, variation: Variation, data: Sequence[Path]) -> NddModel:
    """The model with one number changed.

    Args:
        model: The one to start from, with its provenance.
        variation: What to change.
        data: Trajectory files that the model was fitted from; needed for "fit" only.

    Raises:
        InputError: No data for a fit, or the provenance does not lead to the model's tables.
    """
    if variation.part == "model":
        return replace(model, **{variation.field: getattr(model, variation.field) * variation.factor})
    if variation.part in ("memory", "initial"):
        part = getattr(model, variation.part)
        moved = {variation.field: getattr(part, variation.field) * variation.factor}
        return replace(model, **{variation.part: replace(part, **moved)})
    if variation.part == "fit":
        return _fitted(model, variation, data)
    if variation.part == "lane_change":
        return _other_lane_change(model, variation)
    return _other_prior(model, variation)


def _fitted(model: NddModel, variation: Variation, data: Sequence[Path]) -> NddModel:
    if not data:
        raise InputError(f"{variation.text} needs a fit: name the trajectory files with --data FILE...")
    return fit_model(list(data), str(model.provenance["format"]), prior_strength=variation.factor)[0]


def _section(model: NddModel, name: str) -> dict[str, Any]:
    found = model.provenance.get(name)
    if not isinstance(found, dict):
        raise InputError(f'The model does not say its "{name}", so its prior cannot be varied; use the shipped model.')
    return dict(found)


def _known(kind: Any, values: dict[str, Any]) -> dict[str, Any]:
    """The values, if they are exactly the fields of a dataclass."""
    names = {field.name for field in fields(kind)}
    if names != set(values):
        raise InputError(
            f"The model's provenance and {kind.__name__} have different constants ({sorted(names ^ set(values))}); "
            "mend benchmarks/ground_truth_settings.py."
        )
    return values


_LANE_CHANGE_TABLES: dict[str, Callable[[LaneChange], Any]] = {
    "lc_base": LaneChange.base,
    "lc_desire": LaneChange.desire,
    "lc_desire_free": lambda law: law.desire_free,
    "lc_accept_lead": LaneChange.accept_lead,
    "lc_accept_rear": LaneChange.accept_rear,
    "lc_turn_back": LaneChange.turn_back,
    "overlook": lambda law: law.overlook,
    "overlook_conflict": lambda law: law.overlook_conflict,
}


def _other_lane_change(model: NddModel, variation: Variation) -> NddModel:
    before = LaneChange(**_known(LaneChange, _section(model, "lane_change")))
    after = replace(before, **{variation.field: getattr(before, variation.field) * variation.factor})
    changed: dict[str, Any] = {}
    for name, made_by in _LANE_CHANGE_TABLES.items():
        old, new = made_by(before), made_by(after)
        _check_rebuilt(name, getattr(model, name) / np.max(old), old / np.max(old))
        if not np.array_equal(old, new):
            changed[name] = np.asarray(new, dtype=np.float32) if np.ndim(new) else new
    return replace(model, **changed)


def _other_prior(model: NddModel, variation: Variation) -> NddModel:
    following = _section(model, "following")
    law = LogLaw(**_known(LogLaw, dict(following.pop("law"))))
    before = SafeLaw(**_known(SafeLaw, {"law": law, **following}))
    if variation.part == "law":
        law = replace(law, **{variation.field: getattr(law, variation.field) * variation.factor})
        after = replace(before, law=law)
    else:
        after = replace(before, **{variation.field: getattr(before, variation.field) * variation.factor})
    rows, old, new = model.following.astype(np.float64), _prior(before), following_prior(after)
    share = _prior_share(model)[..., None]
    empty = share[..., 0] == 1.0
    _check_rebuilt("following", rows[empty], old[empty])
    data = rows - share * old
    data[np.abs(data) < _REBUILT_WITHIN] = 0.0  # rounding, not decisions
    mixed = np.maximum(data, 0.0) + share * new
    mixed /= mixed.sum(axis=-1, keepdims=True)
    return replace(model, following=mixed.astype(np.float32))


@functools.lru_cache(maxsize=1)
def _prior(law: SafeLaw) -> NDArray[np.float64]:
    """Every variation starts from the same prior."""
    return following_prior(law)


def _prior_share(model: NddModel) -> NDArray[np.float64]:
    """Weight of the prior in each following state, s / (n + s), shape (21, 116, 19)."""
    strength = float(_section(model, "settings")["prior_strength"])
    counted = _section(model, "counted")
    n = np.zeros(model.following.shape[:-1])
    n.reshape(-1)[np.array(counted["state"], dtype=np.int64)] = counted["decisions"]
    return strength / (n + strength)


def _check_rebuilt(name: str, table: NDArray[np.floating], rebuilt: NDArray[np.floating]) -> None:
    """Refuse to vary a table that its provenance does not explain: the variation would change more than one number."""
    worst = float(np.abs(table - rebuilt).max())
    if worst > _REBUILT_WITHIN:
        raise InputError(
            f"The model's {name} is not what its provenance says (off by {worst:.2g}, allowed {_REBUILT_WITHIN:g}); "
            "mend benchmarks/ground_truth_settings.py."
        )
