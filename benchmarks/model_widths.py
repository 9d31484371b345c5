"""How uncertain the numbers of the shipped model are that come from trajectories: widths for `calibrate.uncertainty`.

    .venv/bin/python benchmarks/model_widths.py ../shared/data/ngsim_*.csv.gz

Widths are standard deviations of a number's natural logarithm: over refits to vehicles resampled within each file, and
between fits to one file each (other roads and speeds, which says more of a law that is extrapolated). The design effect
says by how much decisions in one state tell less because some are of one driver.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from measuring import table

from cornerforge.ext.calibrate.decisions import Decisions, concatenate
from cornerforge.ext.calibrate.laws import LogLaw, fit_law
from cornerforge.ext.calibrate.scores import grid_place
from cornerforge.ndd import read_decisions
from cornerforge.ndd.model import GAPS, RANGE_RATES

_GAP = 30.0
"""Response and reach of a law are fitted together and trade off; what they do at this gap [m] is what counts."""
_SEED = 2021


def numbers(law: LogLaw) -> dict[str, float]:
    """The numbers whose widths are asked for, all above 0."""
    return {"response": law.response / (_GAP + law.reach), "spread": law.spread, "degrees": law.degrees}


def fitted(decisions: Decisions) -> LogLaw:
    """The law that is likeliest."""
    return fit_law(LogLaw(), decisions.speed, decisions.gap, decisions.range_rate, decisions.acceleration)


def resampled(decisions: Decisions, rng: np.random.Generator) -> Decisions:
    """As many vehicles, drawn with replacement, each with all of its decisions."""
    vehicles = np.unique(decisions.vehicle)
    times = np.bincount(rng.integers(vehicles.size, size=vehicles.size), minlength=vehicles.size)
    rows = np.repeat(np.arange(decisions.size), times[np.searchsorted(vehicles, decisions.vehicle)])
    return Decisions(**{name: values[rows] for name, values in vars(decisions).items()})


def design_effect(files: list[Decisions], law: LogLaw) -> tuple[float, float, float]:
    """1 + correlation (decisions of one driver in a state - 1), with the two numbers that it is made of."""
    products, pairs, squares, sums, total = 0.0, 0, 0.0, 0, 0.0
    for decisions in files:
        speed, gap, range_rate, on_grid, is_free = grid_place(decisions)
        led = on_grid & ~is_free
        state = decisions.speed, decisions.gap, decisions.range_rate
        left = ((decisions.acceleration - law.mean(*state)) / law.scale(*state))[led]
        left -= left.mean()
        cell = (speed[led] * GAPS.size + gap[led]) * RANGE_RATES.size + range_rate[led]
        _, one = np.unique(np.stack([cell, decisions.vehicle[led]]), axis=1, return_inverse=True)
        n, of_one = np.bincount(one), np.bincount(one, left)
        products += float((of_one**2 - np.bincount(one, left**2)).sum())
        pairs += int((n * (n - 1)).sum())
        squares, sums, total = squares + float((n * n).sum()), sums + int(n.sum()), total + float((left**2).sum())
    alike = products / pairs / (total / sums)
    return 1.0 + alike * (squares / sums - 1.0), alike, squares / sums


def main() -> int:
    parser = argparse.ArgumentParser(description="Widths of the model's numbers that come from trajectories.")
    parser.add_argument("data", nargs="+", type=Path, help="trajectory files of the shipped model")
    parser.add_argument("--format", default="ngsim")
    parser.add_argument("--resamples", type=int, default=60)
    given = parser.parse_args()
    training = [
        reading.decisions.where(~reading.decisions.held_out) for reading in read_decisions(given.data, given.format)
    ]
    led = [decisions.where(np.isfinite(decisions.gap)) for decisions in training]
    whole = fitted(concatenate(led))
    each = [numbers(fitted(decisions)) for decisions in led]
    rng = np.random.default_rng(_SEED)
    again = [
        numbers(fitted(concatenate([resampled(decisions, rng) for decisions in led]))) for _ in range(given.resamples)
    ]

    def sd(found: list[dict[str, float]], name: str) -> float:
        return float(np.std(np.log([values[name] for values in found]), ddof=1))

    rows = [
        [
            name, f"{value:.4g}", f"{sd(again, name):.3f}", f"{sd(each, name):.3f}",
            ", ".join(f"{values[name]:.3g}" for values in each),
        ]
        for name, value in numbers(whole).items()
    ]  # fmt: skip
    print(table(["number", "all files", "sd of ln over resampled vehicles", "between files", "each file"], rows))
    effect, alike, together = design_effect(training, whole)
    print(f"\nDesign effect {effect:.2f}: correlation {alike:.2f}, {together:.2f} decisions of one driver in a state")
    return 0


if __name__ == "__main__":
    sys.exit(main())
