"""`verify` reads all files of cornerforge at a place and says which of them are not as they were written."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from safetensors import SafetensorError, safe_open

from cornerforge._checksums import NoChecksumError, read_arrays, read_json, read_tensors
from cornerforge._files import check_regular
from cornerforge._locks import is_lock
from cornerforge._options import verb
from cornerforge._table_checks import read_parquet
from cornerforge.adversary.checkpoint import CHECKPOINT_KEY
from cornerforge.errors import CornerForgeError, FileFormatError, InputError
from cornerforge.experiment.av_file import load_av
from cornerforge.experiment.policy_file import load_policy
from cornerforge.library import CaseLibrary
from cornerforge.library.manifest import MANIFEST
from cornerforge.ndd.model import load_model
from cornerforge.results.whole import DamagedFile, Verified
from cornerforge.verbs.options.cases import Verify

__all__ = ["verify"]

_STAGE = "verify"
_NOT_OURS = object()
"""What a reader gives of a file that another program wrote."""


@verb(Verify, writes=False)
def verify(options: Verify) -> Verified:
    """Check that files of cornerforge are as they were written, and that what they hold can be.

    Checksums are compared, and values with what the formats allow (docs/formats.md). Pages, pictures, films, logs and
    files for other tools are not read; they are counted.

    Raises:
        InputError: There is nothing at a path.
    """
    given = [Path(path) for path in ([options.paths] if isinstance(options.paths, (str, Path)) else options.paths)]
    places: list[Path] = []
    for path in given:
        if not path.exists():
            raise InputError(f"There is nothing at {path}; name a file or a folder.")
        inside = (one for one in path.rglob("*") if not (one.is_dir() or is_lock(one.name)))
        places += sorted(inside) if path.is_dir() else [path]
    places = [place for place in dict.fromkeys(places) if not _is_of_library(place)]
    whole, other = 0, 0
    damaged: list[DamagedFile] = []
    without: list[str] = []
    for done, place in enumerate(places):
        options.progress(_STAGE, done, len(places))
        found = list(_checked(place))
        other += not found
        for file, fault, has_checksum in found:
            if fault is not None:
                damaged.append(DamagedFile(file=str(file), fault=fault))
            elif has_checksum:
                whole += 1
            else:
                without.append(str(file))
    options.progress(_STAGE, len(places), len(places))
    return Verified(whole=whole, without_checksum=tuple(without), damaged=tuple(damaged), other=other)


def _is_of_library(place: Path) -> bool:
    """Is it a shard of a library, which is read with the library's manifest?"""
    return place.suffix == ".parquet" and (place.parent / MANIFEST).is_file()


def _checked(place: Path) -> Iterator[tuple[Path, str | None, bool]]:
    """Check a file, or a library by its manifest; nothing for a file of another kind.

    Yields:
        The file, what is wrong with it, and whether it carries a checksum.
    """
    if place.name == MANIFEST:
        yield from _checked_library(place.parent)
        return
    reader = _READERS.get(place.suffix)
    if reader is None or place.name.startswith("."):
        return
    try:
        if reader(place) is not _NOT_OURS:
            yield place, None, True
    except NoChecksumError:
        yield place, None, False
    except CornerForgeError as error:
        yield place, str(error).removeprefix(f"{place}: "), True


def _checked_library(folder: Path) -> Iterator[tuple[Path, str | None, bool]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # each file of it is said below
        try:
            library = CaseLibrary.open(folder)
        except NoChecksumError:
            yield folder / MANIFEST, None, False
            return
        except CornerForgeError as error:
            yield folder / MANIFEST, str(error), True
            return
    yield folder / MANIFEST, None, True
    for name, fault in library.faults():
        yield folder / name, fault, True


def _read_tensors(place: Path) -> object:
    """Read a policy, a learned AV, or an unfinished training; `_NOT_OURS` for weights of another program.

    Raises:
        FileFormatError: It is damaged.
    """
    try:
        check_regular(place)
        with safe_open(place, framework="numpy") as file:
            keys = set(file.metadata() or {})
    except (SafetensorError, OSError) as error:
        raise FileFormatError(f"{place} is damaged ({error}); restore it from a copy, or make it again.") from error
    for key, load in _TENSORS.items():
        if key in keys:
            return load(place)
    return _NOT_OURS


def _read_arrays(place: Path) -> None:
    """Read a model, or trees of `rate`."""
    if "header" in read_arrays(place, "file"):
        load_model(place)


def _read_json(place: Path) -> None:
    read_json(place, "make it again")


_TENSORS: dict[str, Callable[[Path], object]] = {
    "cornerforge": load_policy,
    "cornerforge_av": load_av,
    CHECKPOINT_KEY: lambda place: read_tensors(place, CHECKPOINT_KEY, "checkpoint"),
}
_READERS: dict[str, Callable[[Path], object]] = {
    ".json": _read_json,
    ".npz": _read_arrays,
    ".safetensors": _read_tensors,
    ".checkpoint": _read_tensors,
    ".parquet": lambda place: read_parquet(place, "cornerforge analyse"),
}
