"""`retest` drives another AV through the cases of a library, and compares: fixed, still crashing, new (ADR 40)."""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge._options import verb
from cornerforge.errors import AvFaultError, InputError
from cornerforge.experiment.experiments import Experiment, check_threads
from cornerforge.experiment.forecast import forecast
from cornerforge.experiment.output import check_new_file, config_hash, provenance
from cornerforge.experiment.setting import RECORDED_AV
from cornerforge.foreign.spec import with_av
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import CaseFile
from cornerforge.rates.paired import difference_interval, sequential_verdict
from cornerforge.report.comparison import Pair, check_page, write_comparison
from cornerforge.results.retest import Compared, Difference, Retested, RetestedCase
from cornerforge.sim import controllers, outcome, runner
from cornerforge.verbs.cases import SEVERAL
from cornerforge.verbs.drive_case import CaseDriver, driven_with, strikes
from cornerforge.verbs.options.cases import Retest
from cornerforge.verbs.retest_case_files import (
    FILES_RULE,
    file_says,
    holds_case_files,
    pairs_of_files,
    read_case_files,
)
from cornerforge.verbs.retest_files import write_junit
from cornerforge.verbs.retest_pairs import RULE, Driven, pairs_of
from cornerforge.verbs.stored_cases import drive_as_recorded, run_with
from cornerforge.work.progress import NO_PROGRESS, Progress
from cornerforge.world_options import WorldOptions

__all__ = ["retest"]

_BLOCK = 2_048
"""Natural tests between two looks at the verdict."""
FIXED, STILL, NEW, NEVER, FAILED = "fixed", "still crashing", "new", "never", "failed"
ROUNDED = "rounded"
"""What became of a test. ROUNDED: the crash of the same AV does not come again (ADR 40). FAILED: an AV from outside
raised, hung or gave no usable answer, so nothing is known."""
_NO, _YES, _UNKNOWN = 0, 1, -1
"""Did an AV crash in a test?"""


@verb(Retest)
def retest(options: Retest) -> Retested:
    """Drive another AV through the cases of a library, and say what it crashes in that the old one did not.

    The cases are driven twice. *As recorded*: every other vehicle that was stored does what it did, whatever the AV
    does. *Reacting*: the tests of the library are driven anew with the same random numbers, so the others see the new
    AV; this covers all tests of the library, not only those that became cases.

    Returns:
        What `cornerforge retest --json` prints. `got_worse` is True if a sequential test says that it crashes more
        often (`rates.paired`), or if in a case file it has a new crash or fails.

    Raises:
        CornerForgeError: The library, an AV or a file cannot be read or written, or an AV fails too often.
    """
    began = time.perf_counter()
    files = [Path(file) for file in (options.junit, options.page) if file is not None]
    for index, file in enumerate(files):
        if file.absolute() in [other.absolute() for other in files[:index]]:
            raise InputError(f"{file} is named for two files; give each its own name.")
        check_new_file(file)
    if options.page is not None:
        check_page()
    place = Path(options.library)
    is_of_files = holds_case_files(place)
    world = options.world()
    natural_tests = _natural_tests(place if is_of_files else None, world.av, options.baseline, options.natural_tests)
    if options.baseline is not None and options.baseline == world.av:
        raise InputError(
            f"{options.baseline} is both the AV and the baseline, so there is nothing to compare; name another."
        )
    n_threads = check_threads(options.threads)
    pairs: Callable[[], Sequence[Pair]]
    if is_of_files:
        result, found = _retest_files(
            place, world, options.baseline, options.count, options.page is not None, options.progress
        )
        pairs = lambda: found  # noqa: E731
        rule, identity = FILES_RULE, {"cases": str(options.library), "av": world.av, "seed": options.seed}
    elif options.count != "any":
        raise InputError(f"count = {options.count!r} is for case files; {place} is a library. Leave it out.")
    else:
        cases = _opened(place, options.baseline)
        new = run_with(cases, world, world.av)
        old = None if options.baseline is None else run_with(cases, world, options.baseline)
        result, pairs = _retest_library(cases, new, old, natural_tests, options.seed, n_threads, options.progress)
        rule, identity = RULE, {"library": config_hash(cases.identity), **new.identity(options.seed)}
    took = round(time.perf_counter() - began, 3)
    result = replace(
        result, library=str(options.library), av=world.av, baseline=options.baseline or result.baseline, seconds=took
    )
    if options.junit is not None:
        write_junit(Path(options.junit), result)
    if options.page is not None:
        write_comparison(Path(options.page), result, pairs(), rule, provenance(identity, took))
    return result


def _retest_library(
    cases: CaseLibrary, new: Experiment, old: Experiment | None, natural_tests: int, seed: int, threads: int,
    progress: Progress,
) -> tuple[Retested, Callable[[], Sequence[Pair]]]:  # fmt: skip
    """Drive the cases and the tests of a library, and natural tests.

    Returns:
        What came of it, without the name of its place and the time; what records the pairs for a page.
    """
    tests = natural_tests + (0 if cases.scripted else cases.next_test)
    for run in (new, old):
        if run is not None:
            forecast(run, threads, f"{len(cases):,} cases and {tests:,} tests", tests=tests)
    recorded = _as_recorded(cases, new, old, threads, progress)
    reacting = None if cases.scripted else _reacting(cases, new, old, threads, progress)
    natural = None if old is None or not natural_tests else _natural(new, old, seed, natural_tests, threads, progress)
    of_cases = recorded.compared()
    of_tests, of_natural = (None if part is None else part.compared() for part in (reacting, natural))
    result = Retested(
        **{one.name: getattr(of_tests or of_cases, one.name) for one in fields(Difference)},
        library="",
        av=new.av.name,
        baseline=str(cases.identity["av"]) if old is None else old.av.name,
        cases=len(cases),
        same_av=_is_same(cases, new, old),
        got_worse=any(part is not None and part.verdict == "worse" for part in (of_tests, of_natural)),
        note=_note(cases),
        recorded=of_cases,
        reacting=of_tests,
        natural=of_natural,
        each=_each(cases, recorded, reacting),
        seconds=0.0,
    )

    def pairs() -> Sequence[Pair]:
        return pairs_of(
            cases,
            Driven(recorded.by_case(cases.scalars(["case_id"])["case_id"].to_pylist()), new, old),
            None if reacting is None else Driven(reacting.by_test(int(str(cases.identity["seed"]))), new, old),
            None if natural is None or old is None else Driven(natural.by_test(seed), _naturally(new), _naturally(old)),
            progress,
        )

    return result, pairs


def _natural_tests(files: Path | None, av: str, baseline: str | None, wanted: int | None) -> int:
    """Return how many natural tests both drive.

    Args:
        files: Where case files are; None: it is a library.
        av, baseline, wanted: As the user named them.

    Raises:
        InputError: There can be none, but some are wanted.
    """
    why = None
    if files is not None:
        why = f"{files} holds case files, which tell of no traffic to draw natural tests from; leave them out."
    elif RECORDED_AV in (av, baseline):
        why = f"{RECORDED_AV} drives in its cases only, so there are no natural tests of it; leave them out."
    elif baseline is None:
        why = "Natural rates need both AVs; name the old one with --baseline."
    if wanted is None:
        return 10_000 if why is None else 0
    if check_integer("natural_tests", wanted, low=0, high=10**9) and why is not None:
        raise InputError(why)
    return wanted


def _retest_files(
    place: Path, options: WorldOptions, baseline: str | None, count: str, with_pairs: bool, progress: Progress
) -> tuple[Retested, list[Pair]]:
    """Drive the AV, and the baseline if there is one, through case files; record pairs for the page if wanted."""
    files, note = read_case_files(place)
    options_of_old = None if baseline is None else with_av(options, baseline)
    models = [place if place.is_dir() else place.parent]
    with contextlib.ExitStack() as stack:
        new = stack.enter_context(CaseDriver(options, models))
        old = None if options_of_old is None else stack.enter_context(CaseDriver(options_of_old, models))
        ends = _in_files(new, files, progress, "case files")
        crashed = np.array([end.crashed(count) for end in ends], np.int64)
        if old is None:
            was = np.array([_YES if file_says(name, case, count) else _NO for name, case in files.items()], np.int64)
        else:
            before = _in_files(old, files, progress, "case files, baseline")
            was = np.array([end.crashed(count) for end in before], np.int64)
        both = _Both(crashed, was, picked=True)
        kinds = both.by_case(list(files))
        pairs = pairs_of_files(files, kinds, new, old, options, models) if with_pairs else []
    compared = both.compared(may_be_none=True)
    makers = sorted({case.av or "not known" for case in files.values()})
    result = Retested(
        **{one.name: getattr(compared, one.name) for one in fields(Difference)},
        library=str(place),
        av=options.av,
        baseline=baseline or (makers[0] if len(makers) == 1 else SEVERAL),
        cases=len(files),
        same_av=False,
        got_worse=compared.new_crashes > 0 or bool((crashed == _UNKNOWN).any()),
        note=note,
        recorded=compared,
        reacting=None,
        natural=None,
        each=tuple(
            RetestedCase(
                case=case, recorded=kind, reacting=None, striker=end.striker, words=end.words, failure=end.failure
            )
            for (case, kind), end in zip(kinds.items(), ends, strict=True)
        ),
        seconds=0.0,
    )
    return result, pairs


@dataclass(frozen=True)
class _End:
    """How a case file ended.

    Attributes:
        striker, words, failure: As in `RetestedCase`.
    """

    striker: str | None
    words: str | None
    failure: str | None

    def crashed(self, count: str) -> int:
        """Is there a crash that counts?"""
        return _UNKNOWN if self.failure is not None else _YES if strikes(self.striker, count) else _NO


def _in_files(driver: CaseDriver, files: Mapping[str, CaseFile], progress: Progress, what: str) -> list[_End]:
    """Drive case files, and say how each ends."""
    found = []
    for done, case in enumerate(files.values()):
        driver.run(case)  # an AV that cannot be had is no failure in a case
        try:
            driven = driven_with(driver, case, "")
            found.append(_End(driven.striker, driven.words, None))
        except AvFaultError as error:
            found.append(_End(None, None, str(error).removeprefix(f"Case {case.name}: ")))
        progress(what, done + 1, len(files))
    return found


def _opened(library: Path, baseline: str | None) -> CaseLibrary:
    """Open the library.

    Raises:
        CornerForgeError: It cannot be read, holds no case, or does not tell where the old AV crashed.
    """
    cases = CaseLibrary.open(library)
    if len(cases) == 0:
        raise InputError(f"The library {library} holds no cases yet, so there is none to drive again.")
    if baseline is None and cases.identity.get("av") == SEVERAL:
        raise InputError(
            f"The cases of {library} were made by several AVs, so there is no old one to compare with; name one: "
            "--baseline OLD"
        )
    if baseline is None and not cases.scripted and cases.crashes != len(cases):
        raise InputError(
            f"The library {library} holds {len(cases):,} of {cases.crashes:,} crashes, so it does not tell in which "
            f"tests its AV crashed; say what to compare with: --baseline {shlex.quote(str(cases.identity['av']))}"
        )
    return cases


def _note(cases: CaseLibrary) -> str | None:
    """Say what the traffic does to the comparison; None: nothing."""
    if cases.identity.get("bv") != "policy":
        return None
    return (
        "An adversary that learned makes its own AV crash more often than others, as a rule; where that is the "
        'baseline, "less often" says little. Compare with --baseline in natural tests, or with an adversary of each.'
    )


def _each(cases: CaseLibrary, recorded: _Both, reacting: _Both | None) -> tuple[RetestedCase, ...]:
    """Say case by case what became of it."""
    ids = cases.scalars(["case_id", "test"])
    now = None if reacting is None else reacting.kinds()
    return tuple(
        RetestedCase(
            case=case,
            recorded=kind,
            reacting=None if now is None else now[test],
            striker=None,
            words=None,
            failure=None,
        )
        for case, test, kind in zip(ids["case_id"].to_pylist(), ids["test"].to_pylist(), recorded.kinds(), strict=True)
    )


class _Both:
    """The same tests for both AVs.

    Attributes:
        new, old: Did each crash: _NO, _YES or _UNKNOWN, (N,).
        picked: The tests were picked because an AV crashed in them.
        same: Both are the same AV, so that a crash that does not come again is rounding.
    """

    def __init__(
        self, new: NDArray[np.int64], old: NDArray[np.int64], *, picked: bool = False, same: bool = False
    ) -> None:
        self._known = (new != _UNKNOWN) & (old != _UNKNOWN)
        self._new, self._old, self._picked, self._same = new == _YES, old == _YES, picked, same

    def kinds(self) -> list[str]:
        """Say what became of each."""
        rows = zip(self._known.tolist(), self._new.tolist(), self._old.tolist(), strict=True)
        gone = ROUNDED if self._same else FIXED
        return [
            FAILED if not known else (STILL if was else NEW) if crashes else (gone if was else NEVER)
            for known, crashes, was in rows
        ]

    def by_case(self, ids: Sequence[str]) -> dict[str, str]:
        """Say what became of each, by case id."""
        return dict(zip(ids, self.kinds(), strict=True))

    def by_test(self, seed: int) -> dict[str, str]:
        """Say what became of each, by the case id that a test of its number has."""
        return {f"{seed}:{test}": kind for test, kind in enumerate(self.kinds())}

    def compared(self, *, may_be_none: bool = False) -> Compared:
        """Sum up.

        Args:
            may_be_none: There may be no test in which no AV failed.

        Raises:
            AvFaultError: An AV failed in all of them.
        """
        new, old = self._new[self._known], self._old[self._known]
        if new.size == 0 and not may_be_none:
            raise AvFaultError(f"An AV failed in all of {self._known.size:,} tests, so there is nothing to compare.")
        new_only, old_only = int((new & ~old).sum()), int((old & ~new).sum())
        verdict = sequential_verdict(new, old)
        return Compared(
            tests=new.size,
            left_out=int((~self._known).sum()),
            baseline_crashes=int(old.sum()),
            av_crashes=int(new.sum()),
            fixed=0 if self._same else old_only,
            rounded=old_only if self._same else 0,
            still_crashing=int((new & old).sum()),
            new_crashes=new_only,
            rate_difference=None if self._picked else (new_only - old_only) / new.size,
            interval95=None if self._picked else difference_interval(new_only, old_only, new.size),
            verdict=None if self._picked else verdict.word,
            verdict_after=None if self._picked else verdict.tests,
        )


def _as_recorded(
    cases: CaseLibrary, new: Experiment, old: Experiment | None, threads: int, progress: Progress
) -> _Both:
    """Drive every case with the others as recorded; without a baseline the old AV crashed in each."""
    ids = cases.scalars(["case_id"])["case_id"].to_pylist()

    def driven(run: Experiment, what: str) -> NDArray[np.int64]:
        ends = drive_as_recorded(cases, ids, [run], threads, progress, what)
        return np.array([_UNKNOWN if end.failed else _NO if end.pose is None else _YES for (end,) in ends], np.int64)

    crashed = driven(new, "cases as recorded")
    was = np.full(len(ids), _YES) if old is None else driven(old, "cases as recorded, baseline")
    return _Both(crashed, was, picked=True, same=_is_same(cases, new, old))


def _is_same(cases: CaseLibrary, new: Experiment, old: Experiment | None) -> bool:
    """Say whether the AV is the one that made the library, and is compared with what the library says."""
    return old is None and new.av_hash == cases.identity.get("av_hash")


def _reacting(cases: CaseLibrary, new: Experiment, old: Experiment | None, threads: int, progress: Progress) -> _Both:
    """Drive all tests of the library anew; without a baseline the old AV crashed in those that became cases."""
    seed, tests = int(str(cases.identity["seed"])), cases.next_test
    crashed = _crashes(new, seed, 0, tests, threads, progress, "tests with others who react")
    if old is None:
        was = np.full(tests, _NO)
        was[cases.scalars(["test"])["test"].to_numpy()] = _YES
    else:
        was = _crashes(old, seed, 0, tests, threads, progress, "tests with others who react, baseline")
    return _Both(crashed, was)


def _natural(new: Experiment, old: Experiment, seed: int, most: int, threads: int, progress: Progress) -> _Both:
    """Drive natural tests until the verdict is clear, or there are `most`."""
    runs = [_naturally(run) for run in (new, old)]
    found: list[list[NDArray[np.int64]]] = [[], []]
    done = 0
    while done < most:
        count = min(_BLOCK, most - done)
        for run, parts in zip(runs, found, strict=True):
            parts.append(_crashes(run, seed, done, count, threads, NO_PROGRESS, ""))
        done += count
        progress("natural tests of both", done, most)
        both = _Both(np.concatenate(found[0]), np.concatenate(found[1]))
        if both.compared().verdict != "open":
            break
    return both


def _naturally(run: Experiment) -> Experiment:
    """The same AV and road, with natural drivers only."""
    setting = run.setting.with_drivers(critical=controllers.NOBODY, others=controllers.NATURALISTIC, bounded=0)
    return replace(run, bv="nde", policies=(), bounded=False, budget=None, acting="greedy", setting=setting)


def _crashes(
    run: Experiment, seed: int, first: int, tests: int, threads: int, progress: Progress, what: str
) -> NDArray[np.int64]:
    """Drive tests, and say in which the AV crashed, (tests,)."""
    crashed = np.full(tests, _NO)
    chunks = runner.simulate_chunks(
        run.setting, run.slots, seed=seed, first=first, tests=tests, threads=run.processes(threads),
        chunk=run.range_size(512, tests, threads), drive=run.drive,
    )  # fmt: skip
    done = 0
    for start, out, _ in chunks:
        part = crashed[start - first : start - first + out.code.size]
        part[out.code == outcome.AV_CRASH], part[out.code == outcome.AV_FAULT] = _YES, _UNKNOWN
        done += out.code.size
        progress(what, done, tests)
    return crashed
