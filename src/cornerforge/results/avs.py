"""Results of `avs` and `check-av`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.stating import meant

__all__ = ["AvAbout", "AvCheck", "AvChecked", "AvDoes", "AvSpeed", "Avs"]


@dataclass(frozen=True, kw_only=True)
class AvAbout:
    """A built-in AV."""

    name: str = field(metadata=meant("What `--av` takes."))
    about: str = field(metadata=meant("What it is, in a line."))


@dataclass(frozen=True, kw_only=True)
class Avs:
    """The built-in AVs."""

    avs: tuple[AvAbout, ...] = field(metadata=meant("All of them."))


@dataclass(frozen=True, kw_only=True)
class AvCheck:
    """Result of one trial of an AV."""

    name: str = field(metadata=meant("Of the trial."))
    verdict: str = field(metadata=meant('"ok", "warn" or "FAIL".'))
    found: str = field(metadata=meant("What it did, in words."))
    trace: str | None = field(default=None, metadata=meant("The AV's whole traceback, where it raised."))


@dataclass(frozen=True, kw_only=True)
class AvSpeed:
    """How fast an AV answers, the way to its process included."""

    worlds: int = field(metadata=meant("Worlds in a call: 1, 64 or 256; fewer sizes of a slow AV."))
    calls_per_second: float = field(metadata=meant("Calls answered.", "1/s"))
    decisions_per_second: float = field(metadata=meant("Calls times worlds.", "1/s"))


@dataclass(frozen=True, kw_only=True)
class AvDoes:
    """Work that an AV's speed allows, about: tests to their ends, and no more processes than cores."""

    answer_seconds: float = field(metadata=meant("Time of an answer in one world, of so many together.", "s"))
    batch: int = field(metadata=meant("Worlds that it is asked about together."))
    processes: int = field(metadata=meant("Processes at the same time."))
    tests_per_hour: float = field(metadata=meant("Tests.", "1/h"))
    decisions_per_hour: int = field(metadata=meant("Decisions of a training against it.", "1/h"))
    advice: str = field(metadata=meant("How long a training takes, and what to use, in words."))


@dataclass(frozen=True, kw_only=True)
class AvChecked:
    """An AV from outside, tried on edge cases."""

    av: str = field(metadata=meant("As it was named."))
    kind: str = field(metadata=meant("class, policy, program, onnx or zip."))
    hash: str = field(metadata=meant("Hash of its source or file."))
    memory_gb: float = field(metadata=meant("Memory that each of its processes might take.", "GB"))
    checks: tuple[AvCheck, ...] = field(metadata=meant("All trials, in their order."))
    passed: bool = field(metadata=meant("None failed."))
    log: str | None = field(
        default=None, metadata=meant("File of what it printed and of its tracebacks, where it failed.")
    )
    speed: tuple[AvSpeed, ...] = field(metadata=meant("For 1, 64 and 256 worlds; empty where a trial failed before."))
    does: AvDoes | None = field(metadata=meant("What its speed allows; null: it answers nothing."))
