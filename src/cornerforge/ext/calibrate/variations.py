"""Models with some of their numbers changed: as if a fit, a judgement or a published figure had come out otherwise.

Probabilities of overlooking, memory and initial traffic are numbers of the model. Constants of the prior change the
prior's rows only: a table row is (counts + s prior) / (n + s), so the new row is the old one plus
s (new prior - old prior) / (n + s), with n and s from the model's provenance. Another prior strength needs the data.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_in
from cornerforge.errors import InputError
from cornerforge.ext.calibrate.fit import fit_model
from cornerforge.ext.calibrate.lane_change import LaneChange
from cornerforge.ext.calibrate.laws import LogLaw
from cornerforge.ext.calibrate.prior import SafeLaw, following_prior
from cornerforge.ext.calibrate.shown import counted_states
from cornerforge.ndd.model import NddModel

__all__ = ["PARTS", "Variation", "counted_decisions", "section", "varied_model"]

Floats = NDArray[np.float64]

PARTS = ("lane_change", "safe", "law", "model", "memory", "initial", "fit")
"""Values that `Variation.part` may have."""
_REBUILT_WITHIN = 2e-3
"""Largest difference between tables and tables rebuilt from their provenance: 10 bits are kept of each number, and a
row's largest takes the rest to 1. One decision in a state without others is worth 1 / 201 at strength 200."""
_MEND = "fit it again (cornerforge ndd fit), or use the shipped model."


@dataclass(frozen=True)
class Variation:
    """One number of the model, changed.

    Attributes:
        part: "model" (a number of the model file), "memory" or "initial" (one of these parts of it), "safe"
            (`SafeLaw`), "law" (`LogLaw`), "lane_change" (`LaneChange`), or "fit" (fit again from data).
        field: Its name there; for "fit" `prior_strength`.
        factor: Times what it is; for "fit" the new value.
    """

    part: str
    field: str
    factor: float

    def __post_init__(self) -> None:
        check_in("part of a model", self.part, PARTS)

    @property
    def text(self) -> str:
        """Text for people, such as "overlook x 2"."""
        return f"{self.field} {self.factor:g}" if self.part == "fit" else f"{self.field} x {self.factor:g}"


def varied_model(model: NddModel, variations: Sequence[Variation], data: Sequence[Path] = ()) -> NddModel:
    """Change some numbers of a model, all at once; each stays what it is but for its own factors.

    The provenance of the model that comes out says the changed constants, so it can be varied again.

    Args:
        model: The one to start from, with its provenance.
        variations: What to change; nothing gives the model itself. One of "fit" comes first, the others on top of it.
        data: Trajectory files that the model was fitted from; needed for "fit" only.

    Raises:
        InputError: No data for a fit, or the provenance does not lead to the model's tables.
        FileFormatError: A number is then outside of what a model may have.
    """
    by_part: dict[str, list[Variation]] = {part: [] for part in PARTS}
    for variation in variations:
        by_part[variation.part].append(variation)
    for variation in by_part["fit"]:
        model = _fitted(model, variation, data)
    if by_part["lane_change"]:
        model = _other_lane_change(model, by_part["lane_change"])
    if by_part["safe"] or by_part["law"]:
        model = _other_prior(model, by_part["safe"], by_part["law"])
    for name in ("memory", "initial"):
        if by_part[name]:
            model = replace(model, **{name: _changed(getattr(model, name), by_part[name])})
    if by_part["model"]:
        model = _other_numbers(model, by_part["model"])
    return model


def section(model: NddModel, name: str) -> dict[str, Any]:
    """Look up a part of a model's provenance.

    Raises:
        InputError: The model does not say it.
    """
    found = model.provenance.get(name)
    if not isinstance(found, dict):
        raise InputError(f'The model does not say its "{name}", so it cannot be varied; {_MEND}')
    return dict(found)


def counted_decisions(model: NddModel) -> Floats:
    """Decisions behind each following state, shape (21, 116, 19); 0 where only the prior stands.

    Raises:
        InputError: The model does not say it.
        FileFormatError: It says something else than counts of states.
    """
    section(model, "counted")  # it must be there
    return np.asarray(counted_states(model), dtype=np.float64)


def _changed(before: Any, variations: Sequence[Variation]) -> Any:
    """Multiply fields of a dataclass."""
    after = before
    for variation in variations:
        after = replace(after, **{variation.field: getattr(after, variation.field) * variation.factor})
    return after


def _said(model: NddModel, changed: Mapping[str, object]) -> dict[str, object]:
    return {**model.provenance, **changed}


def _other_numbers(model: NddModel, variations: Sequence[Variation]) -> NddModel:
    after: NddModel = _changed(model, variations)
    lane_change = model.provenance.get("lane_change")
    if isinstance(lane_change, dict):
        own = {name: getattr(after, name) for name in ("overlook", "overlook_conflict") if name in lane_change}
        after = replace(after, provenance=_said(after, {"lane_change": {**lane_change, **own}}))
    return after


def _fitted(model: NddModel, variation: Variation, data: Sequence[Path]) -> NddModel:
    if not data:
        raise InputError(f"{variation.text} needs a fit: name the trajectory files.")
    return fit_model(list(data), str(model.provenance["format"]), prior_strength=variation.factor)[0]


def _known(kind: Any, values: dict[str, Any]) -> dict[str, Any]:
    """The values, if they are exactly the fields of a dataclass."""
    names = {field.name for field in fields(kind)}
    if names != set(values):
        raise InputError(
            f"The model's provenance and {kind.__name__} have different constants ({sorted(names ^ set(values))}): "
            f"another version made it; {_MEND}"
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


def _other_lane_change(model: NddModel, variations: Sequence[Variation]) -> NddModel:
    before = LaneChange(**_known(LaneChange, section(model, "lane_change")))
    after = _changed(before, variations)
    changed: dict[str, Any] = {}
    for name, made_by in _LANE_CHANGE_TABLES.items():
        old, new = made_by(before), made_by(after)
        _check_rebuilt(name, getattr(model, name) / np.max(old), old / np.max(old))
        if not np.array_equal(old, new):
            changed[name] = np.asarray(new, dtype=np.float32) if np.ndim(new) else new
    return replace(model, **changed, provenance=_said(model, {"lane_change": asdict(after)}))


def _other_prior(model: NddModel, of_safe: Sequence[Variation], of_law: Sequence[Variation]) -> NddModel:
    following = section(model, "following")
    law = LogLaw(**_known(LogLaw, dict(following.pop("law"))))
    before = SafeLaw(**_known(SafeLaw, {"law": law, **following}))
    after = replace(_changed(before, of_safe), law=_changed(law, of_law))
    rows, old, new = model.following.astype(np.float64), _prior(before), following_prior(after)
    share = _prior_share(model)[..., None]
    empty = share[..., 0] == 1.0
    _check_rebuilt("following", rows[empty], old[empty])
    data = rows - share * old
    data[np.abs(data) < _REBUILT_WITHIN] = 0.0  # rounding, not decisions
    mixed = np.maximum(data, 0.0) + share * new
    mixed /= mixed.sum(axis=-1, keepdims=True)
    said = _said(model, {"following": asdict(after)})
    return replace(model, following=mixed.astype(np.float32), provenance=said)


@functools.lru_cache(maxsize=1)
def _prior(law: SafeLaw) -> Floats:
    """Most variations start from the same prior."""
    return following_prior(law)


def _prior_share(model: NddModel) -> Floats:
    """Weight of the prior in each following state, s / (n + s), shape (21, 116, 19)."""
    strength = float(section(model, "settings")["prior_strength"])
    return strength / (counted_decisions(model) + strength)


def _check_rebuilt(name: str, table: NDArray[np.floating], rebuilt: NDArray[np.floating]) -> None:
    """Refuse to vary a table that its provenance does not explain: the variation would change more than one number."""
    worst = float(np.abs(table - rebuilt).max())
    if worst > _REBUILT_WITHIN:
        raise InputError(
            f"The model's {name} is not what its provenance says (off by {worst:.2g}, allowed {_REBUILT_WITHIN:g}): "
            f"it was changed by hand, or another version made it; {_MEND}"
        )
