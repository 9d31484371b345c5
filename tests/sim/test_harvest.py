"""What the kernel puts into columns is what the referee makes of a recording, value by value; whoever drove."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hand_built import WIDE, setting_of
from reference.case_record import case_columns
from reference.records import case_record

from cornerforge.drivers.policy import NetworkShape, PolicyNumbers, n_weights
from cornerforge.errors import InputError
from cornerforge.fields import POSE, REALS, SERIES, SHORTFALL
from cornerforge.library import CaseLibrary
from cornerforge.library.harvester import CaseRoom, Harvested, Harvester
from cornerforge.library.shards import encode_tables
from cornerforge.library.tables import POLICY_COLUMNS
from cornerforge.ndd.model import NddModel
from cornerforge.sim.harvest import CRASHED, DRIVEN, allocate_harvest
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.scripted import ScriptDriver
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import n_slots
from cornerforge.types import ODDS, Odd, Scenario

SUMS = {"log_prob_nde", "shortfall_nats", "possible_shortfall_nats", "excess_nats"}  # NumPy adds in another order


def random_policy() -> PolicyNumbers:
    shape = NetworkShape(N_OBSERVATION, 2, 1, 32)
    weights = np.random.default_rng(0).normal(0.0, 0.3, n_weights(shape)).astype(np.float32)
    return PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)


def run_of(model: NddModel, kind: str, odd: Odd) -> Setting:
    adversary = kind.removeprefix("bounded ")
    return setting_of(model, odd, adversary=adversary, bounded=adversary != kind, policy=random_policy())


def same(found: pa.Table, expected: Sequence[Mapping[str, object]]) -> None:
    """Every column, but for those of policies; numbers are compared by their digits, NaN equals null."""
    names = [name for name in found.column_names if name not in POLICY_COLUMNS]
    assert len(expected) == found.num_rows > 0
    assert set(names) == set(expected[0])
    for name in names:
        ours, theirs = found.column(name).to_pylist(), [row[name] for row in expected]
        if name in SUMS:
            np.testing.assert_allclose(np.array(ours, dtype=float), np.array(theirs, dtype=float), rtol=1e-12)
        elif isinstance(ours[0], list):
            for mine, its in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(np.array(mine), np.asarray(its).astype(np.array(mine).dtype), name)
        else:
            assert repr(ours) == repr(theirs), name


def referee(scenarios: Sequence[Scenario], found: tuple[pa.Table, pa.Table]) -> None:
    """Compare tables with what the referee makes of recordings."""
    expected = [case_columns(scenario) for scenario in scenarios]
    same(found[0], [case for case, _ in expected])
    same(found[1], [tracks for _, tracks in expected])


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("kind", "odd"),
    [
        ("swerve", "default"),
        ("lane-changer", "swift"),
        ("uniform", "paper"),
        ("policy", "default"),
        ("swerve", "paper"),
    ],
)
def test_columns_are_those_of_the_slow_way(kind: str, odd: str, reckless: NddModel) -> None:
    road = ODDS[odd]
    setting = run_of(reckless, kind, road)
    harvester = Harvester(setting, n_slots(road))
    harvested = harvester.harvest(3, 10, 200)
    out, _ = drive_chunk(setting, n_slots(road), 3, 10, 200, False)
    for ours, theirs in zip(harvested.outcomes, out, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(harvested.tests, 10 + np.flatnonzero(out.code == 2))
    assert harvested.tests.size >= 3
    recorder = Recorder(setting, road)
    scenarios = [recorder.record(3, test) for test in harvested.tests.tolist()]
    referee(scenarios, (harvested.cases, harvested.tracks))
    # one by one, from the recorder's buffers and from its scenarios: the very same columns
    room = CaseRoom(n_slots(road), setting.road.max_decisions)
    for test in harvested.tests.tolist():
        recorder.drive(3, test)
        recorder.keep(room.room())
    records = [case_record(scenario) for scenario in scenarios]
    slowly = pa.concat_tables([r.cases for r in records]), pa.concat_tables([r.tracks for r in records])
    for cases, tracks in (room.take(), slowly):
        assert repr(cases.to_pylist()) == repr(harvested.cases.to_pylist())
        assert repr(tracks.to_pylist()) == repr(harvested.tracks.to_pylist())
        assert cases.schema.equals(harvested.cases.schema, check_metadata=True)


def test_own_columns_and_scripts_stay_with_their_cases(reckless: NddModel) -> None:
    """More cases than the buffers hold; each keeps its values and its start, and all its vehicles are stored."""
    road = WIDE
    setting = run_of(reckless, "swerve", road)
    tests = Harvester(setting, n_slots(road)).harvest(3, 0, 60).tests.tolist()
    recorder, scripts = Recorder(setting, road), ScriptDriver(setting, road)
    room = CaseRoom(n_slots(road), 60)
    room._harvest = allocate_harvest(3, n_slots(road), 60)
    starts, scenarios = [], []
    for test in tests:
        starts.append(scripts.start_of_test(3, test))
        scenarios.append(recorder.record(3, test))
        room.add(recorder, {"weight": 0.5 * test, "name": str(test)}, start=starts[-1])
    cases, tracks = room.tables()
    assert len(room) == len(tests) > 6
    assert cases["name"].to_pylist() == [str(test) for test in tests]
    assert cases["weight"].to_pylist() == [0.5 * test for test in tests]
    expected = [case_columns(scenario, start) for scenario, start in zip(scenarios, starts, strict=True)]
    same(tracks, [row for _, row in expected])
    same(cases.drop_columns(["weight", "name"]), [row for row, _ in expected])
    room.add(recorder, {"weight": 1, "name": ""}, start=starts[-1])
    with pytest.raises(InputError, match=rf"Case 3:{tests[-1]} has the extra columns .*'weight': 1"):
        room.tables()
    with pytest.raises(InputError, match="Extra column"):
        room.add(recorder, {"two words": 1})
    room.clear()
    assert [len(table) for table in room.take()] == [0, 0]


def test_only_crashes_of_the_av_are_kept(reckless: NddModel) -> None:
    road = WIDE
    setting = run_of(reckless, "swerve", road)
    recorder, room = Recorder(setting, road), CaseRoom(n_slots(road), 60)
    out, _ = drive_chunk(setting, n_slots(road), 3, 10, 200, False)
    recorder.drive(3, test := 10 + int(np.flatnonzero(out.code != 2)[0]))
    with pytest.raises(InputError, match=f"Test 3:{test} holds no crash of the AV"):
        room.add(recorder)
    assert len(room) == 0


def test_vehicles_that_go_are_absent_in_the_columns_too(reckless: NddModel) -> None:
    road = replace(WIDE, n_lanes=3)
    setting = setting_of(reckless, road, adversary="uniform")
    harvested = Harvester(setting, n_slots(road)).harvest(1, 0, 1500)
    assert any(not all(row) for row in harvested.tracks.column("present").to_pylist())
    recorder = Recorder(setting, road)
    scenarios = [recorder.record(1, test) for test in harvested.tests.tolist()]
    referee(scenarios, (harvested.cases, harvested.tracks))


def test_recording_at_once_or_again_gives_the_same(reckless: NddModel) -> None:
    road = WIDE
    setting = run_of(reckless, "swerve", road)
    found = []
    for crashed in (0, 10**9):  # as if no test, or every one, had crashed before
        harvester = Harvester(setting, n_slots(road))
        harvester._cases.room().filled[[DRIVEN, CRASHED]] = 10**9, crashed
        found.append(harvester.harvest(3, 0, 150))
    assert_equal(*found)


def assert_equal(a: Harvested, b: Harvested) -> None:
    for ours, theirs in ((a.cases, b.cases), (a.tracks, b.tracks)):
        assert ours.schema.equals(theirs.schema)
        assert repr(ours.to_pylist()) == repr(theirs.to_pylist())  # NaN equals NaN there


@pytest.mark.full
def test_a_full_buffer_changes_nothing(reckless: NddModel) -> None:
    """More crashes than the buffers hold, in one range or in many."""
    road = WIDE
    setting = run_of(reckless, "swerve", road)
    whole = Harvester(setting, n_slots(road)).harvest(3, 0, 300)
    assert whole.tests.size > 128
    harvester = Harvester(setting, n_slots(road))
    parts = [harvester.harvest(3, first, 25) for first in range(0, 300, 25)]
    cases = pa.concat_tables([part.cases for part in parts])
    tracks = pa.concat_tables([part.tracks for part in parts])
    assert_equal(whole, replace(whole, cases=cases, tracks=tracks))


def test_shortfalls_add_up(model: NddModel) -> None:
    """Within the support nothing is implausible; a budget caps the sum, and without one it goes beyond."""
    road = ODDS["paper"]
    for budget in (12_000_001, 0):
        setting = run_of(model, "bounded swerve", road).with_drivers(budget=budget)
        cases = Harvester(setting, n_slots(road)).harvest(3, 0, 3000).cases
        shortfall = np.array(cases.column("shortfall_nats").to_pylist())
        assert len(shortfall) > 10
        assert set(cases.column("n_implausible").to_pylist()) == {0}
        assert shortfall.min() >= 0.0
        assert (shortfall.max() <= 12.0) == (budget > 0)
        assert cases.column("possible_shortfall_nats").equals(cases.column("shortfall_nats"))
    free = Harvester(run_of(model, "swerve", road), n_slots(road)).harvest(3, 0, 100).cases
    whole, possible, n, excess = (np.array(free.column(field.name).to_pylist()) for field in SHORTFALL)
    assert n.max() > 0
    np.testing.assert_array_equal(np.isposinf(whole), n > 0)  # impossible acts have no finite shortfall
    np.testing.assert_array_equal(whole[n == 0], possible[n == 0])
    assert np.isfinite(possible).all()
    np.testing.assert_array_equal(np.isposinf(excess), n > 0)


def test_natural_drivers_exceed_their_entropy_by_nothing_in_the_mean(model: NddModel) -> None:
    """Each decision adds 0, given all before it; so the sum over 400 tests is 0 within 5 of its standard errors."""
    recorder = Recorder(setting_of(model, WIDE), WIDE)
    found = [np.array(recorder.record(3, test).excess).sum() for test in range(400)]
    error = np.std(found) / math.sqrt(len(found))
    assert abs(np.mean(found)) < 5.0 * error
    assert error < 0.3
    short = [np.array(recorder.record(3, test).shortfall).sum() for test in range(100)]
    assert np.mean(short) > 5.0  # a control: behind the likeliest actions they fall


def test_packed_shards_must_continue_the_library(reckless: NddModel, tmp_path: Path) -> None:
    road = WIDE
    harvested = Harvester(run_of(reckless, "swerve", road), n_slots(road)).harvest(7, 100, 40)
    assert harvested.tests.size > 4
    library = CaseLibrary.create(tmp_path / "library", {"seed": 7}, road)
    whole = encode_tables(harvested.cases, harvested.tracks)
    back = np.arange(harvested.tests.size)[::-1]
    turned = encode_tables(harvested.cases.take(back), harvested.tracks.take(back))
    for shard, next_test in ((whole, 110), (turned, 140)):
        with pytest.raises(InputError, match="do not continue"):
            library.append_shard(shard, next_test=next_test, tests=next_test, crashes=50)
    library.append_shard(whole, next_test=140, tests=140, crashes=50)
    with pytest.raises(InputError, match="do not continue"):
        library.append_shard(whole, next_test=150, tests=150, crashes=60)
    marked = harvested.cases.append_column("mark", pa.array(np.zeros(len(harvested.cases))))
    other = encode_tables(marked, harvested.tracks)
    later = replace(other, first_test=140, last_test=145)
    with pytest.raises(InputError, match="extra columns"):
        library.append_shard(later, next_test=150, tests=150, crashes=60)
    assert len(library) == harvested.tests.size
    stored = library.scenario(f"7:{harvested.tests[2]}")
    assert stored.scenario.crash is not None


def test_the_kernels_name_the_series_that_there_are() -> None:
    """Numba cannot take them from the list (`harvest._real`, `step.record_frame`); a new one needs a line in both."""
    assert REALS == ("x", "y", "speed", "heading", "acceleration")
    assert REALS[: len(POSE)] == POSE
    assert {series.name for series in SERIES} == {*REALS, "target_lane", "present"}
