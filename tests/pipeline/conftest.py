"""One library and one policy for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.adversary.config import PRESETS
from cornerforge.adversary.policy_file import Policy, save_policy
from cornerforge.drivers.policy import n_weights

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
