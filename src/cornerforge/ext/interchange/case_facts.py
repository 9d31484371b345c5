"""Facts of a stored case besides its motion, for the metadata of files for other tools."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cornerforge.analysis.stored import CASES_FILE, read_analysed
from cornerforge.experiment.output import config_hash, version
from cornerforge.ext.interchange.beside import analysis_beside
from cornerforge.library import CaseLibrary, StoredCase
from cornerforge.library.filling import MODEL_FILE
from cornerforge.library.natural import natural_weights
from cornerforge.library.out_case import Fact, OutCase
from cornerforge.ndd.model import load_model
from cornerforge.report.artefacts import per_billion_miles

__all__ = ["CaseFacts"]

_OF_RUN = ("av", "av_hash", "bv", "odd", "model_hash", "policy_hash", "code")
_OF_CASE = ("crash_time_s", "impact_speed_difference_mps", "log_prob_nde", "shortfall_nats", "n_implausible")
_ANALYSED = (
    "crash_type", "prevented_by", "held_speed_prevents", "fault", "fault_rule", "conduct", "avoidability",
    "impact_speed_mps", "av_injury_probability", "value",
)  # fmt: skip


class CaseFacts:
    """Knows the facts of a library's cases; what an analysis beside it says is read once.

    Args:
        cases: The library; its path must have a name.
    """

    def __init__(self, cases: CaseLibrary) -> None:
        self._run: dict[str, Fact] = {
            "made_by": f"cornerforge {version()}",
            "library_hash": config_hash(cases.identity),
            **{name: cases.identity[name] for name in _OF_RUN if cases.identity.get(name) is not None},
            "licence_of_the_model": _licence(cases.path / MODEL_FILE),
        }
        self._analysed = _analysed(analysis_beside(cases))
        weights = natural_weights(cases) or {}
        per_billion = per_billion_miles(cases)
        self._often = {case: weight * per_billion for case, weight in weights.items()}

    def of(self, case_id: str, stored: StoredCase) -> dict[str, Fact]:
        """Give the facts of a case; unknown ones are left out, except the frequency (None)."""
        scalars = {name: stored.scalars.get(name) for name in _OF_CASE}
        found = {**scalars, **self._analysed.get(case_id, {})}
        return {
            "case": case_id,
            **self._run,
            "crashes_per_billion_miles_it_stands_for": self._often.get(case_id),
            **{name: _fact(value) for name, value in found.items() if value is not None},
        }

    def out_case(self, case_id: str, stored: StoredCase) -> OutCase:
        """Make what writers take of a case."""
        return OutCase(f"case-{case_id.replace(':', '-')}", stored.scenario, self.of(case_id, stored))


def _fact(value: Any) -> Fact:
    """Say an infinite number in words: files of others cannot hold it."""
    return "infinite" if isinstance(value, float) and not math.isfinite(value) else value


def _licence(model: Path) -> str | None:
    """Look up what the licence of the naturalistic model's data is; None: the library does not say."""
    if not os.path.lexists(model):
        return None
    said = load_model(model).provenance.get("licence")
    return None if said is None else str(said)


def _analysed(folder: Path | None) -> Mapping[str, dict[str, Any]]:
    """Read what an analysis says of each case; nothing without one."""
    if folder is None:
        return {}
    table = read_analysed(folder / CASES_FILE, "cornerforge analyse", ("case_id", *_ANALYSED), fewer=True)
    return {row.pop("case_id"): row for row in table.to_pylist()}
