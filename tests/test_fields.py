"""What is recorded is said once: everything that is made of the lists agrees with them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pyarrow as pa
import pytest
from hand_built import WIDE

from cornerforge._arrow import arrow_type
from cornerforge._jit import kernel
from cornerforge._values import column_fault
from cornerforge.analysis.avoidability import AVOIDABILITY_COLUMNS
from cornerforge.analysis.stored import CASE_COLUMNS
from cornerforge.fields import CASE_ROW, CASES, FRAME_FIELDS, HISTORY_SHAPE, POSE, REALS, SERIES, TRACKS, Field
from cornerforge.library.schema import RAILS_TRACKS, own_fields
from cornerforge.road.straight import road_numbers
from cornerforge.sim import harvest
from cornerforge.sim.keep import Decisions
from cornerforge.sim.step import allocate_recording, record_frame
from cornerforge.sim.world import VEHICLE, World, allocate_worlds, world_of
from cornerforge.types import Scenario


@kernel
def _record(w: World, recording: np.ndarray) -> None:
    record_frame(w, 1, recording)


def test_a_frame_has_every_series_of_the_list() -> None:
    """Of two vehicles that are there; the third is absent, and its cell stays as it was."""
    world = world_of(allocate_worlds(1, 3))
    world.state["n_vehicles"] = 3
    for place, series in enumerate(SERIES, start=1):
        world.vehicles[series.name] = [place, 10 * place, 99]
    world.vehicles["present"] = [1, 1, 0]
    recording = allocate_recording(2, 3)
    _record(world, recording)
    rest = [place for place, series in enumerate(SERIES, start=1) if series.name != "present"]
    assert recording[1, 0].tolist() == (*rest, 1)
    assert recording[1, 1].tolist() == (*(10 * place for place in rest), 1)
    assert not recording[1, 2]["present"]
    assert not recording[0]["present"].any()


def test_a_case_has_every_real_series_and_pose_of_the_lists() -> None:
    """Two vehicles, two frames; vehicle 1 is absent in the first."""
    cells = np.zeros((2, 2), dtype=FRAME_FIELDS)
    for place, name in enumerate(REALS, start=1):
        cells[name] = [[place, 99], [10 * place, 100 * place]]
    cells["present"] = [[1, 0], [1, 1]]
    zeros = np.zeros(1)
    nothing = Decisions(
        np.zeros((1, 2), np.int8), np.zeros(1, np.int16), zeros, zeros, zeros, zeros, np.zeros(1, np.int8)
    )
    bodies = np.zeros(2, dtype=VEHICLE)
    bodies["length"], bodies["width"] = 5.0, 2.0
    room = harvest.allocate_harvest(1, 2, 1)
    end = harvest.Recorded(2, 1, 2, 1, 1)
    harvest.keep_case(harvest.CaseName(0, 0, 0), end, np.inf, road_numbers(WIDE), cells, nothing, bodies, room)
    for row, name in enumerate(REALS):
        values = np.where(cells["present"], cells[name], np.nan)
        np.testing.assert_array_equal(room.reals[row, :4], values.T.ravel())
        np.testing.assert_array_equal(room.exact[4 * row : 4 * row + 4], np.nan_to_num(values).ravel())
    history = room.history[0].reshape(HISTORY_SHAPE)
    np.testing.assert_array_equal(history[0], [[cells[name][1, i] for name in POSE] for i in (0, 1)])


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


COLUMNS = (*CASES, *RAILS_TRACKS, *CASE_COLUMNS, *AVOIDABILITY_COLUMNS, *own_fields({"mine": "float"}))


def _accepted(field: Field) -> tuple[bool, ...]:
    """Whether null, NaN and inf are accepted in a column."""
    kind = arrow_type(field.type)
    inner = kind.value_type if pa.types.is_nested(kind) else kind
    columns = [pa.nulls(1, kind)]
    if pa.types.is_floating(inner):
        size = getattr(kind, "list_size", 1)
        rows = [[value] * size if pa.types.is_nested(kind) else value for value in (math.nan, math.inf)]
        columns += [pa.array([row], kind) for row in rows]
    return tuple(column_fault(pa.chunked_array([one]), field, str) is None for one in columns)


LISTS = [one for one in COLUMNS if pa.types.is_nested(arrow_type(one.type))]


@pytest.mark.parametrize("field", LISTS, ids=lambda field: field.name)
def test_a_null_within_a_list_is_named(field: Field) -> None:
    kind = arrow_type(field.type)
    size = getattr(kind, "list_size", 2)
    low, high = field.within or (0, 1)
    rows = pa.array([[max(low, min(high, 1))] * size, [max(low, min(high, 1))] * (size - 1) + [None]])
    fault = column_fault(pa.chunked_array([rows.cast(kind)]), field, lambda row: f"row {row}")
    assert fault is not None
    assert fault.startswith(f'"{field.name}"[{size - 1}] of row 1 is missing; it must be ')


@pytest.mark.parametrize("field", COLUMNS, ids=lambda field: field.name)
def test_words_decide_nothing_and_tell_what_is_decided(field: Field) -> None:
    flags = field.nullable, field.nan
    for words in ("x", "null NaN"):
        other = dataclasses.replace(field, meaning=words, unit=words)
        assert (other.nullable, other.nan) == flags
        assert _accepted(other) == _accepted(field)
    assert tuple(word in field.meaning for word in ("null", "NaN")) == flags
