"""Checks of JSON objects that were read, against lists of `fields.Field`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from sys import float_info
from typing import Any

from cornerforge.fields import Field

__all__ = ["is_hex", "object_fault"]

_WORDS = {
    "string": "a text",
    "hex": "1 to 64 hexadecimal digits",
    "bool": "true or false",
    "int64": "a whole number",
    "float64": "a finite number",
    "object": "an object",
}
_DIGITS = frozenset("0123456789abcdef")


def is_hex(text: str) -> bool:
    """Tell whether a text may be a hash, or the first digits of one: 1 to 64 hexadecimal digits."""
    return 0 < len(text) <= 64 and _DIGITS.issuperset(text)


def object_fault(content: Any, fields: Iterable[Field], place: str = "", *, closed: bool = False) -> str | None:
    """Say what is wrong with an object, or None.

    Args:
        content: The object.
        fields: What it must hold; types are "string", "hex" (hexadecimal digits), "bool", "int64", "float64", "object",
            each also as "list of ...".
        place: Name of the object in its file, for messages; "" for the file itself.
        closed: Refuse keys that `fields` does not name, instead of passing them over.
    """
    fields = tuple(fields)
    if not isinstance(content, Mapping):
        return f'"{place}" is {_told(content)}; it must be an object' if place else "it holds no object"
    for field in fields:
        key = f"{place}.{field.name}" if place else field.name
        if field.name not in content:
            if not field.optional:
                return f'"{key}" is missing'
            continue
        value = content[field.name]
        if value is None and field.nullable:
            continue
        kind = field.type.removeprefix("list of ")
        if kind == field.type:
            fault = _fault(value, kind, field)
        elif not isinstance(value, list):
            fault = f"is {_told(value)}; it must be a list"
        else:
            faults = ((i, _fault(one, kind, field)) for i, one in enumerate(value))
            key, fault = next(((f"{key}[{i}]", wrong) for i, wrong in faults if wrong), (key, None))
        if fault:
            return f'"{key}" {fault}'
    unknown = sorted(set(content) - {field.name for field in fields}) if closed else []
    return f'"{unknown[0]}" is unknown' if unknown else None


def _fault(value: Any, kind: str, field: Field) -> str | None:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    fine = {
        "string": isinstance(value, str) and "\0" not in value,
        "hex": isinstance(value, str) and is_hex(value),
        "bool": isinstance(value, bool),
        "int64": number and isinstance(value, int),
        "float64": number and abs(value) <= float_info.max,
        "object": isinstance(value, Mapping),
    }[kind]
    in_range = field.within is None or not number or field.within[0] <= value <= field.within[1]
    if fine and in_range:
        return None
    allowed = f"{field.allowed} {field.unit}".rstrip() if field.within is not None else ""
    if kind == "string" and isinstance(value, str):
        allowed = "without the character NUL"
    return f"is {_told(value)}; it must be {_WORDS[kind]}{f', {allowed}' if allowed else ''}"


def _told(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
