"""`cornerforge serve`: what it starts, and how it fails."""

from __future__ import annotations

import dataclasses
import shutil
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from edited_files import write_object
from explorer.conftest import BRAKES, asked, started, stopped
from plain_results import plain_result

from cornerforge.cli import main
from cornerforge.errors import InputError
from cornerforge.ext.explorer import serve as verb
from cornerforge.ext.explorer.driving import Driving
from cornerforge.ext.explorer.exhibit import Exhibit
from cornerforge.results import NaturalRate, as_json

pytestmark = pytest.mark.full


def test_a_page_that_is_not_built_is_one_line(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cornerforge.ext.explorer.server.read_page", dict)
    assert main(["serve", str(place), "--port", "0"]) == 2
    assert capsys.readouterr().err == (
        "cornerforge: This installation lacks the explorer's page, which is built with Node.js: run `make web` in the "
        "checkout, and install from there again. A wheel (`make wheel`) has it.\n"
    )


def test_an_av_of_ones_own_can_drive(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_av.py").write_text(BRAKES, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    running = started(place, "--port", 0, "--with", "my_av:Brakes")
    assert "my_av:Brakes" in asked(running, "api/about")["avs"]
    told = asked(running, "api/case/adversary/3:0/with/my_av:Brakes")
    speeds = told["vehicles"][0]["v"]
    assert speeds[30] < speeds[0] - 5.0
    assert stopped(running)[0] == 0


def test_an_av_that_is_not_there_is_one_line(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", str(place), "--with", "no-such-av"]) == 2
    assert "no-such-av" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["nothing", "empty"])
def test_what_cannot_be_shown_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str) -> None:
    folder = tmp_path / what
    if what == "empty":
        folder.mkdir()
    assert main(["serve", str(folder)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("fault", [InputError("too few cases."), RuntimeError("two\nlines"), MemoryError()])
def test_an_analysis_that_fails_is_said_on_the_page(
    place: Path, monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    found = [dataclasses.replace(one, analysis=None) for one in verb._sources(place)]
    exhibit = Exhibit("run", [(one.source, None) for one in found], Driving((), found[0].source))
    warmed: list[str] = []

    def fail(*_: Any, **__: Any) -> None:
        raise fault

    monkeypatch.setattr("cornerforge.verbs.analyse.analyse", fail)
    monkeypatch.setattr(verb, "_warm_up", lambda *_: warmed.append("yes"))
    monkeypatch.setattr(verb, "_IDLE_S", 0.0)
    verb._behind(exhibit, found, None, threading.Event())
    warnings = exhibit.about()["warnings"]
    assert [line.startswith("There is no analysis") for line in warnings] == [True, True]
    assert "\n" not in "".join(warnings)
    assert exhibit.about()["work"] is None
    assert warmed == ["yes"]
    exhibit.close()


def test_a_library_without_an_analysis_gets_one(place: Path, tmp_path: Path) -> None:
    shutil.copytree(place / "library", tmp_path / "lib")
    running = started(tmp_path / "lib", "--port", 0)
    end = time.monotonic() + 300
    while (told := asked(running, "api/about"))["revision"] == 1:
        assert time.monotonic() < end
        time.sleep(0.2)
    assert told["warnings"] == []
    assert "pc1" in {one["name"] for one in told["columns"]}
    assert (tmp_path / "lib-analysis" / "analysis.json").is_file()
    assert stopped(running) == (0, "")
    again = started(tmp_path / "lib", "--port", 0)
    assert "pc1" in {one["name"] for one in asked(again, "api/about")["columns"]}
    stopped(again)


def test_scripted_cases_are_not_said_to_be_natural(place: Path, tmp_path: Path) -> None:
    """Though their others drive naturally where no script says what they do."""
    assert main(["shrink", str(place / "library"), "3:0", "--out", str(tmp_path / "small"), "--quiet"]) == 0
    running = started(tmp_path / "small", "--port", 0)
    told = asked(running, "api/about")["sources"]
    assert [(one["name"], one["natural"]) for one in told] == [("scripted", False)]
    assert stopped(running)[0] == 0


def test_a_rate_that_is_in_doubt_is_said_to_be(place: Path, tmp_path: Path) -> None:
    shutil.copytree(place / "natural", tmp_path / "natural")
    rate = plain_result(
        NaturalRate, method="splitting", tests=1000, plain_tests=10, crashes_per_test=1e-6, interval95=(5e-7, 2e-6),
        effective_sample_size=3, doubts=("it rests on 3 trees",),
    )  # fmt: skip
    write_object(tmp_path / "natural" / "rate.json", as_json(rate))
    running = started(tmp_path, "--port", 0)
    assert asked(running, "api/about")["warnings"] == [
        "How often crashes happen is not to be trusted yet: it rests on 3 trees."
    ]
    assert stopped(running)[0] == 0
