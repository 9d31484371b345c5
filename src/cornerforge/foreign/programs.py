"""An AV that is a program of its own: it is asked in lines of JSON on its standard input, and answers on its output.

docs/av-programs.md describes the lines. All questions of a moment are written before all answers are there, so a
program with several threads may answer in any order. Needs Python and NumPy only.
"""

from __future__ import annotations

import hashlib
import json
import os
import selectors
import shlex
import shutil
import signal
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge.errors import InputError
from cornerforge.foreign.drivers import (
    EndedError,
    UnusableError,
    WorldDriver,
)
from cornerforge.foreign import site_scene
from cornerforge.foreign.interface import ANSWERS, AT_SITES, NEAREST
from cornerforge.foreign.scene import COLUMNS, KINDS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.foreign.interface import AvContext

__all__ = ["PREFIX", "PROTOCOL", "Program", "ProgramDriver", "is_program"]

PREFIX = "cmd:"
PROTOCOL = 1
"""Version of the lines."""
_MOST_LINE = 16_000_000
_END = b"\n"
_UNASKED = "its program printed a line that nothing had asked for"
_READ = 1 << 16
_TIME, _LEFT, _CURVATURE, _TARGET = (
    COLUMNS.index(name) for name in ("time", "left_to_drive", "curvature", "target_lane")
)
_WHOLE = ("id", "indicator", "lane")
_OF_BOXES = COLUMNS[:14]
_BOX = "{%s}" % ",".join(  # noqa: UP031 - a template with places
    f'"{name}":"%s"' if name == "kind" else f'"{name}":%d' if name in _WHOLE else f'"{name}":%r' for name in _OF_BOXES
)
_SCENE = (
    '{"type":"scene","world":%d,"time":%r,"target_lane":%d,"curvature":%r,"left_to_drive":%r,"own":%s,"others":[%s]}\n'
)
_KNOWN = ("type", "answers", "objects", "memory")


def is_program(spec: str) -> bool:
    """Does this name an AV that is a program?

    >>> is_program("cmd: ./planner --flag"), is_program("my_av:MyAv")
    (True, False)
    """
    return spec.startswith(PREFIX)


def _quoted(line: bytes) -> str:
    text = line.decode(errors="backslashreplace").rstrip("\r\n")
    return repr(text if len(text) <= 100 else text[:100] + "...")


class Program:
    """A program that was started and has said what it is.

    Args:
        spec: As behind --av: "cmd: PROGRAM ARGUMENTS", in the words of a shell; nothing is expanded.

    Attributes:
        hash_parts: What decides how it drives: its words, the program file, and the first argument that is a file.
        answers, objects, memory: As of `interface.Planner`.

    Raises:
        InputError: There is no such program, it cannot be started, or it does not say hello as it should.
        EndedError: It ended.
    """

    def __init__(self, spec: str) -> None:
        self._spec = spec
        try:
            words = shlex.split(spec[len(PREFIX) :])
        except ValueError as error:
            raise InputError(f"{spec} cannot be read as words of a shell: {error}.") from error
        if not words:
            raise InputError(f'{spec} names no program; write it as "cmd: ./planner --flag".')
        path = shutil.which(words[0])
        if path is None:
            why = "it may not be run (chmod +x)" if Path(words[0]).is_file() else f"looked in {Path.cwd()} and PATH"
            raise InputError(f"No program {words[0]} for the AV {spec}; {why}.")
        script = next((word for word in words[1:] if not word.startswith("-") and Path(word).is_file()), None)
        files = [path] if script is None else [path, script]
        self.hash_parts = [json.dumps(words).encode(), *(_digest(file) for file in files)]
        try:
            self._popen = subprocess.Popen(
                words, executable=path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
            )
        except OSError as error:
            raise InputError(
                f"The program of the AV {spec} cannot be started: {error.strerror}. A script needs a first line such "
                "as #!/bin/sh."
            ) from error
        assert self._popen.stdin is not None
        assert self._popen.stdout is not None
        self._to, self._from = self._popen.stdin.fileno(), self._popen.stdout.fileno()
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        self._rest = b""
        try:
            self._hello()
        except BaseException:
            self.close()
            raise

    def _hello(self) -> None:
        line = self._one({"type": "hello", "protocol": PROTOCOL}, is_first=True)
        said = _object_of(line)
        if said is None or said.get("type") != "hello":
            raise InputError(
                f'The AV {self._spec} did not say hello, such as {{"type":"hello","answers":"lane"}}; it printed '
                f"{_quoted(line)} (docs/av-programs.md)."
            )
        unknown = sorted(set(said) - set(_KNOWN))
        if unknown:
            raise InputError(
                f"The hello of the AV {self._spec} has {unknown[0]!r}; allowed: {', '.join(_KNOWN)}. It printed "
                f"{_quoted(line)}."
            )
        self.answers = said.get("answers", "lane")
        self.objects = said.get("objects", site_scene.AGENTS if self.answers == AT_SITES else NEAREST)
        self.memory = said.get("memory", True)
        whole = isinstance(self.objects, int) and not isinstance(self.objects, bool) and self.objects >= 0
        for name, value, fine, allowed in (
            ("answers", self.answers, self.answers in ANSWERS, ", ".join(ANSWERS)),
            ("objects", self.objects, whole or self.objects is None, "a number from 0 on, or null for all"),
            ("memory", self.memory, isinstance(self.memory, bool), "true or false"),
        ):
            if not fine:
                raise InputError(
                    f"The hello of the AV {self._spec} says {name} = {json.dumps(value)}; allowed: {allowed}."
                )

    def setup(self, context: AvContext) -> None:
        """Tell the program its world, and wait until it is ready.

        Raises:
            EndedError, UnusableError: It ended, or said something else than that it is ready.
        """
        about = {"type": "setup"} | context.stated() | {"speed_limit": context.speed_limit}
        line = self._one(about)
        if (_object_of(line) or {}).get("type") != "ready":
            raise UnusableError(f'after "setup" its program printed {_quoted(line)} instead of {{"type":"ready"}}')

    def _one(self, said: dict[str, Any], *, is_first: bool = False) -> bytes:
        """Say one thing, and read the one line that answers it."""
        line, *more = self.exchange(json.dumps(said, separators=(",", ":")) + "\n", 1, is_first=is_first)
        if more and not is_first:  # what a program prints before it says hello is told by the caller
            raise UnusableError(f"{_UNASKED}: {_quoted(more[0])}")
        return line

    def exchange(self, text: str, lines: int, *, is_first: bool = False) -> list[bytes]:
        """Write lines, and at the same time read so many; more, if more come: then it is not all read.

        Raises:
            EndedError: The program ended.
            UnusableError: It printed before it was asked, or a line without an end.
        """
        if not is_first and (self._rest or self._has_printed()):
            raise UnusableError(f"{_UNASKED}: {_quoted(self._rest.partition(_END)[0])}")
        left, found = memoryview(text.encode()), list[bytes]()
        with selectors.DefaultSelector() as selector:
            selector.register(self._to, selectors.EVENT_WRITE)
            selector.register(self._from, selectors.EVENT_READ)
            while len(found) <= lines and (left or len(found) < lines):
                for key, _ in selector.select():
                    if key.fd == self._to:
                        left = left[self._written(left) :]
                        if not left:
                            selector.unregister(self._to)
                    else:
                        self._read_some()
                        *whole, self._rest = self._rest.split(_END)
                        found += whole
        return found

    def _written(self, left: memoryview) -> int:
        try:
            return os.write(self._to, left[:_READ])
        except BlockingIOError:
            return 0
        except BrokenPipeError:
            return len(left)  # it has closed its input; what it still says comes first

    def _has_printed(self) -> bool:
        with suppress(BlockingIOError):
            self._read_some()
        return bool(self._rest)

    def _read_some(self) -> None:
        content = os.read(self._from, _READ)
        if not content:
            self._raise_end()
        self._rest += content
        if len(self._rest) > _MOST_LINE and _END not in self._rest:
            raise UnusableError(f"its program printed a line of more than {_MOST_LINE:,} bytes: {_quoted(self._rest)}")

    def _raise_end(self) -> None:
        """Say how the program ended.

        Raises:
            EndedError: Always.
        """
        with suppress(subprocess.TimeoutExpired):
            self._popen.wait(timeout=2.0)
        status = self._popen.returncode
        if status is None:
            how = "its program closed its standard output"
        elif status < 0:
            names = {one.value: one.name for one in signal.Signals}
            how = f"ended its program (signal {names.get(-status, -status)})"
        else:
            how = f"ended its program (exit status {status})"
        last = f"; it had begun the line {_quoted(self._rest)}" if self._rest else ""
        raise EndedError(how + last)

    def close(self) -> None:
        """End the program."""
        self._popen.kill()
        for stream in (self._popen.stdin, self._popen.stdout):
            if stream is not None:
                stream.close()
        self._popen.wait()


def _digest(path: str) -> bytes:
    """Hash a file's content."""
    whole = hashlib.sha256()
    try:
        with open(path, "rb") as file:
            while content := file.read(1 << 20):
                whole.update(content)
    except OSError:  # a program may be run that may not be read
        return b"unreadable"
    return whole.digest()


def _object_of(line: bytes) -> dict[str, Any] | None:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


class ProgramDriver(WorldDriver):
    """Asks a program about all worlds that are driving, a line for each."""

    def __init__(self, av: Program) -> None:
        super().__init__(av)
        self.about["remembers"] = "yes" if av.memory else "no"
        self._told: list[str] = []

    def setup(self, context: AvContext) -> None:
        """Tell the program its world."""
        self.context = context
        self.av.setup(context)

    def close(self) -> None:
        """End the program."""
        self.av.close()

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Tell it with the next question that tests begin."""
        self._told += [
            '{"type":"reset","world":%d,"seed":%d}\n' % pair  # noqa: UP031 - fast
            for pair in zip(worlds.tolist(), seeds.tolist())  # noqa: B905 - for Python 3.9
        ]

    def given(self, scenes: Any) -> dict[int, NDArray[np.float64]]:
        """Ask about all worlds that drive, and take the answers in any order."""
        asked = np.flatnonzero(scenes.running).tolist()
        question = _question_at_site if self.form == AT_SITES else _question
        questions = [question(b, scenes.table[b].tolist()) for b in asked]
        text, self._told = "".join(self._told + questions), []
        waiting, answers = set(asked), dict[int, Any]()
        for line in self.av.exchange(text, len(asked)):
            said = _object_of(line)
            if said is None:
                raise UnusableError(
                    f"its program printed a line that is no JSON object: {_quoted(line)}; text for people belongs on "
                    "standard error"
                )
            b = said.get("world")
            if not isinstance(b, int) or isinstance(b, bool) or b not in waiting:
                why = "answered twice" if b in asked else "was not asked"
                raise UnusableError(f"its program answered for world {json.dumps(b)}, which {why}: {_quoted(line)}")
            waiting.remove(b)
            if "error" in said:
                self.failed[b] = "raised", f"reported: {' '.join(str(said['error']).split())[:300]}"
                continue
            try:
                answers[b] = self._answer_of(said)
            except UnusableError as error:
                self.failed[b] = "answer", f"gave no usable answer: {error}: {_quoted(line)}"
        return answers

    def _answer_of(self, said: dict[str, Any]) -> NDArray[np.float64]:
        if "answer" not in said:
            raise UnusableError('it has neither "answer" nor "error"')
        return self._read(said["answer"], (), "it")


def _question(b: int, rows: list[list[float]]) -> str:
    boxes = [_BOX % (row[0], KINDS[int(row[1])], *row[2:14]) for row in rows if row[0] >= 0.0]
    own = rows[0]
    return _SCENE % (
        b, own[_TIME], own[_TARGET], own[_CURVATURE], own[_LEFT], boxes[0], ",".join(boxes[1:]),
    )  # fmt: skip


def _question_at_site(b: int, rows: list[list[float]]) -> str:
    agents = [dict(zip(site_scene.AGENT, row)) for row in (rows[0], *rows[site_scene.FIRST_AGENT :])]  # noqa: B905
    shown: list[dict[str, Any]] = [
        agent | {"id": int(agent["id"]), "kind": site_scene.KINDS[int(agent["kind"])], "priority": int(agent["priority"])}
        for agent in agents
        if agent["id"] >= 0.0
    ]
    moment: dict[str, Any] = dict(zip(site_scene.MOMENT, rows[1]))  # noqa: B905 - for Python 3.9
    moment["light"] = site_scene.LIGHTS[int(moment["light"])]
    path = [dict(zip(site_scene.PATH, row)) for row in rows[2 : site_scene.FIRST_AGENT]]  # noqa: B905
    question = {"type": "scene", "world": b, **moment, "own": shown[0], "path": path, "agents": shown[1:]}
    return json.dumps(question, separators=(",", ":")) + "\n"
