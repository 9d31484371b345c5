"""OpenSCENARIO files are played by esmini; a program of ours stands in its place, as esmini is not on every machine."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest
from reference.osi import Thing, road, scene

import cornerforge
from cornerforge.errors import DataError

pytest.importorskip("google.protobuf", reason="protobuf is not installed (the extra osi)")
pytestmark = pytest.mark.skipif(os.name == "nt", reason="the program is a script")

XOSC = '<OpenSCENARIO><RoadNetwork><LogicFile filepath="road.xodr"/></RoadNetwork><Storyboard/></OpenSCENARIO>'
PLAYER = """#!{python}
import os, pathlib, shutil, sys, time
words = sys.argv
assert pathlib.Path(words[words.index("--osc") + 1]).is_file() and "--headless" in words
pathlib.Path("log.txt").write_text("esmini")
here = os.path.realpath(".")
assert here == os.path.realpath(os.environ["HOME"]) == os.path.realpath(os.environ["TMPDIR"])
{end}
shutil.copy({trace!r}, words[words.index("--osi_file") + 1])
"""


@pytest.fixture
def scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scenario with its road, and an empty PATH."""
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    (tmp_path / "cut.xosc").write_text(XOSC, encoding="utf-8")
    (tmp_path / "road.xodr").write_text(road(), encoding="utf-8")
    (tmp_path / "bin").mkdir()
    scene(tmp_path / "trace.osi", Thing(0, 0.0, -6.0, name="Ego"), Thing(1, 40.0, -6.0, vx=5.0), host=None)
    return tmp_path / "cut.xosc"


def player(folder: Path, end: str = "") -> None:
    program = folder / "bin" / "esmini"
    trace = str(folder / "trace.osi")
    program.write_text(PLAYER.format(python=sys.executable, end=end, trace=trace), encoding="utf-8")
    program.chmod(0o755)


def test_without_esmini_the_message_says_how_to_get_a_trace(scenario: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"cut\.xosc: scenarios are played by esmini, which is not on the PATH"):
        cornerforge.import_cases(scenario, out=tmp_path / "in")


def test_what_esmini_plays_becomes_a_case(scenario: Path, tmp_path: Path) -> None:
    player(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    done = cornerforge.import_cases(scenario, out=tmp_path / "in")
    assert [(case.case, case.vehicles, case.outcome) for case in done.cases] == [("cut", 2, "crash")]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*before, "in"])
    file = Path(done.cases[0].file).read_text(encoding="utf-8")
    assert '"source_road": "road.xodr"' in file
    assert "OpenSCENARIO, ASAM OSI" in file


@pytest.mark.parametrize(
    ("end", "words"),
    [
        ("time.sleep(60)", "esmini has not ended after 0.5 s"),
        ("print('no such entity'); sys.exit(3)", "esmini ended with status 3: no such entity"),
        ("sys.exit(0)", "esmini ended with status 0 and wrote no trace: no word"),
    ],
)
def test_what_esmini_cannot_play_is_said(scenario: Path, tmp_path: Path, end: str, words: str) -> None:
    player(tmp_path, end)
    with pytest.raises(DataError, match=words):
        cornerforge.import_cases(scenario, out=tmp_path / "in", play_seconds=0.5 if "sleep" in end else 30.0)
    assert not (tmp_path / "in").exists()


def test_what_a_script_around_esmini_started_ends_with_it(scenario: Path, tmp_path: Path) -> None:
    """A child in the background does not outlive the script, and what it holds open is not waited for."""
    beat = tmp_path / "beat"
    player(tmp_path, f"os.fork() or [(open({str(beat)!r}, 'a').write('.'), time.sleep(0.05)) for _ in range(600)]")
    began = time.monotonic()
    cornerforge.import_cases(scenario, out=tmp_path / "in", play_seconds=25.0)
    assert time.monotonic() - began < 20.0
    size = beat.stat().st_size
    time.sleep(0.5)
    assert beat.stat().st_size == size
