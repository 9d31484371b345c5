"""`suite build`: the suite is a library that `retest` takes, and does what it says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cornerforge
from cornerforge import cli
from cornerforge.errors import InputError, OutputError
from cornerforge.library import CaseLibrary
from cornerforge.results import SuiteBuilt

pytestmark = pytest.mark.full

ZOO = ("idm-mobil", "idm-mobil-d2rl", "rss-cautious", "flawed-not-left")


@pytest.fixture(scope="module")
def other_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """30 crashes of another AV."""
    path = tmp_path_factory.mktemp("other") / "others"
    cornerforge.generate(policy="swerve", av="rss-cautious", cases=30, out=path, seed=6)
    return path


@pytest.fixture(scope="module")
def built(
    swerve_library: Path, other_library: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, SuiteBuilt]:
    """A suite of both libraries."""
    out = tmp_path_factory.mktemp("suite") / "suite"
    return out, cornerforge.suite_build([swerve_library, other_library], out=out, size=40, zoo=ZOO)


def test_the_suite_finds_all_and_says_where_each_case_is_from(
    built: tuple[Path, SuiteBuilt], swerve_library: Path, other_library: Path
) -> None:
    out, said = built
    assert said.findings_in_suite == said.findings > len(ZOO)
    assert 0 < said.cases_needed <= said.cases
    low, high = said.random_cases_needed_range95
    assert said.cases_needed <= low <= said.random_cases_needed <= high
    assert said.in_order == said.clear > 0
    assert said.candidates + said.not_again + said.left_out == 90
    assert 0 < said.cases < 40
    suite = CaseLibrary.open(out)
    assert len(suite) == said.cases
    assert suite.scripted
    listed = json.loads((out / "suite.json").read_text(encoding="utf-8"))
    assert listed["zoo"] == list(ZOO)
    rows = suite.scalars(["case_id", "source", "source_case", "source_av"]).to_pylist()
    for row, one in zip(rows, listed["cases"], strict=True):
        assert (row["case_id"], row["source"], row["source_case"]) == (one["case"], one["library"], one["source_case"])
        assert row["source_av"] in one["impact_mps"], "the AV that made a case crashes in it"
        source = swerve_library if row["source"] == swerve_library.name else other_library
        before = CaseLibrary.open(source).scenario(row["source_case"]).scenario
        after = suite.scenario(row["case_id"]).scenario
        assert before.crash is not None
        assert after.crash is not None
        assert (after.crash.time, after.crash.slot_b) == (before.crash.time, before.crash.slot_b)
    assert {row["source_av"] for row in rows} == {"idm-mobil", "rss-cautious"}
    told = json.loads((out / "provenance.json").read_text(encoding="utf-8"))
    assert list(told["identity"]["sources"]) == [str(swerve_library), str(other_library)]


def test_the_shares_are_those_that_retest_finds(built: tuple[Path, SuiteBuilt]) -> None:
    out, said = built
    shares = {one.av: one.crashes_in_suite for one in said.avs}
    with pytest.raises(InputError, match=r"made by several AVs.* --baseline OLD"):
        cornerforge.retest(out, av="rl")
    again = cornerforge.retest(out, av="flawed-not-left", baseline="idm-mobil", natural_tests=0)
    assert again.recorded.av_crashes == round(shares["flawed-not-left"] * said.cases)
    assert again.recorded.baseline_crashes == round(shares["idm-mobil"] * said.cases)
    assert again.reacting is None
    listed = json.loads((out / "suite.json").read_text(encoding="utf-8"))["cases"]
    crashed = sum("idm-mobil" in one["impact_mps"] for one in listed)
    assert abs(crashed - again.recorded.baseline_crashes) <= 0.1 * said.cases, "stored again, a few end otherwise"
    with pytest.raises(InputError, match="made by several AVs"):
        cornerforge.replay(out, "all")


def test_avs_left_out_are_compared_with_random_sets(built: tuple[Path, SuiteBuilt]) -> None:
    said = built[1]
    assert {one.av for one in said.left_out_avs} <= set(ZOO)
    assert said.left_out_summary is not None
    assert said.left_out_summary.random_sets >= 100
    low, high = said.left_out_summary.random_told_apart_range95
    assert low <= said.left_out_summary.random_told_apart <= high
    assert all(one.told_apart <= one.pairs < len(ZOO) for one in said.left_out_avs)
    assert all((one.apfd is None) == (not one.found) for one in said.left_out_avs)
    assert said.left_out_summary.apfd is not None
    early = said.left_out_summary.random_apfd_range95
    assert early is not None
    assert early[0] <= said.left_out_summary.random_apfd <= early[1]  # type: ignore[operator]


def test_a_suite_of_one_av_replays_and_needs_no_baseline(
    swerve_library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["suite", "build", str(swerve_library), "--size", "5", "--out", str(tmp_path / "small"), "--json"]
    zoo = ["--zoo", "idm-mobil", "--zoo", "idm-mobil-blind"]
    assert cli.main([*words, *zoo]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["cases"] <= 5
    assert said["out"] == str(tmp_path / "small")
    assert cornerforge.replay(tmp_path / "small", "all", check=True).identical
    again = cornerforge.retest(tmp_path / "small", av="idm-mobil")
    assert again.recorded.still_crashing == again.cases == said["cases"]
    one_thread = cornerforge.suite_build(swerve_library, out=tmp_path / "one", size=5, zoo=zoo[1::2], threads=1)
    assert one_thread.cases == said["cases"]
    assert (tmp_path / "one" / "suite.json").read_bytes() == (tmp_path / "small" / "suite.json").read_bytes()
    assert cli.main([*words, *zoo]) == 2
    assert "is there already and not empty" in capsys.readouterr().err


def test_bad_input_is_named(swerve_library: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match="is named twice"):
        cornerforge.suite_build([swerve_library, swerve_library], out=out)
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in swerve_library.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    with pytest.raises(InputError, match="are the same library"):
        cornerforge.suite_build([swerve_library, copy], out=out)
    with pytest.raises(InputError, match="AV rl is named twice"):
        cornerforge.suite_build(swerve_library, out=out, zoo=["rl", "rl"])
    with pytest.raises(InputError, match="no library to choose"):
        cornerforge.suite_build([], out=out)
    library = CaseLibrary.open(swerve_library)
    CaseLibrary.create(tmp_path / "none", library.identity, library.odd)
    with pytest.raises(InputError, match="holds no cases yet"):
        cornerforge.suite_build([tmp_path / "none"], out=out)
    cornerforge.generate(policy="swerve", cases=1, out=tmp_path / "narrow", lanes=2)
    with pytest.raises(InputError, match="differ in their ODD"):
        cornerforge.suite_build([swerve_library, tmp_path / "narrow"], out=out)
    with pytest.raises(OutputError, match="not empty"):
        cornerforge.suite_build(swerve_library, out=tmp_path / "copy")
    assert not out.exists()


def test_a_zoo_that_never_crashes_makes_no_suite(swerve_library: Path, tmp_path: Path) -> None:
    single = tmp_path / "single"
    said = cornerforge.suite_build(swerve_library, out=single, size=1, zoo=ZOO)
    calm = [one.av for one in said.avs if one.crashes_in_suite == 0.0]
    assert calm, "the first case of a suite tells AVs apart"
    with pytest.raises(InputError, match="No AV crashes in any of the cases"):
        cornerforge.suite_build(single, out=tmp_path / "out", zoo=calm)
    assert not (tmp_path / "out").exists()
