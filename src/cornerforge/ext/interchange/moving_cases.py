"""Moving cases are driven, and cases that end in a crash of the AV become libraries on rails."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cornerforge._checks import check_integer
from cornerforge._locks import claims
from cornerforge.errors import AvFaultError, InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.output import check_new_folder, code_hash, provenance, version, write_json
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.library import CaseLibrary
from cornerforge.library.case_file import Happened
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.harvester import CaseRoom, Scalar
from cornerforge.library.out_case import MovingCase, recorded_script
from cornerforge.library.schema import ON_RAILS, SCRIPTED
from cornerforge.ndd.model import save_model
from cornerforge.types import Odd
from cornerforge.verbs.drive_case import av_straight_on, known_frames, recorded_drive, told
from cornerforge.work.progress import NO_PROGRESS, Progress
from cornerforge.world_options import WorldOptions

__all__ = ["CRASH", "NO_CRASH", "UNKNOWN", "CaseOutcome", "CasesDriven", "library_of"]

CRASH, NO_CRASH, UNKNOWN = "crash", "no crash", "unknown"
"""Outcome of a case. UNKNOWN: the AV gave no usable answer, or what it did was not recorded."""
_SHARD_CASES = 1000
_EXTENT = ("name", "vehicle_length", "vehicle_width", "max_speed", "test_length", "time_limit", "traffic_length")
"""Fields of an ODD that may be larger than a case needs; roads that differ in nothing else become one."""


@dataclass(frozen=True)
class CaseOutcome:
    """Outcome of a moving case.

    Attributes:
        name: Name of the case.
        outcome: CRASH, NO_CRASH or UNKNOWN.
        words: What happened.
        happened: The same as numbers; None where the AV's motion is unknown.
        striker: Which vehicle strikes: "av", "bv" or "mutual"; None without crash.
        library: Library that holds it; None without crash.
        case_id: Its name there.
    """

    name: str
    outcome: str
    words: str
    happened: Happened | None = None
    striker: str | None = None
    library: Path | None = None
    case_id: str | None = None


@dataclass(frozen=True)
class CasesDriven:
    """Result of `library_of`.

    Attributes:
        av: The AV that drove.
        libraries: The libraries: one for each road on which it crashed.
        cases: What became of each case, in their order.
    """

    av: str
    libraries: tuple[Path, ...]
    cases: tuple[CaseOutcome, ...]

    @property
    def crashes(self) -> int:
        """How many end in a crash of the AV."""
        return sum(one.outcome == CRASH for one in self.cases)


@claims()
def library_of(
    cases: Sequence[MovingCase],
    out: Path | str,
    *,
    set_speed: float | None = None,
    seed: int = 0,
    progress: Progress = NO_PROGRESS,
    world: WorldOptions | None = None,
) -> CasesDriven:
    """Drive moving cases with an AV, and store cases that end in a crash of the AV as a library on rails.

    The cases of a library share a road: those with as many lanes of the same width. The library has room for the
    longest and fastest of them. Each road gets a library of its own.

    Args:
        cases: At least one.
        out: New or empty folder: the library, or, for several roads, a folder of libraries `road-1`, `road-2`, ...
        set_speed: At which speed the AV is set to drive [m/s]; None: as `library.out_case.script_of` says.
        seed: Seed of the library: a case is named seed:number, with its number among `cases`.
        progress: Called with the progress.
        world: The AV, and how one from outside is asked; None: "recorded", the vehicle in the AV's place moves as
            recorded.

    Returns:
        What crashed and what did not. Columns of a library: `name` of the case, `origin` (its fact `source`), and
        `av_length_m` and `av_width_m`, how large the AV was.

    Raises:
        CornerForgeError: A case cannot be driven, the AV cannot be had, or the place cannot be used.
    """
    place = Path(out)
    check_integer("seed", seed, low=0, high=2**63 - 1)
    if not cases:
        raise InputError("There is no case to drive.")
    check_new_folder(place)
    options = world or WorldOptions(av=RECORDED_AV)
    groups = _roads(cases)
    found: dict[int, CaseOutcome] = {}
    libraries: list[Path] = []
    for odd, numbers in groups:
        run = experiment(options, road=odd, takes_foreign=True, takes_recorded=True, seed=seed)
        try:
            room = _record_all(run, cases, numbers, found, set_speed, seed, progress, len(cases))
        finally:
            run.rest()
        if len(room):
            library = place if len(groups) == 1 else place / f"road-{len(libraries) + 1}"
            tests = _store(run, library, room, [cases[number] for number in numbers], numbers[-1] + 1, seed)
            libraries.append(library)
            for number in tests:
                found[number] = replace(found[number], library=library, case_id=f"{seed}:{number}")
    return CasesDriven(options.av, tuple(libraries), tuple(found[number] for number in range(len(cases))))


def _roads(cases: Sequence[MovingCase]) -> list[tuple[Odd, list[int]]]:
    """Sort cases by road: the ODD that holds all of them, and their numbers, ascending."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for number, case in enumerate(cases):
        road = case.odd.stated()
        key = tuple((name, value) for name, value in sorted(road.items()) if name not in _EXTENT)
        groups.setdefault(key, []).append(number)
    found = []
    for numbers in groups.values():
        odds = [cases[number].odd for number in numbers]
        names = {odd.name for odd in odds}
        largest = {name: max(getattr(odd, name) for odd in odds) for name in _EXTENT if name != "name"}
        found.append((replace(odds[0], name=names.pop() if len(names) == 1 else "imported", **largest), numbers))
    return found


def _record_all(
    run: Experiment, cases: Sequence[MovingCase], numbers: Sequence[int], found: dict[int, CaseOutcome],
    set_speed: float | None, seed: int, progress: Progress, total: int,
) -> CaseRoom:  # fmt: skip
    """Drive the cases of one road; note what became of each in `found`, and return the crashes."""
    driver = run.script_driver()
    room = CaseRoom(run.slots, driver.max_decisions)
    for number in numbers:
        case = cases[number]
        progress("cases", len(found), total)
        if run.av.name == RECORDED_AV and not case.av_is_recorded:
            found[number] = CaseOutcome(case.name, UNKNOWN, "what the AV did was not recorded")
            continue
        script = recorded_script(case, set_speed=set_speed, seed=seed, test=number)
        try:
            scenario = recorded_drive(run, driver, script)
        except AvFaultError as error:
            found[number] = CaseOutcome(case.name, UNKNOWN, str(error))
            continue
        happened, striker, words = told(scenario, case.called)
        found[number] = CaseOutcome(case.name, CRASH if happened.crashed else NO_CRASH, words, happened, striker)
        if happened.crashed:
            source = case.facts.get("source")
            extra: dict[str, Scalar] = {
                "name": case.name, "origin": "" if source is None else str(source),
                "av_length_m": float(case.length[0]), "av_width_m": float(case.width[0]),
            }  # fmt: skip
            poses = script.poses
            if poses is not None and case.av_is_recorded:  # a replay as recorded asks for all of it
                poses = av_straight_on(poses, known_frames(poses))
            room.add(driver, extra, start=script.start, poses=poses)
    progress("cases", len(found), total)
    return room


def _store(
    run: Experiment, place: Path, room: CaseRoom, cases: Sequence[MovingCase], next_test: int, seed: int
) -> list[int]:
    """Write the library; return the numbers of its cases."""
    identity = {
        **run.identity(seed), SCRIPTED: True, ON_RAILS: True, "moving_cases": _hash_of(cases),
        "cornerforge": version(), "code": code_hash(),
    }  # fmt: skip
    library = CaseLibrary.create(place, identity, run.odd)
    save_model(run.model, place / MODEL_FILE)
    stored, tracks = room.take()
    library.fill(stored, tracks, next_test=next_test, tests=len(cases), crashes=len(stored), shard_cases=_SHARD_CASES)
    library.finish()
    write_json(place / "provenance.json", provenance(library.identity))
    tests: list[int] = stored["test"].to_pylist()
    return tests


def _hash_of(cases: Sequence[MovingCase]) -> str:
    """Hash what decides how the others move (SHA-256, first 16 hex digits)."""
    digest = hashlib.sha256()
    for case in cases:
        digest.update(case.name.encode())
        for values in (case.kind, case.length, case.width, case.poses):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:16]
