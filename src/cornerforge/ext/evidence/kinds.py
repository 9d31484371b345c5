"""Natural crashes by kind: frequency, criticality and complexity, each by a rule that is stated beside it.

Complexity is counted in the last 5 s before the contact. A vehicle takes part if it is the AV or its partner, or acts
within 60 m of one of them. To act is to change lanes (its centre moves by 1 m or more across the road) or to brake by
2 m/s2 or more; both are judgements, as ISO 34505 leaves the measure to its user.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.recordings import Recordings, recordings_of_tracks
from cornerforge.report.judged import read_table
from cornerforge.report.kinds import kind_in_words
from cornerforge.results.analysis import Natural, NaturalKind
from cornerforge.results.evidence import KindOfCrash
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S

__all__ = ["HOW", "complexity", "kinds_of_crash"]

HOW = {
    "frequency": "Weighted natural crashes of the kind over the miles of the AV; interval of Fay and Feuer (1997).",
    "criticality": "Medians over the kind: TTC 1 s before contact and delta-v of the AV; mean chance of MAIS 3 "
    "or more by delta-v.",
    "complexity": "Means over the kind, in the last 5 s: vehicles that take part (AV, partner, and each that acts "
    "within 60 m of them), and their acts (a lane change, braking of 2 m/s² or more).",
}
"""How each is computed."""
_WINDOW = round(5.0 / FRAME_S)
_NEAR, _ACROSS, _HARD = 60.0, 1.0, -2.0
_MEASURES = ("ttc_1s_s", "av_delta_v_mps", "av_injury_probability")


def complexity(r: Recordings) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Count, case by case, the vehicles that take part in the last 5 s, and their acts.

    Args:
        r: C cases.

    Returns:
        Vehicles, at least 2 where there is a partner, and acts, both of shape (C,).
    """
    involved, acts = np.zeros(r.n_cases, np.int64), np.zeros(r.n_cases, np.int64)
    for c in range(r.n_cases):
        frames, vehicles = int(r.frames[c]), int(r.vehicles[c])
        span = slice(int(r.at[c]), int(r.at[c]) + frames * vehicles)
        last = int(np.clip(r.last[c], 0, frames - 1))
        window = slice(max(0, last + 1 - _WINDOW), last + 1)

        x, y, braking, present = (
            series[span].reshape(vehicles, frames)[:, window].astype(np.float64)
            for series in (r.x, r.y, r.acceleration, r.present)
        )
        there = present > 0.0
        y = np.where(there, y, np.nan)
        main = [0, int(r.partner[c])]
        apart = np.min([np.abs(along(x[one], x)) for one in main], axis=0)
        near = (there & (apart <= _NEAR)).any(axis=1)
        seen = there.any(axis=1)
        crossed = np.zeros(vehicles, np.bool_)
        crossed[seen] = np.nanmax(y[seen], axis=1) - np.nanmin(y[seen], axis=1) >= _ACROSS
        braked = (there & (braking <= _HARD)).any(axis=1)
        part = near & (crossed | braked)
        part[main] = True
        involved[c], acts[c] = part.sum(), (part & crossed).sum() + (part & braked).sum()
    return involved, acts


def kinds_of_crash(library: Path, analysis: Path, found: Natural, command: str) -> tuple[KindOfCrash, ...]:
    """Describe the natural crashes of a library, most frequent kind first.

    Args:
        library: The library of natural crashes.
        analysis: Folder of its analysis.
        found: How often its kinds happen (`report.road.on_road`).
        command: What writes the analysis again, for messages.

    Raises:
        FileFormatError: A file is missing or damaged.
    """
    from cornerforge.library import CaseLibrary
    from cornerforge.library.natural import natural_weights

    cases = CaseLibrary.open(library)
    weights = natural_weights(cases) or {}
    column = "mechanism" if found.mechanisms else "crash_type"
    table = read_table(analysis / "cases.parquet", ["case_id", column, "prevention", *_MEASURES], command)
    counted: dict[str, tuple[int, int]] = {}
    for rows, tracks in cases.shards():
        pairs = zip(*(one.tolist() for one in complexity(recordings_of_tracks(rows, tracks))), strict=True)
        counted |= dict(zip(rows.column("case_id").to_pylist(), pairs, strict=True))
    table["weight"] = [weights.get(case, 0.0) for case in table["case_id"]]
    table["involved"], table["acts"] = zip(*(counted.get(case, (0, 0)) for case in table["case_id"]), strict=True)
    kind, weight = np.array(table.pop(column), np.str_), np.array(table["weight"])
    return tuple(
        _kind(name, often, {one: np.array(values)[(kind == name) & (weight > 0.0)] for one, values in table.items()})
        for name, often in (found.mechanisms or found.crash_types).items()
    )


def _kind(name: str, often: NaturalKind, column: dict[str, NDArray[Any]]) -> KindOfCrash:
    from cornerforge.analysis.prevented import CAREFULLY, NOT_JUDGED

    weight, prevention = column["weight"], column["prevention"].astype(np.str_)
    judged, known = prevention != NOT_JUDGED, column["involved"] > 0
    low, high = often.interval95_miles

    def mean(values: NDArray[Any], some: NDArray[np.bool_]) -> float | None:
        return float(np.average(values[some], weights=weight[some])) if some.any() else None

    def median(one: str) -> float | None:
        return _median(column[one].astype(np.float64), weight)

    return KindOfCrash(
        kind=kind_in_words(name),
        cases=often.cases,
        per_million_miles=1e6 / often.miles_between,
        interval95=(1e6 / high if high > 0.0 else 0.0, 1e6 / low),
        prevented=mean(np.isin(prevention, CAREFULLY), judged),
        ttc_1s=median("ttc_1s_s"),
        delta_v=median("av_delta_v_mps"),
        serious=mean(column["av_injury_probability"].astype(np.float64), weight > 0.0),
        involved=mean(column["involved"], known),
        acts=mean(column["acts"], known),
    )


def _median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float | None:
    """Give the weighted median of the finite values; None where they carry less than half of the weight."""
    finite = np.isfinite(values)
    if not finite.any() or weights[finite].sum() < 0.5 * weights.sum():
        return None
    order = np.argsort(values[finite], kind="stable")
    passed = np.cumsum(weights[finite][order])
    return float(values[finite][order][np.searchsorted(passed, 0.5 * passed[-1])])
