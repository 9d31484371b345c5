"""`replay` drives cases again; `query` asks a library in SQL."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cornerforge._extensions import extension
from cornerforge._options import verb
from cornerforge._schema import read
from cornerforge.analysis.avoidability import AvoidParams, avoidability
from cornerforge.analysis.stored import CASE_COLUMNS, CASES_FILE, read_analysed
from cornerforge.errors import FileFormatError, InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import code_hash
from cornerforge.experiment.policy_file import load_policy
from cornerforge.experiment.setting import experiment
from cornerforge.fields import REALS
from cornerforge.foreign.named_avs import check_named
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.library.filling import MODEL_FILE, policy_file
from cornerforge.library.manifest import MANIFEST
from cornerforge.library.query import run_sql
from cornerforge.library.schema import RunIdentity
from cornerforge.results import Queried, Replayed
from cornerforge.sim import recorder
from cornerforge.types import Scenario
from cornerforge.verbs.options.cases import Query, Replay
from cornerforge.world_options import AvProcessOptions, WorldOptions

__all__ = ["SEVERAL", "driver_of_cases", "experiment_of", "experiment_with", "is_same", "query", "replay"]

SEVERAL = "several AVs"
"""The AV of a library whose cases were made by different ones."""


def experiment_of(
    cases: CaseLibrary, asked: AvProcessOptions | None = None, *, takes_foreign: bool = True
) -> Experiment:
    """Rebuild the experiment that made a library from its identity and the files beside it.

    Args:
        cases: The library.
        asked: In what an AV from outside runs, and its time for an answer; None: as by default.

    Raises:
        FileFormatError: A file is missing or is not the one of the library.
        InputError: Its AV is from outside, and not taken, or not named by the user.
    """
    _check_told(cases, ("av",))
    if cases.identity["av"] == SEVERAL:
        raise InputError(
            f"The cases of {cases.path} were made by several AVs, so there is none to drive them with again; drive "
            f"them with two of your choice: cornerforge retest {cases.path} --av NEW --baseline OLD"
        )
    check_named(str(cases.identity["av"]), cases.path)
    world = replace((asked or AvProcessOptions()).world(), av=str(cases.identity["av"]))
    return experiment_with(cases, world, changed=(), takes_foreign=takes_foreign)


def experiment_with(
    cases: CaseLibrary, world: WorldOptions, *, changed: Sequence[str] = ("av", "av_hash", "av_steers"),
    takes_foreign: bool = True,
) -> Experiment:  # fmt: skip
    """Build the experiment that made a library, but with the AV of `world` and as that says it is asked.

    Args:
        cases: The library.
        world: The AV; road, model and mask are those of the library.
        changed: Keys of the identity that may be others than the library's.
        takes_foreign: The AV may be one from outside.

    Raises:
        FileFormatError: A file is missing or is not the one of the library.
    """
    identity = cases.identity
    told = read(RunIdentity, identity, f"The manifest of {cases.path} is damaged", "it cannot be driven again.")
    policies = [load_policy(cases.path / policy_file(index)) for index in range(told.policies)]
    run = experiment(
        world,
        road=cases.odd,
        model=cases.path / MODEL_FILE,
        bv=told.bv,
        policy=policies or None,
        bounded=told.bounded,
        # Policies bring their budgets, which need not be the same.
        budget=None if policies else told.budget,
        budget_of="shortfall" if policies else told.budget_of,
        steer_from=None if policies else told.steers_from,
        acting=told.acting,
        takes_foreign=takes_foreign,
        takes_recorded=cases.on_rails,
        seed=told.seed,
    )
    for key, value in run.identity(told.seed).items():
        if key not in changed and identity.get(key) != value:
            raise FileFormatError(
                f"The library {cases.path} was made with {key} = {identity.get(key)!r}, "
                f"but what is here gives {value!r}; "
                "put the original file back, or install the version that made it."
            )
    return run


def _check_told(cases: CaseLibrary, names: Sequence[str]) -> None:
    missing = [name for name in names if name not in cases.identity]
    if missing:
        raise FileFormatError(f"The library {cases.path} does not say its {missing[0]}, so it cannot be driven again.")


def is_same(driven: Scenario, stored: StoredCase) -> bool:
    """Compare a driven test with the stored case: by digest (all numbers, full precision) and by the stored values."""
    if recorder.scenario_digest(driven) != stored.scalars["trajectory_digest"]:
        return False
    columns = np.searchsorted(driven.slot, stored.scenario.slot)
    return all(
        np.array_equal(
            getattr(driven, name)[:, columns].astype(np.float32),
            getattr(stored.scenario, name).astype(np.float32),
            equal_nan=True,
        )
        for name in REALS
    )


def driver_of_cases(run: Experiment) -> Callable[[StoredCase], Scenario]:
    """Return a function that drives a stored case again, from its seed or by its script; it serves one thread."""
    by_seed = run.recorder()
    scripts = run.script_driver()

    def again(stored: StoredCase) -> Scenario:
        if stored.script is None:
            return by_seed.record(stored.scenario.seed, stored.scenario.test)
        return scripts.record(stored.script)[0]

    return again


@verb(Replay)
def replay(options: Replay) -> Replayed:
    """Drive a case again from its seed, or by its script (`shrink` makes such cases).

    Returns:
        What `cornerforge replay --json` prints.

    Raises:
        CornerForgeError: No such case, the library, its policy or model cannot be read, or there can be no picture or
            film.
    """
    if options.case == "all" and (options.picture is not None or options.video is not None):
        raise InputError(
            f"A {'film' if options.picture is None else 'picture'} shows one case; name it instead of all."
        )
    if options.picture is not None:
        extension("films").check_picture(Path(options.picture))
    if options.video is not None:
        extension("films").check_video(Path(options.video))
    cases = CaseLibrary.open(Path(options.library))
    run = experiment_of(cases, options)
    again = driver_of_cases(run)
    ids = cases.scalars(["case_id"])["case_id"].to_pylist() if options.case == "all" else [options.case]
    if not ids:
        raise InputError(
            f"The library {options.library} holds no cases yet, so there is none to replay; generate some first."
        )
    differ: list[str] = []
    crash_time = None
    note: str | None = None
    for done, case_id in enumerate(ids):
        stored = cases.scenario(case_id)
        driven = again(stored)
        crash_time = None if driven.crash is None else driven.crash.time
        if options.check and not is_same(driven, stored):
            differ.append(case_id)
            if note is None:
                note = _why_different(cases, run, driven)
        options.progress("replay", done + 1, len(ids))
        if options.picture is None and options.video is None:
            continue
        has_crash = driven.partner is not None
        answer = (
            avoidability(driven, AvoidParams(steers=run.av_steers))
            if has_crash or options.picture is not None
            else None
        )
        if options.picture is not None and answer is not None:
            extension("films").write_picture(driven, Path(options.picture), answer)
        if options.video is not None:
            title = f"Case {case_id}, AV {run.av.name}"
            extension("films").write_video(driven, Path(options.video), answer, title=title, progress=options.progress)
    is_all = options.case == "all"
    return Replayed(
        case=options.case,
        crash_time_s=None if is_all else crash_time,
        identical=not differ if options.check else None,
        cases=len(ids) if is_all else None,
        differ=tuple(differ) if is_all else None,
        note=note,
        picture=None if options.picture is None else str(options.picture),
        video=None if options.video is None else str(options.video),
    )


def _why_different(cases: CaseLibrary, run: Experiment, driven: Scenario) -> str | None:
    """Say what may explain that a case differs when it is driven again; None if nothing is known."""
    if not run.repeats(driven.seed, driven.test):
        return (
            f"The AV {run.av.name} is not deterministic: asked twice about the same test, it drives differently. "
            "What is stored is what it did then."
        )
    if cases.identity.get("code") != code_hash():
        return "The library was made by other code; install the version that made it to see the same."
    return None


@verb(Query, writes=False)
def query(options: Query) -> Queried:
    """Run SQL on a library, or on the cases of an analysis (table `cases`, key `case_id`), read only.

    Raises:
        CornerForgeError: There is neither, it cannot be read, the SQL is wrong, or needs more than it may.
    """
    folder = Path(options.library)
    if not (folder / MANIFEST).exists() and (folder / CASES_FILE).is_file():
        table = read_analysed(folder / CASES_FILE, "cornerforge analyse")
        columns, rows = run_sql(table, options.sql, seconds=options.seconds, megabytes=options.megabytes)
    else:
        _point_below(folder)
        library = CaseLibrary.open(folder)
        try:
            columns, rows = library.query(options.sql, seconds=options.seconds, megabytes=options.megabytes)
        except InputError as error:
            analysed = [column.name for column in CASE_COLUMNS if column.name not in library.columns]
            asked = next((name for name in analysed if f'"{name}"' in str(error)), None)
            if asked is None:
                raise
            hint = f'"{asked}" is a column of an analysis: cornerforge analyse {folder} --out NEW, then ask NEW.'
            raise InputError(f"{error} {hint}") from error
    return Queried(columns=tuple(columns), rows=tuple(tuple(_plain(value) for value in row) for row in rows))


def _point_below(folder: Path) -> None:
    """Refuse the folder of a run, and say which of its folders have cases.

    Raises:
        InputError: The folder is one of a run.
    """
    below = [path for path in (folder / "library", folder / "analysis") if path.is_dir()]
    if below and not (folder / MANIFEST).exists():
        raise InputError(f"{folder} is no case library; give a folder in it: {' or '.join(map(str, below))}")


def _plain(value: object) -> Any:
    """Turn a value of SQL into JSON that has no NaN and no infinity: they become None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value
