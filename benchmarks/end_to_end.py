"""Times that a user waits: training, driving a policy, generating, analysing, and the start of the command line."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from measuring import Series, interleave, table

from cornerforge import analyse, generate
from cornerforge.adversary.config import preset_named
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.policy_file import Policy
from cornerforge.experiment.setting import experiment
from cornerforge.sim.runner import simulate, warm_up
from cornerforge.verbs.train import learn
from cornerforge.work import default_threads

__all__ = ["EndToEnd", "Sizes", "measure_end_to_end", "render"]

_SEED = 0
_COMMAND = Path(sys.executable).parent / "cornerforge"


@dataclass(frozen=True)
class Sizes:
    """How much work one round does."""

    decisions: int = 200_000
    policy_tests: int = 8192
    cases: int = 2000
    starts: int = 10


@dataclass(frozen=True)
class EndToEnd:
    """All of this section: numbers by name, and the policy that was trained on the way."""

    numbers: dict[str, Series]
    policy: Policy

    def to_json(self) -> dict[str, object]:
        return {name: series.to_json() for name, series in self.numbers.items()}


class _Training:
    """Trains from nothing each time; the same seed gives the same policy, which is kept."""

    def __init__(self, decisions: int) -> None:
        self._run = experiment(bv="uniform")
        self._config = replace(preset_named("fast"), decisions=decisions)
        self.policy: Policy | None = None

    def __call__(self) -> float:
        self.policy, result = learn(self._run, self._config, seed=_SEED)
        return result.decisions / result.seconds


def _acting(run: Experiment, tests: int) -> Callable[[], float]:
    """Decisions of a policy that does not learn [decisions/s], on all cores."""
    warm_up(run.setting, run.slots)

    def measure() -> float:
        start = time.perf_counter()
        tally = simulate(run.setting, run.slots, seed=_SEED, tests=tests, threads=default_threads())
        return tally.decisions / (time.perf_counter() - start)

    return measure


def _libraries(repetitions: int, cases: int) -> dict[str, Series]:
    """Generating and storing cases, then analysing them, each round in a folder of its own."""
    rates, seconds = [], []
    for _ in range(repetitions):
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            generate(policy="swerve", cases=cases, out=Path(folder) / "library", seed=_SEED)
            rates.append(cases / (time.perf_counter() - start))
            start = time.perf_counter()
            analyse(Path(folder) / "library", out=Path(folder) / "analysis", seed=_SEED)
            seconds.append(time.perf_counter() - start)
    return {
        f"generate and store {cases:,} cases of `swerve`": Series("cases/s", tuple(rates)),
        "analyse them": Series("s", tuple(seconds)),
    }


def _start_of(*arguments: str) -> Callable[[], float]:
    """Seconds from calling the command line to its end, in a process of its own."""

    def measure() -> float:
        start = time.perf_counter()
        subprocess.run([_COMMAND, *arguments], check=True, stdout=subprocess.DEVNULL)
        return time.perf_counter() - start

    return measure


def measure_end_to_end(*, repetitions: int, sizes: Sizes) -> EndToEnd:
    """Measure everything of this section, on all cores."""
    training = _Training(sizes.decisions)
    training()  # loads PyTorch and the kernels
    name = f"train, learning included ({sizes.decisions:,} decisions, preset `fast`)"
    numbers = interleave(repetitions, {name: training}, "decisions/s")
    if training.policy is None:
        raise RuntimeError("Training left no policy.")
    acting = _acting(experiment(policy=training.policy), sizes.policy_tests)
    numbers |= interleave(repetitions, {"drive that policy, without learning": acting}, "decisions/s")
    _libraries(1, 50)  # loads what analysing needs
    numbers |= _libraries(repetitions, sizes.cases)
    starts = {
        "`cornerforge --help`": _start_of("--help"),
        "`cornerforge simulate --tests 1`, kernels cached": _start_of("simulate", "--tests", "1"),
    }
    for start in starts.values():
        start()
    numbers |= interleave(sizes.starts, starts, "s")
    return EndToEnd(numbers, training.policy)


def render(result: EndToEnd) -> str:
    """The section's Markdown."""
    rows = [(name, *series.cells(), series.unit) for name, series in result.numbers.items()]
    return (
        f"{table(('on all cores', 'median', 'min', 'max', 'unit'), rows)}\n\n"
        "A decision is one action of the BV that the adversary controls, with 1 s of traffic around it. Every round\n"
        "trains a new network from nothing, and fills and analyses a library of its own."
    )
