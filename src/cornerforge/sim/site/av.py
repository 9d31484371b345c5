"""Built-in AVs of sites: they look as drivers do, every tenth of a second, and take no chance."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import shared_kernel
from cornerforge.sim.site.look import look_as_driver, seconds_of
from cornerforge.sim.world import NO_VEHICLE
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from cornerforge.drivers.avs import AvNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = ["junction_av_decides"]

_STANDS, _CREEPS = 0.5, 1.5
_TAKES = 0.5


@shared_kernel
def junction_av_decides(w: World, substep: int, road: RoadNumbers, av: AvNumbers) -> float:
    """Decide for a built-in AV at a site: the acceleration that it commands [m/s2].

    It goes where its gap is at least its own critical one, and has then decided to go. A creeping one edges forward
    where it should wait.
    """
    own = w.agents[0]
    seconds = seconds_of(w) - (1.0 if substep > 0 else 0.0) + substep * FRAME_S
    look_as_driver(w, 0, w.state[0].clock + seconds, road.site)
    if own.chooses and own.goes >= _TAKES:
        own.cleared = max(own.cleared, own.until)
        return own.free
    if not own.chooses:
        return own.free
    if av.junction.creeps and own.for_whom != NO_VEHICLE and w.vehicles[0].speed < _CREEPS:
        return max(own.stops, min(own.free, _CREEPS - w.vehicles[0].speed))
    return own.stops
