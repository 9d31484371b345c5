"""Natural crash rates by trees of tests: taught, driven, judged, and compared in CPU time with counting.

    .venv/bin/python benchmarks/natural_rates.py --av idm-mobil --lanes 3 --trees 60000

Prints every round of teaching and the final estimates as a table. Run it alone on the machine: it counts CPU seconds.
"""

from __future__ import annotations

import argparse
import time

from cornerforge.experiment.experiments import check_threads
from cornerforge.experiment.setting import experiment
from cornerforge.rates.branching.drive import DrivenTrees, drive_trees
from cornerforge.rates.teaching import plan_of, teach
from cornerforge.rates.weighted import weighted_rate
from cornerforge.sim import simulate

_COUNTED = 60_000


def main() -> None:
    parser = argparse.ArgumentParser(description="Natural crash rates by trees of tests.")
    parser.add_argument("--av", default="idm-mobil", help="a built-in AV")
    parser.add_argument("--lanes", type=int, default=3)
    parser.add_argument("--trees", type=int, default=60_000, help="trees of each estimate")
    parser.add_argument("--levels", type=float, nargs="+", default=[3.0, 1.0, 0.3], help="times the mean danger")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--threads", type=int)
    given = parser.parse_args()
    run, threads = experiment(av=given.av, lanes=given.lanes), check_threads(given.threads)
    run.warm_up()
    begun = time.process_time()
    simulate(run.setting, run.slots, seed=1, tests=_COUNTED, threads=threads)
    plain = (time.process_time() - begun) / _COUNTED
    print(f"{given.av}, {given.lanes} lanes; a plain test takes {1e6 * plain:.1f} us of CPU", flush=True)
    print("| what | trees | rate | +- 95 % | effective | largest | us a tree | lost | plain CPU over this | doubts |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |")

    def tell(name: str, driven: DrivenTrees) -> None:
        found = weighted_rate(driven.trees["weight"])
        each = driven.cpu_seconds / found.n
        worth = found.counted_tests * plain / (found.n * each)
        print(
            f"| {name} | {found.n:,} | {found.rate:.3g} | {found.high - found.rate:.2g} | {found.effective:.0f} | "
            f"{found.largest:.3f} | {1e6 * each:.0f} | {driven.trees['lost'].sum()} | {worth:,.0f} | "
            f"{'; '.join(found.doubts) or 'none'} |",
            flush=True,
        )

    taught = teach(run.setting, run.slots, seed=given.seed, threads=threads, tell=tell)
    for times in given.levels:
        plan = plan_of(taught.network, times * taught.level)
        tell(
            f"{times:g} x {taught.level:.2g}",
            drive_trees(run.setting, run.slots, plan, seed=given.seed + 1, first=0, tests=given.trees, threads=threads),
        )
    print(f"Teaching took {taught.tests:,} trees and {taught.cpu_seconds:.0f} s of CPU.")


if __name__ == "__main__":
    main()
