"""`figure` and `replay --video`: from a library to files, and what is told before any work."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from paper_figures import read_pdf
from PIL import Image

import cornerforge
from cornerforge.cli import main
from cornerforge.errors import InputError, OutputError, UnknownNameError
from cornerforge.ext.pictures.printed import CAPTIONS
from cornerforge.library import CaseLibrary

pytestmark = pytest.mark.full


@pytest.fixture
def case(swerve_library: Path) -> str:
    return str(CaseLibrary.open(swerve_library).scalars(["case_id"])["case_id"][7].as_py())


def test_a_case_as_a_strip(swerve_library: Path, case: str, tmp_path: Path) -> None:
    place = tmp_path / "new" / "a.pdf"
    (found,) = cornerforge.figure(swerve_library, case, out=place).figures
    assert (found.name, found.file) == (case, str(place))
    assert case in found.caption
    assert read_pdf(place.read_bytes()).points == {8.0}
    with pytest.raises(OutputError, match="exists already"):
        cornerforge.figure(swerve_library, case, out=place)
    wide = tmp_path / "b.svg"
    cornerforge.figure(swerve_library, case, out=wide, times=[-1.0, 0.0], width="page")
    assert 'width="515.52pt"' in wide.read_text(encoding="utf-8")


def test_the_charts_of_a_library(swerve_library: Path, tmp_path: Path) -> None:
    names = ["map", "fault"]
    found = cornerforge.figure(swerve_library, out=tmp_path, figures=names, file_format="svg")
    assert [one.name for one in found.figures] == names
    assert {path.name for path in tmp_path.iterdir()} == {"analysis", "fault.svg", "map.svg"}
    with pytest.raises(InputError, match=r"holds nothing for the figure training; there are: .*map"):
        cornerforge.figure(swerve_library, out=tmp_path, figures=["training"])
    with pytest.raises(OutputError, match="exists already"):
        cornerforge.figure(swerve_library, out=tmp_path, figures=["map"], file_format="svg")


def test_the_names_of_all_charts(swerve_library: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert [one.name for one in cornerforge.figure(swerve_library).figures] == list(CAPTIONS)
    assert main(["figure", str(swerve_library), "--list"]) == 0
    assert [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()] == list(CAPTIONS)


def test_what_cannot_be_drawn_is_told_first(swerve_library: Path, case: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"neither in \.pdf nor in \.svg"):
        cornerforge.figure(swerve_library, case, out=tmp_path / "a.png")
    with pytest.raises(InputError, match='No width "wide"; choose column or page'):
        cornerforge.figure(swerve_library, case, out=tmp_path / "a.pdf", width="wide")
    with pytest.raises(InputError, match="a file"):
        cornerforge.figure(swerve_library, case)
    with pytest.raises(InputError, match="name the case"):
        cornerforge.figure(swerve_library, out=tmp_path, times=[0.0])
    with pytest.raises(InputError, match="choose pdf or svg"):
        cornerforge.figure(swerve_library, out=tmp_path, file_format="png")
    with pytest.raises(UnknownNameError, match='No figure "mapp"'):
        cornerforge.figure(swerve_library, out=tmp_path, figures=["mapp"])
    with pytest.raises(InputError, match="outside the recording"):
        cornerforge.figure(swerve_library, case, out=tmp_path / "a.pdf", times=[-500.0])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["0:0"], "A case's figure needs a file; name it by --out"),
        (["0:0", "--out", "a.pdf", "--times", "1,b"], "are no numbers with commas between them"),
    ],
)
def test_the_command_line_says_what_is_wrong(
    swerve_library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    given: list[str], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["figure", str(swerve_library), *given]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_times_on_the_command_line(swerve_library: Path, case: str, tmp_path: Path) -> None:
    place = tmp_path / "a.pdf"
    assert main(["figure", str(swerve_library), case, "--out", str(place), "--times", "-1,-0.5,0", "--quiet"]) == 0
    assert place.read_bytes().startswith(b"%PDF")


def test_a_film_of_a_case(swerve_library: Path, case: str, tmp_path: Path) -> None:
    place = tmp_path / "new" / "a.gif"
    stages: set[Any] = set()
    found = cornerforge.replay(swerve_library, case, check=True, video=place, progress=lambda *at: stages.add(at[0]))
    assert (found.video, found.identical) == (str(place), True)
    assert found.crash_time_s is not None
    with Image.open(place) as gif:
        assert getattr(gif, "n_frames", 1) == round(10 * min(found.crash_time_s, 15.0)) + 1
    assert "film" in stages
    with pytest.raises(OutputError, match="exists already"):
        cornerforge.replay(swerve_library, case, video=place)


@pytest.mark.parametrize(("case", "name", "why"), [("all", "a.gif", "one case"), ("5:1", "a.avi", "nor in .webm")])
def test_what_cannot_be_a_film_is_told_first(
    swerve_library: Path, tmp_path: Path, case: str, name: str, why: str
) -> None:
    with pytest.raises(InputError, match=why):
        cornerforge.replay(swerve_library, case, video=tmp_path / name)
    assert list(tmp_path.iterdir()) == []
