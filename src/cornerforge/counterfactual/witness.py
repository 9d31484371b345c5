"""Drive a way out that a search found, and check whether a vehicle touches the AV.

This check shares nothing with the search except the simulator's own motion and contact.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import kernel
from cornerforge.counterfactual.motion import change_to, take_over_av
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.recordings import box_in
from cornerforge.sim import actions, motion
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.counterfactual.search import Manoeuvres
    from cornerforge.recordings import Trajectories
    from cornerforge.sim import World

__all__ = ["drive_way_out"]

_DT = FRAME_S


@kernel
def drive_way_out(
    test: Trajectories, moment: int, accelerations: NDArray[np.float64], lanes: NDArray[np.int64], m: Manoeuvres,
    w: World, track: NDArray[np.float64],
) -> int:  # fmt: skip
    """Drive the AV by its decisions, then to a stop, among the other vehicles as they are in the frames.

    While the decisions last, every vehicle counts; while the AV stops, only vehicles ahead of it when it begins to.

    Args:
        test: Recording with its continuation.
        moment: Frame of the first decision.
        accelerations: Commanded from each decision on [m/s2], (decisions,).
        lanes: Target lane from each decision on, of `m.evasive`, (decisions,).
        m: What the AV may do: `every`, `stopping`, `road`, `evasive` and `parts` are read.
        w: Scratch, one row at least.
        track: Filled with [x m, y m, speed m/s, heading rad] from `moment` to the end of the decisions, (at least
            1 + decisions * every, 4).

    Returns:
        The first frame at which a vehicle touches the AV, or -1.
    """
    v = w.vehicles
    frames, body = test.frames, test.bodies[0]
    every, stopping, road, evasive = m.every, m.stopping, m.road, m.evasive
    take_over_av(w, 0, test, moment, m.parts, road, evasive)
    end = moment + every * accelerations.size
    x_end = 0.0
    f = moment
    while True:
        if f <= end:
            track[f - moment, 0] = v[0].x
            track[f - moment, 1] = v[0].y
            track[f - moment, 2] = v[0].speed
            track[f - moment, 3] = v[0].heading
        if f > moment:
            for j in range(1, test.n):
                counts = frames[f, j].present != 0 and (f <= end or frames[end, j].x > x_end)
                if counts and boxes_overlap(
                    Box(v[0].x, v[0].y, v[0].heading, body.length, body.width), box_in(test, f, j)
                ):
                    return f
        if f == end:
            actions.hold(v, 0, -stopping, evasive)
            x_end = v[0].x
        if f >= end and v[0].speed == 0.0:
            return -1
        if f < end and (f - moment) % every == 0:
            k = (f - moment) // every
            actions.hold(v, 0, accelerations[k], evasive)
            if lanes[k] != v[0].target_lane:
                change_to(w, 0, lanes[k], m.parts, evasive)
        began = end if f >= end else f - (f - moment) % every
        f += 1
        motion.move_vehicle(v, 0, (f - began) * _DT, evasive)
