"""Change of velocity in an impact."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.errors import InputError
from cornerforge.metrics._inputs import check_sizes, matching_arrays

__all__ = ["FRICTION", "delta_v"]

FRICTION = 0.5
"""Default friction between two vehicles' bodies that slide along each other, our choice. It is an input in all models
of this kind; between 0.3 and 0.7 the delta-v of a pure sideswipe changes by a sixth."""


def delta_v(
    closing_speed: ArrayLike,
    sliding_speed: ArrayLike = 0.0,
    mass: ArrayLike = 1.0,
    other_mass: ArrayLike = 1.0,
    restitution: ArrayLike = 0.0,
    friction: ArrayLike = FRICTION,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give a vehicle's change of velocity in an impact with another, across and along the touching faces [m/s].

    Across the faces momentum is kept, and the two part with `restitution` times the speed at which they closed in.
    Along them friction pulls with `friction` times the impulse across, until they no longer slide. No outer force acts
    meanwhile, and no vehicle turns: an impact off the centre of mass changes its velocity by less than this.

    Args:
        closing_speed: Part of the relative velocity across the touching faces [m/s], shape (*d), not negative.
        sliding_speed: Part of the relative velocity along them [m/s], shape (*d), not negative.
        mass: Mass of this vehicle, in any unit, shape (*d), positive.
        other_mass: Mass of the other vehicle, in the same unit, positive.
        restitution: 0 (perfectly plastic) to 1 (perfectly elastic). Measured ones fall from about 0.3 at low to about
            0.1 and less at high impact speeds.
        friction: Not negative; inf: they stick together.

    Returns:
        Two of shape (*d): across the faces, in [0, 2 closing speeds]; along them, in [0, sliding speed]. Its size is
        their `numpy.hypot`.

    Raises:
        InputError: A value is NaN, infinite (friction may be) or out of range, or the shapes do not match.

    Source: conservation of momentum, Newton's law of restitution, Coulomb's of friction: the planar impact of Brach
    (1983), "Analysis of planar vehicle collisions using equations of impulse and momentum", without rotation.
    >>> delta_v([1.0, 1.0], [10.0, 0.4])
    (array([0.5, 0.5]), array([0.25, 0.2 ]))
    """
    closing, sliding, own, other, bounce, grip = matching_arrays(
        closing_speed=closing_speed, sliding_speed=sliding_speed, mass=mass, other_mass=other_mass,
        restitution=restitution, friction=friction,
    )  # fmt: skip
    check_sizes(closing_speed=closing, sliding_speed=sliding, friction=np.minimum(grip, 1.0))  # inf is allowed
    check_sizes(zero=False, mass=own, other_mass=other)
    if ((bounce < 0.0) | (bounce > 1.0)).any():
        raise InputError("A restitution is out of range; allowed: 0 (plastic) to 1 (elastic).")
    share = other / (own + other)
    met = (1.0 + bounce) * closing
    held = np.where(met > 0.0, grip, 0.0) * met  # no pressure: no friction, however rough
    return np.asarray(share * met), np.asarray(share * np.minimum(held, sliding))
