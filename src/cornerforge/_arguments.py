"""Types of arguments: a public function that is given another one says so in one plain sentence.

Which numbers and names are allowed is for `_checks`; here it is only text for text, a path for a path, True for a flag.
"""

from __future__ import annotations

import numbers
import os
import types
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeGuard, get_args, get_origin

from cornerforge._checks import check_path
from cornerforge._words import shown
from cornerforge.errors import InputError

__all__ = ["allowed_types", "check_value", "is_several"]


def is_several(value: object) -> TypeGuard[Sequence[Any]]:
    """Tell whether a value is a list, a tuple, an array of values or the like; a text is not.

    >>> is_several([1]), is_several("1"), is_several(1)
    (True, False, False)
    """
    if isinstance(value, Sequence):
        return not isinstance(value, (str, bytes, bytearray))
    return getattr(value, "ndim", 0) > 0


def allowed_types(hint: Any) -> tuple[Any, ...]:
    """Give the types that an annotation allows, in its order.

    >>> allowed_types(int | None)
    (<class 'int'>, <class 'NoneType'>)
    """
    if get_origin(hint) is Annotated:
        return allowed_types(get_args(hint)[0])
    return get_args(hint) if get_origin(hint) in (types.UnionType, typing.Union) else (hint,)


_WORDS = {
    int: "a whole number", float: "a number", bool: "True or False", str: "text", Path: "a path", type(None): "None",
}  # fmt: skip


def _in_words(kind: Any) -> str:
    if get_origin(kind) is Sequence:
        return f"a list (each entry {_listed(allowed_types(get_args(kind)[0]))})"
    return _WORDS.get(kind) or ("a function" if _is_function(kind) else kind.__name__)


def _listed(kinds: Sequence[Any]) -> str:
    words = list(dict.fromkeys(map(_in_words, kinds)))
    return " or ".join(words) if len(words) < 3 else f"{', '.join(words[:-1])} or {words[-1]}"


def _is_function(kind: Any) -> bool:
    return get_origin(kind) is Callable or getattr(kind, "_is_protocol", False)


def _is_of(kind: Any, value: Any) -> bool:
    """Tell whether a value is of a type; a class is told by its name, so that it need not be imported."""
    is_flag = type(value).__name__ in ("bool", "bool_")
    if get_origin(kind) is Sequence:
        each = allowed_types(get_args(kind)[0])
        return is_several(value) and all(any(_is_of(one, entry) for one in each) for entry in value)
    if _is_function(kind):
        return callable(value)
    if kind is bool:
        return is_flag
    if kind in (int, float):
        return isinstance(value, numbers.Integral if kind is int else numbers.Real) and not is_flag
    if kind is Path:
        return isinstance(value, os.PathLike)
    return any(one.__name__ == kind.__name__ for one in type(value).__mro__)


def check_value(name: str, value: Any, hint: Any) -> None:
    """Check that a value is of the type that an annotation says, and that a path is one.

    Raises:
        InputError: It is not; the message names the value, and what is allowed.
    """
    kinds = allowed_types(hint)
    if not any(_is_of(kind, value) for kind in kinds):
        raise InputError(f"{name} = {shown(value)} is not allowed; give {_listed(kinds)}.")
    each = [one for kind in kinds for one in (allowed_types(get_args(kind)[0]) if get_args(kind) else [kind])]
    for one in (value if is_several(value) else [value]) if Path in each else ():
        if isinstance(one, (str, os.PathLike)):
            check_path(one)
            if one == "":
                raise InputError(f'{name} = "" names no file or folder.')
