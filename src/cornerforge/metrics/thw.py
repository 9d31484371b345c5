"""Time headway."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.metrics._inputs import matching_arrays

__all__ = ["thw"]


def thw(bbd: ArrayLike, v_subject: ArrayLike) -> NDArray[np.float64]:
    """Give the time that the subject's front bumper needs to where the lead's rear bumper is now [s].

    Args:
        bbd: Bumper-to-bumper distance [m], shape (*d); negative means overlap, +inf no lead.
        v_subject: Speed of the vehicle behind [m/s], shape (*d); not positive means standstill.

    Returns:
        Shape (*d), in [0, inf], never NaN: 0 where bbd <= 0 (as for the time to collision), else +inf at standstill.

    Raises:
        InputError: A value is NaN, or the shapes do not match.

    Source: the net (bumper-to-bumper) form; the gross form, from front to front, would add the lead's length.
    >>> thw(np.array([30.0, 30.0, -1.0]), np.array([20.0, 0.0, 20.0]))
    array([1.5, inf, 0. ])
    """
    distance, speed = matching_arrays(bbd=bbd, v_subject=v_subject)
    time = np.full(distance.shape, np.inf)
    with np.errstate(over="ignore"):  # a speed near zero: the quotient is +inf, as at standstill
        np.divide(distance, speed, out=time, where=(speed > 0.0) & np.isfinite(distance))
    return np.where(distance <= 0.0, 0.0, time)
