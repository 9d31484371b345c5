"""`run` does the whole job in stages; each finished stage leaves a file, so a killed run goes on after it."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from cornerforge._arguments import checked
from cornerforge._checks import check_in, check_integer, check_number
from cornerforge._locks import claims
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.errors import InputError
from cornerforge.execution.progress import NO_PROGRESS, Progress, begin_part
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import code_hash, config_hash, open_output, version
from cornerforge.experiment.policy_file import load_policy
from cornerforge.experiment.setting import AV_LOG, Experiment, check_threads, experiment
from cornerforge.library.filling import fill_library
from cornerforge.results import Analysed, Filled, NaturalRate, RunDone
from cornerforge.results.rates import Yield
from cornerforge.verbs.analyse import analyse
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
from cornerforge.world_options import WorldKeywords, WorldOptions

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
    return "auto" if natural.foreign is None or why_only_counting(max_tests) is not None else "is"


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


@checked
@claims()
def run(
    *,
    effort: str | None = None,
    hours: float | None = None,
    stand_in: str = STAND_IN,
    out: Path | str = "cornerforge-out",
    reward: str = "crash",
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[WorldKeywords],
) -> RunDone:
    """Do the whole job: natural traffic, natural crash rate, training, cases, analyses, report.

    Args:
        effort: "quick", "standard" or "paper" (see `EFFORTS`); None: "quick", unless there are `hours`.
        hours: Time for all of it [h], 0.001 to 1000, instead of an effort: what fits is chosen by the clock, so results
            depend on the machine's speed. Counts are stored when they are chosen; the same counts and seed give the
            same results. For slow AVs.
        stand_in: Built-in AV that the adversary learns against when `hours` are too few to learn against the AV.
        out: Folder for everything; must be new or empty unless `resume`.
        reward: Which crashes the adversary is paid for, as for `train`.
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
    if hours is not None:
        check_number("hours", hours, low=0.001, high=1000.0, unit="h")
        if effort is not None:
            raise InputError(f"effort = {effort} and hours = {hours:g} exclude each other; leave one out.")
    elif stand_in != STAND_IN:
        raise InputError(f"stand_in = {stand_in!r} has no effect without hours: --hours H --stand-in {stand_in}")
    effort = check_in("effort", effort or "quick", tuple(EFFORTS))
    size = EFFORTS[effort]
    config = _train_config(size, reward)
    check_integer("seed", seed, low=0, high=2**32 - 1)
    check_threads(threads)
    options = WorldOptions(**world)
    if hours is not None:
        from cornerforge.verbs.spend import spend

        return spend(
            options, hours=hours, stand_in=stand_in, folder=folder, reward=reward, resume=resume, seed=seed,
            threads=threads, progress=progress,
        )  # fmt: skip
    unmasked = options.without_mask()
    natural = experiment(unmasked, takes_foreign=True, seed=seed)
    plain = experiment(options, bv="uniform", takes_foreign=True, seed=seed)
    natural_tests = size.natural_tests if natural.foreign is None else round(_OUTSIDE * size.natural_tests)
    identity = _identity(plain, effort, config, seed)
    open_output(folder, identity, resume=resume)
    forecast(
        natural, threads, "all that this effort asks for", decisions=size.decisions,
        tests=size.nde_tests + min(natural_tests, 262_144) + 8 * size.evaluation_tests + size.exposure_tests,
        bound="at least ", advice="If that is too long: --hours H does what fits into H hours.",
    )  # fmt: skip
    for one in (natural, plain):
        one.keep_printed(folder / AV_LOG)
    once = Stages(folder, progress, of=_STAGES).do
    nde = once("nde", Counted, lambda: count(natural, size.nde_tests, 0, seed, threads, progress, "natural traffic"))
    natural.rest()
    often = once(
        "natural",
        NaturalRate,
        lambda: rate(
            method=_natural_method(natural, natural_tests), target_rhw=size.natural_rhw, max_tests=natural_tests,
            out=folder / "natural", resume=True, seed=seed, threads=threads, progress=progress,
            **unmasked.av_keywords(),
        ),
    )  # fmt: skip
    natural_cases = once(
        "natural_cases",
        NaturalCases,
        lambda: analyse_natural(often, folder / "natural", seed, progress),
        natural_files(often),
    )
    checkpoint = checkpoint_beside(folder / "policy.safetensors", plain, config, seed)
    trained = once(
        "train",
        TrainedStage,
        lambda: train_stage(plain, config, checkpoint, folder, seed, threads, progress),
        TRAINING_FILES,
    )
    checkpoint.remove()
    policy = load_policy(folder / "policy.safetensors")
    hostile = experiment(unmasked, policy=policy, takes_foreign=True, seed=seed)
    hostile.keep_printed(folder / AV_LOG)
    evaluation = once(
        "evaluate",
        Yield,
        lambda: evaluate(
            hostile, tests=size.evaluation_tests, seed=seed, reward=reward, threads=threads, progress=progress
        ),
    )
    baselines = once(
        "baselines",
        PlainRates,
        lambda: plain_rates(plain, size.evaluation_tests, reward, seed, threads, progress),
    )
    exposed = once(
        "exposure",
        Counted,
        lambda: count(hostile, size.exposure_tests, EXPOSURE_TESTS_START, seed, threads, progress, "exposure"),
    )
    write_exposure(folder, nde, exposed)
    filled = once(
        "generate",
        Filled,
        lambda: fill_library(
            hostile, folder / "library", seed=seed, cases=size.cases, threads=threads, resume=True, progress=progress
        ),
        LIBRARY_FILES,
    )
    analysed = once(
        "analyse",
        Analysed,
        lambda: analyse(folder / "library", out=folder / "analysis", seed=seed, progress=progress),
        ANALYSED_FILES,
    )
    begin_part(progress, _STAGES, _STAGES)
    return finish(
        Finished(
            effort=effort, nde=nde, natural=often, natural_cases=natural_cases, trained=trained, reached=evaluation,
            baselines=baselines, filled=filled, analysed=analysed,
        ),
        identity, folder, mask=plain, av=options.av, seed=seed, reward=reward, begun=start, progress=progress,
    )  # fmt: skip
