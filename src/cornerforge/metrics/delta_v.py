"""Change of velocity in an impact."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.errors import InputError
from cornerforge.metrics._inputs import matching_arrays

__all__ = ["FRICTION", "delta_v", "velocity_changes"]

FRICTION = 0.5
"""Friction between two vehicles' bodies that slide along each other, if nobody says otherwise: our choice. It is an
input in all models of this kind; between 0.3 and 0.7 the delta-v of a pure sideswipe changes by a sixth."""


def velocity_changes(
    closing_speed: ArrayLike,
    sliding_speed: ArrayLike = 0.0,
    mass: ArrayLike = 1.0,
    other_mass: ArrayLike = 1.0,
    restitution: ArrayLike = 0.0,
    friction: ArrayLike = FRICTION,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Changes of a vehicle's velocity across and along the touching faces, in an impact with another one [m/s].

    Across the faces momentum is kept, and the two part with `restitution` times the speed at which they closed in.
    Along them friction pulls with `friction` times the impulse across, until they no longer slide. No outer force acts
    meanwhile, and nobody turns: a blow past the centre of mass changes its velocity by less than this.

    Args:
        closing_speed: Part of the relative velocity across the touching faces [m/s], shape (*d), not negative.
        sliding_speed: Part of the relative velocity along them [m/s], shape (*d), not negative.
        mass: Of the vehicle asked for, in any unit, shape (*d), positive.
        other_mass: Of the other vehicle, in the same unit, positive.
        restitution: 0 (perfectly plastic) to 1 (perfectly elastic). Measured ones fall from about 0.3 at low to about
            0.1 and less at high impact speeds.
        friction: Not negative; inf: they stick together.

    Returns:
        Two of shape (*d): across the faces, in [0, 2 closing speeds]; along them, in [0, sliding speed].

    Raises:
        InputError: A value is NaN or out of range, or the shapes do not match.

    Source: conservation of momentum, Newton's law of restitution, Coulomb's of friction: the planar impact of Brach
    (1983), "Analysis of planar vehicle collisions using equations of impulse and momentum", without rotation.
    >>> velocity_changes([1.0, 1.0], [10.0, 0.4])
    (array([0.5, 0.5]), array([0.25, 0.2 ]))
    """
    closing, sliding, own, other, bounce, grip = matching_arrays(
        closing_speed=closing_speed,
        sliding_speed=sliding_speed,
        mass=mass,
        other_mass=other_mass,
        restitution=restitution,
        friction=friction,
    )
    for name, speed in (("closing_speed", closing), ("sliding_speed", sliding)):
        if (speed < 0.0).any():
            raise InputError(f"{name} = {float(speed.min())} m/s is negative; give its size.")
    if ((own <= 0.0) | (other <= 0.0)).any():
        raise InputError("A mass is not positive; give both masses in the same unit.")
    if ((bounce < 0.0) | (bounce > 1.0)).any():
        raise InputError("A restitution is out of range; allowed: 0 (plastic) to 1 (elastic).")
    if (grip < 0.0).any():
        raise InputError("A friction is negative; allowed: 0 (none) and more.")
    share = other / (own + other)
    met = (1.0 + bounce) * closing
    held = np.where(met > 0.0, grip, 0.0) * met  # nobody presses: nothing rubs, however rough
    return np.asarray(share * met), np.asarray(share * np.minimum(held, sliding))


def delta_v(
    closing_speed: ArrayLike,
    sliding_speed: ArrayLike = 0.0,
    mass: ArrayLike = 1.0,
    other_mass: ArrayLike = 1.0,
    restitution: ArrayLike = 0.0,
    friction: ArrayLike = FRICTION,
) -> NDArray[np.float64]:
    """Change of a vehicle's velocity in an impact with another one [m/s]: the size of both `velocity_changes`.

    As given, bumper to bumper between equal masses, half the closing speed. Arguments, errors and source are those of
    `velocity_changes`.

    Returns:
        Shape (*d), not negative.

    >>> delta_v([10.0, 10.0, 10.0], 0.0, [1500.0, 1500.0, 1500.0], [1500.0, 1500.0, 3000.0], [0.0, 0.2, 0.0])
    array([5.        , 6.        , 6.66666667])
    """
    across, along = velocity_changes(closing_speed, sliding_speed, mass, other_mass, restitution, friction)
    return np.asarray(np.hypot(across, along))
