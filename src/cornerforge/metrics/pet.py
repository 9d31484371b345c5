"""Post-encroachment time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.errors import InputError
from cornerforge.metrics._inputs import matching_arrays

__all__ = ["pet"]


def pet(enter_a: ArrayLike, leave_a: ArrayLike, enter_b: ArrayLike, leave_b: ArrayLike) -> NDArray[np.float64]:
    """Give the time between the first vehicle leaving a conflict area and the second entering it [s].

    The order of the two is found here, so exchanging them changes nothing.

    Args:
        enter_a: When the foremost point of vehicle a reaches the area [s], shape (*d); +inf if it never does.
        leave_a: When its rearmost point leaves it [s], shape (*d), not before `enter_a`; +inf if it stays.
        enter_b: The same for the other vehicle.
        leave_b: The same for the other vehicle.

    Returns:
        Shape (*d), in [0, inf], never NaN: 0 where both are in the area at once (they need not touch) or one enters as
        the other leaves, +inf where one of them never enters.

    Raises:
        InputError: A value is NaN or -inf, a vehicle leaves before it enters, or the shapes do not match.

    Source: Allen, Shin and Cooper (1978).
    >>> pet([1.0, 5.0, 1.0, np.inf], [2.0, 6.0, 4.0, np.inf], [5.0, 1.0, 3.0, 3.0], [6.0, 2.0, 5.0, 4.0])
    array([ 3.,  3.,  0., inf])
    """
    in_a, out_a, in_b, out_b = matching_arrays(enter_a=enter_a, leave_a=leave_a, enter_b=enter_b, leave_b=leave_b)
    for name, entered, left in (("a", in_a, out_a), ("b", in_b, out_b)):
        if np.isneginf(entered).any():
            raise InputError(f"Vehicle {name} enters at -inf s; give the moment at which the observation begins.")
        if (left < entered).any():
            place = tuple(int(i) for i in np.argwhere(left < entered)[0])
            raise InputError(
                f"Vehicle {name} leaves at {left[place]} s, before it enters at {entered[place]} s; exchange the two."
            )
    both_enter = np.isfinite(in_a) & np.isfinite(in_b)
    between = np.full(in_a.shape, np.inf)
    # The larger difference has the true order; the other counts the whole encounter backwards.
    np.subtract(in_b, out_a, out=between, where=both_enter)
    other = np.full(in_a.shape, np.inf)
    np.subtract(in_a, out_b, out=other, where=both_enter)
    return np.asarray(np.maximum(np.maximum(between, other), 0.0))
