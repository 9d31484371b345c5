"""Progress: long work reports how much of it is done."""

from __future__ import annotations

from typing import Protocol

__all__ = ["NO_PROGRESS", "Progress"]


class Progress(Protocol):
    """A function that long work calls now and then, from one thread, as `progress(stage, done, total)`.

    Text in brackets at the end of `stage`, such as "rate (3 crashes)", may change while the stage lasts.
    """

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Report that `stage` has done `done` of `total`."""


def NO_PROGRESS(stage: str, done: float, total: float) -> None:  # noqa: N802  (a constant: the progress that says nothing)
    """Report nothing."""
