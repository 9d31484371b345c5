"""Importing the published IVBSS arrays (Feng et al. 2021, 2023) as a naturalistic model.

Arrays in the files replace the tables of a base model. Missing arrays and states without data keep the base model's
values, counted and named. `docs/ivbss-arrays.md` describes the layout. No pickle is ever loaded.
"""

from __future__ import annotations

import importlib.metadata
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError
from cornerforge.ext.calibrate.ivbss_files import ROLES, check_array, find_arrays, load_array, load_coordinates
from cornerforge.ext.calibrate.ivbss_initial import fit_gaps, fit_speeds, speed_law
from cornerforge.ext.calibrate.ivbss_tables import (
    LAST_AXIS,
    Cells,
    cells_of,
    checked_cumulative,
    checked_rows,
    reduce_lane_changes,
    table_shape,
)
from cornerforge.ext.calibrate.tables import file_sha256
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel, model_hash
from cornerforge.results.naturalistic import ImportReport
from cornerforge.types import N_ACCELERATIONS

__all__ = ["import_arrays"]

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
    filled = _filled(files)
    model = replace(model, provenance=_provenance(files, filled, base))
    notes = [*_NOTES]
    if "lc_both" in files:
        notes.append("The lane-change table with both adjacent vehicles is compared with the product, not used.")
    return model, ImportReport(
        files=files, missing=tuple(role for role in ROLES if role not in files), filled=tuple(filled),
        unused=tuple(path.name for path in unused), notes=tuple(notes), model_hash=model_hash(model),
    )  # fmt: skip


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


def _accelerations(path: Path, own: NDArray[np.float32], role: str) -> tuple[NDArray[np.float32], dict[str, int]]:
    """Load the table of `path` onto our axes and fill its empty rows from `own`."""
    table = _shaped(path, *((_PUBLISHED, _FOLLOWING) if role == "following" else ((SPEEDS.size, N_ACCELERATIONS),)))
    rows, known, counts = checked_rows(path.name, table)
    if table.shape == _PUBLISHED:  # (gap, range rate, speed, acceleration)
        rows, known = np.moveaxis(rows, 2, 0), np.moveaxis(known, 2, 0)
    filled = np.where(known[..., None], rows, own)
    return np.ascontiguousarray(filled, dtype=np.float32), counts


def _shaped(path: Path, *shapes: tuple[int, ...]) -> Floats:
    array = load_array(path)
    if array.shape not in shapes:
        raise FileFormatError(f"{path} has shape {array.shape}; expected {' or '.join(map(str, shapes))}.")
    return np.asarray(array, dtype=np.float64)


def _with_initial(model: NddModel, paths: Mapping[str, Path]) -> tuple[NddModel, dict[str, dict[str, Any]]]:
    """Return the model with an initial state fitted to the cumulative tables."""
    initial, entries = model.initial, dict[str, dict[str, Any]]()
    speeds = speed_law(initial)
    if "initial_speed" in paths:
        (speeds,), counts = _cumulative(paths["initial_speed"], 1, (SPEEDS.size,))
        initial, found = fit_speeds(speeds, initial)
        entries["initial_speed"] = {"renormalised": counts["renormalised"], **found}
    if "initial_gap" in paths:
        shapes = (SPEEDS.size, _STATES), (SPEEDS.size, *_FOLLOWING[1:3])
        rows, counts = _cumulative(paths["initial_gap"], SPEEDS.size, *shapes)
        initial, found = fit_gaps(rows.reshape(_FOLLOWING[:3]), speeds, initial)
        entries["initial_gap"] = {**counts, **found}
    return replace(model, initial=initial), {role: _rounded(entry) for role, entry in entries.items()}


def _rounded(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Round numbers to 9 digits, so that the last bits of a sum do not change the bytes of the model file."""
    return {key: round(value, 9) if isinstance(value, float) else value for key, value in entry.items()}


def _cumulative(path: Path, rows: int, *shapes: tuple[int, ...]) -> tuple[Floats, dict[str, int]]:
    """Read cumulative probabilities as probabilities, (rows, k), with counts of the rows."""
    table, known, counts = checked_cumulative(path.name, _shaped(path, *shapes).reshape(rows, -1))
    if not known.any():
        raise FileFormatError(f"{path} is all zeros.")
    return table, counts


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


_NOTES = (
    "Lane changes are a product of base, desire and two acceptances; what the tables hold beyond that is lost (misfit: "
    "sum of |table - product| over the sum of the table).",
    "The initial state is a law of few parameters fitted to the tables (misfit: total variation distance).",
    "States without data are ours; the released code drives them by IDM and MOBIL.",
)


def _filled(files: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Name what comes from the base model."""
    filled = [f"{what} (no file)" for role, what in _OURS_WITHOUT.items() if role not in files]
    for role, entry in files.items():
        for key, what in (("empty", "row(s)"), ("speeds_filled", "speed(s)"), ("states_filled", "state(s)")):
            if entry.get(key) and role != "initial_gap":
                filled.append(f"{ROLES[role][0]}: {entry[key]} {what} without data")
    return filled + [f"{name} (in no published array)" for name in _NEVER_IN_FILES]


def _provenance(files: Mapping[str, Mapping[str, Any]], filled: list[str], base: NddModel) -> dict[str, object]:
    """Describe the model's origin, without times and folders, so that the same files give the same bytes."""
    return {
        "made_by": f"cornerforge {importlib.metadata.version('cornerforge')}",
        "attribution": _ATTRIBUTION,
        "licence": _LICENCE,
        "format": "ivbss",
        "files": [{"role": role, **entry} for role, entry in files.items()],
        "filled": filled,
        "filled_from": {"model_hash": model_hash(base), "attribution": base.provenance.get("attribution")},
    }
