"""Lane changes in recordings: found, counted per mile, and the gaps as they were when the change began."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cornerforge.ext.calibrate.lane_observations import LaneObservations, observe_lane_changes
from cornerforge.ndd import read_decisions

HEADER = "scenario,veh_id,lane,t_s,s_m,length_m"
METRES_PER_MILE = 1609.344


def observe(path: Path, rows: list[str], header: str = HEADER) -> LaneObservations:
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    [reading] = read_decisions([path], "tracks")
    found = observe_lane_changes(reading, fast=19.5)
    assert found is not None
    return found


def car(
    name: int, start: float, speed: float, lanes: dict[float, int], length: float = 5.0, sign: float = 1.0
) -> list[str]:
    """20 s at 10 Hz from `start`; `lanes`: from which time on it is in which lane."""
    rows = []
    for tick in range(201):
        t = tick / 10.0
        lane = [number for since, number in lanes.items() if t >= since - 1e-9][-1]
        rows.append(f"1,{name},{lane},{t:.1f},{sign * (start + speed * t):.4f},{length}")
    return rows


def scene(sign: float = 1.0) -> list[str]:
    """Vehicle 1 enters lane 2 at 10 s; at 8 s vehicle 2 is 36 m ahead (30 m of gap), 3 is 26 m behind (21 m)."""
    return [
        *car(1, 0.0, 25.0, {0.0: 1, 10.0: 2}, 5.0, sign),
        *car(2, 36.0 - 8.0 * 2.0, 27.0, {0.0: 2}, 7.0, sign),
        *car(3, -26.0 + 8.0 * 3.0, 22.0, {0.0: 2}, 5.0, sign),
        *car(4, 500.0, 25.0, {0.0: 3}, 5.0, sign),
        *car(5, -500.0, 15.0, {0.0: 3}, 5.0, sign),
    ]


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["forward", "positions fall"])
def test_a_lane_change_by_hand(tmp_path: Path, sign: float) -> None:
    found = observe(tmp_path / "t.csv", scene(sign))
    assert found.vehicles == 5
    assert found.vehicle.tolist() == [0]
    np.testing.assert_allclose(found.speed, 25.0, atol=0.01)
    np.testing.assert_allclose(found.lead_gap, 30.0, atol=0.01)
    np.testing.assert_allclose(found.lead_rate, 2.0, atol=0.01)
    np.testing.assert_allclose(found.rear_gap, 21.0, atol=0.01)
    np.testing.assert_allclose(found.rear_rate, 3.0, atol=0.01)
    np.testing.assert_allclose(found.miles * METRES_PER_MILE, [500.0, 540.0, 440.0, 500.0, 300.0], atol=0.1)
    assert found.miles_fast[4] == 0.0
    np.testing.assert_allclose(found.miles_fast[:4], found.miles[:4], rtol=1e-6)


def test_nobody_beside_and_the_end_of_what_was_recorded(tmp_path: Path) -> None:
    """Behind nobody within 120 m, and the recorded stretch goes on: inf. Ahead it ends after 100 m: not known."""
    rows = [*car(1, 400.0, 25.0, {0.0: 1, 10.0: 2}), *car(2, 0.0, 25.0, {0.0: 1}), *car(3, 500.0, 5.0, {0.0: 1})]
    found = observe(tmp_path / "t.csv", rows)
    assert np.isinf(found.rear_gap[0])
    assert found.rear_rate[0] == 0.0
    rows = car(1, 0.0, 25.0, {0.0: 1, 18.0: 2}) + car(2, -400.0, 25.0, {0.0: 1})
    assert np.isnan(observe(tmp_path / "u.csv", rows).lead_gap[0])


def highd_file(folder: Path, frames_per_second: int) -> Path:
    """Two directions of 400 m. Vehicles 1 (back) and 3 (forth) change lanes after 100 m; 2 comes behind 1 later.

    A track begins and ends at the ends of the stretch; x is of the corner with the smallest coordinate.
    """
    rows = []
    for name, first, lanes, sign in ((1, 0.0, (3, 2), -1.0), (2, 2.4, (2, 2), -1.0), (3, 0.0, (5, 6), 1.0)):
        for tick in range(16 * frames_per_second):
            t = tick / frames_per_second - first
            at = 200.0 + sign * (25.0 * t - 200.0)
            if 0.0 <= t <= 16.0:
                rows.append(f"{tick},{name},{at - 2.5:.4f},0.0,5.0,2.0,{lanes[t >= 4.0]}")
    (folder / "01_recordingMeta.csv").write_text(f"id,frameRate\n1,{frames_per_second}\n", encoding="utf-8")
    path = folder / "01_tracks.csv"
    path.write_text("\n".join(["frame,id,x,y,width,height,laneId", *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("frames_per_second", [25, 10])
def test_two_directions_and_the_files_own_frame_rate(tmp_path: Path, frames_per_second: int) -> None:
    """At 2 s both have 350 m ahead of them; behind them the stretch ends after 50 m, so nobody knows who follows."""
    [reading] = read_decisions([highd_file(tmp_path, frames_per_second)], "highd")
    found = observe_lane_changes(reading, fast=19.5)
    assert found is not None
    np.testing.assert_allclose(found.speed, [25.0, 25.0], atol=0.01)
    assert found.lead_gap.tolist() == [np.inf, np.inf]
    assert np.isnan(found.rear_gap).all()


def test_a_flicker_of_the_lane_number_and_an_unknown_lane_are_no_lane_changes(tmp_path: Path) -> None:
    flicker = car(1, 0.0, 25.0, {0.0: 1, 10.0: 2, 10.3: 1})
    assert observe(tmp_path / "t.csv", flicker).vehicle.size == 0
    unknown = car(1, 0.0, 25.0, {0.0: 1, 10.0: 0, 12.0: 1})
    assert observe(tmp_path / "u.csv", unknown).vehicle.size == 0
    there_and_back = car(1, 0.0, 25.0, {0.0: 1, 10.0: 2, 15.0: 1})
    assert observe(tmp_path / "v.csv", there_and_back).vehicle.tolist() == [0, 0]


def test_a_change_too_early_to_have_seen_its_start_counts_without_gaps(tmp_path: Path) -> None:
    found = observe(tmp_path / "t.csv", car(1, 0.0, 25.0, {0.0: 1, 1.0: 2}))
    assert found.vehicle.size == 1
    assert np.isnan([found.speed[0], found.lead_gap[0], found.rear_gap[0]]).all()


def test_rows_that_cannot_be_used_are_left_out(tmp_path: Path) -> None:
    rows = scene()
    bad = [*rows[:50], "1,1,one,5.0,125.0,5.0", "1,,1,5.0,125.0,5.0", *rows[50:], rows[-1]]
    broken, whole = observe(tmp_path / "t.csv", bad), observe(tmp_path / "u.csv", rows)
    np.testing.assert_allclose(broken.lead_gap, whole.lead_gap)
    np.testing.assert_allclose(broken.miles, whole.miles)


def test_a_file_without_lanes_tells_nothing(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    rows = [f"1,999,{t}.0,25.0,25.0,40.0" for t in range(5)]
    path.write_text("\n".join(["follower,leader,t_s,v_mps,vl_mps,gap_m", *rows]) + "\n")
    [reading] = read_decisions([path], "pairs")
    assert observe_lane_changes(reading, fast=19.5) is None
