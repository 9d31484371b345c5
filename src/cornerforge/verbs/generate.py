"""`generate` fills a case library with crashes that an adversary makes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from cornerforge._arguments import checked
from cornerforge._checks import check_integer
from cornerforge._locks import claims
from cornerforge.errors import InputError
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.setting import experiment
from cornerforge.library.filling import fill_library
from cornerforge.results import Filled
from cornerforge.world_options import WorldKeywords, WorldOptions

__all__ = ["generate"]


@checked
@claims()
def generate(
    *,
    policy: Path | str | Sequence[Path | str],
    cases: int,
    out: Path | str,
    resume: bool = False,
    acting: str = "greedy",
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[WorldKeywords],
) -> Filled:
    """Fill a case library with crashes that an adversary makes.

    Args:
        policy: Policy file of `train`, or the name of a plain adversary; several files: each test is driven by one of
            these policies, drawn at random.
        cases: How many, at least 1.
        out: The library's folder; must be new unless `resume`.
        resume: Go on where an earlier call, or its kill, stopped.
        acting: How a policy acts: "greedy", or "softmax:T" to draw actions by exp(Q / T).
        seed: Of the tests, 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
        world: The world, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge generate --json` prints: cases, and the crashes of all tests that were driven for them.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    check_integer("cases", cases, low=1, high=10**8)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    run = experiment(WorldOptions(**world), bv=policy, acting=acting, takes_foreign=True, seed=seed)
    if run.bv in ("nde", "idm"):
        raise InputError(
            f"policy = {run.bv!r} is no adversary; to store natural crashes: cornerforge simulate --out LIB"
        )
    forecast(run, threads, f"driving {cases:,} tests (if every one is a case)", tests=cases)
    return fill_library(run, Path(out), seed=seed, cases=cases, threads=threads, resume=resume, progress=progress)
