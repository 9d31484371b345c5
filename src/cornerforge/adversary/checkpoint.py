"""Checkpoints: files of an unfinished training, which continues from them as if it had never stopped."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from numpy.typing import NDArray

from cornerforge._checksums import read_tensors, write_tensors
from cornerforge._files import remove_parts
from cornerforge._schema import Closed, Whole, meant, read
from cornerforge.errors import FileFormatError, InputError, OutputError

__all__ = ["CHECKPOINT_KEY", "CHECKPOINT_SCHEMA", "CheckpointFile", "CheckpointHeader", "TrainingState"]

CHECKPOINT_SCHEMA = 6
CHECKPOINT_KEY = "cornerforge_checkpoint"
"""Name of the header in a checkpoint's metadata."""
_WRITING_SHARE = 20
"""Least time between two writes as a multiple of the duration of one: a slow disk costs at most 5 %."""


class CheckpointHeader(Closed, frozen=True):
    """Header of a checkpoint; its arrays are the networks, the optimiser and the replay memory."""

    schema_version: Annotated[Whole, meant("Version of the file.")]
    identity: Annotated[dict[str, Any], meant("What decides the result; a training goes on from its own states only.")]
    values: Annotated[dict[str, Any], meant("The state beside the arrays: counters, random numbers, the curve so far.")]


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
        header = {"schema_version": CHECKPOINT_SCHEMA, "identity": self.identity, "values": dict(state.values)}
        write_tensors(self.path, CHECKPOINT_KEY, header, state.arrays, "the checkpoint")
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
        header, arrays = read_tensors(self.path, CHECKPOINT_KEY, "checkpoint", "remove it to begin again")
        if isinstance(identity := header.get("identity"), dict):
            # First: a user that named the wrong file should be told so, and nothing of schemas.
            self._check_identity(identity)
            self._check_schema(header.get("schema_version"))
        told = read(CheckpointHeader, header, f"Checkpoint {self.path} is damaged", "remove it to begin again.")
        return TrainingState(arrays, told.values)

    def remove(self) -> None:
        """Remove the file, if there is one, and what a kill while writing may have left of the next.

        Raises:
            OutputError: It cannot be removed.
        """
        try:
            remove_parts(self.path)
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"Cannot remove {self.path}: {error.strerror}; remove it yourself.") from error

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
