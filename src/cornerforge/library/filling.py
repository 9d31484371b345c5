"""Fill a case library with the crashes of an experiment; tests are driven on threads or machines, and kept in order."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from cornerforge._locks import is_lock
from cornerforge.errors import AvFaultError, CornerForgeError, InputError, UndrawableError
from cornerforge.experiment.counting import CHUNK, tally_summary
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import code_hash, provenance, version, write_json
from cornerforge.experiment.policy_file import policy_hash, save_policy
from cornerforge.experiment.setting import AV_LOG
from cornerforge.foreign.session import answers_per_test
from cornerforge.intervals import binomial_interval
from cornerforge.library import CaseLibrary
from cornerforge.library.harvester import CaseRoom, Harvested, Harvester, harvested_of, hides_bvs
from cornerforge.library.shards import EncodedShard, encode_tables
from cornerforge.ndd.model import save_model
from cornerforge.results import Filled, Simulated
from cornerforge.results.driving import CasesMade
from cornerforge.sim import Tally, controllers, outcome, runner
from cornerforge.work import Rooms, in_order
from cornerforge.work.progress import NO_PROGRESS, Progress, moving

__all__ = ["MODEL_FILE", "cases_made", "fill_library", "harvest_tests", "library_summary", "policy_file", "store_tests"]

_SHARD_CASES = 1000
_COMMIT_SECONDS = 20.0
_MAX_TESTS_PER_CASE = 100_000
_MAX_PACKING = 2
_CHUNK, _CHUNK_NATURAL = 128, 512
MODEL_FILE = "model.npz"


def policy_file(index: int) -> str:
    """Name the file of a policy beside a library by its place in the mixture.

    >>> policy_file(0), policy_file(1)
    ('policy.safetensors', 'policy-1.safetensors')
    """
    return "policy.safetensors" if index == 0 else f"policy-{index}.safetensors"


def _open_library(run: Experiment, out: Path, seed: int, *, resume: bool) -> CaseLibrary:
    """Start a run's library, or go on with it, and put the policy and model that its replays need beside it."""
    identity = {**run.identity(seed), "cornerforge": version(), "code": code_hash()}
    library = (CaseLibrary.resume if resume else CaseLibrary.create)(out, identity, run.odd)
    for index, policy in enumerate(run.policies):
        if not (out / policy_file(index)).exists():
            save_policy(policy, out / policy_file(index))
    if not (out / MODEL_FILE).exists():
        save_model(run.model, out / MODEL_FILE)
    return library


class _Driving:
    """Drives ranges of tests, and gives them with their cases; it can be sent to other processes.

    Args:
        run, seed: The tests.
        policies: Hashes of its policies.
        counting: Count the traffic too.
    """

    def __init__(self, run: Experiment, seed: int, policies: list[str], *, counting: bool) -> None:
        self._seed, self._counting = seed, counting
        self._harvesters = Rooms(partial(_harvester, run, policies))

    def __call__(self, first: int, count: int) -> Harvested:
        with self._harvesters.lend() as harvester:
            return harvester.harvest(self._seed, first, count, counting=self._counting)


def _harvester(run: Experiment, policies: list[str]) -> Harvester | _RecordingHarvester:
    """Make what drives tests of a run and keeps their crashes, in one thread."""
    return Harvester(run.setting, run.slots, policies) if run.asked is None else _RecordingHarvester(run, policies)


class _RecordingHarvester:
    """Drives tests of an AV from outside; each crashed test is driven again, alone, with the AV's first answers."""

    def __init__(self, run: Experiment, policies: list[str]) -> None:
        self._run = run
        # The recorder is made before the tests: it keeps the AV's answers, since an AV may draw random numbers.
        self._recorder, self._cases = (
            run.recorder(),
            CaseRoom(run.slots, int(run.setting.road.max_decisions), policies, hides=hides_bvs(run.setting)),
        )
        self.warm_up = run.warm_up

    def harvest(self, seed: int, first: int, count: int, *, counting: bool = False) -> Harvested:
        outcomes, counts = self._run.drive(self._run.setting, self._run.slots, seed, first, count, counting)
        for test in runner.crashed_tests(first, outcomes):
            self._recorder.drive(seed, test)
            self._cases.add(self._recorder)
        return harvested_of(first, outcomes, counts, self._cases)


class _Harvest:
    """Tests that are driven, given in test order with their cases; and a pool of threads, which packs shards too."""

    def __init__(self, run: Experiment, seed: int, threads: int, *, counting: bool = False) -> None:
        policies = [policy_hash(policy) for policy in run.policies]
        self._drive = _Driving(run, seed, policies, counting=counting)
        self.run, self._threads = run, run.processes(threads)
        self.pool = ThreadPoolExecutor(self._threads)

    def chunks(self, first: int, tests: int) -> Generator[Harvested, None, None]:
        """Yield ranges of tests with their cases; the number of threads and the ranges' size change no result."""
        # With an adversary most tests are cases, and cases fill memory; natural crashes are rare.
        usual = _CHUNK_NATURAL if self.run.setting.who.critical == controllers.NOBODY else _CHUNK
        chunk = self.run.range_size(usual, tests, self._threads)
        return in_order(self._drive, first, tests, chunk=chunk, threads=self._threads, pool=self.pool)

    def __enter__(self) -> _Harvest:
        return self

    def __exit__(self, *_: object) -> None:
        self.pool.shutdown(cancel_futures=True)


def harvest_tests(
    run: Experiment, seed: int, first: int, tests: int, threads: int
) -> Generator[tuple[int, Harvested], None, None]:
    """Drive tests in a thread pool and yield (tests done, cases of a range of tests), in test order; nothing is stored.

    Results do not depend on `threads`.
    """
    with _Harvest(run, seed, threads) as harvest, contextlib.closing(harvest.chunks(first, tests)) as chunks:
        for harvested in chunks:
            yield harvested.first - first + harvested.outcomes.code.size, harvested


class _Filler:
    """Writer of a library: it cuts cases into shards, has the pool pack them, and commits them in order.

    Shards are cut by the number of cases only, so the files do not depend on the clock. A shard that is saved by the
    clock before it is full gets its missing cases later.

    Args:
        library, harvest: Where cases go, and where they come from.
        tally: Sums to which the taken tests are added.
    """

    def __init__(self, library: CaseLibrary, harvest: _Harvest, tally: Tally | None = None) -> None:
        self._library = library
        self._tally = tally
        self._harvest = harvest
        self._cases: list[pa.Table] = []
        self._tracks: list[pa.Table] = []
        self._loose = 0
        self._open = library.open_cases(_SHARD_CASES)
        self._packing: deque[tuple[Future[EncodedShard], int, int]] = deque()
        self._committed_at = time.monotonic()
        self._earlier_faults = library.next_test - library.tests
        self._faults: list[int] = []
        self.crashes = library.crashes
        """Crashes taken so far, committed or not."""

    def _tests_below(self, next_test: int) -> int:
        """Count the valid tests below `next_test`; a test that a foreign AV spoiled is done but does not count."""
        return next_test - self._earlier_faults - sum(test < next_test for test in self._faults)

    def take(self, harvested: Harvested, most: int | None) -> int:
        """Take the cases of a range of tests, `most` at most; return the first test that is not done."""
        if self._tally is not None:
            self._tally.add(harvested.outcomes, harvested.counts)
        self._faults += [harvested.first + int(k) for k in np.flatnonzero(harvested.outcomes.code == outcome.AV_FAULT)]
        tests = harvested.tests if most is None else harvested.tests[:most]
        done = 0
        while done < tests.size:
            part = min(tests.size - done, _SHARD_CASES - self._open - self._loose)
            self._cases.append(harvested.cases.slice(done, part))
            self._tracks.append(harvested.tracks.slice(done, part))
            self._loose += part
            self.crashes += part
            done += part
            if self._open + self._loose == _SHARD_CASES:
                full = int(tests[done - 1]) + 1
                if self._open:
                    self._save(full)
                else:
                    self._pack(full)
        self._commit_packed(wait_beyond=_MAX_PACKING)
        if most is not None and tests.size == most:
            return int(tests[-1]) + 1
        return harvested.first + harvested.outcomes.code.size

    def _pack(self, next_test: int) -> None:
        cases, tracks = pa.concat_tables(self._cases), pa.concat_tables(self._tracks)
        future = self._harvest.pool.submit(encode_tables, cases, tracks)
        self._packing.append((future, next_test, self.crashes))
        self._cases, self._tracks, self._loose = [], [], 0

    def _save(self, next_test: int) -> None:
        """Add the cases that are in no shard yet to the library's last shard, or begin a shard with them."""
        self._commit_packed(wait_beyond=0)
        cases, tracks = pa.concat_tables(self._cases), pa.concat_tables(self._tracks)
        self._library.fill(
            cases, tracks, next_test=next_test, tests=self._tests_below(next_test), crashes=self.crashes,
            shard_cases=_SHARD_CASES,
        )  # fmt: skip
        self._open = (self._open + self._loose) % _SHARD_CASES
        self._cases, self._tracks, self._loose = [], [], 0

    def _commit_packed(self, *, wait_beyond: int) -> None:
        """Commit packed shards in order; wait while more than `wait_beyond` shards are being packed."""
        while self._packing and (self._packing[0][0].done() or len(self._packing) > wait_beyond):
            future, next_test, crashes = self._packing[0]
            shard = future.result()
            tests = self._tests_below(next_test)
            self._library.append_shard(shard, next_test=next_test, tests=tests, crashes=crashes)
            self._packing.popleft()
            self._committed_at = time.monotonic()

    def commit(self, next_test: int) -> None:
        """Store all taken cases; all tests below `next_test` are done."""
        if self._loose:
            self._save(next_test)
        self._commit_packed(wait_beyond=0)
        if next_test != self._library.next_test:
            tests = self._tests_below(next_test)
            self._library.append_shard(None, next_test=next_test, tests=tests, crashes=self.crashes)
        self._committed_at = time.monotonic()

    def commit_if_due(self, next_test: int) -> None:
        """Store the taken cases if the last commit is long ago: with rare crashes or a slow AV a shard fills slowly."""
        if time.monotonic() - self._committed_at >= _COMMIT_SECONDS:
            self.commit(next_test)

    def rescue(self) -> None:
        """Store the taken cases when the work is interrupted."""
        # After an interrupt within a commit the library is ahead of this object and refuses a second write; the cases
        # are stored then.
        with contextlib.suppress(CornerForgeError):
            if self._loose:
                self.commit(int(self._cases[-1].column("test")[-1].as_py()) + 1)
            else:
                self._commit_packed(wait_beyond=0)


def fill_library(
    run: Experiment,
    out: Path,
    *,
    seed: int,
    cases: int | None = None,
    tests: int | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress: Progress = NO_PROGRESS,
    stage: str = "generate",
    counting: bool = False,
    tally: Tally | None = None,
    tally_from: int = 0,
) -> Filled:
    """Drive tests 0, 1, 2, ... of a seed and store every AV crash until there are enough cases or tests.

    Args:
        run: The experiment.
        out: The library's folder.
        seed: Seed of the tests.
        cases: Stop at this many stored cases; the test of the last case is the last counted.
        tests: Stop after this many tests.
        threads, progress, stage: As for `simulate`.
        resume: Go on where an earlier call, or its kill, stopped.
        counting: Fill the histograms of `tally` too.
        tally: Sums of the tests `tally_from` .. `tests` - 1 are added to it.
        tally_from: See `tally`.

    Raises:
        CornerForgeError: The place cannot be used, or crashes are so rare that `cases` is out of reach.
    """
    n_threads = run.processes(threads)
    _harvester(run, []).warm_up()
    start = time.perf_counter()
    library = _open_library(run, out, seed, resume=resume)
    run.keep_printed(out / AV_LOG)
    if tally is not None:
        # The library keeps only the crashes of tests that are done, so their sums need another drive.
        earlier = max(0, min(library.next_test, tests or 0) - tally_from)
        for first, outcomes, counts in runner.simulate_chunks(
            run.setting, run.slots, seed=seed, first=tally_from, tests=earlier, threads=n_threads, counting=counting,
            chunk=run.range_size(CHUNK, earlier, threads), drive=run.drive,
        ):  # fmt: skip
            tally.add(outcomes, counts)
            progress("count again", first - tally_from + outcomes.code.size, earlier)
    with _Harvest(run, seed, n_threads, counting=counting) as harvest:
        filler = _Filler(library, harvest, tally)
        try:
            _fill(harvest, filler, library.next_test, cases, tests, progress, stage)
        except (KeyboardInterrupt, AvFaultError):
            filler.rescue()
            if library.next_test == 0:
                _release(out)
            raise
        except (InputError, UndrawableError):
            if len(library) == 0:
                _release(out)
            raise
    run.check_not_all_spoiled(library.tests, library.next_test)
    library.finish()
    seconds = time.perf_counter() - start
    write_json(out / "provenance.json", provenance(library.identity, round(seconds, 3)))
    return library_summary(library, seconds)


def _release(out: Path) -> None:
    """Remove what was begun in a library's folder, so that the corrected command finds it free; an AV's log stays."""
    for entry in out.iterdir():
        if not is_lock(entry.name) and entry.name != AV_LOG:
            entry.unlink()


def _fill(
    harvest: _Harvest, filler: _Filler, first: int, cases: int | None, tests: int | None, progress: Progress, stage: str
) -> None:
    """Drive from test `first` on until there are enough cases or tests, and commit everything."""
    if cases is not None and filler.crashes >= cases:
        return
    last = tests if tests is not None else _MAX_TESTS_PER_CASE * (cases or 1)
    next_test = first

    def done() -> tuple[int, int]:
        return (next_test, last) if cases is None else (filler.crashes, cases)

    each = 1.0 / answers_per_test(harvest.run.setting)  # in cases, as if half of the tests were one, until some are
    with (
        moving(progress, harvest.run.answered(), each if cases is None else each / 2.0, stage, *done()) as told,
        contextlib.closing(harvest.chunks(first, max(0, last - first))) as chunks,
    ):
        for harvested in chunks:
            next_test = filler.take(harvested, None if cases is None else cases - filler.crashes)
            told(stage, *done())
            if filler.crashes == cases:
                break
            filler.commit_if_due(next_test)
            if cases is not None and filler.crashes == 0 and next_test >= _MAX_TESTS_PER_CASE:
                break
    filler.commit(next_test)
    if cases is not None and filler.crashes < cases:
        raise InputError(
            f"{filler.crashes} of {cases} cases after {next_test} tests: this adversary is too weak. Train it longer, "
            "or store what there is with: cornerforge simulate --bv POLICY --out LIB"
        )


def library_summary(library: CaseLibrary, seconds: float) -> Filled:
    """Make the result of `generate`: cases, and crashes per test over all tests that were driven."""
    return Filled(
        **vars(cases_made(library)),
        av_faults=library.next_test - library.tests,
        seconds=round(seconds, 3),
        library=str(library.path),
    )


def cases_made(library: CaseLibrary) -> CasesMade:
    """Give the cases of a library that says how many tests there were, and how often these crashed."""
    return CasesMade(
        cases=len(library),
        tests=library.tests,
        av_crashes=library.crashes,
        crashes_per_test=library.crashes / library.tests,
        interval95=binomial_interval(library.crashes, library.tests),
    )


def store_tests(
    run: Experiment, out: Path, *, tests: int, seed: int, threads: int | None, counting: bool, resume: bool,
    progress: Progress,
) -> Simulated:  # fmt: skip
    """Drive each test once, count it and store its crash, for `simulate --out`."""
    tally = Tally()
    filled = fill_library(
        run, out, seed=seed, tests=tests, threads=threads, resume=resume, progress=progress, stage="store",
        counting=counting, tally=tally,
    )  # fmt: skip
    counted = tally_summary(tally, filled.seconds, with_distributions=counting)
    return replace(counted, cases=filled.cases, library=str(out))
