"""`generate` fills a case library with crashes that an adversary makes."""

from __future__ import annotations

from pathlib import Path

from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.setting import experiment
from cornerforge.library.filling import fill_library
from cornerforge.results import Filled
from cornerforge.verbs.options.cases import Generate

__all__ = ["generate"]


@verb(Generate)
def generate(options: Generate) -> Filled:
    """Fill a case library with crashes that an adversary makes.

    Returns:
        What `cornerforge generate --json` prints: cases, and the crashes of all tests that were driven for them.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    run = experiment(options.world(), bv=options.policy, acting=options.acting, takes_foreign=True, seed=options.seed)
    if run.bv in ("nde", "idm"):
        raise InputError(
            f"policy = {run.bv!r} is no adversary; to store natural crashes: cornerforge simulate --out LIB"
        )
    forecast(run, options.threads, f"driving {options.cases:,} tests (if every one is a case)", tests=options.cases)
    return fill_library(
        run,
        Path(options.out),
        seed=options.seed,
        cases=options.cases,
        threads=options.threads,
        resume=options.resume,
        progress=options.progress,
    )
