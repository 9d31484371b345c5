"""A model in which much happens, as a file, and driving environments to their end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.ndd.model import default_model_path, load_model, save_model


@pytest.fixture(scope="session")
def reckless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drivers who change lanes often and overlook what is beside them: crashes of all kinds within few tests."""
    model = load_model(default_model_path())
    initial = replace(model.initial, rr_scale=3.0, min_ttc=8.0)
    base = np.full(21, 0.1, dtype=np.float32)
    path = tmp_path_factory.mktemp("model") / "reckless.npz"
    save_model(replace(model, lc_base=base, overlook=0.3, overlook_conflict=0.5, initial=initial), path)
    return path
