"""Reading results from JSON, the inverse of `stating.as_json`: each value is checked against its field."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from sys import float_info
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from cornerforge._checksums import read_json
from cornerforge.errors import FileFormatError
from cornerforge.results.stating import UNIONS

__all__ = ["JsonFile", "from_json", "open_json"]

T = TypeVar("T")

_WHOLE = "a whole number of at least 0, and below 2^63"


def from_json(kind: type[T], content: Mapping[str, Any], *, stored: bool = False) -> T:
    """Make a result of what `as_json` made of it; NaN is kept, and lists may be tuples.

    Args:
        kind: Its class: one of the dataclasses of this package.
        content: The object.
        stored: It is out of a file, whose rules hold, too: no number below its least, none that is not finite; unknown
            keys are passed over.

    Raises:
        FileFormatError: Keys are missing or unknown, or a value is of another type.
    """

    def fault(key: str, what: str) -> FileFormatError:
        return FileFormatError(f'This is no {kind.__name__} ("{key}" {what}).')

    return _Reading(fault, is_file=stored).result(kind, content, "")


@dataclass(frozen=True)
class JsonFile:
    """A file that holds one JSON object.

    Attributes:
        path: The file.
        command: What writes it again, for messages.
        values: The object.
    """

    path: Path
    command: str
    values: Mapping[str, Any]

    def fault(self, key: str, what: str) -> FileFormatError:
        """The error to raise for a key, such as "nde.tests": `what` completes '<file>: "<key>" ...'."""
        return FileFormatError(f'{self.path}: "{key}" {what}; write the file again with: {self.command}')

    def read(self, kind: type[T]) -> T:
        """Make a dataclass of the object.

        Numbers must be finite, whole ones at least 0, and within the range that the field's metadata may name
        (`share`). A key without a field is passed over; a field with a default may be missing.

        Raises:
            FileFormatError: A value is missing or of another type or range; the message names its place in the file.
        """
        return _Reading(self.fault, is_file=True).result(kind, self.values, "")


def open_json(path: Path, command: str) -> JsonFile:
    """Open a JSON file that holds one object.

    Args:
        path: The file.
        command: What writes it, for messages.

    Raises:
        FileFormatError: The file is missing, unreadable, no JSON, no object, or has been changed.
    """
    values = read_json(path, f"write it with: {command}")
    return JsonFile(path, command, values)


@dataclass(frozen=True)
class _Reading:
    """How to read: what makes an error of a key and what is wrong with it, and whether a file's rules hold."""

    fault: Callable[[str, str], FileFormatError]
    is_file: bool

    def result(self, kind: type[T], values: Any, place: str) -> T:
        if not isinstance(values, Mapping):
            raise self.fault(place, "is not an object")
        prefix, hints = f"{place}." if place else "", get_type_hints(kind)
        unknown = [name for name in values if name not in hints]
        if unknown and not self.is_file:
            raise self.fault(prefix + unknown[0], "is unknown")
        found = {}
        for one in fields(kind):  # type: ignore[arg-type]
            key, value = prefix + one.name, values.get(one.name)
            if value is not None or (one.name in values and _may_be_null(hints[one.name])):
                found[one.name] = self.value(hints[one.name], value, key)
                self.check_range(one.metadata.get("within"), value, key)
            elif one.default is MISSING:
                raise self.fault(key, "is missing")
        return kind(**found)

    def check_range(self, within: tuple[float, float] | None, value: Any, key: str) -> None:
        if self.is_file and within is not None and value is not None and not within[0] <= value <= within[1]:
            raise self.fault(key, f"= {value} is outside [{within[0]:g}, {within[1]:g}]")

    def value(self, kind: Any, value: Any, key: str) -> Any:
        origin, arguments = get_origin(kind), get_args(kind)
        if kind is Any or (value is None and _may_be_null(kind)):
            return value
        if origin in UNIONS:
            return self.first_of([one for one in arguments if one is not NoneType], value, key)
        if is_dataclass(kind):
            return self.result(kind, value, key)  # type: ignore[arg-type]
        if origin is tuple:
            return self.items(arguments, value, key)
        if origin is dict:
            if not isinstance(value, Mapping):
                raise self.fault(key, "is not an object")
            for name in value:
                self.name(arguments[0], name, key)
            return {name: self.value(arguments[1], item, f"{key}.{name}") for name, item in value.items()}
        return self.scalar(kind, value, key)

    def first_of(self, kinds: list[Any], value: Any, key: str) -> Any:
        """Read a value of one of several types."""
        for kind in kinds[:-1]:
            try:
                return self.value(kind, value, key)
            except FileFormatError:
                continue
        return self.value(kinds[-1], value, key)

    def items(self, kinds: tuple[Any, ...], value: Any, key: str) -> tuple[Any, ...]:
        if not isinstance(value, (list, tuple)):
            raise self.fault(key, "is not a list")
        if kinds[-1] is Ellipsis:
            kinds = (kinds[0],) * len(value)
        if len(value) != len(kinds):
            raise self.fault(key, f"has {len(value)} entries instead of {len(kinds)}")
        return tuple(self.value(kind, value[i], f"{key}[{i}]") for i, kind in enumerate(kinds))

    def name(self, kind: Any, name: str, key: str) -> None:
        """Check a key of an object whose keys are by name."""
        if get_origin(kind) is Literal and name not in get_args(kind):
            raise self.fault(key, f"holds {name!r}, allowed: {', '.join(get_args(kind))}")

    def scalar(self, kind: Any, value: Any, key: str) -> Any:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        checks = {
            str: (isinstance(value, str), "a text"),
            bool: (isinstance(value, bool), "true or false"),
            int: (is_number and isinstance(value, int) and (0 <= value < 1 << 63 or not self.is_file), _WHOLE),
            float: (is_number and (abs(value) <= float_info.max or not self.is_file), "a finite number"),
        }
        if get_origin(kind) is Literal:
            is_right, what = value in get_args(kind), f"one of {', '.join(get_args(kind))}"
        else:
            is_right, what = checks[kind]
        if not is_right:
            raise self.fault(key, f"is {value!r}, not {what}")
        return value


def _may_be_null(kind: Any) -> bool:
    return kind is Any or NoneType in get_args(kind)
