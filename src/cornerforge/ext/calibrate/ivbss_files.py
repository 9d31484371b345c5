"""Finding and reading the published IVBSS arrays on disk; no pickle is ever loaded.

Names, axes and meanings come from the data in folder `NDD_DATA` of the released code of Feng et al. (NADE, Nature
Communications 12:748, 2021; D2RL, Nature 615:620, 2023). `docs/ivbss-arrays.md` lists them.
"""

from __future__ import annotations

import pickle
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._checksums import UNREADABLE
from cornerforge._words import shown
from cornerforge.errors import FileFormatError

__all__ = ["ROLES", "Coordinates", "check_array", "find_arrays", "load_array", "load_coordinates"]

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


ROLES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "following": ("car following", (r"Optimized_CF_pdf_array\.npy", r"CF_pdf_array\.npy")),
    "free": ("free flow", (r"Optimized_FF_pdf_array\.npy", r"FF_pdf_array\.npy")),
    "lc_alone": (
        "lane change, no adjacent vehicle",
        (r"(.*_)?OL_pdf.*\.npz", r"(.*_)?OL_pdf.*\.npy", r"Lane_change_no_adjacent_vehicle_pdf\.np[yz]"),
    ),
    "lc_lead": (
        "lane change, an adjacent vehicle ahead",
        (r"(.*_)?SLC_pdf.*\.npz", r"(.*_)?SLC_pdf.*\.npy", r"Lane_change_one_adjacent_vehicle_pdf\.np[yz]"),
    ),
    "lc_rear": (
        "lane change, an adjacent vehicle behind",
        (r"(.*_)?CI_pdf.*\.npz", r"(.*_)?CI_pdf.*\.npy", r"Lane_change_cut-in_pdf\.np[yz]"),
    ),
    "lc_both": (
        "lane change, adjacent vehicles ahead and behind",
        (r"(.*_)?DLC_pdf.*\.npz", r"(.*_)?DLC_pdf.*\.npy", r"Lane_change_two_adjacent_vehicles_pdf\.np[yz]"),
    ),
    "initial_speed": ("speeds at the start", (r"speed_CDF\.npy",)),
    "initial_gap": (
        "gaps and range rates at the start",
        (r"Optimized_presum_list_forward\.npy", r"presum_list_forward\.npy"),
    ),
}
"""The known arrays by our names: meaning in words, and regular expressions of file names, the preferred one first."""

_ENDINGS = (".npy", ".npz", ".pkl", ".pickle")


def find_arrays(folder: Path) -> tuple[dict[str, Path], list[Path]]:
    """Find the file below `folder` that holds each array.

    Returns:
        Role -> file, and the files that are not used because a preferred file holds the same array.

    Raises:
        FileFormatError: No folder, no known array in it, two files for one array, or an array given as a pickle.
    """
    if not folder.is_dir():
        raise FileFormatError(f"No folder {folder}; name the one that holds the arrays (NDD_DATA, or one above it).")
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _ENDINGS and path.is_file())
    taken: dict[str, Path] = {}
    left: list[Path] = []
    for role, (about, patterns) in ROLES.items():
        for pattern in patterns:
            fits = [path for path in files if re.fullmatch(pattern, path.name)]
            if role in taken:
                left += fits
            elif len(fits) > 1:
                raise FileFormatError(
                    f"{folder} holds {len(fits)} files for {about}: {_names(fits, folder)}; leave one there."
                )
            elif fits:
                taken[role] = fits[0]
        if role not in taken:
            _refuse_pickles(files, patterns)
    if not taken:
        wanted = "Optimized_CF_pdf_array.npy, Optimized_FF_pdf_array.npy, ..._OL_pdf....npz, speed_CDF.npy"
        raise FileFormatError(f"{folder} holds none of the published arrays (such as {wanted}).")
    return taken, [path for path in left if path not in taken.values()]


def _refuse_pickles(files: Sequence[Path], patterns: Sequence[str]) -> None:
    stems = [pattern.rsplit(r"\.", 1)[0] for pattern in patterns]
    for path in files:
        if path.suffix.lower() in (".pkl", ".pickle") and any(re.fullmatch(stem, path.stem) for stem in stems):
            raise _needs_pickle(path)


def _names(paths: Sequence[Path], folder: Path) -> str:
    return ", ".join(str(path.relative_to(folder)) for path in paths)


def _needs_pickle(path: Path) -> FileFormatError:
    return FileFormatError(
        f"{path} is a pickle, or an array of Python objects; it is not loaded, as that can run any program. Where you "
        "trust it, convert it: numpy.save(NEW, numpy.asarray(numpy.load(OLD, allow_pickle=True), dtype=float))."
    )


def load_array(path: Path) -> NDArray[np.number]:
    """Open the array of a `.npy` file; its values stay on disk until they are read.

    Raises:
        FileFormatError: Damaged, no array of numbers, or a pickle.
    """
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (*UNREADABLE, pickle.UnpicklingError) as error:
        raise _unreadable(path, error) from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise FileFormatError(f"{path} holds no array of numbers.")
    return array


def check_array(path: Path) -> None:
    """Check by its head that a file is an array, or arrays; its content is not read.

    Raises:
        FileFormatError: It is neither.
    """
    if path.suffix != ".npz":
        load_array(path)
    elif not zipfile.is_zipfile(path):
        raise FileFormatError(f"{path} is damaged or no array; fetch it again.")


def _unreadable(path: Path, error: Exception) -> FileFormatError:
    hints = ("allow_pickle", "Object arrays", "Python objects")  # how NumPy says it
    if isinstance(error, pickle.UnpicklingError) or any(hint in str(error) for hint in hints):
        return _needs_pickle(path)
    return FileFormatError(f"{path} is damaged or no array ({error}); fetch it again.")


class Coordinates(NamedTuple):
    """An array by its entries that are not 0.

    Attributes:
        shape: Shape of the array.
        place: Flat index over all axes but the last, shape (k,).
        last: Index along the last axis, shape (k,).
        value: The entries, shape (k,).
    """

    shape: tuple[int, ...]
    place: Ints
    last: Ints
    value: Floats


def load_coordinates(path: Path, shape: tuple[int, ...], lengths: Sequence[int]) -> Coordinates:
    """Load a lane-change table, stored whole (`.npy`) or as a coordinate list (`.npz`).

    Args:
        path: The file. A coordinate list holds `coords`, integers (axes, k), `data`, (k,), and perhaps `shape` and
            `fill_value` (0): what the package `sparse` writes.
        shape: All axes but the last.
        lengths: Allowed lengths of the last axis.

    Raises:
        FileFormatError: Damaged, a pickle, another shape, or another kind of sparse array.
    """
    return _from_list(path, shape, lengths) if path.suffix == ".npz" else _from_whole(path, shape, lengths)


def _check_shape(path: Path, found: tuple[int, ...], shape: tuple[int, ...], lengths: Sequence[int]) -> None:
    if found[:-1] != shape or found[-1] not in lengths:
        wanted = " or ".join(str((*shape, length)) for length in lengths)
        raise FileFormatError(f"{path} has shape {found}; expected {wanted}.")


def _from_whole(path: Path, shape: tuple[int, ...], lengths: Sequence[int]) -> Coordinates:
    array = load_array(path)
    if array.ndim != len(shape) + 1:
        raise FileFormatError(f"{path} has {array.ndim} axes; expected {len(shape) + 1}.")
    _check_shape(path, array.shape, shape, lengths)
    places, lasts, values = [], [], []
    slab_size = int(np.prod(shape[1:]))
    for i in range(shape[0]):  # one speed after another: a whole table of six axes takes gigabytes
        slab = np.asarray(array[i], dtype=np.float64).reshape(slab_size, -1)
        place, last = np.nonzero(slab)  # NaN is not 0
        places.append(place + i * slab_size)
        lasts.append(last)
        values.append(slab[place, last])
    return Coordinates(array.shape, np.concatenate(places), np.concatenate(lasts), np.concatenate(values))


def _from_list(path: Path, shape: tuple[int, ...], lengths: Sequence[int]) -> Coordinates:
    try:
        # With a damaged file np.load would leave the handle open.
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            parts = {name: file[name] for name in ("coords", "data", "shape", "fill_value") if name in file.files}
    except (*UNREADABLE, pickle.UnpicklingError) as error:
        raise _unreadable(path, error) from error
    if "coords" not in parts or "data" not in parts:
        raise FileFormatError(
            f"{path} is no coordinate list (it needs arrays coords and data); save it again in coordinate form with "
            "the package sparse."
        )
    coords, data = parts["coords"], parts["data"]
    if coords.ndim != 2 or data.ndim != 1 or coords.shape != (len(shape) + 1, data.size):
        raise FileFormatError(
            f"{path}: coords has shape {coords.shape} and data {data.shape}; expected ({len(shape) + 1}, k) and (k,)."
        )
    if coords.dtype.kind not in "iu" or data.dtype.kind not in "fiu":
        raise FileFormatError(f"{path}: coords must be whole numbers and data numbers.")
    fill, whole = parts.get("fill_value", np.zeros(())), parts.get("shape", np.array((*shape, lengths[0])))
    if fill.size != 1 or fill.dtype.kind not in "fiu" or fill.item() != 0:
        raise FileFormatError(f"{path}: fill_value is {shown(fill.tolist())}; only lists of what is not 0 can be read.")
    if whole.ndim != 1 or whole.dtype.kind not in "iu":
        raise FileFormatError(f"{path}: shape is {shown(whole.tolist())}; it must be whole numbers.")
    found = tuple(whole.tolist())
    if len(found) != len(shape) + 1:
        raise FileFormatError(f"{path} has {len(found)} axes; expected {len(shape) + 1}.")
    _check_shape(path, found, shape, lengths)
    outside = ((coords < 0) | (coords >= np.array(found)[:, None])).any(axis=0)
    if outside.any():
        raise FileFormatError(
            f"{path}: {int(outside.sum())} of {data.size} coordinates lie outside {found}, first number "
            f"{int(np.argmax(outside))}."
        )
    place = np.zeros(data.size, dtype=np.int64)
    for axis, length in enumerate(shape):
        place = place * length + coords[axis].astype(np.int64)
    return Coordinates(found, place, coords[-1].astype(np.int64), data.astype(np.float64))
