"""Accelerations that are possible for a vehicle: what its class can do, and what lets it stop where it must.

Of classes see docs/adr/0028-trucks.md, of lanes docs/adr/0077-traffic-on-roads.md, of queues
docs/adr/0078-traffic-that-stops.md.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.actions import nearest_action
from cornerforge.sim.braking import last_to_stop
from cornerforge.sim.merging import suitable_accelerations
from cornerforge.sim.neighbours import rank_of
from cornerforge.types import ACCELERATIONS, CLASSES, FIRST_ACCELERATION, N_ACTIONS, TRUCK

if TYPE_CHECKING:
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = ["cut_all", "cut_to_class", "possible_actions"]

_POWER, _RESISTANCE, _TOP_SPEED = CLASSES[TRUCK].power, CLASSES[TRUCK].resistance, CLASSES[TRUCK].top_speed
_HARDEST = FIRST_ACCELERATION + int((-CLASSES[TRUCK].braking > ACCELERATIONS).sum())
_LEAST_SPEED = 1.0
_NONE = -math.inf


@inlined_kernel
def _possible(w: World, i: int, rank: int, last: int, road: RoadNumbers) -> tuple[int, int]:
    """Do the same as `possible_actions` for vehicle i, at a rank; `last`: `braking.last_to_stop`."""
    v = w.vehicles
    hardest, strongest = FIRST_ACCELERATION, N_ACTIONS - 1
    if not road.one_size and v[i].kind == TRUCK:
        hardest, strongest = _HARDEST, nearest_action(0.0)
        if v[i].speed < _TOP_SPEED:
            strongest = nearest_action(_POWER / max(v[i].speed, _LEAST_SPEED) - _RESISTANCE)
    if road.stops:
        least, most = suitable_accelerations(w, i, rank, last, road)
        if least > _NONE:
            hardest = min(strongest, nearest_action(least))
        if most < -_NONE:
            strongest = max(hardest, min(strongest, nearest_action(most)))
    return hardest, strongest


@kernel
def possible_actions(w: World, i: int, road: RoadNumbers) -> tuple[int, int]:
    """Find the actions of the hardest braking and of the strongest acceleration that vehicle i can do.

    Of classes only trucks have limits. What the engine's power allows is rounded to the nearest step; from its top
    speed on a truck does not accelerate. Where traffic stops see `suitable_accelerations`.
    """
    rank = rank_of(w, i) if road.stops else 0  # else `order` need not be sorted
    return _possible(w, i, rank, last_to_stop(w, road), road)


@inlined_kernel
def cut_to_class(w: World, i: int, action: int, road: RoadNumbers) -> int:
    """Return an acceleration's action, cut to what vehicle i can do."""
    if action < FIRST_ACCELERATION:
        return action
    hardest, strongest = possible_actions(w, i, road)
    return max(hardest, min(strongest, action))


@kernel
def cut_all(w: World, controlled: int, road: RoadNumbers) -> None:
    """Cut the actions of all BVs to what they can do, but that of the controlled one and of those that look away."""
    v = w.vehicles
    last = last_to_stop(w, road)
    for rank in range(w.state[0].n_vehicles):
        i = w.order[rank]
        if i > 0 and i != controlled and v[i].away == 0 and v[i].action >= FIRST_ACCELERATION:
            hardest, strongest = _possible(w, i, rank, last, road)
            v[i].action = max(hardest, min(strongest, v[i].action))
