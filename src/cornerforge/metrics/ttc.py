"""Time to collision."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.metrics._inputs import matching_arrays

__all__ = ["ttc"]


def ttc(bbd: ArrayLike, range_rate: ArrayLike) -> NDArray[np.float64]:
    """Give the time until contact if both vehicles kept their speeds [s].

    Args:
        bbd: Bumper-to-bumper distance [m], shape (*d); negative means overlap, +inf no lead.
        range_rate: v_lead - v_subject [m/s], shape (*d); negative when closing.

    Returns:
        Shape (*d), in [0, inf], never NaN: 0 where bbd <= 0, +inf where not closing.

    Raises:
        InputError: A value is NaN, or the shapes do not match.

    Source: Hayward (1972). Paper: Figure 3(c) and (d).
    >>> ttc(np.array([20.0, 20.0, -1.0]), np.array([-5.0, 5.0, 5.0]))
    array([ 4., inf,  0.])
    """
    distance, rate = matching_arrays(bbd=bbd, range_rate=range_rate)
    time = np.full(distance.shape, np.inf)
    with np.errstate(over="ignore"):  # a closing speed near zero: the quotient is +inf, as it should be
        np.divide(distance, -rate, out=time, where=(rate < 0.0) & np.isfinite(distance))
    return np.where(distance <= 0.0, 0.0, time)
