"""`cases from-data`: from trajectory files to case files, with the recorded driver or an AV in the seat."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_files import US101, Track, braking, clips_file, motorway, straight_on

from cornerforge.drivers.rails import HEADING, SPEED, X, Y
from cornerforge.errors import DataError, OutputError, UnknownNameError
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.ext.interchange.from_data import cases_from_data, from_data_text
from cornerforge.ext.interchange.moments import critical_moments
from cornerforge.ext.interchange.recorded_traffic import read_traffic
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import read_case_file
from cornerforge.library.out_case import script_of
from cornerforge.results import as_json, from_json
from cornerforge.results.imported import CasesFromData
from cornerforge.verbs.drive_case import drive_case

pytestmark = pytest.mark.full


def queue(*, behind: float | None = None) -> list[Track]:
    """A car comes to a queue that stands, and brakes late but in time; another may follow it closely."""
    tracks = [
        braking(1, 1, 0.0, 20.0, 5.0, 4.0, 0.0),
        straight_on(2, 1, 128.0, 0.0),
        straight_on(3, 0, -300.0, 20.0),
        straight_on(4, 2, -300.0, 20.0),
    ]
    if behind is not None:
        tracks.append(replace(tracks[0], name=5, x=tracks[0].x - behind))
    return tracks


def test_us101_drives_as_it_was_recorded() -> None:
    """Nobody crashed on US-101, so the 50 most critical moments drive through; all go where they went."""
    if not US101.exists():
        pytest.skip("NGSIM's clips are not at hand")
    cases = critical_moments(read_traffic([US101]), most=50).cases
    assert len(cases) == 50
    run = experiment(road=cases[0].odd, av=RECORDED_AV, takes_recorded=True)
    driver = run.script_driver()
    for case in cases:
        scenario, _ = driver.record(script_of(case))
        assert scenario.crash is None
        frames = len(case.poses)
        for name, column in (("x", X), ("y", Y), ("speed", SPEED), ("heading", HEADING)):
            there = np.isfinite(case.poses[..., column])
            np.testing.assert_array_equal(getattr(scenario, name)[:frames][there], case.poses[..., column][there])
            np.testing.assert_array_equal(scenario.present[:frames], there)


def test_case_files_hold_the_recorded_driver(tmp_path: Path) -> None:
    result = cases_from_data(clips_file(tmp_path / "a.csv", motorway()), out=tmp_path / "out")
    assert from_json(CasesFromData, as_json(result)) == result
    assert (result.av, result.crashes, result.libraries) == (RECORDED_AV, 0, ())
    assert [row.outcome for row in result.cases] == ["no crash"] * len(result.cases)
    (file,) = result.files
    assert (file.rows_read, file.rows_left_out, file.vehicles) == (606, 0, 6)
    case = read_case_file(result.cases[0].file)
    assert case.av_is_recorded
    assert case.happened is not None
    assert not case.happened.crashed
    assert (case.facts["source"], case.facts["others_react"]) == ("a.csv", False)
    assert not drive_case(case, av=RECORDED_AV).crashed


def test_an_av_that_brakes_late_strikes_and_one_that_brakes_early_is_struck(tmp_path: Path) -> None:
    path = clips_file(tmp_path / "a.csv", queue())
    late = cases_from_data(path, out=tmp_path / "late", av="flawed-brakes-late", cases=1)
    assert (late.crashes, late.strikers) == (1, {"av": 1, "bv": 0, "mutual": 0})
    (row,) = late.cases
    assert (row.ego, row.other, row.outcome, row.striker) == ("1", "2", "crash", "av")
    good = cases_from_data(path, out=tmp_path / "good", av="cc-human", cases=1)
    assert (good.crashes, good.libraries) == (0, ())
    followed = clips_file(tmp_path / "b.csv", queue(behind=9.0))
    struck = cases_from_data(followed, out=tmp_path / "struck", av="cc-human", cases=1)
    assert (struck.crashes, struck.strikers) == (1, {"av": 0, "bv": 1, "mutual": 0})
    library = CaseLibrary.open(Path(struck.libraries[0]))
    assert library.scalars(["case_id"])["case_id"].to_pylist() == [struck.cases[0].case_id]


def test_the_same_files_give_the_same_bytes(tmp_path: Path) -> None:
    path = clips_file(tmp_path / "a.csv", motorway())
    one, two = (cases_from_data(path, out=tmp_path / name) for name in ("one", "two"))
    assert [row.case for row in one.cases] == [row.case for row in two.cases]
    for a, b in zip(one.cases, two.cases, strict=True):
        assert Path(a.file).read_bytes() == Path(b.file).read_bytes()


def test_nothing_is_said_of_a_deceleration_that_nobody_needs(tmp_path: Path) -> None:
    """A car follows closely at the same speed."""
    tracks = [straight_on(1, 1, 0.0, 20.0), straight_on(2, 1, 12.0, 20.0), straight_on(3, 0, 200.0, 20.0)]
    path = clips_file(tmp_path / "a.csv", [*tracks, straight_on(4, 2, 200.0, 20.0)])
    result = cases_from_data([path, path], out=tmp_path / "out", measure="thw")
    assert result.cases[0].drac_mps2 < 0.05
    told = from_data_text(result)
    assert "needs" not in told
    assert "time headway 0.4 s" in told
    assert len(result.files) == 1
    assert "a.csv was given again" in told
    asked = cases_from_data(clips_file(tmp_path / "b.csv", queue()), out=tmp_path / "asked", cases=1)
    assert "needs" in from_data_text(asked)


def test_what_cannot_be_done_leaves_nothing(tmp_path: Path) -> None:
    path = clips_file(tmp_path / "a.csv", motorway())
    with pytest.raises(UnknownNameError):
        cases_from_data(path, out=tmp_path / "out", av="idm-mobile")
    with pytest.raises(UnknownNameError):
        cases_from_data(path, out=tmp_path / "out", measure="pet")
    with pytest.raises(DataError, match=r"No trajectory file .*none\.csv"):
        cases_from_data(tmp_path / "none.csv", out=tmp_path / "out")
    with pytest.raises(DataError, match="is a folder; name the files in it"):
        cases_from_data(tmp_path, out=tmp_path / "out")
    ends = [straight_on(1, 1, 0.0, 25.0), *queue()[1:]]
    with pytest.raises(DataError, match=r"No case could be made of 1 event.*less than 2 s before or 1 s after"):
        cases_from_data(
            clips_file(tmp_path / "b.csv", [replace(t, x=t.x[:50], y=t.y[:50]) for t in ends]), out=tmp_path / "out"
        )
    assert not (tmp_path / "out").exists()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="not empty"):
        cases_from_data(path, out=tmp_path / "full")
