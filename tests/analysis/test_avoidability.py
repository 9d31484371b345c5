"""Avoidability of whole libraries: the table, its witnesses, threads, and input that cannot be judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hand_built import WIDE
from reference.records import append, case_record

from cornerforge.analysis.avoidability import (
    AVOIDABILITY_SCHEMA,
    LABELS,
    AvoidParams,
    avoidability,
    avoidability_of_library,
    avoidability_table,
)
from cornerforge.errors import InputError
from cornerforge.ext.pictures.picture import avoidance_figure
from cornerforge.library import CaseLibrary
from cornerforge.report.drawing import png_of
from cornerforge.types import Crash, Scenario

FRAMES = 41


def crash_behind(test: int, *, gap: float = 30.0, braking: float = -4.0, pace: float = 30.0) -> Scenario:
    """The AV, at 30 m/s, runs into a lead at `pace` [m/s] that brakes from the first frame on; a third one is far."""
    t = 0.1 * np.arange(FRAMES)
    lead = 105.0 + gap + pace * t + 0.5 * braking * t**2
    last = int(np.argmax(lead - 100.0 - 30.0 * t < 5.0))
    assert last > 0
    n = last + 1
    shape = (n, 3)
    x = np.stack([100.0 + 30.0 * t[:n], lead[:n], 20.0 + 20.0 * t[:n]], axis=1)
    speed = np.stack([np.full(n, 30.0), pace + braking * t[:n], np.full(n, 20.0)], axis=1)
    decided = -(-last // 10)
    lanes = np.tile(np.array([1, 1, 0], dtype=np.int8), (n, 1))
    y = np.tile([6.0, 6.0, 2.0], (n, 1))
    acceleration = np.tile([0.0, braking, 0.0], (n, 1))
    return Scenario(
        seed=3, test=test, odd=WIDE, slot=np.array([0, 4, 7], dtype=np.int16), x=x, y=y, speed=speed,
        heading=np.zeros(shape), acceleration=acceleration, target_lane=lanes,
        present=np.ones(shape, dtype=np.bool_), action=np.full((decided, 3), -1, dtype=np.int8),
        critical_bv=np.ones(decided, dtype=np.int16), log_prob_nde=np.zeros(decided),
        crash=Crash(round(0.1 * last, 1), 0, 4),
    )  # fmt: skip


SCENARIOS = [crash_behind(k, gap=5.0 + 1.5 * k, braking=-8.0 if k % 2 else -4.0) for k in range(16)]


def library_of(folder: Path, scenarios: Sequence[Scenario], shard: int = 5) -> CaseLibrary:
    library = CaseLibrary.create(folder, {"seed": 3}, WIDE)
    for k in range(0, len(scenarios), shard):
        part = [case_record(scenario, trajectory_digest="00") for scenario in scenarios[k : k + shard]]
        done = k + len(part)
        append(library, part, next_test=done, tests=done, crashes=done)
    library.finish()
    return library


def test_one_row_a_case_as_for_the_recording_itself(tmp_path: Path) -> None:
    library = library_of(tmp_path / "lib", SCENARIOS)
    table = avoidability_of_library(library.shards(), library.odd)
    assert table.schema.equals(AVOIDABILITY_SCHEMA)
    assert table.column("case_id").to_pylist() == [f"3:{k}" for k in range(len(SCENARIOS))]
    for row, scenario in zip(table.to_pylist(), SCENARIOS, strict=True):
        answer = avoidability(scenario)
        assert row["avoidability"] == answer.label
        assert row["avoidability_problem"] is None
        assert (row["latest_braking_s"], row["latest_steering_s"]) == (answer.braking_s, answer.steering_s)
        assert (row["latest_any_s"], row["time_to_react_s"]) == (answer.latest_s, answer.time_to_react_s)
        assert answer.witness is not None
        np.testing.assert_allclose(row["witness_x_m"], answer.witness.x, rtol=1e-5)
        np.testing.assert_allclose(row["witness_y_m"], answer.witness.y, atol=1e-3)
        assert row["witness_lane"] == answer.witness.lane.tolist()
        assert len(row["witness_x_m"]) == 5 * len(row["witness_acceleration_mps2"]) + 1
    assert set(table.column("avoidability").to_pylist()) <= set(LABELS)


def test_threads_and_shards_change_nothing_and_parquet_keeps_all(tmp_path: Path) -> None:
    few, many = library_of(tmp_path / "a", SCENARIOS, 3), library_of(tmp_path / "b", SCENARIOS, 16)
    one = avoidability_of_library(few.shards(), WIDE, threads=1).combine_chunks()
    two = avoidability_of_library(many.shards(), WIDE, threads=2).combine_chunks()
    assert one.equals(two)
    pq.write_table(one, tmp_path / "avoidability.parquet")
    again = pq.read_table(tmp_path / "avoidability.parquet")
    assert again.equals(one)
    assert again.schema.field("latest_any_s").metadata[b"unit"] == b"s"


def test_a_delay_takes_ways_out_away_and_changes_no_moment() -> None:
    for scenario in SCENARIOS[:6]:
        at_once = avoidability(scenario)
        late = avoidability(scenario, AvoidParams(delay_s=5.0))
        assert late.label == "unavoidable"
        assert late.latest_s == at_once.latest_s
        assert at_once.label != "unavoidable"


def test_cases_that_cannot_be_judged_say_why_and_leave_the_others_alone(tmp_path: Path) -> None:
    library = library_of(tmp_path / "lib", SCENARIOS[:6], 6)
    cases, tracks = next(iter(library.shards()))
    good = avoidability_table(cases, tracks, WIDE)

    def spoiled(table: pa.Table, name: str, row: int, change: object) -> pa.Table:
        values = table.column(name).to_pylist()
        values[row] = change(values[row]) if callable(change) else change
        k = table.schema.get_field_index(name)
        return table.set_column(k, table.schema.field(name), pa.array(values, type=table.schema.field(name).type))

    cases = spoiled(cases, "bv_slot", 0, 99)
    cases = spoiled(cases, "crash_time_s", 1, 77.0)
    tracks = spoiled(tracks, "x_m", 2, lambda x: [float("nan"), *x[1:]])
    tracks = spoiled(tracks, "present", 3, lambda there: [False, *there[1:]])
    tracks = spoiled(tracks, "speed_mps", 4, lambda speed: [400.0, *speed[1:]])
    table = avoidability_table(cases, tracks, WIDE, threads=2)
    parts = ("slot 99", "its contact at 77.0 s", "not finite", "the AV is absent at 0.0 s", "outside [0, 40.0]")
    for row, part in zip(table.to_pylist(), parts, strict=False):
        assert part in row["avoidability_problem"]
        assert all(value is None for name, value in row.items() if name not in ("case_id", "avoidability_problem"))
    assert table.slice(5).equals(good.slice(5))


def test_tables_that_do_not_belong_together_and_empty_ones(tmp_path: Path) -> None:
    cases, tracks = next(iter(library_of(tmp_path / "lib", SCENARIOS[:4], 4).shards()))
    with pytest.raises(InputError, match="not of the same cases"):
        avoidability_table(cases, tracks.slice(1), WIDE)
    with pytest.raises(InputError, match="threads"):
        avoidability_table(cases, tracks, WIDE, threads=0)
    assert avoidability_table(cases.slice(0, 0), tracks.slice(0, 0), WIDE).schema.equals(AVOIDABILITY_SCHEMA)
    assert len(avoidability_of_library(CaseLibrary.create(tmp_path / "new", {"seed": 3}, WIDE).shards(), WIDE)) == 0


def test_recordings_that_hold_no_crash_of_the_av_are_refused() -> None:
    scenario = SCENARIOS[0]
    wrong = {
        "holds no crash of the AV": replace(scenario, crash=None),
        "is not in the recording of": replace(scenario, crash=Crash(60.0, 0, 4)),
        "slot 5": replace(scenario, crash=Crash(scenario.crash.time if scenario.crash else 0.0, 0, 5)),
        "not finite": replace(scenario, y=np.full_like(scenario.y, np.nan)),
    }
    for message, bad in wrong.items():
        with pytest.raises(InputError, match=message):
            avoidability(bad)


def test_a_crash_in_the_first_moments_has_no_way_out() -> None:
    """Contact 0.1 s after the begin, and at the begin itself: nothing to decide before."""
    start = crash_behind(0, gap=0.5, braking=-1.0, pace=20.0)
    assert len(start.x) == 2
    answer = avoidability(start)
    assert (answer.label, answer.witness) == ("unavoidable", None)
    names = ("x", "y", "speed", "heading", "acceleration", "target_lane", "present")
    at_once = replace(start, crash=Crash(0.0, 0, 4), **{name: getattr(start, name)[-1:] for name in names})
    assert avoidability(at_once).label == "unavoidable"


@pytest.mark.parametrize(
    "wrong",
    [
        {"decision_s": 0.25},
        {"decision_s": 1.0},
        {"delay_s": -1.0},
        {"accelerations_mps2": (-8.0, 2.0)},
        {"accelerations_mps2": (0.0, 2.0)},
        {"accelerations_mps2": (-8.0, 0.0, 0.0)},
        {"accelerations_mps2": ()},
        {"lane_changes": 5},
        {"horizon_s": float("nan")},
        {"lookback_s": 0.0},
        {"others": "nobody"},
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        AvoidParams(**wrong)  # type: ignore[arg-type]


def test_finer_decisions_find_what_coarse_ones_find() -> None:
    """Decisions every 0.1 s hold every plan of 0.5 s, so they lose nothing; short, because there are many more."""
    coarse = AvoidParams(horizon_s=0.5, lookback_s=0.6, lane_changes=1)
    for scenario in SCENARIOS[:4]:
        slow, fast = avoidability(scenario, coarse), avoidability(scenario, replace(coarse, decision_s=0.1))
        assert slow.latest_s is None or (fast.latest_s is not None and fast.latest_s <= slow.latest_s)


@pytest.mark.full
def test_the_figure_is_the_same_bytes_twice_and_needs_no_witness() -> None:
    scenario = SCENARIOS[2]
    answer = avoidability(scenario)
    first, second = (png_of(avoidance_figure(scenario, answer)) for _ in range(2))
    assert first == second
    without = replace(answer, witness=None, latest_s=None, time_to_react_s=None)
    assert png_of(avoidance_figure(scenario, without)) != first
    with pytest.raises(InputError, match="nothing to draw"):
        avoidance_figure(replace(scenario, crash=None), answer)
