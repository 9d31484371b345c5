"""The language in which options, results and files are declared, and the checks of values against it.

A field is `Annotated[type, meant("What it is.", "m")]`. msgspec checks what was read of JSON (`read`); `check_value`
and `check_fields` check what was made in Python, where a path, a function or a number of NumPy is allowed too.
"""

from __future__ import annotations

import functools
import json
import math
import numbers
import os
import re
import types
import typing
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import (
    Annotated,
    Any,
    TypedDict,
    TypeGuard,
    TypeVar,
    Unpack,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)  # fmt: skip

import msgspec

from cornerforge._checks import check_in, check_integer, check_number, check_path
from cornerforge._words import shown
from cornerforge.errors import FileFormatError, InputError

__all__ = [
    "Closed", "Declared", "Hex", "Share", "Shown", "Whole", "allowed_types", "check_fields", "check_value", "hints_of",
    "is_several", "meant", "parse", "read", "shown_of", "unit_of",
]  # fmt: skip

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


class Shown(TypedDict, total=False):
    """Facts on an option besides its meaning, its unit and its range.

    Attributes:
        more: Further sentences for docstrings alone.
        choices: All values of a text; without it any.
        near: Words that a shell offers where `choices` are not all; ("av",) and ("odd",) stand for those names.
        name: Name on the command line, with its dashes; without it the field's name.
        metavar: What stands for the value in help; without it its type.
        default: What help says is the default, where the value None does not tell.
        also: A second name on the command line, with its dashes.
        many: The words after it on the command line belong to it too, up to the next option.
        hidden: For Python only, as `progress`.
    """

    more: str
    choices: tuple[str, ...]
    near: tuple[str, ...]
    name: str
    metavar: str
    default: str
    also: str
    many: bool
    hidden: bool


def meant(
    meaning: str, unit: str = "", low: float | None = None, high: float | None = None, **option: Unpack[Shown]
) -> msgspec.Meta:
    """Say what a field is.

    Args:
        meaning: One sentence, with the edge values; of an option its help, one or two sentences.
        unit: Unit of the values, "" for none.
        low, high: Smallest and largest number, inclusive; None: any, or the verb of an option checks it.
        option: What else is said of an option.
    """
    units = {"unit": unit} if unit else {}
    return msgspec.Meta(description=meaning, extra_json_schema=units, ge=low, le=high, extra=dict(option))


def unit_of(said: msgspec.Meta) -> str:
    """Give the unit that `meant` was told, "" for none."""
    return str((said.extra_json_schema or {}).get("unit", ""))


def shown_of(said: msgspec.Meta) -> Shown:
    """Give what `meant` was told of an option."""
    return cast("Shown", said.extra or {})


@functools.cache
def hints_of(kind: Any) -> dict[str, Any]:
    """Give the types of a class's fields with what is meant by them."""
    return get_type_hints(kind, include_extras=True)


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
    for name, hint in hints_of(kind).items():
        if name not in but and any(said.le is not None for said in getattr(hint, "__metadata__", ())):
            check_value(prefix + name, getattr(part, name), hint)


def check_value(name: str, value: Any, hint: Any) -> None:
    """Check that a value is of the type that an annotation says, a path one, and each number and name an allowed one.

    Raises:
        InputError: It is not; the message names the value, and what is allowed.
    """
    kinds = allowed_types(hint)
    if not any(_is_of(kind, value) for kind in kinds):
        raise InputError(f"{name} = {shown(value)} is not allowed; give {_listed(kinds)}.")
    each = [one for kind in kinds for one in (allowed_types(get_args(kind)[0]) if get_args(kind) else [kind])]
    for one in value if is_several(value) else [value]:
        if Path in each and isinstance(one, (str, os.PathLike)):
            check_path(one)
            if one == "":
                raise InputError(f'{name} = "" names no file or folder.')
        for said in getattr(hint, "__metadata__", ()) if one is not None else ():
            if choices := shown_of(said).get("choices"):
                check_in(name, one, choices)
            if said.ge is not None and int in each:
                check_integer(name, one, low=int(said.ge), high=None if said.le is None else int(said.le))
            elif said.ge is not None:
                high = math.inf if said.le is None else float(said.le)
                check_number(name, one, low=float(said.ge), high=high, unit=unit_of(said))


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


_PYTHON = {
    int: "a whole number", float: "a number", bool: "True or False", str: "text", Path: "a path", type(None): "None",
}  # fmt: skip


def _type_in_words(kind: Any) -> str:
    if get_origin(kind) is Sequence:
        return f"a list (each entry {_listed(allowed_types(get_args(kind)[0]))})"
    return _PYTHON.get(kind) or ("a function" if _is_function(kind) else kind.__name__)


def _listed(kinds: Sequence[Any]) -> str:
    words = list(dict.fromkeys(map(_type_in_words, kinds)))
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
    """Parse JSON strictly: what is there twice, or is no number of JSON and no text, is no value to be believed.

    Args:
        text: The JSON.
        finite: Refuse NaN and infinite numbers; False: let them through, to a reader that names what they are.

    Raises:
        ValueError: It is no JSON, has a key twice, a number that is not finite, or half a character, or is nested too
            deeply.
    """
    numbers: dict[str, Any] = {"parse_constant": _no_number, "parse_float": _finite} if finite else {}
    try:
        found = json.loads(text, object_pairs_hook=_once, **numbers)
        if re.search(r"\\u[dD][89a-fA-F]", text):
            json.dumps(found, ensure_ascii=False).encode()
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except UnicodeEncodeError as error:
        raise ValueError(f"the text {error.object[error.start]!a} is half a character") from None
    return found


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
