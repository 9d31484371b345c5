"""Teaching with a stand-in: who drives in which round, and whose lessons are learned from."""

from __future__ import annotations

import importlib
from typing import Any

import pytest
from hand_built import reckless_drivers, setting_of

from cornerforge.drivers.avs import av_named
from cornerforge.ndd.model import default_model_path, load_model
from cornerforge.rates.trees import BUILT_IN_GROWER
from cornerforge.sim import Forest, n_slots
from cornerforge.types import Odd

ROUNDS = {"_EXPLORING": 40, "_ROUNDS": (50, 60), "_ROUNDS_OF_STAND_IN": (50,), "_OWN_ROUNDS": (30, 30), "_PILOT": 50}


class Noted:
    """Grows trees like the kernels, and notes whose."""

    places, chunk = 1, 250

    def __init__(self) -> None:
        self.first: list[int] = []

    def __call__(self, seed: int, first: int, forest: Forest, roots: Any) -> None:
        self.first.append(first)
        BUILT_IN_GROWER(seed, first, forest, roots)


@pytest.mark.full
@pytest.mark.parametrize("stand_in", [False, True])
def test_a_stand_in_teaches_where_to_look_and_is_forgotten(stand_in: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    teaching = importlib.import_module("cornerforge.rates.teaching")
    for name, value in ROUNDS.items():
        monkeypatch.setattr(teaching, name, value)
    learned_from: list[int] = []

    def learn(_school: Any, tables: list[Any], *, steps: int) -> float:
        learned_from.append(len(tables))
        return 0.0 * steps

    monkeypatch.setattr(teaching._School, "learn", learn)
    odd = Odd()
    model = reckless_drivers(load_model(default_model_path()))
    own, told = Noted(), []
    taught = teaching.teach(
        setting_of(model, odd, av=av_named("idm-mobil")), n_slots(odd), seed=1, threads=1, grower=own,
        stand_in=stand_in, tell=lambda name, _: told.append(name),
    )  # fmt: skip
    assert own.first == ([90, 120] if stand_in else [0, 40, 90])
    assert learned_from == ([1, 2, 1, 2] if stand_in else [1, 2, 3])
    assert len(told) == len(own.first)
    assert taught.tests == 150
