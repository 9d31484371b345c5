"""Reading JSON artefacts with messages that name the file, the key, and the command that writes it again."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cornerforge.errors import FileFormatError

__all__ = ["Reader", "read_json"]


@dataclass(frozen=True)
class Reader:
    """A JSON object of a file, read key by key.

    Attributes:
        file: The file, for messages.
        values: The object.
        command: What writes the file again, for messages.
        place: Where in the file the object stands, such as "nde." (empty for the outermost).
    """

    file: Path
    values: Mapping[str, Any]
    command: str
    place: str = ""

    def fault(self, key: str, what: str) -> FileFormatError:
        """The error to raise for a key: `what` completes "<file>: <key> ..."."""
        return FileFormatError(f'{self.file}: "{self.place}{key}" {what}; write the file again with: {self.command}')

    def has(self, key: str) -> bool:
        """The key is there and not null."""
        return self.values.get(key) is not None

    def _value(self, key: str) -> Any:
        if not self.has(key):
            raise self.fault(key, "is missing")
        return self.values[key]

    def number(self, key: str) -> float:
        """A finite number.

        Raises:
            FileFormatError: It is missing or something else.
        """
        return self._number(key, self._value(key))

    def _number(self, key: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.fault(key, f"is {value!r}, not a finite number")
        return float(value)

    def number_or_none(self, key: str) -> float | None:
        """A finite number, or None where the key is absent, null, NaN or infinite (such as a loss before training)."""
        value = self.values.get(key)
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return self.number(key) if self.has(key) else None

    def count(self, key: str) -> int:
        """A whole number of at least 0.

        Raises:
            FileFormatError: It is missing or something else.
        """
        value = self.number(key)
        if value < 0 or value != int(value):
            raise self.fault(key, f"is {value!r}, not a whole number of at least 0")
        return int(value)

    def text(self, key: str, default: str | None = None) -> str:
        """A string; `default`, if given, stands for a missing one."""
        if default is not None and not self.has(key):
            return default
        value = self._value(key)
        if not isinstance(value, str):
            raise self.fault(key, f"is {value!r}, not a text")
        return value

    def items(self, key: str) -> list[Any]:
        """A list.

        Raises:
            FileFormatError: It is missing or something else.
        """
        value = self._value(key)
        if not isinstance(value, list):
            raise self.fault(key, "is not a list")
        return value

    def numbers(self, key: str, n: int | None = None) -> list[float]:
        """A list of finite numbers, of length `n` if given."""
        values = self.items(key)
        if n is not None and len(values) != n:
            raise self.fault(key, f"has {len(values)} entries instead of {n}")
        return [self._number(f"{key}[{i}]", value) for i, value in enumerate(values)]

    def texts(self, key: str) -> list[str]:
        """A list of strings."""
        values = self.items(key)
        if not all(isinstance(value, str) for value in values):
            raise self.fault(key, "does not hold texts only")
        return values

    def child(self, key: str) -> Reader:
        """The object below a key.

        Raises:
            FileFormatError: It is missing or something else.
        """
        return self._reader(key, self._value(key))

    def children(self, key: str) -> list[Reader]:
        """The objects of the list below a key."""
        return [self._reader(f"{key}[{i}]", value) for i, value in enumerate(self.items(key))]

    def _reader(self, key: str, value: Any) -> Reader:
        if not isinstance(value, dict):
            raise self.fault(key, "is not an object")
        return Reader(self.file, value, self.command, f"{self.place}{key}.")

    def counts(self, key: str) -> dict[str, int]:
        """An object of whole numbers, such as cases by crash type; empty where the key is absent."""
        if not self.has(key):
            return {}
        child = self.child(key)
        return {name: child.count(name) for name in child.values}


def read_json(file: Path, command: str) -> Reader:
    """Open a JSON file that holds one object.

    Args:
        file: The file.
        command: What writes it, for the message.

    Raises:
        FileFormatError: The file is missing, unreadable, no JSON, or no object.
    """
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FileFormatError(f"{file} is missing; write it with: {command}") from None
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{file} cannot be read as JSON ({error}); write it again with: {command}") from None
    if not isinstance(values, dict):
        raise FileFormatError(f"{file} holds no JSON object; write it again with: {command}")
    return Reader(file, values, command)
