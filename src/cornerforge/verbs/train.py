"""`train` trains an adversary and measures it on tests that it never saw."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._options import verb
from cornerforge.adversary.checkpoint import CheckpointFile
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.adversary.verdicts import count_paid, verdict_of
from cornerforge.adversary.worlds import SITE_REWARDS, judge_crashes, reward_numbers
from cornerforge.errors import InputError, OutputError
from cornerforge.experiment.counting import drive_tests, rate_summary
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import check_new_file, code_hash, provenance, read_json_file, version, write_json
from cornerforge.experiment.policy_file import Policy, load_policy, policy_hash, save_policy
from cornerforge.experiment.setting import AV_LOG, experiment
from cornerforge.foreign.session import answers_per_second
from cornerforge.intervals import binomial_interval
from cornerforge.ndd.model import model_hash
from cornerforge.results import Trained
from cornerforge.results.learning import Baseline
from cornerforge.results.rates import Yield
from cornerforge.sim import Tally, controllers, runner
from cornerforge.verbs.options.learning import Train
from cornerforge.work.progress import NO_PROGRESS, Progress, moving
from cornerforge.world_options import BUDGETS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.adversary.train import CurvePoint, TrainResult
    from cornerforge.adversary.worlds import RewardNumbers

__all__ = [
    "BASELINES",
    "EVALUATION_TESTS",
    "about_training",
    "canonical_curve",
    "checkpoint_beside",
    "curve_report",
    "evaluate",
    "judge",
    "learn",
    "load_timed_policy",
    "measure_baselines",
    "point_seconds",
    "provenance_beside",
    "train",
    "training_faults",
    "write_provenance_beside",
    "yield_of",
]

EVALUATION_TESTS = 1 << 41
"""Number of the first evaluation test: far from those of training and of generation."""
STAND_IN_ADVICE = (
    "Of a slow AV, train against a stand-in (--av idm-mobil) and generate cases with the AV itself; run --hours does."
)
BASELINES = ("uniform", "lane-changer", "swerve")
"""Plain adversaries of roads; they or those of sites, each unmasked and masked, and traffic without an adversary stand
beside every yield."""


def about_training(run: Experiment, config: TrainConfig, result: TrainResult, seed: int) -> dict[str, Any]:
    """Say in the header of what was learnt how it was made: code, settings, seed, world, curve."""
    return {
        "cornerforge": version(),
        "code": code_hash(),
        "train": asdict(config),
        "seed": seed,
        "odd": run.odd.stated(),
        "av": run.av.name,
        "av_hash": run.av_hash,
        "model_hash": model_hash(run.model),
        "decisions": result.decisions,
        "updates": result.updates,
        "curve": canonical_curve(result),
    }


def canonical_curve(result: TrainResult) -> list[dict[str, Any]]:
    """Return the training curve without times, for files: the same training then gives the same bytes."""
    return [asdict(point) | {"seconds": None} for point in result.curve]


def point_seconds(result: TrainResult) -> list[float]:
    """Return the times at which the points of the curve were reached [s], for provenance files."""
    return [point.seconds for point in result.curve]


def provenance_beside(policy: Path) -> Path:
    """Return the provenance file of a policy, NAME.provenance.json beside NAME.safetensors: date, duration, machine."""
    return policy.with_name(f"{policy.stem}.provenance.json")


def write_provenance_beside(policy: Path, run: Experiment, result: TrainResult, seed: int) -> None:
    """Write the provenance file beside a policy.

    Raises:
        OutputError: It cannot be written.
    """
    identity = {**run.identity(seed), "code": code_hash()}
    times = {"point_seconds": point_seconds(result)}
    write_json(provenance_beside(policy), {**provenance(identity, round(result.seconds, 3)), **times})


def load_timed_policy(path: Path) -> Policy:
    """Load a policy and add to its curve the times from the provenance file; old policies hold the times themselves.

    Raises:
        FileFormatError: A file is damaged.
    """
    policy = load_policy(path)
    curve, beside = policy.about.get("curve"), provenance_beside(path)
    if not isinstance(curve, list) or not beside.exists():
        return policy
    seconds = read_json_file(beside).get("point_seconds")
    if not isinstance(seconds, list) or len(seconds) != len(curve):
        return policy  # the provenance belongs to a policy that stood here before
    timed = [{**point, "seconds": at} for point, at in zip(curve, seconds, strict=True)]
    return replace(policy, about={**policy.about, "curve": timed})


def checkpoint_beside(policy: Path, run: Experiment, config: TrainConfig, seed: int) -> CheckpointFile:
    """Return the checkpoint file of the training of `policy`; it refuses the state of other settings or other code."""
    identity = {
        "seed": seed,
        "bounded": run.bounded,
        "budget": run.budget,
        **_mask(run),
        "av_hash": run.av_hash,
        "model_hash": model_hash(run.model),
        **{f"train.{name}": value for name, value in asdict(config).items()},
        **{f"odd.{name}": value for name, value in run.odd.stated().items()},
        "code": code_hash(),
    }
    return CheckpointFile(policy.with_name(f"{policy.name}.checkpoint"), identity)


def curve_report(progress: Progress, config: TrainConfig, max_seconds: float | None) -> Callable[[CurvePoint], None]:
    """Return a function that reports a training's progress: in decisions, or in seconds if the time ends it."""

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
    """Train on an experiment (`bounded` and `budget` give the mask), or go on from the checkpoint."""
    from cornerforge.adversary.train import train_adversary

    setting = run.opened_setting
    answered = run.answered() if max_seconds is None else None
    run.rest()  # a training has processes of its own
    each = 1.0 / answers_per_second(run.setting)
    with moving(progress, answered, each, "train", 0, config.decisions) as told:
        result = train_adversary(
            setting,
            run.slots,
            config,
            av=run.asked,
            verdict=verdict_of(config.reward, run),
            seed=seed,
            threads=check_threads(threads),
            max_seconds=max_seconds,
            progress=curve_report(told, config, max_seconds),
            checkpoint=checkpoint,
        )
    about = about_training(run, config, result, seed)
    return Policy(result.weights, config.network, run.bounded, about, run.budget, config.head, **_mask(run)), result


def _mask(run: Experiment) -> dict[str, Any]:
    """Say what the budget limits, and when the adversary begins to steer, as a policy names them."""
    return {"budget_of": BUDGETS[run.setting.who.excess], "steers_from": run.setting.who.steers_from}


def training_faults(run: Experiment) -> int:
    """Count the tests of a training that were abandoned because the foreign AV failed in them."""
    return sum(test < EVALUATION_TESTS for _, test in run.faults)


def evaluate(
    run: Experiment,
    *,
    tests: int,
    seed: int,
    delay_s: float = 1.0,
    reward: str = "crash",
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> Yield:
    """Measure the yield on evaluation tests: all crashes, crashes avoidable by braking, crashes in which the AV struck.

    Under a reward that is judged by cases, crashes that it pays for, too.

    Args:
        run: The experiment.
        tests: Number of tests, at least 1.
        seed: Seed of the tests.
        delay_s: The AV's time to react, for `counterfactual.braking.is_avoidable` [s].
        reward: Name of the reward whose crashes are counted if it is judged by cases.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
    """
    tally, crashed = Tally(), []
    run.keep_scripts(anew=True)  # crashes are judged by what the AV answered
    for first, out in drive_tests(
        run, tally, "evaluate", seed=seed, first=EVALUATION_TESTS, tests=tests, threads=threads, progress=progress
    ):
        crashed += runner.crashed_tests(first, out)
    strikes, avoidable = judge(run, seed, crashed, reward_numbers("avoidable", delay_s), check_threads(threads))
    counted = count_paid(run, seed, crashed, reward, check_threads(threads))
    run.rest()  # importing torch may keep frames, and what they hold, until memory is tidied
    braked = int(avoidable.sum()) if run.odd.site is None else None
    return yield_of(len(crashed), tally.tests, tally.miles, int(strikes.sum()), braked, **counted)


def yield_of(
    crashes: int, tests: int, miles: float, strikes: int, avoidable: int | None, *, paid: int | None,
    strictly: int | None,
) -> Yield:  # fmt: skip
    """Make a yield of counts: crashes, in how many of them the AV struck, and how many braking would have avoided.

    `paid` and `strictly` as `verdicts.count_paid` gives them.
    """
    return Yield(
        **vars(rate_summary(crashes, tests, miles)),
        avoidable_per_test=None if avoidable is None else avoidable / tests,
        avoidable_interval95=None if avoidable is None else binomial_interval(avoidable, tests),
        striking_share=strikes / crashes if crashes else None,
        striking_interval95=binomial_interval(strikes, crashes) if crashes else None,
        paid_per_test=None if paid is None else paid / tests,
        paid_interval95=None if paid is None else binomial_interval(paid, tests),
        strictly_paid_per_test=None if strictly is None else strictly / tests,
    )


def judge(
    run: Experiment, seed: int, crashed: list[int], reward: RewardNumbers, threads: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Judge crashed tests: did the AV strike, would braking have avoided the crash? Bool (n,) each."""
    n = run.processes(threads)
    return judge_crashes(run.recorder, run.setting, seed=seed, tests=crashed, braking=reward.braking, threads=n)


def measure_baselines(
    run: Experiment,
    *,
    tests: int,
    seed: int,
    delay_s: float = 1.0,
    reward: str = "crash",
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> tuple[Baseline, ...]:
    """Measure the plain adversaries with and without the NDD-bounded mask, and no adversary, on the same tests.

    Traffic without an adversary has no mask and is measured once.
    """
    rates = []
    for name in ("nobody", *(BASELINES if run.odd.site is None else controllers.SITE_ADVERSARIES)):
        for bounded in (False,) if name == "nobody" else (False, True):
            budget = run.setting.who.budget if bounded else 0
            setting = run.setting.with_drivers(
                critical=controllers.ADVERSARIES[name],
                bounded=int(bounded),
                budget=budget,
                temperature=0.0,
                cast=controllers.NO_CAST,
            )
            plain = replace(run, setting=setting, bv=name, bounded=bounded, policies=(), acting="greedy")
            rate = evaluate(
                plain, tests=tests, seed=seed, delay_s=delay_s, reward=reward, threads=threads, progress=progress
            )
            rates.append(Baseline(name=f"{name}, bounded" if bounded else name, bounded=bounded, **vars(rate)))
    return tuple(rates)


@verb(Train)
def train(options: Train) -> Trained:
    """Train the adversary and write its policy.

    The policy is the one at the end of training; tests are not used to pick one. It and the plain adversaries are
    measured on evaluation tests, which no training and no generation uses.

    Returns:
        What `cornerforge train --json` prints: the yield, the yields of plain adversaries, and where the policy is.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    path = Path(options.out)
    config = replace(preset_named(options.preset, options.learner), reward=options.reward, delay_s=options.delay)
    if options.decisions is not None:
        config = replace(config, decisions=options.decisions)
    if options.minutes is not None and options.decisions is None:
        config = replace(config, decisions=10**12)  # only the time ends it
    world = options.world()
    run = experiment(world, bv="uniform", takes_foreign=True, seed=options.seed)
    if run.odd.site is not None and options.reward not in SITE_REWARDS:
        raise InputError(
            f"reward = {options.reward!r} is judged on roads only; at a site take {' or '.join(SITE_REWARDS)}."
        )
    check_new_file(path, overwrite=options.resume)
    checkpoint = checkpoint_beside(path, run, config, options.seed)
    check_new_file(checkpoint.path, overwrite=True)
    check_new_file(provenance_beside(path), overwrite=True)
    if not options.resume:
        checkpoint.check_absent()
    log = path.with_name(f"{path.stem}.{AV_LOG}")
    run.keep_printed(log)
    kept = options.resume and path.exists()
    if kept:
        policy = load_policy(path)
        _check_same(policy, run, config, options.seed, path)
        checkpoint.read()  # only a checkpoint of this training is removed below
        seconds = 0.0
    else:
        if options.minutes is None:
            forecast(
                run, options.threads,
                f"training for {config.decisions:,} decisions, and {8 * options.tests:,} tests for the yields",
                decisions=config.decisions, tests=8 * options.tests, advice=STAND_IN_ADVICE,
            )  # fmt: skip
        policy, result = learn(
            run,
            config,
            seed=options.seed,
            threads=options.threads,
            max_seconds=None if options.minutes is None else 60.0 * options.minutes,
            progress=options.progress,
            checkpoint=checkpoint,
        )
        write_provenance_beside(path, run, result, options.seed)
        save_policy(policy, path)  # last: where it is, a resumed command takes the training for done
        seconds = result.seconds
    checkpoint.remove()
    trained = experiment(world.without_mask(), policy=policy, takes_foreign=True, seed=options.seed)
    trained.keep_printed(log)
    measured: dict[str, Any] = {
        "tests": options.tests,
        "seed": options.seed,
        "delay_s": options.delay,
        "reward": options.reward,
        "threads": options.threads,
    }
    about: Any = policy.about
    return Trained(
        decisions=about["decisions"],
        updates=about["updates"],
        seconds=round(seconds, 3),
        learner=options.learner,
        preset=options.preset,
        bounded=run.bounded,
        budget=run.budget,
        reward=options.reward,
        delay_s=options.delay,
        **vars(evaluate(trained, **measured, progress=options.progress)),
        baselines=measure_baselines(run, **measured, progress=options.progress),
        policy_hash=policy_hash(policy),
        kept=kept,
        av_faults=training_faults(run),
        out=str(path),
    )


def _check_same(policy: Policy, run: Experiment, config: TrainConfig, seed: int, path: Path) -> None:
    """Check that a kept policy is the one that this command would train.

    Raises:
        OutputError: The file holds another policy.
    """
    found = {**policy.about, "bounded": policy.bounded, "budget": policy.budget}
    found |= {"budget_of": policy.budget_of, "steers_from": policy.steers_from}
    wanted = {
        "seed": seed,
        "bounded": run.bounded,
        "budget": run.budget,
        **_mask(run),
        "av_hash": run.av_hash,
        "model_hash": model_hash(run.model),
        "train": asdict(config),
        "odd": json.loads(json.dumps(run.odd.stated())),  # lists for tuples, as in the file
    }
    for key, value in wanted.items():
        if found.get(key) != value:
            raise OutputError(f"{path} holds a policy of another {key}; choose another place, or remove it.")
