"""`rate --method mc`: natural tests are counted, block by block, and their crashes kept; trees begin with some too.

`counts.json` holds whole blocks only and is replaced after each; `library/` holds all crashes, driven again. The counts
are written first: a kill at any moment loses only the block in progress, and a resumed run drives again the crashes
that the library lacks.
"""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cornerforge.errors import CornerForgeError, FileFormatError
from cornerforge.experiment.counting import rate_summary
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import code_hash, open_output, read_json_file, remove_folder, version, write_json
from cornerforge.experiment.setting import AV_LOG
from cornerforge.foreign.session import answers_per_test
from cornerforge.intervals import binomial_interval, poisson_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.harvester import CaseRoom
from cornerforge.ndd.model import save_model
from cornerforge.rates.crashes import NaturalCrashes, crash_tables
from cornerforge.rates.exposure import SAMPLE_TESTS, BvTravel, bv_travel
from cornerforge.rates.monte_carlo import BLOCK, CHUNK, MonteCarlo, drive_blocks, relative_half_width
from cornerforge.results import NaturalRate, as_json
from cornerforge.results.driving import BvMilesEstimate, Cost, Effort, KindRate
from cornerforge.results.rates import Rate
from cornerforge.work.progress import NO_PROGRESS, Progress, moving

__all__ = ["ASKED", "ENOUGH_TO_FORESEE", "PlainTests", "cost_of", "kept_if_interrupted"]

_BLOCK = BLOCK
_SHARD_CASES = 500
_STORE_SECONDS = 600.0
"""Time between two updates of the library and `rate.json` [s]; each writes a shard, so not every block does."""
_COLUMNS = ("test", "crash_type", "mechanism", "at_start", "rare_action", "overlooked", "looked_away")
ENOUGH_TO_FORESEE = 10
"""Fewest crashes from which the tests for a target can be estimated."""
ASKED = "asked for"
"""The reason for a method that the user named."""


class _Keeper:
    """Crashes that are kept: in a library if there is a folder, else only what the tables need.

    Args:
        run, seed: The experiment and seed of the tests.
        out: The output folder, or None.
    """

    def __init__(self, run: Experiment, seed: int, out: Path | None) -> None:
        self._crashes = NaturalCrashes(run, seed)
        self._studies: list[dict[str, Any]] = []
        self._at_site = run.odd.site is not None
        self._room = CaseRoom(run.slots, int(run.setting.road.max_decisions))
        self._library: CaseLibrary | None = None
        if out is not None:
            identity = {**run.identity(seed), "cornerforge": version(), "code": code_hash()}
            self._library = CaseLibrary.resume(out / "library", identity, run.odd)
            if not (out / "library" / MODEL_FILE).exists():
                save_model(run.model, out / "library" / MODEL_FILE)
        self._next_test = 0 if self._library is None else self._library.next_test

    def catch_up(self, counts: MonteCarlo, progress: Progress) -> None:
        """Drive every crash of `counts` that is not kept yet again, and keep it."""
        self._room.clear()  # an earlier call may have been interrupted
        missing = [test for test in counts.crashed if test >= self._next_test]
        for done, test in enumerate(missing, start=1):
            study = self._crashes.record(test)[1]
            if self._library is None:
                self._studies.append({"test": test, **study.columns()})
            else:
                self._room.add(self._crashes.recorder, study.columns())
            if len(self._room) >= _SHARD_CASES:
                crashes = len(counts.crashed) - len(missing) + done
                self._commit(test + 1, crashes, min(test + 1, counts.valid_tests))
            progress("record crashes", done, len(missing))
        self._commit(counts.tests, counts.av_crashes, counts.valid_tests)

    def _commit(self, next_test: int, crashes: int, tests: int) -> None:
        if next_test > self._next_test and self._library is not None:
            progress = {"next_test": next_test, "tests": tests, "crashes": crashes}
            self._library.fill(*self._room.take(), **progress, shard_cases=_SHARD_CASES)
        self._next_test = max(self._next_test, next_test)

    def finish(self) -> None:
        """Note in the library that the run is complete."""
        if self._library is not None:
            self._library.finish()

    def tables(self, tests: int) -> dict[str, Any]:
        """Make the fields of `NaturalRate` that `crash_tables` gives for the crashes in tests 0 .. `tests` - 1."""
        rows = self._studies
        if self._library is not None:
            rows = self._library.scalars(_COLUMNS).to_pylist() if len(self._library) else []
        return crash_tables((row for row in rows if row["test"] < tests), at_site=self._at_site)


class PlainTests:
    """One session of a run: it drives blocks and keeps them, so that only the block in progress can be lost.

    Attributes:
        run: What is driven.
        counts: All tests so far; the last block may be incomplete.
    """

    def __init__(self, run: Experiment, seed: int, out: Path | None, *, threads: int, progress: Progress) -> None:
        self.run, self._seed, self.out = run, seed, out
        self.reason = ASKED
        self._threads, self._progress = threads, progress
        self.counts = MonteCarlo()
        self._travel: BvTravel | None = None
        self._keeper: _Keeper | None = None

    def start(self, identity: dict[str, Any], *, resume: bool) -> None:
        """Read the folder's counts, if there are any, and load the kernels."""
        if self.out is not None:
            save = self.out / "counts.json"
            if open_output(self.out, identity, resume=resume) and save.exists():
                self.counts = MonteCarlo.from_json(read_json_file(save))
            self.run.keep_printed(self.out / AV_LOG)
        self.run.warm_up()

    def take(self, counts: MonteCarlo, travel: BvTravel, reason: str) -> None:
        """Take over tests that were driven elsewhere, and what their BVs drove, instead of driving any."""
        self.counts, self._travel, self.reason = counts, travel, reason

    def leave_to_trees(self) -> None:
        """Remove the library that an interrupt or a long count began: by trees, crashes are in another one."""
        if self.out is None:
            return
        library = self.out / "library"
        with contextlib.suppress(FileFormatError):
            if CaseLibrary.open(library).finished:  # an earlier call counted to the end
                return
        remove_folder(library)
        self._keeper = None

    def drive(self, target: float, max_tests: int) -> str:
        """Drive until the interval is narrow enough ("target") or `max_tests` are done ("max_tests")."""
        each = 1.0 / answers_per_test(self.run.setting)
        stage, done = f"rate ({self.counts.av_crashes} crashes)", self.counts.tests
        progress = self._progress
        with moving(progress, self.run.answered(), each, stage, done, max_tests) as self._progress:
            try:
                return self._drive(target, max_tests)
            finally:
                self._progress = progress

    def _drive(self, target: float, max_tests: int) -> str:
        """Drive, as `drive`."""
        stored = time.monotonic()
        blocks = drive_blocks(
            self.run.setting,
            self.run.slots,
            seed=self._seed,
            first=self.counts.tests,
            tests=max_tests - self.counts.tests,
            threads=self.run.processes(self._threads),
            block=_BLOCK,
            chunk=self.run.range_size(CHUNK, min(max_tests - self.counts.tests, _BLOCK), self._threads),
            tell=lambda done, crashes: self._tell(target, max_tests, done, crashes),
            drive=self.run.drive,
        )
        with contextlib.closing(blocks):
            while not (enough := self.counts.is_enough(target)) and self.counts.tests < max_tests:
                self._tell(target, max_tests, 0, 0)
                self.counts = self.counts.plus(next(blocks))
                self._save()
                if self.out is not None and time.monotonic() - stored >= _STORE_SECONDS:
                    self.store("running")
                    stored = time.monotonic()
        return "target" if enough else "max_tests"

    def _save(self) -> None:
        """Save the counts, unless the last block is incomplete.

        A later, longer run drives an incomplete block as a whole, so its digest is the one of a run without a break.
        """
        if self.out is not None and self.counts.tests % _BLOCK == 0:
            write_json(self.out / "counts.json", self.counts.to_json())

    def _tell(self, target: float, max_tests: int, done: int, crashes: int) -> None:
        """Report tests; once there are crashes, the total is the number that the target will probably need."""
        total = max_tests
        width = self.counts.half_width()
        if width is not None and self.counts.av_crashes >= ENOUGH_TO_FORESEE:
            total = min(max_tests, round(self.counts.tests * (width / target) ** 2))
        now = self.counts.tests + done
        self._progress(f"rate ({self.counts.av_crashes + crashes} crashes)", now, max(total, now))

    def store(self, state: str) -> NaturalRate:
        """Bring library and `rate.json` up to the counts; return the summary. `state` says why it is done now."""
        self._save()  # An interrupt may come after the last block was counted and before it was saved.
        # No progress bar before the end: a long run would leave hundreds of bars.
        keeper = self._keeper = self._keeper or _Keeper(self.run, self._seed, self.out)
        keeper.catch_up(self.counts, NO_PROGRESS if state == "running" else self._progress)
        if state not in ("running", "interrupted"):
            keeper.finish()
        summary = self._counted(keeper.tables(self.counts.tests), state)
        if self.out is not None:
            write_json(self.out / "rate.json", as_json(summary))
        return summary

    def plain_part(self) -> dict[str, Any]:
        """Make the fields of `NaturalRate` that come from plain tests whatever the method, without the rate."""
        sample = min(SAMPLE_TESTS, self.counts.tests)
        if self._travel is None or self._travel.tests < sample:
            self._travel = bv_travel(
                self.run.setting,
                self.run.slots,
                seed=self._seed,
                tests=sample,
                threads=self.run.processes(self._threads),
                drive=self.run.drive,
            )
        run, counts = self.run, self.counts
        bv_miles = self._travel.miles_per_test * counts.valid_tests
        low, high = poisson_interval(counts.bv_crashes)
        return {
            "av": run.av.name,
            "odd": run.odd.name,
            "lanes": run.odd.n_lanes,
            "plain_tests": counts.valid_tests,
            "av_faults": counts.av_faults,
            "bv_crashes": counts.bv_crashes,
            "bv_crashes_per_test": counts.bv_crashes / counts.valid_tests,
            "bv_crashes_per_bv_mile": None if bv_miles == 0.0 else counts.bv_crashes / bv_miles,
            "interval95_bv_crashes_per_bv_mile": None if bv_miles == 0.0 else (low / bv_miles, high / bv_miles),
            "bv_miles": bv_miles,
            "bv_miles_estimate": BvMilesEstimate(tests=self._travel.tests, relative_error=self._travel.relative_error),
        }

    def rate(self) -> Rate:
        """Make the rate of plain tests."""
        counts, at_site = self.counts, self.run.odd.site is not None
        return rate_summary(counts.av_crashes, counts.valid_tests, counts.miles, at_site=at_site)

    def _counted(self, tables: dict[str, Any], state: str) -> NaturalRate:
        """Make the result of counting, of what `crash_tables` gives."""
        counts, nothing = self.counts, Cost(tests=0, cpu_seconds=0.0)
        rate = self.rate()
        low, high = binomial_interval(counts.av_crashes, counts.valid_tests, 0.9)
        return NaturalRate(
            **vars(rate),
            **self.plain_part(),
            **tables,
            method="mc",
            reason=self.reason,
            relative_half_width=counts.half_width(),
            relative_half_width_90=relative_half_width(low, high, rate.crashes_per_test),
            doubts=(),
            effort=Effort(plain=cost_of(counts), teaching=nothing, estimation=nothing),
            av_crashes=counts.av_crashes,
            effective_sample_size=counts.valid_tests,
            largest_share=None,
            halves=None,
            tail_index=None,
            acceleration=1.0,
            seconds=round(counts.seconds, 3),
            cpu_seconds=round(counts.cpu_seconds, 3),
            tests_per_second=round(counts.tests / counts.seconds, 1) if counts.seconds else None,
            digest=counts.digest,
            state=state,
            crash_type_rates=_counted_kinds(tables["crash_types"], counts.valid_tests),
            mechanism_rates=_counted_kinds(tables["mechanisms"], counts.valid_tests),
        )

    def kinds(self) -> dict[str, int]:
        """Count the crashes so far by mechanism."""
        crashes = NaturalCrashes(self.run, self._seed)
        return dict(Counter(crashes.record(test)[1].mechanism for test in self.counts.crashed))


@contextlib.contextmanager
def kept_if_interrupted(session: PlainTests) -> Iterator[None]:
    """Count; interrupted, bring library and `rate.json` up to the whole blocks first."""
    try:
        yield
    except KeyboardInterrupt:
        if session.out is not None and session.counts.tests:
            # After an interrupt within a commit the library refuses a second write; the crash is stored then.
            with contextlib.suppress(CornerForgeError):
                session.store("interrupted")
        raise


def cost_of(counts: MonteCarlo) -> Cost:
    """Say what counting took."""
    return Cost(tests=counts.tests, cpu_seconds=round(counts.cpu_seconds, 3))


def _counted_kinds(kinds: dict[str, int], tests: int) -> dict[str, KindRate]:
    return {
        name: KindRate(crashes=n, crashes_per_test=n / tests, interval95=binomial_interval(n, tests))
        for name, n in kinds.items()
        if n
    }
