"""`run`: the whole job in stages; each leaves a file when it is done, so a killed run goes on there."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from cornerforge._checks import check_integer
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.adversary.policy_file import load_policy, policy_hash, save_policy
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
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.pipeline.train import (
    canonical_curve,
    checkpoint_beside,
    evaluate,
    learn,
    measure_baselines,
    point_seconds,
)
from cornerforge.sim.runner import Tally
from cornerforge.sim.statistics import EXPOSURE, TRAFFIC, grid_edges
from cornerforge.world_options import AvKeywords, WorldOptions

__all__ = ["EFFORTS", "Effort", "run"]

EXPOSURE_TESTS_START = 1 << 42
"""Number of the first test whose distances and TTC are counted with the adversary."""


@dataclass(frozen=True)
class Effort:
    """How much of everything a run does; in counts, never in seconds, so that results do not depend on speed."""

    nde_tests: int
    decisions: int
    evaluation_tests: int
    exposure_tests: int
    cases: int


EFFORTS = {
    "quick": Effort(nde_tests=200_000, decisions=2_500_000, evaluation_tests=2_048, exposure_tests=1_024, cases=1_500),
    "standard": Effort(
        nde_tests=1_000_000, decisions=6_000_000, evaluation_tests=8_192, exposure_tests=4_096, cases=10_000
    ),
    "paper": Effort(
        nde_tests=10_000_000, decisions=20_000_000, evaluation_tests=8_192, exposure_tests=8_192, cases=50_000
    ),
}
"""quick: within 3 minutes on two cores; standard: within 15; paper: as many cases as the paper had (about 50,000)."""


_POINT_SECONDS = "point_seconds"
"""In provenance.json: when the points of training.json were reached, which itself tells no times."""


class _Stages:
    """Runs each stage once; its result is kept in `stages/NAME.json`, which appears only when the stage is whole."""

    def __init__(self, out: Path) -> None:
        self._folder = out / "stages"

    def do(self, name: str, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        path = self._folder / f"{name}.json"
        if path.exists():
            return read_json_file(path)
        result = work()
        write_json(path, result)
        # What the file gives back is what a resumed run sees, so that is what this one goes on with too.
        content: dict[str, Any] = json.loads(json.dumps(result))
        return content


def _exposure_counts(tally: Tally) -> dict[str, list[int]]:
    rows = tally.counts.histograms[len(TRAFFIC) :]
    return {grid.name: rows[k][: grid.bins].tolist() for k, grid in enumerate(EXPOSURE)}


def _count(
    run: Experiment, tests: int, first: int, seed: int, threads: int | None, progress: Progress, stage: str
) -> dict[str, Any]:
    """Drive tests with all histograms; the summary of `simulate` with what the AV was exposed to."""
    tally, seconds = simulate_experiment(
        run, tests=tests, seed=seed, first=first, threads=threads, counting=True, progress=progress, stage=stage
    )
    return {"rate": tally_summary(tally, seconds, with_distributions=True), "exposure": _exposure_counts(tally)}


_LABELS = {
    "bbd_front": "Bumper-to-bumper distance to the vehicle ahead",
    "bbd_rear": "Bumper-to-bumper distance to the vehicle behind",
    "ttc_front": "Time to collision with the vehicle ahead, when closing",
    "ttc_rear": "Time to collision with the vehicle behind, when closing",
}


def _write_exposure(out: Path, nde: dict[str, Any], adversary: dict[str, Any]) -> None:
    """`exposure.json`: the paper's Figure 3; the last bin holds all beyond the grid and is left out."""
    quantities = {}
    for grid in EXPOSURE:
        quantities[grid.name] = {
            "label": _LABELS[grid.name],
            "unit": grid.unit,
            "edges": grid_edges(grid)[:-1].tolist(),
            "nde": nde["exposure"][grid.name][:-1],
            "adversary": adversary["exposure"][grid.name][:-1],
        }
    miles = {"nde": nde["rate"]["miles"], "adversary": adversary["rate"]["miles"]}
    write_json(out / "exposure.json", {"miles": miles, "quantities": quantities})


def _train(
    run: Experiment, size: Effort, checkpoint: CheckpointFile, out: Path, seed: int, threads: int | None,
    progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    config = _train_config(size)
    policy, result = learn(run, config, seed=seed, threads=threads, progress=progress, checkpoint=checkpoint)
    save_policy(policy, out / "policy.safetensors")
    points = canonical_curve(result)
    write_json(out / "training.json", {"preset": config.preset, "config": asdict(config), "points": points})
    return {
        "decisions": result.decisions,
        "updates": result.updates,
        "seconds": round(result.seconds, 3),
        "preset": config.preset,
        "policy_hash": policy_hash(policy),
        _POINT_SECONDS: point_seconds(result),
    }


def _plain_rates(
    plain: Experiment, tests: int, seed: int, threads: int | None, progress: Progress
) -> list[dict[str, Any]]:
    """Yields of the plain adversaries; what happens with nobody is the natural traffic, counted on many more tests."""
    rates = measure_baselines(plain, tests=tests, seed=seed, threads=threads, progress=progress)
    return [rate for rate in rates if rate["name"] != "nobody"]


def _train_config(size: Effort) -> TrainConfig:
    return replace(preset_named("fast"), decisions=size.decisions)


def _identity(plain: Experiment, effort: str, seed: int) -> dict[str, Any]:
    """What decides the results of a run; there is no policy yet, and the BVs are driven in more than one way."""
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
    effort: str = "quick",
    budget: float | str | None = None,
    out: Path | str = "cornerforge-out",
    bounded: bool = False,
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[AvKeywords],
) -> dict[str, Any]:
    """The whole job: natural baseline, training, cases, analysis, report.

    Args:
        effort: "quick", "standard" or "paper" (see `EFFORTS`).
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
        The object that `cornerforge run --json` prints; also in `summary.json`.

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
    natural = experiment(options)
    plain = experiment(options, bv="uniform", bounded=bounded, budget=budget)
    identity = _identity(plain, effort, seed)
    open_output(folder, identity, resume=resume)
    stages = _Stages(folder)

    def once(name: str, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        return stages.do(name, work)

    nde = once("nde", lambda: _count(natural, size.nde_tests, 0, seed, threads, progress, "natural traffic"))
    checkpoint = checkpoint_beside(folder / "policy.safetensors", plain, _train_config(size), seed)
    trained = once("train", lambda: _train(plain, size, checkpoint, folder, seed, threads, progress))
    checkpoint.remove()
    times = {_POINT_SECONDS: trained.pop(_POINT_SECONDS, None)}  # a stage of an older version has none
    hostile = experiment(options, policy=load_policy(folder / "policy.safetensors"))
    tests = size.evaluation_tests
    evaluation = once("evaluate", lambda: evaluate(hostile, tests=tests, seed=seed, threads=threads, progress=progress))
    baselines = once(
        "baselines",
        lambda: {"rates": _plain_rates(plain, tests, seed, threads, progress)},
    )
    exposed = once(
        "exposure",
        lambda: _count(hostile, size.exposure_tests, EXPOSURE_TESTS_START, seed, threads, progress, "exposure"),
    )
    _write_exposure(folder, nde, exposed)
    filled = once(
        "generate",
        lambda: fill_library(
            hostile, folder / "library", seed=seed, cases=size.cases, threads=threads, resume=True, progress=progress
        ),
    )
    analysed = once(
        "analyse", lambda: analyse(folder / "library", out=folder / "analysis", seed=seed, progress=progress)
    )
    summary = {
        "out": str(folder),
        "version": version(),
        "effort": effort,
        "seed": seed,
        "av": options.av,
        "bounded": plain.bounded,
        "budget": plain.budget,
        "nde": nde["rate"],
        "train": {**trained, **evaluation},
        "baselines": baselines["rates"],
        "generate": filled,
        "analyse": analysed,
        "report": str(folder / "report.html"),
    }
    return _finish(folder, summary, {**identity, "policy_hash": trained["policy_hash"]}, times, start, progress)


def _finish(
    folder: Path, summary: dict[str, Any], identity: dict[str, Any], times: dict[str, Any], start: float,
    progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """Write the summary and the report; `seconds` counts this call and, after a kill, not the ones before."""
    from cornerforge.report import write_report

    progress("report", 0, 1)
    summary = {**summary, "seconds": round(time.perf_counter() - start, 3)}
    write_json(folder / "summary.json", summary)
    write_json(folder / "provenance.json", {**provenance(identity, summary["seconds"]), **times})
    write_report(folder)
    progress("report", 1, 1)
    return summary
