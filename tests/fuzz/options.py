"""Hostile values for every argument and option of every command, one at a time, in calls that are cheap otherwise.

`cases` gives the command lines; `hostile_options` draws one.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer

from cornerforge.cli import app

__all__ = ["HOSTILE", "Case", "Inputs", "cases", "hostile_options", "plain_options"]

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
        scenario: An OSI trace.
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


_AT = Inputs(
    Path("lib"), Path("p.safetensors"), Path("ngsim.csv"), Path("imported/cases/cut_in.json"), Path("traces/cut_in.osi")
)


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
        "retest": {"library": lib, "av": ["idm-mobil"]},
        "suite build": {"libraries": lib, "out": [out], "size": ["2"], "zoo": ["idm-mobil"]},
        "suite run": {"suite": ["aeb"], "family": ["none"]},
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


def _one_thread(command: Any) -> dict[str, Sequence[str]]:
    return {one.name: ["1"] for one in command.params if one.name == "threads"}


def cases(at: Inputs, out: str = "out") -> Iterator[Case]:
    """Give a command line for each hostile value of each argument and option that takes one.

    Args:
        at: Files that commands take.
        out: Where they write, below the current folder; it should be empty before each.
    """
    for words, command in _commands(typer.main.get_command(app)):
        usual = _usual(words, at, out)
        usual |= _one_thread(command)
        for one in command.params:
            if getattr(one, "is_flag", False):
                continue
            for value in HOSTILE:
                yield Case(words, one.name, value, _argv(words, command, {**usual, one.name: [value]}))


def hostile_options(rng: np.random.Generator) -> list[str]:
    """Draw one of `cases`, for a folder as of the seed "everything"."""
    every = _every()
    return list(every[int(rng.integers(len(every)))].argv)


def plain_options(argv: list[str]) -> list[str]:
    """The command of a drawn line with nothing odd."""
    case = next(case for case in _every() if list(case.argv) == argv)
    command = dict(_commands(typer.main.get_command(app)))[case.words]
    return list(_argv(case.words, command, _usual(case.words, _AT, "out") | _one_thread(command)))


@functools.cache
def _every() -> tuple[Case, ...]:
    return tuple(case for case in cases(_AT) if case.words != ("serve",))  # which never ends when it is right
