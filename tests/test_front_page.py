"""The first page of the program, which is written without Typer: it is the one that Typer would write."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import typer.main

from cornerforge.cli import app, front, main
from cornerforge.cli.start import run

Capture = pytest.CaptureFixture[str]
ENVIRONMENT = {
    name: value for name, value in os.environ.items() if name not in {*front._OTHER_LOOKS, "COLUMNS", "TERM"}
}


def content() -> str:
    """What is on the page, from what Typer makes it of."""
    command: Any = typer.main.get_command(app)
    context = command.make_context("cornerforge", ["avs"], resilient_parsing=True)

    def named(option: Any) -> list[str]:
        long, short = ([one for one in option.opts if one.startswith("--") == yes] for yes in (True, False))
        return ["".join(long), "".join(short), option.help or ""]

    panels: dict[str, list[list[str]]] = {}
    for name in command.list_commands(context):
        child = command.commands[name]
        panels.setdefault(child.rich_help_panel, []).append([name, " ".join(child.help.split("\n\n")[0].split())])
    page = {
        "usage": command.get_usage(context).removeprefix("Usage: "),
        "about": command.help,
        "options": [named(one) for one in command.get_params(context)],
        "commands": panels,
        "end": command.epilog,
    }
    return json.dumps(page, indent=1) + "\n"


def test_the_page_holds_what_the_commands_say(golden: Callable[[str, str], None]) -> None:
    """src/cornerforge/cli/front_page.json."""
    golden("../../src/cornerforge/cli/front_page.json", content())


@pytest.fixture
def usual(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    for name in front._OTHER_LOOKS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    return monkeypatch


@pytest.mark.sampled(8)
@pytest.mark.parametrize("width", [*range(60, 86), 97, 120, 144, 205, 301])
def test_the_page_is_the_one_that_typer_writes(usual: pytest.MonkeyPatch, capsys: Capture, width: int) -> None:
    usual.setenv("COLUMNS", str(width))
    assert front.front_page(["--help"]) is not None
    assert main(["--help"]) == 0
    ours = capsys.readouterr().out
    assert run(["--help"]) == 0
    assert ours == capsys.readouterr().out


def cells(text: str) -> Iterator[tuple[str, str]]:
    """Each letter with its look; that of a space without a background says nothing."""
    look = ""
    for code, letter in re.findall(r"\x1b\[([0-9;]*)m|(.)", text, flags=re.DOTALL):
        if letter:
            yield letter, "" if letter.isspace() else look
        else:
            look = "" if code == "0" else code


def test_on_a_terminal_the_page_has_the_looks_that_typer_gives(usual: pytest.MonkeyPatch, capsys: Capture) -> None:
    usual.setenv("COLUMNS", "80")
    usual.setenv("COLORTERM", "truecolor")
    ours = front._page(80, colours=True)
    usual.setattr("typer.rich_utils.FORCE_TERMINAL", True)
    assert run(["--help"]) == 0
    theirs = capsys.readouterr().out
    assert "\x1b[" in theirs
    assert list(cells(ours)) == list(cells(theirs))


@pytest.mark.parametrize("words", [["--help"], ["-h"], ["--version"]])
def test_version_is_what_typer_prints_too(usual: pytest.MonkeyPatch, capsys: Capture, words: list[str]) -> None:
    usual.setenv("COLUMNS", "80")
    assert run(words) == 0
    theirs = capsys.readouterr().out
    assert main(words) == 0
    assert capsys.readouterr().out == theirs


@pytest.mark.parametrize(
    ("name", "value"), [("COLUMNS", "50"), ("TERM", "dumb"), *((one, "1") for one in front._OTHER_LOOKS)]
)
def test_what_may_change_the_look_is_left_to_typer(usual: pytest.MonkeyPatch, name: str, value: str) -> None:
    usual.setenv("COLUMNS", "80")
    assert front.front_page(["--help"]) is not None
    usual.setenv(name, value)
    assert front.front_page(["--help"]) is None


@pytest.mark.parametrize("words", [[], ["run", "--help"], ["--help", "run"], ["--version", "run"], ["avs"]])
def test_all_other_words_are_left_to_typer(usual: pytest.MonkeyPatch, words: list[str]) -> None:  # noqa: ARG001
    assert front.front_page(words) is None


@pytest.mark.parametrize("word", ["--version", "--help", "-h"])
def test_the_first_page_loads_no_library(word: str) -> None:
    """Neither Typer nor what computes; so it is there at once."""
    code = (
        "import sys; from cornerforge.cli import main; status = main(sys.argv[1:]);"
        "print(*sorted(name for name in sys.modules if '.' not in name), file=sys.stderr); sys.exit(status)"
    )
    command = [sys.executable, "-c", code, word]
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, check=True)
    loaded = set(done.stderr.split())
    assert "cornerforge" in loaded
    assert not loaded & {"typer", "rich", "numpy", "numba", "scipy", "pyarrow", "torch", "inspect", "subprocess"}
