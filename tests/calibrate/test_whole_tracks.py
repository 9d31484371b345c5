"""Tracks of one vehicle each: names that are used again, ramps, lane numbers of both directions."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from cornerforge.ext.calibrate.lane_observations import lane_tracks
from cornerforge.ext.calibrate.readers import Reading, read_decisions
from cornerforge.ext.interchange.recorded_traffic import read_traffic

HEADER = "scenario,veh_id,lane,t_s,s_m,d_m,length_m,width_m"


def rows(
    name: str, lane: int, at: float, from_m: float, speed: float, seconds: float, length: float = 5.0
) -> list[str]:
    """A vehicle that keeps its lane and speed; lane 1 is the leftmost, as in NGSIM."""
    return [
        f"A,{name},{lane},{at + 0.1 * i:.1f},{from_m + speed * 0.1 * i:.3f},{-3.66 * lane:.2f},{length},2.0"
        for i in range(round(10 * seconds) + 1)
    ]


def period(names: str, at: float, speed: float = 20.0) -> list[str]:
    """Traffic in three lanes, and a vehicle that comes by a ramp, lane 4, with few rows there."""
    a, b, c, d = list(names)
    on_ramp = rows(d, 4, at, 10.0, speed, 2.5)
    after = rows(d, 3, at + 2.6, 10.0 + 2.6 * speed, speed, 7.0)
    return [
        *rows(a, 1, at, 60.0, speed, 12.0), *rows(b, 2, at, 20.0, speed, 12.0), *rows(c, 3, at, 80.0, speed, 12.0),
        *on_ramp, *after,
    ]  # fmt: skip


def read(folder: Path, lines: list[str], *, name: str = "t.csv") -> Reading:
    path = folder / name
    path.write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (reading,) = read_decisions([path])
    return reading


def assert_same_decisions(one: Reading, other: Reading) -> None:
    def states(reading: Reading) -> np.ndarray:
        found = reading.decisions
        states = np.stack([found.speed, found.gap, found.range_rate, found.acceleration, *found.before.T], axis=1)
        return states[np.lexsort(np.nan_to_num(states, posinf=1e6).T)]

    np.testing.assert_allclose(states(one), states(other), atol=1e-9)
    assert np.unique(one.decisions.vehicle).size == np.unique(other.decisions.vehicle).size


@pytest.mark.parametrize("later", [13.0, 900.0])
def test_names_used_again_give_what_names_of_their_own_give(tmp_path: Path, later: float) -> None:
    own = read(tmp_path, period("abcd", 0.0) + period("efgh", later), name="own.csv")
    again = read(tmp_path, period("abcd", 0.0) + period("badc", later), name="again.csv")
    assert_same_decisions(again, own)
    assert (again.vehicles, own.notes) == (8, ())
    (note,) = again.notes
    assert "again.csv: tracks were cut at 4 place(s) (first at line" in note
    assert again.table.bad.total == 0
    assert lane_tracks(again).forward.all()


def test_a_leap_aside_is_no_lane_change(tmp_path: Path) -> None:
    """A name goes on in the next lane but one, at the same speed: another vehicle, or a row that is astray."""
    traffic = [line for lane in (1, 2, 3) for line in rows(f"v{lane}", lane, 0.0, 10.0 * lane, 20.0, 12.0)]
    leaps = read(tmp_path, traffic + rows("x", 1, 0.0, 90.0, 20.0, 5.0) + rows("x", 3, 5.1, 192.0, 20.0, 5.0))
    (one,) = read_traffic([leaps.path])
    assert any("tracks were cut at 1 place(s)" in note for note in one.file.notes)
    assert one.names.count("x") == 2
    assert np.abs(one.lateral_speed).max() < 0.01
    passing = rows("x", 1, 0.0, 90.0, 20.0, 5.0)
    passing[20:21] = rows("x", 3, 2.0, 130.0, 20.0, 0.0)
    (one,) = read_traffic([read(tmp_path, traffic + passing).path])
    assert one.names.count("x") == 1
    assert one.file.left_out == {"s_m jumps (faster than 70 m/s)": (1, 385)}


def test_a_ramp_stays_where_it_is_when_names_are_used_again(tmp_path: Path) -> None:
    once = read(tmp_path, period("abcd", 0.0), name="once.csv").path
    again = read(tmp_path, period("abcd", 0.0) + period("badc", 900.0), name="again.csv").path
    (one,), (two,) = read_traffic([once]), read_traffic([again])
    assert (one.lanes, two.lanes, one.lane_width, two.lane_width) == (4, 4, pytest.approx(3.66), pytest.approx(3.66))
    assert len(two.names) == 2 * len(one.names) == 8
    assert sorted(set(two.lane.tolist())) == sorted(set(one.lane.tolist())) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    "second",
    [
        pytest.param(rows("x", 2, 2.5, 30.0, 20.0, 4.0, length=9.0), id="another length"),
        pytest.param(rows("x", 2, 2.5, 400.0, 20.0, 4.0), id="farther than a vehicle drives"),
        pytest.param(rows("x", 2, 5.0, 20.0, 20.0, 4.0), id="back where it came from"),
        pytest.param(rows("x", 2, 8.0, 30.0, 20.0, 4.0), id="much later"),
    ],
)
def test_a_track_is_cut_where_it_goes_on_as_another_vehicle(tmp_path: Path, second: list[str]) -> None:
    reading = read(tmp_path, rows("x", 2, 0.0, 0.0, 20.0, 2.4) + second + rows("y", 2, 0.0, 300.0, 20.0, 15.0))
    assert reading.vehicles == 3
    assert "cut at 1 place(s) (first at line 27)" in reading.notes[0]


def test_a_single_row_astray_is_left_out_and_cuts_nothing(tmp_path: Path) -> None:
    lines = rows("x", 2, 0.0, 0.0, 20.0, 6.0) + rows("y", 2, 0.0, 100.0, 20.0, 6.0)
    lines[30] = lines[30].replace(",60.000,", ",600.000,")
    reading = read(tmp_path, lines)
    assert (reading.vehicles, reading.notes) == (2, ())
    assert reading.table.bad.reasons == {"s_m jumps (faster than 70 m/s)": (1, 32)}


def test_lane_numbers_that_serve_both_directions_are_two_lanes_each(tmp_path: Path) -> None:
    there = [*rows("a", 1, 0.0, 0.0, 20.0, 10.0), *rows("b", 1, 0.0, 50.0, 20.0, 10.0)]
    back = [*rows("c", 1, 0.0, 410.0, -20.0, 10.0), *rows("d", 1, 0.0, 450.0, -20.0, 10.0)]
    both = read(tmp_path, there + back)
    gaps = both.decisions.gap
    np.testing.assert_allclose(np.unique(gaps[np.isfinite(gaps)].round(6)), [35.0, 45.0])
    assert both.table.bad.total == 0


def test_one_vehicle_that_reverses_turns_no_lane_around(tmp_path: Path) -> None:
    lines = [line for n in range(9) for line in rows(f"v{n}", 2, 0.0, 60.0 * n, 20.0, 6.0)]
    reading = read(tmp_path, lines + rows("r", 2, 0.0, 700.0, -4.0, 6.0))
    assert reading.table.bad.reasons["vehicle reverses (faster than 2 m/s)"][0] == 61
