"""Deceleration rate to avoid a crash."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.metrics._inputs import matching_arrays

__all__ = ["drac"]


def drac(bbd: ArrayLike, range_rate: ArrayLike) -> NDArray[np.float64]:
    """Give the constant braking of the subject that just avoids contact if the lead keeps its speed [m/s^2].

    Args:
        bbd: Bumper-to-bumper distance [m], shape (*d); negative means overlap, +inf no lead.
        range_rate: v_lead - v_subject [m/s], shape (*d); negative when closing.

    Returns:
        Shape (*d), in [0, inf], never NaN, positive for braking: 0 where not closing, +inf where closing with bbd <= 0.

    Raises:
        InputError: A value is NaN, or the shapes do not match.

    Source: Almqvist, Hyden and Risser (1991).
    >>> drac(np.array([20.0, 20.0, 0.0]), np.array([-10.0, 10.0, -1.0]))
    array([2.5, 0. , inf])
    """
    distance, rate = matching_arrays(bbd=bbd, range_rate=range_rate)
    braking = np.where(distance > 0.0, 0.0, np.inf)
    with np.errstate(over="ignore"):  # a distance near zero: +inf, as on contact
        np.divide(rate * rate, 2.0 * distance, out=braking, where=(distance > 0.0) & np.isfinite(distance))
    return np.where(rate < 0.0, braking, 0.0)
