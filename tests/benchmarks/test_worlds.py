"""The benchmark's worlds and sums."""

from __future__ import annotations

import pytest
import scaling
from measuring import Series
from scaling import Memory, Scaling, measure_memory
from worlds import driven_seconds, mean_bvs, with_bvs, with_length

from cornerforge.experiment.setting import experiment
from cornerforge.sim.world import VEHICLE


@pytest.mark.parametrize("bvs", [5, 20])
def test_a_world_of_a_wished_size(bvs: int) -> None:
    run, found = with_bvs(bvs)
    assert found == pytest.approx(bvs, abs=0.15 * bvs + 0.5)
    assert found == mean_bvs(run, 50)
    assert run.setting.road.traffic_length == run.odd.traffic_length
    default = experiment().odd
    assert run.odd.av_start / run.odd.traffic_length == pytest.approx(default.av_start / default.traffic_length)
    assert run.setting.road.test_length == 400.0


def test_the_same_length_is_the_same_world() -> None:
    run = experiment()
    same = with_length(run, run.odd.traffic_length)
    assert same.odd == run.odd
    assert same.slots == run.slots
    assert driven_seconds(same, 20) == driven_seconds(run, 20)


def test_core_hours_by_hand() -> None:
    # 1000 tests/s on one core: 234,212,252 / 1000 / 3600 = 65.06 core-hours; n cores that do it together take n times.
    hours = Scaling.core_hours(1000.0) / scaling.default_threads()
    assert hours == pytest.approx(65.0589588, abs=1e-6)


def test_memory_counts_vehicles_and_scratch() -> None:
    run = experiment()
    memory = measure_memory(run, 50)
    assert memory.computed > run.slots * VEHICLE.itemsize
    once = 36_000  # bytes a thread, whatever the slots: networks, and who may start into a lane (`StarterScratch`)
    assert memory.computed < run.slots * (2 * VEHICLE.itemsize + 400) + once
    assert 0.0 <= memory.measured < 4.0 * memory.computed


def test_the_text_says_core_hours() -> None:
    one = Series("x", (1.0, 2.0, 3.0))
    result = Scaling(
        {5.0: one}, {(2, 20.0): one}, {512: one}, {1: one, 2: one}, one, {"idm-mobil": one}, Memory(91, 1000, 900.0, 10)
    )
    text = scaling.render(result)
    assert f"{Scaling.core_hours(2.0):.2f}" in text
    assert "1,000 bytes" in text
