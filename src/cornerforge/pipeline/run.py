"""`run` does the whole job in stages; each finished stage leaves a file, so a killed run goes on after it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, Unpack

from cornerforge._checks import check_integer
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.adversary.policy_file import load_policy, policy_hash, save_policy
from cornerforge.errors import FileFormatError
from cornerforge.pipeline.analyse import analyse
from cornerforge.pipeline.counting import simulate_experiment, tally_summary
from cornerforge.pipeline.effort import effort_and_budget
from cornerforge.pipeline.generate import fill_library
from cornerforge.pipeline.output import (
    code_hash,
    config_hash,
    open_output,
    provenance,
    read_json_file,
    version,
    write_json,
)
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.rate import rate
from cornerforge.pipeline.setting import AV_LOG, Experiment, check_threads, experiment
from cornerforge.pipeline.train import (
    canonical_curve,
    checkpoint_beside,
    evaluate,
    learn,
    measure_baselines,
    point_seconds,
    training_faults,
)
from cornerforge.results import Analysed, Filled, NaturalRate, RunDone, Simulated, as_json, from_json
from cornerforge.results.learning import Baseline, LearnedPolicy, TrainingCurve, TrainingPoint
from cornerforge.results.rates import Yield
from cornerforge.results.whole import Exposed, Exposure, ExposureMiles, RunTrained
from cornerforge.sim import Tally, statistics
from cornerforge.world_options import AvKeywords, WorldOptions

__all__ = ["EFFORTS", "Effort", "run"]

T = TypeVar("T")

EXPOSURE_TESTS_START = 1 << 42
"""Number of the first test whose distances and TTC are counted with the adversary."""


@dataclass(frozen=True)
class Effort:
    """The amount of work in a run, as counts, never as seconds, so that results do not depend on speed.

    The natural rate ends at a relative half-width of `natural_rhw`, at the latest after `natural_tests` tests.
    """

    nde_tests: int
    natural_tests: int
    natural_rhw: float
    decisions: int
    evaluation_tests: int
    exposure_tests: int
    cases: int


EFFORTS = {
    "quick": Effort(
        nde_tests=200_000, natural_tests=1_000_000, natural_rhw=0.3, decisions=2_500_000, evaluation_tests=2_048,
        exposure_tests=1_024, cases=1_500,
    ),
    "standard": Effort(
        nde_tests=1_000_000, natural_tests=3_000_000, natural_rhw=0.15, decisions=6_000_000, evaluation_tests=8_192,
        exposure_tests=4_096, cases=10_000,
    ),
    "paper": Effort(
        nde_tests=10_000_000, natural_tests=10_000_000, natural_rhw=0.1, decisions=20_000_000, evaluation_tests=8_192,
        exposure_tests=8_192, cases=50_000,
    ),
}  # fmt: skip
"""quick: within 4 minutes on two cores; standard: within 15; paper: as many cases as the paper had (about 50,000)."""


class _Stages:
    """Runner of stages: each runs once; `stages/NAME.json` holds its result and appears only when it is complete."""

    def __init__(self, out: Path) -> None:
        self._folder = out / "stages"

    def do(self, name: str, kind: type[T], work: Callable[[], T]) -> T:
        path = self._folder / f"{name}.json"
        if not path.exists():
            write_json(path, as_json(work()))
        # A resumed run reads the result from the file, so this run goes on with the same values.
        content = read_json_file(path)
        try:
            return from_json(kind, content)
        except FileFormatError as error:
            raise FileFormatError(f"{path} is damaged ({error}); remove it, or choose another place.") from error


@dataclass(frozen=True)
class _Counted:
    """Tests with all histograms: their result, and the AV's exposure as counts by quantity."""

    rate: Simulated
    exposure: dict[str, tuple[int, ...]]


@dataclass(frozen=True)
class _Trained:
    """A training, and when the points of its curve were reached [s]."""

    policy: LearnedPolicy
    point_seconds: tuple[float, ...]


@dataclass(frozen=True)
class _PlainRates:
    rates: tuple[Baseline, ...]


@dataclass(frozen=True)
class _NaturalCases:
    """What is in the library of natural crashes; None: nothing."""

    analysed: Analysed | None


def _exposure_counts(tally: Tally) -> dict[str, tuple[int, ...]]:
    rows = tally.counts.histograms[len(statistics.TRAFFIC) :]
    return {grid.name: tuple(rows[k][: grid.bins].tolist()) for k, grid in enumerate(statistics.EXPOSURE)}


def _count(
    run: Experiment, tests: int, first: int, seed: int, threads: int | None, progress: Progress, stage: str
) -> _Counted:
    tally, seconds = simulate_experiment(
        run, tests=tests, seed=seed, first=first, threads=threads, counting=True, progress=progress, stage=stage
    )
    return _Counted(tally_summary(tally, seconds, with_distributions=True), _exposure_counts(tally))


_LABELS = {
    "bbd_front": "Bumper-to-bumper distance to the vehicle ahead",
    "bbd_rear": "Bumper-to-bumper distance to the vehicle behind",
    "ttc_front": "Time to collision with the vehicle ahead, when closing",
    "ttc_rear": "Time to collision with the vehicle behind, when closing",
}


def _write_exposure(out: Path, nde: _Counted, adversary: _Counted) -> None:
    """Write `exposure.json`, the paper's Figure 3, without the last bin, which holds all values beyond the grid."""
    quantities = {
        grid.name: Exposed(
            label=_LABELS[grid.name],
            unit=grid.unit,
            edges=tuple(statistics.grid_edges(grid)[:-1].tolist()),
            nde=nde.exposure[grid.name][:-1],
            adversary=adversary.exposure[grid.name][:-1],
        )
        for grid in statistics.EXPOSURE
    }
    miles = ExposureMiles(nde=nde.rate.miles, adversary=adversary.rate.miles)
    write_json(out / "exposure.json", as_json(Exposure(miles=miles, quantities=quantities)))


def _train(
    run: Experiment, size: Effort, checkpoint: CheckpointFile, out: Path, seed: int, threads: int | None,
    progress: Progress,
) -> _Trained:  # fmt: skip
    config = _train_config(size)
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
    return _Trained(learned, tuple(point_seconds(result)))


def _plain_rates(plain: Experiment, tests: int, seed: int, threads: int | None, progress: Progress) -> _PlainRates:
    """Measure the plain adversaries; traffic without an adversary is measured as the baseline, on many more tests."""
    rates = measure_baselines(plain, tests=tests, seed=seed, threads=threads, progress=progress)
    return _PlainRates(tuple(rate for rate in rates if rate.name != "nobody"))


def _natural_cases(found: NaturalRate, folder: Path, seed: int, progress: Progress) -> _NaturalCases:
    """Analyse the crashes that a natural rate left in its folder."""
    if found.crashes_per_test == 0.0:
        return _NaturalCases(None)
    cases = folder / ("library" if found.method == "mc" else "weighted")
    return _NaturalCases(analyse(cases, out=folder / "analysis", seed=seed, progress=progress))


def _train_config(size: Effort) -> TrainConfig:
    return replace(preset_named("fast"), decisions=size.decisions)


def _identity(plain: Experiment, effort: str, seed: int) -> dict[str, Any]:
    """Return what decides the results of a run, without a policy and a way to drive BVs: a run has several of them."""
    identity: dict[str, Any] = plain.identity(seed)
    size = EFFORTS[effort]
    settings = {"world": identity.pop("config_hash"), "effort": asdict(size), "train": asdict(_train_config(size))}
    del identity["bv"], identity["policy_hash"]
    return {
        **identity,
        "effort": effort,
        "config_hash": config_hash(settings),
        "cornerforge": version(),
        "code": code_hash(),
    }


def run(
    *,
    effort: str | None = None,
    budget: float | str | None = None,
    out: Path | str = "cornerforge-out",
    bounded: bool = False,
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[AvKeywords],
) -> RunDone:
    """Do the whole job: natural traffic, natural crash rate, training, cases, analyses, report.

    Args:
        effort: "quick", "standard" or "paper" (see `EFFORTS`); None: "quick".
        budget: Likelihood budget of a test [nats], as for `train`; implies `bounded`. A name is taken for `effort`, as
            it once was called, with a warning.
        out: Folder for everything; must be new or empty unless `resume`.
        bounded: The adversary uses only actions that the naturalistic model calls possible.
        resume: Go on with what is in `out`; finished stages are kept, and an unfinished training too.
        seed: 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
        world: The world, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge run --json` prints, and `summary.json` holds: the result of each stage.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    start = time.perf_counter()
    folder = Path(out)
    effort, budget = effort_and_budget(effort, budget, EFFORTS)
    size = EFFORTS[effort]
    check_integer("seed", seed, low=0, high=2**32 - 1)
    check_threads(threads)
    options = WorldOptions(**world)
    natural = experiment(options, takes_foreign=True, seed=seed)
    plain = experiment(options, bv="uniform", bounded=bounded, budget=budget, takes_foreign=True, seed=seed)
    identity = _identity(plain, effort, seed)
    open_output(folder, identity, resume=resume)
    for one in (natural, plain):
        one.keep_printed(folder / AV_LOG)
    once = _Stages(folder).do
    nde = once("nde", _Counted, lambda: _count(natural, size.nde_tests, 0, seed, threads, progress, "natural traffic"))
    natural.rest()
    often = once(
        "natural",
        NaturalRate,
        lambda: rate(
            target_rhw=size.natural_rhw, max_tests=size.natural_tests, out=folder / "natural", resume=True, seed=seed,
            threads=threads, progress=progress, **world,
        ),
    )  # fmt: skip
    natural_cases = once(
        "natural_cases", _NaturalCases, lambda: _natural_cases(often, folder / "natural", seed, progress)
    )
    checkpoint = checkpoint_beside(folder / "policy.safetensors", plain, _train_config(size), seed)
    trained = once("train", _Trained, lambda: _train(plain, size, checkpoint, folder, seed, threads, progress))
    checkpoint.remove()
    policy = load_policy(folder / "policy.safetensors")
    hostile = experiment(options, policy=policy, takes_foreign=True, seed=seed)
    hostile.keep_printed(folder / AV_LOG)
    tests = size.evaluation_tests
    evaluation = once(
        "evaluate", Yield, lambda: evaluate(hostile, tests=tests, seed=seed, threads=threads, progress=progress)
    )
    baselines = once("baselines", _PlainRates, lambda: _plain_rates(plain, tests, seed, threads, progress))
    exposed = once(
        "exposure",
        _Counted,
        lambda: _count(hostile, size.exposure_tests, EXPOSURE_TESTS_START, seed, threads, progress, "exposure"),
    )
    _write_exposure(folder, nde, exposed)
    filled = once(
        "generate",
        Filled,
        lambda: fill_library(
            hostile, folder / "library", seed=seed, cases=size.cases, threads=threads, resume=True, progress=progress
        ),
    )
    analysed = once(
        "analyse", Analysed, lambda: analyse(folder / "library", out=folder / "analysis", seed=seed, progress=progress)
    )
    from cornerforge.report import write_report

    progress("report", 0, 1)
    done = RunDone(
        out=str(folder),
        version=version(),
        effort=effort,
        seed=seed,
        av=options.av,
        bounded=plain.bounded,
        budget=plain.budget,
        nde=nde.rate,
        natural=often,
        natural_cases=natural_cases.analysed,
        train=RunTrained(**vars(trained.policy), **vars(evaluation)),
        baselines=baselines.rates,
        generate=filled,
        analyse=analysed,
        report=str(folder / "report.html"),
        seconds=round(time.perf_counter() - start, 3),
    )
    write_json(folder / "summary.json", as_json(done))
    made = provenance({**identity, "policy_hash": trained.policy.policy_hash}, done.seconds)
    write_json(folder / "provenance.json", {**made, "point_seconds": list(trained.point_seconds)})
    write_report(folder)
    progress("report", 1, 1)
    return done
