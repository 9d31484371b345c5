"""Driving the cases of a library with another AV, the others as recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cornerforge.drivers.avs import numbers_of_av
from cornerforge.errors import ReplayError
from cornerforge.experiment.av_file import av_of
from cornerforge.experiment.experiments import Experiment
from cornerforge.foreign.spec import with_av
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.road.straight import along
from cornerforge.sim import Script, ScriptDriver, scripted
from cornerforge.types import SUBSTEPS
from cornerforge.verbs.cases import experiment_with
from cornerforge.work import Rooms, in_order
from cornerforge.work.progress import Progress
from cornerforge.world_options import WorldOptions

__all__ = ["StoredScripts", "drive_as_recorded", "run_with"]

_SAME_M = 1e-3
"""Stored positions have 32 bits: this far along the road they are the same [m]."""
_AFTER_S = 3
"""How long after the end of a recording the others drive on naturally [s]: as long as nobody may touch a way out."""
_CHUNK = 32


class StoredScripts:
    """Makes scripts of a library's cases; keeps its buffers, so one serves one thread.

    Args:
        cases: The library.
        run: Its world, with any AV.
    """

    def __init__(self, cases: CaseLibrary, run: Experiment) -> None:
        # Where vehicles start depends on the gaps that the AV wants: those of the one that made the library.
        made_by = str(cases.identity["av"])
        made = numbers_of_av(av_of("idm-mobil" if cases.scripted else made_by))  # scripts hold their starts
        self._starts = ScriptDriver(run.setting._replace(av=made), run.odd)

    def of(self, stored: StoredCase) -> Script:
        """Make the script of a case: what is stored of the others; the far ones, and all after its end, are natural.

        On rails they go on as those say, to their end.

        Raises:
            ReplayError: The case does not begin where tests of its name begin.
        """
        script = stored.script
        if script is None:
            case = stored.scenario
            start = self._starts.start_of_test(case.seed, case.test)
            if np.abs(along(case.x[0], start["x"][case.slot])).max() > _SAME_M:
                raise ReplayError(
                    f"Case {case.case_id} does not begin as stored; install the version that made the library."
                )
            action = np.full((len(case.action), start.size), scripted.NATURAL, dtype=np.int8)
            action[:, case.slot] = case.action
            slots = np.arange(start.size, dtype=np.int16)
            script = Script(slots, start, action, case.seed, case.test, hidden=case.hidden_slots)
        decisions = len(script.action) + _AFTER_S if script.poses is None else (len(script.poses) - 1) // SUBSTEPS
        decisions = min(decisions, self._starts.max_decisions)
        action = np.full((decisions, script.slot.size), scripted.NATURAL, dtype=np.int8)
        action[: len(script.action)] = script.action[:decisions]
        return replace(script, action=action)


def run_with(cases: CaseLibrary, options: WorldOptions, av: str) -> Experiment:
    """Build the experiment of a library with one of several AVs."""
    return experiment_with(cases, with_av(options, av))


def drive_as_recorded(
    cases: CaseLibrary, ids: Sequence[str], runs: Sequence[Experiment], threads: int, progress: Progress, what: str
) -> list[list[scripted.Ending]]:
    """Drive cases with the AVs of some runs, and say how each ends.

    Args:
        cases: The library.
        ids: Case ids.
        runs: Its world, with one AV each; at least one.
        threads: How many at the same time; does not change the result.
        progress: Told how far it is, under the name `what`.

    Returns:
        For each case the ends of all AVs.

    Raises:
        CornerForgeError: A case cannot be read or does not begin as stored, or an AV fails 20 times in a row.
    """
    rooms = Rooms(lambda: ([run.script_driver() for run in runs], StoredScripts(cases, runs[0])))

    def drive(first: int, count: int) -> list[list[scripted.Ending]]:
        with rooms.lend() as (drivers, scripts):
            made = (scripts.of(cases.scenario(case)) for case in ids[first : first + count])
            return [[driver.drive(script) for driver in drivers] for script in made]

    ends: list[list[scripted.Ending]] = []
    for part in in_order(drive, 0, len(ids), chunk=_CHUNK, threads=min(run.processes(threads) for run in runs)):
        ends += part
        progress(what, len(ends), len(ids))
    return ends
