"""`run --hours`: a given time is spent where it finds most; what was chosen by the clock is stored when it is chosen.

Tests of an adversary come first, because they find crashes even of an AV that drives ten tests a minute; it learns
against a stand-in where learning against the AV itself would take too long. Natural tests come after them, by trees
if there is time for these, else counted. Work is done in portions, each with a file: a run that is resumed makes the
same choices from the times in these files, and goes on in the portion in which it was stopped.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cornerforge._schema import Whole
from cornerforge._words import spoken
from cornerforge.adversary.config import TrainConfig, preset_named
from cornerforge.adversary.verdicts import count_paid
from cornerforge.adversary.worlds import reward_numbers
from cornerforge.errors import InputError
from cornerforge.execution import cpu_seconds
from cornerforge.execution.progress import Progress
from cornerforge.experiment.counting import drive_tests, rate_summary, simulate_experiment
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.output import code_hash, config_hash, open_output, version
from cornerforge.experiment.policy_file import load_policy
from cornerforge.experiment.setting import AV_LOG, experiment
from cornerforge.foreign.pace import announce
from cornerforge.foreign.spec import AvSpec
from cornerforge.intervals import binomial_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import fill_library, library_summary
from cornerforge.rates.exposure import BvTravel
from cornerforge.rates.monte_carlo import Block, MonteCarlo
from cornerforge.rates.plain import PlainTests
from cornerforge.results import Analysed, NaturalRate, RunDone, Simulated
from cornerforge.results.whole import Spending, SpentOn
from cornerforge.sim import Tally, runner, statistics
from cornerforge.types import FRAME_S, METRES_PER_MILE
from cornerforge.verbs.analyse import analyse
from cornerforge.verbs.rate import PLAIN_TESTS, rate
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
    exposure_counts,
    finish,
    natural_files,
    plain_rates,
    train_stage,
    write_exposure,
)
from cornerforge.verbs.train import checkpoint_beside, judge, yield_of
from cornerforge.world_options import WorldOptions

__all__ = ["spend"]

TRAINING_SHARE = 0.4
"""A training against the AV itself takes this share of the time at most, else a stand-in is trained against."""
_STAND_IN_SHARE = 0.12
_ATTACK_UNTIL, _NATURAL_UNTIL = 0.75, 0.92
"""Shares of the time at which tests of the adversary, and natural tests, end; analysis and page come after."""
_DECISIONS = 2_500_000
_LEAST_DECISIONS = 1_000_000
"""A training against the AV itself is no shorter; a stand-in is better then."""
_FEWEST_DECISIONS = 20_480
_DECISIONS_PER_SECOND = 30_000.0
"""What a training against a built-in AV does on two busy cores, with room to spare."""
_MOST_CASES = 3_000
"""So many cases are enough for an analysis; what time is left goes to natural tests."""
_ENOUGH_NATURAL = 1_000
"""So many natural crashes give a rate to some 6 %; to store many more would take longer than to drive them."""
_PORTIONS = 12
_MOST_PORTION = 65_536
_TREES_LEAST = PLAIN_TESTS + 450_000
"""Trees need so many tests, or answers for as many, before their rate can be trusted."""
_SAMPLE, _NDE_TESTS = 512, 20_000
_BASELINE_SHARE, _LEAST_BASELINE, _MOST_BASELINE, _BASELINES = 0.05, 500, 2_048, 7
_clock = time.perf_counter


@dataclass(frozen=True)
class Plan:
    """Choices made by the clock at the start.

    Attributes:
        stand_in: The AV that the adversary learns against; None: the AV itself.
        decisions: Of the training.
        trees: Largest number of tests for a rate by trees; 0: natural tests are counted.
        baselines: Tests of each plain adversary; 0: none.
        answer_seconds, batch: The AV's speed; None: it is built in.
        processes: Tests at the same time.
        tests_per_second: As measured.
        training_seconds: What `_DECISIONS` against the AV itself would take [s].
        seconds: What choosing took [s].
    """

    stand_in: str | None
    decisions: int
    trees: int
    baselines: int
    answer_seconds: float | None
    batch: int | None
    processes: int
    tests_per_second: float
    training_seconds: float
    seconds: float


@dataclass(frozen=True)
class Portion:
    """Tests that were driven together.

    Attributes:
        first, tests: Which; `tests` counts those too that the AV spoiled.
        seconds, cpu_seconds: What they took [s].
        av_faults, bv_crashes, decisions, millimetres, digest: As in `Tally`.
        frames, bv_millimetres: Time driven [0.1 s], and what BVs drove, as counted at decisions [mm].
        crashed: Tests in which the AV crashed.
        strikes, avoidable: Of these, the AV struck, braking would have avoided it; judged for an adversary only.
        paid, strictly: As `verdicts.count_paid` gives them; None where nothing is judged.
        exposure: As in `Counted`.
    """

    first: Whole
    tests: Whole
    seconds: float
    cpu_seconds: float
    av_faults: Whole
    bv_crashes: Whole
    decisions: Whole
    millimetres: Whole
    digest: str
    frames: Whole
    bv_millimetres: Whole
    crashed: tuple[Whole, ...]
    strikes: Whole
    avoidable: Whole
    exposure: dict[str, tuple[Whole, ...]]
    paid: Whole | None = None
    strictly: Whole | None = None

    @property
    def valid(self) -> int:
        """Tests that count."""
        return self.tests - self.av_faults


def _measured(run: Experiment, seed: int, threads: int | None) -> float:
    """Measure how many tests a second are driven: of an AV from outside by its answers, else by driving some."""
    if seconds := run.seconds_of(threads, tests=1000):
        return 1000.0 / seconds
    return _SAMPLE / max(simulate_experiment(run, tests=_SAMPLE, seed=seed, threads=threads)[1], 1e-3)


def _plan(natural: Experiment, stand_in: str, budget: float, seed: int, threads: int | None, begun: float) -> Plan:
    """Choose what fits into the time [s]."""
    av, speed = natural.asked, _measured(natural, seed, threads)
    own = natural.seconds_of(threads, decisions=_DECISIONS) or _DECISIONS / _DECISIONS_PER_SECOND
    fits = int(_DECISIONS * TRAINING_SHARE * budget / own)
    against = None if av is None or fits >= _LEAST_DECISIONS else stand_in
    if av is None or against is not None:
        fits = int(_STAND_IN_SHARE * budget * _DECISIONS_PER_SECOND)
    again = 3.5 if av is not None and av.remembers else 1.0
    trees = int((_NATURAL_UNTIL - _ATTACK_UNTIL) * budget * speed / again)
    plain = int(_BASELINE_SHARE * budget * speed / _BASELINES)
    return Plan(
        stand_in=against,
        decisions=max(_FEWEST_DECISIONS, min(_DECISIONS, fits)),
        trees=trees if trees >= _TREES_LEAST else 0,
        baselines=min(plain, _MOST_BASELINE) if plain >= _LEAST_BASELINE else 0,
        answer_seconds=None if av is None else av.answer_seconds,
        batch=None if av is None else av.batch,
        processes=natural.processes(threads),
        tests_per_second=speed,
        training_seconds=own,
        seconds=_clock() - begun,
    )


def _in_portions(
    stages: Stages,
    name: str,
    plan: Plan,
    until: float,
    spent: float,
    drive: Callable[[int, int], Portion],
    enough: Callable[[Sequence[Portion]], bool] = lambda _: False,
    makes: Sequence[str] = (),
) -> list[Portion]:
    """Drive portions of tests while there is time, one at least.

    Args:
        stages: Keep the portions.
        name: Of the stage.
        plan: Says how many tests a second to expect at first.
        until: Time at which the last portion should end [s].
        spent: Time that other parts took before [s].
        drive: Drives a portion: first test, number of tests.
        enough: Says whether more would be of no use.
        makes: Files that each portion adds to, as for `Stages.do`.
    """
    done: list[Portion] = []
    speed, least = plan.tests_per_second, 4 * plan.processes
    share = (until - spent) / _PORTIONS
    while not done or not enough(done):
        left = until - spent
        if done and speed * left < least:
            break
        size = max(least, min(int(speed * min(left, share)), _MOST_PORTION))
        first = sum(portion.tests for portion in done)
        portion = stages.do(f"{name}-{len(done):03}", Portion, lambda first=first, size=size: drive(first, size), makes)  # type: ignore[misc]
        done.append(portion)
        spent += portion.seconds
        speed = portion.tests / max(portion.seconds, 1e-3)
    return done


def _portion(first: int, begun: tuple[float, float], tally: Tally, frames: int, **found: Any) -> Portion:
    """Make a portion of its sums."""
    return Portion(
        first=first,
        tests=tally.tests + tally.av_faults,
        seconds=_clock() - begun[0],
        cpu_seconds=cpu_seconds() - begun[1],
        av_faults=tally.av_faults,
        bv_crashes=tally.bv_crashes,
        decisions=tally.decisions,
        millimetres=tally.millimetres,
        digest=tally.digest.hexdigest(),
        frames=frames,
        bv_millimetres=int(tally.counts.totals[statistics.BV_TRAVEL_MM]),
        exposure=exposure_counts(tally),
        **found,
    )


def _attack(
    run: Experiment, library: Path, reward: str, seed: int, threads: int | None, progress: Progress, first: int,
    tests: int,
) -> Portion:  # fmt: skip
    """Drive a portion of the adversary's tests, and store its crashes in the library."""
    begun, tally = (_clock(), cpu_seconds()), Tally()
    run.keep_scripts()  # crashes are judged by what the AV answered
    fill_library(
        run, library, seed=seed, tests=first + tests, threads=threads, resume=True, progress=progress,
        stage=f"cases ({first + tests} tests)", counting=True, tally=tally, tally_from=first,
    )  # fmt: skip
    cases = CaseLibrary.open(library)
    stored = cases.scalars(["test"])["test"].to_pylist() if len(cases) else []
    crashed = [test for test in stored if first <= test < first + tests]
    strikes, avoidable = judge(run, seed, crashed, reward_numbers("avoidable", 1.0), check_threads(threads))
    return _portion(
        first, begun, tally, 0, crashed=tuple(crashed), strikes=int(strikes.sum()), avoidable=int(avoidable.sum()),
        **count_paid(run, seed, crashed, reward, check_threads(threads)),
    )  # fmt: skip


def _drive_natural(
    run: Experiment, seed: int, threads: int | None, progress: Progress, first: int, tests: int
) -> Portion:
    """Drive a portion of natural tests."""
    run.warm_up()
    begun, tally, frames = (_clock(), cpu_seconds()), Tally(), 0
    crashed: list[int] = []
    run.keep_scripts()  # crashes will be stored as the AV drove
    for start, out in drive_tests(
        run, tally, f"natural tests ({first} before)", seed=seed, first=first, tests=tests, threads=threads,
        progress=progress, counting=True,
    ):  # fmt: skip
        frames += int(out.frame.sum(dtype=np.int64))
        crashed += runner.crashed_tests(start, out)
    return _portion(first, begun, tally, frames, crashed=tuple(crashed), strikes=0, avoidable=0)


def _exposure(portions: Sequence[Portion]) -> dict[str, tuple[int, ...]]:
    names = portions[0].exposure
    return {name: tuple(np.sum([p.exposure[name] for p in portions], axis=0).tolist()) for name in names}


def _counted(portions: Sequence[Portion]) -> Counted:
    """Sum portions up."""
    tests, seconds = sum(p.valid for p in portions), max(sum(p.seconds for p in portions), 1e-3)
    crashes, steps = sum(len(p.crashed) for p in portions), sum(p.decisions for p in portions)
    found = Simulated(
        **vars(rate_summary(crashes, tests, sum(p.millimetres for p in portions) / 1000.0 / METRES_PER_MILE)),
        av_crashes=crashes,
        av_faults=sum(p.av_faults for p in portions),
        bv_crashes=sum(p.bv_crashes for p in portions),
        seconds=round(seconds, 3),
        world_steps=steps,
        world_steps_per_second=round(steps / seconds, 2),
        tests_per_second=round(tests / seconds, 4),
        digest=hashlib.sha256("".join(p.digest for p in portions).encode()).hexdigest(),
    )
    return Counted(found, _exposure(portions))


def _natural_rate(
    run: Experiment, portions: Sequence[Portion], folder: Path, seed: int, threads: int | None, progress: Progress
) -> NaturalRate:
    """Make the natural rate of counted tests, and store their crashes as `rate` does."""
    counts = MonteCarlo()
    for p in portions:
        counts = counts.plus(
            Block(
                p.tests, p.bv_crashes, p.decisions, p.millimetres, p.seconds, p.cpu_seconds, p.crashed, p.digest,
                p.av_faults,
            )
        )  # fmt: skip
    steps, frames = sum(p.decisions for p in portions), sum(p.frames for p in portions)
    scale = frames * FRAME_S / steps / 1000.0 / METRES_PER_MILE if steps else 0.0
    miles = sum(p.bv_millimetres for p in portions) * scale
    session = PlainTests(run, seed, folder, threads=check_threads(threads), progress=progress)
    identity = {**run.identity(seed), "method": "mc", "cornerforge": version(), "code": code_hash()}
    session.start(identity, resume=True)
    session.take(counts, BvTravel(miles / counts.tests, None, counts.tests), "as many tests as fitted into the time")
    return session.store("max_tests")


def _share(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _few(number: float) -> str:
    return f"{number:,.0f}" if number >= 10.0 else f"{number:.2g}"


def _not_found(plan: Plan, attacks: Sequence[Portion], natural: NaturalRate, miles: float) -> tuple[str, ...]:
    """Say what the time was too short for."""
    said = []
    n, crashes = sum(p.valid for p in attacks), sum(len(p.crashed) for p in attacks)
    if crashes == 0:
        high = binomial_interval(0, n)[1]
        said.append(
            f"0 crashes in {n:,} tests of the adversary: fewer than {_share(high)} of such tests end in one (95 %)."
        )
    if natural.method == "mc" and natural.av_crashes == 0:
        tests = natural.plain_tests
        said.append(
            f"0 crashes in {tests:,} natural tests: fewer than one in {max(1, tests // 3):,} tests, or in "
            f"{_few(tests / 3.0 * miles)} miles (rule of three, 95 %). That says nothing about rare "
            f"crashes: to see one in 100,000 tests would take about {spoken(3e5 / plan.tests_per_second)} of counting."
        )
    elif natural.method == "mc" and natural.av_crashes < 10:
        said.append(f"The natural rate rests on {natural.av_crashes} crashes: its interval is wide.")
    if natural.doubts:
        said.append("The natural rate cannot be trusted yet: " + "; ".join(natural.doubts) + ".")
    if plan.stand_in is not None:
        said.append(
            f"The adversary learned against {plan.stand_in}, not against this AV, which would take about "
            f"{spoken(plan.training_seconds)}: one that knows this AV may find more crashes, and other ones."
        )
    if plan.baselines == 0:
        said.append("Plain adversaries were not driven, so the yield has nothing to compare with.")
    if crashes and crashes < 100:
        said.append(f"{crashes} cases are too few to tell rare kinds of crash; more hours find more.")
    return tuple(said)


def _tell_plan(plan: Plan, natural: Experiment, threads: int | None, hours: float) -> None:
    """Say what will be done with the time."""
    against = "itself" if plan.stand_in is None else f"the stand-in {plan.stand_in}"
    if plan.stand_in is not None:
        against += f" (against the AV itself it would take about {spoken(plan.training_seconds)})"
    tests, rate = plan.tests_per_second * 3600.0 * hours, "by trees of tests" if plan.trees else "counted"
    announce(
        f"{natural.pace_text(threads)}: {spoken(3600.0 * hours)} are enough for about {tests:,.0f} tests to their "
        f"ends. The adversary learns against {against}; the natural rate is {rate}."
    )


def _logged(run: Experiment, folder: Path) -> Experiment:
    """Keep in the folder what the AV of a run prints."""
    run.keep_printed(folder / AV_LOG)
    return run


def spend(
    options: WorldOptions, *, hours: float, stand_in: str, folder: Path, reward: str, resume: bool, seed: int,
    threads: int | None, progress: Progress,
) -> RunDone:  # fmt: skip
    """Do the whole job in about so many hours; see `run`.

    Raises:
        CornerForgeError: Input, files or output place are not right, or the AV fails too often.
    """
    start, begun = time.perf_counter(), _clock()
    if AvSpec(stand_in).is_outside:
        raise InputError(f"stand_in = {stand_in!r} is not built in; name a built-in AV (cornerforge avs lists them).")
    limit = 3600.0 * hours
    unmasked = options.without_mask()
    natural = experiment(unmasked, takes_foreign=True, seed=seed)
    substitute = experiment(replace(options, av=stand_in), bv="uniform", seed=seed)
    own = partial(experiment, options, bv="uniform", takes_foreign=True, seed=seed)
    identity = _identity(natural, substitute, hours, stand_in, reward, seed)
    open_output(folder, identity, resume=resume)
    _logged(natural, folder)
    stages = Stages(folder)
    once = stages.do
    plan = once("plan", Plan, lambda: _plan(natural, stand_in, limit, seed, threads, begun))
    _tell_plan(plan, natural, threads, hours)
    natural.rest()

    config = replace(preset_named("fast"), decisions=plan.decisions, reward=reward)
    plain = substitute if plan.stand_in is not None else _logged(own(), folder)
    trained = once(
        "train", TrainedStage, lambda: _train(plain, config, folder, seed, threads, progress), TRAINING_FILES
    )
    hostile = _logged(
        experiment(unmasked, policy=load_policy(folder / "policy.safetensors"), takes_foreign=True, seed=seed), folder
    )
    spent = plan.seconds + trained.policy.seconds
    library = folder / "library"
    attacks = _in_portions(
        stages, "attack", plan, _ATTACK_UNTIL * limit, spent,
        lambda first, tests: _attack(hostile, library, reward, seed, threads, progress, first, tests),
        lambda done: sum(len(p.crashed) for p in done) >= _MOST_CASES, LIBRARY_FILES,
    )  # fmt: skip
    spent += sum(p.seconds for p in attacks)
    hostile.rest()

    baselines = _compared(
        stages, lambda: _logged(own(), folder),
        plan.baselines, reward, seed, threads, progress,
    )  # fmt: skip
    spent += baselines.seconds
    nde, often = _roads(stages, natural, unmasked, plan, limit, spent, folder, seed, threads, progress)
    natural.rest()
    roads = once(
        "natural_cases", NaturalCases, lambda: analyse_natural(often, folder / "natural", seed, progress),
        natural_files(often),
    )  # fmt: skip

    attacked = _counted(attacks)
    write_exposure(folder, nde, attacked)
    filled = library_summary(CaseLibrary.open(library), sum(p.seconds for p in attacks))
    analysed: Analysed | None = None
    if filled.cases:
        analysed = once(
            "analyse",
            Analysed,
            lambda: analyse(library, out=folder / "analysis", seed=seed, progress=progress),
            ANALYSED_FILES,
        )
    crashes = sum(len(p.crashed) for p in attacks)
    found = yield_of(
        crashes, attacked.rate.tests, attacked.rate.miles, sum(p.strikes for p in attacks),
        sum(p.avoidable for p in attacks), paid=_sum(p.paid for p in attacks),
        strictly=_sum(p.strictly for p in attacks),
    )  # fmt: skip
    spending = Spending(
        hours=hours,
        stand_in=plan.stand_in,
        decisions=plan.decisions,
        answer_seconds=plan.answer_seconds,
        batch=plan.batch,
        processes=plan.processes,
        parts=_parts(plan, trained, attacks, crashes, often, baselines, analysed),
        not_found=_not_found(plan, attacks, often, _test_miles(natural)),
    )
    return finish(
        Finished(
            effort=f"{hours:g} h", nde=nde, natural=often, natural_cases=roads, trained=trained, reached=found,
            baselines=baselines, filled=filled, analysed=analysed, spending=spending,
        ),
        identity, folder, mask=substitute, av=options.av, seed=seed, reward=reward, begun=start, progress=progress,
    )  # fmt: skip


def _compared(
    stages: Stages, make: Callable[[], Experiment], tests: int, reward: str, seed: int, threads: int | None,
    progress: Progress,
) -> PlainRates:  # fmt: skip
    """Measure the plain adversaries, if the plan has tests for them; `make` builds the run, which may start an AV."""

    def measured() -> PlainRates:
        own = make()
        found = plain_rates(own, tests, reward, seed, threads, progress)
        own.rest()
        return found

    return stages.do("baselines", PlainRates, measured) if tests else PlainRates((), 0.0)


def _roads(
    stages: Stages, natural: Experiment, options: WorldOptions, plan: Plan, limit: float, spent: float, folder: Path,
    seed: int, threads: int | None, progress: Progress,
) -> tuple[Counted, NaturalRate]:  # fmt: skip
    """Drive natural tests, and measure the natural rate: by trees if the plan has time for them, else by counting."""
    if plan.trees:
        nde = stages.do(
            "nde", Counted, lambda: count(natural, _NDE_TESTS, 0, seed, threads, progress, "natural traffic")
        )
        found = stages.do(
            "natural",
            NaturalRate,
            lambda: rate(
                max_tests=plan.trees, out=folder / "natural", resume=True, seed=seed, threads=threads,
                progress=progress, **options.av_keywords(),
            ),
        )  # fmt: skip
        return nde, found
    portions = _in_portions(
        stages, "natural", plan, _NATURAL_UNTIL * limit, spent,
        lambda first, tests: _drive_natural(natural, seed, threads, progress, first, tests),
        lambda done: sum(len(p.crashed) for p in done) >= _ENOUGH_NATURAL,
    )  # fmt: skip
    found = stages.do(
        "natural",
        NaturalRate,
        lambda: _natural_rate(natural, portions, folder / "natural", seed, threads, progress),
    )
    return _counted(portions), found


def _test_miles(run: Experiment) -> float:
    """Return the miles of a test that is driven to its end."""
    return run.odd.test_length / METRES_PER_MILE


def _sum(counts: Iterable[int | None]) -> int | None:
    """Sum counts up; None if one is None."""
    known = list(counts)
    return None if None in known else sum(n for n in known if n is not None)


def _train(
    plain: Experiment, config: TrainConfig, folder: Path, seed: int, threads: int | None, progress: Progress
) -> TrainedStage:
    """Train, or go on with a training that was stopped."""
    checkpoint = checkpoint_beside(folder / "policy.safetensors", plain, config, seed)
    found = train_stage(plain, config, checkpoint, folder, seed, threads, progress)
    checkpoint.remove()
    return found


def _parts(
    plan: Plan, trained: TrainedStage, attacks: Sequence[Portion], crashes: int, often: NaturalRate,
    baselines: PlainRates, analysed: Analysed | None,
) -> tuple[SpentOn, ...]:  # fmt: skip
    """List what the time was spent on."""
    against = "the AV itself" if plan.stand_in is None else f"the stand-in {plan.stand_in}"
    parts = [
        SpentOn(what="loading, and measuring the AV's speed", seconds=round(plan.seconds, 1), tests=None,
                came_of_it=f"about {3600.0 * plan.tests_per_second:,.0f} tests an hour expected"),
        SpentOn(what=f"training the adversary against {against}", seconds=trained.policy.seconds, tests=None,
                came_of_it=f"{trained.policy.decisions:,} decisions"),
        SpentOn(what="tests of the adversary with the AV", seconds=round(sum(p.seconds for p in attacks), 1),
                tests=sum(p.tests for p in attacks), came_of_it=f"{crashes:,} crashes, all stored as cases"),
    ]  # fmt: skip
    if baselines.rates:
        parts.append(
            SpentOn(
                what="plain adversaries", seconds=round(baselines.seconds, 1),
                tests=sum(rate.tests for rate in baselines.rates), came_of_it="yields to compare with",
            )
        )  # fmt: skip
    how = {"mc": "counted", "is": "weighted tests", "splitting": "trees of tests"}[often.method]
    parts.append(
        SpentOn(
            what=f"natural tests, {how}", seconds=often.seconds, tests=often.tests,
            came_of_it=f"{often.av_crashes:,} crashes" if often.method == "mc" else "a rate",
        )
    )  # fmt: skip
    if analysed is not None:
        parts.append(
            SpentOn(
                what="analysis of the cases", seconds=round(analysed.seconds["total"], 1), tests=None,
                came_of_it=f"{len(analysed.clusters)} clusters, {len(analysed.rare)} rare cases",
            )
        )  # fmt: skip
    return tuple(parts)


def _identity(
    natural: Experiment, substitute: Experiment, hours: float, stand_in: str, reward: str, seed: int
) -> dict[str, Any]:
    """Return what decides the results of a run for some hours, but for the speed."""
    identity: dict[str, Any] = natural.identity(seed)
    hostile = substitute.identity(seed)
    settings = {"world": identity.pop("config_hash"), "mask": hostile["config_hash"]}
    settings |= {"hours": hours, "stand_in": stand_in, "train": asdict(replace(preset_named("fast"), reward=reward))}
    del identity["bv"], identity["policy_hash"]
    return {
        **identity,
        "bounded": hostile["bounded"],
        "budget": hostile["budget"],
        "effort": f"{hours:g} h",
        "stand_in": stand_in,
        "stand_in_hash": hostile["av_hash"],
        "config_hash": config_hash(settings),
        "cornerforge": version(),
        "code": code_hash(),
    }
