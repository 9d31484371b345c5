"""What preset `paper` needs: the same training with larger learning rates.

    .venv/bin/python benchmarks/learning_rates.py --rate 1e-4 --rate 1e-3 --decisions 1000000

In small steps SGD follows its gradient, so what counts is the learning rate times the number of updates: k times the
rate shows after n updates roughly what the paper's 1e-6 (Table 1) would show after k n; roughly, for the target network
and exploring go on at their own pace. Everything else is as in the preset. Prints Markdown: the training curve
(exploring included) in tenths, and the yield of the greedy policy after it on tests that nothing was trained on. On one
core at about 1,200 updates a second; rates can run beside each other.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from measuring import table

from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.experiment.setting import experiment
from cornerforge.verbs.train import evaluate, learn

if TYPE_CHECKING:
    from cornerforge.adversary.train import CurvePoint

_TENTHS = 10
_PAPERS_RATE = 1e-6


def at_rate(rate: float, decisions: int) -> TrainConfig:
    """Preset `paper` with another learning rate."""
    return replace(preset_named("paper"), learning_rate=rate, final_learning_rate=rate, decisions=decisions)


def in_tenths(curve: list[CurvePoint], decisions: int) -> list[tuple[float, int]]:
    """Share of crashes among the tests that ended in each tenth of the training, and how many tests these were."""
    found = []
    for tenth in range(_TENTHS):
        points = [p for p in curve if tenth < p.decisions * _TENTHS / decisions <= tenth + 1]
        tests = sum(p.tests for p in points)
        crashes = sum(p.tests * (p.crashes_per_test or 0.0) for p in points)
        found.append((crashes / tests if tests else 0.0, tests))
    return found


def main() -> int:
    """Train with each rate in turn."""
    parser = argparse.ArgumentParser(description="Preset paper with larger learning rates.")
    parser.add_argument("--rate", type=float, action="append", required=True)
    parser.add_argument("--decisions", type=int, default=1_000_000)
    parser.add_argument("--tests", type=int, default=8192)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    run = experiment(bv="uniform")
    tenths = [f"{tenth + 1}/{_TENTHS}" for tenth in range(_TENTHS)]
    print(table(["learning rate", "updates", "updates at 1e-6", *tenths, "greedy, 95 %"], []), flush=True)
    for rate in given.rate:
        policy, result = learn(run, at_rate(rate, given.decisions), seed=given.seed, threads=1)
        found = evaluate(experiment(policy=policy), tests=given.tests, seed=given.seed)
        low, high = found.interval95
        row = [
            f"{rate:g}",
            f"{result.updates:,}",
            f"{result.updates * rate / _PAPERS_RATE:.1e}",
            *(f"{share:.3f}" for share, _ in in_tenths(result.curve, result.decisions)),
            f"{found.crashes_per_test:.3f} ({low:.3f} to {high:.3f})",
        ]
        print(f"| {' | '.join(row)} |", flush=True)  # a rate takes long: none is lost when the next is stopped
    return 0


if __name__ == "__main__":
    sys.exit(main())
