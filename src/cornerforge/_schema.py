"""Types of what files and results hold, each declared once with its meaning, and the reading of JSON into them.

A field is `Annotated[type, meant("What it is.", "m")]`; msgspec checks values against the type.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeVar, dataclass_transform, get_type_hints

import msgspec

from cornerforge._checks import check_integer, check_number
from cornerforge._words import shown
from cornerforge.errors import FileFormatError

__all__ = ["Closed", "Declared", "Hex", "Share", "Whole", "check_fields", "meant", "parse", "read", "unit_of"]

T = TypeVar("T")

Whole = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""A whole number of at least 0, and below 2^63."""
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""A number from 0 to 1."""
Hex = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{1,64}$(?!\n)")]
"""A hash, or the first digits of one: 1 to 64 hexadecimal digits."""

_WORDS = {
    "int": "a whole number", "float": "a number", "str": "a text", "bool": "true or false", "array": "a list",
    "object": "an object",
}  # fmt: skip
_SHOWN = 60


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
@dataclass(frozen=True, kw_only=True)
class Declared:
    """Base of classes that are made of declared fields: their subclasses are frozen dataclasses, made by keywords."""

    def __init_subclass__(cls) -> None:
        """Make a dataclass of a subclass."""
        super().__init_subclass__()
        dataclass(frozen=True, kw_only=True)(cls)


class Closed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An object of a file that holds the declared keys and no others."""


def meant(meaning: str, unit: str = "", low: float | None = None, high: float | None = None) -> msgspec.Meta:
    """Say what a field is.

    Args:
        meaning: One sentence, with the edge values.
        unit: Unit of the values, "" for none.
        low, high: Smallest and largest number, inclusive; None: any.
    """
    return msgspec.Meta(description=meaning, extra_json_schema={"unit": unit} if unit else {}, ge=low, le=high)


def unit_of(said: msgspec.Meta) -> str:
    """Give the unit that `meant` was told, "" for none."""
    return str((said.extra_json_schema or {}).get("unit", ""))


def read(kind: type[T], content: Any, place: str, advice: str = "") -> T:
    """Make a value of a declared type of what JSON gave.

    A key without a field is passed over, but for `Closed` types; a field with a default may be missing.

    Args:
        kind: The type: a dataclass or a `Closed`.
        content: The object.
        place: What it is, for messages: a file, mostly.
        advice: What to do if it is wrong, for messages; "" for nothing.

    Raises:
        FileFormatError: A value is missing, or of another type or range: '<place>: "<key>" is ...; it must be ...'.
    """
    try:
        return msgspec.convert(content, kind)
    except (msgspec.ValidationError, RecursionError) as error:
        fault = _fault(kind, content, str(error))
    raise FileFormatError(f"{place}: {fault}{f'; {advice}' if advice else '.'}")


def check_fields(part: object, prefix: str, *, but: Sequence[str] = ()) -> None:
    """Check the numbers of a dataclass that was made in Python against the ranges that its fields declare.

    Args:
        part: The dataclass.
        prefix: What stands before a field's name in messages, such as "odd.".
        but: Fields that are not looked at.

    Raises:
        InputError: A number is no number, not finite, or out of range.
    """
    kind: Any = type(part)
    for name, whole, low, high, unit in _ranges(kind):
        if name not in but and whole:
            check_integer(prefix + name, getattr(part, name), low=low, high=high)
        elif name not in but:
            check_number(prefix + name, getattr(part, name), low=low, high=high, unit=unit)


@functools.cache
def _ranges(kind: Any) -> list[tuple[str, bool, Any, Any, str]]:
    """List the fields that declare a range: name, whether it is a whole number, lowest, highest, unit."""
    return [
        (name, declared.__origin__ is int, declared.__origin__(said.ge), declared.__origin__(said.le), unit_of(said))
        for name, declared in get_type_hints(kind, include_extras=True).items()
        for said in getattr(declared, "__metadata__", ())
        if said.le is not None
    ]


def _fault(kind: Any, content: Any, error: str) -> str:
    """Say in plain words, with the value, what an error of msgspec says: "Expected `int` >= 0 - at `$.a[0]`"."""
    said, of_key, path = re.findall(r"(?s)\A(.*?)(?: - at (`key` in )?`\$([^`]*)`)?\Z", error)[0]
    place, part = "", content
    for step in re.findall(r"\[\.\.\.\]|\w+", path):
        key = _refused_key(kind, content, part, error) if step == "[...]" else step
        is_list = isinstance(part, list | tuple)
        place, part = f"{place}[{key}]" if is_list else f"{place}.{key}".lstrip("."), part[int(key) if is_list else key]
    if name := re.fullmatch(r"Object (missing required|contains unknown) field `(.*)`", said):
        return f'"{place}{place and "."}{name[2]}" is {"missing" if name[1][0] == "m" else "unknown"}'
    here = f'"{place}"' if place else "it"
    if said.startswith("Invalid enum value"):
        found = re.search(
            f'"{path.rpartition(".")[2]}": {{.*?"enum": (\\[.*?\\])', json.dumps(msgspec.json.schema(kind))
        )
        allowed = ", ".join(map(str, json.loads(found[1]))) if found and not of_key else ""
        names = f"one of {allowed}" if allowed else "a name that is known there"
        return f"{here} {'holds' if of_key else 'is'} {said.removeprefix('Invalid enum value ')}; it must be {names}"
    if not said.startswith("Expected "):  # of a class that checks more than the types of its fields
        return f"{here}: {said.rstrip('.')}" if place else said.rstrip(".")
    must = said.removeprefix("Expected ").partition(", got ")[0]
    return f"{here} is {shown(part)}; it must be {_in_words(must)}"


def _refused_key(kind: Any, content: Any, part: dict[str, Any], error: str) -> str:
    """Find the key of the value that gives an error of msgspec in read data, because msgspec does not name it."""
    whole = dict(part)
    for key, value in whole.items():
        part.clear()
        part[key] = value
        try:
            msgspec.convert(content, kind)
        except msgspec.ValidationError as found:
            if str(found) == error:
                break
    part.clear()
    part.update(whole)
    return key


def _in_words(text: str) -> str:
    for sign, words in ((" of length <=", " of at most"), (" of length >=", " of at least"), (" <=", " of at most"),
                        (" >=", " of at least"), (" matching regex", " of the form")):  # fmt: skip
        text = text.replace(sign, words)
    return re.sub("`(.*?)`", lambda found: " or ".join(_WORDS.get(one, one) for one in found[1].split(" | ")), text)


def parse(text: str, *, finite: bool = True) -> Any:
    """Parse JSON strictly: what is there twice, or is no number of JSON, is no value to be believed.

    Args:
        text: The JSON.
        finite: Refuse NaN and infinite numbers; False: let them through, to a reader that names what they are.

    Raises:
        ValueError: It is no JSON, has a key twice, a number that is not finite, or is nested too deeply.
    """
    numbers: dict[str, Any] = {"parse_constant": _no_number, "parse_float": _finite} if finite else {}
    try:
        return json.loads(text, object_pairs_hook=_once, **numbers)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {json.dumps(twice[:_SHOWN], ensure_ascii=False)} is there twice")
    return found


def _no_number(name: str) -> Any:
    raise ValueError(f"{name} is no number of JSON")


def _finite(digits: str) -> float:
    value = float(digits)
    if math.isinf(value):
        raise ValueError(f"the number {digits[:_SHOWN]} is too large")
    return value
