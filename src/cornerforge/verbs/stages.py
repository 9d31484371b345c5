"""The stages of `run` in one list; an effort (`verbs.run`) or hours (`verbs.spend`) decide how much each does."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from cornerforge._checks import check_integer
from cornerforge._schema import Whole
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.experiment.counting import simulate_experiment, tally_summary
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.output import SUMMARY, code_hash, config_hash, open_output, provenance, version, write_json
from cornerforge.experiment.policy_file import load_policy, policy_hash, save_policy
from cornerforge.experiment.setting import AV_LOG, experiment
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.manifest import MANIFEST
from cornerforge.results import Analysed, Filled, NaturalRate, RunDone, Simulated, as_json
from cornerforge.results.learning import Baseline, LearnedPolicy, TrainingCurve, TrainingPoint
from cornerforge.results.rates import Yield
from cornerforge.results.whole import Exposed, ExposedTo, Exposure, ExposureMiles, RunTrained
from cornerforge.sim import Tally, statistics
from cornerforge.verbs.analyse import ANALYSIS_FILES, analyse
from cornerforge.verbs.options.whole import Run
from cornerforge.verbs.rate import rate
from cornerforge.verbs.train import (
    canonical_curve,
    checkpoint_beside,
    learn,
    measure_baselines,
    point_seconds,
    training_faults,
)
from cornerforge.work.stages import Stage, Stages

__all__ = ["HOURS", "LIBRARY_FILES", "Counted", "Job", "NaturalCases", "PlainRates", "TrainedStage", "exposure_counts"]

HOURS = " h"
"""Ends the name of an effort that was so many hours."""
POLICY = "policy.safetensors"
LIBRARY_FILES = (f"library/{MANIFEST}", f"library/{MODEL_FILE}")
"""Files that a stage makes when it fills the library."""
_LABELS: dict[ExposedTo, str] = {
    "bbd_front": "Bumper-to-bumper distance to the vehicle ahead",
    "bbd_rear": "Bumper-to-bumper distance to the vehicle behind",
    "ttc_front": "Time to collision with the vehicle ahead, when closing",
    "ttc_rear": "Time to collision with the vehicle behind, when closing",
}


@dataclass(frozen=True)
class Counted:
    """Result of tests that were counted with all histograms; the AV's exposure as counts by quantity."""

    rate: Simulated
    exposure: dict[str, tuple[Whole, ...]]


@dataclass(frozen=True)
class TrainedStage:
    """Result of the training, and the time at which each point of its curve was reached [s]."""

    policy: LearnedPolicy
    point_seconds: tuple[float, ...]


@dataclass(frozen=True)
class PlainRates:
    """Yields of the plain adversaries, and how long measuring them took [s]."""

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


class Job(ABC):
    """All stages of `run` in one folder; a subclass decides how much each stage does.

    Args:
        options: What the user asked for.

    Attributes:
        found: Results of the stages that are done, by name.
        how: Keywords of all work: seed, threads, progress.
        natural: Experiment with the AV in natural traffic.
        mask: Experiment with the adversary's mask and likelihood budget; with `--hours` its AV is the stand-in.
        effort: Name of the amount of work.
        settings: What decides the results besides AV, world, mask and code.
        stand_in: Name and hash of another AV that decides them too.
    """

    mask: Experiment
    effort: str
    settings: dict[str, Any]
    stand_in: Mapping[str, str] = MappingProxyType({})

    def __init__(self, options: Run) -> None:
        self._begun = time.perf_counter()
        check_integer("seed", options.seed, low=0, high=2**32 - 1)
        check_threads(options.threads)
        self.options, self.folder, self.seed = options, Path(options.out), options.seed
        self.how: dict[str, Any] = {name: getattr(options, name) for name in ("seed", "threads", "progress")}
        self.world = options.world()
        self.natural = experiment(self.world.without_mask(), takes_foreign=True, seed=self.seed)
        self.found: dict[str, Any] = {}

    @abstractmethod
    def works(self) -> dict[str, Callable[[], Any]]:
        """Give the work of the stages whose amount the subclass decides, by name."""

    def announce(self) -> None:
        """Tell the user how long the job will take, if that is long."""
        return

    def stages(self) -> tuple[Stage, ...]:
        """List the stages, each after those whose results it needs."""
        work, files = self.works(), lambda: [f"analysis/{name}" for name in ANALYSIS_FILES]
        return (
            Stage("nde", Counted, work["nde"], title="natural traffic"),
            Stage("natural", NaturalRate, work["natural"], title="natural crash rate"),
            Stage(
                "natural_cases", NaturalCases, self._analyse_natural, ("natural",), self._natural_files,
                title="analysis of natural crashes",
            ),
            Stage("train", TrainedStage, work["train"], makes=lambda: (POLICY, "training.json"), title="training"),
            Stage("evaluate", Yield, work["evaluate"], ("train",), title="yield"),
            Stage("baselines", PlainRates, work["baselines"], title="plain adversaries"),
            Stage("exposure", Counted, work["exposure"], ("train",)),
            Stage("generate", Filled, work["generate"], ("train",), lambda: LIBRARY_FILES, title="cases"),
            Stage(
                "analyse", Analysed, self._analyse, ("generate",), files, lambda: self.found["generate"].cases > 0,
                title="analysis of the cases",
            ),
        )  # fmt: skip

    def do(self, *, numbered: bool) -> RunDone:
        """Do all stages that are not done yet; write the summary, the provenance and the report.

        Args:
            numbered: Tell the progress the number of each stage.

        Raises:
            CornerForgeError: Input, files or output place are not right.
        """
        identity = self.identity()
        open_output(self.folder, identity, resume=self.options.resume)
        self.announce()
        self.logged(self.natural)
        self.logged(self.mask)
        listed = self.stages()
        stages = Stages(self.folder, self.options.progress, len(listed) + 1 if numbered else None)
        stages.go(listed, self.found)
        stages.begin("page")
        return self._finish(identity)

    def identity(self) -> dict[str, Any]:
        """Name what decides the results, but no policy and no driver of BVs: a job has several of each."""
        identity: dict[str, Any] = self.natural.identity(self.seed)
        settings = {"world": identity.pop("config_hash"), "mask": self.mask.identity(self.seed)["config_hash"]}
        del identity["bv"], identity["policy_hash"]
        return {
            **identity,
            "bounded": self.mask.bounded,
            "budget": self.mask.budget,
            "effort": self.effort,
            **self.stand_in,
            "config_hash": config_hash({**settings, **self.settings}),
            "cornerforge": version(),
            "code": code_hash(),
        }

    # Work

    @cached_property
    def hostile(self) -> Experiment:
        """Experiment with the AV against the trained adversary; removes the checkpoint of the training."""
        CheckpointFile(self.folder / f"{POLICY}.checkpoint", {}).remove()
        world, policy = self.world.without_mask(), load_policy(self.folder / POLICY)
        return self.logged(experiment(world, policy=policy, takes_foreign=True, seed=self.seed))

    def logged(self, run: Experiment) -> Experiment:
        """Keep in the folder what the AV of an experiment prints."""
        run.keep_printed(self.folder / AV_LOG)
        return run

    def learning(self, decisions: int) -> TrainConfig:
        """Configure a training of so many decisions."""
        return replace(preset_named("fast"), decisions=decisions, reward=self.options.reward)

    def count(self, run: Experiment, tests: int, first: int, stage: str) -> Counted:
        """Drive tests and count all histograms."""
        tally, seconds = simulate_experiment(run, tests=tests, first=first, counting=True, stage=stage, **self.how)
        return Counted(tally_summary(tally, seconds, with_distributions=True), exposure_counts(tally))

    def rate(self, max_tests: int, by: Callable[..., NaturalRate] = rate, **more: Any) -> NaturalRate:
        """Measure the natural rate in the folder `natural`, with the verb `by`."""
        out = self.folder / "natural"
        return by(max_tests=max_tests, out=out, resume=True, **more, **self.how, **self.world.av_keywords())

    def plain_rates(self, run: Experiment, tests: int) -> PlainRates:
        """Measure the plain adversaries; the stage `nde` measures traffic without one, on many more tests."""
        begun = time.perf_counter()
        rates = measure_baselines(run, tests=tests, reward=self.options.reward, **self.how)
        return PlainRates(tuple(one for one in rates if one.name != "nobody"), round(time.perf_counter() - begun, 3))

    def train(self, run: Experiment, decisions: int) -> TrainedStage:
        """Train, or go on with a training that was stopped, and write `policy.safetensors` and `training.json`."""
        config = self.learning(decisions)
        checkpoint = checkpoint_beside(self.folder / POLICY, run, config, self.seed)
        policy, result = learn(run, config, checkpoint=checkpoint, **self.how)
        save_policy(policy, self.folder / POLICY)
        points = tuple(TrainingPoint(**point) for point in canonical_curve(result))
        curve = TrainingCurve(preset=config.preset, config=asdict(config), points=points)
        write_json(self.folder / "training.json", asdict(curve))  # not as_json, which leaves out null
        learned = LearnedPolicy(
            decisions=result.decisions, updates=result.updates, seconds=round(result.seconds, 3), preset=config.preset,
            policy_hash=policy_hash(policy), av_faults=training_faults(run),
        )  # fmt: skip
        return TrainedStage(learned, tuple(point_seconds(result)))

    def _natural_library(self) -> str:
        return "natural/library" if self.found["natural"].method == "mc" else "natural/weighted"

    def _natural_files(self) -> list[str]:
        of_cases = [f"{self._natural_library()}/{MANIFEST}", *(f"natural/analysis/{name}" for name in ANALYSIS_FILES)]
        return ["natural/rate.json", *(of_cases if self.found["natural"].crashes_per_test else ())]

    def _analyse_natural(self) -> NaturalCases:
        if self.found["natural"].crashes_per_test == 0.0:
            return NaturalCases(None)
        return NaturalCases(self._analysed(self._natural_library(), "natural/analysis"))

    def _analyse(self) -> Analysed | None:
        return self._analysed("library", "analysis") if self.found["generate"].cases else None

    def _analysed(self, library: str, out: str) -> Analysed:
        return analyse(self.folder / library, out=self.folder / out, seed=self.seed, progress=self.options.progress)

    def _finish(self, identity: Mapping[str, Any]) -> RunDone:
        """Write `exposure.json`, `summary.json`, `provenance.json` and the report."""
        from cornerforge.report import write_report

        found, policy, options = self.found, self.found["train"].policy, self.options
        _write_exposure(self.folder, found["nde"], found["exposure"])
        options.progress("report", 0, 1)
        done = RunDone(
            out=str(self.folder), version=version(), effort=self.effort, seed=self.seed, av=options.av,
            bounded=self.mask.bounded, budget=self.mask.budget, reward=options.reward, nde=found["nde"].rate,
            natural=found["natural"], natural_cases=found["natural_cases"].analysed,
            train=RunTrained(**vars(policy), **vars(found["evaluate"])), baselines=found["baselines"].rates,
            generate=found["generate"], analyse=found["analyse"], spending=found.get("spending"),
            report=str(self.folder / "report.html"), seconds=round(time.perf_counter() - self._begun, 3),
        )  # fmt: skip
        write_json(self.folder / SUMMARY, as_json(done))
        made = provenance({**identity, "policy_hash": policy.policy_hash}, done.seconds)
        write_json(self.folder / "provenance.json", {**made, "point_seconds": list(found["train"].point_seconds)})
        write_report(self.folder)
        options.progress("report", 1, 1)
        return done


def _write_exposure(out: Path, nde: Counted, adversary: Counted) -> None:
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
