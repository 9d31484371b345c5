"""`check-av` tries a foreign AV on edge cases and measures its speed."""

from __future__ import annotations

import time
from functools import partial
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.errors import AvFaultError, InputError
from cornerforge.foreign.answers import controller_of
from cornerforge.foreign.av_log import AvLog
from cornerforge.foreign.edge_cases import EDGE_CASES, edge_case, random_views
from cornerforge.foreign.loaders import is_foreign
from cornerforge.foreign.process import FIRST_TIMEOUT, AvFailureError, AvProcess
from cornerforge.foreign.session import AvSession, context_of
from cornerforge.pipeline.counting import simulate_experiment
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import check_av_timeout, experiment, road_of
from cornerforge.results import AvChecked
from cornerforge.results.avs import AvCheck, AvSpeed
from cornerforge.road.straight import road_numbers
from cornerforge.sim import STEERED
from cornerforge.types import Odd
from cornerforge.world_options import AvKeywords, WorldOptions

__all__ = ["check_av"]

_OK, _WARN, _FAIL = "ok", "warn", "FAIL"
_BATCH = 64
_STEPS = 12
_SPEED_BATCHES = (1, 64, 256)
_SPEED_SECONDS = 0.5
_ROUNDING = 1e-3


class _Bench:
    """Trials of one AV, each in a process of its own, and the list of findings."""

    def __init__(self, spec: str, odd: Odd, seed: int, timeout: float, python: str | None) -> None:
        self.log = AvLog()
        self._start = partial(AvProcess, python=python, log=self.log)
        self._spec, self._odd, self._seed, self._timeout = spec, odd, seed, timeout
        self._session: AvSession | None = None
        self._batch = 0
        self.checks: list[AvCheck] = []
        self.about: dict[str, str] = {}

    def note(self, name: str, verdict: str, found: str, trace: str = "") -> None:
        """Add a finding to the list."""
        self.checks.append(AvCheck(name=name, verdict=verdict, found=found, trace=trace or None))

    def note_failure(self, name: str, how: str) -> None:
        """Add a failure of the AV to the list, with its traceback."""
        self.note(name, _FAIL, f"it {how}", self.log.trace(how))

    def session(self, batch: int) -> AvSession:
        """Return the AV's process, set up for `batch` worlds."""
        if self._session is None or self._batch != batch:
            self.close()
            context = context_of(self._odd, batch=batch, seed=self._seed)
            session = AvSession(self._spec, context, road_numbers(self._odd), self._timeout, FIRST_TIMEOUT, self._start)
            self.about = session.process().about
            self._session, self._batch = session, batch
        return self._session

    def close(self) -> None:
        """End the process."""
        if self._session is not None:
            self._session.drop()
            self._session = None

    def answers(self, views: NDArray[np.float32], order: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
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
                answers, failed = session.act(session.shown(shown), fresh, seeds)
                for what, how in failed.values():
                    raise AvFailureError(what, how)
            except AvFailureError:
                self.close()
                raise
            given.append(answers[rows])
            fresh, seeds = fresh[:0], seeds[:0]
        return np.array(given)


def check_av(
    *,
    tests: int = 256,
    seed: int = 0,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[AvKeywords],
) -> AvChecked:
    """Try an AV on edge cases, check that its answers repeat, and measure its speed.

    Args:
        tests: Tests to drive in natural traffic at the end.
        seed: Seed of tests and views.
        progress: Told how far it is.
        world: The AV (`module:Class`, `cmd: PROGRAM`, an `.onnx` or a Stable-Baselines3 `.zip` file) and its world,
            keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge check-av --json` prints: what each trial found, and the AV's speed.

    Raises:
        CornerForgeError: It is no AV, or fails at once.
    """
    check_integer("tests", tests, low=1, high=10**6)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    options = WorldOptions(**world)
    av, av_timeout = options.av, check_av_timeout(options.av_timeout)
    if not is_foreign(av):
        raise InputError(
            f'"{av}" is a built-in name or none; check-av tries module:Class, "cmd: PROGRAM", .onnx and .zip files.'
        )
    road = road_of(options)
    bench = _Bench(av, road, seed, av_timeout, options.av_python)
    try:
        bench.session(_BATCH)
        speed: tuple[AvSpeed, ...] = ()
        bench.note("loads", _OK, "it can be made and set up")
        for k, name in enumerate(EDGE_CASES):
            progress("edge cases", k, len(EDGE_CASES))
            _try_edge_case(bench, name, road)
        if all(check.verdict != _FAIL for check in bench.checks):
            progress("repeats", 0, 1)
            _try_repeats(bench, road, seed)
            progress("speed", 0, 1)
            speed = _speeds(bench, road, seed)
    finally:
        bench.close()
    _drive(bench, options, tests, seed, progress)
    passed = all(check.verdict != _FAIL for check in bench.checks)
    log = None if passed else bench.log.named()
    return AvChecked(
        av=av,
        kind=bench.about["kind"],
        hash=bench.about["hash"],
        checks=tuple(bench.checks),
        passed=passed,
        log=None if passed or log is None else str(log),
        speed=speed,
    )


def _try_edge_case(bench: _Bench, name: str, odd: Odd) -> None:
    view = np.broadcast_to(edge_case(name, odd), (1, _BATCH, 13, 8)).astype(np.float32)
    try:
        answer = bench.answers(view)[0, 0]
    except AvFailureError as failure:
        bench.note_failure(name, str(failure))
        return
    steers = controller_of(bench.about["form"]) == STEERED
    order = 0.0 if steers else float(answer[1])
    text = f"{answer[0]:.2f} m/s2, " + (f"curvature {answer[1]:+.4f} /m" if steers else f"lane order {order:+.0f}")
    doubt = EDGE_CASES[name].doubt(float(answer[0]), order)
    beyond = "" if -8.0 <= answer[0] <= 2.0 else "; commands are cut to -8 to 2 m/s2"
    bench.note(name, _WARN if doubt else _OK, text + beyond + (f"; {doubt}" if doubt else ""))


def _difference(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the largest difference of two sets of answers; +inf if one of them is not finite."""
    difference = np.abs(a - b)
    return float(difference.max()) if np.isfinite(difference).all() else np.inf


def _try_repeats(bench: _Bench, odd: Odd, seed: int) -> None:
    """Check that answers do not change when views come again, in another order, or in batches of other sizes."""
    rng = np.random.default_rng(seed)
    views = random_views(rng, (_STEPS, 512), odd)
    few = views[:, :_BATCH]
    try:
        first = bench.answers(few)
        again = _difference(first, bench.answers(few))
        order = rng.permutation(_BATCH)
        turned = _difference(first, bench.answers(few, order))
        alone = _difference(first[:, :1], bench.answers(few[:, :1]))
        many = _difference(first, bench.answers(views)[:, :_BATCH])
    except AvFailureError as failure:
        bench.note_failure("random traffic", str(failure))
        return
    bench.note("random traffic", _OK, f"{_STEPS} seconds in {_BATCH} worlds")
    if again > 0.0:
        bench.note(
            "repeats", _WARN, f"the same views, asked twice, differ by up to {again:.3g}: it is not deterministic, so "
            "results cannot be repeated. Draw random numbers by the seeds that reset() gives."
        )  # fmt: skip
        return
    bench.note("repeats", _OK, "the same views give the same answers")
    for name, difference in (("order of worlds", turned), ("alone", alone), ("512 worlds", many)):
        if difference == 0.0:
            bench.note(name, _OK, "the same answers")
        elif difference <= _ROUNDING:
            bench.note(
                name, _WARN, f"answers differ by up to {difference:.2g} (rounding): tests may come out differently in "
                "batches of another size"
            )  # fmt: skip
        else:
            bench.note(name, _FAIL, f"answers differ by up to {difference:.3g}: worlds have an influence on each other")


def _speeds(bench: _Bench, odd: Odd, seed: int) -> tuple[AvSpeed, ...]:
    try:
        return tuple(_speed(bench, odd, seed, batch) for batch in _SPEED_BATCHES)
    except AvFailureError as failure:
        bench.note_failure("speed", str(failure))
        return ()


def _speed(bench: _Bench, odd: Odd, seed: int, batch: int) -> AvSpeed:
    view = random_views(np.random.default_rng(seed), (1, batch), odd)
    bench.answers(view)
    session, none = bench.session(batch), np.zeros(0, dtype=np.int64)
    shown = session.shown(view[0])
    calls, start = 0, time.perf_counter()
    while (seconds := time.perf_counter() - start) < _SPEED_SECONDS:
        session.act(shown, none, none)
        calls += 1
    return AvSpeed(
        worlds=batch,
        calls_per_second=round(calls / seconds, 1),
        decisions_per_second=round(calls * batch / seconds, 1),
    )


def _drive(bench: _Bench, world: WorldOptions, tests: int, seed: int, progress: Progress) -> None:
    """Drive tests in natural traffic and count crashes."""
    try:
        run = experiment(world, takes_foreign=True, seed=seed)
        tally, seconds = simulate_experiment(run, tests=tests, seed=seed, threads=1, progress=progress, stage="tests")
    except AvFaultError as error:
        trace = getattr(error.__cause__, "trace", "") or "".join(getattr(error, "__notes__", [])).partition("\n")[2]
        bench.note("tests in natural traffic", _FAIL, str(error), trace)
        return
    found = f"{tally.av_crashes} crashes in {tally.tests} tests, {tests / seconds:,.3g} tests/s"
    if tally.av_faults and run.foreign is not None:
        fault = min(run.foreign.faults.values(), key=lambda fault: fault.test)
        text = f"{tally.av_faults} tests spoiled; in test {fault.test} it {fault.message}"
        bench.note("tests in natural traffic", _FAIL, text, run.foreign.log.trace(fault.message))
        bench.log = run.foreign.log  # of its own processes
    elif tally.av_crashes > 0.05 * tests:
        bench.note("tests in natural traffic", _WARN, found + ": more than one in twenty")
    else:
        bench.note("tests in natural traffic", _OK, found)
