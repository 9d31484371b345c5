"""What is recorded is said once: everything that is made of the lists agrees with them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cornerforge.fields import CASE_ROW, CASES, FRAME_FIELDS, REALS, SERIES, TRACKS
from cornerforge.sim import harvest
from cornerforge.types import Scenario


def test_the_kernel_reads_the_real_series_in_their_order() -> None:
    """`harvest._reals` is the one place that names them by hand."""
    cell = np.zeros(1, dtype=FRAME_FIELDS)
    for place, name in enumerate(REALS, start=1):
        cell[name] = place
    assert harvest._reals(cell.view(np.recarray)[0]) == tuple(range(1, len(REALS) + 1))


def test_series_are_those_of_a_scenario() -> None:
    fields = {field.name: field for field in dataclasses.fields(Scenario)}
    for series in SERIES:
        assert fields[series.name].metadata.get("unit", "") == series.column.unit
        assert f"list of {series.column.type}" in [c.type for c in TRACKS if c.name == series.column.name]
    assert list(REALS) == [series.name for series in SERIES][: len(REALS)], "a digest takes the real numbers first"


@pytest.mark.parametrize("columns", [CASES, TRACKS], ids=["cases", "tracks"])
def test_names_are_unique(columns: tuple[object, ...]) -> None:
    names = [column.name for column in columns]  # type: ignore[attr-defined]
    assert len(set(names)) == len(names)


def test_the_kernel_fills_every_number_of_a_case() -> None:
    texts = {"case_id", "trajectory_digest", "critical_bv_action", "history"}
    assert {column.name for column in CASES} - set(CASE_ROW.names or ()) == texts
