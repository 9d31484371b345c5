"""`init`: its files do what they say, and take nobody's place."""

from __future__ import annotations

import importlib
import json
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from folder_snapshot import snapshot
from stage_lines import without_stages

import cornerforge
from cornerforge.cli import app, main
from cornerforge.cli.output import compiling_text
from cornerforge.errors import OutputError
from cornerforge.verbs.init import FILES

run_module = importlib.import_module("cornerforge.verbs.run")
Capture = pytest.CaptureFixture[str]
EXAMPLE = Path(__file__).parents[2] / "examples" / "my_av.py"


def call(capsys: Capture, *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out, without_stages(captured.err.replace(f"{compiling_text()}\n", ""))


def run_options() -> dict[str, Any]:
    program: Any = typer.main.get_command(app)
    options = (one for one in program.commands["run"].params if not one.hidden and one.name != "config")
    return {one.opts[0].removeprefix("--"): one for one in options}


@pytest.mark.full
def test_the_av_is_the_example(golden: Callable[[str, str], None]) -> None:
    """The package holds a copy of examples/my_av.py, which `make golden` writes."""
    golden("../../src/cornerforge/verbs/start/my_av.py.txt", EXAMPLE.read_text(encoding="utf-8"))


@pytest.mark.full
def test_the_files_are_written_and_named(tmp_path: Path, capsys: Capture) -> None:
    place = tmp_path / "a" / "b"
    status, out, err = call(capsys, "init", place, "--json")
    assert (status, err) == (0, "")
    assert json.loads(out) == {"files": [str(place / name) for name in FILES]}
    assert {path.name for path in place.iterdir()} == set(FILES)
    assert (place / "my_av.py").read_text(encoding="utf-8") == EXAMPLE.read_text(encoding="utf-8")
    again = tmp_path / "again"
    assert cornerforge.init(again).files == tuple(str(again / name) for name in FILES)
    assert snapshot(again) == snapshot(place)


@pytest.mark.full
@pytest.mark.parametrize("name", FILES)
def test_nothing_is_overwritten_and_nothing_half_done(name: str, tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / name).write_text("mine", encoding="utf-8")
    before = snapshot(tmp_path)
    status, out, err = call(capsys, "init", tmp_path)
    assert (status, out) == (2, "")
    assert err == f"cornerforge: {tmp_path / name} exists already; remove it, or choose another place.\n"
    assert snapshot(tmp_path) == before
    status, _, err = call(capsys, "init", tmp_path / name)
    assert (status, err.count("\n")) == (2, 1)


@pytest.mark.full
def test_other_files_of_the_folder_stay(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    assert call(capsys, "init", tmp_path)[0] == 0
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"


@pytest.mark.full
def test_a_write_that_fails_takes_back_what_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("cornerforge.verbs.init")
    honest = module.write_text

    def full(path: Path, text: str) -> None:
        if path.name == "README.md":
            raise OutputError("no room")
        honest(path, text)

    monkeypatch.setattr(module, "write_text", full)
    with pytest.raises(OutputError, match="no room"):
        cornerforge.init(tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


def test_the_config_shows_every_option_with_its_default(tmp_path: Path, capsys: Capture) -> None:
    cornerforge.init(tmp_path)
    text = (tmp_path / "cornerforge.toml").read_text(encoding="utf-8")
    all_on = re.sub(r"^# (?=[a-z-]+ = )", "", text, flags=re.MULTILINE)
    content = tomllib.loads(all_on)
    table = content.pop("run")
    assert not content.keys() & table.keys()
    options = run_options()
    assert content.keys() | table.keys() == options.keys(), "an option of run is missing, or gone"
    commented = re.findall(r"^# ([a-z-]+) = .*?(  # .*)$", text, flags=re.MULTILINE)
    for name, remark in commented:
        default = options[name].default
        if "by default" in remark:
            assert default is None
        else:
            assert (content | table)[name] == default
    assert {"av", "out"} == options.keys() - {name for name, _ in commented}
    either = re.sub(r"^hours = .*\n", "", all_on, flags=re.MULTILINE)  # hours stand instead of an effort
    (tmp_path / "all.toml").write_text(either.replace('effort = "quick"', 'effort = "none"'), encoding="utf-8")
    status, _, err = call(capsys, "run", "--config", tmp_path / "all.toml")
    assert (status, 'No effort "none"' in err) == (2, True), "every value has the type that run takes"


@pytest.mark.full
def test_the_readme_has_ten_lines_whose_commands_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    cornerforge.init(tmp_path)
    monkeypatch.chdir(tmp_path)
    lines = (tmp_path / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 10
    commands = [shlex.split(line, comments=True) for line in lines if line.startswith("    cornerforge ")]
    assert [words[1] for words in commands] == ["check-av", "run", "replay"]
    for words in commands:
        assert call(capsys, *words[1:], "--help")[0] == 0


@pytest.mark.full
def test_a_run_from_the_folder_and_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """What the README says, at a tiny size; what was used is kept; a changed config is refused as changed options."""
    tiny = run_module.Effort(
        nde_tests=100, natural_tests=100, natural_rhw=0.3, decisions=20_000, evaluation_tests=100, exposure_tests=60,
        cases=8,
    )  # fmt: skip
    monkeypatch.setitem(run_module.EFFORTS, "quick", tiny)
    place = tmp_path / "mine"
    cornerforge.init(place)
    config = place / "cornerforge.toml"
    monkeypatch.chdir(tmp_path)
    status, out, err = call(capsys, "run", "--config", "mine/cornerforge.toml", "--json", "--seed", 2)
    assert (status, err) == (0, "")
    summary = json.loads(out)
    assert (summary["av"], summary["effort"], summary["seed"]) == ("my_av:MyAv", "quick", 2)
    assert summary["out"] == "mine/out"
    kept = json.loads((place / "out" / "provenance.json").read_text(encoding="utf-8"))
    assert kept["config"] == {"file": "mine/cornerforge.toml", "text": config.read_text(encoding="utf-8")}
    assert {"av": "my_av:MyAv", "seed": 2, "out": "mine/out"}.items() <= kept["options"].items()
    monkeypatch.chdir(place)
    again = ["run", "--config", "cornerforge.toml", "--seed", "2", "--json"]
    status, out, err = call(capsys, *again, "--resume")
    assert (status, err) == (0, "")
    moved = {"out", "seconds", "report", "generate", "analyse", "natural_cases"}  # they name the folder
    assert {k: v for k, v in json.loads(out).items() if k not in moved} == {
        k: v for k, v in summary.items() if k not in moved
    }
    assert call(capsys, "replay", "out/library", "all", "--check", "--quiet")[0] == 0
    config.write_text(config.read_text(encoding="utf-8").replace("# lanes = 4", "lanes = 4"), encoding="utf-8")
    status, _, err = call(capsys, *again, "--resume")
    assert (status, err.count("\n")) == (2, 1)
    assert "lanes = 3, not 4" in err
