"""`simulate` drives tests and counts crashes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cornerforge._options import verb
from cornerforge._schema import is_several
from cornerforge.errors import InputError
from cornerforge.experiment.counting import simulate_experiment, tally_summary
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.setting import experiment
from cornerforge.results import Simulated
from cornerforge.verbs.options.driving import Simulate

__all__ = ["simulate"]


@verb(Simulate)
def simulate(options: Simulate) -> Simulated:
    """Run tests of an AV; crashes are counted, and stored only when `out` names a library.

    Returns:
        What `cornerforge simulate --json` prints: counts, the crash rate, and with `stats` the distributions.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    if options.resume and options.out is None:
        raise InputError("There is nothing to resume without out; name the folder: --out FOLDER --resume")
    run = experiment(options.world(), bv=options.bv, acting=options.acting, takes_foreign=True, seed=options.seed)
    forecast(run, options.threads, f"driving {options.tests:,} tests", tests=options.tests)
    if options.out is not None:
        from cornerforge.library.filling import store_tests  # here, because it loads pyarrow

        found = store_tests(
            run, Path(options.out), tests=options.tests, seed=options.seed, threads=options.threads,
            counting=options.stats, resume=options.resume, progress=options.progress,
        )  # fmt: skip
    else:
        tally, seconds = simulate_experiment(
            run, tests=options.tests, seed=options.seed, threads=options.threads, counting=options.stats,
            progress=options.progress,
        )  # fmt: skip
        found = tally_summary(tally, seconds, with_distributions=options.stats)
    named = options.bv if is_several(options.bv) else [options.bv]
    return replace(found, av=run.av.name, bv=tuple(map(str, named)))
