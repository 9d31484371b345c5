"""View of a world for the AV under test: one array in SI units, for the learned AV and for AVs outside the kernels.

Row 0 is the AV, the other rows are the vehicles nearest to it along the road, nearest first, within sight (200 m centre
to centre); rows without a vehicle are 0. Columns:

| column | row 0, the AV | other rows |
| --- | --- | --- |
| 0 | 1 | 1; 0 where there is no vehicle |
| 1 | distance left to drive in this test [m] | centre ahead (+) or behind (-) of the AV's [m] |
| 2 | centre's distance from the right edge of the road [m] | centre to the left (+) or right (-) of the AV's [m] |
| 3 | speed along the road [m/s] | the same |
| 4 | lateral speed, to the left positive [m/s] | the same |
| 5 | acceleration along the road, as it is now [m/s2] | the same |
| 6 | lane that it keeps or changes to, 0 the rightmost | lane that it is seen to enter, else that of its centre |
| 7 | 1 while it changes lanes, else 0 | 1 from 0.375 m off the centre of its lane on, while it changes lanes |

Perception of what can be seen is perfect, as in the paper ("only decisions are tested"), unless the ODD says otherwise
(`perception.Perception`). What a driver has
decided cannot be seen before the vehicle moves (docs/adr/0023-what-an-av-sees.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel
from cornerforge.road.straight import ahead_by, distance_left
from cornerforge.sim.neighbours import SIGHT
from cornerforge.sim.sight import is_seen_changing, lane_entered

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.sight import SightNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = [
    "ACCELERATION", "AHEAD", "AV_VIEW_VERSION", "CHANGES", "LANE", "LATERAL_SPEED", "LEFT", "SPEED", "THERE",
    "VIEW_COLUMNS", "VIEW_ROWS", "nearest_along", "view_of_av",
]  # fmt: skip

AV_VIEW_VERSION = 1
"""Raised when an AV that reads the columns as documented would misread them."""
VIEW_ROWS = 13
THERE, AHEAD, LEFT, SPEED, LATERAL_SPEED, ACCELERATION, LANE, CHANGES = range(8)
"""The columns; in row 0, AHEAD is the distance left to drive, and LEFT is counted from the road's edge."""
VIEW_COLUMNS = CHANGES + 1


@inlined_kernel
def nearest_along(w: World, found: NDArray[np.int64], most: int) -> int:
    """List the slots of at most `most` vehicles nearest to the AV along the road in `found`; return how many."""
    v = w.vehicles
    count = 0
    for j in range(1, w.state[0].n_vehicles):
        distance = abs(ahead_by(v, 0, j))
        if v[j].present == 0 or distance >= SIGHT:
            continue
        place = count
        while place > 0 and abs(ahead_by(v, 0, found[place - 1])) > distance:
            if place < most:
                found[place] = found[place - 1]
            place -= 1
        if place < most:
            found[place] = j
            count = min(count + 1, most)
    return count


@inlined_kernel
def view_of_av(
    w: World, road: RoadNumbers, sight: SightNumbers, found: NDArray[np.int64], out: NDArray[np.float32]
) -> None:
    """Write the AV's view into `out`.

    Args:
        w: The world; the state of every vehicle must be that of this moment (`step.begin_to_act` with `everybody`).
        road: Constants.
        sight: What is seen of lane changes; by decision, columns 6 and 7 mean in all rows what they mean in row 0.
        found: Scratch, int64 (VIEW_ROWS - 1,) or more.
        out: float32 (VIEW_ROWS, VIEW_COLUMNS), as the head of this module says.
    """
    v = w.vehicles
    for row in range(VIEW_ROWS):
        for column in range(VIEW_COLUMNS):
            out[row, column] = 0.0
    for row in range(1 + nearest_along(w, found, VIEW_ROWS - 1)):
        j = 0 if row == 0 else found[row - 1]
        out[row, THERE] = 1.0
        out[row, AHEAD] = ahead_by(v, 0, j)
        out[row, LEFT] = v[j].y - v[0].y
        out[row, SPEED] = v[j].speed
        out[row, LATERAL_SPEED] = v[j].lateral_speed
        out[row, ACCELERATION] = v[j].acceleration
        out[row, LANE] = lane_entered(v, j, road.lane_width, sight)
        out[row, CHANGES] = 1.0 if is_seen_changing(v, j, road.lane_width, sight) else 0.0
    out[0, AHEAD] = distance_left(v, 0, road)
    out[0, LEFT] = v[0].y
    out[0, LANE] = v[0].target_lane
    out[0, CHANGES] = 1.0 if v[0].duration > 0.0 else 0.0
