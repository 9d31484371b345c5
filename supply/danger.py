"""Teach, at length, the networks of dangers that every rate by trees begins with: `make danger`.

The first samples come from tests in which acts near each built-in AV are followed by chance, the later ones from trees
that branch by what was learned of that AV so far. All AVs share one network but for a bias, so each learns from what
happens to the others.

python supply/danger.py FILE
"""

from __future__ import annotations

import sys
from itertools import chain
from pathlib import Path

from cornerforge._checksums import write_arrays
from cornerforge.drivers.avs import AVS
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.rates.branching.danger import Network
from cornerforge.rates.branching.drive import TrainingTable, drive_trees
from cornerforge.rates.branching.population import Plan
from cornerforge.rates.teaching import DangerLearner, blind_plan, level_of, own_bias, plan_of
from cornerforge.rates.weighted import weighted_rate
from cornerforge.work import default_threads

SEED = 20_261_127
BLIND = 3_000
"""Trees of each AV that know nothing."""
ROUNDS = (8_000, 24_000, 48_000)
"""Trees of each AV, round by round."""
STEPS, LAST_STEPS = 5_000, 24_000
CHECKED, LEAST_EFFECTIVE = 24_000, 15.0
"""Fresh trees by which an AV's own network is judged, and the fewest effective ones of a network that is kept."""


def main(place: Path) -> None:
    """Teach the networks, and write them."""
    runs = [experiment(av=name) for name in AVS]
    learner, threads, begun = DangerLearner(SEED, avs=len(runs)), default_threads(), 0

    def driven(run: Experiment, plan: Plan, tests: int) -> TrainingTable:
        nonlocal begun
        made = drive_trees(
            run.setting, run.slots, plan, seed=SEED, first=begun, tests=tests, threads=threads, learning=True
        )  # fmt: skip
        begun += tests
        assert made.training is not None
        weights = made.trees["weight"]
        print(
            f"{run.av.name}: {tests} trees, {weights.mean():.3g}, {made.training.test.size} samples, "
            f"{made.cpu_seconds:.1f} s",
            flush=True,
        )
        return made.training

    def by_the_network(av: int, run: Experiment, tests: int) -> TrainingTable:
        network = learner.network(av)
        level, _ = level_of(network, run.setting, run.slots, SEED, threads)
        return driven(run, plan_of(network, level), tests)

    tables = [[(av, driven(run, blind_plan(), BLIND)) for av, run in enumerate(runs)]]
    for tests in ROUNDS:
        print(f"learned in {learner.learn([*chain(*tables)], steps=STEPS):.0f} s", flush=True)
        tables = [tables[0], *tables[1:][-1:], [(av, by_the_network(av, run, tests)) for av, run in enumerate(runs)]]
    print(f"learned in {learner.learn([*chain(*tables)], steps=LAST_STEPS):.0f} s", flush=True)
    networks = [learner.network(av) for av in range(len(runs))]
    kept = [(run, one) for run, one in zip(runs, networks, strict=True) if serves(run, one, threads)]
    write_arrays(
        place, {**learner.network(None)._asdict(), **{str(own_bias(run)): one.first_bias for run, one in kept}}
    )


def serves(run: Experiment, network: Network, threads: int) -> bool:
    """Do fresh trees by an AV's network find enough of its crashes? Else the AV is better taught again, each time."""
    level, _ = level_of(network, run.setting, run.slots, SEED + 1, threads)
    plan = plan_of(network, level)
    made = drive_trees(run.setting, run.slots, plan, seed=SEED + 1, first=0, tests=CHECKED, threads=threads)
    found = weighted_rate(made.trees["weight"])
    print(f"{run.av.name}: {found.rate:.3g}, {found.effective:.0f} effective of {CHECKED}", flush=True)
    return found.effective >= LEAST_EFFECTIVE


if __name__ == "__main__":
    main(Path(sys.argv[1]))
