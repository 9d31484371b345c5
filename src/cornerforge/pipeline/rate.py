"""`rate` measures the AV's natural crash rate with its exact interval; it keeps every finished block of tests.

The output folder holds `counts.json` (whole blocks only, replaced after each), `library/` (all crashes, driven again)
and `rate.json`. The counts are written first: a kill at any moment loses only the block in progress, and a resumed run
drives again the crashes that the library lacks.
"""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any, Unpack

from cornerforge._checks import check_in, check_integer, check_number
from cornerforge.errors import CornerForgeError, InputError
from cornerforge.library import CaseLibrary, CaseRecord, case_record
from cornerforge.ndd.model import save_model
from cornerforge.pipeline.counting import rate_summary
from cornerforge.pipeline.crashes import NaturalCrashes, crash_tables
from cornerforge.pipeline.generate import MODEL_FILE
from cornerforge.pipeline.output import code_hash, open_output, provenance, read_json_file, version, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.rates import poisson_interval
from cornerforge.rates.exposure import SAMPLE_TESTS, BvTravel, bv_travel
from cornerforge.rates.monte_carlo import BLOCK, MonteCarlo, drive_block
from cornerforge.results import NaturalRate, as_json
from cornerforge.results.driving import BvMilesEstimate
from cornerforge.world_options import AvKeywords, WorldOptions

__all__ = ["rate"]

_BLOCK = BLOCK
_SHARD_CASES = 500
_STORE_SECONDS = 600.0
"""Time between two updates of the library and `rate.json` [s]; each writes a shard, so not every block does."""
_COLUMNS = ("test", "crash_type", "mechanism", "at_start", "rare_action", "overlooked", "looked_away")
_ENOUGH_TO_FORESEE = 10


class _Keeper:
    """Keeper of crashes: in a library if there is a folder, else only what the tables need.

    Args:
        run, seed: The experiment and seed of the tests.
        out: The output folder, or None.
    """

    def __init__(self, run: Experiment, seed: int, out: Path | None) -> None:
        self._crashes = NaturalCrashes(run, seed)
        self._studies: list[dict[str, Any]] = []
        self._library: CaseLibrary | None = None
        if out is not None:
            identity = {**run.identity(seed), "cornerforge": version(), "code": code_hash()}
            self._library = CaseLibrary.resume(out / "library", identity, run.odd)
            if not (out / "library" / MODEL_FILE).exists():
                save_model(run.model, out / "library" / MODEL_FILE)
        self._next_test = 0 if self._library is None else self._library.next_test

    def catch_up(self, counts: MonteCarlo, progress: Progress) -> None:
        """Drive every crash of `counts` that is not kept yet again, and keep it."""
        missing = [test for test in counts.crashed if test >= self._next_test]
        pending: list[CaseRecord] = []
        for done, test in enumerate(missing, start=1):
            scenario, study = self._crashes.record(test)
            if self._library is None:
                self._studies.append({"test": test, **study.columns()})
            else:
                pending.append(case_record(scenario, extra=study.columns()))
            if len(pending) >= _SHARD_CASES:
                crashes = len(counts.crashed) - len(missing) + done
                self._commit(pending, test + 1, crashes, min(test + 1, counts.valid_tests))
                pending = []
            progress("record crashes", done, len(missing))
        self._commit(pending, counts.tests, counts.av_crashes, counts.valid_tests)

    def _commit(self, pending: list[CaseRecord], next_test: int, crashes: int, tests: int) -> None:
        if next_test > self._next_test and self._library is not None:
            self._library.append(pending, next_test=next_test, tests=tests, crashes=crashes, shard_cases=_SHARD_CASES)
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
        return crash_tables(row for row in rows if row["test"] < tests)


class _Session:
    """One session of a run: it drives blocks and keeps them, so that only the block in progress can be lost.

    Attributes:
        counts: All tests so far; the last block may be incomplete.
    """

    def __init__(
        self, run: Experiment, seed: int, method: str, out: Path | None, *, threads: int, progress: Progress
    ) -> None:
        self._run, self._seed, self._method, self._out = run, seed, method, out
        self._threads, self._progress = threads, progress
        self.counts = MonteCarlo()
        self._travel: BvTravel | None = None
        self._keeper: _Keeper

    def start(self, identity: dict[str, Any], *, resume: bool) -> None:
        """Read the folder's counts, if there are any, and load the kernels."""
        if self._out is not None:
            save = self._out / "counts.json"
            if open_output(self._out, identity, resume=resume) and save.exists():
                self.counts = MonteCarlo.from_json(read_json_file(save))
        self._keeper = _Keeper(self._run, self._seed, self._out)
        self._run.warm_up()

    def drive(self, target: float, max_tests: int) -> str:
        """Drive until the interval is narrow enough ("target") or `max_tests` are done ("max_tests")."""
        stored = time.monotonic()
        while not (enough := self.counts.is_enough(target)) and self.counts.tests < max_tests:
            tests = min(_BLOCK, max_tests - self.counts.tests)
            self._tell(target, max_tests, 0, 0)
            block = drive_block(
                self._run.setting,
                self._run.slots,
                seed=self._seed,
                first=self.counts.tests,
                tests=tests,
                threads=self._threads,
                tell=lambda done, crashes: self._tell(target, max_tests, done, crashes),
                drive=self._run.drive,
            )
            self.counts = self.counts.plus(block)
            self._save()
            if self._out is not None and time.monotonic() - stored >= _STORE_SECONDS:
                self.store("running")
                stored = time.monotonic()
        return "target" if enough else "max_tests"

    def _save(self) -> None:
        """Save the counts, unless the last block is incomplete.

        A later, longer run drives an incomplete block as a whole, so its digest is the one of a run without a break.
        """
        if self._out is not None and self.counts.tests % _BLOCK == 0:
            write_json(self._out / "counts.json", self.counts.to_json())

    def _tell(self, target: float, max_tests: int, done: int, crashes: int) -> None:
        """Report tests; once there are crashes, the total is the number that the target will probably need."""
        total = max_tests
        width = self.counts.half_width()
        if width is not None and self.counts.av_crashes >= _ENOUGH_TO_FORESEE:
            total = min(max_tests, round(self.counts.tests * (width / target) ** 2))
        now = self.counts.tests + done
        self._progress(f"rate ({self.counts.av_crashes + crashes} crashes)", now, max(total, now))

    def store(self, state: str) -> NaturalRate:
        """Bring library and `rate.json` up to the counts; return the summary. `state` says why it is done now."""
        self._save()  # An interrupt may come after the last block was counted and before it was saved.
        # No progress bar before the end: a long run would leave hundreds of bars.
        self._keeper.catch_up(self.counts, NO_PROGRESS if state == "running" else self._progress)
        if self._travel is None or self._travel.tests < SAMPLE_TESTS:
            sample = min(SAMPLE_TESTS, self.counts.tests)
            self._travel = bv_travel(
                self._run.setting,
                self._run.slots,
                seed=self._seed,
                tests=sample,
                threads=self._threads,
                drive=self._run.drive,
            )
        if state not in ("running", "interrupted"):
            self._keeper.finish()
        tables = self._keeper.tables(self.counts.tests)
        summary = _summary(self._run, self.counts, self._travel, self._method, state, tables)
        if self._out is not None:
            write_json(self._out / "rate.json", as_json(summary))
        return summary


def rate(
    *,
    method: str = "mc",
    target_rhw: float = 0.3,
    max_tests: int = 1_000_000,
    out: Path | str | None = None,
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[AvKeywords],
) -> NaturalRate:
    """Measure the AV's natural crash rate in 400 m tests, without bias.

    Args:
        method: "mc", plain Monte Carlo.
        target_rhw: Stop when half the exact 95 % interval is at most this share of the rate, 0.001 to 10.
        max_tests: Largest number of tests.
        out: Folder for `rate.json`, the counts so far, and `library/` with all crashes; None keeps nothing.
        resume: Go on with that folder, after an end, an interrupt or a kill.
        seed: 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
        world: The world, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge rate --json` prints: the rate, its precision and cost, and what kinds of crash there were.

    Raises:
        CornerForgeError: Input, files or output place are not right.
        KeyboardInterrupt: Interrupted; with `out`, library and `rate.json` are brought up to the whole blocks first.
    """
    check_in("method", method, ("mc",))
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("max_tests", max_tests, low=1, high=10**12)
    check_number("target_rhw", target_rhw, low=1e-3, high=10.0)
    if resume and out is None:
        raise InputError("There is nothing to resume without out; name the folder: --out FOLDER --resume")
    run = experiment(WorldOptions(**world), takes_foreign=True, seed=seed)
    folder = None if out is None else Path(out)
    session = _Session(run, seed, method, folder, threads=check_threads(threads), progress=progress)
    identity = {**run.identity(seed), "method": method, "cornerforge": version(), "code": code_hash()}
    session.start(identity, resume=resume)
    try:
        summary = session.store(session.drive(target_rhw, max_tests))
    except KeyboardInterrupt:
        if folder is not None and session.counts.tests:
            # After an interrupt within a commit the library refuses a second write; the crash is stored then.
            with contextlib.suppress(CornerForgeError):
                session.store("interrupted")
        raise
    if folder is not None:
        write_json(folder / "provenance.json", provenance(identity, summary.seconds))
    return summary


def _summary(
    run: Experiment, counts: MonteCarlo, travel: BvTravel, method: str, state: str, tables: dict[str, Any]
) -> NaturalRate:
    bv_miles = travel.miles_per_test * counts.valid_tests
    low, high = poisson_interval(counts.bv_crashes)
    return NaturalRate(
        method=method,
        av=run.av.name,
        odd=run.odd.name,
        lanes=run.odd.n_lanes,
        **vars(rate_summary(counts.av_crashes, counts.valid_tests, counts.miles)),
        relative_half_width=counts.half_width(),
        av_crashes=counts.av_crashes,
        av_faults=counts.av_faults,
        bv_crashes=counts.bv_crashes,
        bv_crashes_per_test=counts.bv_crashes / counts.valid_tests,
        bv_crashes_per_bv_mile=None if bv_miles == 0.0 else counts.bv_crashes / bv_miles,
        interval95_bv_crashes_per_bv_mile=None if bv_miles == 0.0 else (low / bv_miles, high / bv_miles),
        bv_miles=bv_miles,
        bv_miles_estimate=BvMilesEstimate(tests=travel.tests, relative_error=travel.relative_error),
        effective_sample_size=counts.valid_tests,
        acceleration=1.0,
        seconds=round(counts.seconds, 3),
        cpu_seconds=round(counts.cpu_seconds, 3),
        tests_per_second=round(counts.tests / counts.seconds, 1) if counts.seconds else None,
        digest=counts.digest,
        state=state,
        **tables,
    )
