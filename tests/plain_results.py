"""Results for tests that need one whole, and a few values of it."""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass
from typing import Annotated, Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

__all__ = ["plain_result"]

T = TypeVar("T")


def plain_result(kind: type[T], **given: Any) -> T:
    """Make a result with the given values; the others are zero, null or empty."""
    hints = get_type_hints(kind)
    needed: Any = (one.name for one in fields(kind) if one.default is MISSING)  # type: ignore[arg-type]
    return kind(**{name: _plainest(hints[name]) for name in needed} | given)


def _plainest(kind: Any) -> Any:
    parts, origin = get_args(kind), get_origin(kind)
    if origin is Annotated:
        return _plainest(parts[0])
    if origin is tuple:
        return () if Ellipsis in parts else tuple(map(_plainest, parts))
    if origin is Literal:
        return parts[0]
    if type(None) in parts:
        return None
    return plain_result(cast("Any", kind)) if is_dataclass(kind) else (origin or kind)()
