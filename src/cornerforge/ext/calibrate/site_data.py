"""Tables of junctions, crossings and people, as `site fit` reads them, and how a part of each is kept apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import DataError
from cornerforge.ext.calibrate.resampling import resampled_weights
from cornerforge.ext.calibrate.tables import Table, read_header, read_table

__all__ = ["SITE_FILES", "SiteFile", "interval_of", "kept_apart", "owners", "quantiles", "read_site_data", "words"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_EVERY = 4
"""One in so many groups (drivers, signals, participants) is kept apart for the score."""
_DRAWS = 200
"""Resamples of whole groups behind an interval."""


@dataclass(frozen=True)
class SiteFile:
    """One file that is read.

    Attributes:
        name: Its name without .csv or .csv.gz.
        what: What it holds, in words.
        credit: Whose it is, and its licence.
        numbers, texts: Its columns, in small letters.
        blanks: Numbers may be missing in its rows.
    """

    name: str
    what: str
    credit: str
    numbers: tuple[str, ...]
    texts: tuple[str, ...]
    blanks: bool = False


_UTAH = "Singleton, Mekker, Gaither, Subedi and Islam 2023, CC BY 4.0"
SITE_FILES = (
    SiteFile(
        "ngsim_lankershim_clips", "vehicles on Lankershim Boulevard, 10 Hz", "NGSIM, US DOT FHWA",
        ("t", "x", "y", "heading", "v", "length"), ("scenario", "id"),
    ),
    SiteFile(
        "utah_right_turn_conflicts", "right-turning vehicles against people, Utah", f"{_UTAH} (UDOT-20.312)",
        ("encroachment_time",), ("signal.id", "pedcp_ped", "ped.reaction"),
    ),
    SiteFile(
        "utah_ped_crossings", "people at signals, Utah", f"{_UTAH} (UDOT-20.313)",
        ("crossdist", "cross_sec", "vehiclesnext10", "timewaitclean", "timecurbdep_sec_next_walk"),
        ("signal", "otherbicycle", "crossbehspeed", "timewaitarr_ped_status", "timecurbdep_ped_status"), True,
    ),
    SiteFile(
        "dfki_street_crossing", "crossings in virtual reality, Germany and Japan", "DFKI, CC BY 4.0, adapted",
        ("s_cargap_near_largestmissed", "s_cargap_near_taken", "n_time", "stepbacks"),
        ("country", "vpn", "trialtype", "environment", "dropout", "timeout", "collision"), True,
    ),
    SiteFile("dut_pet_events", "vehicles and people on a campus, Dalian", "Yang et al. 2019 (DUT)", ("dt",), ("clip",)),
    SiteFile(
        "jaad_pedestrians", "people seen from dashcams", "JAAD: Rasouli, Kotseruba and Tsotsos, MIT",
        ("crossing",), ("video", "vehicle_action_1s_before"),
    ),
)  # fmt: skip
"""Files that `site fit` reads of a folder; each may be missing, plain or packed with gzip."""


def read_site_data(folder: Path) -> dict[str, Table]:
    """Read the files of `SITE_FILES` that a folder has.

    Returns:
        Name of the file without ending -> its columns. A missing file has no entry.

    Raises:
        DataError: There is no such folder, it has none of the files, or one is damaged or lacks a column.
    """
    if not folder.is_dir():
        raise DataError(f"No folder {folder}; name the one with {SITE_FILES[0].name}.csv.gz and the others.")
    found = {}
    for file in SITE_FILES:
        path = next((p for end in (".csv", ".csv.gz") if (p := folder / f"{file.name}{end}").exists()), None)
        if path is not None:
            found[file.name] = _read(path, file)
    if not found:
        names = ", ".join(file.name for file in SITE_FILES)
        raise DataError(f"{folder} has none of the files that laws are fitted to: {names} (.csv or .csv.gz).")
    return found


def _read(path: Path, file: SiteFile) -> Table:
    missing = sorted({*file.numbers, *file.texts} - set(read_header(path)))
    if missing:
        raise DataError(f"{path} lacks {', '.join(missing)}; is it {file.what}?")
    table = read_table(path, {name: (name, 1.0) for name in file.numbers}, {name: name for name in file.texts})
    faults = [(f"{count} row(s) with {why}", line) for why, (count, line) in table.bad.reasons.items()]
    for name in () if file.blanks else file.numbers:
        faults += [(f"{name} is no number", int(line)) for line in table.line[np.isnan(table.numbers[name])][:1]]
    if faults:
        raise DataError(f"{path}: {faults[0][0]}, first in line {faults[0][1]}; fetch it again.")
    return table


def words(table: Table, name: str) -> NDArray[np.str_]:
    """Give a column of texts, shape (n,); "" where the file has none."""
    return np.array([*table.labels[name], ""])[table.texts[name]]


def owners(*columns: NDArray[Any]) -> Ints:
    """Number the groups that rows belong to, 0, 1, ... in the order of their names: columns (n,) each, to (n,)."""
    joined = np.array(["\t".join(map(str, row)) for row in zip(*columns, strict=True)])
    return np.unique(joined, return_inverse=True)[1].astype(np.int64)


def kept_apart(owner: Ints) -> Bools:
    """Say which rows belong to a group that is kept apart from a fit whose score is reported, (n,) to (n,)."""
    return np.asarray(owner % _EVERY == _EVERY - 1)


def interval_of(value: Callable[[Floats], Any], groups: int) -> Floats:
    """Compute 95 % intervals by resampling whole groups, with a fixed seed.

    Args:
        value: From how often each group counts, shape (groups,), to a number or k of them.
        groups: How many there are.

    Returns:
        Low and high, shape (2,) or (2, k); a resample without a value (NaN) does not count.
    """
    drawn = resampled_weights(groups)[:_DRAWS]
    return np.asarray(np.nanpercentile(np.array([value(row) for row in drawn], np.float64), [2.5, 97.5], axis=0))


def quantiles(values: Floats, weights: Floats, shares: Sequence[float]) -> Floats:
    """Quantiles of weighted values: the smallest value that a share of the weight does not exceed.

    Args:
        values, weights: Shape (n,), weights of at least 0 and not all 0.
        shares: k of them, in [0, 1].
    """
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    places = np.searchsorted(reached, np.asarray(shares) * reached[-1] - 1e-9)
    return np.asarray(values[order][np.minimum(places, values.size - 1)])
