"""Teach, at length, the network of dangers that every rate by trees begins with: `make danger`.

The first samples come from tests in which acts near `idm-mobil` are followed by chance, the later ones from trees that
branch by what was learned so far; then all built-in AVs are driven in turn, twice, but for those made bad on purpose,
which crash often enough to be counted.

python supply/danger.py FILE
"""

from __future__ import annotations

import sys
from pathlib import Path

from cornerforge._checksums import write_arrays
from cornerforge.drivers.avs import AVS
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.rates.branching.drive import TrainingTable, drive_trees
from cornerforge.rates.branching.population import Plan
from cornerforge.rates.teaching import DangerLearner, blind_plan, level_of, wide_plan_of
from cornerforge.work import default_threads

SEED = 20_261_127
ALONE = (16_000, 32_000, 64_000)
"""Trees of `idm-mobil` alone, round by round, after as many blind ones as in the first round."""
EACH = 24_000
"""Trees of each AV in a round with all of them."""
ROUNDS = 2
STEPS, LAST_STEPS = 4_000, 20_000


def main(place: Path) -> None:
    """Teach the network, and write it."""
    learner, threads, begun = DangerLearner(SEED), default_threads(), 0

    def driven(run: Experiment, plan: Plan, tests: int) -> TrainingTable:
        nonlocal begun
        made = drive_trees(
            run.setting, run.slots, plan, seed=SEED, first=begun, tests=tests, threads=threads, learning=True
        )  # fmt: skip
        begun += tests
        assert made.training is not None
        print(
            f"{run.av.name}: {tests} trees, {made.trees['weight'].mean():.3g}, {made.training.test.size} samples",
            flush=True,
        )
        return made.training

    def by_the_network(run: Experiment, tests: int) -> TrainingTable:
        network = learner.network()
        level, _ = level_of(network, run.setting, run.slots, SEED, threads)
        return driven(run, wide_plan_of(network, level), tests)

    first = experiment()
    tables = [driven(first, blind_plan(), ALONE[0])]
    for tests in ALONE:
        learner.learn(tables, steps=STEPS)
        tables = [tables[0], by_the_network(first, tests)]
    runs = [experiment(av=name) for name in AVS if not name.startswith("flawed-")]
    for number in range(ROUNDS):
        learner.learn(tables, steps=STEPS if number == 0 else LAST_STEPS)
        tables = [tables[0], *(by_the_network(run, EACH) for run in runs)]
    learner.learn(tables, steps=LAST_STEPS)
    write_arrays(place, learner.network()._asdict())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
