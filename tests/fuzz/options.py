"""Hostile values for every argument and option of every command, one at a time, in calls that are cheap otherwise.

`cases` gives the command lines, `verdict` runs one and says what became of it.
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import signal
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from cornerforge.cli import app, main

__all__ = ["HOSTILE", "Case", "Inputs", "cases", "verdict"]

HOSTILE = (
    "", "nan", "inf", "-inf", "-1", "0", "1e308", "1" + 30 * "0", "2.7", "true", "x", "x" * 100_000, "\udcff", "~/x",
    ".", "..", "/", "/dev/null", "/dev/full", "a\nb", "\x1b[31mred", "a b;c", "../../x", "run-10:30", "%s{0}", "--seed",
)  # fmt: skip
"""What no option expects; a value that one of them may have is as good as any other there."""


@dataclass(frozen=True)
class Inputs:
    """Small files that commands take.

    Attributes:
        library: A case library of a few cases.
        policy: A policy file.
        data: A trajectory file.
        case: A case file.
        scenario: An OpenSCENARIO file.
    """

    library: Path
    policy: Path
    data: Path
    case: Path
    scenario: Path


@dataclass(frozen=True)
class Case:
    """One command line.

    Attributes:
        words: The words of the command.
        option: The option or argument with the hostile value, by parameter name.
        value: The value.
        argv: All words after `cornerforge`.
    """

    words: tuple[str, ...]
    option: str
    value: str
    argv: tuple[str, ...]


def _commands(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, child in getattr(command, "commands", {}).items():
        if getattr(child, "commands", None):
            yield from _commands(child, (*path, name))
        else:
            yield (*path, name), child


def _usual(words: tuple[str, ...], at: Inputs, out: str) -> dict[str, Sequence[str]]:
    """Arguments and options that make a command cheap, by parameter name."""
    lib, policy = [str(at.library)], [str(at.policy)]
    given: dict[str, dict[str, Sequence[str]]] = {
        "init": {"folder": [out]},
        "run": {"out": [out], "effort": ["none"]},  # too long to be run: --effort is refused last
        "report": {"place": lib, "out": [out], "avoidability": ["2"]},
        "serve": {"place": lib, "port": ["0"]},
        "figure": {"place": lib, "out": [f"{out}.pdf"]},
        "reproduce": {"out": [out], "figure": ["none"]},
        "simulate": {"tests": ["3"]},
        "rate": {"method": ["mc"], "max_tests": ["10"]},
        "check-av": {"tests": ["2"], "av": ["idm-mobil"]},
        "train": {"out": [f"{out}.safetensors"], "decisions": ["100"], "tests": ["2"]},
        "train-av": {"out": [f"{out}.safetensors"], "decisions": ["100"], "tests": ["2"]},
        "generate": {"policy": policy, "cases": ["1"], "out": [out]},
        "analyse": {"library": lib, "avoidability": ["2"]},
        "shrink": {"library": lib, "cases": ["none"], "out": [out]},
        "replay": {"library": lib, "case": ["all"]},
        "retest": {"library": lib},
        "suite build": {"libraries": lib, "out": [out], "size": ["2"], "zoo": ["idm-mobil"]},
        "r157": {"family": ["none"]},
        "query": {"library": lib, "sql": ["select 1"]},
        "variety": {"libraries": lib},
        "plausibility": {"out": [out], "budget": ["10"], "seeds": ["1"], "decisions": ["100"], "tests": ["2"]},
        "export": {"library": lib, "cases": ["all"], "to": ["csv"], "out": [out]},
        "import": {"files": [str(at.scenario)], "out": [out]},
        "cases from-data": {"files": [str(at.data)], "out": [out]},
        "ndd fit": {"files": [str(at.data)], "out": [f"{out}.npz"]},
        "ndd import": {"folder": [str(at.library)], "out": [f"{out}.npz"]},
        "ndd show": {},
        "ndd validate": {"model": [str(at.library / "model.npz")], "against": [str(at.data)], "miles": ["1000"]},
    }
    return given.get(" ".join(words), {})


def _argv(words: tuple[str, ...], command: Any, values: dict[str, Sequence[str]]) -> tuple[str, ...]:
    arguments: list[str] = []
    options: list[str] = []
    for one in command.params:
        for value in values.get(one.name, ()):
            if one.param_type_name == "argument":
                arguments.append(value)
            else:
                options.append(f"{one.opts[0]}={value}")
    return (*words, *options, "--", *arguments)


def cases(at: Inputs, out: str = "out") -> Iterator[Case]:
    """Give a command line for each hostile value of each argument and option that takes one.

    Args:
        at: Files that commands take.
        out: Where they write, below the current folder; it should be empty before each.
    """
    for words, command in _commands(typer.main.get_command(app)):
        usual = _usual(words, at, out)
        usual |= {one.name: ["1"] for one in command.params if one.name == "threads"}
        for one in command.params:
            if getattr(one, "is_flag", False):
                continue
            for value in HOSTILE:
                yield Case(words, one.name, value, _argv(words, command, {**usual, one.name: [value]}))


def verdict(argv: Sequence[str], seconds: float = 20.0) -> tuple[str, str]:
    """Run a command line in a fork of this process: one that is killed in the middle of compiling harms no other.

    Args:
        argv: All words after `cornerforge`.
        seconds: Longest time.

    Returns:
        "done" (exit status 0 or 1), "refused" (2, with one line), "badly refused" (2, with another number of lines),
        "late" or "traceback"; and what was said.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        with os.fdopen(writing, "wb") as told:
            told.write("\0".join(_told(argv)).encode("utf-8", "backslashreplace"))
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as told:
        is_told, _, _ = select.select([told], [], [], seconds)
        if not is_told:
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        what, _, said = told.read().decode().partition("\0")
    return (what, said) if what else ("late" if not is_told else "traceback", said)


def _told(argv: Sequence[str]) -> tuple[str, str]:
    said, shown = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(said):
            status = main(list(argv))
    except BaseException as error:  # whatever leaves `main` is what we look for
        return "traceback", "".join(traceback.format_exception(error))[-1000:]
    lines = [line for line in said.getvalue().split("\n") if line and not line.startswith(("Warning: ", "Compiling "))]
    if status != 2:
        return "done", shown.getvalue()[-200:] + "".join(lines)[-200:]
    right = len(lines) == 1 and lines[0].startswith("cornerforge: ") and lines[0].isprintable()
    return ("refused" if right else "badly refused"), "\n".join(lines)
