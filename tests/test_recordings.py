"""One table of recordings: from scenarios and from a library's tables alike, in blocks, and back into frames."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hand_built import WIDE
from reference.recorded import recordings_of_all
from reference.records import case_record

from cornerforge.analysis.fault import Faults, assign_fault
from cornerforge.analysis.measures import measure_cases
from cornerforge.errors import InputError
from cornerforge.fields import REALS, SERIES
from cornerforge.recordings import (
    BODY_FIELDS,
    Recordings,
    Trajectories,
    box_in,
    recordings_of,
    recordings_of_tracks,
    unpack,
)
from cornerforge.sim.step import allocate_recording
from cornerforge.types import Crash, Scenario

ODD = replace(WIDE, vehicle_length=4.0, vehicle_width=1.5)


def crash_behind(test: int, frames: int, vehicles: int) -> Scenario:
    """The AV runs into the rear of the last vehicle, which is absent in the first frame; the others drive beside."""
    shape = frames, vehicles
    t = 0.1 * np.arange(frames)[:, None]
    speed = np.full(shape, 30.0)
    speed[:, -1] = 20.0
    x = 100.0 + 7.0 * np.arange(vehicles) + speed * t
    x[:, -1] += x[-1, 0] + 3.9 - x[-1, -1]
    present = np.ones(shape, np.bool_)
    present[0, 1:] = False
    lane = np.zeros(shape, np.int8)
    lane[:, 1:-1] = 2
    reals: dict[str, Any] = {
        "x": x,
        "y": 4.0 * lane + 2.0,
        "speed": speed,
        "heading": np.zeros(shape),
        "acceleration": 0.1 * speed,
    }
    series: dict[str, Any] = {name: np.where(present, values, np.nan) for name, values in reals.items()}
    return Scenario(
        seed=7, test=test, odd=ODD, slot=np.arange(0, 3 * vehicles, 3, dtype=np.int16),
        **series,
        target_lane=np.where(present, lane, -1).astype(np.int8), present=present,
        action=np.full((1, vehicles), -1, np.int8), critical_bv=np.full(1, -1, np.int16), log_prob_nde=np.zeros(1),
        crash=Crash(0.1 * (frames - 1), 0, 3 * (vehicles - 1)),
    )  # fmt: skip


SCENARIOS = [crash_behind(2, 5, 3), crash_behind(4, 9, 2), crash_behind(5, 2, 4)]


def tables(scenarios: list[Scenario]) -> tuple[pa.Table, pa.Table]:
    records = [case_record(scenario, trajectory_digest="00") for scenario in scenarios]
    return pa.concat_tables([r.cases for r in records]), pa.concat_tables([r.tracks for r in records])


def test_the_list_of_series_is_that_of_the_fields() -> None:
    assert Recordings._fields[-len(SERIES) :] == tuple(series.name for series in SERIES)
    assert set(BODY_FIELDS.names or ()) < set(Recordings._fields)


def test_tables_give_what_scenarios_give_and_stay_as_small_as_stored() -> None:
    stored, direct = recordings_of_tracks(*tables(SCENARIOS)), recordings_of_all(SCENARIOS)
    assert stored.case_ids == direct.case_ids == ("7:2", "7:4", "7:5")
    for name in Recordings._fields:
        one, other = getattr(stored, name), getattr(direct, name)
        assert np.array_equal(one, other.astype(one.dtype), equal_nan=name in REALS), name
        kinds = (np.float32, np.float64) if name in REALS else (other.dtype, one.dtype)
        assert (one.dtype, other.dtype) == kinds, name
    assert direct.partner.tolist() == [2, 1, 3]
    assert direct.last.tolist() == [4, 8, 1]
    assert direct.slot[direct.vehicle_at + direct.partner].tolist() == [6, 3, 9]
    assert set(direct.length) == {4.0}
    assert set(direct.width) == {1.5}


def frames_of(scenario: Scenario) -> np.ndarray:
    frames = allocate_recording(*scenario.x.shape)
    for series in SERIES:
        frames[series.name] = np.where(scenario.present, getattr(scenario, series.name), 0)
    return frames


@pytest.mark.parametrize("size", [1, 2, 3])
def test_every_case_unpacks_to_its_frames_from_any_block(size: int) -> None:
    recordings = recordings_of_all(SCENARIOS)
    lengths = np.linspace(2.0, 20.0, recordings.slot.size)
    recordings = recordings._replace(length=lengths, width=0.1 * lengths, kind=np.arange(lengths.size, dtype=np.int8))
    row = 0
    for block in recordings.blocks(size):
        for c in range(block.n_cases):
            scenario = SCENARIOS[row]
            frames, bodies = allocate_recording(12, 6), np.zeros(6, BODY_FIELDS)
            unpack(block, c, frames, bodies)
            n, vehicles = scenario.x.shape
            assert np.array_equal(frames[:n, :vehicles], frames_of(scenario))
            assert not frames["present"][n:].any()
            assert not frames["present"][:, vehicles:].any()
            first = int(recordings.vehicle_at[row])
            assert bodies["length"][:vehicles].tolist() == lengths[first : first + vehicles].tolist()
            assert bodies["kind"][:vehicles].tolist() == list(range(first, first + vehicles))
            box = box_in(Trajectories(frames, bodies, vehicles), n - 1, 1)
            assert tuple(box) == (
                scenario.x[-1, 1],
                scenario.y[-1, 1],
                0.0,
                lengths[first + 1],
                0.1 * lengths[first + 1],
            )
            row += 1
    assert row == len(SCENARIOS)


def going_on(scenario: Scenario, frames: int) -> Scenario:
    """The same, recorded on after the contact, in which the AV then is far from everybody."""
    more: dict[str, Any] = {
        series.name: np.concatenate([getattr(scenario, series.name)] + [getattr(scenario, series.name)[-1:]] * frames)
        for series in SERIES
    }
    more["x"][-frames:, 0] += 500.0
    return replace(scenario, **more)


def test_what_is_recorded_after_the_contact_counts_for_nothing() -> None:
    long = [going_on(scenario, 4) for scenario in SCENARIOS]
    cut, stored = recordings_of_all(SCENARIOS), recordings_of_tracks(*tables(long))
    assert stored.frames.tolist() == [n + 4 for n in cut.frames]
    assert recordings_of_all(long).frames.tolist() == cut.frames.tolist()
    one, other = measure_cases(cut), measure_cases(stored)
    for name, values in one.items():
        assert other[name] == pytest.approx(values, nan_ok=True, rel=1e-4, abs=1e-4), name
    faults, again = assign_fault(cut), assign_fault(stored)
    for name in Faults.__dataclass_fields__:
        assert np.array_equal(getattr(faults, name), getattr(again, name), equal_nan=name.endswith("_s")), name


def test_a_partner_that_is_not_there_once_is_none() -> None:
    cases, tracks = tables(SCENARIOS)
    place = cases.schema.get_field_index("bv_slot")
    for slots in ([8, 3, 9], [0, 3, 9]):  # nobody; the AV itself
        found = recordings_of_tracks(cases.set_column(place, "bv_slot", pa.array(slots, pa.int16())), tracks)
        assert found.partner.tolist() == [0, 1, 3]
    with pytest.raises(InputError, match=r"Test 7:2: the contact with slot 6 .* is not in the recording"):
        recordings_of(replace(SCENARIOS[0], slot=np.array([0, 3, 9], np.int16)))


def test_a_name_that_is_none_is_refused() -> None:
    cases, tracks = tables(SCENARIOS[:1])
    for table in (cases, tracks):
        assert table.column("case_id").to_pylist() == ["7:2"]
    cases, tracks = (table.set_column(0, "case_id", pa.array(["7-2"])) for table in (cases, tracks))
    with pytest.raises(InputError, match="7-2 is no name of a case"):
        recordings_of_tracks(cases, tracks)
