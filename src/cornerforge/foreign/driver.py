"""AVs from outside: their processes are opened, lent and ended here, their faults and answers are kept."""

from __future__ import annotations

import queue
import shlex
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import AvFaultError, InputError
from cornerforge.foreign.answers import controller_of
from cornerforge.foreign.av_log import AvLog
from cornerforge.foreign.bulk import Fault, RangeOfTests
from cornerforge.foreign.interface import AT_SITES
from cornerforge.foreign.interpreter import AT_WORK
from cornerforge.foreign.named_avs import remember
from cornerforge.foreign.pace import MOST_WORLDS, Pace, choose_batch
from cornerforge.foreign.process import FIRST_TIMEOUT, AvFailureError, AvProcess
from cornerforge.foreign.session import (
    AvSession,
    Steps,
    answers_per_second,
    context_of,
    seeds_of,
)
from cornerforge.foreign.spec import AvSpec
from cornerforge.road.straight import road_numbers
from cornerforge.sim import Setting, lockstep, outcome, statistics
from cornerforge.types import FRAME_S, Odd

__all__ = ["MAX_FAULTS", "Fault", "ForeignAv"]

MAX_FAULTS = 20
"""Number of faults that ends a run."""
MAX_HANGS = 5
"""Number of faults by hanging that ends a run."""
_KEPT_SCRIPTS = 20_000
_FORMS = {"view": "lane orders", "lane": "lane orders", "steering": "angles of its wheels", "trajectory": "trajectories"}


class _Starter:
    """Starts processes of one AV; it does not know the driver whose sessions it makes, so both end when that one does.

    Attributes:
        about: What the AV's first process said of it; None: there was none yet.
    """

    def __init__(self, spec: AvSpec, odd: Odd, pace: Pace, log: AvLog) -> None:
        self._spec, self._odd, self._pace, self._log = spec, odd, pace, log
        self.about: dict[str, str] | None = None

    def __call__(self) -> AvProcess:
        """Start a process of the AV.

        Raises:
            AvFaultError: It is another AV than before.
            InputError: It drives on roads only and the tests are at a site, or the other way.
        """
        name, limits = self._spec.name, {"timeout": self._pace.timeout, "first_timeout": self._pace.first_timeout}
        how: dict[str, Any] = {"confines": self._spec.confines, "reading": self._spec.reading, **limits}
        process = AvProcess(name, pace=self._pace, log=self._log, **how)
        if wrong := _in_the_wrong_place(name, process.about, self._odd):
            process.close()
            raise InputError(wrong)
        about, self.about = self.about, self.about or process.about
        if about is not None and process.about != about:
            process.close()
            raise AvFaultError(
                f"The AV {name} is not the one that drove before: it was {_some(about)}, it is {_some(process.about)}. "
                "Leave its files alone while it drives, and begin anew."
            )
        return process


class ForeignAv:
    """An AV from outside, ready to drive tests; an instance is a `DriveChunk` (see `sim.runner`).

    Its first process starts when something is asked of it that only a process can say (`open`).

    An answer that is no array of (B, 2) real numbers, an exception, an end of the process, or an answer that takes
    too long (`Pace.limit`) fails the whole batch; the AV is made anew and drives the tests again in smaller groups,
    until the tests that fail alone are found. An answer of NaN, infinity, or a lane order other than -1, 0, 1 fails its
    own test only. A test that fails is a fault: it is listed in `faults` and does not count as a test.

    Args:
        spec: The AV.
        odd: The ODD.
        seed: Seed of the run, told to the AV.

    Attributes:
        spec, odd, seed, name: As given; the AV's name.
        pace: How fast the AV answers.
        log: What it prints, and its tracebacks.
        faults: Faults so far, by (seed, test).
        keeps_scripts: Answers of crashed tests are kept (`keep_scripts`).

    Raises (all that needs a process):
        InputError, FileFormatError: `spec` names no AV.
        AvFaultError: The AV fails at its first question.
    """

    def __init__(self, spec: AvSpec, odd: Odd, *, seed: int = 0) -> None:
        self.spec, self.name, self.odd, self.seed = spec, spec.name, odd, seed
        self._context, self._road = context_of(odd, batch=spec.batch or 1, seed=seed), road_numbers(odd)
        self.pace = Pace(spec.timeout, FIRST_TIMEOUT)
        self._opening, self._lock = threading.Lock(), threading.Lock()
        self._about: dict[str, str] | None = None
        self._free: queue.SimpleQueue[AvSession] = queue.SimpleQueue()
        self.faults: dict[tuple[int, int], Fault] = {}
        self._driven = 0
        self.keeps_scripts = False
        self._scripts: OrderedDict[tuple[int, int], NDArray[np.float64]] = OrderedDict()
        self.log = AvLog()
        self._start = _Starter(spec, odd, self.pace, self.log)

    # --- the AV, opened ---

    def open(self) -> dict[str, str]:
        """Start a first process and measure how fast it answers, unless that was done; give what it says of the AV."""
        with self._opening:
            if self._about is None:
                remember(self.name)
                AT_WORK[self] = self.name, self.spec.confines
                first = self.new_session(self._context.batch)
                about = first.process().about
                if self.spec.batch is None:
                    batch = choose_batch(lambda worlds: self._seconds(first, worlds))
                    self._context = replace(self._context, batch=batch)
                else:
                    self._seconds(first, self.spec.batch)
                self._free.put(first)
                self._about = about
            return self._about

    @property
    def hash(self) -> str:
        """SHA-256 (16 hex digits) of its source or file."""
        return self.open()["hash"]

    @property
    def controller(self) -> int:
        """Controller that it is to the simulator: OUTSIDE, or STEERED if it steers (`sim.controllers`)."""
        return controller_of(self.open()["form"])

    @property
    def remembers(self) -> bool:
        """True if an answer may depend on what the AV saw before in its test."""
        return self.open()["remembers"] == "yes"

    @property
    def batch(self) -> int:
        """Worlds side by side."""
        self.open()
        return self._context.batch

    @property
    def answer_seconds(self) -> float:
        """Time for the answer in one of `batch` worlds [s]."""
        return self.pace.usual(self.batch) / self.batch

    def _seconds(self, session: AvSession, worlds: int) -> float:
        """Measure how long the AV takes for an answer in so many worlds [s]; one that never works is reported at once.

        The first answer of a process may take longer than others, so it does not count unless it is as expected.
        """
        session.resize(worlds)
        expected = self.pace.usual(worlds)
        try:
            begun = time.perf_counter()
            session.ask_once()
            seconds = time.perf_counter() - begun
            if seconds > 1.0 and (seconds < 1.5 * expected or worlds > 16):
                self.pace.note(worlds, seconds)
                return seconds
            begun = time.perf_counter()
            session.ask_once()
            return time.perf_counter() - begun
        except AvFailureError as failure:
            raise AvFaultError(
                f"The AV {self.name} {failure} at its first question; look closer with: {self.closer()}"
            ) from failure

    def closer(self) -> str:
        """Give the end of a message on a failure: the command that looks closer, and the file of what was printed."""
        options = self.spec.confines.options() + self.spec.reading.options()
        return f"cornerforge check-av {shlex.quote(self.name)}{options}{self.log.pointer()}"

    def explained(self, error: AvFaultError, how: str) -> AvFaultError:
        """Add the AV's own traceback to an error, where there is one of a failure that `how` describes."""
        if trace := self.log.trace(how):
            error.add_note(f"The AV's own traceback:\n{trace}")
        return error

    def steering(self, setting: Setting) -> Setting:
        """Copy a setting in which this AV drives."""
        return setting.with_drivers(av=self.controller)

    def new_session(self, batch: int) -> AvSession:
        """Make a session of the caller's own, with so many worlds side by side; the caller drops it."""
        return AvSession(replace(self._context, batch=batch), self._road, self._start)

    @contextmanager
    def lend_session(self, tests: int | None = None, set_speed: float | None = None) -> Iterator[AvSession]:
        """Lend this thread a session, with an AV process of its own.

        Args:
            tests: It drives no more worlds than so many tests need.
            set_speed: At which it is to drive where nothing is in its way [m/s]; None: as usual.
        """
        rows = self.batch if tests is None else self.pace.rows(self.batch, tests)
        try:
            session = self._free.get_nowait()
        except queue.Empty:
            session = self.new_session(rows)
        try:
            if not rows <= session.batch_size < 2 * rows:
                session.resize(rows)
            session.set_to(self._context.set_speed if set_speed is None else set_speed)
            yield session
        except BaseException:
            session.drop()
            raise
        finally:
            self._free.put(session)

    def warm_up(self, setting: Setting, slots: int) -> None:
        """Load the compiled kernels, or compile them, so that timings do not count it."""
        with self.lend_session() as session:
            batch = lockstep.allocate_batch(1, slots, session.views(1, slots), setting.road)
        setting = self.steering(setting)
        lockstep.begin(0, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), setting, batch)
        steps = Steps(setting, slots, batch)
        steps.see()
        steps.act(np.zeros((1, setting.answer_width)))

    def close(self) -> None:
        """End the AV's processes; without this they end with this object or the program."""
        while not self._free.empty():
            self._free.get().drop()

    def group_size(self, worlds: int, threads: int) -> int:
        """Number of worlds, of a fixed number, that one process drives: all have some, unless the AV is fast."""
        self.open()
        most = self.spec.batch or MOST_WORLDS
        busy = self.spec.processes or (threads if self.pace.usual(min(worlds, most)) > 0.005 else 1)
        return -(-worlds // max(-(-worlds // most), min(worlds, busy)))

    # --- driving ---

    def __call__(
        self, setting: Setting, slots: int, seed: int, first: int, count: int, counting: bool | statistics.Census
    ) -> tuple[outcome.Outcomes, statistics.Counts]:
        """Drive `count` tests from `first` on; the outcome code of a fault is AV_FAULT.

        Raises:
            AvFaultError: There are too many faults.
        """
        with self.lend_session(count, float(setting.av.idm.desired_speed)) as session:
            census = statistics.census_of(counting)
            tests = RangeOfTests(self, session, self.steering(setting), slots, seed, first, count, census)
            session.process()  # its start is not driving
            begun = time.perf_counter()
            counts = tests.drive()
            answers = float(tests.outcomes.frame.sum()) * FRAME_S * answers_per_second(setting)
            self.pace.note_driven(answers, time.perf_counter() - begun, session.batch_size)
        self.note_driven(count)
        return tests.outcomes, counts

    def note_driven(self, tests: int) -> None:
        """Note that so many more tests were driven."""
        with self._lock:
            self._driven += tests

    @contextmanager
    def on_trial(self) -> Iterator[None]:
        """Let tests of the block count for the pace alone: its faults are forgotten; the work meets them again."""
        with self._lock:
            faults, driven = dict(self.faults), self._driven
        try:
            with suppress(AvFaultError):
                yield
        finally:
            with self._lock:
                self.faults.clear()
                self.faults.update(faults)
                self._driven = driven

    def note(self, seed: int, fault: Fault) -> None:
        """Note a fault in a test of a seed.

        Raises:
            AvFaultError: There are too many faults.
        """
        with self._lock:
            self.faults[seed, fault.test] = fault
            self.log.write(f"cornerforge: left out test {fault.test} of seed {seed}: the AV {fault.message}\n".encode())
            self.log.named()
            n = sum(other.what != "left" for other in self.faults.values())
            hangs = sum(other.what == "hung" for other in self.faults.values())
            driven = self._driven
        if n >= MAX_FAULTS or hangs >= MAX_HANGS:
            tests = ", ".join(str(test) for test in sorted(test for _, test in list(self.faults))[:5])
            error = AvFaultError(
                f"The AV {self.name} spoiled {n} tests (such as {tests}; {driven:,} were done before). "
                f"In test {fault.test} it {fault.message}. Correct the AV; to look closer: {self.closer()}"
            )
            raise self.explained(error, fault.message)

    # --- scripts: what the AV answered in one test ---

    def keep_scripts(self, *, anew: bool = False) -> None:
        """Keep the answers of crashed tests from now on, so that recording one need not ask the AV again.

        Args:
            anew: Forget what was kept: tests of the same names will be driven in another setting.
        """
        self.keeps_scripts = True
        if anew:
            with self._lock:
                self._scripts.clear()

    def keep_script(self, seed: int, test: int, script: NDArray[np.float64]) -> None:
        """Keep the AV's answers in one test, (number of answers, W)."""
        with self._lock:
            self._scripts[seed, test] = script
            if len(self._scripts) > _KEPT_SCRIPTS:
                self._scripts.popitem(last=False)

    def script(self, setting: Setting, slots: int, seed: int, test: int) -> NDArray[np.float64]:
        """Give the AV's answers in one test, (number of answers, W); the AV is asked again unless they are kept.

        Raises:
            AvFaultError: The AV fails in this test.
        """
        with self._lock:
            if (seed, test) in self._scripts:
                return self._scripts[seed, test]
        script = self.ask(setting, slots, seed, test)
        self.keep_script(seed, test, script)
        return script

    def ask(self, setting: Setting, slots: int, seed: int, test: int) -> NDArray[np.float64]:
        """Let the AV drive one test of a setting, and give its answers, (number of answers, W).

        Raises:
            AvFaultError: The AV fails in this test.
        """
        with self.in_test(slots, seed, test, float(setting.av.idm.desired_speed)) as (views, ask):
            batch = lockstep.allocate_batch(1, slots, views, setting.road)
            lockstep.begin(seed, np.zeros(1, dtype=np.int64), np.array([test], dtype=np.int64), setting, batch)
            steps = Steps(self.steering(setting), slots, batch)
            answers = []
            while lockstep.running(batch).size:
                steps.see()
                answers.append(ask())
                steps.act(answers[-1])
        return np.concatenate(answers)

    @contextmanager
    def in_test(
        self, slots: int, seed: int, test: int, set_speed: float
    ) -> Iterator[tuple[NDArray[Any], Callable[[], NDArray[np.float64]]]]:
        """Let it begin a test that the caller drives (`sim.Asked`); a whole batch is asked, zeros elsewhere."""
        fault: AvFaultError | None = None
        with self.lend_session(set_speed=set_speed) as session:
            views = session.batch(slots).views
            views[:] = 0.0
            rows = fresh = np.zeros(1, dtype=np.int64)
            seeds = seeds_of(seed, np.array([test]))

            def ask() -> NDArray[np.float64]:
                nonlocal fresh, seeds
                try:
                    given, failed = session.act(views, rows, fresh, seeds)
                except AvFailureError as failure:
                    session.drop()
                    raise AvFaultError(f"The AV {self.name} {failure} in test {test}{self.log.pointer()}") from failure
                fresh, seeds = fresh[:0], seeds[:0]
                if failed:
                    error = AvFaultError(f"In test {test} the AV {self.name} {failed[0]}{self.log.pointer()}")
                    raise self.explained(error, str(failed[0]))
                return given[:1]

            try:
                yield views[:1], ask
            except AvFaultError as error:  # where its process still answers, it goes on with other tests
                fault = error
        if fault is not None:
            raise fault

    def repeats(self, setting: Setting, slots: int, seed: int, test: int) -> bool:
        """Does the AV give the same answers when it drives the test twice more?

        Raises:
            AvFaultError: The AV fails in this test.
        """
        scripts = []
        for _ in range(2):
            with self._lock:
                self._scripts.pop((seed, test), None)
            scripts.append(self.script(setting, slots, seed, test))
        return np.array_equal(scripts[0], scripts[1])


def _in_the_wrong_place(name: str, about: dict[str, str], odd: Odd) -> str:
    """Say why an AV cannot drive where the tests are, and what to do; "" if it can."""
    drives_at_sites = about["form"] == AT_SITES
    if odd.site is not None and not drives_at_sites:
        return (
            f"The AV {name} drives on roads only: it answers by {_FORMS.get(about['form'], about['form'])}. At a site, "
            f"such as {odd.site.name}, an AV sees its path and answers by an acceleration along it: a class (or the hello "
            f'of a program) that says answers = "{AT_SITES}"; see docs/site-avs.md and examples/junction_av.py.'
        )
    if odd.site is None and drives_at_sites:
        return f"The AV {name} drives at sites only; give one, such as --site mcity-signal."
    return ""


def _some(about: dict[str, str]) -> str:
    return f"{about['hash']} with answers by {about['form']}"
