"""`check-av` tries a foreign AV on edge cases and measures its speed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._options import verb
from cornerforge._words import spoken
from cornerforge.errors import AvFaultError, InputError
from cornerforge.experiment.counting import simulate_experiment
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.forecast import LONG_SECONDS, forecast
from cornerforge.experiment.setting import experiment, road_of
from cornerforge.foreign.answers import controller_of
from cornerforge.foreign.driver import ForeignAv
from cornerforge.foreign.edge_cases import trials_of
from cornerforge.foreign.interface import AT_SITES
from cornerforge.foreign.named_avs import remember
from cornerforge.foreign.pace import announce
from cornerforge.foreign.process import AvFailureError
from cornerforge.foreign.session import AvSession
from cornerforge.foreign.spec import AvSpec, spec_of
from cornerforge.results import AvChecked
from cornerforge.results.avs import AvCheck, AvDoes, AvSpeed
from cornerforge.sim import controllers
from cornerforge.types import Odd
from cornerforge.verbs.options.driving import CheckAv
from cornerforge.work.progress import Progress
from cornerforge.world_options import WorldOptions

__all__ = ["check_av"]

_OK, _WARN, _FAIL = "ok", "warn", "FAIL"
_BATCH = 64
_MANY = 512
_STEPS = 12
_SPEED_BATCHES = (1, 64, 256)
_SPEED_SECONDS = 0.5
_CALL_SECONDS = 1.0
"""A call on the bench should take no longer [s]: a slow AV is asked about fewer worlds."""
_REPEAT_SECONDS = 60.0
_DRIVE_SECONDS = 60.0
_MOST_TESTS = 256
_MOST_HANGS = 2
_USUAL_DECISIONS = 2_500_000
"""Decisions of a training in `run`."""
_LONG_TRAINING = 1800.0
_ROUNDING = 1e-3


class _Bench:
    """Trials of one AV, each in a process of its own, and the list of findings.

    Attributes:
        pace: How fast it answers.
        few, many: Worlds of trials, fewer for a slow AV.
        hangs: So often it gave no answer in time.
    """

    def __init__(self, av: ForeignAv) -> None:
        self._av, self.pace, self.log = av, av.pace, av.log
        self.trials = trials_of(av.odd)
        self.few, self.many, self.hangs = _BATCH, _MANY, 0
        self._session: AvSession | None = None
        self._loading = 0.0
        self.checks: list[AvCheck] = []
        self.about: dict[str, str] = {}

    def note(self, name: str, verdict: str, found: str, trace: str = "") -> None:
        """Add a finding to the list."""
        self.checks.append(AvCheck(name=name, verdict=verdict, found=found, trace=trace or None))

    @contextmanager
    def trying(self, name: str) -> Iterator[None]:
        """Add a failure of the AV in the block to the list, with its traceback."""
        try:
            yield
        except AvFailureError as failure:
            self.note(name, _FAIL, f"it {failure}", self.log.trace(str(failure)))

    def session(self, batch: int) -> AvSession:
        """Return the AV's process, set up for `batch` worlds."""
        if self._session is None or self._session.batch_size != batch:
            self.close()
            session, begun = self._av.new_session(batch), time.perf_counter()
            self.about = session.process().about
            self._loading = max(self._loading, time.perf_counter() - begun)
            self._session = session
        return self._session

    def close(self) -> None:
        """End the process."""
        if self._session is not None:
            self._session.drop()
            self._session = None

    def start(self) -> None:
        """Ask about one world, and choose by the AV's speed how many it is asked about in trials.

        A process of it that starts later has less time to load and for its first answer, now that it is known what
        these take.
        """
        begun, view = time.perf_counter(), self.trials.case(self.trials.names[0])[None, None]
        try:
            self.answers(view)
            took = time.perf_counter() - begun
            self.answers(view)
        except AvFailureError:
            if self.hangs:
                raise
            return  # the trials will say so
        self.pace.first_timeout = min(self.pace.first_timeout, self.pace.timeout + 3.0 * max(took, self._loading))
        alone = self.pace.usual(1)
        if alone * _BATCH > _CALL_SECONDS:
            self.few = max(2, int(_CALL_SECONDS / alone))
            self.many = 2 * self.few
        seconds = alone * self.few * len(self.trials.names) + self.repeat_steps() * alone * (3 * self.few + 1 + self.many)
        if seconds > LONG_SECONDS:
            announce(
                f"{self._av.name} takes about {spoken(alone)} for an answer in one world (measured): trials will take "
                f"about {spoken(seconds)}."
            )

    def repeat_steps(self) -> int:
        """Say for how many seconds of traffic repeats are tried: fewer for a slow AV."""
        each = max(self.pace.usual(1), 1e-6)
        return max(2, min(_STEPS, int(_REPEAT_SECONDS / (each * (3 * self.few + 1 + self.many)))))

    def answers(self, views: NDArray[Any], order: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Return the answers (T, B, W) to T successive views after a reset; world b stands in row order[b].

        Raises:
            AvFailureError: It fails, in one of the worlds or in all.
        """
        steps, batch = views.shape[:2]
        rows = np.arange(batch) if order is None else order
        session, given = self.session(batch), []
        fresh, seeds = rows.astype(np.int64), np.arange(batch, dtype=np.int64)
        for step in range(steps):
            shown = np.empty_like(views[step])
            shown[rows] = views[step]
            try:
                answers, failed = session.act(session.shown(shown), np.arange(batch), fresh, seeds)
                for failure in failed.values():
                    raise failure
            except AvFailureError as failure:
                self.close()
                self.hangs += failure.what == "hung"
                raise
            given.append(answers[rows])
            fresh, seeds = fresh[:0], seeds[:0]
        return np.array(given)


@verb(CheckAv, writes=False)
def check_av(options: CheckAv) -> AvChecked:
    """Try an AV on edge cases, check that its answers repeat, and measure its speed.

    Returns:
        What `cornerforge check-av --json` prints: what each trial found, and the AV's speed.

    Raises:
        CornerForgeError: It is no AV, or fails at once.
    """
    world = options.world()
    spec = spec_of(world)
    if not spec.is_outside:
        raise InputError(
            f'"{spec.name}" is a built-in name or none; check-av tries module:Class, file.py:Class, "cmd: PROGRAM", '
            ".onnx and .zip files."
        )
    remember(spec.name)
    road = road_of(world)
    bench = _Bench(ForeignAv(spec, road, seed=options.seed))
    try:
        bench.session(1)
        speed: tuple[AvSpeed, ...] = ()
        bench.note("loads", _OK, "it can be made and set up")
        if bench.about["read"]:
            bench.note("read as", _OK, bench.about["read"])
        if bench.about["kind"] == "zip":
            _compare(bench, spec, road)
        _try_edge_cases(bench, options.progress)
        if all(check.verdict != _FAIL for check in bench.checks):
            options.progress("repeats", 0, 1)
            _try_repeats(bench, options.seed)
            options.progress("speed", 0, 1)
            speed = _speeds(bench, options.seed)
    finally:
        bench.close()
    does = _drive(bench, world, options.tests, options.seed, options.threads, options.progress)
    passed = all(check.verdict != _FAIL for check in bench.checks)
    log = None if passed else bench.log.named()
    return AvChecked(
        av=spec.name,
        kind=bench.about["kind"],
        hash=bench.about["hash"],
        memory_gb=round(spec.confines.gigabytes, 3),
        checks=tuple(bench.checks),
        passed=passed,
        log=None if passed or log is None else str(log),
        speed=speed,
        does=does,
    )


def _compare(bench: _Bench, spec: AvSpec, road: Odd) -> None:
    """Compare its answers with those of the library that made the file, where it is there, in a process of its own."""
    other = _Bench(ForeignAv(replace(spec, reading=replace(spec.reading, compares=True)), road))
    try:
        other.session(1)
    except AvFaultError as error:
        bench.note("its maker's answers", _WARN, f"not compared: {error}")
    other.close()
    if said := other.about.get("maker"):
        verdict = _OK if float(said.split()[0]) <= _ROUNDING else _FAIL
        bench.note("its maker's answers", verdict, f"they differ by {said}")


def _try_edge_cases(bench: _Bench, progress: Progress) -> None:
    """Try all edge cases, unless the AV hangs again and again; then say if all answers together are strange."""
    given: list[float] = []
    try:
        bench.start()
    except AvFailureError as failure:
        bench.note("first questions", _FAIL, f"it {failure}; nothing else was tried")
        return
    names = bench.trials.names
    for k, name in enumerate(names):
        progress("edge cases", k, len(names))
        if bench.hangs == _MOST_HANGS:
            bench.note("other edge cases", _FAIL, f"{len(names) - k} were not tried, because it hangs")
            return
        _try_edge_case(bench, name, given)
    if 0.0 < max(map(abs, given), default=0.0) <= 1.0:
        doubt = "no acceleration is beyond -1 to 1 m/s2: are they shares of the strongest, as of Box(-1, 1)?"
        bench.note("units", _WARN, doubt)


def _try_edge_case(bench: _Bench, name: str, given: list[float]) -> None:
    case = bench.trials.case(name)
    view = np.broadcast_to(case, (1, bench.few, *case.shape)).copy()
    with bench.trying(name):
        answer = bench.answers(view)[0, 0]
        given.append(float(answer[0]))
        steers = controller_of(bench.about["form"]) == controllers.STEERED
        order = 0.0 if steers else float(answer[1])
        text = f"{answer[0]:.2f} m/s2"
        if bench.about["form"] != AT_SITES:
            text += f", curvature {answer[1]:+.4f} /m" if steers else f", lane order {order:+.0f}"
        doubt = bench.trials.doubt(name, float(answer[0]), order)
        beyond = "" if -8.0 <= answer[0] <= 2.0 else "; commands are cut to -8 to 2 m/s2"
        bench.note(name, _WARN if doubt else _OK, text + beyond + (f"; {doubt}" if doubt else ""))


def _difference(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the largest difference of two sets of answers; +inf if one of them is not finite."""
    difference = np.abs(a - b)
    return float(difference.max()) if np.isfinite(difference).all() else np.inf


def _try_repeats(bench: _Bench, seed: int) -> None:
    """Check that answers do not change when views come again, in another order, or in batches of other sizes."""
    rng = np.random.default_rng(seed)
    n, steps = bench.few, bench.repeat_steps()
    views = bench.trials.random(rng, (steps, bench.many))
    few = views[:, :n]
    with bench.trying("random traffic"):
        first = bench.answers(few)
        again = _difference(first, bench.answers(few))
        order = rng.permutation(n)
        turned = _difference(first, bench.answers(few, order))
        alone = _difference(first[:, :1], bench.answers(few[:, :1]))
        many = _difference(first, bench.answers(views)[:, :n])
        bench.note("random traffic", _OK, f"{steps} seconds in {n} worlds")
        if again > 0.0:
            bench.note(
                "repeats", _WARN, f"the same views, asked twice, differ by up to {again:.3g}: it is not deterministic, "
                "so results cannot be repeated. Draw random numbers by the seeds that reset() gives."
            )  # fmt: skip
            return
        bench.note("repeats", _OK, "the same views give the same answers")
        for name, difference in (("order of worlds", turned), ("alone", alone), (f"{bench.many} worlds", many)):
            if difference == 0.0:
                bench.note(name, _OK, "the same answers")
                continue
            text = f"answers differ by up to {difference:.2g} (rounding): tests may come out differently in "
            text += "batches of another size"
            if difference > _ROUNDING:
                text = f"answers differ by up to {difference:.3g}: worlds have an influence on each other"
            bench.note(name, _WARN if difference <= _ROUNDING else _FAIL, text)


def _speeds(bench: _Bench, seed: int) -> tuple[AvSpeed, ...]:
    with bench.trying("speed"):
        slow = 10.0 * _CALL_SECONDS
        return tuple(_speed(bench, seed, batch) for batch in _SPEED_BATCHES if bench.pace.usual(batch) <= slow)
    return ()


def _speed(bench: _Bench, seed: int, batch: int) -> AvSpeed:
    view = bench.trials.random(np.random.default_rng(seed), (1, batch))
    bench.answers(view)
    session, none, everywhere = bench.session(batch), np.zeros(0, dtype=np.int64), np.arange(batch)
    shown = session.shown(view[0])
    calls, start = 0, time.perf_counter()
    while (seconds := time.perf_counter() - start) < _SPEED_SECONDS:
        session.act(shown, everywhere, none, none)
        calls += 1
    return AvSpeed(
        worlds=batch,
        calls_per_second=round(calls / seconds, 1),
        decisions_per_second=round(calls * batch / seconds, 1),
    )


def _drive(
    bench: _Bench, world: WorldOptions, tests: int | None, seed: int, threads: int | None, progress: Progress
) -> AvDoes | None:
    """Drive tests in natural traffic and count crashes; say what the AV's speed allows."""
    if bench.hangs:
        bench.note("tests in natural traffic", _FAIL, "not driven, because it hangs")
        return None
    does = None
    try:
        run = experiment(world, takes_foreign=True, seed=seed)
        av = run.asked
        assert av is not None
        does = _does(run, av, threads)  # with a trial, so that what follows is no promise by answers alone
        if tests is None:
            tests = max(2, min(_MOST_TESTS, int(_DRIVE_SECONDS * does.tests_per_hour / 3600.0)))
        forecast(run, threads, f"driving {tests:,} tests", tests=tests)
        tally, seconds = simulate_experiment(
            run, tests=tests, seed=seed, threads=threads, progress=progress, stage="tests"
        )
        does = _does(run, av, threads)
    except AvFaultError as error:
        trace = getattr(error.__cause__, "trace", "") or "".join(getattr(error, "__notes__", [])).partition("\n")[2]
        bench.note("tests in natural traffic", _FAIL, str(error), trace)
        return does
    found = f"{tally.av_crashes} crashes in {tally.tests} tests, {tests / seconds:,.3g} tests/s"
    if tally.av_faults:
        fault = min(av.faults.values(), key=lambda fault: fault.test)
        text = f"{tally.av_faults} tests spoiled; in test {fault.test} it {fault.message}"
        bench.note("tests in natural traffic", _FAIL, text, av.log.trace(fault.message))
        bench.log = av.log  # of its own processes
    elif tally.av_crashes > 0.05 * tests:
        bench.note("tests in natural traffic", _WARN, found + ": more than one in twenty")
    else:
        bench.note("tests in natural traffic", _OK, found)
    return does


def _does(run: Experiment, av: ForeignAv, threads: int | None) -> AvDoes:
    """Say what the AV's speed allows."""
    tests = 3600.0 * 1000.0 / run.seconds_of(threads, tests=1000)
    decisions = 3600.0 * 1e6 / run.seconds_of(threads, decisions=1e6)
    training = 3600.0 * _USUAL_DECISIONS / decisions
    advice = f"training against it ({_USUAL_DECISIONS:,} decisions) would take about {spoken(training)}"
    if training > _LONG_TRAINING:
        advice += "; run --hours 1 trains against a stand-in, and finds cases with this AV in the time given"
    return AvDoes(
        answer_seconds=av.answer_seconds,
        batch=av.batch,
        processes=run.processes(threads),
        tests_per_hour=round(tests, 1),
        decisions_per_hour=round(decisions),
        advice=advice,
    )
