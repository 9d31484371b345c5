"""Checksums that files carry over their own content, so that reading notices a changed value.

A JSON object carries the SHA-256 of its other keys, a file of arrays (`.npz`) one of each array, a file of weights
(safetensors) one of its header and weights. Tables have theirs in `_table_checks`. A checksum shows damage and edits by
hand. It is no signature: anyone can compute it.
"""

from __future__ import annotations

import hashlib
import io
import json
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cornerforge._files import check_regular, read_bytes, reason, writing
from cornerforge._schema import parse
from cornerforge.errors import FileFormatError

__all__ = [
    "KEY",
    "MIGRATE",
    "UNREADABLE",
    "NoChecksumError",
    "check_json",
    "json_checksum",
    "read_arrays",
    "read_json",
    "read_tensors",
    "weights_of",
    "with_checksum",
    "write_arrays",
    "write_tensors",
]

KEY = "sha256"
"""Key of the checksum in a JSON object."""
_MEMBER = "checksums"
"""Array of a file of arrays that holds the checksums of the others, as JSON text by name."""
_LARGEST = 1 << 28
"""Most bytes that the arrays of a file may unpack to, 40 times those of a model: a damaged header could ask for any."""

UNREADABLE = (
    OSError, KeyError, TypeError, ValueError, EOFError, MemoryError, OverflowError, RecursionError, RuntimeError,
    zipfile.BadZipFile, zlib.error, tokenize.TokenError,
)  # fmt: skip
"""Exceptions that `np.load` raises for a damaged file of arrays."""
_LARGEST_WEIGHT = 1e6

_Arrays = Mapping[str, NDArray[Any]]


MIGRATE = "bring it, or the folder that it lies in, to the present form with: cornerforge migrate OLD --out NEW"
"""Advice for files that an earlier version wrote."""


class NoChecksumError(FileFormatError):
    """A file carries no checksum: version 0.1 wrote it, or another program."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path} carries no checksum, so version 0.1 wrote it, or another program: {MIGRATE}.")


def json_checksum(content: Mapping[str, Any]) -> str:
    """Compute the SHA-256 (hex) of an object without its key `KEY`; spaces, line ends and the order of keys are free.

    >>> json_checksum({"a": 1, "b": 2}) == json_checksum({"b": 2, "a": 1, "sha256": "any"})
    True
    """
    rest = {key: value for key, value in content.items() if key != KEY}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def with_checksum(content: Mapping[str, Any]) -> dict[str, Any]:
    """Add the checksum to an object, as its last key."""
    return {**content, KEY: json_checksum(content)}


def check_json(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Compare the checksum of an object that was read.

    Args:
        path: Its file, for messages.
        content: The object.

    Returns:
        The object without the checksum.

    Raises:
        FileFormatError: It does not fit.
        NoChecksumError: It carries no checksum.
    """
    rest = {key: value for key, value in content.items() if key != KEY}
    if KEY not in content:
        raise NoChecksumError(path)
    if content[KEY] != json_checksum(rest):
        raise FileFormatError(
            f"{path} has been changed since it was written (its checksum does not fit); restore it from a copy, or "
            "remove it and make it again."
        )
    return rest


def read_json(path: Path, advice: str) -> dict[str, Any]:
    """Read a file that holds one JSON object with its checksum.

    Args:
        path: The file.
        advice: What to do if it is damaged, for messages.

    Returns:
        The object without the checksum.

    Raises:
        FileFormatError: It is missing, no JSON, no object, or has been changed.
    """
    try:
        content = parse(read_bytes(path).decode())
    except FileNotFoundError:
        raise FileFormatError(f"{path} is missing; {advice}.") from None
    except (OSError, ValueError, MemoryError) as error:
        raise FileFormatError(f"{path} is damaged, it cannot be read as JSON ({error}); {advice}.") from None
    if not isinstance(content, dict):
        raise FileFormatError(f"{path} holds no JSON object; {advice}.")
    return check_json(path, content)


def _header_checksum(header: Mapping[str, Any], arrays: _Arrays) -> str:
    """Compute the SHA-256 (hex) over an object, as of `json_checksum`, and over names, types and values of arrays."""
    digest = hashlib.sha256(json_checksum(header).encode())
    for name in sorted(arrays):
        digest.update(f"{name} {_of_array(arrays[name])}".encode())
    return digest.hexdigest()


def _of_array(array: NDArray[Any]) -> str:
    digest = hashlib.sha256(f"{array.dtype.str} {array.shape} ".encode())
    digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def write_tensors(path: Path, key: str, header: Mapping[str, Any], tensors: _Arrays, what: str) -> None:
    """Write arrays with a header as a safetensors file (no pickle), whole or not at all.

    Args:
        path: The file.
        key: Name of the header in the file's metadata; it says what kind of file this is.
        header: JSON-compatible.
        tensors: By name.
        what: What it is, for messages, for example "the policy".

    Raises:
        OutputError: It cannot be written; nothing is left of it then.
    """
    arrays = {name: np.asarray(array, order="C") for name, array in tensors.items()}  # as `save` needs them
    # One key only: the library writes several in an order that differs from call to call.
    metadata = {key: json.dumps({**header, KEY: _header_checksum(header, arrays)}, sort_keys=True)}
    # Not its own `save_file`: that gives the file to its owner only and reports a full disk as a fault of the format.
    content = save(arrays, metadata=metadata)
    with writing(path, what) as part:
        part.write_bytes(content)


def read_tensors(
    path: Path, key: str, what: str, advice: str = "restore it from a copy, or make it again", *, old: bool = False
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read a file that `write_tensors` wrote.

    Args:
        path: The file.
        key: As for `write_tensors`.
        what: What it is, for messages, for example "policy".
        advice: What to do if it is damaged, for messages.
        old: It may carry no checksum, as version 0.1 wrote it.

    Returns:
        The header, and the arrays by name.

    Raises:
        FileFormatError: It is missing, damaged, of another kind, or has been changed.
        NoChecksumError: It carries no checksum.
    """
    try:
        check_regular(path)
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            if key not in metadata:
                raise FileFormatError(f"{path} is a safetensors file but no {what} of cornerforge.")
            header = parse(metadata[key])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  (it is no mapping)
        if not isinstance(header, dict):
            raise FileFormatError(f"{path}: its header is no JSON object, so it is no {what} of cornerforge.")
    except OSError as error:
        raise FileFormatError(f"Cannot read the {what} {path}: {reason(error)}.") from error
    except (SafetensorError, KeyError, TypeError, ValueError, AttributeError, MemoryError, RecursionError) as error:
        raise FileFormatError(f"{path} is damaged or no {what} ({type(error).__name__}: {error}); {advice}.") from error
    stated = header.pop(KEY, None)
    if stated is None and not old:
        raise NoChecksumError(path)
    if stated is not None and stated != _header_checksum(header, tensors):
        raise FileFormatError(
            f"The {what} {path} has been changed since it was written (its checksum does not fit); {advice}."
        )
    return header, tensors


def weights_of(path: Path, tensors: _Arrays, size: int, what: str) -> NDArray[np.float32]:
    """Give the array `weights` of a file of weights, if it is the only one and what a network can have.

    Args:
        path: Its file, for messages.
        tensors: All arrays of the file.
        size: How many numbers its network has.
        what: What the file is, for messages.

    Raises:
        FileFormatError: There are others, or it is of another type or size, or not finite, or beyond `_LARGEST_WEIGHT`.
    """
    found = tensors.get("weights")
    fault = None
    if found is None or len(tensors) != 1:
        fault = f'it holds the arrays {", ".join(sorted(tensors)) or "none"}; it must be "weights" alone'
    elif found.dtype != np.float32:
        fault = f'"weights" is of type {found.dtype}; it must be float32'
    elif found.shape != (size,):
        fault = f'"weights" has the shape {found.shape}; they do not fit its network, which has {size}'
    elif not (np.abs(found) <= _LARGEST_WEIGHT).all():
        fault = f'"weights" are not finite, or beyond {_LARGEST_WEIGHT:g}'
    if fault is not None or found is None:
        raise FileFormatError(f"The {what} {path} is damaged: {fault}; restore it from a copy, or make it again.")
    # A copy: what the file gives may not be writable, which kernels would take for another type.
    return np.array(found, dtype=np.float32)


def write_arrays(path: Path, arrays: _Arrays, what: str = "") -> None:
    """Write arrays and their checksums as a compressed `.npz`, whole or not at all; the same arrays, the same bytes.

    Args:
        path: The file.
        arrays: By name.
        what: What they are, for messages.

    Raises:
        OutputError: It cannot be written.
    """
    checksums = json.dumps({name: _of_array(np.asarray(array)) for name, array in arrays.items()}, sort_keys=True)
    with writing(path, what) as part, part.open("wb") as file:
        # The checksums first: of a damaged list of members the last ones may be lost.
        np.savez_compressed(file, allow_pickle=False, **{_MEMBER: np.array(checksums), **arrays})


def read_arrays(path: Path, what: str, *, old: bool = False) -> dict[str, NDArray[Any]]:
    """Read a file that `write_arrays` wrote; never loads a pickle.

    Args:
        path: The file.
        what: What it is, for messages, for example "model".
        old: It may carry no checksums, as version 0.1 wrote it.

    Returns:
        All arrays, by name.

    Raises:
        FileFormatError: It is missing, damaged, or another kind of file; an array that does not fit is named.
        NoChecksumError: It carries no checksums.
    """
    try:
        content = read_bytes(path)
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > _LARGEST:
                raise ValueError(f"it unpacks to more than {_LARGEST >> 20} MB")
        # From memory: of a cut-off file np.load would leave the handle open.
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if not all(isinstance(array, np.ndarray) for array in arrays.values()):
            raise ValueError("a member is no array")
        stated = parse(str(arrays.pop(_MEMBER))) if _MEMBER in arrays else None
        if not isinstance(stated, dict | None):
            raise ValueError("its checksums are no object")
    except UNREADABLE as error:
        raise FileFormatError(
            f"The {what} {path} is damaged or none of cornerforge ({type(error).__name__}: {error}); restore it from a "
            "copy, or make it again."
        ) from error
    if stated is None and old:
        return arrays
    if stated is None:
        raise NoChecksumError(path)
    for name in [*stated, *(name for name in arrays if name not in stated)]:
        if name in arrays and name in stated and _of_array(arrays[name]) == stated[name]:
            continue
        fault = "has been changed" if name in arrays and name in stated else "is missing or foreign"
        raise FileFormatError(
            f'The {what} {path} is not as it was written: its part "{name}" {fault} (the checksum does not fit); '
            "restore it from a copy, or make it again."
        )
    return arrays
