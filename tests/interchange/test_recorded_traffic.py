"""All vehicles of trajectory files: the same road whatever the format, and bad input named rather than swallowed."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_files import (
    FEET,
    LANE_WIDTH,
    LANES,
    US101,
    Track,
    clips_file,
    highd_files,
    motorway,
    ngsim_file,
    straight_on,
    tgsim_file,
    written,
)

from cornerforge.errors import DataError
from cornerforge.ext.interchange.recorded_traffic import Traffic, read_traffic
from cornerforge.types import CAR, MOTORCYCLE, TRUCK

needs_us101 = pytest.mark.skipif(not US101.exists(), reason="NGSIM's clips are not at hand")


def one(path: Path, data_format: str | None = None) -> Traffic:
    (traffic,) = read_traffic([path], data_format)
    return traffic


def rows_of(traffic: Traffic, name: int) -> np.ndarray:
    return np.flatnonzero(traffic.vehicle == traffic.names.index(str(name)))


def same_as(traffic: Traffic, tracks: list[Track], *, classes: bool = True) -> None:
    """The vehicles are where they were, but for one shift along the road and the smoothing of a sharp brake."""
    first = rows_of(traffic, 1)[0]
    shift = traffic.x[first] - tracks[0].x[0]
    assert sorted(traffic.names) == sorted(str(track.name) for track in tracks)
    for track in tracks:
        rows = rows_of(traffic, track.name)
        np.testing.assert_array_equal(traffic.frame[rows], track.began + np.arange(track.x.size))
        np.testing.assert_allclose(traffic.x[rows] - shift, track.x, atol=0.13)
        np.testing.assert_allclose(traffic.y[rows], track.y, atol=0.1)
        np.testing.assert_allclose(traffic.speed[rows], np.gradient(track.x, 0.1), atol=0.7)
        if track.name != 6:
            np.testing.assert_array_equal(traffic.lane[rows], np.floor(traffic.y[rows] / traffic.lane_width))
        vehicle = traffic.names.index(str(track.name))
        assert traffic.length[vehicle] == pytest.approx(track.length, abs=1e-4)
        assert traffic.width[vehicle] == pytest.approx(track.width, abs=1e-4)
        if classes:
            assert traffic.kind[vehicle] == {"car": CAR, "truck": TRUCK, "motorcycle": MOTORCYCLE}[track.kind]


@pytest.mark.parametrize(
    "make",
    [
        lambda folder: ngsim_file(folder / "ngsim.csv", motorway()),
        lambda folder: clips_file(folder / "clips.csv", motorway()),
        lambda folder: tgsim_file(folder / "tgsim.csv", motorway()),
        lambda folder: tgsim_file(folder / "tgsim.csv", motorway(), along_y=True),
        lambda folder: highd_files(folder, [t for t in motorway() if t.kind != "motorcycle"]),
    ],
    ids=["ngsim", "clips", "tgsim", "tgsim along y", "highd"],
)
def test_every_format_gives_the_same_road(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    path = make(tmp_path)
    traffic = one(path)
    tracks = [t for t in motorway() if "highd" not in traffic.file.layout.lower() or t.kind != "motorcycle"]
    assert (traffic.lanes, traffic.file.left_out) == (LANES, {})
    assert traffic.lane_width == pytest.approx(LANE_WIDTH, abs=1e-3)
    same_as(traffic, tracks)


def test_both_directions_of_highd_drive_to_growing_x_with_the_left_on_the_left(tmp_path: Path) -> None:
    tracks = [t for t in motorway() if t.kind != "motorcycle"]
    others = [replace(t, name=t.name + 100) for t in tracks]
    there, back = read_traffic([highd_files(tmp_path, tracks, others)])
    if there.direction == "backward":
        there, back = back, there
    assert (there.direction, back.direction) == ("forward", "backward")
    same_as(there, tracks)
    for track in tracks:
        mine, theirs = rows_of(there, track.name), rows_of(back, track.name + 100)
        np.testing.assert_allclose(there.y[mine], back.y[theirs], atol=1e-3)
        np.testing.assert_allclose(np.diff(there.x[mine]), np.diff(back.x[theirs]), atol=1e-3)
        np.testing.assert_allclose(there.lateral_speed[mine], back.lateral_speed[theirs], atol=1e-3)


def test_highd_without_its_meta_files_has_the_same_road(tmp_path: Path) -> None:
    tracks = [t for t in motorway() if t.kind == "car"]
    path = highd_files(tmp_path, tracks, [replace(t, name=t.name + 100) for t in tracks])
    for name in ("01_recordingMeta.csv", "01_tracksMeta.csv"):
        (tmp_path / name).unlink()
    there, back = read_traffic([path])
    for traffic in (there, back):
        assert traffic.lanes == 2  # lane 0 has trucks and motorcycles only
        assert traffic.lane_width == pytest.approx(LANE_WIDTH, abs=0.01)
        assert (traffic.kind == CAR).all()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "names no vehicle; a row with id and class is needed for each"),
        ("id,class\n1,Car\n2,\n", "has no class, line 3"),
        ("number,class\n1,Car\n", "has no id, line 2"),
    ],
)
def test_highd_classes_that_are_none_are_refused(content: str, message: str, tmp_path: Path) -> None:
    path = highd_files(tmp_path, motorway(), [])
    (tmp_path / "01_tracksMeta.csv").write_text(content, encoding="utf-8")
    with pytest.raises(DataError, match=f"01_tracksMeta.csv {message}"):
        read_traffic([path])


def test_a_change_to_the_left_is_one(tmp_path: Path) -> None:
    traffic = one(ngsim_file(tmp_path / "a.csv", motorway()))
    rows = rows_of(traffic, 6)
    lane = traffic.lane[rows]
    (begin,) = np.flatnonzero(np.diff(lane))
    assert (lane[0], lane[-1]) == (1, 2)
    assert 20 <= begin <= 27  # it moves from 2 s on, and its centre crosses the marking at 4.5 s
    assert traffic.lateral_speed[rows].max() == pytest.approx(LANE_WIDTH * np.pi / 10, rel=0.1)
    assert traffic.heading[rows].max() == pytest.approx(LANE_WIDTH * np.pi / 10 / 24.0, rel=0.1)


def test_short_gaps_are_bridged_and_long_ones_split_a_track(tmp_path: Path) -> None:
    path = clips_file(tmp_path / "a.csv", motorway())
    lines = path.read_text().splitlines()
    of_5 = [line for line in lines if line.startswith("clip,5,")]
    gone = {*of_5[20:23], *of_5[50:60]}
    path.write_text("\n".join(line for line in lines if line not in gone) + "\n")
    traffic = one(path)
    rows = rows_of(traffic, 5)
    np.testing.assert_array_equal(traffic.frame[rows], [*range(50), *range(60, 101)])
    np.testing.assert_allclose(traffic.speed[rows], 26.0, atol=0.01)
    assert traffic.file.rows_read == len(lines) - 1 - len(gone)


def test_who_stands_never_goes_back(tmp_path: Path) -> None:
    noise = np.random.default_rng(5).normal(0.0, 0.15, 101)
    standing = straight_on(2, 1, 90.0, 0.0)
    tracks = [*motorway()[2:], replace(standing, x=standing.x + noise)]
    traffic = one(clips_file(tmp_path / "a.csv", tracks))
    rows = rows_of(traffic, 2)
    assert (np.diff(traffic.x[rows]) >= 0.0).all()
    assert (traffic.speed[rows] >= 0.0).all()
    assert np.abs(traffic.heading[rows]).max() < 0.05


def test_rows_that_cannot_be_used_are_counted_by_reason(tmp_path: Path) -> None:
    ramp = replace(straight_on(9, 0, 10.0, 15.0), y=np.full(101, -2.5))
    short = replace(straight_on(8, 2, 10.0, 15.0, seconds=0.3))
    path = clips_file(tmp_path / "a.csv", [*motorway(), short, ramp])
    path.write_text(path.read_text().replace("clip,6,2,0.0,160.0000,", "clip,6,2,0.0,far,"))
    traffic = one(path)
    assert traffic.file.left_out == {
        "s_m is not a number": (1, 507),
        "stretch shorter than 0.5 s": (4, 608),
        "beside the lanes (ramp or shoulder)": (101, 612),
    }
    assert {"8", "9"}.isdisjoint(traffic.names[v] for v in traffic.vehicle)


def test_recordings_of_one_file_stay_apart(tmp_path: Path) -> None:
    a = clips_file(tmp_path / "a.csv", motorway(), "a").read_text()
    b = clips_file(tmp_path / "b.csv", motorway()[:3], "b").read_text().partition("\n")[2]
    (tmp_path / "c.csv").write_text(a + b)
    first, second = read_traffic([tmp_path / "c.csv"])
    assert (first.recording, len(first.names), second.recording, len(second.names)) == ("a", 6, "b", 3)
    assert (first.lanes, first.lane_width) == (second.lanes, second.lane_width)


def diagonal(folder: Path) -> Path:
    tracks = [replace(t, y=t.y + 0.05 * t.x) for t in motorway()]
    lines = clips_file(folder / "a.csv", tracks).read_text().splitlines()
    straight = clips_file(folder / "b.csv", motorway()).read_text().splitlines()
    lanes = [line.split(",")[2] for line in straight]
    fields = [line.split(",") for line in lines]
    return written(
        folder / "a.csv", lines[0], [",".join([*f[:2], n, *f[3:]]) for f, n in zip(fields[1:], lanes[1:], strict=True)]
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda f: written(f / "a.csv", "a,b", ["1,2"]), "does not have the columns of any known format"),
        (lambda f: clips_file(f / "a.csv", motorway(), every=10), "1 row.s. a second"),
        (lambda f: ngsim_file(f / "a.csv", motorway(), unit=1.0), "lanes are 1.1 m apart.*in metres already"),
        (diagonal, "does not run along an axis"),
        (
            lambda f: written(f / "a.csv", "scenario,veh_id,lane,t_s,s_m,length_m", ["a,1,1,0.0,3.0,4.0"]),
            "where vehicles are across the road .column d_m.",
        ),
    ],
    ids=["other columns", "a row a second", "metres taken for feet", "a road across", "nothing across"],
)
def test_what_cannot_be_used_is_one_clear_error(tmp_path: Path, make: Callable[[Path], Path], message: str) -> None:
    path = make(tmp_path)
    with pytest.raises(DataError, match=message):
        read_traffic([path])


def test_feet_taken_for_metres_are_an_error(tmp_path: Path) -> None:
    feet = [
        replace(t, x=t.x / FEET, y=t.y / FEET, length=t.length / FEET, width=1.8) for t in motorway() if t.kind == "car"
    ]
    path = clips_file(tmp_path / "a.csv", feet)
    text = path.read_text().splitlines()
    fields = [line.split(",") for line in text[1:]]
    lane = [str(LANES - int((float(f[5]) + LANES * LANE_WIDTH) * FEET / LANE_WIDTH)) for f in fields]
    written(path, text[0], [",".join([*f[:2], n, *f[3:]]) for f, n in zip(fields, lane, strict=True)])
    with pytest.raises(DataError, match=r"lanes are 11\.8 m apart.*is the file in feet\?"):
        read_traffic([path])


def test_ten_thousand_vehicles_in_one_place_are_an_error(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    place, lane = rng.uniform(0.0, 900.0, 10_000), rng.integers(0, LANES, 10_000)
    tracks = [straight_on(k, int(lane[k]), float(place[k]), 20.0, seconds=0.5) for k in range(10_000)]
    with pytest.raises(DataError, match=r"1,\d\d\d vehicles are within 100 m at one time"):
        read_traffic([clips_file(tmp_path / "a.csv", tracks)])


def test_a_single_row_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"a\.csv has 1 row"):
        read_traffic([clips_file(tmp_path / "a.csv", [straight_on(1, 1, 0.0, 20.0, seconds=0.0)])])


@pytest.mark.full
@needs_us101
def test_us101_is_what_its_own_columns_say() -> None:
    """Speeds and lanes of the file itself, which this reader does not look at; every row that has both."""
    traffic = read_traffic([US101], "ngsim")
    assert len(traffic) == 27
    assert traffic[0].file.credit.startswith("NGSIM, US DOT FHWA")
    with gzip.open(US101, "rt", newline="") as file:
        said = {
            (row["scenario"], row["veh_id"], round(10 * float(row["t_s"]))): (float(row["speed_mps"]), int(row["lane"]))
            for row in csv.DictReader(file)
        }
    speed, lane = [], []
    for clip in traffic:
        began = round(10 * clip.began)
        for row in range(clip.x.size):
            known = said.get((clip.recording, clip.names[clip.vehicle[row]], began + int(clip.frame[row])))
            if known is not None:
                speed.append(clip.speed[row] - known[0])
                lane.append(known[1] == 0 or 6 - known[1] == int(clip.y[row] / clip.lane_width))
    assert len(speed) == 61372
    assert abs(np.median(speed)) < 0.01
    assert np.median(np.abs(speed)) < 0.2
    assert np.mean(lane) > 0.985  # of two in a hundred the file sees the change of lanes earlier or later


def test_a_file_that_is_given_twice_counts_once(tmp_path: Path) -> None:
    path = clips_file(tmp_path / "a.csv", motorway())
    copy = tmp_path / "b.csv"
    copy.write_bytes(path.read_bytes())
    once, thrice = read_traffic([path]), read_traffic([path, path, copy])
    assert len(once) == len(thrice)
    assert not once[0].file.notes
    assert [note.split(",")[0] for note in thrice[0].file.notes] == ["a.csv was given again", "b.csv was given again"]
