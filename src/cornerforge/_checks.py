"""Checks at the border (public functions, files, command line), with their messages.

Every message says what was wrong, its value, what is allowed, and where.
"""

from __future__ import annotations

import json
import numbers
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cornerforge._words import shown
from cornerforge.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "check_finite",
    "check_in",
    "check_integer",
    "check_is_json",
    "check_number",
    "check_path",
]


def check_path(path: os.PathLike[str] | str) -> None:
    """Check that a path is valid text: a file can have another name, but no message or file could hold that name.

    Raises:
        InputError: The path is no valid text, or holds the character that ends texts.
    """
    try:
        name = os.fsdecode(path)
        name.encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{os.fspath(path)!a} is no UTF-8; choose another name.") from error
    if "\0" in name:
        raise InputError(f"{shown(name)} is no name of a file, because it holds a NUL; choose another name.")


def check_integer(name: str, value: int, *, low: int, high: int | None = None) -> int:
    """Return `value` if it is a whole number in [low, high] (no upper limit if None).

    Raises:
        InputError: It is not.

    >>> check_integer("tests", 5, low=1)
    5
    """
    allowed = f"at least {low}" if high is None else f"from {low} to {high}"
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise InputError(f"{name} = {shown(value)} is not a whole number; allowed: {allowed}.")
    if value < low or (high is not None and value > high):
        raise InputError(f"{name} = {shown(value)} is out of range; allowed: {allowed}.")
    return int(value)


def check_number(name: str, value: float, *, low: float, high: float, unit: str = "") -> float:
    """Return `value` as float if it is a finite number in [low, high].

    Raises:
        InputError: It is not a number, NaN, infinite or outside.
    """
    tail = f" {unit}" if unit else ""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InputError(f"{name} = {shown(value)} is not a number; allowed: {low} to {high}{tail}.")
    if not low <= value <= high:
        raise InputError(f"{name} = {value}{tail} is out of range; allowed: {low} to {high}{tail}.")
    return float(value)


def check_in(name: str, value: str, allowed: tuple[str, ...]) -> str:
    """Return `value` if it is one of `allowed`.

    Raises:
        UnknownNameError: It is not; the nearest allowed value is suggested.
    """
    if not isinstance(value, str) or value not in allowed:
        raise UnknownNameError(name, value, allowed)
    return value


def check_finite(name: str, values: NDArray[np.floating]) -> None:
    """Check that an array of any shape holds neither NaN nor infinity.

    Raises:
        InputError: It does; the message names the first place.
    """
    import numpy as np

    bad = ~np.isfinite(values)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"{name}{list(first)} = {values[first]} is not finite ({int(bad.sum())} such value(s)); mend the input."
        )


def check_is_json(name: str, value: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a dictionary that JSON can hold as it is.

    Raises:
        InputError: It is no dictionary, or holds what JSON cannot: NaN, infinity, an array, a number of NumPy, bytes.

    >>> check_is_json("about", {"seed": 1})
    {'seed': 1}
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{name} = {shown(value)} is not a dictionary with texts as keys.")
    for key, one in value.items():
        try:
            json.dumps({key: one}, allow_nan=False, ensure_ascii=False).encode()
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"{name}[{shown(key)}] = {shown(one)} cannot be kept as JSON: {error}.") from None
    return dict(value)
