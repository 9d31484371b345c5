"""Checkpoints: files of an unfinished training, which continues from them as if it had never stopped."""

from __future__ import annotations

import json
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cornerforge._files import part_of, writing
from cornerforge.errors import FileFormatError, InputError, OutputError

__all__ = ["CHECKPOINT_SCHEMA", "CheckpointFile", "TrainingState"]

CHECKPOINT_SCHEMA = 4
_WRITING_SHARE = 20
"""Least time between two writes as a multiple of the duration of one: a slow disk costs at most 5 %."""


@dataclass(frozen=True)
class TrainingState:
    """State of a training between two iterations.

    Attributes:
        arrays: Plain arrays by name.
        values: Everything else, JSON-compatible.
    """

    arrays: Mapping[str, NDArray[Any]]
    values: Mapping[str, Any]


class CheckpointFile:
    """Where a training keeps its state, and which training that is.

    Args:
        path: The file; beside the policy, usually.
        identity: What decides the result, flat and JSON-compatible; a training continues only from its own states.
        every_seconds: Time between two writes [s], at least; 0 writes as often as the disk's speed allows.
    """

    def __init__(self, path: Path, identity: Mapping[str, object], *, every_seconds: float = 20.0) -> None:
        self.path = path
        self.identity: dict[str, object] = json.loads(json.dumps(dict(identity)))
        self._every = every_seconds
        self._next = time.monotonic() + every_seconds

    def check_absent(self) -> None:
        """Check that a new training would not overwrite an unfinished one.

        Raises:
            OutputError: There is one.
        """
        if self.path.exists():
            raise OutputError(f"{self.path} holds an unfinished training; go on with --resume, or remove it.")

    def is_due(self) -> bool:
        """Whether it is time to write again."""
        return time.monotonic() >= self._next

    def write(self, state: TrainingState) -> None:
        """Write a state to a file beside, then rename it, so that a kill leaves the state before.

        Raises:
            OutputError: It cannot be written; the state before is still there.
        """
        begin = time.monotonic()
        arrays = {name: np.asarray(array, order="C") for name, array in state.arrays.items()}  # as `save` needs them
        values = json.dumps(dict(state.values))
        header = {
            "schema_version": CHECKPOINT_SCHEMA,
            "identity": self.identity,
            "values": values,
            "crc32": _checksum(arrays, values),
        }
        content = save(arrays, metadata={"cornerforge_checkpoint": json.dumps(header)})
        with writing(self.path, "the checkpoint") as part:
            part.write_bytes(content)
        end = time.monotonic()
        self._next = end + max(self._every, _WRITING_SHARE * (end - begin))

    def read(self) -> TrainingState | None:
        """Read the state; None when there is no file. The time until the next write starts now.

        Raises:
            FileFormatError: It is damaged, of another schema, or no checkpoint.
            InputError: It belongs to another training; the first difference is named.
        """
        self._next = time.monotonic() + self._every
        if not self.path.exists():
            return None
        try:
            with safe_open(self.path, framework="numpy") as file:
                header = json.loads((file.metadata() or {})["cornerforge_checkpoint"])
                # The identity first: a user that named the wrong file should be told so, and nothing of schemas.
                self._check_identity(header["identity"])
                self._check_schema(header["schema_version"])
                arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  (it is no mapping)
            if _checksum(arrays, header["values"]) != header["crc32"]:
                raise self._damaged("its checksum is wrong")
            return TrainingState(arrays, json.loads(header["values"]))
        except (SafetensorError, OSError, KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise self._damaged(f"{type(error).__name__}: {error}") from error

    def remove(self) -> None:
        """Remove the file, if there is one, and what a kill while writing may have left of the next.

        Raises:
            OutputError: It cannot be removed.
        """
        try:
            part_of(self.path).unlink(missing_ok=True)
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"Cannot remove {self.path}: {error.strerror}; remove it yourself.") from error

    def _damaged(self, why: str) -> FileFormatError:
        return FileFormatError(f"Checkpoint {self.path} is damaged or no checkpoint ({why}); remove it to begin again.")

    def _check_schema(self, schema: object) -> None:
        if schema != CHECKPOINT_SCHEMA:
            raise FileFormatError(
                f"Checkpoint {self.path} has schema version {schema}; this cornerforge reads {CHECKPOINT_SCHEMA}. "
                "Remove it to begin again."
            )

    def _check_identity(self, found: Mapping[str, object]) -> None:
        for key in (*self.identity, *found):
            before, now = found.get(key), self.identity.get(key)
            if before != now:
                raise InputError(
                    f"{self.path} holds a training with {key} = {before!r}, not {now!r}; "
                    "go on with the same command and version, choose another place, or remove it."
                )


def _checksum(arrays: Mapping[str, NDArray[Any]], values: str) -> int:
    """CRC-32 over names, contents and values: a flipped bit in the replay memory would go unnoticed otherwise."""
    crc = zlib.crc32(values.encode())
    for name in sorted(arrays):
        crc = zlib.crc32(name.encode(), crc)
        crc = zlib.crc32(np.ascontiguousarray(arrays[name]).reshape(-1).view(np.uint8).data, crc)
    return crc
