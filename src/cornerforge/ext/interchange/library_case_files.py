"""Case files of the cases of a library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import CornerForgeError
from cornerforge.experiment.experiments import Experiment
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.library.case_file import CaseFile, Happened
from cornerforge.library.out_case import Fact
from cornerforge.ndd.model import model_hash
from cornerforge.sim import Script, scripted
from cornerforge.types import Scenario
from cornerforge.verbs.cases import SEVERAL, driver_of_cases, experiment_of, is_same
from cornerforge.verbs.drive_case import happened_in
from cornerforge.verbs.stored_cases import StoredScripts, run_with
from cornerforge.world_options import WorldOptions

__all__ = ["CaseFilesOf"]


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
        try:
            return experiment_of(self._cases, takes_foreign=False)
        except CornerForgeError:
            return None

    def of(self, case_id: str, *, name: str | None = None, facts: Mapping[str, Fact] | None = None) -> CaseFile:
        """Make the case file of a case.

        Where the AV that made the library is built in, all others do what they did, so that it crashes again to the
        bit; else only the stored ones do, and vehicles farther off drive as is likeliest.

        Args:
            case_id: The case.
            name: Name of the case file; None: the case id, with - instead of the colon.
            facts: What else is known; None: a few numbers of the library's.

        Raises:
            CornerForgeError: The case is missing, it cannot be read, or it does not begin as stored.
        """
        stored = self._cases.scenario(case_id)
        script, happened = self._script(stored)
        licence = self._model.provenance.get("licence")
        on_rails = script.poses is not None
        # A suite names the AV of each case.
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
                return script if stored.script is not None else _whole(script, driven), happened_in(driven)
        return script, happened_in(stored.scenario)


def _whole(script: Script, driven: Scenario) -> Script:
    """The same script, with the actions of all others, not only of the stored ones."""
    action = np.full((max(len(script.action), len(driven.action)), script.slot.size), scripted.NATURAL, dtype=np.int8)
    action[: len(driven.action)] = driven.action
    return replace(script, action=action)


def _of_av(scenario: Scenario) -> NDArray[np.float64]:
    """Motion of the AV, (T, POSE_NUMBERS); its lateral speed was not recorded."""
    poses = np.zeros((len(scenario.x), POSE_NUMBERS))
    for column, name in ((X, "x"), (Y, "y"), (SPEED, "speed"), (HEADING, "heading"), (ACCELERATION, "acceleration"),
                         (LANE, "target_lane")):  # fmt: skip
        poses[:, column] = getattr(scenario, name)[:, 0]
    return poses


def _facts(stored: StoredCase) -> dict[str, Fact]:
    names = ("case_id", "crash_time_s", "impact_speed_difference_mps", "min_ttc_s", "log_prob_nde")
    found = {name: stored.scalars.get(name) for name in names}
    return {name: v if not isinstance(v, float) or np.isfinite(v) else None for name, v in found.items()}
