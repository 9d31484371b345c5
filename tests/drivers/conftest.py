"""The shipped naturalistic model, for the driver tests."""

from __future__ import annotations

import pytest

from cornerforge.drivers.naturalistic import NddTables, tables_of
from cornerforge.ndd.model import NddModel, default_model_path, load_model


@pytest.fixture(scope="session")
def model() -> NddModel:
    return load_model(default_model_path())


@pytest.fixture(scope="session")
def tables(model: NddModel) -> NddTables:
    return tables_of(model)
