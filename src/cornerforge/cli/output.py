"""Output for people: progress bars, and the object or the text at the end."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from cornerforge._locks import claims
from cornerforge._words import few_digits, spoken
from cornerforge.cli.config import this_call
from cornerforge.errors import printable

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

__all__ = [
    "EXIT_GATE",
    "Bars",
    "compiling_text",
    "run_command",
]

T = TypeVar("T")
EXIT_GATE = 1
"""Exit status when a gate or a comparison failed."""


_EACH_SECONDS = 60.0
"""Where there is no terminal, a stage that lasts says every so often how far it is [s]."""


class Bars:
    """Progress on standard error: on a terminal bars, one per stage, with rate and time left; else a line per stage.

    Args:
        quiet: Say nothing.
        lines: Where there is no terminal, say of each stage that has ended how long it took and which one is next, and
            each minute how far it is.
    """

    def __init__(self, quiet: bool, *, lines: bool = False) -> None:
        self.show = not quiet and sys.stderr.isatty()
        self._lines = lines and not quiet and not self.show
        self._bars: RichProgress | None = None
        self._stage = ""
        self._task: TaskID | None = None
        self._number, self._of, self._title = 0, 0, ""
        self._done = self._total = 0.0
        self._begun = self._told = time.monotonic()
        self._lock, self._over = threading.RLock(), threading.Event()
        if self._lines:
            threading.Thread(target=self._tick, daemon=True).start()

    def _tick(self) -> None:
        """Look every few seconds whether something must be said: work may report nothing for long."""
        while not self._over.wait(0.1 * _EACH_SECONDS):
            self.tell()

    def begin_part(self, number: int, of: int, name: str) -> None:
        """Take it that the present stage has ended, and that part `number` of `of`, so named, begins."""
        if self._lines:
            with self._lock:
                self._end_stage(f"; next: {name}")
                self._number, self._of, self._title = number, of, name

    def _end_stage(self, after: str = "") -> None:
        """Say how long the present stage took, if there is one, and what comes `after`, which begins now."""
        now = time.monotonic()
        took, self._begun, self._told = now - self._begun, now, now
        self._done = self._total = 0.0
        if not self._stage:
            return
        if not self._of:
            self._number += 1
        self._say(0, f"{took:.{0 if took >= 10.0 else 1}f} s{after}")
        self._stage = ""

    def _say(self, ahead: int, text: str) -> None:
        """Say something of the stage whose number is `ahead` of the last one."""
        number = f"{self._number + ahead}" + (f" of {self._of}" if self._of else "")
        typer.echo(f"stage {number}: {self._stage or self._title}, {text}", err=True)

    def tell(self) -> None:
        """Say how far the stage is and how long it will still take, if nothing was said for a minute."""
        with self._lock:
            now, done, total = time.monotonic(), self._done, self._total
            if now - self._told < _EACH_SECONDS or not (self._stage or self._title):
                return
            self._told, spent = now, now - self._begun
            left = f", about {spoken(spent * (total - done) / done)} left" if 0.0 < done < total else ""
            share = f"{100.0 * done / total:.0f} % " if total > 0.0 else ""
            self._say(0 if self._of else 1, f"{share}after {spoken(spent)}{left}")

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Draw; a new stage gets a new bar, or ends the line of the one before."""
        stage = printable(stage)
        name = stage.partition(" (")[0]  # what stands in brackets may change while a stage lasts
        if self._lines:
            with self._lock:
                if name != self._stage:
                    begun, before, told = self._stage == "", self._begun, self._told
                    self._end_stage()
                    if begun:  # what came before the first report belongs to it
                        self._begun, self._told = before, told
                    self._stage = name
                self._done, self._total = done, total
                self.tell()
        if not self.show:
            return
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        if self._bars is None:
            columns = (
                TextColumn("{task.description:>16}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[rate]}"),
            )
            self._bars = Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=Console(stderr=True))
            self._bars.start()
        if name != self._stage or self._task is None:
            self._stage = name
            # Work of an earlier session does not count for the speed of this one.
            self._task = self._bars.add_task(stage, total=total, completed=int(done), rate="")
        speed = self._bars.tasks[self._task].speed
        text = f"{few_digits(speed)}/s" if speed else ""
        self._bars.update(self._task, description=stage, completed=done, total=total, rate=text)

    def stop(self, *, finished: bool = False) -> None:
        """Leave the bars as they are; `finished`: the last stage has ended."""
        self._over.set()
        if self._lines and finished:
            self._end_stage()
        if self._bars is not None:
            self._bars.stop()


@claims()
def run_command(
    work: Callable[[Bars, Callable[[T], None]], T],
    text: Callable[[T], str],
    *,
    as_json: bool,
    quiet: bool,
    out: Path | None = None,
    at: tuple[str, str | None, int | None] = ("threads", None, None),
    stages: bool = False,
    early: bool = False,
) -> T:
    """Do the work with progress bars, then print its result as JSON or the text made of it.

    Args:
        work: Makes the result, a dataclass of `cornerforge.results`; it is handed the bars, and what tells a result.
        text: Makes of it what people read.
        as_json: Print JSON.
        quiet: Print no text, but for an early result.
        out: New file that the JSON goes to as well; for commands without output of their own.
        at: Where it is done: engine, address and workers of `cornerforge.engine`.
        stages: It may take minutes; without a terminal, say on standard error what each of its stages took.
        early: The work tells its result itself, before it ends.
    """
    from cornerforge._jit import announce_compiling
    from cornerforge.experiment.output import called_with, check_new_file, write_json
    from cornerforge.foreign.pace import announced
    from cornerforge.results import as_json as result_as_json
    from cornerforge.work import engine

    if out is not None:
        check_new_file(out)

    def tell(result: T) -> None:
        content = result_as_json(result)
        if out is not None:
            write_json(out, content, checksum=False)
        if as_json:
            typer.echo(json.dumps(content, allow_nan=False))
        elif early or not quiet:  # a server's address is what the command is for
            typer.echo(printable(text(result)))
        sys.stdout.flush()

    bars = Bars(quiet, lines=stages)
    try:
        compiling = announce_compiling(lambda: None if quiet else typer.echo(compiling_text(), err=True))
        told = announced(lambda text: None if quiet else typer.echo(printable(text), err=True))
        call = this_call()
        with (
            engine(at[0], address=at[1], workers=at[2]), compiling, told, called_with(call.stated()),
            call.finding_modules(),
        ):  # fmt: skip
            result = work(bars, tell)
        bars.stop(finished=True)
    finally:
        bars.stop()
    if not early:
        tell(result)
    return result


def compiling_text() -> str:
    """Why the first start takes so long, in one line."""
    from cornerforge._kernel_cache import cache_folder

    if cache_folder():
        return (
            "Compiling a part of the simulator that was not used before: half a minute, more on a busy machine; "
            "then it is kept."
        )
    return (
        "Compiling the simulator for this run only, half a minute or more: no folder for its machine code can be "
        "written; name one in NUMBA_CACHE_DIR."
    )
