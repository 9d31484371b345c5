"""Visible lanes of a vehicle: where its body is, and where it moves; never what its driver decided."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel
from cornerforge.drivers.sight import BY_CENTRE, BY_DECISION, BY_MOTION
from cornerforge.geometry import path_at
from cornerforge.road.straight import lane_bits, lane_centre, lane_of
from cornerforge.sim.motion import path_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.drivers.sight import SightNumbers

__all__ = ["is_seen_changing", "lane_entered", "lanes_seen"]

_BY_CENTRE, _BY_DECISION, _BY_MOTION = BY_CENTRE, BY_DECISION, BY_MOTION


@inlined_kernel
def lane_entered(v: NDArray[np.void], j: int, lane_width: float, sight: SightNumbers) -> int:
    """Find the lane that vehicle j is seen to enter; the lane of its centre where it is seen to enter none.

    Seen by motion, it enters the lane towards which it moves: as soon as its body is over the line, or its centre was
    `offset` off the centre of its lane `perception_time` ago; with `indicators`, from the begin of its change on if its
    driver announces it. Where it was then is reckoned back from its lateral
    position, speed and acceleration now, which no decision changes at once: with 0.375 m and 0.4 s a vehicle that takes
    4 s to change lanes is seen after 1.37 s, and was 0.375 m off after 0.96 s.
    """
    if (
        sight.by == _BY_DECISION
        or v[j].duration == 0.0
        or (sight.by == _BY_MOTION and sight.indicators and v[j].signals & 1)
    ):
        target: int = v[j].target_lane
        return target
    own = lane_of(v[j].y, lane_width)
    if sight.by == _BY_CENTRE:
        return own
    side = 0
    if v[j].lateral_speed > 0.0:
        side = 1
    elif v[j].lateral_speed < 0.0:
        side = -1
    entered = lane_of(v[j].y + side * 0.5 * v[j].width, lane_width)
    if entered == own:
        y = v[j].y
        ago = sight.perception_time
        if ago > 0.0:
            _, speed, acceleration = path_at(path_of(v, j), v[j].clock)
            y -= ago * (speed - 0.5 * ago * acceleration)
        if side * (y - lane_centre(own, lane_width)) >= sight.offset:
            entered = own + side
    return max(0, entered)


@inlined_kernel
def is_seen_changing(v: NDArray[np.void], j: int, lane_width: float, sight: SightNumbers) -> bool:
    """Is vehicle j seen to change lanes: is its centre `offset` off the centre of a lane while it does?"""
    if v[j].duration == 0.0 or sight.by == _BY_DECISION:
        changes: bool = v[j].duration > 0.0
        return changes
    off: float = abs(v[j].y - lane_centre(lane_of(v[j].y, lane_width), lane_width))
    return off >= sight.offset


@inlined_kernel
def lanes_seen(v: NDArray[np.void], j: int, lane_width: float, sight: SightNumbers) -> int:
    """Find the lanes that vehicle j is seen in, as a bit mask: lanes that its body touches, and the lane it enters.

    Seen by decision, they are all lanes that it occupies (`VEHICLE.lanes`); by centre, the lane of its centre.
    """
    if sight.by == _BY_DECISION or (sight.by == _BY_MOTION and v[j].duration == 0.0):
        lanes: int = v[j].lanes
        return lanes
    if sight.by == _BY_CENTRE:
        return 1 << lane_of(v[j].y, lane_width)
    return lane_bits(v[j].y, 0.5 * v[j].width, lane_entered(v, j, lane_width, sight), lane_width)
