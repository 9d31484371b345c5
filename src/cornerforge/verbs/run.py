"""`run` does the whole job in stages; each finished stage leaves a file, so a killed run goes on after it."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cornerforge._checks import check_in, check_integer
from cornerforge._options import verb
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.errors import InputError
from cornerforge.execution.progress import begin_part
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import code_hash, config_hash, open_output, version
from cornerforge.experiment.policy_file import load_policy
from cornerforge.experiment.setting import AV_LOG, experiment
from cornerforge.library.filling import fill_library
from cornerforge.results import Analysed, Filled, NaturalRate, RunDone
from cornerforge.results.rates import Yield
from cornerforge.verbs.analyse import analyse
from cornerforge.verbs.options.whole import Run
from cornerforge.verbs.rate import rate, why_only_counting
from cornerforge.verbs.stages import (
    ANALYSED_FILES,
    LIBRARY_FILES,
    TRAINING_FILES,
    Counted,
    Finished,
    NaturalCases,
    PlainRates,
    Stages,
    TrainedStage,
    analyse_natural,
    count,
    finish,
    natural_files,
    plain_rates,
    train_stage,
    write_exposure,
)
from cornerforge.verbs.train import checkpoint_beside, evaluate

__all__ = ["EFFORTS", "Effort", "run"]

STAND_IN = "idm-mobil"
"""The AV that an adversary learns against when there is no time to learn against the AV under test."""
_STAGES = 10
"""Stages of a run, the report among them."""
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
        nde_tests=65_536, natural_tests=716_000, natural_rhw=0.3, decisions=2_500_000, evaluation_tests=2_048,
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
"""quick: within 4 minutes on two cores, 10 with an AV from outside that takes microseconds for an answer; standard:
within 15; paper: as many cases as the paper had (about 50,000)."""
_OUTSIDE = 0.85
"""Share of `natural_tests` that an AV from outside drives, which is asked in all of them."""


def _train_config(size: Effort, reward: str) -> TrainConfig:
    return replace(preset_named("fast"), decisions=size.decisions, reward=reward)


def _natural_method(natural: Experiment, max_tests: int) -> str:
    """Choose the method of the natural rate: for an AV from outside the one that makes no copies of its tests."""
    return "auto" if natural.asked is None or why_only_counting(max_tests) is not None else "is"


def _identity(plain: Experiment, effort: str, config: TrainConfig, seed: int) -> dict[str, Any]:
    """Return what decides the results of a run, without a policy and a way to drive BVs: a run has several of them."""
    identity: dict[str, Any] = plain.identity(seed)
    size = EFFORTS[effort]
    settings = {"world": identity.pop("config_hash"), "effort": asdict(size), "train": asdict(config)}
    del identity["bv"], identity["policy_hash"]
    return {
        **identity,
        "effort": effort,
        "config_hash": config_hash(settings),
        "cornerforge": version(),
        "code": code_hash(),
    }


@verb(Run)
def run(options: Run) -> RunDone:
    """Do the whole job: natural traffic, natural crash rate, training, cases, analyses, report.

    Returns:
        What `cornerforge run --json` prints, and `summary.json` holds: the result of each stage.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    start = time.perf_counter()
    folder = Path(options.out)
    if options.hours is not None:
        if options.effort is not None:
            raise InputError(
                f"effort = {options.effort} and hours = {options.hours:g} exclude each other; leave one out."
            )
    elif options.stand_in != STAND_IN:
        raise InputError(
            f"stand_in = {options.stand_in!r} has no effect without hours: --hours H --stand-in {options.stand_in}"
        )
    effort = check_in("effort", options.effort or "quick", tuple(EFFORTS))
    size = EFFORTS[effort]
    config = _train_config(size, options.reward)
    check_integer("seed", options.seed, low=0, high=2**32 - 1)
    check_threads(options.threads)
    world = options.world()
    if options.hours is not None:
        from cornerforge.verbs.spend import spend

        return spend(
            world, hours=options.hours, stand_in=options.stand_in, folder=folder, reward=options.reward,
            resume=options.resume, seed=options.seed, threads=options.threads, progress=options.progress,
        )  # fmt: skip
    unmasked = world.without_mask()
    natural = experiment(unmasked, takes_foreign=True, seed=options.seed)
    plain = experiment(world, bv="uniform", takes_foreign=True, seed=options.seed)
    natural_tests = size.natural_tests if natural.asked is None else round(_OUTSIDE * size.natural_tests)
    identity = _identity(plain, effort, config, options.seed)
    open_output(folder, identity, resume=options.resume)
    forecast(
        natural, options.threads, "all that this effort asks for", decisions=size.decisions,
        tests=size.nde_tests + min(natural_tests, 262_144) + 8 * size.evaluation_tests + size.exposure_tests,
        bound="at least ", advice="If that is too long: --hours H does what fits into H hours.",
    )  # fmt: skip
    for one in (natural, plain):
        one.keep_printed(folder / AV_LOG)
    once = Stages(folder, options.progress, of=_STAGES).do
    nde = once(
        "nde",
        Counted,
        lambda: count(natural, size.nde_tests, 0, options.seed, options.threads, options.progress, "natural traffic"),
    )
    natural.rest()
    often = once(
        "natural",
        NaturalRate,
        lambda: rate(
            method=_natural_method(natural, natural_tests), target_rhw=size.natural_rhw, max_tests=natural_tests,
            out=folder / "natural", resume=True, seed=options.seed, threads=options.threads, progress=options.progress,
            **unmasked.av_keywords(),
        ),
    )  # fmt: skip
    natural_cases = once(
        "natural_cases",
        NaturalCases,
        lambda: analyse_natural(often, folder / "natural", options.seed, options.progress),
        natural_files(often),
    )
    checkpoint = checkpoint_beside(folder / "policy.safetensors", plain, config, options.seed)
    trained = once(
        "train",
        TrainedStage,
        lambda: train_stage(plain, config, checkpoint, folder, options.seed, options.threads, options.progress),
        TRAINING_FILES,
    )
    checkpoint.remove()
    policy = load_policy(folder / "policy.safetensors")
    hostile = experiment(unmasked, policy=policy, takes_foreign=True, seed=options.seed)
    hostile.keep_printed(folder / AV_LOG)
    evaluation = once(
        "evaluate",
        Yield,
        lambda: evaluate(
            hostile,
            tests=size.evaluation_tests,
            seed=options.seed,
            reward=options.reward,
            threads=options.threads,
            progress=options.progress,
        ),
    )
    baselines = once(
        "baselines",
        PlainRates,
        lambda: plain_rates(
            plain, size.evaluation_tests, options.reward, options.seed, options.threads, options.progress
        ),
    )
    exposed = once(
        "exposure",
        Counted,
        lambda: count(
            hostile,
            size.exposure_tests,
            EXPOSURE_TESTS_START,
            options.seed,
            options.threads,
            options.progress,
            "exposure",
        ),
    )
    write_exposure(folder, nde, exposed)
    filled = once(
        "generate",
        Filled,
        lambda: fill_library(
            hostile,
            folder / "library",
            seed=options.seed,
            cases=size.cases,
            threads=options.threads,
            resume=True,
            progress=options.progress,
        ),
        LIBRARY_FILES,
    )
    analysed = once(
        "analyse",
        Analysed,
        lambda: analyse(folder / "library", out=folder / "analysis", seed=options.seed, progress=options.progress),
        ANALYSED_FILES,
    )
    begin_part(options.progress, _STAGES, _STAGES)
    return finish(
        Finished(
            effort=effort, nde=nde, natural=often, natural_cases=natural_cases, trained=trained, reached=evaluation,
            baselines=baselines, filled=filled, analysed=analysed,
        ),
        identity, folder, mask=plain, av=world.av, seed=options.seed, reward=options.reward, begun=start,
        progress=options.progress,
    )  # fmt: skip
