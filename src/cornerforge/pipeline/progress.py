"""How long work tells how far it is."""

from __future__ import annotations

from typing import Protocol

__all__ = ["NO_PROGRESS", "Progress"]


class Progress(Protocol):
    """Called as `progress(stage, done, total)`, now and then, from one thread.

    Text in brackets at the end of `stage`, such as "rate (3 crashes)", may change while the stage lasts.
    """

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Stage `stage` has done `done` of `total`."""


def NO_PROGRESS(stage: str, done: float, total: float) -> None:  # noqa: N802  (a constant: the progress that says nothing)
    """Say nothing."""
