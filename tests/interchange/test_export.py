"""`export` writes the cases of a library, and what it writes is what the library holds."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import (
    FileFormatError,
    InputError,
    MissingExtraError,
    OutputError,
    UnknownCaseError,
    UnknownNameError,
)
from cornerforge.ext.interchange.case_facts import CaseFacts
from cornerforge.ext.interchange.export import is_installed
from cornerforge.ext.interchange.read_commonroad import read_commonroad
from cornerforge.ext.interchange.tables import read_table
from cornerforge.library import CaseLibrary
from cornerforge.verbs.drive_case import drive_case

pytestmark = pytest.mark.full


def ids_of(library: Path) -> list[str]:
    return list(CaseLibrary.open(library).scalars(["case_id"])["case_id"].to_pylist())


def test_many_cases_are_read_as_one_by_one(swerve_library: Path) -> None:
    library, ids = CaseLibrary.open(swerve_library), ids_of(swerve_library)
    chosen = ids[5:1:-1]
    found = list(library.scenarios(chosen))
    assert [one.scalars["case_id"] for one in found] == sorted(chosen, key=ids.index)
    for one in found:
        alone = library.scenario(one.scalars["case_id"])
        assert one.scalars == alone.scalars
        np.testing.assert_array_equal(one.scenario.x, alone.scenario.x)
        np.testing.assert_array_equal(one.history, alone.history)
    with pytest.raises(UnknownCaseError):
        next(iter(library.scenarios([ids[0], "0:123456789"])))


def metadata_of(path: Path) -> list[Any]:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return list(make_reader(file).iter_metadata())


@pytest.mark.parametrize("to", ["openscenario", "commonroad", "osi", "mcap", "csv", "parquet", "json"])
def test_each_case_becomes_a_file_with_its_facts(swerve_library: Path, tmp_path: Path, to: str) -> None:
    ids = ids_of(swerve_library)
    if to in ("osi", "mcap") and not is_installed(to):
        pytest.skip("protobuf or mcap is not installed (the extra osi)")
    done = cornerforge.export(swerve_library, "all", to=to, out=tmp_path / "out")
    assert (done.cases, done.to) == (len(ids), to)
    there = {path.name for path in (tmp_path / "out").iterdir()} - {"provenance.json"}
    assert there == set(done.files)
    of_cases = [name for name in done.files if name.startswith("case-") and not name.endswith(".facts.json")]
    assert [name.split(".")[0] for name in of_cases] == [f"case-{case.replace(':', '-')}" for case in ids]
    text = (tmp_path / "out" / (of_cases[0] if to != "csv" else f"{Path(of_cases[0]).stem}.facts.json")).read_bytes()
    if to == "osi":  # it has no place for facts
        return
    if to == "mcap":
        text = b"".join(str(one.metadata).encode() for one in metadata_of(tmp_path / "out" / of_cases[0]))
    assert str(CaseLibrary.open(swerve_library).identity["av_hash"]).encode() in text


def test_what_is_written_is_what_is_stored(swerve_library: Path, tmp_path: Path) -> None:
    case = ids_of(swerve_library)[3]
    stored = CaseLibrary.open(swerve_library).scenario(case).scenario
    for to, read in (("commonroad", read_commonroad), ("parquet", read_table)):
        (file,) = cornerforge.export(swerve_library, [case], to=to, out=tmp_path / to).files
        back = read(tmp_path / to / file)
        there = np.isfinite(stored.x)
        assert back.poses.shape[:2] == stored.x.shape
        np.testing.assert_allclose(back.poses[: len(stored.x), :, 0][there] - back.poses[0, 0, 0],
                                   stored.x[there] - stored.x[0, 0], atol=1e-3)  # fmt: skip


def test_a_commonroad_file_names_its_case(swerve_library: Path, tmp_path: Path) -> None:
    """The numbers of its benchmark id begin at 1, those of cases at 0."""
    case = ids_of(swerve_library)[0]
    (file,) = cornerforge.export(swerve_library, [case], to="commonroad", out=tmp_path / "out").files
    assert f'source="cornerforge; case: {case}; ' in (tmp_path / "out" / file).read_text(encoding="utf-8")


def test_the_av_can_be_left_to_the_user(swerve_library: Path, tmp_path: Path) -> None:
    """In CommonRoad it is a planning problem then: nobody knows what it does, and an AV can take its seat."""
    case = ids_of(swerve_library)[0]
    done = cornerforge.export(swerve_library, [case], to="commonroad", mode="controller", out=tmp_path / "out")
    back = read_commonroad(tmp_path / "out" / done.files[0])
    assert not back.av_is_recorded
    said = cornerforge.import_cases(tmp_path / "out" / done.files[0], out=tmp_path / "in", av="idm-mobil")
    assert {one.outcome for one in said.cases} <= {"crash", "no crash"}


def test_a_case_file_drives_to_the_same_contact(swerve_library: Path, tmp_path: Path) -> None:
    case = ids_of(swerve_library)[0]
    (file,) = cornerforge.export(swerve_library, [case], to="json", out=tmp_path / "out").files
    library = CaseLibrary.open(swerve_library)
    driven = drive_case(tmp_path / "out" / file, av=str(library.identity["av"]))
    assert driven.happened.frame == round(10 * library.scenario(case).scalars["crash_time_s"])


def test_the_analysis_beside_is_told(swerve_library: Path, tmp_path: Path) -> None:
    (tmp_path / "lib").symlink_to(swerve_library)
    cornerforge.analyse(
        swerve_library, out=swerve_library.parent / f"{swerve_library.name}-analysis", avoidability="none"
    )
    case = ids_of(swerve_library)[0]
    done = cornerforge.export(tmp_path / "lib", [case], to="openscenario", out=tmp_path / "out")
    tree = ElementTree.parse(tmp_path / "out" / next(name for name in done.files if name.endswith(".xosc")))
    facts = {one.get("name"): one.get("value") for one in tree.iter("Property")}
    rows = pq.read_table(swerve_library.parent / f"{swerve_library.name}-analysis" / "cases.parquet").to_pylist()
    row = next(row for row in rows if row["case_id"] == case)
    assert facts["case"] == case
    assert facts["prevented_by"] == row["prevented_by"]
    assert facts["crash_type"] == row["crash_type"]
    assert facts["licence_of_the_model"]


def test_a_damaged_analysis_is_named(swerve_library: Path, tmp_path: Path) -> None:
    shutil.copytree(swerve_library, tmp_path / "run" / "library")
    cornerforge.analyse(tmp_path / "run" / "library", out=tmp_path / "run" / "analysis", avoidability="none")
    whole = (tmp_path / "run" / "analysis" / "cases.parquet").read_bytes()
    (tmp_path / "run" / "analysis" / "cases.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileFormatError, match=r"analysis.*damaged"):
        cornerforge.export(tmp_path / "run" / "library", "all", to="csv", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_rates_of_cases_add_up_to_the_natural_rate(tmp_path: Path) -> None:
    """What cases stand for, summed, is the rate per mile that `rate` says, of the library that it leaves."""
    said = cornerforge.rate(av="flawed-brakes-late", method="mc", max_tests=2_000, out=tmp_path / "natural")
    assert said.crashes_per_mile is not None
    cases = CaseLibrary.open(tmp_path / "natural" / "library")
    facts = CaseFacts(cases)
    each = [facts.of(str(one.scalars["case_id"]), one) for one in cases.scenarios(ids_of(cases.path))]
    often = sum(float(one["crashes_per_billion_miles_it_stands_for"] or 0.0) for one in each)
    assert often == pytest.approx(1e9 * said.crashes_per_mile, rel=1e-9)


def test_bad_input(swerve_library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UnknownNameError, match='No format "carla"'):
        cornerforge.export(swerve_library, "all", to="carla", out=tmp_path / "a")
    with pytest.raises(InputError, match="csv has no mode controller"):
        cornerforge.export(swerve_library, "all", to="csv", mode="controller", out=tmp_path / "a")
    with pytest.raises(InputError, match="leave it out for commonroad"):
        cornerforge.export(swerve_library, "all", to="commonroad", version="1.0", out=tmp_path / "a")
    with pytest.raises(UnknownCaseError, match="0:99999999"):
        cornerforge.export(swerve_library, ["0:99999999"], to="csv", out=tmp_path / "a")
    with pytest.raises(InputError, match="stands for every case"):
        cornerforge.export(swerve_library, ["5:0", "all"], to="csv", out=tmp_path / "a")
    with pytest.raises(UnknownNameError, match="version"):
        cornerforge.export(swerve_library, ["5:0"], to="openscenario", version="2.0", out=tmp_path / "a")
    with pytest.raises(InputError, match="no case to export"):
        cornerforge.export(swerve_library, [], to="csv", out=tmp_path / "a")
    if not is_installed("rerun"):
        with pytest.raises(MissingExtraError, match="rerun"):
            cornerforge.export(swerve_library, "all", to="rerun", out=tmp_path / "a")
    assert not (tmp_path / "a").exists()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("kept", encoding="utf-8")
    with pytest.raises(OutputError, match=r"mine\.txt"):
        cornerforge.export(swerve_library, "all", to="csv", out=tmp_path / "full")
    wrong = ["export", str(swerve_library), "0:99999999", "--to", "csv", "--out", str(tmp_path / "b"), "--json"]
    assert main(wrong) == 2
    assert "0:99999999" in capsys.readouterr().err


def test_what_was_ended_is_gone_on_with(swerve_library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = cornerforge.export(swerve_library, "all", to="csv", out=tmp_path / "whole")
    place = tmp_path / "ended"

    def stop(stage: str, done: float, total: float) -> None:  # noqa: ARG001
        if done:
            raise KeyboardInterrupt

    monkeypatch.setattr("cornerforge.ext.interchange.export._AFTER", 2)
    with pytest.raises(KeyboardInterrupt):
        cornerforge.export(swerve_library, "all", to="csv", out=place, progress=stop)
    assert 1 < len(list(place.glob("*.csv"))) < whole.cases
    with pytest.raises(OutputError, match="--resume"):
        cornerforge.export(swerve_library, "all", to="csv", out=place)
    with pytest.raises(InputError, match="to = 'csv', not 'json'"):
        cornerforge.export(swerve_library, "all", to="json", out=place, resume=True)
    again = cornerforge.export(swerve_library, "all", to="csv", out=place, resume=True)
    assert again.files == whole.files
    for name in whole.files:
        assert (place / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_json_is_one_object(swerve_library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(swerve_library), "all", "--to", "csv", "--out", str(tmp_path / "a"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert 2 * told["cases"] == len(told["files"])
