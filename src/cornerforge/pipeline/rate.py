"""`rate` measures the AV's natural crash rate with its interval; it keeps every finished block of tests or trees.

The output folder holds `counts.json` (whole blocks only, replaced after each), `library/` and `rate.json`. The counts
are written first: a kill at any moment loses only the block in progress. By counting, the library holds all crashes,
and a resumed run drives again those that it lacks; for trees see `splitting`.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Unpack

from cornerforge._checks import check_in, check_integer, check_number
from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.analysis.mechanism import MECHANISMS
from cornerforge.errors import CornerForgeError, InputError
from cornerforge.library import CaseLibrary, CaseRecord, case_record
from cornerforge.ndd.model import save_model
from cornerforge.pipeline.counting import rate_summary
from cornerforge.pipeline.crashes import NaturalCrashes, crash_tables
from cornerforge.pipeline.generate import MODEL_FILE
from cornerforge.pipeline.output import code_hash, open_output, provenance, read_json_file, version, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import Experiment, check_threads, experiment
from cornerforge.pipeline.splitting import TREES, PickedCrash, Splitting, kind_rates
from cornerforge.rates import binomial_interval, poisson_interval
from cornerforge.rates.exposure import SAMPLE_TESTS, BvTravel, bv_travel
from cornerforge.rates.monte_carlo import BLOCK, MonteCarlo, drive_block, relative_half_width
from cornerforge.rates.weighted import always_valid_half_width
from cornerforge.results import NaturalRate, as_json
from cornerforge.results.driving import BvMilesEstimate, Cost, Effort, KindRate
from cornerforge.world_options import AvKeywords, WorldOptions

__all__ = ["rate"]

_BLOCK = BLOCK
_SHARD_CASES = 500
_STORE_SECONDS = 600.0
"""Time between two updates of the library and `rate.json` [s]; each writes a shard, so not every block does."""
_COLUMNS = ("test", "crash_type", "mechanism", "at_start", "rare_action", "overlooked", "looked_away")
_ENOUGH_TO_FORESEE = 10
PLAIN_TESTS = 4 * BLOCK
"""Plain tests that trees begin with: kinds of crash that a network does not know show there, if they are frequent."""
_TREES_TAKE_S = 300.0
_ASKED = "asked for"
_Z95 = 1.959963984540054


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

    def __init__(self, run: Experiment, seed: int, out: Path | None, *, threads: int, progress: Progress) -> None:
        self._run, self._seed, self.out = run, seed, out
        self.reason = _ASKED
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
        if width is not None and self.counts.av_crashes >= _ENOUGH_TO_FORESEE:
            total = min(max_tests, round(self.counts.tests * (width / target) ** 2))
        now = self.counts.tests + done
        self._progress(f"rate ({self.counts.av_crashes + crashes} crashes)", now, max(total, now))

    def store(self, state: str) -> NaturalRate:
        """Bring library and `rate.json` up to the counts; return the summary. `state` says why it is done now."""
        self._save()  # An interrupt may come after the last block was counted and before it was saved.
        # No progress bar before the end: a long run would leave hundreds of bars.
        keeper = self._keeper = self._keeper or _Keeper(self._run, self._seed, self.out)
        keeper.catch_up(self.counts, NO_PROGRESS if state == "running" else self._progress)
        if state not in ("running", "interrupted"):
            keeper.finish()
        counted = _counted(self.counts, keeper.tables(self.counts.tests), self.reason)
        summary = NaturalRate(**{**self.plain_part(), **counted, "state": state})
        if self.out is not None:
            write_json(self.out / "rate.json", as_json(summary))
        return summary

    def plain_part(self) -> dict[str, Any]:
        """Make the fields of `NaturalRate` that come from plain tests, whatever the method."""
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
        return _plain_part(self._run, self.counts, self._travel)

    def kinds(self) -> dict[str, int]:
        """Count the crashes so far by mechanism."""
        crashes = NaturalCrashes(self._run, self._seed)
        return dict(Counter(crashes.record(test)[1].mechanism for test in self.counts.crashed))


def rate(
    *,
    method: str = "auto",
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
        method: "mc", plain Monte Carlo; "splitting", trees of tests (`sim.trees`), for rates below 1e-5; "auto" begins
            with plain tests and goes on with trees if those would take longer.
        target_rhw: Stop when half the 95 % interval is at most this share of the rate, 0.001 to 10. The interval is
            exact for "mc", and holds however often one looks for "splitting", which moreover stops only without doubts.
        max_tests: Largest number of tests; trees, those of teaching too, count as one each.
        out: Folder for `rate.json`, the counts so far, and `library/` with crashes; None keeps nothing.
        resume: Go on with that folder, after an end, an interrupt or a kill.
        seed: 0 or more.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.
        world: The world, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge rate --json` prints: the rate, its precision and cost, and what kinds of crash there were.
        With `doubts` it cannot be trusted yet.

    Raises:
        CornerForgeError: Input, files or output place are not right.
        KeyboardInterrupt: Interrupted; with `out`, all finished blocks are kept.
    """
    check_in("method", method, ("auto", "mc", "splitting"))
    check_integer("seed", seed, low=0, high=2**63 - 1)
    check_integer("max_tests", max_tests, low=1, high=10**12)
    check_number("target_rhw", target_rhw, low=1e-3, high=10.0)
    if resume and out is None:
        raise InputError("There is nothing to resume without out; name the folder: --out FOLDER --resume")
    run = experiment(WorldOptions(**world), takes_foreign=True, seed=seed)
    only_mc = _why_only_counting(run, max_tests)
    if method == "splitting" and only_mc is not None:
        raise InputError(f"Method splitting cannot be used: {only_mc}")
    folder = None if out is None else Path(out)
    session = _Session(run, seed, folder, threads=check_threads(threads), progress=progress)
    identity = {**run.identity(seed), "method": method, "cornerforge": version(), "code": code_hash()}
    session.start(identity, resume=resume)
    if method == "mc" or only_mc is not None:
        session.reason = _ASKED if method == "mc" else only_mc or ""
        summary = _count(session, target_rhw, max_tests)
    else:
        with _kept_if_interrupted(session):
            state = session.drive(target_rhw, PLAIN_TESTS)
        wanted = "plain tests are enough" if state == "target" else _why_counting(session.counts, target_rhw)
        if method == "auto" and wanted is not None:
            session.reason = wanted
            summary = _count(session, target_rhw, max_tests)
        else:
            reason = _ASKED if method == "splitting" else _why_trees(session.counts)
            split = Splitting(run, seed, folder, threads=check_threads(threads), progress=progress)
            summary = _split(session, split, reason, target_rhw, max_tests)
            if folder is not None:
                write_json(folder / "rate.json", as_json(summary))
    if folder is not None:
        write_json(folder / "provenance.json", provenance(identity, summary.seconds))
    return summary


# Choosing


def _why_only_counting(run: Experiment, max_tests: int) -> str | None:
    """Say why only counting is possible; None if trees are."""
    if run.foreign is not None:
        return f"the AV {run.av.name} is outside the simulator, and trees need copies of worlds."
    if importlib.util.find_spec("torch") is None:
        return 'teaching needs torch; install it with: pip install "cornerforge[learn]"'
    from cornerforge.rates.teaching import TEACHING_TREES

    least = PLAIN_TESTS + TEACHING_TREES + TREES
    if max_tests < least:
        return f"--max-tests is below {least:,}, too few to learn what is dangerous."
    return None


def _why_counting(counts: MonteCarlo, target: float) -> str | None:
    """Say why counting is the faster way; None if trees are, or if it is not known."""
    width = counts.half_width()
    if counts.av_crashes < _ENOUGH_TO_FORESEE or width is None:
        return None
    seconds = counts.cpu_seconds * (width / target) ** 2
    if seconds > _TREES_TAKE_S:
        return None
    return f"plain tests will take about {seconds:.0f} s of CPU time, trees {_TREES_TAKE_S:.0f} s or more"


def _why_trees(counts: MonteCarlo) -> str:
    return f"{counts.valid_tests:,} plain tests had {counts.av_crashes} crashes, so counting would take longer"


# Both ways


@contextlib.contextmanager
def _kept_if_interrupted(session: _Session) -> Iterator[None]:
    """Count; interrupted, bring library and `rate.json` up to the whole blocks first."""
    try:
        yield
    except KeyboardInterrupt:
        if session.out is not None and session.counts.tests:
            # After an interrupt within a commit the library refuses a second write; the crash is stored then.
            with contextlib.suppress(CornerForgeError):
                session.store("interrupted")
        raise


def _count(session: _Session, target: float, max_tests: int) -> NaturalRate:
    """Count to the end."""
    with _kept_if_interrupted(session):
        return session.store(session.drive(target, max_tests))


def _split(session: _Session, split: Splitting, reason: str, target: float, max_tests: int) -> NaturalRate:
    """Find the rate by trees of tests."""
    plain = session.counts
    split.start()
    most = max(TREES, max_tests - plain.tests - split.taught.tests)
    state = split.drive(target, most)
    found = split.rate
    picked = split.picked() if found.rate > 0.0 else []
    types = kind_rates(picked, "crash_type", found) if picked else {}
    mechanisms = kind_rates(picked, "mechanism", found) if picked else {}
    doubts = split.doubts(plain, session.kinds(), mechanisms)
    if not picked:
        doubts, state = ("no crash was found, so the interval is that of the plain tests",), "no crash"
    radius = always_valid_half_width(found) if picked else math.nan
    interval = (max(0.0, found.rate - radius), found.rate + radius)
    if not picked:
        interval = binomial_interval(plain.av_crashes, plain.valid_tests)
    per_test = plain.miles / plain.valid_tests
    cost = plain.cpu_seconds + split.taught.cpu_seconds + split.cost.cpu_seconds
    counted_s = 0.0
    if picked:  # relative half-width z/sqrt(crashes)
        counted_s = (_Z95 / found.half_width) ** 2 / found.rate * plain.cpu_seconds / plain.valid_tests
    own = {
        "method": "splitting",
        "reason": reason,
        "tests": found.n,
        "crashes_per_test": found.rate,
        "interval95": interval,
        "crashes_per_mile": found.rate / per_test if per_test > 0.0 else None,
        "interval95_per_mile": (interval[0] / per_test, interval[1] / per_test) if per_test > 0.0 else None,
        "relative_half_width": split.half_width if picked else None,
        "relative_half_width_90": found.half_width_90 if picked else None,
        "doubts": doubts,
        "effort": Effort(plain=_cost_of(plain), teaching=split.taught, estimation=split.cost),
        "av_crashes": split.crashes,
        "effective_sample_size": round(found.effective),
        "largest_share": found.largest if picked else None,
        "halves": found.halves,
        "tail_index": found.tail if found.tail is None or math.isfinite(found.tail) else None,
        "acceleration": counted_s / cost,
        "seconds": round(plain.seconds + split.seconds, 3),
        "cpu_seconds": round(cost, 3),
        "tests_per_second": round(found.n / split.seconds, 1),
        "digest": split.digest,
        "state": state,
        **_kind_counts(picked),
        "crash_type_rates": types,
        "mechanism_rates": mechanisms,
        "crash_circumstances": None,
    }
    return NaturalRate(**{**session.plain_part(), **own})


def _kind_counts(picked: list[PickedCrash]) -> dict[str, Any]:
    types, mechanisms = Counter(crash.crash_type for crash in picked), Counter(crash.mechanism for crash in picked)
    return {
        "crash_types": {name: types[name] for name in CRASH_TYPES.values()},
        "mechanisms": {name: mechanisms[name] for name in MECHANISMS},
    }


def _cost_of(counts: MonteCarlo) -> Cost:
    return Cost(tests=counts.tests, cpu_seconds=round(counts.cpu_seconds, 3))


def _counted(counts: MonteCarlo, tables: dict[str, Any], reason: str) -> dict[str, Any]:
    """Make the fields of `NaturalRate` that counting gives."""
    nothing = Cost(tests=0, cpu_seconds=0.0)
    low, high = binomial_interval(counts.av_crashes, counts.valid_tests, 0.9)
    return {
        "method": "mc",
        "reason": reason,
        "relative_half_width": counts.half_width(),
        "relative_half_width_90": relative_half_width(low, high, counts.av_crashes / counts.valid_tests),
        "doubts": (),
        "effort": Effort(plain=_cost_of(counts), teaching=nothing, estimation=nothing),
        "av_crashes": counts.av_crashes,
        "effective_sample_size": counts.valid_tests,
        "largest_share": None,
        "halves": None,
        "tail_index": None,
        "acceleration": 1.0,
        "seconds": round(counts.seconds, 3),
        "cpu_seconds": round(counts.cpu_seconds, 3),
        "tests_per_second": round(counts.tests / counts.seconds, 1) if counts.seconds else None,
        "digest": counts.digest,
        "crash_type_rates": _counted_kinds(tables["crash_types"], counts.valid_tests),
        "mechanism_rates": _counted_kinds(tables["mechanisms"], counts.valid_tests),
        **tables,
    }


def _counted_kinds(kinds: dict[str, int], tests: int) -> dict[str, KindRate]:
    return {
        name: KindRate(crashes=n, crashes_per_test=n / tests, interval95=binomial_interval(n, tests))
        for name, n in kinds.items()
        if n
    }


def _plain_part(run: Experiment, counts: MonteCarlo, travel: BvTravel) -> dict[str, Any]:
    """Make the fields of `NaturalRate` that come from plain tests, whatever the method."""
    bv_miles = travel.miles_per_test * counts.valid_tests
    low, high = poisson_interval(counts.bv_crashes)
    return {
        "av": run.av.name,
        "odd": run.odd.name,
        "lanes": run.odd.n_lanes,
        **vars(rate_summary(counts.av_crashes, counts.valid_tests, counts.miles)),
        "plain_tests": counts.valid_tests,
        "av_faults": counts.av_faults,
        "bv_crashes": counts.bv_crashes,
        "bv_crashes_per_test": counts.bv_crashes / counts.valid_tests,
        "bv_crashes_per_bv_mile": None if bv_miles == 0.0 else counts.bv_crashes / bv_miles,
        "interval95_bv_crashes_per_bv_mile": None if bv_miles == 0.0 else (low / bv_miles, high / bv_miles),
        "bv_miles": bv_miles,
        "bv_miles_estimate": BvMilesEstimate(tests=travel.tests, relative_error=travel.relative_error),
    }
