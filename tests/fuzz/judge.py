"""One input: make it, put it through its door, and say what came of it."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import resource
import shlex
import shutil
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foreign.hostile_avs import left_behind
from fuzz.calls import call
from fuzz.damage import done
from fuzz.kinds import CONTROL, KINDS, Door, Kind
from fuzz.seeds import SEEDS, seed_folder

from cornerforge.cli import main
from cornerforge.errors import CornerForgeError
from cornerforge.foreign import interpreter

__all__ = ["FAILURES", "OUTCOMES", "Judge", "Outcome"]

OUTCOMES = (
    "same", "refused", "told", "other", "silent", "traceback", "hang", "memory", "partial", "lines", "survivor",
)  # fmt: skip
"""same: the answer for the whole file. refused: one line. told: another answer, and a warning or a failed gate. other:
another answer to what may be meant so. silent: another answer, without a word, to what could be noticed. lines: it was
refused, but not in one readable line. survivor: a process that it started lives on."""
FAILURES = ("silent", "traceback", "hang", "memory", "partial", "lines", "survivor")
_BY_NAME = {kind.name: kind for kind in (*KINDS, CONTROL)}
_LONGEST_LINE = 3000
_TIMES = (
    "written", "seconds", "cpu_seconds", "point_seconds", "world_steps_per_second", "tests_per_second", "sha256",
)  # fmt: skip
"""Keys whose values differ from run to run, and the checksums over them."""
_TIMES_SHOWN = re.compile(rb">(written|seconds)</th><td[^>]*>[^<]*<")
"""The same on a page."""
_MEMORY = 2 * 2**30
"""More memory than this for one small input is a fault [bytes]."""


@dataclass(frozen=True)
class Outcome:
    """What came of an input: one of `OUTCOMES`, the line or the frame that says more, and where it was raised."""

    what: str
    detail: str = ""


@dataclass(frozen=True)
class _Run:
    """What a door did: exit status, answer, words besides, files made, and the error that came out if any."""

    status: int
    answer: Any
    words: str
    files: dict[str, Any]
    error: BaseException | None = None


_Files = dict[str, tuple[tuple[int, ...], Any]]
"""Files by name: what tells whether one was changed, and its content as it is compared."""


def _made(folder: Path, before: _Files) -> dict[str, Any]:
    """The files that were made or changed, with their content."""
    made: dict[str, Any] = {}
    for name, (mark, content) in _files(folder, before).items():
        was = before.get(name)
        if was is None or (was[0] != mark and _text(was[1]) != _text(content)):
            made[name] = content
    return made


def _files(folder: Path, known: _Files) -> _Files:
    """The files of a folder: of JSON its values, else a hash; what is no plain file: its kind.

    Args:
        folder: The folder.
        known: Files that were read before; what has the same mark is not read again.
    """
    found: _Files = {}
    for path in sorted(folder.rglob("*")):
        name, status = str(path.relative_to(folder)), path.lstat()
        mark = status.st_mode, status.st_size, status.st_mtime_ns
        if name in known and known[name][0] == mark:
            found[name] = known[name]
        else:
            found[name] = mark, _content(path)
    return found


def _content(path: Path) -> Any:
    if path.is_symlink() or not path.is_file():
        return "folder" if path.is_dir() and not path.is_symlink() else "odd"
    if path.stat().st_size > 2**31:
        return "sparse"
    content = path.read_bytes()
    if path.suffix == ".json":
        with contextlib.suppress(ValueError, RecursionError):
            found = json.loads(content)
            return (
                {key: value for key, value in found.items() if key not in _TIMES} if isinstance(found, dict) else found
            )
    if path.suffix == ".html":
        content = _TIMES_SHOWN.sub(b"", content)
    return hashlib.sha256(content).hexdigest()


def _masked(answer: Any, other: Any) -> Any:
    """What of an answer is the same in another run of the same: times, for example, are not."""
    if isinstance(answer, dict) and isinstance(other, dict):
        return {key: _masked(answer[key], other[key]) for key in answer if key in other}
    if isinstance(answer, list) and isinstance(other, list) and len(answer) == len(other):
        return [_masked(a, b) for a, b in zip(answer, other, strict=True)]
    return answer if _text(answer) == _text(other) else "@differs"


def _like(mask: Any, answer: Any) -> Any:
    """Cut an answer to what a mask keeps; keys that the mask lacks stay."""
    if mask == "@differs":
        return mask
    if isinstance(mask, dict) and isinstance(answer, dict):
        return {key: _like(mask.get(key), value) for key, value in answer.items() if key not in _TIMES}
    if isinstance(mask, list) and isinstance(answer, list) and len(mask) == len(answer):
        return [_like(a, b) for a, b in zip(mask, answer, strict=True)]
    return answer


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=str)


class Judge:
    """Runs inputs, each in a folder of its own.

    Args:
        seeds: Where seeds are kept; made when they are first needed.
        room: Folder for the inputs.
    """

    def __init__(self, seeds: Path, room: Path) -> None:
        self._seeds, self._room = seeds, room
        self._whole: dict[tuple[str, str], tuple[Any, Any]] = {}
        self._seed_files: dict[str, _Files] = {}

    def prepare(self, one: dict[str, Any]) -> None:
        """Make what an input needs: its seed, and the answer for the whole file."""
        kind = _BY_NAME[one["kind"]]
        seed_folder(self._seeds, kind.seed)
        if kind.words is None:
            self._answer(kind, self._door(kind, one))
        elif kind.plain is not None:
            words = kind.plain(one["words"])
            if (kind.name, shlex.join(words)) not in self._whole:
                self._whole[kind.name, shlex.join(words)] = None, None
                with self._folder(kind) as folder:
                    self._spoken(kind, words, folder)

    def run(self, one: dict[str, Any]) -> Outcome:
        """Run an input.

        Args:
            one: As `kinds.draw_input` draws it.

        Raises:
            LookupError: Its recipe fits its seed no more.
        """
        kind = _BY_NAME[one["kind"]]
        with self._folder(kind) as folder:
            if kind.words is not None:
                return self._spoken(kind, one["words"], folder)
            whole, mask = self._answer(kind, self._door(kind, one))
            for recipe in one["damage"]:
                done(folder, recipe)
            before = _files(folder, self._of_seed(kind))
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            run = self._through(self._door(kind, one), folder, before)
            fault = self._fault(run, folder, memory)
            if fault is not None:
                return fault
            if run.error is not None or run.status == 2:
                return Outcome("refused", run.words)
            answer = _like(mask, [run.answer, run.files])
            if _text(answer) == _text(whole):
                return Outcome("same")
            if run.words or run.status == 1:
                return Outcome("told", run.words)
            found = _difference(whole, answer)
        matters = [recipe for recipe in one["damage"] if kind.matters(recipe, self._door(kind, one))]
        if not matters:
            return Outcome("other", found)
        if len(one["damage"]) == 1:
            return Outcome("silent", found)
        # Which of them changed the answer shows each one alone.
        alone = [self.run({**one, "damage": [recipe]}) for recipe in matters]
        return next((outcome for outcome in alone if outcome.what in (*FAILURES, "silent")), Outcome("other", found))

    def _of_seed(self, kind: Kind) -> _Files:
        """The files of a seed, which are copied with their times."""
        if kind.seed not in self._seed_files:
            self._seed_files[kind.seed] = _files(seed_folder(self._seeds, kind.seed), {})
        return self._seed_files[kind.seed]

    @staticmethod
    def _door(kind: Kind, one: dict[str, Any]) -> Door:
        return next(door for door in kind.doors if door.name == one["door"])

    @contextlib.contextmanager
    def _folder(self, kind: Kind) -> Any:
        folder = self._room / f"input-{os.getpid()}"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(seed_folder(self._seeds, kind.seed), folder, symlinks=True)
        if kind.name == "checkpoint":
            (folder / "whole.safetensors").symlink_to(seed_folder(self._seeds, kind.seed) / "p.safetensors.checkpoint")
        if kind.words is not None:
            with contextlib.chdir(folder):
                SEEDS["nothing"](self._seeds)
        here = os.getcwd()
        try:
            yield folder
        finally:
            os.chdir(here)
            shutil.rmtree(folder, ignore_errors=True)

    def _answer(self, kind: Kind, door: Door) -> tuple[Any, Any]:
        """The answer for the whole seed, and the mask of what is the same in each run."""
        key = kind.name, door.name
        if key not in self._whole:
            runs = []
            for _ in range(2):
                with self._folder(kind) as folder:
                    run = self._through(door, folder, _files(folder, self._of_seed(kind)))
                    if run.error is not None or run.status > 1:
                        raise RuntimeError(
                            f"{key}: the whole seed is refused: {run.words} {run.error!r}"
                        ) from run.error
                    runs.append([run.answer, run.files])
            mask = _masked(*runs)
            self._whole[key] = _like(mask, runs[0]), mask
        return self._whole[key]

    def _spoken(self, kind: Kind, words: list[str], folder: Path) -> Outcome:
        before = _files(folder, self._of_seed(kind))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        door = Door("words", (lambda: call(*words)) if kind.name == "interface" else shlex.join(words))
        run = self._through(door, folder, before, words)
        return self._fault(run, folder, memory, words) or Outcome(
            "refused" if run.status == 2 or run.error else "told", run.words
        )

    def _through(self, door: Door, folder: Path, before: _Files, words: list[str] | None = None) -> _Run:
        out, err = io.StringIO(), io.StringIO()
        interpreter.AT_WORK.clear()  # AVs of earlier inputs, which nothing holds, but which are not collected yet
        answer: Any = None
        status, error = 0, None
        os.chdir(folder)
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            warnings.catch_warnings(record=True) as told,
        ):
            warnings.simplefilter("always")
            try:
                if callable(door.argv):
                    answer = door.argv()
                else:
                    status = main(words if words is not None else shlex.split(door.argv))
            except BaseException as raised:
                error = raised
        if not callable(door.argv):
            answer = out.getvalue()
            with contextlib.suppress(ValueError):
                answer = json.loads(answer)
        lines = [
            line
            for line in err.getvalue().splitlines()
            if line.strip() and not line.startswith(("Compiling a part", "stage "))
        ]
        lines += [str(one.message) for one in told if issubclass(one.category, UserWarning) or callable(door.argv)]
        if error is not None:
            lines.append(str(error))
        if status > 128:
            error = error or RuntimeError(f"exit status {status}")
        return _Run(status, answer, "\n".join(lines), _made(folder, before), error)

    def _fault(self, run: _Run, folder: Path, memory: int, words: list[str] | None = None) -> Outcome | None:
        """Say what is wrong with a run whatever was read."""
        if isinstance(run.error, MemoryError):
            return Outcome("memory", _frame(run.error))
        if run.error is not None and not isinstance(run.error, (CornerForgeError, OSError)):
            return Outcome("traceback", _frame(run.error))
        if isinstance(run.error, OSError) and not isinstance(run.error, CornerForgeError):
            return Outcome("lines", _frame(run.error))
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) * 1024
        if grown > _MEMORY:
            return Outcome("memory", f"{grown / 2**30:.1f} GiB")
        # What was asked for by such a name is no part of a file.
        alive = left_behind(folder)
        if alive:
            return Outcome("survivor", f"processes {alive} live on")
        left = [
            name for name in run.files
            if (name.endswith((".part", ".tmp", ".part.npz")) or "/.part" in name) and name not in (words or ())
        ]  # fmt: skip
        if left:
            return Outcome("partial", " ".join(left))
        if run.error is not None or run.status == 2:
            said = [line for line in run.words.splitlines() if not line.startswith("Warning:")]
            if run.error is not None:
                said = str(run.error).splitlines()
            if len(said) != 1 or (run.error is None and not said[0].startswith("cornerforge: ")):
                return Outcome("lines", f"not one line: {run.words[:300]}")
            if len(said[0]) > _LONGEST_LINE:
                return Outcome("lines", f"a long line: {said[0][:200]}")
            if said[0].removeprefix("cornerforge: ").startswith("[Errno"):
                return Outcome("lines", f"raw: {said[0][:200]}")
            # A folder that says what it is may be gone on with; whatever else a refused command leaves is half made,
            # but for `alive`, which a hostile AV writes.
            homes = {
                str(Path(name).parent) for name in run.files if Path(name).name in ("provenance.json", "manifest.json")
            }
            half = [
                name for name, content in run.files.items()
                if content != "folder" and name != "alive"
                and not any(home == "." or name.startswith(home) for home in homes)
            ]  # fmt: skip
            if half:
                return Outcome("partial", f"refused, but left {' '.join(half[:3])}: {run.words[:150]}")
        for name in run.files:
            path = folder / name
            if path.suffix == ".json" and path.is_file() and path.stat().st_size == 0:
                return Outcome("partial", f"empty {name}")
        return None


def _difference(whole: Any, answer: Any, place: str = "") -> str:
    """Name the first place where two answers differ."""
    if isinstance(whole, dict) and isinstance(answer, dict):
        for key in [*whole, *(k for k in answer if k not in whole)]:
            if key not in whole or key not in answer:
                return f"{place}.{key} is {'missing' if key in whole else 'new'}"
            if _text(whole[key]) != _text(answer[key]):
                return _difference(whole[key], answer[key], f"{place}.{key}")
    if isinstance(whole, list) and isinstance(answer, list) and len(whole) == len(answer):
        for i, (a, b) in enumerate(zip(whole, answer, strict=True)):
            if _text(a) != _text(b):
                return _difference(a, b, f"{place}[{i}]")
    return f"{place}: {_text(whole)[:60]} -> {_text(answer)[:60]}"


def _frame(error: BaseException) -> str:
    """The error in a line, with the innermost frame of cornerforge."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/cornerforge/" in f.filename] or list(frames)
    where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno} {ours[-1].name}" if ours else "?"
    return f"{type(error).__name__} at {where}: {str(error)[:160]!r}"
