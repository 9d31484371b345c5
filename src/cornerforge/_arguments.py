"""Arguments of public functions have the types that their annotations say, or the call ends in one plain sentence.

Which numbers and names are allowed is for each function to check (`_checks`); here it is only text for text, a path for
a path, True for a flag. Annotations are read as they are written, so that nothing is imported to check a call.
"""

from __future__ import annotations

import ast
import functools
import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, ParamSpec, TypeGuard, TypeVar

import numpy as np

from cornerforge._checks import check_path
from cornerforge._words import shown
from cornerforge.errors import InputError

__all__ = ["checked", "is_several", "keywords_of"]

P = ParamSpec("P")
R = TypeVar("R")


class _Kind(NamedTuple):
    """A kind of value: how it is called, and which values are of it."""

    words: str
    takes: Callable[[Any], bool]


def _is_number(value: Any, *kinds: type) -> bool:
    return isinstance(value, kinds) and not isinstance(value, bool)


_PLAIN = {
    "int": _Kind("a whole number", lambda v: _is_number(v, int, np.integer)),
    "float": _Kind("a number", lambda v: _is_number(v, int, float, np.integer, np.floating)),
    "bool": _Kind("True or False", lambda v: isinstance(v, (bool, np.bool_))),
    "str": _Kind("text", lambda v: isinstance(v, str)),
    "Path": _Kind("a path", lambda v: isinstance(v, os.PathLike)),
    "Progress": _Kind("a function", callable),
    "Callable": _Kind("a function", callable),
}


def is_several(value: object) -> TypeGuard[Sequence[Any]]:
    """Tell whether a value is a list, a tuple, an array of values or the like; a text is none.

    >>> is_several([1]), is_several("1"), is_several(1)
    (True, False, False)
    """
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes, bytearray))


@functools.cache
def _kinds(annotation: str) -> tuple[_Kind, ...]:
    """Read an annotation: the kinds of value that it allows."""
    return tuple(_of(ast.parse(annotation, mode="eval").body))


def _of(node: ast.expr) -> list[_Kind]:
    if isinstance(node, ast.BinOp):
        return _of(node.left) + _of(node.right)
    if isinstance(node, ast.Constant):
        return [_Kind("None", lambda v: v is None)]
    if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Sequence":
        each = _of(node.slice)

        def takes(value: Any) -> bool:
            return is_several(value) and all(any(kind.takes(one) for kind in each) for one in value)

        return [_Kind(f"a list (each entry {_listed([kind.words for kind in each])})", takes)]
    name = ast.unparse(node.value if isinstance(node, ast.Subscript) else node)
    return [_PLAIN.get(name) or _Kind(name, lambda v: _has_class(v, name))]


def _has_class(value: Any, name: str) -> bool:
    return any(one.__name__ == name for one in type(value).__mro__)


def _listed(words: Sequence[str]) -> str:
    words = list(dict.fromkeys(words))
    return " or ".join(words) if len(words) < 3 else f"{', '.join(words[:-1])} or {words[-1]}"


def _check(name: str, value: Any, annotation: str) -> None:
    kinds = _kinds(annotation)
    if not any(kind.takes(value) for kind in kinds):
        raise InputError(f"{name} = {shown(value)} is not allowed; give {_listed([kind.words for kind in kinds])}.")
    if "Path" in annotation:
        for one in value if is_several(value) else [value]:
            if isinstance(one, (str, os.PathLike)):
                check_path(one)
                if one == "":
                    raise InputError(f'{name} = "" names no file or folder.')


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function check the types of its arguments at each call.

    Its module has `from __future__ import annotations`. Keywords that it takes as `**name: Unpack[Keywords]` are those
    of the `TypedDict`; others would be handed on unseen. Parameters without an annotation are not checked.

    Raises:
        InputError: An argument is of another type than its annotation says.
        TypeError: There is no such argument, or one is missing; in Python's words.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def check(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # says it as everywhere in Python
        for name, value in given.items():
            parameter = signature.parameters[name]
            if parameter.kind is parameter.VAR_KEYWORD:
                known = keywords_of(function, parameter.annotation)
                for keyword, one in value.items():
                    if keyword not in known:
                        raise TypeError(f"{function.__qualname__}() got an unexpected keyword argument {keyword!r}")
                    _check(keyword, one, known[keyword].__forward_arg__)
            elif parameter.annotation is not parameter.empty:
                _check(name, value, parameter.annotation)
        return function(*args, **kwargs)

    return check


def keywords_of(function: Callable[..., Any], annotation: str) -> Mapping[str, Any]:
    """Find the `TypedDict` that `Unpack[...]` names."""
    named = annotation.removeprefix("Unpack[").removesuffix("]")
    found: Mapping[str, Any] = inspect.unwrap(function).__globals__[named].__annotations__
    return found
