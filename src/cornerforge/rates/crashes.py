"""Natural crashes are driven again, recorded, classified, and summed up in tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.analysis.mechanism import MECHANISMS, crash_type_of, mechanism_of
from cornerforge.analysis.site_case import KINDS_AT_SITES
from cornerforge.experiment.experiments import Experiment
from cornerforge.rates.attention import action_chances, oversight
from cornerforge.results.driving import CrashCircumstances
from cornerforge.types import Scenario

__all__ = ["CrashStudy", "NaturalCrashes", "crash_tables", "kind_counts"]


@dataclass(frozen=True)
class CrashStudy:
    """Facts about one natural AV crash; also the extra columns of a library of natural crashes.

    Attributes:
        crash_type: A name of `CRASH_TYPES`.
        mechanism: A key of `MECHANISMS`.
        at_start: The crash came less than 4 s after the start of the test.
        rarest_chance: Smallest chance of an action of the crash partner in the last 5 s under the attentive model;
            None if it decided nothing.
        rare_action: `rarest_chance` is below 1e-3.
        overlooked: The partner began a lane change that more likely than not overlooked a neighbour.
        looked_away: The partner's driver looked away from the road in the last 5 s.
    """

    crash_type: str
    mechanism: str
    at_start: bool
    rarest_chance: float | None
    rare_action: bool
    overlooked: bool
    looked_away: bool

    def columns(self) -> dict[str, Any]:
        """Return the values by column name, as the library takes them."""
        return asdict(self)


class NaturalCrashes:
    """Recorder and classifier of the crashed tests of one run of natural traffic; serves one thread.

    Args:
        run: Natural traffic, no adversary.
        seed: Seed of the tests.
    """

    def __init__(self, run: Experiment, seed: int) -> None:
        self._run = run
        self._seed = seed
        self.recorder = run.recorder()
        """Holds the recording of the crash that was recorded last."""

    def record(self, test: int) -> tuple[Scenario, CrashStudy]:
        """Drive again a test that is known to end in an AV crash.

        Raises:
            InputError: The test does not end in an AV crash.
        """
        scenario = self.recorder.record(self._seed, test)
        mechanism = mechanism_of(scenario)
        setting = self._run.setting
        assert scenario.crash is not None  # mechanism_of has looked
        chances = action_chances(
            setting, self._run.slots, seed=self._seed, test=test, slot=scenario.crash.slot_b, step=self._run.stepper()
        )
        overlook = (0.0, 0.0) if setting.road.site.size else (setting.tables.overlook, setting.tables.overlook_conflict)
        eyes = oversight(chances, scenario.crash.time, *overlook)
        return scenario, CrashStudy(
            crash_type=crash_type_of(scenario)[0],
            mechanism=mechanism.name,
            at_start=mechanism.at_start,
            rarest_chance=eyes.rarest_chance,
            rare_action=eyes.rare_action,
            overlooked=eyes.overlooked,
            looked_away=eyes.looked_away,
        )


def crash_tables(studies: Iterable[Mapping[str, Any]], *, at_site: bool) -> dict[str, Any]:
    """Count crashes for the fields `crash_types`, `mechanisms` and `crash_circumstances` of `NaturalRate`.

    Args:
        studies: `CrashStudy.columns` of each crash.
        at_site: Kinds are those of sites.
    """
    rows = list(studies)
    seen = {one.name: sum(bool(row[one.name]) for row in rows) for one in fields(CrashCircumstances)}
    counts = kind_counts(((row["crash_type"], row["mechanism"]) for row in rows), at_site=at_site)
    return {**counts, "crash_circumstances": CrashCircumstances(**seen)}


def kind_counts(crashes: Iterable[tuple[str, str]], *, at_site: bool) -> dict[str, Any]:
    """Count crashes, each a type and a mechanism, for the fields `crash_types` and `mechanisms` of `NaturalRate`."""
    pairs = list(crashes)
    types, mechanisms = Counter(kind for kind, _ in pairs), Counter(mechanism for _, mechanism in pairs)
    names = KINDS_AT_SITES if at_site else MECHANISMS
    return {
        "crash_types": {name: types[name] for name in CRASH_TYPES.values()},
        "mechanisms": {name: mechanisms[name] for name in names},
    }
