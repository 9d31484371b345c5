"""`run --hours`: a given time is spent where it finds most; what was chosen by the clock is stored when it is chosen.

Tests of an adversary come first, because they find crashes even of an AV that drives ten tests a minute; it learns
against a stand-in where learning against the AV itself would take too long. Natural tests come after them, by trees
if there is time for these, else counted. Work is done in portions, each with a file: a run that is resumed makes the
same choices from the times in these files, and goes on in the portion in which it was stopped.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cornerforge._schema import Whole
from cornerforge._words import few_digits, spoken
from cornerforge.adversary.config import preset_named
from cornerforge.adversary.verdicts import count_paid
from cornerforge.adversary.worlds import reward_numbers
from cornerforge.errors import InputError
from cornerforge.experiment.counting import drive_tests, rate_summary, simulate_experiment
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.output import code_hash, version
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.pace import announce
from cornerforge.foreign.spec import AvSpec
from cornerforge.intervals import binomial_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import fill_library, library_summary
from cornerforge.rates.exposure import BvTravel
from cornerforge.rates.monte_carlo import Block, MonteCarlo
from cornerforge.rates.plain import PlainTests
from cornerforge.results import NaturalRate, RunDone, Simulated
from cornerforge.results.rates import Yield
from cornerforge.results.whole import Spending, SpentOn
from cornerforge.sim import Tally, runner, statistics
from cornerforge.types import FRAME_S, METRES_PER_MILE
from cornerforge.verbs.options.whole import STAND_IN, STAND_IN_AT_SITE, Run
from cornerforge.verbs.rate import PLAIN_TESTS
from cornerforge.verbs.stages import HOURS, LIBRARY_FILES, Counted, Job, PlainRates, TrainedStage, exposure_counts
from cornerforge.verbs.train import judge, yield_of
from cornerforge.work import cpu_seconds
from cornerforge.work.stages import Stage, Stages

__all__ = ["spend"]

TRAINING_SHARE = 0.4
"""A training against the AV itself takes this share of the time at most, else a stand-in is trained against."""
_STAND_IN_SHARE = 0.12
_ATTACK_UNTIL, _NATURAL_UNTIL, _NATURAL_AT_SITE = 0.75, 0.92, 0.84
"""Shares of the time at which tests of the adversary, and natural tests, end; analysis and page come after. At a site
these take longer, and a first start compiles more."""
_DECISIONS = 2_500_000
_LEAST_DECISIONS = 1_000_000
"""A training against the AV itself is no shorter; a stand-in is better then."""
_FEWEST_DECISIONS = 20_480
_DECISIONS_PER_SECOND = 30_000.0
"""What a training against a built-in AV does on two busy cores, with room to spare."""
_MOST_CASES, _MOST_AT_SITE = 3_000, 1_000
"""So many cases are enough for an analysis; what time is left goes to natural tests, at a site earlier: there they
crash more often, and an adversary's crashes are seldom the AV's own doing."""
_ENOUGH_NATURAL = 1_000
"""So many natural crashes give a rate to some 6 %; to store many more would take longer than to drive them."""
_PORTIONS = 12
_MOST_PORTION = 65_536
_SURE = 3.0
"""So many crashes more than were seen can be expected in as many tests (95 %, where none was seen)."""
_TREES_LEAST = PLAIN_TESTS + 450_000
"""Trees need so many tests, or answers for as many, before their rate can be trusted."""
_SAMPLE, _NDE_TESTS = 512, 20_000
_SCENES_COUNT = 60.0
"""Where the answers to 1,000 tests take less, what an AV is shown at a site takes longer, so tests are tried [s]."""
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


@dataclass(frozen=True, kw_only=True)
class Portion(Block):
    """Tests that were driven together.

    Attributes:
        first: The first of them.
        frames, bv_millimetres: Time driven [0.1 s], and what BVs drove, as counted at decisions [mm].
        strikes, avoidable: Of the crashed tests, the AV struck, braking would have avoided it; judged for an adversary
            only.
        paid, strictly: As `verdicts.count_paid` gives them; None where nothing is judged.
        exposure: As in `Counted`.
    """

    first: Whole
    frames: Whole
    bv_millimetres: Whole
    strikes: Whole
    avoidable: Whole
    exposure: dict[str, tuple[Whole, ...]]
    paid: Whole | None = None
    strictly: Whole | None = None


class _ByClock(Job):
    """The whole job in about so many hours."""

    def __init__(self, options: Run, hours: float) -> None:
        self._started, stand_in = _clock(), options.stand_in
        if options.site is not None and stand_in == STAND_IN:
            stand_in = STAND_IN_AT_SITE
        self._stand_in = stand_in
        if AvSpec(stand_in).is_outside:
            raise InputError(
                f"stand_in = {stand_in!r} is not built in; name a built-in AV (cornerforge avs lists them)."
            )
        super().__init__(options)
        self.mask = experiment(self.world.driven_by(stand_in), bv="uniform", seed=self.seed)
        self.effort, self._hours, self._library = f"{hours:g}{HOURS}", hours, self.folder / "library"
        self.stand_in = {"stand_in": stand_in, "stand_in_hash": self.mask.av_hash}
        train = asdict(replace(preset_named("fast"), reward=options.reward))
        self.settings = {"hours": hours, "stand_in": stand_in, "train": train}

    def works(self) -> dict[str, Callable[[], Any]]:
        return {
            "nde": self._traffic, "natural": self._rate, "train": self._train, "evaluate": self._yield,
            "baselines": self._compare, "exposure": lambda: _counted(self.found["attack"]),
            "generate": lambda: library_summary(CaseLibrary.open(self._library), _summed(self.found["attack"]).seconds),
        }  # fmt: skip

    def stages(self) -> tuple[Stage, ...]:
        """List the stages: the plan comes first, tests of the adversary before natural ones."""
        after = {
            "nde": ("roads",), "natural": ("nde",), "train": ("told",), "evaluate": ("attack",),
            "baselines": ("attack",), "exposure": ("attack",), "generate": ("attack",),
            "analyse": ("generate", "natural_cases"),
        }  # fmt: skip
        is_kept: dict[str, Callable[[], bool]] = {
            "nde": lambda: self._plan.trees > 0,
            "baselines": lambda: self._plan.baselines > 0,
            **dict.fromkeys(("evaluate", "exposure", "generate"), _never),
        }
        return (
            Stage("plan", Plan, self._choose),
            Stage("told", type(None), self._tell, ("plan",), is_kept=_never),
            Stage("attack", list, self._attack, ("train",), is_kept=_never),
            Stage("roads", list, self._roads, ("baselines",), is_kept=_never),
            *(
                replace(one, after=after.get(one.name, one.after), is_kept=is_kept.get(one.name, one.is_kept))
                for one in super().stages()
            ),
            Stage("spending", Spending, self._spending, ("analyse",), is_kept=_never),
        )

    @property
    def _plan(self) -> Plan:
        plan: Plan = self.found["plan"]
        return plan

    @cached_property
    def _own(self) -> Experiment:
        return self.logged(experiment(self.world, bv="uniform", takes_foreign=True, seed=self.seed))

    def _choose(self) -> Plan:
        """Choose what fits into the time."""
        threads, av, budget = self.options.threads, self.natural.asked, 3600.0 * self._hours
        seconds, at_site = self.natural.seconds_of(threads, tests=1000), self.options.site is not None
        if seconds and not (at_site and seconds < _SCENES_COUNT):
            speed = 1000.0 / seconds
        else:
            tried = simulate_experiment(self.natural, tests=_SAMPLE, seed=self.seed, threads=threads)
            speed = _SAMPLE / max(tried[1], 1e-3)
        own = self.natural.seconds_of(threads, decisions=_DECISIONS) or _DECISIONS / _DECISIONS_PER_SECOND
        fits = int(_DECISIONS * TRAINING_SHARE * budget / own)
        against = None if av is None or fits >= _LEAST_DECISIONS else self._stand_in
        if av is None or against is not None:
            fits = int(_STAND_IN_SHARE * budget * _DECISIONS_PER_SECOND)
        again = 3.5 if av is not None and av.remembers else 1.0
        trees = int((_NATURAL_UNTIL - _ATTACK_UNTIL) * budget * speed / again)
        plain = int(_BASELINE_SHARE * budget * speed / _BASELINES)
        return Plan(
            stand_in=against, decisions=max(_FEWEST_DECISIONS, min(_DECISIONS, fits)),
            trees=trees if trees >= _TREES_LEAST else 0,
            baselines=min(plain, _MOST_BASELINE) if plain >= _LEAST_BASELINE else 0,
            answer_seconds=None if av is None else av.answer_seconds, batch=None if av is None else av.batch,
            processes=self.natural.processes(threads), tests_per_second=speed, training_seconds=own,
            seconds=_clock() - self._started,
        )  # fmt: skip

    def _tell(self) -> None:
        """Say what will be done with the time."""
        plan, seconds = self._plan, 3600.0 * self._hours
        against = "itself" if plan.stand_in is None else f"the stand-in {plan.stand_in}"
        if plan.stand_in is not None:
            against += f" (against the AV itself it would take about {spoken(plan.training_seconds)})"
        tests, rate = plan.tests_per_second * seconds, "by trees of tests" if plan.trees else "counted"
        announce(
            f"{self.natural.pace_text(self.options.threads)}: {spoken(seconds)} are enough for about {tests:,.0f} "
            f"tests to their ends. The adversary learns against {against}; the natural rate is {rate}."
        )
        self.natural.rest()

    def _train(self) -> TrainedStage:
        return self.train(self._own if self._plan.stand_in is None else self.mask, self._plan.decisions)

    def _attack(self) -> list[Portion]:
        """Drive tests of the adversary, and store its crashes in the library."""
        most = _MOST_CASES if self.options.site is None else _MOST_AT_SITE
        portions = self._in_portions("attack", _ATTACK_UNTIL, self._attack_some, most, LIBRARY_FILES)
        self.hostile.rest()
        return portions

    def _attack_some(self, first: int, tests: int) -> Portion:
        run, reward, threads = self.hostile, self.options.reward, check_threads(self.options.threads)
        begun, tally = (_clock(), cpu_seconds()), Tally()
        run.keep_scripts()  # crashes are judged by what the AV answered
        fill_library(
            run, self._library, tests=first + tests, resume=True, stage=f"cases ({first + tests} tests)",
            counting=True, tally=tally, tally_from=first, **self.how,
        )  # fmt: skip
        cases = CaseLibrary.open(self._library)
        stored = cases.scalars(["test"])["test"].to_pylist() if len(cases) else []
        crashed = [test for test in stored if first <= test < first + tests]
        strikes, avoidable = judge(run, self.seed, crashed, reward_numbers("avoidable", 1.0), threads)
        return _portion(
            first, begun, tally, crashed, 0, strikes=int(strikes.sum()), avoidable=int(avoidable.sum()),
            **count_paid(run, self.seed, crashed, reward, threads),
        )  # fmt: skip

    def _yield(self) -> Yield:
        attacks, sums = self.found["attack"], _summed(self.found["attack"])
        return yield_of(
            sums.av_crashes, sums.valid_tests, sums.miles, sum(p.strikes for p in attacks),
            sum(p.avoidable for p in attacks), paid=_sum(p.paid for p in attacks),
            strictly=_sum(p.strictly for p in attacks),
        )  # fmt: skip

    def _compare(self) -> PlainRates:
        if not self._plan.baselines:
            return PlainRates((), 0.0)
        found = self.plain_rates(self._own, self._plan.baselines)
        self._own.rest()
        return found

    def _roads(self) -> list[Portion]:
        """Drive natural tests, unless there is time for trees."""
        if self._plan.trees:
            return []
        until = _NATURAL_UNTIL if self.options.site is None else _NATURAL_AT_SITE
        return self._in_portions("natural", until, self._drive_some, _ENOUGH_NATURAL)

    def _drive_some(self, first: int, tests: int) -> Portion:
        run = self.natural
        run.warm_up()
        begun, tally, frames = (_clock(), cpu_seconds()), Tally(), 0
        crashed: list[int] = []
        run.keep_scripts()  # crashes will be stored as the AV drove
        stage = f"natural tests ({first} before)"
        for start, out in drive_tests(run, tally, stage, first=first, tests=tests, counting=True, **self.how):
            frames += int(out.frame.sum(dtype=np.int64))
            crashed += runner.crashed_tests(start, out)
        return _portion(first, begun, tally, crashed, frames, strikes=0, avoidable=0)

    def _traffic(self) -> Counted:
        if not self._plan.trees:
            return _counted(self.found["roads"])
        return self.count(self.natural, _NDE_TESTS, 0, "natural traffic")

    def _rate(self) -> NaturalRate:
        found = self.rate(self._plan.trees) if self._plan.trees else self._counted_rate(self.found["roads"])
        self.natural.rest()
        return found

    def _counted_rate(self, portions: Sequence[Portion]) -> NaturalRate:
        """Make the natural rate of counted tests, and store their crashes as `rate` does."""
        run, sums, frames = self.natural, _summed(portions), sum(p.frames for p in portions)
        scale = frames * FRAME_S / sums.world_steps / 1000.0 / METRES_PER_MILE if sums.world_steps else 0.0
        miles = sum(p.bv_millimetres for p in portions) * scale
        threads = check_threads(self.options.threads)
        session = PlainTests(run, self.seed, self.folder / "natural", threads=threads, progress=self.options.progress)
        identity = {**run.identity(self.seed), "method": "mc", "cornerforge": version(), "code": code_hash()}
        session.start(identity, resume=True)
        session.take(sums, BvTravel(miles / sums.tests, None, sums.tests), "as many tests as fitted into the time")
        return session.store("max_tests")

    def _in_portions(
        self, name: str, share: float, drive: Callable[[int, int], Portion], most: int, makes: Sequence[str] = ()
    ) -> list[Portion]:
        """Drive portions until a share of the time is over, or until `most` crashes are found."""
        found, until = self.found, share * 3600.0 * self._hours
        before = (found["plan"], found["train"].policy, *found.get("attack", ()), found.get("baselines"))
        spent = sum(one.seconds for one in before if one is not None)
        return in_portions(Stages(self.folder), name, self._plan, until, spent, drive, most, makes)

    def _spending(self) -> Spending:
        plan, found, attacks = self._plan, self.found, self.found["attack"]
        return Spending(
            hours=self._hours, stand_in=plan.stand_in, decisions=plan.decisions, answer_seconds=plan.answer_seconds,
            batch=plan.batch, processes=plan.processes, parts=_parts(plan, found, _summed(attacks)),
            not_found=_not_found(plan, attacks, found["natural"], self.natural.odd.test_length / METRES_PER_MILE),
        )  # fmt: skip


def _never() -> bool:
    return False


def in_portions(
    stages: Stages,
    name: str,
    plan: Plan,
    until: float,
    spent: float,
    drive: Callable[[int, int], Portion],
    most: int,
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
        most: So many crashes are enough; no portion drives tests that make many more.
        makes: Files that each portion adds to, as for `Stages.do`.
    """
    done: list[Portion] = []
    speed, least = plan.tests_per_second, 4 * plan.processes
    share = (until - spent) / _PORTIONS
    while sum(len(portion.crashed) for portion in done) < most:
        left = until - spent
        if done and speed * left < least:
            break
        first, crashed = sum(portion.tests for portion in done), sum(len(portion.crashed) for portion in done)
        at_most = (crashed + _SURE) / (first + _SURE)  # crashes a test; 1 before any was driven
        needed = int((most - crashed) / at_most) + 1
        size = max(least, min(int(speed * min(left, share)), needed, _MOST_PORTION))
        portion = stages.do(f"{name}-{len(done):03}", Portion, lambda first=first, size=size: drive(first, size), makes)  # type: ignore[misc]
        done.append(portion)
        spent += portion.seconds
        speed = portion.tests / max(portion.seconds, 1e-3)
    return done


def _portion(
    first: int, begun: tuple[float, float], tally: Tally, crashed: Sequence[int], frames: int, **judged: Any
) -> Portion:
    """Make a portion of its sums."""
    bv_millimetres, exposure = int(tally.counts.totals[statistics.BV_TRAVEL_MM]), exposure_counts(tally)
    return Portion.of(
        tally, begun, _clock(), crashed, first=first, frames=frames, bv_millimetres=bv_millimetres, exposure=exposure,
        **judged,
    )  # fmt: skip


def _summed(portions: Sequence[Portion]) -> MonteCarlo:
    """Sum portions up."""
    sums = MonteCarlo()
    for portion in portions:
        sums = sums.plus(portion)
    return sums


def _counted(portions: Sequence[Portion]) -> Counted:
    """Sum portions up, as tests with all histograms."""
    sums, names = _summed(portions), portions[0].exposure
    tests, seconds = sums.valid_tests, max(sums.seconds, 1e-3)
    found = Simulated(
        **vars(rate_summary(sums.av_crashes, tests, sums.miles)), av_crashes=sums.av_crashes, av_faults=sums.av_faults,
        bv_crashes=sums.bv_crashes, seconds=round(seconds, 3), world_steps=sums.world_steps,
        world_steps_per_second=round(sums.world_steps / seconds, 2), tests_per_second=round(tests / seconds, 4),
        digest=hashlib.sha256("".join(p.digest for p in portions).encode()).hexdigest(),
    )  # fmt: skip
    return Counted(found, {n: tuple(np.sum([p.exposure[n] for p in portions], axis=0).tolist()) for n in names})


def _sum(counts: Iterable[int | None]) -> int | None:
    """Sum counts up; None if one is None."""
    known = list(counts)
    return None if None in known else sum(n for n in known if n is not None)


def _share(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _not_found(plan: Plan, attacks: Sequence[Portion], natural: NaturalRate, miles: float) -> tuple[str, ...]:
    """Say what the time was too short for."""
    said = []
    n, crashes = (sums := _summed(attacks)).valid_tests, sums.av_crashes
    if crashes == 0:
        high = binomial_interval(0, n)[1]
        said.append(
            f"0 crashes in {n:,} tests of the adversary: fewer than {_share(high)} of such tests end in one (95 %)."
        )
    if natural.method == "mc" and natural.av_crashes == 0:
        tests = natural.plain_tests
        said.append(
            f"0 crashes in {tests:,} natural tests: fewer than one in {max(1, tests // 3):,} tests, or in "
            f"{few_digits(tests / 3.0 * miles)} miles (rule of three, 95 %). That says nothing about rare "
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


def _parts(plan: Plan, found: Mapping[str, Any], attacks: MonteCarlo) -> tuple[SpentOn, ...]:
    """List what the time was spent on."""
    against = "the AV itself" if plan.stand_in is None else f"the stand-in {plan.stand_in}"
    trained, often, plain, cases = found["train"].policy, found["natural"], found["baselines"], found["analyse"]
    how = {"mc": "counted", "is": "weighted tests", "splitting": "trees of tests"}[often.method]
    parts: list[tuple[str, float, int | None, str]] = [
        ("loading, and measuring the AV's speed", round(plan.seconds, 1), None,
         f"about {3600.0 * plan.tests_per_second:,.0f} tests an hour expected"),
        (f"training the adversary against {against}", trained.seconds, None, f"{trained.decisions:,} decisions"),
        ("tests of the adversary with the AV", round(attacks.seconds, 1), attacks.tests,
         f"{attacks.av_crashes:,} crashes, all stored as cases"),
    ]  # fmt: skip
    if plain.rates:
        tests = sum(rate.tests for rate in plain.rates)
        parts.append(("plain adversaries", round(plain.seconds, 1), tests, "yields to compare with"))
    came = f"{often.av_crashes:,} crashes" if often.method == "mc" else "a rate"
    parts.append((f"natural tests, {how}", often.seconds, often.tests, came))
    if cases is not None:
        came = f"{len(cases.clusters)} clusters, {len(cases.rare)} rare cases"
        parts.append(("analysis of the cases", round(cases.seconds["total"], 1), None, came))
    return tuple(SpentOn(what=what, seconds=s, tests=n, came_of_it=came) for what, s, n, came in parts)


def spend(options: Run, hours: float) -> RunDone:
    """Do the whole job in about so many hours; see `run`.

    Raises:
        CornerForgeError: Input, files or output place are not right, or the AV fails too often.
    """
    return _ByClock(options, hours).do(numbered=False)
