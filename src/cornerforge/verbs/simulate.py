"""`simulate` drives tests and counts crashes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from cornerforge._arguments import checked
from cornerforge._checks import check_integer
from cornerforge._locks import claims
from cornerforge.errors import InputError
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.counting import simulate_experiment, tally_summary
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.setting import experiment
from cornerforge.results import Simulated
from cornerforge.world_options import WorldKeywords, WorldOptions

__all__ = ["simulate"]


@checked
@claims()
def simulate(
    *,
    tests: int,
    bv: str | Path | Sequence[str | Path] = "nde",
    acting: str = "greedy",
    stats: bool = False,
    out: Path | str | None = None,
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[WorldKeywords],
) -> Simulated:
    """Run tests of an AV; crashes are counted, and stored only when `out` names a library.

    Args:
        tests: How many tests (drives of 400 m), at least 1.
        bv: How background vehicles drive: "nde", "idm", a plain adversary's name, or a policy file; several files:
            each test is driven by one of these policies, drawn at random.
        acting: How a policy acts: "greedy", or "softmax:T" to draw actions by exp(Q / T).
        stats: Add distributions over all BVs at decision times.
        out: Library in which crashes are stored; None to store none.
        resume: Go on with the library `out`.
        seed: 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
        world: The world, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge simulate --json` prints: counts, the crash rate, and with `stats` the distributions.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    check_integer("tests", tests, low=1, high=10**12)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    if resume and out is None:
        raise InputError("There is nothing to resume without out; name the folder: --out FOLDER --resume")
    run = experiment(WorldOptions(**world), bv=bv, acting=acting, takes_foreign=True, seed=seed)
    forecast(run, threads, f"driving {tests:,} tests", tests=tests)
    if out is not None:
        from cornerforge.library.filling import store_tests  # here, because it loads pyarrow

        return store_tests(
            run, Path(out), tests=tests, seed=seed, threads=threads, counting=stats, resume=resume, progress=progress
        )
    tally, seconds = simulate_experiment(
        run, tests=tests, seed=seed, threads=threads, counting=stats, progress=progress
    )
    return tally_summary(tally, seconds, with_distributions=stats)
