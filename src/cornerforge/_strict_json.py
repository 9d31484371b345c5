"""JSON that is read strictly: what is there twice, or is no number of JSON, is no value to be believed."""

from __future__ import annotations

import json
import math
from typing import Any

__all__ = ["parse"]

_SHOWN = 60


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


def parse(text: str, *, finite: bool = True) -> Any:
    """Parse JSON strictly.

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
