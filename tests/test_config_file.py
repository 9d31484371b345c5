"""`--config FILE`: it says what options say, mistakes in it are one plain line, and what was used is kept."""

from __future__ import annotations

import json
import os
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
import typer
from stage_lines import without_stages

from cornerforge.cli import app, main
from cornerforge.cli.config import Call, a_call, read_config
from cornerforge.cli.output import compiling_text

Capture = pytest.CaptureFixture[str]
EXAMPLE = Path(__file__).parents[1] / "examples" / "my_av.py"
SIMULATE = ["simulate", "--tests", "20", "--threads", "1"]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(capsys: Capture, *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and standard error, but for the line on compiling."""
    capsys.readouterr()
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out, without_stages(captured.err.replace(f"{compiling_text()}\n", ""))


def found(capsys: Capture, *arguments: object) -> dict[str, Any]:
    status, out, err = call(capsys, *arguments, "--json")
    assert (status, err) == (0, "")
    result: dict[str, Any] = json.loads(out)
    return result


def write(text: str, name: str = "c.toml") -> None:
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    Path(name).write_text(text, encoding="utf-8")


def commands() -> list[list[str]]:
    """Words of all commands that take --config."""

    def walk(command: Any, path: list[str]) -> Iterator[list[str]]:
        if any(one.name == "config" for one in command.params):
            yield path
        for name, child in getattr(command, "commands", {}).items():
            yield from walk(child, [*path, name])

    return list(walk(typer.main.get_command(app), []))


@pytest.mark.full
def test_a_file_says_what_options_say_and_options_win(place: Path, capsys: Capture) -> None:  # noqa: ARG001
    write('tests = 40\nlanes = 2\nodd = "swift"\nseed = 5\nbv = ["idm"]\nthreads = 1\n')
    said = found(capsys, "simulate", "--config", "c.toml")
    same = found(capsys, *shlex.split("simulate --tests 40 --lanes 2 --odd swift --seed 5 --bv idm --threads 1"))
    assert said["digest"] == same["digest"]
    assert found(capsys, "simulate", "--config", "c.toml", "--seed", 6, "--tests", 30)["tests"] == 30
    assert found(capsys, "simulate", "--seed", 6, "--config", "c.toml")["digest"] != said["digest"]


def test_a_flag_of_a_file_can_be_taken_back(place: Path, capsys: Capture) -> None:  # noqa: ARG001
    write('tests = 20\nthreads = 1\njson = true\nquiet = true\nbv = "swerve"\nbounded = true\n')
    assert json.loads(call(capsys, "simulate", "--config", "c.toml")[1])["tests"] == 20
    status, out, err = call(capsys, "simulate", "--config", "c.toml", "--no-json", "--no-quiet", "--no-bounded")
    assert (status, err) == (0, "")
    assert out.startswith("idm-mobil, swerve: ")
    for never in ("--no-tests", "--no-bound"):
        assert call(capsys, "simulate", never)[0] == 2


def test_tables_are_for_one_command_and_win_over_the_top(place: Path, capsys: Capture) -> None:  # noqa: ARG001
    write('threads = 1\nseed = 5\n[simulate]\ntests = 40\nseed = 7\n[run]\neffort = "quick"\n[ndd.fit]\nstudy = true\n')
    same = found(capsys, *shlex.split("simulate --tests 40 --seed 7 --threads 1"))
    assert found(capsys, "simulate", "--config", "c.toml")["digest"] == same["digest"]


def test_commands_share_the_world_of_a_file(place: Path, capsys: Capture) -> None:  # noqa: ARG001
    """The AV, its world and the seed may be at the top also for a command without such an option; nothing else may."""
    write('av = "my_av:MyAv"\nlanes = 4\nbounded = true\nseed = 5\n')
    fit = ["ndd", "fit", "none.csv", "--out", "m.npz", "--config", "c.toml"]
    status, _, err = call(capsys, *fit)
    assert status == 2
    assert "none.csv" in err
    write("[ndd.fit]\nlanes = 4\n")
    assert 'ndd fit has no option "lanes"' in call(capsys, *fit)[2]


@pytest.mark.full
def test_a_required_option_and_a_flag_can_stand_in_a_file(place: Path, capsys: Capture) -> None:
    write('policy = "swerve"\nout = "library"\ncases = 3\njson = true\nthreads = 1\n')
    status, out, err = call(capsys, "generate", "--config", "c.toml")
    assert (status, err) == (0, "")
    assert json.loads(out)["cases"] == 3
    assert (place / "library" / "manifest.json").exists()
    assert call(capsys, "generate", "--config", "c.toml", "--resume")[0] == 0
    write('policy = "swerve"\nout = "library"\ncases = 4\nresume = true\nseed = 1\n')
    status, _, err = call(capsys, "generate", "--config", "c.toml")
    assert (status, err.count("\n")) == (2, 1), "a changed file is as changed options"
    assert "seed" in err


@pytest.mark.full
def test_paths_in_a_file_are_seen_from_its_folder(place: Path, capsys: Capture) -> None:
    write('out = "library"\ntests = 20\nthreads = 1\nquiet = true\n', "sub/c.toml")
    assert call(capsys, "simulate", "--config", "sub/c.toml") == (0, "", "")
    assert (place / "sub" / "library").is_dir()
    assert call(capsys, "simulate", "--config", "sub/c.toml", "--out", "mine") == (0, "", "")
    assert (place / "mine").is_dir()
    write('bv = ["none.safetensors"]\n', "sub/c.toml")
    assert "sub/none.safetensors" in call(capsys, "simulate", "--config", "sub/c.toml")[2]
    write(f'model = "{place}/none.npz"\n', "sub/c.toml")
    assert f"{place}/none.npz" in call(capsys, "simulate", "--config", "sub/c.toml")[2]
    write('road = "none.json"\n', "sub/c.toml")
    assert "sub/none.json" in call(capsys, *SIMULATE, "--config", "sub/c.toml")[2]
    write('av = "none.onnx"\n', "sub/c.toml")
    assert "sub/none.onnx" in call(capsys, *SIMULATE, "--config", "sub/c.toml")[2]


@pytest.mark.full
def test_the_module_of_an_av_is_found_beside_the_file(place: Path, capsys: Capture) -> None:
    write('av = "my_av:MyAv"\n', "sub/c.toml")
    shutil.copy(EXAMPLE, place / "sub")
    before = os.environ.get("PYTHONPATH")
    assert found(capsys, *SIMULATE, "--config", "sub/c.toml")["av_faults"] == 0
    assert os.environ.get("PYTHONPATH") == before
    status, _, err = call(capsys, *SIMULATE, "--config", "sub/c.toml", "--av", "my_av:MyAv")
    assert status == 2, "what is said on the command line is looked for as ever"
    assert err.startswith("cornerforge: No module my_av")
    write('av = "nowhere:MyAv"\n', "sub/c.toml")
    looked = f"looked in {place / 'sub'}, {place} and where"
    assert looked in call(capsys, *SIMULATE, "--config", "sub/c.toml")[2]
    assert looked.replace(f"{place / 'sub'}, ", "") in call(capsys, *SIMULATE, "--av", "nowhere:MyAv")[2]


@pytest.mark.full
@pytest.mark.parametrize("other", ["my_av.py", "my_av/__init__.py"])
def test_another_module_of_that_name_is_never_taken_for_it(other: str, place: Path, capsys: Capture) -> None:
    write('av = "my_av:MyAv"\n', "sub/c.toml")
    shutil.copy(EXAMPLE, place / "sub")
    write("class MyAv: ...\n", other)
    status, _, err = call(capsys, *SIMULATE, "--config", "sub/c.toml")
    assert (status, err.count("\n")) == (2, 1)
    assert str(place / "sub" / "my_av.py") in err
    assert str(place / other) in err
    (place / "sub" / "my_av.py").unlink()
    assert "MyAv" in call(capsys, *SIMULATE, "--config", "sub/c.toml")[2], "the only one there is: it has no act"


@pytest.mark.full
def test_the_options_in_effect_and_the_file_are_kept(place: Path, capsys: Capture) -> None:
    text = "# mine\ntests = 20\nthreads = 1\nlanes = 4\n"
    write(text)
    found(capsys, "simulate", "--config", "c.toml", "--lanes", 2, "--out", "library")
    kept = json.loads((place / "library" / "provenance.json").read_text(encoding="utf-8"))
    assert kept["config"] == {"file": "c.toml", "text": text}
    expected = {"tests": 20, "lanes": 2, "out": "library", "odd": "default", "json": True, "model": None, "bv": []}
    assert expected.items() <= kept["options"].items()
    assert kept["identity"]["lanes"] == 2
    found(capsys, *SIMULATE, "--out", "plain")
    kept = json.loads((place / "plain" / "provenance.json").read_text(encoding="utf-8"))
    assert "config" not in kept
    assert kept["options"]["tests"] == 20


# What stands in the file, what the message must hold.
BAD = {
    "unknown key": ("lnes = 4", 'c.toml: No option of simulate "lnes". Did you mean "lanes"?'),
    "unknown key, underscore": ("av_timout = 4", 'Did you mean "av-timeout"?'),
    "nothing near": ("zzz = 4", "Known: acting, "),
    "of another command": ('effort = "quick"', "effort of run, put it below a line [run]"),
    "of another command, misspelt": ('effrt = "quick"', "effort of run"),
    "in another command's table": (
        '[run]\neffrt = "quick"',
        'c.toml: No option of run "effrt". Did you mean "effort"?',
    ),
    "unknown table": ("[simulat]\ntests = 5", 'Did you mean "simulate"?'),
    "unknown table below ndd": ("[ndd.fti]\nstudy = true", 'Did you mean "ndd fit"?'),
    "no table below ndd": ("[ndd]\nfit = 1", "ndd fit"),
    "text for a number": ('tests = "many"', 'tests = "many" is not of the right type; give a whole number.'),
    "fraction for a count": ("tests = 4.5", "give a whole number"),
    "true for a count": ("tests = true", "tests = true is not of the right type"),
    "number for a flag": ("bounded = 1", "give true or false"),
    "number for a path": ("out = 3", "give text in quotes"),
    "number for a name": ("av = 3", "give text in quotes"),
    "number in a list": ('bv = ["idm", 3]', "bv = 3"),
    "list for one": ("lanes = [2, 3]", "lanes = [2, 3]"),
    "table for one": ("[lanes]\na = 1", "lanes = "),
    "a date": ("seed = 2026-01-01", "seed = 2026-01-01"),
    "said twice": ("av-timeout = 1\nav_timeout = 2", "stands there twice"),
    "on the command line only": ('config = "d.toml"', "on the command line only"),
    "no TOML": ("tests = ", "c.toml is no TOML"),
    "out of range": ("lanes = 99", "c.toml: lanes = 99 is out of range"),
    "out of range, in two words": ("av-timeout = -1", "c.toml: av_timeout = -1"),
    "unknown name": ('odd = "swft"', 'c.toml: No ODD "swft". Did you mean "swift"?'),
    "unknown name in a list": ('bv = ["swerv"]', 'c.toml: No driver of background vehicles "swerv".'),
    "no such module": ('av = "no_such:Av"', "c.toml: No module no_such for the AV no_such:Av; looked in /"),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", BAD)
def test_a_mistake_in_a_file_is_one_plain_line(name: str, place: Path, capsys: Capture) -> None:
    text, message = BAD[name]
    write(text)
    status, out, err = call(capsys, *SIMULATE[:1], "--config", "c.toml")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("cornerforge: ")
    assert message in err
    assert [path.name for path in place.iterdir()] == ["c.toml"]


def test_a_mistake_on_the_command_line_is_not_blamed_on_the_file(place: Path, capsys: Capture) -> None:  # noqa: ARG001
    write('lanes = 2\nodd = "swift"\n')
    for given in (("--lanes", 99), ("--odd", "swft"), ("--tests", 0)):
        status, _, err = call(capsys, "simulate", "--config", "c.toml", *given)
        assert status == 2
        assert "c.toml" not in err


def test_a_file_of_an_editor_that_marks_its_encoding(place: Path, capsys: Capture) -> None:
    (place / "c.toml").write_bytes(b"\xef\xbb\xbftests = 20\nthreads = 1\n")
    assert found(capsys, "simulate", "--config", "c.toml")["tests"] == 20


def test_a_file_that_is_not_there_or_no_text(place: Path, capsys: Capture) -> None:
    status, _, err = call(capsys, "run", "--config", "none.toml")
    assert (status, err) == (2, "cornerforge: No config file none.toml; cornerforge init DIR writes one.\n")
    (place / "b.toml").write_bytes(b"\xff\xfe")
    assert call(capsys, "run", "--config", "b.toml")[::2] == (
        2,
        "cornerforge: The config file b.toml is no UTF-8 text.\n",
    )
    (place / "folder").mkdir()
    assert "cannot be read" in call(capsys, "run", "--config", "folder")[2]


def test_debug_in_a_file_shows_the_traceback(place: Path, capsys: Capture) -> None:  # noqa: ARG001
    write("debug = true\ntests = 0\n")
    status, _, err = call(capsys, "simulate", "--config", "c.toml")
    assert status == 2
    assert err.startswith("Traceback")


def test_an_interrupt_promises_what_the_file_says(
    place: Path,  # noqa: ARG001
    capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cornerforge.verbs.rate.rate", interrupted)
    write("max-tests = 10\n")
    assert call(capsys, "rate", "--config", "c.toml") == (130, "", "cornerforge: interrupted.\n")
    write('max-tests = 10\nout = "kept"\n')
    said = "cornerforge: interrupted; what was finished is kept: the same command with --resume goes on.\n"
    assert call(capsys, "rate", "--config", "c.toml") == (130, "", said)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("path", commands(), ids=" ".join)
def test_a_file_can_say_every_option(path: list[str], place: Path) -> None:  # noqa: ARG001
    """A value for each option, written by the option's type, arrives under the option's parameter."""
    by_type = {bool: "true", int: "3", float: "3", str: '"word"', Path: '"word"'}
    with a_call() as running:
        context: Any = typer.main.get_command(app).make_context("cornerforge", [], resilient_parsing=True)
        for word in path:
            context = type(context)(context.command.commands[word], info_name=word, parent=context)
        options = [
            one
            for one in context.command.params
            if one.param_type_name == "option" and not one.hidden and one.name != "config"
        ]
        kinds = [one.type_descriptor.annotation for one in options]
        values = [by_type[get_args(kind)[0] if get_args(kind) else kind] for kind in kinds]
        names = [one.opts[0].removeprefix("--") for one in options]
        write("\n".join(f"{name} = {value}" for name, value in zip(names, values, strict=True)))
        read_config(context, Path("c.toml"))
    assert set(running.given) == {one.name for one in options}
    assert len(options) > 3


def test_without_a_call_nothing_is_stated() -> None:
    assert Call().stated() == {}


def test_a_file_without_end_is_not_read_to_its_end(place: Path, capsys: Capture) -> None:  # noqa: ARG001
    """Such as /dev/zero, which would fill the memory first."""
    write("# " + "x" * 1_000_000)
    status, _, err = call(capsys, *SIMULATE, "--config", "c.toml")
    assert status == 2
    assert err == "cornerforge: The config file c.toml is longer than 1,000,000 characters; name another file.\n"
