"""`train`: learn an adversary and measure it on tests that it never saw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from cornerforge._checks import check_integer, check_number
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.adversary.policy_file import Policy, load_policy, policy_hash, save_policy
from cornerforge.drivers.avs import av_hash
from cornerforge.errors import OutputError
from cornerforge.ndd.model import model_hash
from cornerforge.pipeline.counting import rate_summary
from cornerforge.pipeline.output import check_new_file, code_hash, provenance, read_json_file, version, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.rates import binomial_interval
from cornerforge.results import Baseline, Trained, Yield
from cornerforge.sim.judge import judge_crashes
from cornerforge.sim.rewards import reward_numbers
from cornerforge.sim.runner import Tally, crashed_tests, simulate_chunks
from cornerforge.sim.setting import ADVERSARIES, NO_CAST
from cornerforge.world_options import WorldKeywords, WorldOptions

if TYPE_CHECKING:
    from cornerforge.adversary.train import CurvePoint, TrainResult

__all__ = [
    "BASELINES",
    "EVALUATION_TESTS",
    "canonical_curve",
    "checkpoint_beside",
    "curve_report",
    "evaluate",
    "learn",
    "load_timed_policy",
    "measure_baselines",
    "point_seconds",
    "provenance_beside",
    "train",
    "write_provenance_beside",
]

EVALUATION_TESTS = 1 << 41
"""Number of the first evaluation test: far from those of training and of generation."""
BASELINES = ("uniform", "lane-changer", "swerve")
"""Plain adversaries that every yield is shown beside, each unmasked and masked; and so is driving with nobody."""


def _about(run: Experiment, config: TrainConfig, result: TrainResult, seed: int) -> dict[str, Any]:
    return {
        "cornerforge": version(),
        "code": code_hash(),
        "train": asdict(config),
        "seed": seed,
        "odd": run.odd.stated(),
        "av": run.av.name,
        "av_hash": av_hash(run.av),
        "model_hash": model_hash(run.model),
        "decisions": result.decisions,
        "updates": result.updates,
        "curve": canonical_curve(result),
    }


def canonical_curve(result: TrainResult) -> list[dict[str, Any]]:
    """The training curve for files, without times: the same training gives the same bytes, however long it took."""
    return [asdict(point) | {"seconds": None} for point in result.curve]


def point_seconds(result: TrainResult) -> list[float]:
    """When the points of the curve were reached [s], for provenance files."""
    return [point.seconds for point in result.curve]


def provenance_beside(policy: Path) -> Path:
    """Where it stands when and how long a policy was trained: beside NAME.safetensors in NAME.provenance.json."""
    return policy.with_name(f"{policy.stem}.provenance.json")


def write_provenance_beside(policy: Path, run: Experiment, result: TrainResult, seed: int) -> None:
    """Write it.

    Raises:
        OutputError: It cannot be written.
    """
    identity = {**run.identity(seed), "code": code_hash()}
    times = {"point_seconds": point_seconds(result)}
    write_json(provenance_beside(policy), {**provenance(identity, round(result.seconds, 3)), **times})


def load_timed_policy(path: Path) -> Policy:
    """A policy whose curve tells times, from the provenance beside it; policies of old carry them themselves.

    Raises:
        FileFormatError: A file is damaged.
    """
    policy = load_policy(path)
    curve, beside = policy.about.get("curve"), provenance_beside(path)
    if not isinstance(curve, list) or not beside.exists():
        return policy
    seconds = read_json_file(beside).get("point_seconds")
    if not isinstance(seconds, list) or len(seconds) != len(curve):
        return policy  # of another policy that stood here before
    timed = [{**point, "seconds": at} for point, at in zip(curve, seconds, strict=True)]
    return replace(policy, about={**policy.about, "curve": timed})


def checkpoint_beside(policy: Path, run: Experiment, config: TrainConfig, seed: int) -> CheckpointFile:
    """Where the training that shall make `policy` keeps its state; other settings or other code are refused there."""
    identity = {
        "seed": seed,
        "bounded": run.bounded,
        "budget": run.budget,
        "av_hash": av_hash(run.av),
        "model_hash": model_hash(run.model),
        **{f"train.{name}": value for name, value in asdict(config).items()},
        **{f"odd.{name}": value for name, value in run.odd.stated().items()},
        "code": code_hash(),
    }
    return CheckpointFile(policy.with_name(f"{policy.name}.checkpoint"), identity)


def curve_report(progress: Progress, config: TrainConfig, max_seconds: float | None) -> Callable[[CurvePoint], None]:
    """Tell how far a training is: in decisions, or in seconds where the time ends it."""

    def report(point: CurvePoint) -> None:
        if max_seconds is None:
            progress("train", point.decisions, config.decisions)
        else:
            progress("train", min(point.seconds, max_seconds), max_seconds)

    return report


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

    result = train_adversary(
        run.setting,
        run.slots,
        config,
        seed=seed,
        threads=check_threads(threads),
        max_seconds=max_seconds,
        progress=curve_report(progress, config, max_seconds),
        checkpoint=checkpoint,
    )
    policy = Policy(result.weights, config.network, run.bounded, _about(run, config, result, seed), run.budget)
    return policy, result


def evaluate(
    run: Experiment,
    *,
    tests: int,
    seed: int,
    delay_s: float = 1.0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> Yield:
    """Yield of an experiment on evaluation tests: all crashes, those avoidable by braking, those that the AV struck in.

    Args:
        run: The experiment.
        tests: How many, at least 1.
        seed: Of the tests.
        delay_s: The AV's time to react, for `sim.braking.is_avoidable` [s].
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
    """
    tally, crashed = Tally(), []
    n_threads = check_threads(threads)
    for first, out, counts in simulate_chunks(
        run.setting, run.slots, seed=seed, first=EVALUATION_TESTS, tests=tests, threads=n_threads
    ):
        tally.add(out, counts)
        crashed += crashed_tests(first, out)
        progress("evaluate", tally.tests, tests)
    braking = reward_numbers("avoidable", delay_s).braking
    strikes, avoidable = judge_crashes(
        run.setting, run.slots, seed=seed, tests=crashed, braking=braking, threads=n_threads
    )
    n_avoidable, n_strikes = int(avoidable.sum()), int(strikes.sum())
    return Yield(
        **vars(rate_summary(tally.av_crashes, tally.tests, tally.miles)),
        avoidable_per_test=n_avoidable / tests,
        avoidable_interval95=binomial_interval(n_avoidable, tests),
        striking_share=n_strikes / len(crashed) if crashed else None,
        striking_interval95=binomial_interval(n_strikes, len(crashed)) if crashed else None,
    )


def measure_baselines(
    run: Experiment,
    *,
    tests: int,
    seed: int,
    delay_s: float = 1.0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> tuple[Baseline, ...]:
    """Yields of nobody and of the plain adversaries, each with and without the NDD-bounded mask, on the same tests.

    Nobody, who has no mask, is measured once.
    """
    rates = []
    for name in ("nobody", *BASELINES):
        for bounded in (False,) if name == "nobody" else (False, True):
            budget = run.setting.who.budget if bounded else 0
            setting = run.setting.with_drivers(
                critical=ADVERSARIES[name], bounded=int(bounded), budget=budget, temperature=0.0, cast=NO_CAST
            )
            plain = replace(run, setting=setting, bv=name, bounded=bounded, policies=(), acting="greedy")
            rate = evaluate(plain, tests=tests, seed=seed, delay_s=delay_s, threads=threads, progress=progress)
            rates.append(Baseline(name=f"{name}, bounded" if bounded else name, bounded=bounded, **vars(rate)))
    return tuple(rates)


def train(
    *,
    out: Path | str,
    preset: str = "fast",
    reward: str = "crash",
    delay: float = 1.0,
    decisions: int | None = None,
    minutes: float | None = None,
    resume: bool = False,
    tests: int = 8192,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[WorldKeywords],
) -> Trained:
    """Train the adversary (dueling double DQN) and write its policy.

    The policy is the one at the end of training: none is picked by a look at tests. It is measured, as are the plain
    adversaries beside it, on evaluation tests, which no training and no generation ever uses.

    Args:
        out: Policy file, `.safetensors`; must not exist unless `resume`. When and how long it was trained stands in
            `NAME.provenance.json` beside it: the policy is the same bytes for the same training.
        preset: "fast" or "paper".
        reward: Which crashes of the AV are paid for: a name of `sim.rewards.REWARDS`.
        delay: For the reward `avoidable`, and for counting avoidable crashes: the AV's time to react [s].
        decisions: Length in decisions; None for the preset's own. Same seed and decisions, same weights (on another
            processor PyTorch may round otherwise, and other weights come out).
        minutes: Stop after this time [min], and let the learning rate fall over it; the result then depends on the
            machine's speed. With `decisions` too, what comes first ends it.
        resume: Go on with a training of the same command that was stopped (its state is in `OUT.checkpoint`); the
            weights are those of a training without the stop, unless `minutes` ends it. Where `out` holds a finished
            policy of the same seed, length and world, keep it and only measure it again.
        tests: Evaluation tests.
        seed: 0 or more.
        threads: None for all cores; does not change the weights.
        progress: Told how far it is.
        world: The world to learn in, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge train --json` prints: the yield, those of plain adversaries, and where the policy is.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    path = Path(out)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("tests", tests, low=1, high=10**9)
    config = replace(preset_named(preset), reward=reward, delay_s=delay)
    if decisions is not None:
        config = replace(config, decisions=check_integer("decisions", decisions, low=1, high=10**12))
    if minutes is not None:
        check_number("minutes", minutes, low=0.01, high=1e5, unit="min")
        if decisions is None:
            config = replace(config, decisions=10**12)  # the time alone ends it
    options = WorldOptions(**world)
    run = experiment(options, bv="uniform")
    check_new_file(path, overwrite=resume)
    checkpoint = checkpoint_beside(path, run, config, seed)
    check_new_file(checkpoint.path, overwrite=True)
    check_new_file(provenance_beside(path), overwrite=True)
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
        write_provenance_beside(path, run, result, seed)
        seconds = result.seconds
    checkpoint.remove()
    trained = experiment(options.without_mask(), policy=policy)
    measured: dict[str, Any] = {"tests": tests, "seed": seed, "delay_s": delay, "threads": threads}
    about: Any = policy.about
    return Trained(
        decisions=about["decisions"],
        updates=about["updates"],
        seconds=round(seconds, 3),
        preset=preset,
        bounded=run.bounded,
        budget=run.budget,
        reward=reward,
        delay_s=delay,
        **vars(evaluate(trained, **measured, progress=progress)),
        baselines=measure_baselines(run, **measured, progress=progress),
        policy_hash=policy_hash(policy),
        kept=kept,
        out=str(path),
    )


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
        "odd": run.odd.stated(),
    }
    for key, value in wanted.items():
        if found.get(key) != value:
            raise OutputError(f"{path} holds a policy of another {key}; choose another place, or remove it.")
