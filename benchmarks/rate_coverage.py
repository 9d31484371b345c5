"""How often a rate by trees holds the truth: many small runs of one AV, with their intervals and doubts.

    .venv/bin/python benchmarks/rate_coverage.py --av idm-mobil --runs 200 --trees 20000
    .venv/bin/python benchmarks/rate_coverage.py --av flawed-too-close --runs 200 --trees 2000 --count 2000000

All runs of an AV have the same network, and trees of their own. The truth is the mean of all their trees, in which each
run has its small part; where it can be counted, the count stands beside it. A run is in doubt as `rate` says, but for
the number of its trees, which is small on purpose.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence

import numpy as np
from measuring import table

from cornerforge.experiment.experiments import check_threads
from cornerforge.experiment.setting import experiment
from cornerforge.intervals import binomial_interval
from cornerforge.rates.branching.drive import drive_trees
from cornerforge.rates.teaching import own_bias, plan_of, teach
from cornerforge.rates.weighted import WeightedRate, always_valid_interval, weighted_rate
from cornerforge.sim import simulate


def held(what: str, runs: Sequence[WeightedRate], truth: float) -> list[str]:
    """Make the row of some runs: how many of their intervals hold the truth."""
    n = len(runs)
    row = [what, str(n)]
    for intervals in ([(run.low, run.high) for run in runs], [always_valid_interval(run) for run in runs]):
        hits = sum(low <= truth <= high for low, high in intervals)
        low, high = binomial_interval(hits, n) if n else (0.0, 1.0)
        row.append(f"{hits} ({low:.3f} to {high:.3f})")
    row.append(f"{np.mean([run.rate for run in runs]) / truth:.2f}" if n else "")
    row.append(f"{np.median([run.effective for run in runs]):.0f}" if n else "")
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description="How often a rate by trees holds the truth.")
    parser.add_argument("--av", default="idm-mobil", help="a built-in AV")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--trees", type=int, default=20_000, help="of each run")
    parser.add_argument("--count", type=int, default=0, help="plain tests to count the truth with")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int)
    given = parser.parse_args()
    run, threads = experiment(av=given.av), check_threads(given.threads)
    taught = teach(run.setting, run.slots, seed=given.seed, threads=threads, own=own_bias(run))
    plan = plan_of(taught.network, taught.level)
    driven = drive_trees(
        run.setting, run.slots, plan, seed=given.seed + 1, first=0, tests=given.runs * given.trees, threads=threads
    )
    weights = driven.trees["weight"].reshape(given.runs, given.trees)
    found, whole = [weighted_rate(one) for one in weights], weighted_rate(weights.ravel())
    print(
        f"{given.av}: {given.runs} runs of {given.trees:,} trees, {taught.tests:,} trees of teaching; all together "
        f"{whole.rate:.3g} (+- {whole.error:.2g}), {whole.effective:,.0f} effective, largest {whole.largest:.3f}, tail "
        f"index {math.nan if whole.tail is None else whole.tail:.2f}, {driven.cpu_seconds:.0f} s of CPU"
    )
    if given.count:
        out = simulate(run.setting, run.slots, seed=given.seed, tests=given.count, threads=threads)
        low, high = binomial_interval(out.av_crashes, given.count)
        print(f"Counted: {out.av_crashes} crashes in {given.count:,} tests, {low:.3g} to {high:.3g}")
    rows = [
        held("all", found, whole.rate),
        held("in doubt", [one for one in found if one.doubts], whole.rate),
        held("not in doubt", [one for one in found if not one.doubts], whole.rate),
    ]
    head = ["runs", "number", "95 % interval holds", "interval for many looks holds", "mean / truth", "effective"]
    print(table(head, rows))


if __name__ == "__main__":
    main()
