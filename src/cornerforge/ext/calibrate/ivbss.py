"""Importing the published IVBSS arrays (Feng et al. 2021, 2023) as a naturalistic model.

Arrays in the files replace the tables of a base model. Missing arrays and states without data keep the base model's
values, counted and named. `docs/ivbss-arrays.md` describes the layout. No pickle is ever loaded.
"""

from __future__ import annotations

import importlib.metadata
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError
from cornerforge.ext.calibrate.ivbss_files import ROLES, check_array, find_arrays, load_array, load_coordinates
from cornerforge.ext.calibrate.ivbss_initial import fit_gaps, fit_speeds, speed_law
from cornerforge.ext.calibrate.ivbss_lane_change import LAST_AXIS, Cells, cells_of, reduce_lane_changes, table_shape
from cornerforge.ext.calibrate.ivbss_rows import checked_cumulative, checked_rows
from cornerforge.ext.calibrate.tables import file_sha256
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel, model_hash
from cornerforge.types import N_ACCELERATIONS

__all__ = ["ImportReport", "import_arrays"]

Floats = NDArray[np.float64]

_FOLLOWING = (SPEEDS.size, GAPS.size, RANGE_RATES.size, N_ACCELERATIONS)
_PUBLISHED = (GAPS.size, RANGE_RATES.size, SPEEDS.size, N_ACCELERATIONS)
_STATES = GAPS.size * RANGE_RATES.size
_ATTRIBUTION = "IVBSS (UMTRI), arrays published with Feng et al. 2021 (doi:10.1038/s41467-021-21007-8) and 2023"
_LICENCE = "as stated by the publisher of the arrays; not checked"
_OVERLOOK = 1e-4
_NEVER_IN_FILES = (
    "initial.follow_share",
    "initial.min_ttc",
    "initial.free_gap_low",
    "initial.free_gap_high",
    "lc_desire_free",
    "overlook",
    "overlook_conflict",
)
"""Parts of a model that no published array holds; the released code has some as constants (following share 0.682)."""


@dataclass(frozen=True)
class ImportReport:
    """The source of each part of an imported model.

    Attributes:
        files: For each array found: `name`, `sha256`, and its treatment (rows, empty, renormalised, filled, misfit; see
            `ivbss_rows`, `ivbss_lane_change`, `ivbss_initial`).
        missing: Arrays that no file holds; what depends on them comes from the base model.
        filled: Everything that comes from the base model, in plain words.
        unused: Files that were not used because a preferred file holds the same array.
        notes: What a reader must know, one plain sentence each.
    """

    files: Mapping[str, Mapping[str, Any]]
    missing: tuple[str, ...]
    filled: tuple[str, ...]
    unused: tuple[str, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """All fields, JSON-compatible."""
        return {
            "files": {role: dict(entry) for role, entry in self.files.items()},
            "missing": list(self.missing),
            "filled": list(self.filled),
            "unused": list(self.unused),
            "notes": list(self.notes),
        }


def import_arrays(
    folder: Path, base: NddModel, progress: Callable[[str], None] | None = None
) -> tuple[NddModel, ImportReport]:
    """Make a model from the arrays below a folder; the same files give the same model, to the bit.

    Args:
        folder: `NDD_DATA` of the released data, one above it, or any folder with files of these names.
        base: Model that fills missing tables.
        progress: Called with a sentence on each step of the work.

    Returns:
        The model, and the source of each of its parts.

    Raises:
        FileFormatError: No array is found, or one is damaged, a pickle, of another shape, or holds no probabilities.
    """
    tell = progress or (lambda _: None)
    base = _as_theirs(base)
    paths, unused = find_arrays(folder)
    files: dict[str, dict[str, Any]] = {}
    for role, path in paths.items():
        check_array(path)  # a wrong file may have any size
        tell(f"Hashing {path.name}")
        files[role] = {"name": path.name, "sha256": file_sha256(path)}
    accelerations = {"following": base.following, "free": base.free}
    for role in [role for role in accelerations if role in paths]:
        tell(f"Reading {paths[role].name}")
        accelerations[role], counts = _accelerations(paths[role], accelerations[role], role)
        files[role] |= counts
    model = replace(base, following=accelerations["following"], free=accelerations["free"])
    cells: dict[str, Cells] = {}
    for role in ("lc_alone", "lc_lead", "lc_rear", "lc_both"):
        if role in paths:
            tell(f"Reading {paths[role].name}")
            path = paths[role]
            cells[role] = cells_of(path.name, load_coordinates(path, table_shape(role), LAST_AXIS))
    model, found = reduce_lane_changes(model, cells)
    for role, entry in found.items():
        files[role] |= {**cells[role].counts, **_rounded(entry)}
    tell("Fitting the initial state")
    model, entries = _with_initial(model, paths)
    for role, numbers in entries.items():
        files[role] |= numbers
    report = _report(files, [path.name for path in unused])
    return replace(model, provenance=_provenance(report, base)), report


def _as_theirs(base: NddModel) -> NddModel:
    """Take out of a model what the authors' drivers do not have.

    That is memory, desired speeds, streams, turning back, and lengths of lane changes, indicators, noise levels and
    vigilance of their own. Their initial speeds and time gaps come from one driver after the other, so speeds within a
    test spread as over all drivers. Drivers that never turn back may not overlook more than one neighbour in 10,000.
    """
    start = base.initial
    initial = replace(
        start,
        stream_sd=0.0,
        speed_sd=math.hypot(start.stream_sd, start.speed_sd),
        time_gap_shift=0.0,
        time_gap_median=start.time_gap_shift + start.time_gap_median,
        desire_share=0.0,
        habit_spread=1.0,
        change_median=0.0,
        signal_share=1.0,
        noise_spread=0.0,
        vigilance_sigma=0.0,
    )
    return replace(
        base, free_pull=0.0, memory=Memory(), lc_turn_back=np.zeros_like(base.lc_turn_back), initial=initial,
        overlook=min(base.overlook, _OVERLOOK),
    )  # fmt: skip


def _accelerations(path: Path, own: NDArray[np.float32], role: str) -> tuple[NDArray[np.float32], Mapping[str, int]]:
    """Load the table of `path` onto our axes and fill its empty rows from `own`."""
    array = load_array(path)
    shapes = (_PUBLISHED, _FOLLOWING) if role == "following" else ((SPEEDS.size, N_ACCELERATIONS),)
    if array.shape not in shapes:
        wanted = " or ".join(str(shape) for shape in shapes)
        raise FileFormatError(f"{path} has shape {array.shape}; expected {wanted}.")
    table = np.asarray(array, dtype=np.float64)
    rows, known, counts = checked_rows(path.name, table)
    if array.shape == _PUBLISHED:  # (gap, range rate, speed, acceleration)
        rows, known = np.moveaxis(rows, 2, 0), np.moveaxis(known, 2, 0)
    filled = np.where(known[..., None], rows, own)
    return np.ascontiguousarray(filled, dtype=np.float32), counts.to_json()


def _with_initial(model: NddModel, paths: Mapping[str, Path]) -> tuple[NddModel, dict[str, dict[str, Any]]]:
    """Return the model with an initial state fitted to the cumulative tables."""
    initial, entries = model.initial, dict[str, dict[str, Any]]()
    speeds = speed_law(initial)
    if "initial_speed" in paths:
        path = paths["initial_speed"]
        rows, known, counts = _cumulative(path, [(SPEEDS.size,)], 1)
        if not known.all():
            raise FileFormatError(f"{path} is all zeros.")
        speeds = rows[0]
        initial, found = fit_speeds(speeds, initial)
        entries["initial_speed"] = {"renormalised": counts["renormalised"], **found}
    if "initial_gap" in paths:
        path = paths["initial_gap"]
        rows, known, counts = _cumulative(path, [(SPEEDS.size, _STATES), (SPEEDS.size, *_FOLLOWING[1:3])], SPEEDS.size)
        if not known.any():
            raise FileFormatError(f"{path} is all zeros.")
        initial, found = fit_gaps(rows.reshape(_FOLLOWING[:3]), speeds, initial)
        entries["initial_gap"] = {**counts, **found}
    return replace(model, initial=initial), {role: _rounded(entry) for role, entry in entries.items()}


def _rounded(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Round numbers to 9 digits, so that the last bits of a sum do not change the bytes of the model file."""
    return {key: round(value, 9) if isinstance(value, float) else value for key, value in entry.items()}


def _cumulative(
    path: Path, shapes: list[tuple[int, ...]], rows: int
) -> tuple[Floats, NDArray[np.bool_], Mapping[str, int]]:
    array = load_array(path)
    if array.shape not in shapes:
        raise FileFormatError(f"{path} has shape {array.shape}; expected {' or '.join(str(s) for s in shapes)}.")
    table, known, counts = checked_cumulative(path.name, np.asarray(array, dtype=np.float64).reshape(rows, -1))
    return table, known, counts.to_json()


_OURS_WITHOUT = {
    "following": "following: all states",
    "free": "free flow: all speeds",
    "lc_alone": "lane changes: base chance and desire",
    "lc_lead": "lane changes: acceptance of the adjacent vehicle ahead",
    "lc_rear": "lane changes: acceptance of the adjacent vehicle behind",
    "initial_speed": "start: speeds",
    "initial_gap": "start: time gaps and range rates",
}
"""Parts from the base model if an array is missing; the table with both adjacent vehicles is only compared."""


def _report(files: Mapping[str, Mapping[str, Any]], unused: list[str]) -> ImportReport:
    missing = tuple(role for role in ROLES if role not in files)
    filled = [f"{_OURS_WITHOUT[role]} (no file)" for role in missing if role in _OURS_WITHOUT]
    for role, entry in files.items():
        for key, what in (("empty", "row(s)"), ("speeds_filled", "speed(s)"), ("states_filled", "state(s)")):
            if entry.get(key) and role != "initial_gap":
                filled.append(f"{ROLES[role].about}: {entry[key]} {what} without data")
    filled += [f"{name} (in no published array)" for name in _NEVER_IN_FILES]
    notes = [
        "Lane changes are a product of base, desire and two acceptances; what the tables hold beyond that is lost "
        "(misfit: sum of |table - product| over the sum of the table).",
        "The initial state is a law of few parameters fitted to the tables (misfit: total variation distance).",
        "States without data are ours; the released code drives them by IDM and MOBIL.",
    ]
    if "lc_both" in files:
        notes.append("The lane-change table with both adjacent vehicles is compared with the product, not used.")
    return ImportReport(files, missing, tuple(filled), tuple(unused), tuple(notes))


def _provenance(report: ImportReport, base: NddModel) -> dict[str, object]:
    """Describe the model's origin, without times and folders, so that the same files give the same bytes."""
    return {
        "made_by": f"cornerforge {importlib.metadata.version('cornerforge')}",
        "attribution": _ATTRIBUTION,
        "licence": _LICENCE,
        "format": "ivbss",
        "files": [{"role": role, **entry} for role, entry in report.files.items()],
        "filled": list(report.filled),
        "filled_from": {"model_hash": model_hash(base), "attribution": base.provenance.get("attribution")},
    }
