"""How long a job with an AV from outside will take, by the speed that was measured; said before anything long."""

from __future__ import annotations

from cornerforge._words import spoken
from cornerforge.experiment.experiments import Experiment
from cornerforge.foreign.pace import announce

__all__ = ["LONG_SECONDS", "forecast"]

LONG_SECONDS = 20.0
"""Jobs that take longer are announced [s]."""


def forecast(
    run: Experiment,
    threads: int | None,
    what: str,
    *,
    tests: float = 0.0,
    decisions: float = 0.0,
    bound: str = "about ",
    advice: str = "",
) -> None:
    """Announce how long a job will take, if that is long.

    Args:
        run, threads, tests, decisions: As for `Experiment.seconds_of`.
        what: The job, in words.
        bound: Stands before the time: "about ", "up to ", "at least ".
        advice: Sentence at the end.
    """
    seconds = run.seconds_of(threads, tests=tests, decisions=decisions)
    if seconds >= LONG_SECONDS:
        announce(f"{run.pace_text(threads)}: {what} will take {bound}{spoken(seconds)}.{advice and ' ' + advice}")
