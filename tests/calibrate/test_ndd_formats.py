"""Files as their publishers describe them, the format told from the columns, and units that are not what they seem."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cornerforge.cli import main
from cornerforge.errors import DataError, InputError
from cornerforge.ext.calibrate.highd import read_recording_meta
from cornerforge.ext.calibrate.readers import Reading, guess_format, read_decisions
from cornerforge.ndd import default_model_path

FEET = 0.3048
LEAD, GAP, SPEED, LENGTH = 60.0, 25.0, 20.0, 5.0


def written(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def read_one(path: Path, data_format: str | None) -> Reading:
    (reading,) = read_decisions([path], data_format)
    return reading


def states(step: float, seconds: float = 6.0) -> list[tuple[int, int, float, float]]:
    """(vehicle, row number, time [s], front bumper [m]) of a leader 1 and a follower 2, both at 20 m/s, 25 m apart."""
    starts = {1: LEAD + LENGTH, 2: LEAD - GAP}
    count = round(seconds / step)
    return [(v, i, i * step, front + SPEED * i * step) for v, front in starts.items() for i in range(count + 1)]


NGSIM_HEADER = (
    "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,v_Class,v_Vel,"
    "v_Acc,Lane_ID,Preceding,Following,Space_Hdwy,Time_Hdwy"
)


def ngsim_rows(unit: float = FEET) -> list[str]:
    """All 18 columns; lengths in feet, time in milliseconds of the day, `Local_Y` of the front bumper's centre."""
    return [
        f"{v},{1000 + i},61,{1118846980200 + round(1000 * t)},16.5,{front / unit:.3f},6042842.1,2133117.7,"
        f"{LENGTH / unit:.2f},{2.0 / unit:.2f},2,{SPEED / unit:.2f},0.00,2,{0 if v == 1 else 1},{2 if v == 1 else 0},"
        f"{0.0 if v == 1 else (GAP + LENGTH) / unit:.2f},{0.0 if v == 1 else 1.5:.2f}"
        for v, i, t, front in states(0.1)
    ]


TGSIM_HEADER = (
    "id,time,xloc-kf,yloc-kf,lane-kf,speed-kf,acceleration-kf,length-smoothed,width-smoothed,"
    "type-most-common,av,run-index"
)


def tgsim_rows() -> list[str]:
    """Positions of the centre, metres; the road runs towards falling x."""
    return [
        f"{v},{t:.1f},{1500.0 - (front - LENGTH / 2):.4f},31.2,3,{SPEED},0.0,{LENGTH},2.0,small-vehicle,no,1"
        for v, _, t, front in states(0.1)
    ]


HIGHD_HEADER = (
    "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,backSightDistance,"
    "dhw,thw,ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,leftFollowingId,"
    "rightPrecedingId,rightAlongsideId,rightFollowingId,laneId"
)


def highd_rows(per_second: int = 25) -> list[str]:
    """`x` is the box's corner with the smallest x, `width` its extent along the road."""
    tail = "0,0,0,0,0,0,0,0,5"
    return [
        f"{i + 1},{v},{front - LENGTH:.4f},21.7,{LENGTH},1.9,{SPEED},0,0,0,300,100,{GAP},1.25,0,{SPEED},{tail}"
        for v, i, _, front in states(1.0 / per_second)
    ]


META_HEADER = (
    "id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,totalDrivenTime,"
    "numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings"
)


def meta_row(rate: str = "25", lane: float = 3.9) -> str:
    marks = ";".join(f"{8.5 + lane * i:.2f}" for i in range(4))
    return f"1,{rate},2,-1.00,9.2017,Tue,08:38,901.16,414229.06,15090.67,1047,863,184,{marks},{marks}"


PAIRS_HEADER = "period,follower,leader,t_s,v_mps,vl_mps,gap_m,split"
PAIRS = [f"400,2,1,{0.1 * i:.1f},{SPEED},{SPEED},{GAP},train" for i in range(61)]
LEADERS_HEADER = "track,t_s,y_m,v_mps,leader_track,spacing_m"
LANES_HEADER = "scenario,veh_id,lane,t_s,s_m,length_m"


def leaders_rows() -> list[str]:
    """Front bumpers; the length is not given, so the gap is the spacing less 4.9 m."""
    extra = 4.9 - LENGTH
    return [
        f"{v},{t:.1f},{front + (extra if v == 1 else 0.0):.4f},{SPEED},{',' if v == 1 else f'1,{GAP + 4.9}'}"
        for v, _, t, front in states(0.1)
    ]


def lanes_rows(scale: float = 1.0) -> list[str]:
    return [f"A,{v},2,{t:.1f},{scale * (front - 2.5):.4f},{scale * LENGTH}" for v, _, t, front in states(0.1)]


FILES: dict[str, tuple[str, str, Callable[[], list[str]]]] = {
    "pairs": ("pairs", PAIRS_HEADER, lambda: list(PAIRS)),
    "tracks with leaders": ("tracks", LEADERS_HEADER, leaders_rows),
    "tracks with lanes": ("tracks", LANES_HEADER, lanes_rows),
    "official NGSIM": ("ngsim", NGSIM_HEADER, ngsim_rows),
    "TGSIM": ("tgsim", TGSIM_HEADER, tgsim_rows),
    "highD": ("highd", HIGHD_HEADER, highd_rows),
}


@pytest.mark.parametrize("name", FILES)
def test_every_documented_form_gives_the_same_states_with_its_format_guessed(tmp_path: Path, name: str) -> None:
    data_format, header, rows = FILES[name]
    path = written(tmp_path / "01_tracks.csv", header, rows())
    assert guess_format([path]) == data_format
    reading = read_one(path, None)
    followers = reading.decisions.where(np.isfinite(reading.decisions.gap))
    assert followers.size >= 4
    np.testing.assert_allclose(followers.speed, SPEED, atol=0.02)
    np.testing.assert_allclose(followers.gap, GAP, atol=0.02)
    np.testing.assert_allclose(followers.range_rate, 0.0, atol=0.02)
    np.testing.assert_allclose(followers.acceleration, 0.0, atol=0.02)
    assert (reading.table.bad.total, reading.notes) == (0, ())


@pytest.mark.parametrize("name", FILES)
def test_damage_in_every_form_is_counted_with_its_first_line(tmp_path: Path, name: str) -> None:
    data_format, header, rows = FILES[name]
    lines = rows()
    wrong = lines[7].split(",")
    wrong[
        header.split(",").index({"tgsim": "time", "highd": "frame", "ngsim": "Global_Time"}.get(data_format, "t_s"))
    ] = "x"
    lines[7] = ",".join(wrong)
    lines[9] = lines[9] + ",1"
    lines.insert(20, lines[19])
    reading = read_one(written(tmp_path / "01_tracks.csv", header, lines), data_format)
    reasons = {reason.split(" ", 1)[1]: where for reason, where in reading.table.bad.reasons.items()}
    assert reasons == {"number of fields": (1, 11), "is not a number": (1, 9), "twice for one vehicle": (1, 22)}
    assert reading.table.rows_read == len(lines)


def test_pairs_and_tracks_together_are_refused_with_what_would_read_both(tmp_path: Path) -> None:
    both = [written(tmp_path / "p.csv", PAIRS_HEADER, PAIRS), written(tmp_path / "t.csv", LANES_HEADER, lanes_rows())]
    with pytest.raises(InputError, match=r"p\.csv looks like pairs, t\.csv looks like tracks; use --format ngsim if"):
        guess_format(both)
    assert [reading.layout.kind for reading in read_decisions(both, "ngsim")] == ["pairs", "lanes"]
    with pytest.raises(InputError, match="one format only"):
        guess_format([both[0], written(tmp_path / "h.csv", HIGHD_HEADER, highd_rows())])


def test_columns_of_two_formats_are_refused_with_both_named(tmp_path: Path) -> None:
    rows = [f"{a},{b}" for a, b in zip(PAIRS, lanes_rows(), strict=False)]
    header = PAIRS_HEADER + "," + LANES_HEADER.replace("t_s,", "")
    path = written(tmp_path / "both.csv", header, rows)
    with pytest.raises(InputError, match=r"both\.csv fit more than one format: pairs, tracks; .*--format"):
        read_decisions([path])


def test_columns_of_no_format_are_refused_with_the_nearest(tmp_path: Path) -> None:
    path = written(tmp_path / "odd.csv", "t_s,v_mps,vl_mps,gap_m,driver", ["0,1,1,5,1"])
    with pytest.raises(DataError, match=r"odd\.csv does not have the columns of any known format: missing follower"):
        guess_format([path])
    with pytest.raises(DataError, match="line 1 must name the columns"):
        guess_format([written(tmp_path / "bare.csv", "2 13 437 1118846980200 16.467", ["2 14 437 1118846980300 16.5"])])
    with pytest.raises(InputError, match="name at least one"):
        guess_format([])


def test_highd_takes_the_frame_rate_from_the_meta_file_beside_it(tmp_path: Path) -> None:
    path = written(tmp_path / "07_tracks.csv", HIGHD_HEADER, highd_rows(per_second=10))
    meta = written(tmp_path / "07_recordingMeta.csv", META_HEADER, [meta_row("10")])
    both = read_decisions([path, meta], "highd")
    assert len(both) == 1
    np.testing.assert_allclose(both[0].decisions.speed, SPEED, atol=0.02)
    meta.unlink()
    np.testing.assert_allclose(read_one(path, "highd").decisions.speed, 2.5 * SPEED, atol=0.02)
    assert read_recording_meta(path) is None


@pytest.mark.parametrize("tracks", ["07_tracks.csv", "07_tracks.csv.gz"])
@pytest.mark.parametrize("meta", ["07_recordingMeta.csv", "07_recordingMeta.csv.gz"])
def test_highd_finds_the_meta_file_packed_or_not(tracks: str, meta: str, tmp_path: Path) -> None:
    """10 Hz read as 25 Hz would make every speed 2.5 times as large, without a word."""
    plain = {
        tracks: written(tmp_path / "tracks", HIGHD_HEADER, highd_rows(per_second=10)),
        meta: written(tmp_path / "meta", META_HEADER, [meta_row("10")]),
    }
    for name, path in plain.items():
        content = path.read_bytes()
        (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    (reading,) = read_decisions([tmp_path / tracks, tmp_path / meta], "highd")
    np.testing.assert_allclose(reading.decisions.speed, SPEED, atol=0.02)


def test_a_packed_meta_file_that_is_damaged_or_there_twice_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "07_tracks.csv", HIGHD_HEADER, highd_rows())
    packed = tmp_path / "07_recordingMeta.csv.gz"
    packed.write_bytes(gzip.compress(f"{META_HEADER}\n{meta_row('10')}\n".encode())[:30])
    with pytest.raises(DataError, match=r"07_recordingMeta\.csv\.gz cannot be read"):
        read_decisions([path], "highd")
    written(tmp_path / "07_recordingMeta.csv", META_HEADER, [meta_row("10")])
    with pytest.raises(DataError, match=r"07_recordingMeta\.csv stands there twice"):
        read_decisions([path], "highd")


def test_a_meta_file_without_a_frame_rate_or_tracks_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "07_tracks.csv", HIGHD_HEADER, highd_rows())
    meta = written(tmp_path / "07_recordingMeta.csv", META_HEADER, [meta_row("fast")])
    with pytest.raises(DataError, match=r'07_recordingMeta\.csv has frameRate "fast", line 2'):
        read_decisions([path], "highd")
    with pytest.raises(DataError, match=r"07_recordingMeta\.csv holds no trajectories"):
        read_decisions([meta])


def test_lanes_too_wide_for_metres_are_noted(tmp_path: Path) -> None:
    path = written(tmp_path / "07_tracks.csv", HIGHD_HEADER, highd_rows())
    written(tmp_path / "07_recordingMeta.csv", META_HEADER, [meta_row(lane=3.9 / FEET)])
    with pytest.warns(UserWarning, match=r"lanes are 12\.8 m wide.*feet"):
        read_one(path, "highd")


def test_feet_in_a_file_of_metres_are_noted_by_length_and_speed(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", LANES_HEADER, lanes_rows(scale=1.0 / FEET))
    with pytest.warns(UserWarning, match="feet") as caught:
        reading = read_one(path, "tracks")
    notes = [str(warning.message) for warning in caught]
    assert list(reading.notes) == notes
    assert "the median of length_m is 16.4 m" in notes[0]
    assert "5 % of the speeds from s_m are above 66 m/s" in notes[1]


def test_feet_per_second_are_named_even_when_no_row_is_left(tmp_path: Path) -> None:
    fast = [f"400,2,1,{0.1 * i:.1f},{30.0 / FEET},{30.0 / FEET},{GAP / FEET},train" for i in range(61)]
    with pytest.raises(
        DataError, match=r"no usable row; first fault: v_mps outside.*61 row.*line 2.*above 98 m/s.*feet"
    ):
        read_one(written(tmp_path / "p.csv", PAIRS_HEADER, fast), "pairs")


def test_metres_in_a_file_of_feet_are_noted(tmp_path: Path) -> None:
    path = written(tmp_path / "n.csv", NGSIM_HEADER, ngsim_rows(unit=1.0))
    with pytest.warns(UserWarning, match=r"the median of v_length is 5\.0 ft.*in metres already"):
        read_one(path, "ngsim")


def test_plausible_speeds_are_not_noted(tmp_path: Path) -> None:
    fast = [f"400,2,1,{0.1 * i:.1f},59.0,59.0,{GAP},train" for i in range(61)]
    assert read_one(written(tmp_path / "p.csv", PAIRS_HEADER, fast), "pairs").notes == ()


@pytest.mark.full
def test_the_command_names_what_was_left_out_and_how_much_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "p.csv", PAIRS_HEADER, [*PAIRS, PAIRS[5]])
    assert main(["ndd", "fit", str(path), "--out", str(tmp_path / "m.npz")]) == 0
    text = capsys.readouterr().out
    assert "61 of 62 rows used" in text
    assert "Left out of p.csv: t_s twice for one vehicle, 1 row(s), first at line 63" in text
    assert "Only 6 following decisions, 194 too few (at least 200 are needed)" in text


def test_the_command_refuses_an_unclear_format_with_exit_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(
        tmp_path / "b.csv", f"{PAIRS_HEADER},scenario,veh_id,lane,s_m", [f"{row},A,1,2,5.0" for row in PAIRS]
    )
    for call in (["fit", str(path), "--out", "m.npz"], ["validate", str(default_model_path()), "--against", str(path)]):
        assert main(["ndd", *call]) == 2
        message = capsys.readouterr().err
        assert "fit more than one format: pairs, tracks; say which with --format" in message
        assert "Traceback" not in message
