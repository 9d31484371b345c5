"""Readers: units, smoothing, leaders, held-out splits, and bad input named rather than swallowed."""

from __future__ import annotations

import gzip
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.errors import DataError, UnknownNameError
from cornerforge.ext.calibrate.layouts import LAYOUTS
from cornerforge.ext.calibrate.readers import Reading, read_decisions

PAIRS_HEADER = "period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"


def pairs_rows(n: int = 41, split: str = "train", follower: int = 1) -> list[str]:
    """A follower at 12 m/s that accelerates by 0.5 m/s2 behind a leader at 10 m/s."""
    return [f"400,{follower},2,{0.1 * i:.1f},{12 + 0.05 * i:.4f},10.0,{40 - 0.2 * i:.3f},{split}" for i in range(n)]


def written(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def read_one(path: Path, data_format: str) -> Reading:
    (reading,) = read_decisions([path], data_format)
    return reading


def test_pairs_give_one_decision_a_second_with_the_acceleration_that_follows(tmp_path: Path) -> None:
    reading = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, pairs_rows()), "pairs")
    decisions = reading.decisions
    np.testing.assert_allclose(decisions.speed, [12.0, 12.5, 13.0, 13.5])
    np.testing.assert_allclose(decisions.acceleration, 0.5)
    np.testing.assert_allclose(decisions.range_rate, [-2.0, -2.5, -3.0, -3.5])
    np.testing.assert_allclose(decisions.gap, [40.0, 38.0, 36.0, 34.0])
    assert (reading.table.rows_read, reading.rows_used, reading.table.bad.total) == (41, 41, 0)


def test_decisions_never_reach_over_a_missing_row(tmp_path: Path) -> None:
    rows = pairs_rows()
    del rows[15]
    decisions = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, rows), "pairs").decisions
    np.testing.assert_allclose(decisions.speed, [12.0, 12.8, 13.3])  # 0.0 s, then 1.6 s and 2.6 s after the break


def test_the_files_own_test_split_is_held_out(tmp_path: Path) -> None:
    rows = pairs_rows(split="train", follower=1) + pairs_rows(split="test", follower=3)
    decisions = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, rows), "pairs").decisions
    assert decisions.held_out.tolist() == [False] * 4 + [True] * 4
    assert np.unique(decisions.vehicle).size == 2


def broken(row: str, column: int, text: str) -> str:
    cells = row.split(",")
    cells[column] = text
    return ",".join(cells)


@pytest.mark.parametrize(
    ("column", "text", "reason"),
    [
        (4, "nan", "v_mps is not a number"),
        (4, "", "v_mps is not a number"),
        (4, "fast", "v_mps is not a number"),
        (5, "inf", "vl_mps is not a number"),
        (4, "-3.0", "v_mps outside 0 to 70 m/s"),
        (5, "299792458", "vl_mps outside 0 to 70 m/s"),
        (6, "0.4", "gap_m outside 1 to 500 m"),
        (6, "-2.0", "gap_m below 0 m: the vehicles overlap"),
        (6, "501", "gap_m outside 1 to 500 m"),
        (3, "1e300", "t_s outside -1e+10 to 1e+10 s"),
        (1, "", "follower is empty"),
    ],
)
def test_a_bad_row_is_named_counted_and_left_out(tmp_path: Path, column: int, text: str, reason: str) -> None:
    rows = pairs_rows()
    rows[20] = broken(rows[20], column, text)
    reading = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, rows), "pairs")
    assert reading.table.bad.reasons == {reason: (1, 22)}  # the header is line 1
    assert reading.rows_used == 40
    assert np.isfinite(reading.decisions.acceleration).all()


def test_a_row_that_stands_twice_is_kept_once(tmp_path: Path) -> None:
    rows = pairs_rows()
    rows.insert(21, rows[20])
    rows.append(rows[3])
    reading = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, rows), "pairs")
    assert reading.table.bad.reasons == {"t_s twice for one vehicle": (2, 23)}
    np.testing.assert_allclose(reading.decisions.speed, [12.0, 12.5, 13.0, 13.5])


def test_rows_that_contradict_each_other_are_both_left_out(tmp_path: Path) -> None:
    rows = pairs_rows()
    rows[20] = broken(rows[20], 3, "0.1")  # now two rows say where the vehicle is at 0.1 s
    reading = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, rows), "pairs")
    assert reading.table.bad.reasons == {"t_s twice for one vehicle, with different values": (2, 3)}
    assert reading.rows_used == 39


def test_unsorted_rows_are_sorted_and_the_file_is_named(tmp_path: Path) -> None:
    wanted = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, pairs_rows()), "pairs").decisions
    rows = pairs_rows()
    rows[10], rows[30] = rows[30], rows[10]
    with pytest.warns(UserWarning, match=r"p\.csv: 2 row\(s\) stand after a later one .*line 13\); .*sorted by t_s"):
        reading = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, rows), "pairs")
    assert reading.table.bad.total == 0
    assert len(reading.notes) == 1
    for name in ("speed", "gap", "range_rate", "acceleration"):
        np.testing.assert_array_equal(getattr(reading.decisions, name), getattr(wanted, name))


@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_rows_decides_nothing(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    rows = [*pairs_rows(follower=1), *pairs_rows(follower=3, split="test")]
    folder = tmp_path_factory.mktemp("order")
    wanted = read_one(written(folder / "a.csv", PAIRS_HEADER, rows), "pairs").decisions
    shuffled = [rows[i] for i in np.random.default_rng(seed).permutation(len(rows))]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        got = read_one(written(folder / "b.csv", PAIRS_HEADER, shuffled), "pairs").decisions
    for name in ("speed", "gap", "range_rate", "acceleration", "vehicle", "held_out"):
        np.testing.assert_array_equal(getattr(got, name), getattr(wanted, name))


def test_a_row_with_too_few_or_too_many_fields_does_not_shift_line_numbers(tmp_path: Path) -> None:
    rows = pairs_rows()
    rows[3] = "400,1,2"
    rows[7] += ",9"
    rows[20] = broken(rows[20], 4, "nan")
    reading = read_one(written(tmp_path / "p.csv", PAIRS_HEADER, rows), "pairs")
    assert reading.table.bad.reasons == {"wrong number of fields": (2, 5), "v_mps is not a number": (1, 22)}
    assert reading.table.rows_read == 41


HOV_HEADER = "track,t_s,y_m,v_mps,leader_track,spacing_m"


def hov_rows(leader: str = "7.0", noise: float = 0.0) -> list[str]:
    """Track 7 at 15 m/s ahead of track 8, which brakes from 20 m/s by 0.4 m/s2."""
    rng = np.random.default_rng(5)
    rows = [f"7,{0.1 * i:.1f},{60 + 1.5 * i:.4f},15.0,," for i in range(121)]
    for i in range(121):
        t = 0.1 * i
        y = 20.0 * t - 0.2 * t * t + noise * rng.standard_normal()
        rows.append(f"8,{t:.1f},{y:.4f},99.0,{leader},{60 + 15.0 * t - y:.4f}")
    return rows


def test_tracks_take_speed_from_smoothed_positions_and_the_gap_between_bumpers(tmp_path: Path) -> None:
    reading = read_one(written(tmp_path / "t.csv", HOV_HEADER, hov_rows()), "tracks")
    decisions = reading.decisions
    t = np.arange(12.0)
    np.testing.assert_allclose(decisions.speed, 20.0 - 0.4 * t, atol=1e-3)  # not the column's 99
    np.testing.assert_allclose(decisions.range_rate, 15.0 - (20.0 - 0.4 * t), atol=1e-3)
    np.testing.assert_allclose(decisions.gap, 60.0 - 5.0 * t + 0.2 * t * t - 4.9, atol=1e-3)
    np.testing.assert_allclose(decisions.acceleration, -0.4, atol=1e-3)


def test_smoothing_takes_out_the_noise_of_positions(tmp_path: Path) -> None:
    reading = read_one(written(tmp_path / "t.csv", HOV_HEADER, hov_rows(noise=0.1)), "tracks")
    # Raw differences of noise of 0.1 m would scatter speeds by sqrt(2) m/s, accelerations by 2 m/s2.
    middle = reading.decisions.acceleration[3:-3]
    assert np.abs(middle + 0.4).max() < 0.3


def test_a_position_that_jumps_is_named_not_smoothed_over(tmp_path: Path) -> None:
    rows = hov_rows()
    rows[180] = broken(rows[180], 2, "300.0")
    reading = read_one(written(tmp_path / "t.csv", HOV_HEADER, rows), "tracks")
    assert reading.table.bad.reasons == {"y_m jumps (faster than 70 m/s)": (1, 182)}
    np.testing.assert_allclose(reading.decisions.acceleration, -0.4, atol=1e-3)


def test_a_vehicle_that_reverses_is_named(tmp_path: Path) -> None:
    rows = [f"7,{0.1 * i:.1f},{200.0:.4f},0.0,," for i in range(61)]
    rows += [f"8,{0.1 * i:.1f},{100 - 0.5 * i:.4f},0.0,7,{100 + 0.5 * i:.4f}" for i in range(61)]
    reading = read_one(written(tmp_path / "t.csv", HOV_HEADER, rows), "tracks")
    assert reading.table.bad.reasons == {"vehicle reverses (faster than 2 m/s)": (61, 63)}
    assert reading.decisions.size == 0


def test_a_leader_that_is_not_in_the_file_gives_no_decision(tmp_path: Path) -> None:
    reading = read_one(written(tmp_path / "t.csv", HOV_HEADER, hov_rows(leader="99")), "tracks")
    assert reading.decisions.size == 0
    assert reading.table.bad.total == 0


CLIP_HEADER = "scenario,veh_id,lane,t_s,s_m,length_m"


def clip_rows(scale: float = 1.0) -> list[str]:
    """Three vehicles of one lane at 10 m/s, 5 m long, bumpers 25 m apart; one alone in each neighbouring lane."""
    starts = {1: (100.0, 2), 2: (130.0, 2), 3: (160.0, 2), 4: (60.0, 3), 5: (112.0, 1)}
    return [
        f"A,{name},{lane},{0.1 * i:.1f},{scale * (s + i):.4f},{scale * 5.0}"
        for name, (s, lane) in starts.items()
        for i in range(61)
    ]


def test_the_leader_is_the_next_vehicle_ahead_in_the_lane(tmp_path: Path) -> None:
    decisions = read_one(written(tmp_path / "c.csv", CLIP_HEADER, clip_rows()), "tracks").decisions
    following = np.isfinite(decisions.gap)
    np.testing.assert_allclose(decisions.gap[following], 25.0, atol=1e-6)
    assert np.unique(decisions.vehicle[following]).size == 2  # 1 behind 2, 2 behind 3; never 1 behind 5
    np.testing.assert_allclose(decisions.speed, 10.0, atol=1e-6)


def test_two_vehicles_in_one_place_are_named(tmp_path: Path) -> None:
    rows = clip_rows()
    # Vehicle 6 drives through vehicle 2: its box covers the other's from 128 m on (2 m behind it) for 0.5 s.
    rows += [f"A,6,2,{0.1 * i:.1f},{128.0 + i:.4f},5.0" for i in range(61)]
    reading = read_one(written(tmp_path / "c.csv", CLIP_HEADER, rows), "tracks")
    assert reading.table.bad.reasons == {"overlaps the vehicle ahead (two vehicles in one place)": (61, 307)}
    following = np.isfinite(reading.decisions.gap)
    np.testing.assert_allclose(np.unique(reading.decisions.gap[following].round(6)), [23.0, 25.0])


def test_free_flow_is_claimed_only_where_the_road_ahead_is_seen(tmp_path: Path) -> None:
    decisions = read_one(written(tmp_path / "c.csv", CLIP_HEADER, clip_rows()), "tracks").decisions
    free = ~np.isfinite(decisions.gap)
    # Vehicle 4 starts at 60 m; the farthest point seen is 220 m, so past 105 m (4.5 s) what is ahead is not known.
    assert np.unique(decisions.vehicle[free]).size == 1
    assert free.sum() == 4
    assert (decisions.range_rate[free] == 0.0).all()


def feet(rows: list[str]) -> list[str]:
    out = []
    for row in rows:
        _, vehicle, lane, t, s, length = row.split(",")
        out.append(f"{vehicle},{round(float(t) * 1000) + 1113433135300},{s},{length},{lane}")
    return out


def as_tgsim(rows: list[str]) -> list[str]:
    return [f"{v},{t},3.5,{-float(s):.4f},{lane},5.0,1" for _, v, lane, t, s, _ in (row.split(",") for row in rows)]


def as_highd(rows: list[str]) -> list[str]:
    """highD counts frames at 25 Hz and gives the corner with the smallest x; half of its lanes run backwards."""
    starts = sorted(
        {(row.split(",")[1], row.split(",")[2], row.split(",")[4]) for row in rows if row.split(",")[3] == "0.0"}
    )
    return [f"{i + 1},{v},{-(float(s) + 0.4 * i) - 2.5:.4f},5.0,{lane}" for v, lane, s in starts for i in range(151)]


@pytest.mark.parametrize(
    ("data_format", "header", "convert"),
    [
        ("ngsim", "Vehicle_ID,Global_Time,Local_Y,v_Length,Lane_ID", lambda: feet(clip_rows(scale=1.0 / 0.3048))),
        ("tgsim", "id,time,xloc-kf,yloc-kf,lane-kf,length-smoothed,run-index", lambda: as_tgsim(clip_rows())),
        ("tgsim", "ID,time,xloc_kf,yloc_kf,lane_kf,length_smoothed,run_index", lambda: as_tgsim(clip_rows())),
        ("highd", "frame,id,x,width,laneId", lambda: as_highd(clip_rows())),
    ],
)
def test_other_publishers_layouts_give_the_same_decisions(
    tmp_path: Path, data_format: str, header: str, convert: Callable[[], list[str]]
) -> None:
    wanted = read_one(written(tmp_path / "c.csv", CLIP_HEADER, clip_rows()), "tracks").decisions
    got = read_one(written(tmp_path / "other.csv", header, convert()), data_format).decisions
    assert got.size == wanted.size
    for name in ("speed", "gap", "range_rate", "acceleration"):
        np.testing.assert_allclose(np.sort(getattr(got, name)), np.sort(getattr(wanted, name)), atol=2e-3)


def test_ngsim_recognises_each_file_by_its_columns(tmp_path: Path) -> None:
    paths = [
        written(tmp_path / "p.csv", PAIRS_HEADER, pairs_rows()),
        written(tmp_path / "t.csv", HOV_HEADER, hov_rows()),
        written(tmp_path / "c.csv", CLIP_HEADER, clip_rows()),
    ]
    assert [reading.layout.kind for reading in read_decisions(paths, "ngsim")] == ["pairs", "leaders", "lanes"]


def test_wrong_columns_are_refused_with_what_was_needed_and_found(tmp_path: Path) -> None:
    path = written(tmp_path / "p.csv", "a,b,t_s", ["1,2,3"])
    with pytest.raises(DataError, match=r"p\.csv.*missing .*gap_m.*found a, b, t_s"):
        read_decisions([path], "pairs")


def test_a_column_named_twice_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "p.csv", PAIRS_HEADER + ",t_s", [row + ",0" for row in pairs_rows()])
    with pytest.raises(DataError, match="two columns named t_s"):
        read_decisions([path], "pairs")


def test_damaged_bytes_spoil_their_row_only(tmp_path: Path) -> None:
    content = "\n".join([PAIRS_HEADER, *pairs_rows()]).encode()
    lines = content.split(b"\n")
    lines[21] = lines[21].replace(b"13.0", b"13\xff0")
    (tmp_path / "p.csv").write_bytes(b"\n".join(lines))
    assert read_one(tmp_path / "p.csv", "pairs").table.bad.reasons == {"v_mps is not a number": (1, 22)}


def test_an_unknown_format_names_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="ngsim"):
        read_decisions([tmp_path / "x.csv"], "ngsin")


def test_missing_empty_and_headed_but_empty_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"No trajectory file .*none\.csv"):
        read_decisions([tmp_path / "none.csv"], "pairs")
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(DataError, match=r"empty\.csv is empty"):
        read_decisions([tmp_path / "empty.csv"], "pairs")
    with pytest.raises(DataError, match="no rows"):
        read_decisions([written(tmp_path / "head.csv", PAIRS_HEADER, [])], "pairs")
    with pytest.raises(DataError, match=r"no usable row.*v_mps is not a number \(5 row"):
        read_decisions([written(tmp_path / "b.csv", PAIRS_HEADER, [broken(r, 4, "x") for r in pairs_rows(5)])], "pairs")


def test_a_cut_off_gzip_file_is_refused_and_a_whole_one_read(tmp_path: Path) -> None:
    rows = [row for follower in range(3, 200) for row in pairs_rows(follower=follower)]
    whole = gzip.compress("\n".join([PAIRS_HEADER, *rows]).encode(), mtime=0)
    (tmp_path / "whole.csv.gz").write_bytes(whole)
    assert read_one(tmp_path / "whole.csv.gz", "pairs").table.rows_read == len(rows)
    (tmp_path / "cut.csv.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"cut\.csv\.gz is cut off after line [1-9][0-9]+;"):
        read_decisions([tmp_path / "cut.csv.gz"], "pairs")
    (tmp_path / "nothing.csv.gz").write_bytes(gzip.compress(b"", mtime=0))
    with pytest.raises(DataError, match=r"nothing\.csv\.gz is empty"):
        read_decisions([tmp_path / "nothing.csv.gz"], "pairs")
    (tmp_path / "fake.csv.gz").write_bytes(b"not gzip at all")
    with pytest.raises(DataError, match=r"fake\.csv\.gz cannot be read"):
        read_decisions([tmp_path / "fake.csv.gz"], "pairs")


def test_a_time_step_that_does_not_divide_a_second_is_refused(tmp_path: Path) -> None:
    rows = [f"400,1,2,{0.3 * i:.1f},12.0,10.0,40.0,train" for i in range(40)]
    with pytest.raises(DataError, match=r"every 0\.3 s"):
        read_decisions([written(tmp_path / "p.csv", PAIRS_HEADER, rows)], "pairs")


def test_every_layout_names_its_format() -> None:
    assert {name for layout in LAYOUTS for name in layout.formats} == {"highd", "ngsim", "pairs", "tgsim", "tracks"}
