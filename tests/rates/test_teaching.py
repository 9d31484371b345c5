"""Teaching: which AV drives in which round, which samples are learned from, and what it begins with."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hand_built import WIDE, reckless_drivers, setting_of

from cornerforge.drivers.avs import av_named
from cornerforge.experiment.setting import experiment
from cornerforge.ndd.model import default_model_path, load_model
from cornerforge.rates.branching.danger import N_SEEN, WIDTH, danger
from cornerforge.rates.branching.drive import BUILT_IN_TREES, TrainingTable
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
        assert all(av == 0 for av, _ in tables)
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
    known, is_own = teaching.shipped_network()
    assert not is_own
    for network in (*begun_with, taught.network):
        for ours, theirs in zip(network, known, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_a_built_in_av_with_a_network_of_its_own_is_not_taught_again() -> None:
    teaching = importlib.import_module("cornerforge.rates.teaching")
    mean, _ = teaching.shipped_network()
    run = experiment()
    taught = teaching.teach(run.setting, run.slots, seed=1, threads=2, own=teaching.own_bias(run))
    assert taught.tests == 0, "the shipped networks are of another model, or another AV; run: make danger"
    assert 1e-8 < taught.level < 1e-4
    for name, ours, theirs in zip(mean._fields, taught.network, mean, strict=True):
        assert (ours == theirs).all() == (name != "first_bias")


def test_another_av_or_another_world_has_no_network_of_its_own() -> None:
    teaching = importlib.import_module("cornerforge.rates.teaching")
    run = experiment()
    own = teaching.own_bias(run)
    assert teaching.own_bias(experiment(lanes=2)) == own
    assert teaching.own_bias(experiment(odd="paper")) is None
    shorter = replace(run.av, idm=replace(run.av.idm, time_gap=1.0))
    for other in (replace(run, av=shorter), replace(run, model=reckless_drivers(run.model))):
        assert teaching.own_bias(other) != own
        assert not teaching.shipped_network(teaching.own_bias(other))[1]


def test_avs_that_learn_together_share_all_but_a_bias() -> None:
    """Two AVs see the same; what is dangerous to the one is harmless to the other."""
    teaching = importlib.import_module("cornerforge.rates.teaching")
    rng = np.random.default_rng(1)
    seen = rng.random((4_000, N_SEEN)).astype(np.float32)
    tables = [
        (av, TrainingTable(seen, np.full(4_000, followed), np.ones(4_000), np.arange(4_000)))
        for av, followed in enumerate((1e-1, 1e-4))
    ]
    learner = teaching.DangerLearner(1, avs=2)
    learner.learn(tables, steps=600)
    one, other, mean = learner.network(0), learner.network(1), learner.network(None)
    np.testing.assert_array_equal(one.second, other.second)
    np.testing.assert_allclose((one.first_bias + other.first_bias) / 2, mean.first_bias, atol=1e-6)
    layers = np.zeros((2, WIDTH), dtype=np.float32)
    for network, true in ((one, 1e-1), (other, 1e-4)):
        found = np.array([danger(network, x, layers) for x in seen[:100]])
        assert abs(np.log10(np.median(found) / true)) < 0.2
