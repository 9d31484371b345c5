"""Abilities of a vehicle's class: the accelerations that are possible for it (docs/adr/0028-trucks.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel
from cornerforge.sim.actions import nearest_action
from cornerforge.types import ACCELERATIONS, CLASSES, FIRST_ACCELERATION, N_ACTIONS, TRUCK

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers

__all__ = ["cut_to_class", "possible_actions"]

_POWER, _RESISTANCE, _TOP_SPEED = CLASSES[TRUCK].power, CLASSES[TRUCK].resistance, CLASSES[TRUCK].top_speed
_HARDEST = FIRST_ACCELERATION + int((-CLASSES[TRUCK].braking > ACCELERATIONS).sum())
_LEAST_SPEED = 1.0


@inlined_kernel
def possible_actions(v: NDArray[np.void], i: int, road: RoadNumbers) -> tuple[int, int]:
    """Find the actions of the hardest braking and of the strongest acceleration that vehicle i can do.

    Only trucks have limits. What the engine's power allows is rounded to the nearest step; from its top speed on a
    truck does not accelerate.
    """
    if road.one_size or v[i].kind != TRUCK:
        return FIRST_ACCELERATION, N_ACTIONS - 1
    if v[i].speed >= _TOP_SPEED:
        return _HARDEST, nearest_action(0.0)
    return _HARDEST, nearest_action(_POWER / max(v[i].speed, _LEAST_SPEED) - _RESISTANCE)


@inlined_kernel
def cut_to_class(v: NDArray[np.void], i: int, action: int, road: RoadNumbers) -> int:
    """Return an acceleration's action, cut to the limits of vehicle i's class."""
    if action < FIRST_ACCELERATION:
        return action
    hardest, strongest = possible_actions(v, i, road)
    return max(hardest, min(strongest, action))
