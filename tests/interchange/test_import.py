"""`import` takes in what `export` wrote and what others wrote, and says what became of each file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from old_tables import with_comments

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import DataError, InputError, OutputError, UnknownNameError
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import read_case_file
from cornerforge.results.imported import ImportedCases

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def there_and_back(swerve_library: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], ImportedCases]:
    """Some cases written as OSI traces and CommonRoad, and read in again; read only."""
    place = tmp_path_factory.mktemp("exchange")
    ids = CaseLibrary.open(swerve_library).scalars(["case_id"])["case_id"].to_pylist()[:4]
    for to in ("osi", "commonroad"):
        cornerforge.export(swerve_library, ids, to=to, out=place / to)
    files = [*sorted((place / "osi").glob("*.osi")), *sorted((place / "commonroad").glob("*.xml"))]
    return ids, cornerforge.import_cases(files, out=place / "in")


def test_every_case_ends_as_it_did(swerve_library: Path, there_and_back: tuple[list[str], ImportedCases]) -> None:
    """In both formats the same step."""
    ids, done = there_and_back
    library = CaseLibrary.open(swerve_library)
    assert done.crashes == len(done.cases) == 2 * len(ids)
    assert not done.refused
    for case in done.cases:
        scalars = library.scenario(next(i for i in ids if f"case-{i.replace(':', '-')}." in case.source)).scalars
        happened = read_case_file(case.file).happened
        assert happened is not None
        assert happened.pose is not None
        assert happened.frame == round(10 * scalars["crash_time_s"])
        speeds = scalars["av_speed_mps"], scalars["bv_speed_mps"]
        np.testing.assert_allclose(happened.pose[:, 2], speeds, atol=1e-4)


def test_libraries_of_imported_cases_are_as_others(
    there_and_back: tuple[list[str], ImportedCases], tmp_path: Path
) -> None:
    _, done = there_and_back
    for number, library in enumerate(done.libraries):
        assert cornerforge.replay(library, "all", check=True).identical
        assert cornerforge.analyse(library, out=tmp_path / str(number), avoidability="none").cases > 0
        assert cornerforge.retest(library, av="recorded", baseline="idm-mobil").cases > 0
    cases = cornerforge.retest(Path(done.out) / "cases", av="idm-mobil")
    assert cases.cases == len(done.cases)
    assert cases.recorded.baseline_crashes == done.crashes


@pytest.mark.slow
def test_imported_cases_shrink(there_and_back: tuple[list[str], ImportedCases], tmp_path: Path) -> None:
    """Vehicles go, the window gets shorter; the crash is the same, and the motion is still that of the rails."""
    _, done = there_and_back
    whole = CaseLibrary.open(Path(done.libraries[0]))
    said = cornerforge.shrink(whole.path, "all", out=tmp_path / "small")
    small = CaseLibrary.open(tmp_path / "small")
    assert small.on_rails
    assert cornerforge.replay(small.path, "all", check=True).identical
    assert said.median.after.vehicles < said.median.before.vehicles
    for case in said.cases:
        before, after = whole.scenario(case.case), small.scenario(case.case)
        assert after.scalars["impact_speed_difference_mps"] == before.scalars["impact_speed_difference_mps"]
        assert case.after.seconds <= case.before.seconds
        assert case.after.deviating_actions == 0
        there, was = after.scenario, before.scenario
        later = len(was.x) - len(there.x)
        columns = np.searchsorted(was.slot, there.slot)
        np.testing.assert_array_equal(there.x, was.x[later:, columns])


def test_a_bad_file_does_not_keep_the_others_out(
    swerve_library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, _ = cornerforge.export(swerve_library, ["5:0"], to="csv", out=tmp_path / "good").files
    half = tmp_path / "half.xml"
    half.write_text('<?xml version="1.0"?><commonRoad><location', encoding="utf-8")
    words = ["import", str(half), str(tmp_path / "good" / good), str(tmp_path / "none.xml"), str(tmp_path / "x.txt")]
    assert main([*words, "--out", str(tmp_path / "in"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [Path(case["source"]).name for case in told["cases"]] == [good]
    assert [Path(one["source"]).name for one in told["refused"]] == ["half.xml", "none.xml", "x.txt"]
    assert main(["import", str(half), "--out", str(tmp_path / "no")]) == 2
    assert "half.xml" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def with_head(file: Path, to: Path, head: str) -> Path:
    """Copy a table with one line more at its head."""
    first, rest = file.read_text(encoding="utf-8").split("\n", 1)
    to.write_text(f"{first}\n{head}\n{rest}", encoding="utf-8")
    return to


def test_awkward_names_and_facts_are_taken_in(swerve_library: Path, tmp_path: Path) -> None:
    """No case file can hold them as they are; what is no JSON is refused by name."""
    name, _ = cornerforge.export(swerve_library, ["5:0"], to="csv", out=tmp_path / "good").files
    good = with_comments(tmp_path / "good" / name)
    named = with_head(good, tmp_path / "named.csv", "")
    named.write_text(good.read_text().replace('# name: "case-5-0"', f'# name: "_{"n" * 150}"'), encoding="utf-8")
    heads = {"nan": "NaN", "big": "1e305", "long": json.dumps("x" * 12_000), "half": '"\\ud800"'}
    odd = [with_head(good, tmp_path / f"{one}.csv", f'# fact "awkward": {head}') for one, head in heads.items()]
    done = cornerforge.import_cases([named, *odd, good], out=tmp_path / "in")
    assert [Path(one.source).name for one in done.refused] == ["nan.csv", "half.csv"]
    assert [case.case for case in done.cases][:2] == ["n" * 80, "case-5-0"]
    facts = [read_case_file(case.file).facts.get("source_awkward") for case in done.cases]
    assert facts == [None, "1e+305", "x" * 9_999 + "\u2026", None]


def test_what_no_case_file_can_hold_is_refused_alone(swerve_library: Path, tmp_path: Path) -> None:
    """It is read and has a road, but a vehicle swings around by 140 m/s."""
    name, _ = cornerforge.export(swerve_library, ["5:0"], to="csv", out=tmp_path / "good").files
    good = with_comments(tmp_path / "good" / name)
    lines = good.read_text(encoding="utf-8").split("\n")
    slot = next(line.split(",")[2] for line in lines if line.startswith("5,0.5,") and not line.startswith("5,0.5,0,"))
    for frame, aside in ((5, 14.0), (6, 28.0), (7, 14.0)):
        at = next(k for k, line in enumerate(lines) if line.startswith(f"{frame},{frame / 10},{slot},"))
        cells = lines[at].split(",")
        cells[7] = str(float(cells[7]) + aside)
        lines[at] = ",".join(cells)
    bad = tmp_path / "bad.csv"
    bad.write_text("\n".join(lines), encoding="utf-8")
    done = cornerforge.import_cases([bad, good], out=tmp_path / "in")
    assert [Path(case.source).name for case in done.cases] == [good.name]
    (refused,) = done.refused
    assert "is not where its speed takes it" in refused.why


def test_the_source_is_told_from_what_is_said_here(
    there_and_back: tuple[list[str], ImportedCases],
) -> None:
    """Licence, types and names of vehicles come along; what is said of the old AV is called so."""
    _, done = there_and_back
    for case in done.cases:
        file = read_case_file(case.file)
        assert file.facts["source"] == Path(case.source).name
        assert "av" not in file.facts
        if case.source.endswith(".osi"):  # it holds no facts
            assert file.licence == "not stated; see the source file"
            assert "(object " in case.words
            continue
        licence = file.facts["source_licence_of_the_model"]
        assert licence
        assert file.licence == licence
        assert isinstance(file.facts["source_crash_time_s"], float)
        assert isinstance(file.facts["source_av"], str)
        assert "(obstacle " in case.words


def test_a_call_that_was_ended_leaves_its_folder_free(swerve_library: Path, tmp_path: Path) -> None:
    name, _ = cornerforge.export(swerve_library, ["5:0"], to="csv", out=tmp_path / "good").files

    def ctrl_c(stage: str, done: float, total: float) -> None:
        if stage == "cases" and done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cornerforge.import_cases(tmp_path / "good" / name, out=tmp_path / "in", progress=ctrl_c)
    assert len(cornerforge.import_cases(tmp_path / "good" / name, out=tmp_path / "in").cases) == 1


def test_bad_input(swerve_library: Path, tmp_path: Path) -> None:
    name, _ = cornerforge.export(swerve_library, ["5:0"], to="csv", out=tmp_path / "good").files
    file = tmp_path / "good" / name
    with pytest.raises(InputError, match="no file to import"):
        cornerforge.import_cases([], out=tmp_path / "a")
    with pytest.raises(DataError, match="leave out ego"):
        cornerforge.import_cases(file, out=tmp_path / "a", ego="Ego")
    with pytest.raises(DataError, match="leave out road"):
        cornerforge.import_cases(file, out=tmp_path / "a", road="road.xodr")
    with pytest.raises(DataError, match="good is a folder; name the files in it"):
        cornerforge.import_cases(file.parent, out=tmp_path / "a")
    with pytest.raises(UnknownNameError, match="idm-mobi"):
        cornerforge.import_cases(file, out=tmp_path / "a", av="idm-mobi")
    with pytest.raises(OutputError, match="not empty"):
        cornerforge.import_cases(file, out=tmp_path / "good")
    assert not (tmp_path / "a").exists()


def test_a_size_that_no_av_has_is_refused_with_the_file(swerve_library: Path, tmp_path: Path) -> None:
    name, _ = cornerforge.export(swerve_library, ["5:0"], to="csv", out=tmp_path / "good").files
    file = tmp_path / "good" / name
    rows = [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()]
    at = rows[0].index("length_m")
    rows = [[*row[:at], "1.8", *row[at + 1 :]] if row[2] == "0" else row for row in rows]
    file.write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
    with pytest.raises(DataError, match=r"case-5-0\.csv: An AV of 1\.8 m x 2 m cannot be driven on this road"):
        cornerforge.import_cases(file, out=tmp_path / "in")


def test_two_files_of_one_name_are_two_cases(swerve_library: Path, tmp_path: Path) -> None:
    files = []
    for number in range(2):
        name, _ = cornerforge.export(swerve_library, ["5:0"], to="csv", out=tmp_path / str(number)).files
        files.append(tmp_path / str(number) / name)
    done = cornerforge.import_cases(files, out=tmp_path / "in", av="idm-mobil")
    assert len({case.case for case in done.cases}) == 2
    assert len(list((tmp_path / "in" / "cases").glob("*.json"))) == 2
