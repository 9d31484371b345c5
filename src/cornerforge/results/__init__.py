"""Results of verbs: classes of declared fields (`html.Result`) that say unit and meaning, the keys of `--json`.

A field's name is its key, and the order of fields is that of the keys; a class that is made of others has the fields of
the last of its bases first. `as_json` makes from them what `--json` prints; docs/results-json.md is made of them, too.
The package gives what verbs return; the modules hold the parts of it, and all their names without an underscore are
for others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.results.analysis import Analysed
    from cornerforge.results.avs import AvChecked, Avs
    from cornerforge.results.cases import Plausibility, Queried, Replayed, ShrunkLibrary, Varied
    from cornerforge.results.driving import Filled, NaturalRate, Simulated
    from cornerforge.results.imported import CasesFromData, ImportedCases
    from cornerforge.results.learning import Trained, TrainedAv
    from cornerforge.results.naturalistic import NddFitted, NddImported, NddShown
    from cornerforge.results.r157 import Regulated
    from cornerforge.results.reproduction import Reproduced
    from cornerforge.results.retest import Retested
    from cornerforge.results.roads import RoadTold
    from cornerforge.results.site_laws import SiteFitted, SiteValidated
    from cornerforge.results.sites import SiteTold
    from cornerforge.results.stating import as_json, from_json
    from cornerforge.results.suite import SuiteBuilt
    from cornerforge.results.validation import NddValidated
    from cornerforge.results.whole import (
        Exported,
        Figured,
        Initialised,
        Migrated,
        Reported,
        RunDone,
        Served,
        Verified,
    )

__all__ = [
    "Analysed",
    "AvChecked",
    "Avs",
    "CasesFromData",
    "Exported",
    "Figured",
    "Filled",
    "ImportedCases",
    "Initialised",
    "Migrated",
    "NaturalRate",
    "NddFitted",
    "NddImported",
    "NddShown",
    "NddValidated",
    "Plausibility",
    "Queried",
    "Regulated",
    "Replayed",
    "Reported",
    "Reproduced",
    "Retested",
    "RoadTold",
    "RunDone",
    "Served",
    "ShrunkLibrary",
    "Simulated",
    "SiteFitted",
    "SiteTold",
    "SiteValidated",
    "SuiteBuilt",
    "Trained",
    "TrainedAv",
    "Varied",
    "Verified",
    "as_json",
    "from_json",
]

_PLACES = {
    "analysis": ("Analysed",), "avs": ("AvChecked", "Avs"),
    "cases": ("Plausibility", "Queried", "Replayed", "ShrunkLibrary", "Varied"),
    "driving": ("Filled", "NaturalRate", "Simulated"), "imported": ("CasesFromData", "ImportedCases"),
    "learning": ("Trained", "TrainedAv"), "naturalistic": ("NddFitted", "NddImported", "NddShown"),
    "r157": ("Regulated",), "roads": ("RoadTold",), "site_laws": ("SiteFitted", "SiteValidated"),
    "sites": ("SiteTold",),
    "reproduction": ("Reproduced",), "retest": ("Retested",),
    "stating": ("as_json", "from_json"), "suite": ("SuiteBuilt",), "validation": ("NddValidated",),
    "whole": (
        "Exported", "Figured", "Initialised", "Migrated", "Reported", "RunDone", "Served", "Verified",
    ),
}  # fmt: skip
"""By module, the names that it gives. A start pays only for the classes that it needs: making all takes 0.15 s."""

__getattr__ = door("cornerforge.results", {name: module for module, names in _PLACES.items() for name in names})
