"""Every part of a fitted model says where it comes from; scarce and odd files are told, not guessed about."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.cli import main
from cornerforge.errors import DataError
from cornerforge.ext.calibrate.decisions import Decisions
from cornerforge.ext.calibrate.lane_fit import not_fitted
from cornerforge.ext.calibrate.parts import FITTED, IN_PART, PRIOR, parts_of
from cornerforge.ext.calibrate.traits import NoiseSpread
from cornerforge.ndd import fit_model
from cornerforge.ndd.initial import InitialState
from cornerforge.results.naturalistic import BadRows

NAMES = [
    "car-following law", "response near the leader", "following table", "free driving", "memory", "noise level",
    "desired speeds", "lane changes", "gap acceptance", "turning back", "duration of lane changes",
    "traffic at the start", "indicators", "looking away, overlooking",
]  # fmt: skip


def decisions(speeds: list[float], gaps: list[float]) -> Decisions:
    n = len(speeds)
    speed, gap, zero = np.array(speeds), np.array(gaps), np.zeros(n)
    return Decisions(speed, gap, zero, zero, np.arange(n), np.zeros(n, dtype=bool))


def test_each_part_has_a_source_and_a_reason() -> None:
    changes = replace(not_fitted(""), fitted=True, changes=50, seconds=4000)
    training = decisions([25.0, 27.0, 15.0], [25.0, np.inf, 10.0])
    noise = NoiseSpread(0.2, fitted=True, drivers=40, interval95=(0.0, 0.5))
    found = parts_of(
        training, too_few="", fast=0, counted=1, counted_free=1, strength=200.0, changes=changes, noise=noise
    )
    assert [part.name for part in found] == NAMES
    assert [part.source for part in found if part.source != PRIOR] == [
        FITTED, IN_PART, IN_PART, FITTED, IN_PART, IN_PART,
    ]  # fmt: skip
    why = {part.name: part.why for part in found}
    assert all(text.endswith(".") for text in why.values())
    assert why["car-following law"].startswith("Maximum likelihood over 2 decisions of 2 drivers")
    assert "40 drivers were seen behind a leader for 30 s and more" in why["noise level"]
    assert "a factor of 1.22 (1.00 to 1.65) of the odds" in why["noise level"]
    assert "50 changes in 4,000 seconds at risk" in why["gap acceptance"]
    assert (
        "mean speed 26.0 m/s (start 30.1 m/s), standard deviation 1.0 m/s (start 3.4 m/s), median time gap 1.00 s"
        in (why["traffic at the start"])
    )


def test_with_nothing_to_fit_all_is_prior_and_says_why() -> None:
    slow = decisions([12.0], [np.inf])
    found = parts_of(
        slow, too_few="Only 0.", fast=0, counted=0, counted_free=0, strength=200.0,
        changes=not_fitted("that is so"),
        noise=NoiseSpread(0.2, fitted=False, drivers=3, interval95=(np.nan, np.nan)),
    )  # fmt: skip
    assert {part.source for part in found} == {PRIOR}
    why = {part.name: part.why for part in found}
    assert why["car-following law"] == "Only 0."
    assert why["noise level"] == "3 drivers were seen behind a leader for 30 s and more, and at least 30 are needed."
    assert why["lane changes"] == why["gap acceptance"] == "That is so."
    assert why["free driving"] == "No decision from 19.5 m/s on; all of it is published facts (IVBSS)."
    assert "no decision from 19.5 m/s on" in why["traffic at the start"]


def lanes_file(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join(["veh_id,lane,t_s,s_m,length_m", *rows]) + "\n", encoding="utf-8")
    return path


def one_vehicle(seconds: int, name: int = 1) -> list[str]:
    return [f"{name},1,{tick / 10:.1f},{2.5 * tick:.1f},4.5" for tick in range(10 * seconds)]


@pytest.mark.full
def test_one_vehicle_gives_free_driving_and_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = lanes_file(tmp_path / "one.csv", one_vehicle(60))
    assert main(["ndd", "fit", str(path), "--format", "tracks", "--out", str(tmp_path / "m.npz")]) == 0
    text = capsys.readouterr().out
    assert "Only 0 following decisions, 200 too few" in text
    assert "nobody was seen for long enough with a lane beside its own" in text.lower()
    assert "free driving" in text
    for name in NAMES:
        assert sum(line.startswith(name) for line in text.splitlines()) == 1, name


def test_one_vehicle_on_a_short_road_is_refused_with_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = lanes_file(tmp_path / "one.csv", one_vehicle(4))
    assert main(["ndd", "fit", str(path), "--format", "tracks", "--out", str(tmp_path / "m.npz")]) == 2
    said = capsys.readouterr().err
    assert "its leader's rows in the same file" in said
    assert "of 1 vehicle(s)" in said
    assert "Traceback" not in said


def test_rows_whose_lane_is_not_known_are_refused_with_what_is_missing(tmp_path: Path) -> None:
    rows = [row.replace(f"{name},1,", f"{name},0,", 1) for name in (1, 2) for row in one_vehicle(60, name)]
    with (
        pytest.raises(DataError, match=r"make no decision.*in a lane that is known \(0 is not\)"),
        pytest.warns(UserWarning, match="number lanes from 1"),
    ):
        fit_model([lanes_file(tmp_path / "unknown.csv", rows)], "tracks")


@pytest.mark.full
def test_few_drivers_are_said_to_be_few(tmp_path: Path) -> None:
    rows = [f"1,999,{t}.0,{25 + 0.3 * np.sin(t):.3f},25.0,{40 + np.cos(t):.3f}" for t in range(300)]
    path = tmp_path / "pairs.csv"
    path.write_text("\n".join(["follower,leader,t_s,v_mps,vl_mps,gap_m", *rows]) + "\n", encoding="utf-8")
    _, report = fit_model([path], "pairs")
    assert report.parts[0].source == FITTED
    assert report.parts[0].why.endswith("of 1 drivers, at all speeds. 1 are too few to stand for all.")


def test_rows_of_one_a_second_are_read(tmp_path: Path) -> None:
    """The window of highD is 1.1 s: three rows at the least."""
    rows = [f"{t},{v},{x + 25.0 * t},{4 * v},4.5,2.0,{v}" for v, x in ((1, 0.0), (2, 60.0)) for t in range(30)]
    path = tmp_path / "01_tracks.csv"
    path.write_text("\n".join(["frame,id,x,y,width,height,laneId", *rows]) + "\n", encoding="utf-8")
    (tmp_path / "01_recordingMeta.csv").write_text("id,frameRate\n1,1\n", encoding="utf-8")
    model, report = fit_model([path], "highd")
    assert report.rows_used == 60
    assert report.decisions_fitted > 40
    assert model.initial == InitialState()


def test_vehicles_out_of_all_lengths_are_counted_with_their_line(tmp_path: Path) -> None:
    rows = one_vehicle(60) + [row.replace(",4.5", ",60") for row in one_vehicle(59, 2)]
    path = lanes_file(tmp_path / "long.csv", rows)
    _, report = fit_model([path], "tracks")
    assert report.bad_rows["long.csv"] == {"length_m outside 1 to 40 m": BadRows(rows=590, first_line=602)}
    only = lanes_file(tmp_path / "only.csv", rows[600:])
    with pytest.raises(DataError, match=r"length_m outside 1 to 40 m .590 row.s., first at line 2.* in feet"):
        fit_model([only], "tracks")
