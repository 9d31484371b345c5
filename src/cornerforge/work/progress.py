"""Progress: long work reports how much of it is done."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

__all__ = ["NO_PROGRESS", "Moving", "Progress", "begin_part", "moving"]

_TICK_SECONDS = 1.0


class Progress(Protocol):
    """A function that long work calls now and then, never twice at once, as `progress(stage, done, total)`.

    Text in brackets at the end of `stage`, such as "rate (3 crashes)", may change while the stage lasts.
    """

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Report that `stage` has done `done` of `total`."""


def NO_PROGRESS(stage: str, done: float, total: float) -> None:  # noqa: N802  (a constant: the progress that says nothing)
    """Report nothing."""


def begin_part(progress: Progress, number: int, of: int, name: str) -> None:
    """Tell a progress that has `begin_part` that part `number` of `of` begins, and its name."""
    begin = getattr(progress, "begin_part", None)
    if begin is not None:
        begin(number, of, name)


class Moving:
    """Progress that also moves between two reports, by what a slow AV has answered since the last one.

    Args:
        progress: Called with the progress.
        answered: Says how many answers there were so far.
        each: How much of the work an answer is, until reports say.
    """

    def __init__(self, progress: Progress, answered: Callable[[], int], each: float) -> None:
        self._progress, self._answered, self._each = progress, answered, each
        self._lock = threading.Lock()
        self._stage, self._done, self._shown, self._total = "", 0.0, 0.0, 0.0
        self._begun = self._at = 0
        self._begun_done = 0.0
        self._failure: BaseException | None = None

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Report, as `Progress`; raises what the last `tick` ran into."""
        with self._lock:
            if self._failure is not None:
                raise self._failure
            now = self._answered()
            if self._stage == "" or done < self._done:
                self._begun, self._begun_done = now, done
            if now > self._begun and done > self._begun_done:
                self._each = (done - self._begun_done) / (now - self._begun)
            self._stage, self._done, self._total, self._at = stage, done, total, now
            self._shown = done
            self._progress(stage, done, total)

    def tick(self) -> None:
        """Report what was probably done since the last report, if something was."""
        with self._lock:
            since = self._answered() - self._at
            if self._failure is not None or self._stage == "" or since <= 0:
                return
            self._shown = max(self._shown, min(self._done + since * self._each, 0.999 * self._total))
            try:
                self._progress(self._stage, self._shown, self._total)
            except BaseException as error:
                self._failure = error


@contextmanager
def moving(
    progress: Progress, answered: Callable[[], int] | None, each: float, stage: str, done: float, total: float
) -> Iterator[Progress]:
    """Let progress move while an AV from outside answers.

    Args:
        progress: Called with the progress, at once with the finished part.
        answered: Says how many answers there were so far; None: `progress` stays as it is.
        each: How much of the work an answer is, about.
        stage, done, total: As in `Progress`.
    """
    if answered is None or progress is NO_PROGRESS:
        yield progress
        return
    told, ended = Moving(progress, answered, each), threading.Event()

    def ticking() -> None:
        while not ended.wait(_TICK_SECONDS):
            told.tick()

    thread = threading.Thread(target=ticking, daemon=True)
    told(stage, done, total)
    thread.start()
    try:
        yield told
    finally:
        ended.set()
        thread.join()
