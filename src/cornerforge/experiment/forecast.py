"""How long a job with an AV from outside will take, by the speed that was measured; said before anything long."""

from __future__ import annotations

from cornerforge._words import spoken
from cornerforge.execution import default_threads
from cornerforge.experiment.setting import Experiment
from cornerforge.foreign.driver import answers_per_second, answers_per_test
from cornerforge.foreign.pace import announce

__all__ = ["LONG_SECONDS", "forecast", "pace_text", "seconds_of", "tests_per_hour"]

LONG_SECONDS = 20.0
"""Jobs that take longer are announced [s]."""


def seconds_of(run: Experiment, threads: int | None, *, tests: float = 0.0, decisions: float = 0.0) -> float:
    """Say how long an AV from outside takes for a job [s], about; 0 for a built-in one.

    Tests are taken to be driven to their ends. More processes than cores are taken to help no further.

    Args:
        run: The experiment.
        threads: As the user gave it.
        tests: Tests to drive.
        decisions: Decisions of a training.
    """
    av = run.foreign
    if av is None:
        return 0.0
    each = av.pace.seconds_per_answer(av.batch)
    processes = min(run.processes(threads), default_threads())
    seconds = tests * answers_per_test(run.setting) * each / max(1.0, min(processes, tests))
    group = av.group_size(512, processes)
    asked = decisions * answers_per_second(run.setting)
    return seconds + asked * av.pace.seconds_per_answer(group) / max(1, min(processes, -(-512 // group)))


def tests_per_hour(run: Experiment, threads: int | None) -> float:
    """Say how many tests an AV from outside drives in an hour, about."""
    return 3600.0 * 1000.0 / seconds_of(run, threads, tests=1000)


def pace_text(run: Experiment, threads: int | None) -> str:
    """Say how fast an AV from outside is: its time for an answer, worlds together, processes."""
    av = run.foreign
    assert av is not None
    each = av.pace.usual(av.batch) / av.batch
    together = "one world at a time" if av.batch == 1 else f"{av.batch} worlds at a time"
    n = run.processes(threads)
    return (
        f"{av.spec} takes about {spoken(each)} for an answer (measured), {together}, "
        f"in {n} {'process' if n == 1 else 'processes'}"
    )


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
        run, threads, tests, decisions: As for `seconds_of`.
        what: The job, in words.
        bound: Stands before the time: "about ", "up to ", "at least ".
        advice: Sentence at the end.
    """
    seconds = seconds_of(run, threads, tests=tests, decisions=decisions)
    if seconds >= LONG_SECONDS:
        announce(f"{pace_text(run, threads)}: {what} will take {bound}{spoken(seconds)}.{advice and ' ' + advice}")
