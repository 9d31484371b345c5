"""Checks of arguments that all measures share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.errors import InputError

__all__ = ["check_sizes", "matching_arrays"]


def matching_arrays(**values: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    """Turn named arguments into float64 arrays of one common shape.

    Returns:
        One read-only array per argument, in the order given.

    Raises:
        InputError: A value is not a number or NaN, or the shapes do not broadcast; the message names the argument.

    >>> [a.shape for a in matching_arrays(x=[1.0, 2.0], length=5.0)]
    [(2,), (2,)]
    """
    arrays = [_as_float(name, value) for name, value in values.items()]
    try:
        return tuple(np.broadcast_arrays(*arrays))
    except ValueError as error:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in zip(values, arrays, strict=True))
        raise InputError(f"The shapes do not match: {shapes}; give equal shapes or single numbers.") from error


def _as_float(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} = {value!r} is not an array of numbers.") from error
    is_nan = np.isnan(array)
    if is_nan.any():
        place = [int(i) for i in np.argwhere(is_nan)[0]]
        raise InputError(
            f"{name}{place if place else ''} is NaN ({int(is_nan.sum())} such value(s)); leave absent vehicles out, "
            "or give them a distance of inf."
        )
    return array


def check_sizes(*, zero: bool = True, **values: NDArray[np.float64]) -> None:
    """Check that all values are finite and positive, or 0 unless `zero` is False.

    Raises:
        InputError: One is not; the message names the argument and its first value out of range.
    """
    for name, array in values.items():
        bad = array[~((array >= 0.0 if zero else array > 0.0) & (array < np.inf))]
        if bad.size:
            allowed = "0 and more" if zero else "more than 0"
            raise InputError(f"{name} = {bad[0]} is out of range; allowed: {allowed}, but finite.")
