"""Case files and moving cases are driven: one with an AV of choice, many into a library. Libraries give case files."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.analysis.crash_types import STRIKERS, classify_crashes
from cornerforge.analysis.in_words import what_happened
from cornerforge.analysis.mechanism import contact_pose, crash_frame, crash_types_of
from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import AvFaultError, CornerForgeError, InputError, UnknownNameError
from cornerforge.fields import SERIES
from cornerforge.foreign.loaders import is_foreign
from cornerforge.interchange.case_file import CaseFile, Happened, read_case_file
from cornerforge.interchange.cases import Fact, MovingCase, plain_text, script_of, straight_on
from cornerforge.library import CaseLibrary, CaseRecord, StoredCase, case_record
from cornerforge.library.record import Scalar
from cornerforge.library.schema import ON_RAILS, SCRIPTED
from cornerforge.ndd.model import default_model_path, load_model, model_hash, save_model
from cornerforge.pipeline.cases import SEVERAL, driver_of_cases, experiment_of, is_same
from cornerforge.pipeline.generate import MODEL_FILE
from cornerforge.pipeline.output import check_new_folder, code_hash, provenance, version, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.pipeline.setting import RECORDED_AV, Experiment, experiment
from cornerforge.pipeline.stored_cases import StoredScripts, run_with
from cornerforge.sim import NATURAL, SUBSTEPS, Ending, Script
from cornerforge.types import CLASSES, FRAME_S, Odd, Scenario
from cornerforge.world_options import AvAloneKeywords, WorldOptions

__all__ = [
    "COUNTS", "CRASH", "NO_CRASH", "UNKNOWN", "CaseDriver", "CaseFilesOf", "CaseOutcome", "CasesDriven", "DrivenCase",
    "check_count", "crash_in_words", "drive_case", "driven_with", "library_of", "striker_of_file", "strikes",
]  # fmt: skip

CRASH, NO_CRASH, UNKNOWN = "crash", "no crash", "unknown"
"""What became of a case. UNKNOWN: the AV gave no usable answer, or what it did was not recorded."""
COUNTS = ("any", "av")
"""Which crashes count: any, or those in which the AV strikes, alone or as the other does."""
_SHARD_CASES = 1000
_LONGEST_NAME = 40
_RUNS = 2
"""Experiments that a driver of case files keeps: each may hold a process of the AV."""
_EXTENT = ("name", "vehicle_length", "vehicle_width", "max_speed", "test_length", "time_limit", "traffic_length")
"""Fields of an ODD that may be larger than a case needs; roads that differ in nothing else become one."""


# One case with one AV


@dataclass(frozen=True, repr=False)
class DrivenCase:
    """A case, driven.

    Attributes:
        case: Name of the case.
        av: The AV that drove.
        happened: Whether it crashed, when, with whom.
        words: What happened, in words.
        scenario: All of the motion, up to the contact or to the end.
        seen: How to see it; "": not told.
        striker: Who strikes: "av", "bv" or "mutual"; None: no crash.
    """

    case: str
    av: str
    happened: Happened
    words: str
    scenario: Scenario
    seen: str = ""
    striker: str | None = None

    @property
    def crashed(self) -> bool:
        """Did the AV touch another vehicle, or was it touched?"""
        return self.happened.crashed

    def counts(self, count: str = "any") -> bool:
        """Is there a crash that counts?

        Args:
            count: "any", or "av": only if the AV strikes, alone or as the other does.

        Raises:
            UnknownNameError: `count` is another word.
        """
        return strikes(self.striker, check_count(count))

    def __repr__(self) -> str:
        told = f"case {self.case}, AV {self.av}: {self.words}"
        return f"<{told}; to see it: {self.seen}>" if self.seen else f"<{told}>"


class CaseDriver:
    """Drives case files with one AV; one serves one thread. Close it at the end: it may hold processes of the AV.

    Args:
        options: The AV, and how it is asked; road and model are those of each case.
        models: Folders in which `model.npz` may lie, for cases that depend on another model than the shipped one.
    """

    def __init__(self, options: WorldOptions, models: Sequence[Path] = ()) -> None:
        self._options = options
        self._models = models
        self._runs: OrderedDict[tuple[str, ...], Experiment] = OrderedDict()

    def __enter__(self) -> CaseDriver:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the AV's processes."""
        while self._runs:
            self._runs.popitem()[1].rest()

    def run(self, case: CaseFile) -> Experiment:
        """Build the world of a case, with the AV.

        Raises:
            CornerForgeError: The AV cannot be had, or the model is another one.
        """
        if self._options.av == RECORDED_AV and not case.av_is_recorded:
            raise InputError(f"Case {case.name} does not say what the AV did, so it cannot drive as recorded.")
        key = (json.dumps(case.odd.stated(), sort_keys=True), case.model or "", str(case.script.seed))
        if key not in self._runs:
            while len(self._runs) >= _RUNS:
                self._runs.popitem(last=False)[1].rest()
            self._runs[key] = experiment(
                self._options, road=case.odd, model=self._model(case), takes_foreign=True,
                takes_recorded=True, seed=case.script.seed,
            )  # fmt: skip
        self._runs.move_to_end(key)
        return self._runs[key]

    def _model(self, case: CaseFile) -> Path | None:
        """Find the model of a case; None: the shipped one."""
        if case.model in (None, _shipped()):
            return None
        for folder in self._models:
            path = folder / MODEL_FILE
            if path.is_file() and model_hash(load_model(path)) == case.model:
                return path
        raise InputError(
            f"In case {case.name} the others drive by the naturalistic model {case.model}, not by the shipped one "
            f"({_shipped()}); put that model beside the case file as {MODEL_FILE}."
        )

    def drive(self, case: CaseFile) -> Ending:
        """Drive a case, and say how it ends.

        Raises:
            CornerForgeError: See `run`.
        """
        driver = self.run(case).script_driver()
        with _saying(case):
            if self._options.av != RECORDED_AV:
                return driver.drive(case.script)
            script, frames = _as_recorded(case.script)
            ending = driver.drive(script)
        return ending if ending.frame < frames else Ending(None, -1, 0, ending.bv_crashes)

    def record(self, case: CaseFile) -> Scenario:
        """Drive a case, and keep all of the motion.

        Raises:
            AvFaultError: The AV gives no usable answer.
            CornerForgeError: See `run`.
        """
        run = self.run(case)
        with _saying(case):
            return _record(run, case.script)


@contextmanager
def _saying(case: CaseFile) -> Iterator[None]:
    """Let errors of a drive begin with the case."""
    try:
        yield
    except (InputError, AvFaultError) as error:
        error.args = (f"Case {case.name}: {error}",)
        raise


@functools.cache
def _shipped() -> str:
    """Hash of the model that ships with the package."""
    return model_hash(load_model(default_model_path()))


def _as_recorded(script: Script) -> tuple[Script, int]:
    """Cut a script to the seconds in which it is known what was in the AV's seat, and count the frames of these.

    In the last tenths of the last second, of which nothing is known, the AV goes straight on.
    """
    poses = script.poses
    assert poses is not None
    frames = _known_frames(poses)
    seconds = max(1, math.ceil((frames - 1) / SUBSTEPS))
    whole = _av_straight_on(poses, frames)[: SUBSTEPS * seconds + 1]
    return replace(script, action=script.action[:seconds], poses=whole), frames


def _known_frames(poses: NDArray[np.float64]) -> int:
    """Count the frames until the first one in which nobody knows where the AV was."""
    unknown = np.flatnonzero(np.isnan(poses[:, 0, X]))
    return int(unknown[0]) if unknown.size else len(poses)


def _av_straight_on(poses: NDArray[np.float64], frames: int) -> NDArray[np.float64]:
    """Let the AV go on at its last speed after some frames."""
    poses = poses.copy()
    poses[frames:, 0] = straight_on(poses[frames - 1, 0], len(poses) - frames)
    return poses


def _record(run: Experiment, script: Script) -> Scenario:
    """Drive a script and keep all of the motion; what was in the AV's seat drives as long as it was recorded."""
    driver = run.script_driver()
    if run.av.name != RECORDED_AV:
        return driver.record(script)[0]
    script, frames = _as_recorded(script)
    scenario = driver.record(script)[0]
    if len(scenario.x) <= frames:
        return scenario
    return replace(scenario, crash=None, **{one.name: getattr(scenario, one.name)[:frames] for one in SERIES})


def drive_case(case: CaseFile | Path | str, **world: Unpack[AvAloneKeywords]) -> DrivenCase:
    """Drive a case file with an AV.

    Args:
        case: The case, or its file.
        world: `av`, and how an AV from outside is asked. "recorded" is whatever was in the AV's seat.

    Raises:
        AvFaultError: The AV raises, hangs or gives no usable answer.
        CornerForgeError: The file cannot be read, the AV cannot be had, or the case depends on another model.
    """
    models = [] if isinstance(case, CaseFile) else [Path(case).parent]
    read = case if isinstance(case, CaseFile) else read_case_file(case)
    options = WorldOptions(**world)
    with CaseDriver(options, models) as driver:
        return driven_with(driver, read, options.av)


def driven_with(driver: CaseDriver, case: CaseFile, av: str) -> DrivenCase:
    """Drive a case with the AV of a driver, and say what happened."""
    scenario = driver.record(case)
    happened, striker = _happened(scenario), _striker(scenario)
    return DrivenCase(case.name, av, happened, crash_in_words(scenario), scenario, striker=striker)


def check_count(count: str) -> str:
    """Check which crashes count.

    Raises:
        UnknownNameError: It is none of COUNTS.
    """
    if count not in COUNTS:
        raise UnknownNameError("way to count crashes", count, COUNTS)
    return count


def strikes(striker: str | None, count: str) -> bool:
    """Does a crash count, by who strikes?

    >>> strikes("bv", "any"), strikes("bv", "av"), strikes("mutual", "av"), strikes(None, "any")
    (True, False, True, False)
    """
    return striker is not None and (count == "any" or striker != "bv")


def striker_of_file(case: CaseFile) -> str | None:
    """Say who struck in the crash that a case file tells of; None: it tells of none.

    Raises:
        InputError: What the file says is no contact.
    """
    happened = case.happened
    if happened is None or happened.pose is None:
        return None
    pair = [0, int(np.flatnonzero(case.script.slot == happened.partner)[0])]
    length, width = (case.script.start[name][pair].astype(np.float64)[None] for name in ("length", "width"))
    with _saying(case):
        return STRIKERS[int(classify_crashes(happened.pose[None], length, width).striker[0])]


def _striker(scenario: Scenario) -> str | None:
    """Say who strikes; None: no crash of the AV."""
    if not _happened(scenario).crashed:
        return None
    return STRIKERS[int(crash_types_of([scenario]).striker[0])]


def _happened(scenario: Scenario) -> Happened:
    if scenario.crash is None or scenario.crash.slot_a != 0:
        return Happened()
    frame, _ = crash_frame(scenario)
    return Happened(frame, scenario.crash.slot_b, contact_pose(scenario))


def crash_in_words(scenario: Scenario, called: Sequence[str] = ()) -> str:
    """Say in words what happened: who struck whom, when, how fast both were.

    Args:
        scenario: The motion.
        called: What the vehicles are called, by slot; empty: by their slots.
    """
    happened = _happened(scenario)
    if happened.frame is None or happened.pose is None or happened.partner is None:
        return f"no crash of the AV in {FRAME_S * (len(scenario.x) - 1):.1f} s"
    frame, column = crash_frame(scenario)
    name = f"({plain_text(called[happened.partner], _LONGEST_NAME)})" if called else f"in slot {happened.partner}"
    other = f"the {CLASSES[int(scenario.kind[column])].name} {name}"
    speeds = happened.pose[:, 2]
    struck = {
        "av": f"the AV, at {speeds[0]:.1f} m/s, strikes {other}, at {speeds[1]:.1f} m/s",
        "bv": f"{other}, at {speeds[1]:.1f} m/s, strikes the AV, at {speeds[0]:.1f} m/s",
        "mutual": f"the AV, at {speeds[0]:.1f} m/s, and {other}, at {speeds[1]:.1f} m/s, strike each other",
    }[str(_striker(scenario))]
    return f"crash after {FRAME_S * frame:.1f} s: {struck} ({what_happened(scenario)})"


# From a library to case files


class CaseFilesOf:
    """Makes case files of a library's cases; one serves one thread.

    Args:
        cases: The library.
    """

    def __init__(self, cases: CaseLibrary) -> None:
        self._cases = cases
        self._av = str(cases.identity["av"])
        self._run = self._maker()
        world = self._run or run_with(cases, WorldOptions(), "idm-mobil")
        self._scripts = StoredScripts(cases, world)
        self._model = world.model
        self._again = None if self._run is None else driver_of_cases(self._run)

    def _maker(self) -> Experiment | None:
        """The run that made the library; None if its AV is from outside or not at hand."""
        if is_foreign(self._av) or self._av == SEVERAL:
            return None
        try:
            return experiment_of(self._cases)
        except CornerForgeError:
            return None

    def of(self, case_id: str, *, name: str | None = None, facts: Mapping[str, Fact] | None = None) -> CaseFile:
        """Make the case file of a case.

        Where the AV that made the library is built in, all others do what they did, so that it crashes again to the
        bit; else only those that the library stored, and those farther off drive as is likeliest.

        Args:
            case_id: The case.
            name: Of the case file; None: the case id, with - instead of the colon.
            facts: What else is known; None: a few numbers of the library's.

        Raises:
            CornerForgeError: There is no such case, it cannot be read, or it does not begin as stored.
        """
        stored = self._cases.scenario(case_id)
        script, happened = self._script(stored)
        licence = self._model.provenance.get("licence")
        on_rails = script.poses is not None
        # A suite says of each case whose it was.
        av = stored.scalars.get("source_av") if self._av == SEVERAL else self._av
        known_hash = self._cases.identity.get("av_hash")
        return CaseFile(
            name=case_id.replace(":", "-") if name is None else name,
            odd=self._cases.odd,
            script=script,
            av=av,
            av_hash=None if known_hash is None else str(known_hash),
            happened=happened,
            recorded=None if on_rails else _of_av(stored.scenario),
            model=None if on_rails else model_hash(self._model),
            licence="" if licence is None or on_rails else f"naturalistic model: {licence}",
            facts=_facts(stored) if facts is None else facts,
        )

    def _script(self, stored: StoredCase) -> tuple[Script, Happened]:
        script = self._scripts.of(stored)
        if self._again is not None:
            driven = self._again(stored)
            if is_same(driven, stored):
                return script if stored.script is not None else _whole(script, driven), _happened(driven)
        return script, _happened(stored.scenario)


def _whole(script: Script, driven: Scenario) -> Script:
    """The same script, with what all others did, not only those that were stored."""
    action = np.full((max(len(script.action), len(driven.action)), script.slot.size), NATURAL, dtype=np.int8)
    action[: len(driven.action)] = driven.action
    return replace(script, action=action)


def _of_av(scenario: Scenario) -> NDArray[np.float64]:
    """What the AV did, (T, POSE_NUMBERS); its lateral speed was not recorded."""
    poses = np.zeros((len(scenario.x), POSE_NUMBERS))
    for column, name in ((X, "x"), (Y, "y"), (SPEED, "speed"), (HEADING, "heading"), (ACCELERATION, "acceleration"),
                         (LANE, "target_lane")):  # fmt: skip
        poses[:, column] = getattr(scenario, name)[:, 0]
    return poses


def _facts(stored: StoredCase) -> dict[str, Fact]:
    names = ("case_id", "crash_time_s", "impact_speed_difference_mps", "min_ttc_s", "log_prob_nde")
    found = {name: stored.scalars.get(name) for name in names}
    return {name: v if not isinstance(v, float) or np.isfinite(v) else None for name, v in found.items()}


# From moving cases to libraries


@dataclass(frozen=True)
class CaseOutcome:
    """What became of a moving case.

    Attributes:
        name: Of the case.
        outcome: CRASH, NO_CRASH or UNKNOWN.
        words: What happened.
        happened: The same as numbers; None: nobody knows.
        library: Library that holds it; None: it is no crash.
        case_id: Its name there.
    """

    name: str
    outcome: str
    words: str
    happened: Happened | None = None
    library: Path | None = None
    case_id: str | None = None


@dataclass(frozen=True)
class CasesDriven:
    """What `library_of` made.

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


def library_of(
    cases: Sequence[MovingCase],
    out: Path | str,
    *,
    set_speed: float | None = None,
    seed: int = 0,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[AvAloneKeywords],
) -> CasesDriven:
    """Drive moving cases with an AV, and store those that end in a crash of the AV as a library on rails.

    The cases of a library share a road: those with as many lanes of the same width. The library has room for the
    longest and fastest of them. Where there are several such roads, each gets a library of its own.

    Args:
        cases: At least one.
        out: New or empty folder: the library, or, for several roads, a folder of libraries `road-1`, `road-2`, ...
        set_speed: At which speed the AV is set to drive [m/s]; None: as `interchange.cases.script_of` says.
        seed: Of the library: a case is named seed:number, where it stands among `cases`.
        progress: Told how far it is.
        world: `av`, and how an AV from outside is asked; without `av` it is "recorded": whatever was in the AV's seat
            moves as it was recorded.

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
    options = replace(WorldOptions(av=RECORDED_AV), **world)
    groups = _roads(cases)
    found: dict[int, CaseOutcome] = {}
    libraries: list[Path] = []
    for odd, numbers in groups:
        run = experiment(options, road=odd, takes_foreign=True, takes_recorded=True, seed=seed)
        try:
            records = _record_all(run, cases, numbers, found, set_speed, seed, progress, len(cases))
        finally:
            run.rest()
        if records:
            library = place if len(groups) == 1 else place / f"road-{len(libraries) + 1}"
            _store(run, library, records, [cases[number] for number in numbers], numbers[-1] + 1, seed)
            libraries.append(library)
            for record in records:
                number = int(str(record.case["test"]))
                found[number] = replace(found[number], library=library, case_id=record.case_id)
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
) -> list[CaseRecord]:  # fmt: skip
    """Drive the cases of one road; note what became of each in `found`, and return the crashes."""
    records = []
    for number in numbers:
        case = cases[number]
        progress("cases", len(found), total)
        if run.av.name == RECORDED_AV and not case.av_is_recorded:
            found[number] = CaseOutcome(case.name, UNKNOWN, "what the AV did was not recorded")
            continue
        script = _script_of(case, set_speed, seed, number)
        try:
            scenario = _record(run, script)
        except AvFaultError as error:
            found[number] = CaseOutcome(case.name, UNKNOWN, str(error))
            continue
        happened = _happened(scenario)
        outcome = CRASH if happened.crashed else NO_CRASH
        found[number] = CaseOutcome(case.name, outcome, crash_in_words(scenario, case.called), happened)
        if happened.crashed:
            source = case.facts.get("source")
            extra: dict[str, Scalar] = {
                "name": case.name, "origin": "" if source is None else str(source),
                "av_length_m": float(case.length[0]), "av_width_m": float(case.width[0]),
            }  # fmt: skip
            poses = script.poses
            if poses is not None and case.av_is_recorded:  # a replay as recorded asks for all of it
                poses = _av_straight_on(poses, _known_frames(poses))
            records.append(case_record(scenario, start=script.start, poses=poses, extra=extra))
    progress("cases", len(found), total)
    return records


def _script_of(case: MovingCase, set_speed: float | None, seed: int, number: int) -> Script:
    """Make the script; the AV's own rails are as long as it was recorded."""
    script = script_of(case, set_speed=set_speed, seed=seed, test=number)
    if script.poses is not None:
        script.poses[len(case.poses) :, 0] = np.nan
    return script


def _store(
    run: Experiment, place: Path, records: Sequence[CaseRecord], cases: Sequence[MovingCase], next_test: int, seed: int
) -> None:
    identity = {
        **run.identity(seed), SCRIPTED: True, ON_RAILS: True, "moving_cases": _hash_of(cases),
        "cornerforge": version(), "code": code_hash(),
    }  # fmt: skip
    library = CaseLibrary.create(place, identity, run.odd)
    save_model(run.model, place / MODEL_FILE)
    library.append(records, next_test=next_test, tests=len(cases), crashes=len(records), shard_cases=_SHARD_CASES)
    library.finish()
    write_json(place / "provenance.json", provenance(library.identity))


def _hash_of(cases: Sequence[MovingCase]) -> str:
    """Hash what decides how the others move (SHA-256, first 16 hex digits)."""
    digest = hashlib.sha256()
    for case in cases:
        digest.update(case.name.encode())
        for values in (case.kind, case.length, case.width, case.poses):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:16]
