"""Teaching: which AV drives in which round, which samples are learned from, and what it begins with."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest
from hand_built import WIDE, reckless_drivers, setting_of

from cornerforge.drivers.avs import av_named
from cornerforge.ndd.model import default_model_path, load_model
from cornerforge.rates.branching.drive import BUILT_IN_TREES
from cornerforge.rates.branching.population import Population
from cornerforge.sim import n_slots


class Noted:
    """Drives trees like the kernels, and notes the AVs."""

    places, chunk = 1, 250

    def __init__(self) -> None:
        self.first: list[int] = []
        self.blind: list[bool] = []

    def __call__(self, seed: int, first: int, population: Population, trees: Any) -> Any:
        self.first.append(first)
        self.blind.append(population.plan.windows == 0)
        return BUILT_IN_TREES(seed, first, population, trees)


@pytest.mark.full
def test_a_known_network_is_adjusted_by_trees_of_the_av_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blind trees come first, and their samples stay: the crashes of `idm-mobil-blind` are those of no other AV.

    By the shipped network alone 60,000 trees gave 6.7e-6 for it, a fourth of what counting gives.
    """
    teaching = importlib.import_module("cornerforge.rates.teaching")
    monkeypatch.setattr(teaching, "_EXPLORING", 30)
    monkeypatch.setattr(teaching, "_ROUNDS", (40, 60))
    monkeypatch.setattr(teaching, "_PILOT", 50)
    begun_with: list[Any] = []
    learned_from: list[int] = []

    def learn(learner: Any, tables: list[Any], *, steps: int) -> float:
        begun_with.append(learner.network())
        learned_from.append(len(tables))
        return 0.0 * steps

    monkeypatch.setattr(teaching.DangerLearner, "learn", learn)
    odd = WIDE
    model = reckless_drivers(load_model(default_model_path()))
    own, told = Noted(), []
    taught = teaching.teach(
        setting_of(model, odd, av=av_named("idm-mobil")), n_slots(odd), seed=1, threads=1, driver=own,
        tell=lambda name, _: told.append(name),
    )  # fmt: skip
    assert own.first == [0, 30, 70]
    assert own.blind == [True, False, False]
    assert learned_from == [1, 2, 3]
    assert len(told) == 3
    assert taught.tests == 130
    known = teaching.shipped_network()
    for network in (*begun_with, taught.network):
        for ours, theirs in zip(network, known, strict=True):
            np.testing.assert_array_equal(ours, theirs)
