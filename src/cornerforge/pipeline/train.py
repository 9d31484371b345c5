"""`train`: learn an adversary and measure it on tests that it never saw."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cornerforge._checks import check_integer, check_number
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.adversary.policy_file import Policy, load_policy, policy_hash, save_policy
from cornerforge.drivers.avs import av_hash
from cornerforge.errors import OutputError
from cornerforge.ndd.model import model_hash
from cornerforge.pipeline.output import check_new_file, code_hash, version
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.pipeline.simulate import rate_summary, simulate_experiment
from cornerforge.sim.adversaries import ADVERSARIES, NO_CAST

if TYPE_CHECKING:
    from cornerforge.adversary.train import CurvePoint, TrainResult

__all__ = ["BASELINES", "EVALUATION_TESTS", "checkpoint_beside", "evaluate", "learn", "measure_baselines", "train"]

EVALUATION_TESTS = 1 << 41
"""Number of the first evaluation test: far from those of training and of generation."""
BASELINES = ("uniform", "lane-changer", "swerve")
"""Plain adversaries that every yield is shown beside."""


def _about(run: Experiment, config: TrainConfig, result: TrainResult, seed: int) -> dict[str, Any]:
    return {
        "cornerforge": version(),
        "code": code_hash(),
        "train": asdict(config),
        "seed": seed,
        "odd": asdict(run.odd),
        "av": run.av.name,
        "av_hash": av_hash(run.av),
        "model_hash": model_hash(run.model),
        "decisions": result.decisions,
        "updates": result.updates,
        "curve": [asdict(point) for point in result.curve],
    }


def checkpoint_beside(policy: Path, run: Experiment, config: TrainConfig, seed: int) -> CheckpointFile:
    """Where the training that shall make `policy` keeps its state; other settings or other code are refused there."""
    identity = {
        "seed": seed,
        "bounded": run.bounded,
        "budget": run.budget,
        "av_hash": av_hash(run.av),
        "model_hash": model_hash(run.model),
        **{f"train.{name}": value for name, value in asdict(config).items()},
        **{f"odd.{name}": value for name, value in asdict(run.odd).items()},
        "code": code_hash(),
    }
    return CheckpointFile(policy.with_name(f"{policy.name}.checkpoint"), identity)


def learn(
    run: Experiment,
    config: TrainConfig,
    *,
    seed: int,
    threads: int | None = None,
    max_seconds: float | None = None,
    progress: Progress = NO_PROGRESS,
    checkpoint: CheckpointFile | None = None,
) -> tuple[Policy, TrainResult]:
    """Train on an experiment (`bounded` and `budget` give its mask), or go on with what the checkpoint holds."""
    from cornerforge.adversary.train import train_adversary

    def report(point: CurvePoint) -> None:
        if max_seconds is None:
            progress("train", point.decisions, config.decisions)
        else:
            progress("train", min(point.seconds, max_seconds), max_seconds)

    result = train_adversary(
        run.setting,
        run.slots,
        config,
        seed=seed,
        threads=check_threads(threads),
        max_seconds=max_seconds,
        progress=report,
        checkpoint=checkpoint,
    )
    policy = Policy(result.weights, config.network, run.bounded, _about(run, config, result, seed), run.budget)
    return policy, result


def evaluate(
    run: Experiment, *, tests: int, seed: int, threads: int | None = None, progress: Progress = NO_PROGRESS
) -> dict[str, Any]:
    """Crash rate of an experiment on evaluation tests."""
    tally, _ = simulate_experiment(
        run, tests=tests, seed=seed, first=EVALUATION_TESTS, threads=threads, progress=progress, stage="evaluate"
    )
    return rate_summary(tally.av_crashes, tally.tests, tally.miles)


def measure_baselines(
    run: Experiment, *, tests: int, seed: int, threads: int | None = None, progress: Progress = NO_PROGRESS
) -> list[dict[str, Any]]:
    """Crash rates of the plain adversaries under the run's mask, on the same evaluation tests."""
    rates = []
    for name in BASELINES:
        setting = run.setting._replace(adversary=ADVERSARIES[name], bounded=int(run.bounded), cast=NO_CAST)
        plain = replace(run, setting=setting, bv=name, policies=(), acting="greedy")
        rates.append({"name": name, **evaluate(plain, tests=tests, seed=seed, threads=threads, progress=progress)})
    return rates


def train(
    *,
    out: Path | str,
    av: str = "idm-mobil",
    preset: str = "fast",
    bounded: bool = False,
    budget: float | None = None,
    decisions: int | None = None,
    minutes: float | None = None,
    resume: bool = False,
    lanes: int | None = None,
    odd: str = "default",
    model: Path | str | None = None,
    tests: int = 4096,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> dict[str, Any]:
    """Train the adversary (dueling double DQN) and write its policy.

    Args:
        out: Policy file, `.safetensors`; must not exist unless `resume`.
        av: AV to learn on.
        preset: "fast" or "paper".
        bounded: Only actions that the naturalistic model calls possible.
        budget: Likelihood budget of a test [nats], 0 or more; implies `bounded`. By so much, in all, may the
            log-probability of its actions fall short of the likeliest actions'.
        decisions: Length in decisions; None for the preset's own. Same seed and decisions, same weights.
        minutes: Stop after this time [min]; the result then depends on the machine's speed.
        resume: Go on with a training of the same command that was stopped (its state is in `OUT.checkpoint`); the
            weights are those of a training without the stop, unless `minutes` ends it. Where `out` holds a finished
            policy of the same seed, length and world, keep it and only measure it again.
        lanes, odd, model: The world, as for `simulate`.
        tests: Evaluation tests.
        seed: 0 or more.
        threads: None for all cores; does not change the weights.
        progress: Told how far it is.

    Returns:
        The object that `cornerforge train --json` prints.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    path = Path(out)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("tests", tests, low=1, high=10**9)
    config = preset_named(preset)
    if decisions is not None:
        config = replace(config, decisions=check_integer("decisions", decisions, low=1, high=10**12))
    if minutes is not None:
        check_number("minutes", minutes, low=0.01, high=1e5, unit="min")
    run = experiment(
        av=av, odd=odd, lanes=lanes, model=None if model is None else Path(model), bv="uniform", bounded=bounded,
        budget=budget,
    )  # fmt: skip
    check_new_file(path, overwrite=resume)
    checkpoint = checkpoint_beside(path, run, config, seed)
    check_new_file(checkpoint.path, overwrite=True)
    if not resume:
        checkpoint.check_absent()
    kept = resume and path.exists()
    if kept:
        policy = load_policy(path)
        _check_same(policy, run, config, seed, path)
        checkpoint.read()  # only a checkpoint of this training is removed below
        seconds = 0.0
    else:
        policy, result = learn(
            run,
            config,
            seed=seed,
            threads=threads,
            max_seconds=None if minutes is None else 60.0 * minutes,
            progress=progress,
            checkpoint=checkpoint,
        )
        save_policy(policy, path)
        seconds = result.seconds
    checkpoint.remove()
    trained = experiment(av=av, odd=odd, lanes=lanes, model=None if model is None else Path(model), policy=policy)
    rate = evaluate(trained, tests=tests, seed=seed, threads=threads, progress=progress)
    return {
        "decisions": policy.about["decisions"],
        "updates": policy.about["updates"],
        "seconds": round(seconds, 3),
        "preset": preset,
        "bounded": run.bounded,
        "budget": run.budget,
        **rate,
        "baselines": measure_baselines(run, tests=tests, seed=seed, threads=threads, progress=progress),
        "policy_hash": policy_hash(policy),
        "kept": kept,
        "out": str(path),
    }


def _check_same(policy: Policy, run: Experiment, config: TrainConfig, seed: int, path: Path) -> None:
    """A kept policy must be the one that this command would train.

    Raises:
        OutputError: It is another one.
    """
    found = {**policy.about, "bounded": policy.bounded, "budget": policy.budget}
    wanted = {
        "seed": seed,
        "bounded": run.bounded,
        "budget": run.budget,
        "av_hash": av_hash(run.av),
        "model_hash": model_hash(run.model),
        "train": asdict(config),
        "odd": asdict(run.odd),
    }
    for key, value in wanted.items():
        if found.get(key) != value:
            raise OutputError(f"{path} holds a policy of another {key}; choose another place, or remove it.")
