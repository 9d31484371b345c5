"""The stages of `run`, each of which runs once: a finished one leaves a file, so a killed run goes on after it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from cornerforge._schema import Declared, Whole, read
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import TrainConfig
from cornerforge.execution.progress import NO_PROGRESS, Progress, begin_part
from cornerforge.experiment.counting import simulate_experiment, tally_summary
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import SUMMARY, provenance, read_json_file, version, write_json
from cornerforge.experiment.policy_file import policy_hash, save_policy
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.manifest import MANIFEST
from cornerforge.results import Analysed, Filled, NaturalRate, RunDone, Simulated, as_json
from cornerforge.results.learning import Baseline, LearnedPolicy, TrainingCurve, TrainingPoint
from cornerforge.results.rates import Yield
from cornerforge.results.whole import Exposed, ExposedTo, Exposure, ExposureMiles, RunTrained, Spending
from cornerforge.sim import Tally, statistics
from cornerforge.verbs.analyse import ANALYSIS_FILES, analyse
from cornerforge.verbs.train import canonical_curve, learn, measure_baselines, point_seconds, training_faults

__all__ = [
    "ANALYSED_FILES", "LIBRARY_FILES", "TRAINING_FILES", "Counted", "Finished", "NaturalCases", "PlainRates", "Stages",
    "TrainedStage", "analyse_natural", "count", "exposure_counts", "finish", "natural_files", "plain_rates",
    "train_stage", "write_exposure",
]  # fmt: skip

T = TypeVar("T")
TRAINING_FILES = ("policy.safetensors", "training.json")
LIBRARY_FILES = (f"library/{MANIFEST}", f"library/{MODEL_FILE}")
ANALYSED_FILES = tuple(f"analysis/{name}" for name in ANALYSIS_FILES)
"""What stages of a run make in its folder."""


class Stages:
    """Runner of stages: each runs once; `stages/NAME.json` holds its result and appears only when it is complete.

    Args:
        out: The output folder.
        progress: Told which stage begins, if their number is known.
        of: Their number, with what comes after them; None: not known.
    """

    def __init__(self, out: Path, progress: Progress = NO_PROGRESS, of: int | None = None) -> None:
        self._out, self._progress, self._of, self._begun = out, progress, of, 0

    def do(self, name: str, kind: type[T], work: Callable[[], T], makes: Sequence[str] = ()) -> T:
        """Give the result of a stage, from its file if it is there; else do the work and leave the file.

        Args:
            name: Of the stage.
            kind: Of its result.
            work: Does the work.
            makes: Files in the output folder that it makes; without one of them it is not finished.

        Raises:
            FileFormatError: The file is damaged.
        """
        self._begun += 1
        if self._of is not None:
            begin_part(self._progress, self._begun, self._of)
        path = self._out / "stages" / f"{name}.json"
        if not all(file.exists() for file in (path, *(self._out / made for made in makes))):
            write_json(path, as_json(work()))
        # A resumed run reads the result from the file, so this run goes on with the same values.
        return read(kind, read_json_file(path), f"{path} is damaged", "remove it, or choose another place.")


@dataclass(frozen=True)
class Counted:
    """Tests with all histograms: their result, and the AV's exposure as counts by quantity."""

    rate: Simulated
    exposure: dict[str, tuple[Whole, ...]]


@dataclass(frozen=True)
class TrainedStage:
    """A training, and when the points of its curve were reached [s]."""

    policy: LearnedPolicy
    point_seconds: tuple[float, ...]


@dataclass(frozen=True)
class PlainRates:
    """The yields of plain adversaries, and what measuring them took [s]."""

    rates: tuple[Baseline, ...]
    seconds: float


@dataclass(frozen=True)
class NaturalCases:
    """Analysis of the library of natural crashes; None: there are none."""

    analysed: Analysed | None


def exposure_counts(tally: Tally) -> dict[str, tuple[int, ...]]:
    """Give the AV's exposure as counts by quantity, from tests that were counted with all histograms."""
    rows = tally.counts.histograms[len(statistics.TRAFFIC) :]
    return {grid.name: tuple(rows[k][: grid.bins].tolist()) for k, grid in enumerate(statistics.EXPOSURE)}


def count(
    run: Experiment, tests: int, first: int, seed: int, threads: int | None, progress: Progress, stage: str
) -> Counted:
    """Drive tests and count all histograms."""
    tally, seconds = simulate_experiment(
        run, tests=tests, seed=seed, first=first, threads=threads, counting=True, progress=progress, stage=stage
    )
    return Counted(tally_summary(tally, seconds, with_distributions=True), exposure_counts(tally))


_LABELS: dict[ExposedTo, str] = {
    "bbd_front": "Bumper-to-bumper distance to the vehicle ahead",
    "bbd_rear": "Bumper-to-bumper distance to the vehicle behind",
    "ttc_front": "Time to collision with the vehicle ahead, when closing",
    "ttc_rear": "Time to collision with the vehicle behind, when closing",
}


def write_exposure(out: Path, nde: Counted, adversary: Counted) -> None:
    """Write `exposure.json`, the paper's Figure 3, without the last bin, which holds all values beyond the grid."""
    grids = {grid.name: grid for grid in statistics.EXPOSURE}
    quantities = {
        name: Exposed(
            label=label,
            unit=grids[name].unit,
            edges=tuple(statistics.grid_edges(grids[name])[:-1].tolist()),
            nde=nde.exposure[name][:-1],
            adversary=adversary.exposure[name][:-1],
        )
        for name, label in _LABELS.items()
    }
    miles = ExposureMiles(nde=nde.rate.miles, adversary=adversary.rate.miles)
    write_json(out / "exposure.json", as_json(Exposure(miles=miles, quantities=quantities)))


def train_stage(
    run: Experiment, config: TrainConfig, checkpoint: CheckpointFile, out: Path, seed: int, threads: int | None,
    progress: Progress,
) -> TrainedStage:  # fmt: skip
    """Train, and write `policy.safetensors` and `training.json`."""
    policy, result = learn(run, config, seed=seed, threads=threads, progress=progress, checkpoint=checkpoint)
    save_policy(policy, out / "policy.safetensors")
    points = tuple(TrainingPoint(**point) for point in canonical_curve(result))
    curve = TrainingCurve(preset=config.preset, config=asdict(config), points=points)
    write_json(out / "training.json", asdict(curve))  # not as_json, which leaves out null
    learned = LearnedPolicy(
        decisions=result.decisions,
        updates=result.updates,
        seconds=round(result.seconds, 3),
        preset=config.preset,
        policy_hash=policy_hash(policy),
        av_faults=training_faults(run),
    )
    return TrainedStage(learned, tuple(point_seconds(result)))


def plain_rates(
    plain: Experiment, tests: int, reward: str, seed: int, threads: int | None, progress: Progress
) -> PlainRates:
    """Measure the plain adversaries; traffic without an adversary is measured as the baseline, on many more tests."""
    begun = time.perf_counter()
    rates = measure_baselines(plain, tests=tests, reward=reward, seed=seed, threads=threads, progress=progress)
    return PlainRates(tuple(rate for rate in rates if rate.name != "nobody"), round(time.perf_counter() - begun, 3))


def analyse_natural(found: NaturalRate, folder: Path, seed: int, progress: Progress) -> NaturalCases:
    """Analyse the crashes that a natural rate left in its folder."""
    if found.crashes_per_test == 0.0:
        return NaturalCases(None)
    return NaturalCases(
        analyse(folder / _natural_library(found), out=folder / "analysis", seed=seed, progress=progress)
    )


def natural_files(found: NaturalRate) -> tuple[str, ...]:
    """Name the files that a natural rate and its analysis leave in the folder `natural` of a run."""
    of_cases = (f"{_natural_library(found)}/{MANIFEST}", *(f"analysis/{name}" for name in ANALYSIS_FILES))
    return tuple(f"natural/{name}" for name in ("rate.json", *(() if found.crashes_per_test == 0.0 else of_cases)))


def _natural_library(found: NaturalRate) -> str:
    return "library" if found.method == "mc" else "weighted"


class Finished(Declared):
    """Results of all stages of a run; `effort` names it, `spending` says what hours were spent on."""

    effort: str
    nde: Counted
    natural: NaturalRate
    natural_cases: NaturalCases
    trained: TrainedStage
    reached: Yield
    baselines: PlainRates
    filled: Filled
    analysed: Analysed | None
    spending: Spending | None = None


def finish(
    found: Finished, identity: Mapping[str, Any], folder: Path, *, mask: Experiment, av: str, seed: int, reward: str,
    begun: float, progress: Progress,
) -> RunDone:  # fmt: skip
    """Write `summary.json`, `provenance.json` and the report of a run, and give what `run --json` prints.

    Args:
        found: Results of its stages.
        identity: Of the run; its policy's hash is added.
        folder: Of the run.
        mask: An experiment whose adversary is as bounded as the run's.
        av: The AV, as the user named it.
        seed: As given.
        reward: As given.
        begun: When the run began, by `time.perf_counter` [s].
        progress: Told of the report.
    """
    from cornerforge.report import write_report

    progress("report", 0, 1)
    policy = found.trained.policy
    done = RunDone(
        out=str(folder),
        version=version(),
        effort=found.effort,
        seed=seed,
        av=av,
        bounded=mask.bounded,
        budget=mask.budget,
        reward=reward,
        nde=found.nde.rate,
        natural=found.natural,
        natural_cases=found.natural_cases.analysed,
        train=RunTrained(**vars(policy), **vars(found.reached)),
        baselines=found.baselines.rates,
        generate=found.filled,
        analyse=found.analysed,
        report=str(folder / "report.html"),
        seconds=round(time.perf_counter() - begun, 3),
        spending=found.spending,
    )
    write_json(folder / SUMMARY, as_json(done))
    made = provenance({**identity, "policy_hash": policy.policy_hash}, done.seconds)
    write_json(folder / "provenance.json", {**made, "point_seconds": list(found.trained.point_seconds)})
    write_report(folder)
    progress("report", 1, 1)
    return done
