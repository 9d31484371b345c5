"""One library and one policy for all tests of this folder."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.adversary.config import PRESETS
from cornerforge.adversary.policy_file import Policy, save_policy
from cornerforge.drivers.policy import n_weights
from cornerforge.ndd import default_model_path, load_model, save_model

LIBRARY_SEED = 5


@pytest.fixture(scope="session")
def swerve_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """60 crashes that the plain adversary `swerve` made; read only."""
    path = tmp_path_factory.mktemp("swerve") / "library"
    cornerforge.generate(policy="swerve", cases=60, out=path, seed=LIBRARY_SEED)
    return path


@pytest.fixture(scope="session")
def some_policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy file with random weights of preset `fast`."""
    shape = PRESETS["fast"].network
    weights = np.random.default_rng(0).normal(0.0, 0.1, n_weights(shape)).astype(np.float32)
    path = tmp_path_factory.mktemp("policy") / "some.safetensors"
    save_policy(Policy(weights, shape, False, {}), path)
    return path


@pytest.fixture(scope="session")
def reckless_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of drivers who crash often, in several ways."""
    path = tmp_path_factory.mktemp("reckless") / "reckless.npz"
    model = load_model(default_model_path())
    memory = replace(model.memory, away=0.02, away_again=0.5)
    often = np.full(21, 0.05, dtype=np.float32)
    save_model(replace(model, overlook=0.1, overlook_conflict=0.1, lc_base=often, memory=memory), path)
    return path


@pytest.fixture
def small_trees(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small parts, so that a test of trees takes seconds: a network that was taught little changes no rate."""
    teaching = importlib.import_module("cornerforge.rates.teaching")
    monkeypatch.setattr(teaching, "_EXPLORING", 200)
    monkeypatch.setattr(teaching, "_ROUNDS", (300,))
    monkeypatch.setattr(teaching, "_ROUNDS_OF_STAND_IN", (100,))
    monkeypatch.setattr(teaching, "_OWN_ROUNDS", (200,))
    monkeypatch.setattr(teaching, "TEACHING_TREES", 500)
    monkeypatch.setattr(teaching, "_PILOT", 200)
    monkeypatch.setattr(teaching, "_STEPS", 150)
    rate = importlib.import_module("cornerforge.pipeline.rate")
    monkeypatch.setattr(importlib.import_module("cornerforge.pipeline.plain"), "_BLOCK", 2_000)
    monkeypatch.setattr(rate, "PLAIN_TESTS", 4_000)
    for module in (rate, importlib.import_module("cornerforge.pipeline.splitting")):
        monkeypatch.setattr(module, "TREES", 500)
