"""The shipped model, and one in which more happens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cornerforge.ndd.model import NddModel, default_model_path, load_model


@pytest.fixture(scope="session")
def model() -> NddModel:
    return load_model(default_model_path())


@pytest.fixture(scope="session")
def reckless(model: NddModel) -> NddModel:
    """The same drivers, but they change lanes often, overlook what is beside them and start at unlike speeds.

    Much happens in few tests, and draws are refused that the shipped model hardly ever makes.
    """
    initial = replace(model.initial, rr_scale=3.0, min_ttc=8.0)
    base = np.full(21, 0.1, dtype=np.float32)
    return replace(model, lc_base=base, overlook=0.3, overlook_conflict=0.5, initial=initial)
