"""Stored cases driven again, by reference drivers and other AVs, or written for other tools."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge.drivers.avs import ROAD_AVS, SITE_AVS
from cornerforge.drivers.careful import CAREFUL
from cornerforge.ext.interchange.export import EXPORTS, CaseWriter, is_installed
from cornerforge.library import StoredCase

if TYPE_CHECKING:
    from cornerforge.ext.explorer.sources import Source
    from cornerforge.sim import Script, ScriptDriver
    from cornerforge.types import Scenario

__all__ = ["Driving"]


class Driving:
    """Drivers and writers, kept once they were asked for; methods are called by one thread at a time.

    Args:
        avs: AVs of the user's own; that each can be had is checked with the library of `source`.
        source: One of the sources.

    Attributes:
        drivers: Names of the reference drivers.
        avs: Names of the AVs that can drive a case.
        exports: Formats for other tools, each with what people read.

    Raises:
        CornerForgeError: The AV is unknown, or the library does not say with what it was made.
    """

    def __init__(self, avs: Sequence[str], source: Source) -> None:
        self.drivers = tuple(CAREFUL)
        own = ROAD_AVS if source.cases.odd.site is None else SITE_AVS
        self.avs = tuple(dict.fromkeys((*own, *avs)))
        self.exports = {name: label for name, label in EXPORTS.items() if is_installed(name)}
        self._drivers: dict[tuple[str, str], tuple[Callable[[StoredCase], Script], ScriptDriver]] = {}
        self._writers: dict[tuple[str, str], CaseWriter] = {}
        for av in avs:
            self._made(source, av)

    def ghosts(self, source: Source, stored: StoredCase) -> dict[str, Any]:
        """Let each reference driver take the AV's place in a case: `motion`, whether it `prevents`, when it `reacts_s`.

        Motion lasts until the recording ends or it is touched; times are since the begin of the test [s].
        """
        from cornerforge.analysis.avoidability import AvoidParams, WayOut
        from cornerforge.analysis.prevented import driven_by
        from cornerforge.report.cases import first_shown, ghost

        scenario = stored.scenario
        first, crash = first_shown(scenario), 0.0 if scenario.crash is None else scenario.crash.time
        params = AvoidParams(steers=bool(source.cases.identity.get("av_steers")))
        return {
            name: {
                "motion": ghost(scenario, WayOut(one.begin_s, *np.ascontiguousarray(one.track.T)), first),
                "prevents": one.prevented.prevented,
                "reacts_s": None if one.prevented.reacts_s is None else round(crash - one.prevented.reacts_s, 1),
            }
            for name, one in driven_by(scenario, params).items()
        }

    def with_av(self, source: Source, stored: StoredCase, av: str) -> Scenario:
        """Drive a case with another AV, the others as recorded.

        Raises:
            CornerForgeError: The AV is unknown or failed, or the library cannot be driven again.
        """
        script, driver = self._made(source, av)
        return driver.record(script(stored))[0]

    def _made(self, source: Source, av: str) -> tuple[Callable[[StoredCase], Script], ScriptDriver]:
        """Give what makes scripts of a source's cases, and what drives them with an AV."""
        from cornerforge.verbs.stored_cases import StoredScripts, run_with
        from cornerforge.world_options import WorldOptions

        key = source.name, av
        if key not in self._drivers:
            run = run_with(source.cases, WorldOptions(), av)
            self._drivers[key] = StoredScripts(source.cases, run).of, run.script_driver()
        return self._drivers[key]

    def export(self, source: Source, stored: StoredCase, to: str) -> Mapping[str, bytes]:
        """Give the files of a case in a format for other tools, by name.

        Raises:
            CornerForgeError: It cannot be written in that format.
        """
        key = source.name, to
        if key not in self._writers:
            self._writers[key] = CaseWriter(source.cases, to)
        with tempfile.TemporaryDirectory() as folder:
            names = self._writers[key].write(str(stored.scalars["case_id"]), stored, Path(folder))
            return {name: (Path(folder) / name).read_bytes() for name in names}
