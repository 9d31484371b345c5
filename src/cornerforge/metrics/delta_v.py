"""Change of velocity in an impact."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.errors import InputError
from cornerforge.metrics._inputs import matching_arrays

__all__ = ["delta_v"]


def delta_v(
    impact_speed: ArrayLike, mass: ArrayLike = 1.0, other_mass: ArrayLike = 1.0, restitution: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """Change of a vehicle's velocity in an impact with another one [m/s].

    The impact is central and no outer force acts during it: momentum is kept, and the two part with `restitution` times
    the speed at which they met. As given, the impact is perfectly plastic (both go on together), between equal masses:
    half the impact speed. A glancing blow, in which the vehicles slide along each other, changes velocities by less, so
    this is an upper bound for sideswipes.

    Args:
        impact_speed: Size of the relative velocity at contact [m/s], shape (*d), not negative.
        mass: Of the vehicle asked for, in any unit, shape (*d), positive.
        other_mass: Of the other vehicle, in the same unit, positive.
        restitution: 0 (perfectly plastic) to 1 (perfectly elastic). Measured ones fall from about 0.3 at low to about
            0.1 and less at high impact speeds.

    Returns:
        Shape (*d), in [0, 2 impact speeds].

    Raises:
        InputError: A value is NaN or out of range, or the shapes do not match.

    Source: conservation of momentum; Newton's law of restitution.
    >>> delta_v([10.0, 10.0, 10.0], [1500.0, 1500.0, 1500.0], [1500.0, 1500.0, 3000.0], [0.0, 0.2, 0.0])
    array([5.        , 6.        , 6.66666667])
    """
    speed, own, other, bounce = matching_arrays(
        impact_speed=impact_speed, mass=mass, other_mass=other_mass, restitution=restitution
    )
    if (speed < 0.0).any():
        raise InputError(
            f"impact_speed = {float(speed.min())} m/s is negative; give the size of the relative velocity."
        )
    if ((own <= 0.0) | (other <= 0.0)).any():
        raise InputError("A mass is not positive; give both masses in the same unit.")
    if ((bounce < 0.0) | (bounce > 1.0)).any():
        raise InputError("A restitution is out of range; allowed: 0 (plastic) to 1 (elastic).")
    return np.asarray(speed * (1.0 + bounce) * other / (own + other))
