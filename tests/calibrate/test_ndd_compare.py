"""Recorded against simulated traffic: matched by speed, refused in words where it is not fair."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cornerforge.ext.calibrate.compare import compare_decisions, compare_traffic
from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.free_running import Quantity
from cornerforge.ext.calibrate.readers import Reading
from cornerforge.ndd import read_decisions
from cornerforge.ndd.model import NddModel
from cornerforge.types import ACCELERATIONS

GRIDS = {
    "gap": ("m", 0.0, 0.5, 240),
    "time_gap": ("s", 0.0, 0.05, 240),
    "range_rate": ("m/s", -12.0, 0.1, 240),
    "acceleration_following": ("m/s2", -4.1, 0.2, 31),
    "acceleration_free": ("m/s2", -4.1, 0.2, 31),
    "inverse_ttc": ("1/s", 0.0, 1.0 / 60.0, 61),
    "accepted_lead_gap": ("m", 0.0, 1.0, 121),
    "accepted_rear_gap": ("m", 0.0, 1.0, 121),
}


def drivers(n: int, speeds: np.ndarray, seed: int) -> Decisions:
    """Decisions of n // 20 drivers: the gap grows with the speed, all else does not."""
    rng = np.random.default_rng(seed)
    speed = rng.choice(speeds, n) + rng.uniform(-0.4, 0.4, n)
    free = rng.random(n) < 0.3
    gap = np.where(free, np.inf, np.abs(2.0 * speed - 20.0 + 8.0 * rng.standard_normal(n)))
    return Decisions(
        speed=speed,
        gap=gap,
        range_rate=np.where(free, 0.0, rng.standard_normal(n)),
        acceleration=np.where(free, 0.2, 0.5) * rng.standard_normal(n),
        vehicle=np.arange(n) // 20,
        held_out=np.zeros(n, dtype=bool),
    )


def traffic_of(d: Decisions) -> dict[str, Quantity]:
    """Counts of decisions, as a simulator would have them."""
    led, alone = d.where(np.isfinite(d.gap)), d.where(~np.isfinite(d.gap))
    values = {
        "gap": (led, led.gap),
        "time_gap": (led, led.gap / led.speed),
        "range_rate": (led, led.range_rate),
        "acceleration_following": (led, led.acceleration),
        "acceleration_free": (alone, alone.acceleration),
        "inverse_ttc": (led, np.maximum(-led.range_rate, 0.0) / led.gap),
    }
    quantities = {}
    for name, (unit, low, width, bins) in GRIDS.items():
        empty = Quantity(unit, low, width, np.zeros((41, bins), dtype=np.int64))
        if name in values:
            part, numbers = values[name]
            np.add.at(empty.counts, (np.rint(part.speed).astype(int), empty.place(numbers)), 1)
        quantities[name] = empty
    return quantities


@pytest.fixture(scope="module")
def reading(tmp_path_factory: pytest.TempPathFactory) -> Reading:
    """A real reading, whose decisions tests replace."""
    path = tmp_path_factory.mktemp("r") / "r.csv"
    rows = [f"1,999,{t}.0,25.0,25.0,40.0" for t in range(5)]
    path.write_text("\n".join(["follower,leader,t_s,v_mps,vl_mps,gap_m", *rows]) + "\n")
    return read_decisions([path], "pairs")[0]


def compared(model: NddModel, reading: Reading, d: Decisions, traffic: dict[str, Quantity]) -> dict[str, Any]:
    found = compare_traffic(model, [replace(reading, decisions=d)], traffic, 0.3)
    json.dumps(found, allow_nan=False)
    assert all(list(files) == ["r.csv"] for files in found.values())
    return {quantity: files["r.csv"] for quantity, files in found.items()}


MANY = np.arange(20, 41)
STATED = ("gap", "time_gap", "range_rate", "acceleration_following", "acceleration_free")


def test_the_same_drivers_at_other_speeds_are_no_distance_away(model: NddModel, reading: Reading) -> None:
    """Recorded mostly at 22 m/s, simulated at all speeds: gaps differ by 16 m, but not at the same speeds."""
    traffic = traffic_of(drivers(400_000, MANY, 1))
    rows = compared(model, reading, drivers(6000, np.array([21, 22, 22, 23]), 2), traffic)
    for name in STATED:
        assert rows[name]["wasserstein_interval95"][0] < 0.05, name
        assert rows[name]["kolmogorov_smirnov"] < 0.05, name
        assert "caution" not in rows[name]
    pooled = {name: q._replace(counts=np.tile(q.counts.sum(axis=0), (41, 1))) for name, q in traffic.items()}
    unmatched = compared(model, reading, drivers(6000, np.array([22]), 2), pooled)
    assert unmatched["gap"]["wasserstein"] > 10.0  # negative control: without the matching


def test_a_shift_is_found_in_its_unit(model: NddModel, reading: Reading) -> None:
    traffic = traffic_of(drivers(400_000, MANY, 1))
    d = drivers(6000, MANY, 3)
    rows = compared(model, reading, replace(d, gap=d.gap + 6.0, range_rate=d.range_rate - 0.5), traffic)
    for name, shift in (("gap", 6.0), ("range_rate", 0.5)):
        low, high = rows[name]["wasserstein_interval95"]
        assert low < rows[name]["wasserstein"] == pytest.approx(shift, rel=0.1)
        assert low - 0.05 * shift < shift < high + 0.05 * shift
    assert rows["acceleration_following"]["wasserstein_interval95"][0] < 0.01


def test_ttc_shares_are_recorded_and_simulated_at_the_same_speeds(model: NddModel, reading: Reading) -> None:
    traffic = traffic_of(drivers(400_000, MANY, 1))
    rows = compared(model, reading, drivers(20_000, MANY, 4), traffic)["ttc_share_below"]["shares"]
    assert list(rows) == ["3", "5", "10", "20"]
    for row in rows.values():
        assert row["recorded_interval95"][0] <= row["recorded"] <= row["recorded_interval95"][1]
        assert row["recorded"] == pytest.approx(row["simulated"], rel=0.3, abs=1e-4)


def test_congested_data_get_a_sentence_and_no_number(model: NddModel, reading: Reading) -> None:
    traffic = traffic_of(drivers(100_000, MANY, 1))
    slow = drivers(3000, np.array([10, 12]), 5)
    rows = compared(model, reading, slow, traffic)
    for name in (*STATED, "speed", "ttc_share_below"):
        assert set(rows[name]) == {"not_compared"}
        assert "0 observation(s) of 0 vehicle(s) at 19.5 m/s" in rows[name]["not_compared"]
    mixed = compared(model, reading, drivers(6000, np.array([10, 12, 12, 22]), 5), traffic)
    assert "slower than 19.5" in mixed["speed"]["not_compared"]
    assert "wasserstein" in mixed["gap"]
    assert mixed["gap"]["caution"].startswith("Only 25%")


def test_free_running_data_are_compared_by_speed_too(model: NddModel, reading: Reading) -> None:
    traffic = traffic_of(drivers(400_000, MANY, 1))
    assert compared(model, reading, drivers(8000, MANY, 6), traffic)["speed"]["wasserstein"] < 0.3
    shifted = compared(model, reading, drivers(8000, MANY[:11], 6), traffic)["speed"]
    assert shifted["wasserstein"] == pytest.approx(5.0, abs=0.3)


def test_few_drivers_and_speeds_that_were_not_simulated_are_named(model: NddModel, reading: Reading) -> None:
    d = drivers(6000, MANY, 7)
    few = compared(model, reading, d.where(d.vehicle < 9), traffic_of(drivers(100_000, MANY, 1)))
    assert "of 9 vehicle(s)" in few["gap"]["not_compared"]
    assert (
        "holds too few states" in compared(model, reading, d, traffic_of(drivers(100, MANY, 1)))["gap"]["not_compared"]
    )
    partly = compared(model, reading, d, traffic_of(drivers(100_000, MANY[:10], 1)))["gap"]
    assert 0 < partly["speeds_not_simulated"] < 6000
    assert partly["decisions"] + partly["speeds_not_simulated"] == int(np.isfinite(d.gap[d.gap < 115.5]).sum())


def test_a_file_without_lanes_says_so(model: NddModel, reading: Reading) -> None:
    rows = compared(model, reading, drivers(6000, MANY, 7), traffic_of(drivers(100_000, MANY, 1)))
    for name in ("lane_changes_per_mile", "accepted_lead_gap", "accepted_rear_gap"):
        assert rows[name] == {"not_compared": "The file does not give each row's lane."}


def lane_file(path: Path, changes: int) -> Reading:
    """Pairs of vehicles at 25 m/s, 40 m apart; the rear one moves in front of nobody, or (`changes`) behind one."""
    rows = []
    for pair in range(60):
        for name, start, lane in ((2 * pair, 0.0, 1), (2 * pair + 1, 40.0, 2)):
            for tick in range(601):
                moved = lane if name % 2 or pair >= changes or tick < 300 else 2
                rows.append(f"{pair},{name},{moved},{tick / 10:.1f},{start + 2.5 * tick:.2f},5.0")
    path.write_text("\n".join(["scenario,veh_id,lane,t_s,s_m,length_m", *rows]) + "\n")
    return read_decisions([path], "tracks")[0]


@pytest.mark.full
def test_lane_changes_are_compared_where_lanes_are_known(model: NddModel, tmp_path: Path) -> None:
    traffic = traffic_of(drivers(100_000, MANY, 1))
    lead = traffic["accepted_lead_gap"].counts
    lead[25, 35] = 1000
    found = compare_traffic(model, [lane_file(tmp_path / "l.csv", 40)], traffic, 0.3)
    rate: Any = found["lane_changes_per_mile"]["l.csv"]
    miles = 120 * 1500.0 / 1609.344
    assert rate["recorded_miles"] == pytest.approx(miles, rel=1e-3)
    assert rate["recorded"] == pytest.approx(40 / miles, rel=1e-3)
    low, high = rate["recorded_interval95"]
    assert low < 40 / miles < high
    assert rate["simulated"] == 0.3
    gap: Any = found["accepted_lead_gap"]["l.csv"]
    assert gap["wasserstein"] == pytest.approx(0.0, abs=1e-9)  # 35 m in all of them, as simulated
    assert (gap["accepted_by_drivers"], gap["thereof_impossible_to_the_model"]) == (40, 0)
    assert (
        "not_compared"
        in compare_traffic(model, [lane_file(tmp_path / "m.csv", 5)], traffic, 0.3)["accepted_lead_gap"]["m.csv"]
    )


# One step ahead


def decided_by(model: NddModel, n: int, seed: int) -> Decisions:
    """Decisions that drivers of the model's table make, at grid points between 20 and 30 m/s."""
    rng = np.random.default_rng(seed)
    speed, gap, rate = rng.integers(20, 30, n), rng.integers(20, 90, n), rng.integers(-3, 4, n)
    rows = model.following[speed - 20, gap, rate + 10].astype(np.float64)
    drawn = (rows.cumsum(axis=1) / rows.sum(axis=1, keepdims=True) < rng.random((n, 1))).sum(axis=1)
    return Decisions(
        speed.astype(float), gap.astype(float), rate.astype(float), ACCELERATIONS[np.minimum(drawn, 30)],
        np.arange(n) // 20, np.zeros(n, dtype=bool),
    )  # fmt: skip


def test_one_step_ahead_finds_the_right_model_right_and_a_wrong_one_wrong(model: NddModel, reading: Reading) -> None:
    d = decided_by(model, 20_000, 1)
    right = compare_decisions(model, [replace(reading, decisions=d)])["r.csv"]
    assert {cell["state"] for cell in right} == {"closing", "steady", "opening"}
    assert {tuple(cell["speed_mps"]) for cell in right} == {(19.5, 22.0), (22.0, 25.0), (25.0, 30.0)}  # type: ignore[arg-type]
    wrong_model = replace(model, following=np.ascontiguousarray(model.following[..., ::-1]))
    wrong = compare_decisions(wrong_model, [replace(reading, decisions=d)])["r.csv"]
    cell: Any
    other: Any
    for cell, other in zip(right, wrong, strict=True):
        assert cell["by"] == "table"
        assert cell["wasserstein_interval95"][0] < 0.01
        assert cell["kolmogorov_smirnov"] < 0.04
        assert cell["recorded_mean_sd"] == pytest.approx(cell["predicted_mean_sd"], abs=0.05)
        assert other["kolmogorov_smirnov"] > 0.5
        assert sum(cell["recorded"]) == pytest.approx(1.0, abs=1e-3)


def test_slow_decisions_are_predicted_by_the_law_or_not_at_all(model: NddModel, reading: Reading) -> None:
    d = decided_by(model, 4000, 2)
    slow = replace(reading, decisions=replace(d, speed=d.speed - 8.0))
    assert {cell["by"] for cell in compare_decisions(model, [slow])["r.csv"]} == {"law", "table"}
    none = compare_decisions(replace(model, provenance={}), [slow])["r.csv"]
    assert {cell["by"] for cell in none} == {"table"}
