"""Tutorials as programs: what a page tells the reader to save and to type, and whether its outputs look as it says.

A page says "Save this as `NAME`:" before a file, and shows commands in blocks marked `sh`. A block without a mark
right after one of commands is what the last command of the block prints. Numbers may differ between processors, and
tests run smaller than the page; so each line is held to its words: a number stands for any number, "..." for anything.
"""

from __future__ import annotations

import re
import runpy
import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from cornerforge.cli import main

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
SAVE = re.compile(r"Save this as `([\w.]+)`[^`]*\Z")
Smaller = Mapping[str, str | Callable[[], str]]
NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Step:
    """A file to save (`name` and its text), or commands and what the last of them prints."""

    name: str = ""
    text: str = ""
    commands: tuple[str, ...] = ()
    output: tuple[str, ...] = ()


def steps_of(page: str) -> list[Step]:
    """What a page asks for, in its order. A block of another kind asks for nothing."""
    steps: list[Step] = []
    end = 0
    for block in BLOCK.finditer(page):
        kind, text = block.groups()
        between = page[end : block.start()]
        saved = SAVE.search(between)
        if saved:
            steps.append(Step(name=saved[1], text=text))
        elif kind == "sh":
            steps.append(Step(commands=tuple(text.splitlines())))
        elif not kind and steps and steps[-1].commands and not steps[-1].output and not between.strip():
            steps[-1] = Step(commands=steps[-1].commands, output=tuple(text.splitlines()))
        end = block.end()
    return steps


def pattern_of(line: str) -> re.Pattern[str]:
    """What a line of an output must look like: its words, with any number for a number and anything for "..."."""
    parts = re.split(r"(\.\.\.)", " ".join(line.split()))
    made = []
    for part in parts:
        words = NUMBER.split(part)
        made.append(".*" if part == "..." else NUMBER.pattern.join(re.escape(word) for word in words))
    return re.compile("".join(made).replace(r"\ ", r"\s+"))


def missing_lines(output: tuple[str, ...], printed: str, loose: Mapping[str, str] = {}) -> list[str]:
    """Lines of the page's output that do not stand in what was printed, in this order.

    `loose` says what of a line depends on the cases that were found: patterns, and what stands for what they match.
    """
    lines = [" ".join(line.split()) for line in printed.splitlines()]
    missing, at = [], 0
    for said in output:
        line = said
        for pattern, instead in loose.items():
            line = re.sub(pattern, instead, line)
        if not line.strip() or line.strip() == "...":
            continue
        found = next((k for k in range(at, len(lines)) if pattern_of(line).fullmatch(lines[k])), None)
        if found is None:
            missing.append(said)
        else:
            at = found + 1
    return missing


def expanded(words: list[str], folder: Path) -> list[str]:
    """What a shell makes of a pattern."""
    return [
        part
        for word in words
        for part in (
            sorted(str(path.relative_to(folder)) for path in folder.glob(word))
            if "*" in word and " " not in word
            else [word]
        )
    ]


def run(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch, *more: str) -> int:
    """Run a command of a page in this process, as a shell would in `folder`; the exit status."""
    program, *words = shlex.split(command)
    if program == "python":
        monkeypatch.setattr(sys, "argv", [*expanded(words, folder)])
        runpy.run_path(str(ROOT / words[0]), run_name="__main__")
        return 0
    assert program == "cornerforge"
    return main([*expanded(words, folder), *more])


def walk(
    page: Path,
    folder: Path,
    smaller: Smaller,
    loose: Mapping[str, str],
    patch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> dict[str, tuple[int, str]]:
    """Do all that a page says, in `folder`; the exit status and the output of each command, as the page has it.

    Args:
        page: The tutorial.
        folder: An empty folder.
        smaller: Words of commands, and what stands for them in a test, said or computed. Each must be used.
        loose: What of outputs is not compared; see `missing_lines`.
        patch, capsys: Fixtures.
    """
    patch.chdir(folder)
    patch.syspath_prepend(str(folder))
    done: dict[str, tuple[int, str]] = {}
    used: set[str] = set()
    for step in steps_of(page.read_text(encoding="utf-8")):
        if step.name:
            (folder / step.name).write_text(step.text, encoding="utf-8")
            continue
        for command in step.commands:
            instead = command
            for words, fewer in smaller.items():
                if words in command:
                    used.add(words)
                    instead = instead.replace(words, fewer if isinstance(fewer, str) else fewer())
            capsys.readouterr()
            status = run(instead, folder, patch)
            printed = capsys.readouterr()
            done[command] = (status, printed.out)
            assert status in {0, 1}, f"{instead}: {status}\n{printed.err}"
        missing = missing_lines(step.output, printed.out, loose)
        assert not missing, f"{instead}: the page says\n{missing[0]}\nbut it prints\n{printed.out}"
    assert used == set(smaller), f"never used: {set(smaller) - used}"
    return done
