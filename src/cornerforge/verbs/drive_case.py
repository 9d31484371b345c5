"""Case files are driven, each with an AV of choice; what happened is told in words."""

from __future__ import annotations

import functools
import json
import math
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from cornerforge._extensions import extension
from cornerforge._options import verb
from cornerforge._schema import meant
from cornerforge.analysis.crash_types import STRIKERS, classify_crashes
from cornerforge.analysis.in_words import what_happened
from cornerforge.analysis.mechanism import contact_pose, crash_type_of, own_frame
from cornerforge.drivers.rails import X
from cornerforge.errors import AvFaultError, InputError, UnknownNameError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.fields import SERIES
from cornerforge.library.case_file import CaseFile, Happened, read_case_file
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.out_case import plain_text, straight_on
from cornerforge.ndd.model import default_model_path, load_model, model_hash
from cornerforge.sim import Script, ScriptDriver, scripted
from cornerforge.types import CLASSES, FRAME_S, SUBSTEPS, Scenario
from cornerforge.world_options import AvAloneOptions, WorldOptions

__all__ = [
    "COUNTS", "CaseDriver", "DrivenCase", "av_straight_on", "check_count", "drive_case",
    "driven_with", "happened_in", "known_frames", "recorded_drive", "striker_of_file", "strikes",
    "told",
]  # fmt: skip

COUNTS = ("any", "av")
"""Which crashes count: any, or those in which the AV strikes, alone or as the other does."""
_LONGEST_NAME = 40
_RUNS = 2
"""Experiments that a driver of case files keeps: each may hold a process of the AV."""


@dataclass(frozen=True, repr=False)
class DrivenCase:
    """A case, driven; a notebook plays it.

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

    def _repr_html_(self) -> str:
        html: str = extension("players").player(self.case, self.scenario)
        return html


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

    def drive(self, case: CaseFile) -> scripted.Ending:
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
        return ending if ending.frame < frames else scripted.Ending(None, -1, 0, ending.bv_crashes)

    def record(self, case: CaseFile) -> Scenario:
        """Drive a case, and keep all of the motion.

        Raises:
            AvFaultError: The AV gives no usable answer.
            CornerForgeError: See `run`.
        """
        run = self.run(case)
        with _saying(case):
            return recorded_drive(run, run.script_driver(), case.script)


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
    frames = known_frames(poses)
    seconds = max(1, math.ceil((frames - 1) / SUBSTEPS))
    whole = av_straight_on(poses, frames)[: SUBSTEPS * seconds + 1]
    return replace(script, action=script.action[:seconds], poses=whole), frames


def known_frames(poses: NDArray[np.float64]) -> int:
    """Count the frames until the first one in which nobody knows where the AV was."""
    unknown = np.flatnonzero(np.isnan(poses[:, 0, X]))
    return int(unknown[0]) if unknown.size else len(poses)


def av_straight_on(poses: NDArray[np.float64], frames: int) -> NDArray[np.float64]:
    """Let the AV go on at its last speed after some frames."""
    poses = poses.copy()
    poses[frames:, 0] = straight_on(poses[frames - 1, 0], len(poses) - frames)
    return poses


def recorded_drive(run: Experiment, driver: ScriptDriver, script: Script) -> Scenario:
    """Drive a script and keep all of the motion; what was in the AV's seat drives as long as it was recorded."""
    if run.av.name != RECORDED_AV:
        return driver.record(script)[0]
    script, frames = _as_recorded(script)
    scenario = driver.record(script)[0]
    if len(scenario.x) <= frames:
        return scenario
    return replace(scenario, crash=None, **{one.name: getattr(scenario, one.name)[:frames] for one in SERIES})


class DriveCase(AvAloneOptions):
    """Drive a case file; the AV "recorded" is whatever was in the AV's seat."""

    case: Annotated[CaseFile | Path | str, meant("The case, or its file.")] = field(kw_only=False)


@verb(DriveCase, writes=False)
def drive_case(options: DriveCase) -> DrivenCase:
    """Drive a case file with an AV.

    Returns:
        What happened. The AV "recorded" is whatever was in the AV's seat.

    Raises:
        AvFaultError: The AV raises, hangs or gives no usable answer.
        CornerForgeError: The file cannot be read, the AV cannot be had, or the case depends on another model.
    """
    case = options.case
    models = [] if isinstance(case, CaseFile) else [Path(case).parent]
    read = case if isinstance(case, CaseFile) else read_case_file(case)
    with CaseDriver(options.world(), models) as driver:
        return driven_with(driver, read, options.av)


def driven_with(driver: CaseDriver, case: CaseFile, av: str) -> DrivenCase:
    """Drive a case with the AV of a driver, and say what happened."""
    scenario = driver.record(case)
    happened, striker, words = told(scenario)
    return DrivenCase(case.name, av, happened, words, scenario, striker=striker)


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
        return STRIKERS[int(classify_crashes(own_frame(happened.pose[None], case.odd), length, width).striker[0])]


def happened_in(scenario: Scenario) -> Happened:
    """Tell the AV's contact, if it has one."""
    if scenario.partner is None:
        return Happened()
    return Happened(scenario.contact()[0], int(scenario.slot[scenario.partner]), contact_pose(scenario))


def told(scenario: Scenario, called: Sequence[str] = ()) -> tuple[Happened, str | None, str]:
    """Tell what happened: the AV's contact; the striker, "av", "bv" or "mutual"; and in words how fast both were.

    Args:
        scenario: The motion.
        called: What the vehicles are called, by slot; empty: by their slots.

    Returns:
        Contact, striker (None: no crash of the AV), and words.
    """
    happened = happened_in(scenario)
    if happened.frame is None or happened.pose is None or happened.partner is None:
        return happened, None, f"no crash of the AV in {FRAME_S * (len(scenario.x) - 1):.1f} s"
    frame, column = scenario.contact()
    name = f"({plain_text(called[happened.partner], _LONGEST_NAME)})" if called else f"in slot {happened.partner}"
    other = f"the {CLASSES[int(scenario.kind[column])].name} {name}"
    speeds = happened.pose[:, 2]
    striker = crash_type_of(scenario)[1]
    struck = {
        "av": f"the AV, at {speeds[0]:.1f} m/s, strikes {other}, at {speeds[1]:.1f} m/s",
        "bv": f"{other}, at {speeds[1]:.1f} m/s, strikes the AV, at {speeds[0]:.1f} m/s",
        "mutual": f"the AV, at {speeds[0]:.1f} m/s, and {other}, at {speeds[1]:.1f} m/s, strike each other",
    }[striker]
    return happened, striker, f"crash after {FRAME_S * frame:.1f} s: {struck} ({what_happened(scenario)})"
