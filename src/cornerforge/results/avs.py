"""Results of `avs` and `check-av`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.html import Result

__all__ = ["AvAbout", "AvCheck", "AvChecked", "AvDoes", "AvSpeed", "Avs"]


class AvAbout(Result):
    """A built-in AV."""

    name: Annotated[str, meant("What `--av` takes.")]
    about: Annotated[str, meant("What it is, in a line.")]


class Avs(Result):
    """The built-in AVs."""

    avs: Annotated[tuple[AvAbout, ...], meant("All of them.")]


class AvCheck(Result):
    """Result of one trial of an AV."""

    name: Annotated[str, meant("Of the trial.")]
    verdict: Annotated[str, meant('"ok", "warn" or "FAIL".')]
    found: Annotated[str, meant("What it did, in words.")]
    trace: Annotated[str | None, meant("The AV's whole traceback, where it raised.")] = None


class AvSpeed(Result):
    """How fast an AV answers, the way to its process included."""

    worlds: Annotated[Whole, meant("Worlds in a call: 1, 64 or 256; fewer sizes of a slow AV.")]
    calls_per_second: Annotated[float, meant("Calls answered.", "1/s")]
    decisions_per_second: Annotated[float, meant("Calls times worlds.", "1/s")]


class AvDoes(Result):
    """Work that an AV's speed allows, about: tests to their ends, and no more processes than cores."""

    answer_seconds: Annotated[float, meant("Time of an answer in one world, of so many together.", "s")]
    batch: Annotated[Whole, meant("Worlds that it is asked about together.")]
    processes: Annotated[Whole, meant("Processes at the same time.")]
    tests_per_hour: Annotated[float, meant("Tests.", "1/h")]
    decisions_per_hour: Annotated[Whole, meant("Decisions of a training against it.", "1/h")]
    advice: Annotated[str, meant("How long a training takes, and what to use, in words.")]


class AvChecked(Result):
    """An AV from outside, tried on edge cases."""

    av: Annotated[str, meant("As it was named.")]
    kind: Annotated[str, meant("class, policy, program, onnx or zip.")]
    hash: Annotated[str, meant("Hash of its source or file.")]
    memory_gb: Annotated[float, meant("Memory that each of its processes might take.", "GB")]
    checks: Annotated[tuple[AvCheck, ...], meant("All trials, in their order.")]
    passed: Annotated[bool, meant("None failed.")]
    log: Annotated[str | None, meant("File of what it printed and of its tracebacks, where it failed.")] = None
    speed: Annotated[tuple[AvSpeed, ...], meant("For 1, 64 and 256 worlds; empty where a trial failed before.")]
    does: Annotated[AvDoes | None, meant("What its speed allows; null: it answers nothing.")]
