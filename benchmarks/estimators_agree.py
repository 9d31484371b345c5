"""Counting, importance sampling and trees of tests beside each other where crashes are frequent enough to count.

    .venv/bin/python benchmarks/estimators_agree.py --write docs/results.md

Natural traffic is made careless: drivers change lanes often, overlook a neighbour often and look away often. So `mc`
knows rates, kinds of crash, impact speeds and times into the test too, and the three can be held against each other.
Every run is the command `rate` with a folder; what is there is taken up again.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from document import MarkedBlock
from measuring import table
from numpy.typing import NDArray

import cornerforge
from cornerforge.library import CaseLibrary
from cornerforge.ndd import NddModel, default_model_path, load_model, save_model
from cornerforge.results import NaturalRate

IN_DOCUMENT = MarkedBlock("benchmarks/estimators_agree.py")
METHODS = ("mc", "is", "splitting")
WORLDS = (("idm-mobil", 2), ("idm-mobil-blind", 2))
SEED = 11
_MOST = {"mc": 40_000_000, "is": 3_600_000, "splitting": 4_000_000}
_Z95 = 1.959963984540054


@dataclass(frozen=True)
class Found:
    """One run: its rate, and what its crashes are like.

    Attributes:
        rate: What `rate` said.
        weight: Of each crash in the library, over their sum, (K,).
        values: Impact speed [m/s] and time into the test [s] of each, (K, 2).
        kinds: Mechanism of each, (K,).
    """

    rate: NaturalRate
    weight: NDArray[np.float64]
    values: NDArray[np.float64]
    kinds: NDArray[np.str_]

    @property
    def error(self) -> float:
        """Standard error of the rate, from its 90 % interval at this number of tests."""
        return (self.rate.relative_half_width_90 or math.inf) * self.rate.crashes_per_test / 1.6448536269514722

    def mean(self, which: int) -> tuple[float, float]:
        """Weighted mean of a value over crashes, and its standard error."""
        x = self.values[:, which]
        mean = float(self.weight @ x)
        return mean, float(np.sqrt(self.weight**2 @ (x - mean) ** 2))

    def share(self, kind: str) -> tuple[float, float]:
        """Share of a mechanism, and its standard error."""
        is_kind = (self.kinds == kind).astype(np.float64)
        share = float(self.weight @ is_kind)
        return share, float(np.sqrt(self.weight**2 @ (is_kind - share) ** 2))


def careless(model: NddModel) -> NddModel:
    """The same drivers, who change lanes often and make many errors."""
    memory = replace(model.memory, away=0.015, away_again=0.5)
    return replace(
        model, memory=memory, lc_base=np.full(21, 0.05, dtype=np.float32), overlook=0.05, overlook_conflict=0.05
    )


def found_by(method: str, av: str, lanes: int, out: Path, target: float) -> Found:
    """Run `rate` into a folder, or take it up."""
    model, folder = out / "careless.npz", out / f"{av}-{lanes}-{method}"
    rate = cornerforge.rate(
        method=method, av=av, lanes=lanes, model=model, seed=SEED, target_rhw=target, max_tests=_MOST[method],
        out=folder, resume=True,
    )  # fmt: skip
    library = CaseLibrary.open(folder / ("library" if method == "mc" else "weighted"))
    names = ["impact_speed_difference_mps", "crash_time_s", "mechanism"] + (["weight"] if method != "mc" else [])
    rows = library.scalars(names)
    weight = np.ones(len(library)) if method == "mc" else rows["weight"].to_numpy()
    values = np.column_stack([np.abs(rows[names[0]].to_numpy()), rows[names[1]].to_numpy()])
    return Found(rate, weight / weight.sum(), values, np.array(rows["mechanism"].to_pylist()))


def apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    """How many standard errors two numbers are apart."""
    return abs(a[0] - b[0]) / max(math.hypot(a[1], b[1]), 1e-300)


def render(found: dict[tuple[str, int, str], Found]) -> str:
    """Both tables."""
    rates, alike = [], []
    for av, lanes in WORLDS:
        runs = {method: found[av, lanes, method] for method in METHODS}
        for method, run in runs.items():
            low, high = run.rate.interval95
            speed, time = run.mean(0), run.mean(1)
            rates.append(
                [
                    f"{av}, {lanes} lanes", method,
                    f"{run.rate.crashes_per_test:.3e} ({low:.2e} to {high:.2e})",
                    f"{_Z95 * run.error / run.rate.crashes_per_test:.3f}", f"{run.rate.tests:,}",
                    f"{run.rate.effective_sample_size if method != 'mc' else run.rate.av_crashes:,}",
                    f"{run.rate.cpu_seconds:,.0f}",
                    f"{speed[0]:.2f} +- {_Z95 * speed[1]:.2f}", f"{time[0]:.2f} +- {_Z95 * time[1]:.2f}",
                    "; ".join(run.rate.doubts) or "none",
                ]
            )  # fmt: skip
        for a, b in itertools.combinations(METHODS, 2):
            one, two = runs[a], runs[b]
            kinds = sorted({*one.kinds, *two.kinds})
            shares = [apart(one.share(kind), two.share(kind)) for kind in kinds]
            alike.append(
                [
                    f"{av}, {lanes} lanes", f"{a}, {b}",
                    f"{apart((one.rate.crashes_per_test, one.error), (two.rate.crashes_per_test, two.error)):.1f}",
                    f"{apart(one.mean(0), two.mean(0)):.1f}", f"{apart(one.mean(1), two.mean(1)):.1f}",
                    f"{max(shares):.1f} of {len(kinds)} ({kinds[int(np.argmax(shares))]})",
                ]
            )  # fmt: skip
    head = [
        "AV", "method", "per test (95 %)", "half-width at this n", "tests or trees", "effective (mc: crashes)",
        "CPU [s]", "impact speed [m/s]", "time of the crash [s]", "doubts",
    ]  # fmt: skip
    compared = ["AV", "methods", "rate", "impact speed", "time", "shares of mechanisms, the largest"]
    return "\n\n".join(
        [
            table(head, rates),
            "How many standard errors two methods are apart:",
            table(compared, alike),
        ]
    )


def main() -> int:
    parser = argparse.ArgumentParser(description="Three estimators of natural rates beside each other.")
    parser.add_argument("--target", type=float, default=0.05, help="relative half-width that stops a run")
    parser.add_argument("--out", type=Path, default=Path("out/estimators"), help="working folder")
    parser.add_argument("--write", type=Path, metavar="PATH", help="replace the marked block of this document")
    given = parser.parse_args()
    if given.write and (fault := IN_DOCUMENT.missing_in(given.write)):
        parser.error(fault)
    given.out.mkdir(parents=True, exist_ok=True)
    save_model(careless(load_model(default_model_path())), given.out / "careless.npz")
    found = {}
    for (av, lanes), method in itertools.product(WORLDS, METHODS):
        found[av, lanes, method] = run = found_by(method, av, lanes, given.out, given.target)
        print(av, lanes, method, run.rate.crashes_per_test, run.rate.interval95, run.rate.cpu_seconds, file=sys.stderr)
    IN_DOCUMENT.publish(render(found), given.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
