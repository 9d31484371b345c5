"""`shrink` makes cases of a library as small as possible and stores them in a library of their own."""

from __future__ import annotations

import contextlib
import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from cornerforge._locks import claim_folder
from cornerforge._options import verb
from cornerforge.analysis.shrink import Shrunk
from cornerforge.analysis.shrink import shrink as shrink_script
from cornerforge.errors import CornerForgeError, InputError, ReplayError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import code_hash, config_hash, provenance, version, write_json
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.harvester import CaseRoom, Scalar
from cornerforge.library.schema import ON_RAILS, SCRIPTED
from cornerforge.ndd.model import save_model
from cornerforge.results import ShrunkLibrary
from cornerforge.results.cases import CaseMedians, CaseSize, MedianSize, ShrunkCase
from cornerforge.sim import Script, ScriptDriver
from cornerforge.types import Scenario
from cornerforge.verbs.cases import driver_of_cases, experiment_of, is_same
from cornerforge.verbs.options.cases import Shrink
from cornerforge.work.progress import Progress

__all__ = ["shrink"]

_SHARD_CASES = 100
_COMMIT_SECONDS = 20.0
_MEASURES = {
    "vehicles": ("source_n_vehicles", "n_vehicles"),
    "decisions": ("source_n_decisions", "n_decisions"),
    "seconds": ("source_crash_time_s", "crash_time_s"),
    "deviating_actions": ("source_deviating_actions", "deviating_actions"),
    "log_prob_nde": ("source_log_prob_nde", "log_prob_nde"),
}
"""Field of `CaseSize` -> the columns with its value before and after."""
_LABELS = ("crash_type", "striker", "cause")


@verb(Shrink)
def shrink(options: Shrink) -> ShrunkLibrary:
    """Make cases as small as possible: fewest vehicles, shortest window, most natural actions, the same crash.

    Where the other vehicles are on rails, as in imported cases, only vehicles and the window can become fewer.

    Returns:
        What `cornerforge shrink --json` prints: each case before and after, and medians.

    Raises:
        CornerForgeError: No such case, a case no longer replays, the place cannot be used, or the AV fails 20 times in
            a row.
    """
    began = time.perf_counter()
    source = CaseLibrary.open(Path(options.library))
    ids = _ids(source, [options.cases] if isinstance(options.cases, str) else options.cases)
    place = _place(Path(options.library), ids) if options.out is None else Path(options.out)
    claim_folder(place)
    run = experiment_of(source, options)
    if run.odd.perception is not None and run.odd.perception.is_random:
        raise InputError(
            f"What the AV of {source.path} perceives is drawn for each second and vehicle "
            f"({run.odd.perception.in_words()}): a case with fewer of them would be another one, so none is shrunk."
        )
    _check_same(source.scenario(ids[0]), driver_of_cases(run))  # a case that does not replay fails before out is made
    shrunk = _open(source, run, place, resume=options.resume)
    left = _left(shrunk, ids)
    _fill(source, run, shrunk, left, options.progress)
    rows = _rows(shrunk, ids)
    seconds = round(time.perf_counter() - began, 3)
    write_json(place / "provenance.json", provenance(shrunk.identity, seconds))
    return ShrunkLibrary(library=str(place), seconds=seconds, cases=rows, median=_medians(rows))


def _ids(source: CaseLibrary, wanted: Sequence[str]) -> list[str]:
    """Return the ids of the wanted cases, ascending by test, each once.

    Raises:
        InputError: No case is wanted, or the library has none.
        UnknownNameError: The library lacks a wanted case.
    """
    known = source.scalars(["case_id"])["case_id"].to_pylist()
    ids = known if list(wanted) == ["all"] else list(dict.fromkeys(wanted))
    there = set(known)
    for case_id in ids:
        if case_id not in there:
            source.scenario(case_id)  # raises the error
    if not ids:
        raise InputError(f"There is no case to shrink; name some of the library {source.path}.")
    return sorted(ids, key=lambda case_id: int(case_id.partition(":")[2]))


def _place(library: Path, ids: Sequence[str]) -> Path:
    """Return the default folder of a shrunk case."""
    if len(ids) > 1:
        raise InputError(f"{len(ids)} cases are to be shrunk; say where their library goes with --out FOLDER.")
    path = library.absolute()
    return path.with_name(f"{path.name}-shrunk-{ids[0].replace(':', '-')}")


def _open(source: CaseLibrary, run: Experiment, place: Path, *, resume: bool) -> CaseLibrary:
    """Start the library of shrunk cases, or go on with it, and put the model that its replays need beside it.

    Its identity is that of natural traffic: the scripts hold the actions, so the adversary does not matter any more.
    """
    seed = int(str(source.identity["seed"]))
    natural = replace(run, bv="nde", bounded=False, policies=(), budget=None, acting="greedy")
    origin = {key: value for key, value in source.identity.items() if key not in ("cornerforge", "code")}
    identity = {
        **natural.identity(seed),
        SCRIPTED: True,
        **({ON_RAILS: True} if source.on_rails else {}),
        "source_bv": source.identity["bv"],
        "source": config_hash(origin),
        "cornerforge": version(),
        "code": code_hash(),
    }
    library = (CaseLibrary.resume if resume else CaseLibrary.create)(place, identity, natural.odd)
    if not (place / MODEL_FILE).exists():
        save_model(natural.model, place / MODEL_FILE)
    return library


def _left(shrunk: CaseLibrary, ids: Sequence[str]) -> list[str]:
    """Return the ids of the cases that are not shrunk yet.

    Raises:
        InputError: A case comes before one that is stored: a library is written in the order of tests.
    """
    done = set(shrunk.scalars(["case_id"])["case_id"].to_pylist())
    left = [case_id for case_id in ids if case_id not in done]
    if left and int(left[0].partition(":")[2]) < shrunk.next_test:
        raise InputError(
            f"Case {left[0]} comes before cases that {shrunk.path} holds already; choose another place with --out."
        )
    return left


def _fill(source: CaseLibrary, run: Experiment, shrunk: CaseLibrary, ids: Sequence[str], progress: Progress) -> None:
    """Shrink cases and store them; when the work is stopped, store the finished ones."""
    again = driver_of_cases(run)
    driver = run.script_driver()
    room = CaseRoom(run.slots, driver.max_decisions)

    def commit() -> None:
        if len(room):
            cases, tracks = room.tables()
            next_test, done = cases["test"][-1].as_py() + 1, shrunk.tests + len(room)
            shrunk.fill(cases, tracks, next_test=next_test, tests=done, crashes=done, shard_cases=_SHARD_CASES)
            room.clear()

    committed_at = time.monotonic()
    try:
        for done, case_id in enumerate(ids):
            stored = source.scenario(case_id)
            small = shrink_script(driver, _script(stored, _check_same(stored, again), driver))
            room.add(driver, _columns(small), start=small.script.start, poses=small.script.poses)
            if len(room) == _SHARD_CASES or time.monotonic() - committed_at >= _COMMIT_SECONDS:
                commit()
                committed_at = time.monotonic()
            progress("shrink", done + 1, len(ids))
        commit()
    except (KeyboardInterrupt, CornerForgeError):
        # After a stop within a commit the library is ahead and refuses a second write; all finished cases are stored.
        with contextlib.suppress(CornerForgeError):
            commit()
        raise
    shrunk.finish()
    for case_id in ids:
        small_stored = shrunk.scenario(case_id)
        if not is_same(again(small_stored), small_stored):
            raise ReplayError(f"The shrunk case {case_id} in {shrunk.path} does not replay; please report this.")


def _check_same(stored: StoredCase, again: Callable[[StoredCase], Scenario]) -> Scenario:
    """Drive a case again and check it against what is stored.

    Raises:
        ReplayError: The driven test is not the stored one.
    """
    driven = again(stored)
    if not is_same(driven, stored):
        raise ReplayError(
            f"Case {driven.case_id}, driven again, is not what is stored; install the version that made the library."
        )
    return driven


def _script(stored: StoredCase, driven: Scenario, driver: ScriptDriver) -> Script:
    """Make a script of the whole case."""
    seed, test = driven.seed, driven.test
    return stored.script or Script(driven.slot, driver.start_of_test(seed, test), driven.action, seed, test)


def _columns(small: Shrunk) -> dict[str, Scalar]:
    """Make the own columns of a shrunk case."""
    before, after = small.before, small.after
    return {
        "crash_type": small.crash_type,
        "striker": small.striker,
        "cause": small.cause,
        "deviating_actions": after.deviating_actions,
        "source_n_vehicles": before.vehicles,
        "source_n_decisions": before.decisions,
        "source_crash_time_s": before.seconds,
        "source_deviating_actions": before.deviating_actions,
        "source_log_prob_nde": before.log_prob_nde,
    }


def _rows(shrunk: CaseLibrary, ids: Sequence[str]) -> tuple[ShrunkCase, ...]:
    """Read the sizes of these cases from the library."""
    columns = ["case_id", *_LABELS, *(name for pair in _MEASURES.values() for name in pair)]
    wanted = set(ids)
    rows = [row for row in shrunk.scalars(columns).to_pylist() if row["case_id"] in wanted]
    return tuple(
        ShrunkCase(
            case=row["case_id"],
            **{name: row[name] for name in _LABELS},
            before=CaseSize(**{name: _finite(row[pair[0]]) for name, pair in _MEASURES.items()}),
            after=CaseSize(**{name: _finite(row[pair[1]]) for name, pair in _MEASURES.items()}),
        )
        for row in rows
    )


def _finite(value: Any) -> Any:
    return value if value is None or math.isfinite(value) else None


def _medians(rows: Sequence[ShrunkCase]) -> CaseMedians:
    return CaseMedians(before=_median([row.before for row in rows]), after=_median([row.after for row in rows]))


def _median(sizes: Sequence[CaseSize]) -> MedianSize:
    names = [one.name for one in fields(MedianSize)]
    return MedianSize(**{name: float(statistics.median(getattr(size, name) for size in sizes)) for name in names})
