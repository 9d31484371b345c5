"""Which of the four things that preset `fast` adds to the paper's learner are needed: each is taken out in turn.

    .venv/bin/python benchmarks/ablation.py --decisions 1000000
    .venv/bin/python benchmarks/ablation.py --decisions 3000000 --bounded

The four: Adam (else SGD, at the same learning rates, and at a hundred times these), batches of 512 (else 16, with as
many updates, and with as many transitions), exploring by plain rules in half of the worlds (else one uniform action
with chance epsilon, everywhere), and half of each batch from paid tests (else drawn alike from all). All else is as in
`fast`, the network too. Prints Markdown: for each variant and training seed the yield of the greedy policy for the
reward `crash` on tests that nothing was trained on, their mean, and the seconds of a training. One thread.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from measuring import table

from cornerforge.adversary.config import PRESETS, DqnConfig
from cornerforge.experiment.setting import experiment
from cornerforge.verbs.train import evaluate, learn

if TYPE_CHECKING:
    pass

_FAST, _PAPER = PRESETS["fast"], PRESETS["paper"]
_SGD = {"optimiser": _PAPER.optimiser}
_LARGE_STEPS = {
    "learning_rate": 100.0 * _FAST.learning_rate,
    "final_learning_rate": 100.0 * _FAST.final_learning_rate,
}
_SMALL = {"batch": _PAPER.batch}
_AS_MANY = {"decisions_per_update": _FAST.decisions_per_update * _PAPER.batch // _FAST.batch}
_UNGUIDED = {"guided": 0.0, "guided_epsilon": 0.0}
_ALIKE = {"paid_share": 0.0}

VARIANTS: dict[str, dict[str, Any]] = {
    "fast": {},
    "SGD": _SGD,
    "SGD, steps 100 times as large": _SGD | _LARGE_STEPS,
    "batches of 16, as many updates": _SMALL,
    "batches of 16, as many transitions": _SMALL | _AS_MANY,
    "exploring by chance": _UNGUIDED,
    "batches drawn alike": _ALIKE,
    "exploring by chance, batches drawn alike": _UNGUIDED | _ALIKE,
    "none of the four": _SGD | _LARGE_STEPS | _SMALL | _AS_MANY | _UNGUIDED | _ALIKE,
}
"""What is set anew in `fast`, by the variant's name."""


def variant(name: str, decisions: int) -> DqnConfig:
    """Preset `fast` with what `VARIANTS` sets anew."""
    return replace(_FAST, decisions=decisions, **VARIANTS[name])


def main() -> int:
    """Train each variant with each seed in turn."""
    parser = argparse.ArgumentParser(description="Preset fast without each of its parts.")
    parser.add_argument("--decisions", type=int, required=True)
    parser.add_argument("--bounded", action="store_true")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--tests", type=int, default=8192)
    parser.add_argument("--only", action="append", choices=list(VARIANTS))
    given = parser.parse_args()
    run = experiment(bv="uniform", bounded=given.bounded)
    seeds = range(given.seeds)
    print(table(["variant", *(f"seed {seed}" for seed in seeds), "mean", "seconds"], []), flush=True)
    for name in given.only or VARIANTS:
        yields, began = [], time.perf_counter()
        for seed in seeds:
            policy, _ = learn(run, variant(name, given.decisions), seed=seed, threads=1)
            yields.append(evaluate(experiment(policy=policy), tests=given.tests, seed=seed, threads=1).crashes_per_test)
        seconds = (time.perf_counter() - began) / given.seeds
        shown = [f"{rate:.4f}" for rate in (*yields, sum(yields) / len(yields))]
        print(
            f"| {' | '.join([name, *shown, f'{seconds:.0f}'])} |", flush=True
        )  # none is lost when the next is stopped
    return 0


if __name__ == "__main__":
    sys.exit(main())
