"""The two libraries of the analysis items: crashes of the surrogate AV by its adversary, unbounded and bounded."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cornerforge.experiment.policy_file import policy_hash
from cornerforge.ext.paper.bench import Adversary, Bench
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import fill_library

__all__ = ["BOUNDED", "FREE", "PAPER_BOUNDED_CASES", "PAPER_CASES", "Filled", "library_of", "missing_note"]

FREE = Adversary("learned", bounded=False, trained_on="idm-mobil", reward="crash")
BOUNDED = Adversary("learned", bounded=True, trained_on="idm-mobil", reward="crash")
PAPER_CASES = 50_000
PAPER_BOUNDED_CASES = 1_627
_MAX_TESTS = 3_000_000
"""A library that would need more tests is left out."""


@dataclass(frozen=True)
class Filled:
    """A library of a bench.

    Attributes:
        folder: Where it is.
        cases: How many it holds.
        seconds: What generating and storing it took [s].
    """

    folder: Path
    cases: int
    seconds: float

    def open(self) -> CaseLibrary:
        """Open it for reading."""
        return CaseLibrary.open(self.folder)


def library_of(bench: Bench, adversary: Adversary) -> Filled | None:
    """The library of an adversary against the surrogate AV, filled now unless it is there; None if crashes are rare.

    It has the cases of the effort; the bounded one not more than the paper's 1,627.
    """
    cases = _wanted(bench, adversary)
    if bench.judged(adversary, "idm-mobil")["crashes_per_test"] * _MAX_TESTS < cases:
        return None
    run = bench.experiment("idm-mobil", adversary)
    folder = bench.folder / "libraries" / adversary.key

    def work() -> dict[str, Any]:
        if folder.exists():  # what an interrupted run left would be continued, and the time would be too short
            shutil.rmtree(folder)
        filled = fill_library(
            run, folder, seed=bench.seed, cases=cases, threads=bench.threads, progress=bench.progress,
            stage=f"generate ({adversary.key})",
        )  # fmt: skip
        return {"cases": cases, "seconds": filled.seconds}

    policy = None if run.policy is None else policy_hash(run.policy)
    name, made_of = f"library.{adversary.key}", {"policy": policy, "cases": cases}
    if not folder.exists():
        bench.forget(name)
    made = bench.kept(name, made_of, work)
    return Filled(folder, made["cases"], made["seconds"])


def missing_note(bench: Bench, adversary: Adversary) -> str:
    """Why there is no library."""
    cases = _wanted(bench, adversary)
    return f"No library of {adversary.key}: its yield is too low for {cases:,} cases in {_MAX_TESTS:,} tests."


def _wanted(bench: Bench, adversary: Adversary) -> int:
    return min(PAPER_BOUNDED_CASES, bench.size.cases) if adversary.bounded else bench.size.cases
