"""The tables of the shipped model, for the driver tests."""

from __future__ import annotations

import pytest

from cornerforge.drivers.naturalistic import NddTables, tables_of
from cornerforge.ndd.model import NddModel


@pytest.fixture(scope="session")
def tables(model: NddModel) -> NddTables:
    return tables_of(model)
