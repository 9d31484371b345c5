"""Checks of JSON values against the part of JSON Schema that the case file's schema uses, with messages for people."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["wrong"]

_TYPES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "object": ("an object {...}", lambda v: isinstance(v, dict)),
    "array": ("a list [...]", lambda v: isinstance(v, list)),
    "string": ("a text", lambda v: isinstance(v, str)),
    "number": ("a number", lambda v: isinstance(v, (int, float)) and not isinstance(v, bool)),
    "integer": ("a whole number", lambda v: isinstance(v, int) and not isinstance(v, bool)),
    "boolean": ("true or false", lambda v: isinstance(v, bool)),
    "null": ("null", lambda v: v is None),
}
_SHOWN = 60


def wrong(value: Any, schema: Mapping[str, Any], place: str = "") -> str | None:
    """Say what is wrong with a value, where, and what it must be; None: nothing.

    Args:
        value: As `parse` gives it.
        schema: A schema of the keywords type, const, enum, pattern, minimum, maximum, maxLength, items, minItems,
            maxItems, properties, required, additionalProperties and maxProperties.
        place: Where the value is, such as "vehicles[2].start".
    """
    here = place or "the file"
    must = _must_be(value, schema)
    if must is not None:
        return f"{here} is {_shown(value)}; it must be {must}"
    if isinstance(value, dict):
        return _wrong_inside(value, schema, place)
    if isinstance(value, list):
        return _wrong_items(value, schema, place)
    return None


def _must_be(value: Any, schema: Mapping[str, Any]) -> str | None:
    """Say what a value must be, if it is not; its parts are not looked at."""
    if "const" in schema and (value != schema["const"] or isinstance(value, bool)):
        return _shown(schema["const"])
    if "enum" in schema and value not in schema["enum"]:
        return "one of " + ", ".join(map(_shown, schema["enum"]))
    if "type" in schema:
        names = [schema["type"]] if isinstance(schema["type"], str) else schema["type"]
        if not any(_TYPES[name][1](value) for name in names):
            return " or ".join(_TYPES[name][0] for name in names)
    if isinstance(value, str):
        if len(value) > schema.get("maxLength", math.inf):
            return f"a text of at most {schema['maxLength']:,} characters"
        if "pattern" in schema and re.search(schema["pattern"].removesuffix("$") + r"\Z", value) is None:
            return f"a text of the form {schema['pattern']}"
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        low, high = schema.get("minimum", -math.inf), schema.get("maximum", math.inf)
        if not low <= value <= high:
            return f"from {low:g} to {high:g}"
    return None


def _wrong_inside(value: Mapping[str, Any], schema: Mapping[str, Any], place: str) -> str | None:
    known = schema.get("properties", {})
    more = schema.get("additionalProperties", True)
    for key in schema.get("required", ()):
        if key not in value:
            return f"{place or 'the file'} lacks {_shown(key)}"
    if len(value) > schema.get("maxProperties", math.inf):
        return f"{place} has {len(value):,} entries; it must have at most {schema['maxProperties']:,}"
    for key, one in value.items():
        inner = known.get(key, more)
        if inner is False:
            return f"{place or 'the file'} has {_shown(key)}, which is not known there; known: {', '.join(known)}"
        if isinstance(inner, Mapping) and (found := wrong(one, inner, f"{place}.{key}".lstrip("."))) is not None:
            return found
    return None


def _wrong_items(value: list[Any], schema: Mapping[str, Any], place: str) -> str | None:
    low, high = schema.get("minItems", 0), schema.get("maxItems", math.inf)
    if not low <= len(value) <= high:
        return f"{place} has {len(value):,} entries; it must have {low} to {high:,}"
    if "items" in schema:
        for index, one in enumerate(value):
            if (found := wrong(one, schema["items"], f"{place}[{index}]")) is not None:
                return found
    return None


def _shown(value: Any) -> str:
    """Show a value as JSON, shortened."""
    if isinstance(value, (dict, list)) and value:
        return f"{'an object' if isinstance(value, dict) else 'a list'} of {len(value):,}"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
