"""Models with some of their numbers changed: what is named moves, all else stays, and they can be changed again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cornerforge.errors import FileFormatError, InputError
from cornerforge.ext.calibrate.variations import Variation, varied_model
from cornerforge.ndd.model import NddModel, load_model, model_hash, save_model

TABLES = ("following", "free", "lc_base", "lc_desire", "lc_accept_lead", "lc_accept_rear", "lc_turn_back")
VARIATIONS = {
    "overlook": Variation("model", "overlook", 2.0),
    "overlook_conflict": Variation("model", "overlook_conflict", 2.0),
    "away": Variation("memory", "away", 2.0),
    "signal_share": Variation("initial", "signal_share", 1.5),
    "vigilance_sigma": Variation("initial", "vigilance_sigma", 1.5),
    "safe response": Variation("safe", "response", 1.5),
    "law response": Variation("law", "response", 1.3),
    "spread": Variation("law", "spread", 1.25),
    "degrees": Variation("law", "degrees", 3.0),
    "rate": Variation("lane_change", "rate", 2.0),
    "rear_looming": Variation("lane_change", "rear_looming", 1.5),
    "misjudge": Variation("lane_change", "misjudge", 1.5),
}
MOVED = {"safe": {"following"}, "law": {"following"}}


def _difference(a: NddModel, b: NddModel, name: str) -> float:
    """Largest difference of a table, as a share of its largest number."""
    return float(np.abs(getattr(a, name) - getattr(b, name)).max() / getattr(b, name).max())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", VARIATIONS)
def test_a_variation_moves_what_it_names_and_factor_one_moves_nothing(model: NddModel, name: str) -> None:
    variation = VARIATIONS[name]
    varied, same = varied_model(model, [variation]), varied_model(model, [replace(variation, factor=1.0)])
    moved = {table for table in TABLES if _difference(varied, model, table) > 2e-3}
    lane_change = {"lc_base"} if name == "rate" else {"lc_accept_rear"}
    assert moved == (lane_change if variation.part == "lane_change" else MOVED.get(variation.part, set()))
    for part, numbers in (("model", model), ("memory", model.memory), ("initial", model.initial)):
        if variation.part == part:
            of = varied if part == "model" else getattr(varied, part)
            assert getattr(of, variation.field) == variation.factor * getattr(numbers, variation.field)
    for table in TABLES:
        assert _difference(same, model, table) < 2e-3, table


@pytest.mark.full
def test_many_at_once_are_the_same_as_one_after_the_other(model: NddModel, tmp_path: Path) -> None:
    """So they compose, in any order; the provenance of what comes out says the new constants, also from a file."""
    every = list(VARIATIONS.values())
    at_once = varied_model(model, every)
    after_each_other = model
    for variation in reversed(every):
        after_each_other = varied_model(after_each_other, [variation])
        save_model(after_each_other, tmp_path / "m.npz")
        after_each_other = load_model(tmp_path / "m.npz")
    for table in TABLES:
        assert _difference(at_once, after_each_other, table) < 1e-3, table  # rounding of rows with data
    assert at_once.initial == after_each_other.initial
    assert (at_once.overlook, at_once.memory) == (after_each_other.overlook, after_each_other.memory)
    said: Any = at_once.provenance
    assert said["lane_change"]["rate"] == pytest.approx(2.0 * 0.0133)
    assert said["lane_change"]["overlook"] == pytest.approx(2.0 * 0.0008)
    assert said["following"]["law"]["degrees"] == pytest.approx(3.0 * 5.396)
    assert model_hash(varied_model(model, [])) == model_hash(model)


def test_data_stay_where_the_prior_is_changed(model: NddModel) -> None:
    """Counts that the shipped rows hold are in the new rows too: share * new prior is all that is left without them."""
    counted: Any = model.provenance["counted"]
    place = int(np.argmax(counted["decisions"]))
    state, n = np.unravel_index(counted["state"][place], model.following.shape[:3]), counted["decisions"][place]
    varied = varied_model(model, [Variation("safe", "response", 1.5)])
    strength = 200.0
    chosen = model.following[state] > 1.5 * np.median(model.following[state])
    assert varied.following[state].sum() == pytest.approx(1.0, abs=1e-5)
    # nothing may fall below what n decisions alone give, spread over the bins that were chosen
    assert varied.following[state][chosen].sum() >= n / (n + strength) * 0.5


def test_a_model_without_provenance_is_not_varied(model: NddModel) -> None:
    bare = replace(model, provenance={})
    stiff = [Variation("safe", "response", 2.0)]
    with pytest.raises(InputError, match="does not say"):
        varied_model(bare, stiff)
    wrong: dict[str, Any] = {**model.provenance}
    wrong["following"] = {**wrong["following"], "response": 1.0}
    with pytest.raises(InputError, match="not what its provenance says"):
        varied_model(replace(model, provenance=wrong), stiff)
    wrong["following"] = {**wrong["following"], "unheard_of": 1.0}
    with pytest.raises(InputError, match="unheard_of"):
        varied_model(replace(model, provenance=wrong), stiff)
    with pytest.raises(InputError, match="name the trajectory files"):
        varied_model(model, [Variation("fit", "prior_strength", 50.0)])
    with pytest.raises(InputError, match="part of a model"):
        Variation("weather", "rain", 2.0)
    with pytest.raises(FileFormatError, match="signal_share"):
        varied_model(model, [Variation("initial", "signal_share", 3.0)])
