"""Checks at the border (public functions, files, command line), with their messages.

Every message says what was wrong, its value, what is allowed, and where.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError, UnknownNameError

__all__ = ["check_finite", "check_in", "check_integer", "check_number"]


def check_integer(name: str, value: int, *, low: int, high: int | None = None) -> int:
    """Return `value` if it is a whole number in [low, high] (no upper limit if None).

    Raises:
        InputError: It is not.

    >>> check_integer("tests", 5, low=1)
    5
    """
    allowed = f"at least {low}" if high is None else f"from {low} to {high}"
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InputError(f"{name} = {value!r} is not a whole number; allowed: {allowed}.")
    if value < low or (high is not None and value > high):
        raise InputError(f"{name} = {value} is out of range; allowed: {allowed}.")
    return int(value)


def check_number(name: str, value: float, *, low: float, high: float, unit: str = "") -> float:
    """Return `value` as float if it is a finite number in [low, high].

    Raises:
        InputError: It is not a number, NaN, infinite or outside.
    """
    tail = f" {unit}" if unit else ""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(f"{name} = {value!r} is not a number; allowed: {low} to {high}{tail}.")
    if value < low or value > high or not math.isfinite(value):  # in this order: a whole number may be no float
        raise InputError(f"{name} = {value}{tail} is out of range; allowed: {low} to {high}{tail}.")
    return float(value)


def check_in(name: str, value: str, allowed: tuple[str, ...]) -> str:
    """Return `value` if it is one of `allowed`.

    Raises:
        UnknownNameError: It is not; the nearest allowed value is suggested.
    """
    if value not in allowed:
        raise UnknownNameError(name, value, allowed)
    return value


def check_finite(name: str, values: NDArray[np.floating]) -> None:
    """Check that an array of any shape holds neither NaN nor infinity.

    Raises:
        InputError: It does; the message names the first place.
    """
    bad = ~np.isfinite(values)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"{name}{list(first)} = {values[first]} is not finite ({int(bad.sum())} such value(s)); mend the input."
        )
