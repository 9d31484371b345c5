"""A library, a policy and a model that tests of several folders share, made once by each worker."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_trees import small_trees

import cornerforge
from cornerforge.adversary.config import PRESETS
from cornerforge.drivers.policy import n_weights
from cornerforge.experiment.policy_file import Policy, save_policy
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


@pytest.fixture(name="small_trees")
def _small_trees() -> Iterator[None]:
    """Small parts of a rate by trees."""
    with small_trees():
        yield
