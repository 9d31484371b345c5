"""View of a world for an AV of interface 2: boxes with identities, in road coordinates and SI units.

Row 0 is the AV, the other rows are the vehicles nearest to it along the road, nearest first, within sight (200 m centre
to centre). Columns, float64:

| column | what |
| --- | --- |
| 0 ID | 0 the AV, else a number that stays with the vehicle as long as the test lasts; -1: no vehicle, all else 0 |
| 1 KIND | index of `types.CLASSES`: 0 car, 1 truck, 2 motorcycle |
| 2 LENGTH, 3 WIDTH | of its box [m] |
| 4 X | box centre along the road, from where the AV started [m] |
| 5 Y | box centre from the right edge of the road, to the left [m] |
| 6 HEADING | counter-clockwise from the road's direction [rad] |
| 7 VX, 8 VY | velocity of the centre along and across the road [m/s] |
| 9 AX, 10 AY | acceleration along and across the road [m/s2] |
| 11 YAW_RATE | [rad/s] |
| 12 INDICATOR | 1 left, -1 right, 0 none |
| 13 LANE | that holds its centre, 0 the rightmost |
| 14 TIME | row 0: since the start of the test [s] |
| 15 LEFT_TO_DRIVE | row 0: distance left in this test [m] |
| 16 CURVATURE | row 0: of its way now, to the left positive [1/m]; 0 for an AV that orders lanes |
| 17 TARGET_LANE | row 0: lane that it keeps or changes to |

Perception is perfect unless the ODD says otherwise (`perception.Perception`); what a driver has decided is seen only by
the indicator, which some drivers do not use, and by motion.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.sight import VISIBLE
from cornerforge.geometry import path_at
from cornerforge.road.straight import distance_left, driven, lane_centre, lane_of
from cornerforge.sim.av_view import VIEW_COLUMNS, nearest_along, view_of_av
from cornerforge.sim.motion import path_of
from cornerforge.sim.perception import show_as_is, show_as_seen
from cornerforge.sim.site.scene import FIRST_AGENT, SITE_COLUMNS, site_scene_of_av
from cornerforge.site.tables import at_site
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import AvScratch
from cornerforge.sim.world import World

__all__ = [
    "AX",
    "AY",
    "CURVATURE",
    "FIRST_AGENT",
    "HEADING",
    "ID",
    "INDICATOR",
    "KIND",
    "LANE",
    "LEFT_TO_DRIVE",
    "LENGTH",
    "SCENE_COLUMNS",
    "SITE_COLUMNS",
    "TARGET_LANE",
    "TIME",
    "VX",
    "VY",
    "WIDTH",
    "YAW_RATE",
    "X",
    "Y",
    "scene_of_av",
    "show_to_av",
]  # fmt: skip

(
    ID, KIND, LENGTH, WIDTH, X, Y, HEADING, VX, VY, AX, AY, YAW_RATE, INDICATOR, LANE, TIME, LEFT_TO_DRIVE, CURVATURE,
    TARGET_LANE,
) = range(18)  # fmt: skip
SCENE_COLUMNS = TARGET_LANE + 1
_DT = FRAME_S


@inlined_kernel
def _lateral_acceleration(w: World, j: int) -> float:
    """Compute the acceleration of slot j across the road [m/s2]."""
    v = w.vehicles
    if j == 0 and w.av[0].steers:
        sine, cosine = sin_cos(v[0].heading)
        speed = v[0].speed * cosine + v[0].lateral_speed * sine
        bent: float = speed * speed * w.av[0].curvature * cosine + v[0].acceleration * sine
        return bent
    if v[j].duration == 0.0:
        return 0.0
    across: float = path_at(path_of(v, j), v[j].clock)[2]
    return across


@inlined_kernel
def _indicator(v: NDArray[np.void], j: int, road: RoadNumbers) -> float:
    """Say which way slot j indicates: 1 left, -1 right, 0 not; the AV's own indicator is not known."""
    if j == 0 or v[j].signals & 1 == 0 or v[j].duration == 0.0:
        return 0.0
    return 1.0 if v[j].c0 < lane_centre(v[j].target_lane, road.lane_width) else -1.0


@inlined_kernel
def scene_of_av(w: World, road: RoadNumbers, found: NDArray[np.int64], out: NDArray[np.float64]) -> None:
    """Write what the AV sees into `out`.

    Args:
        w: The world; the state of every vehicle must be that of this moment (`step.begin_to_act` with `everybody`).
        road: Constants.
        found: Scratch, int64 (slots,).
        out: float64 (1 + how many to show at most, SCENE_COLUMNS), as the head of this module says.
    """
    v, state = w.vehicles, w.state[0]
    count = nearest_along(w, found, out.shape[0] - 1)
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            out[row, column] = 0.0
        if row > count:
            out[row, ID] = -1.0
            continue
        j = 0 if row == 0 else found[row - 1]
        across = _lateral_acceleration(w, j)
        squared = v[j].speed * v[j].speed + v[j].lateral_speed * v[j].lateral_speed
        out[row, ID] = j
        out[row, KIND] = v[j].kind
        out[row, LENGTH] = v[j].length
        out[row, WIDTH] = v[j].width
        out[row, X] = driven(v, j, road)
        out[row, Y] = v[j].y
        out[row, HEADING] = v[j].heading
        out[row, VX] = v[j].speed
        out[row, VY] = v[j].lateral_speed
        out[row, AX] = v[j].acceleration
        out[row, AY] = across
        if squared > 1.0:
            out[row, YAW_RATE] = (across * v[j].speed - v[j].lateral_speed * v[j].acceleration) / squared
        out[row, INDICATOR] = _indicator(v, j, road)
        out[row, LANE] = min(max(lane_of(v[j].y, road.lane_width), 0), road.n_lanes - 1)
    second = state.decisions if state.substep == 0 else state.decisions - 1
    out[0, TIME] = second + _DT * state.substep
    out[0, LEFT_TO_DRIVE] = distance_left(v, 0, road)
    out[0, TARGET_LANE] = v[0].target_lane
    if w.av[0].steers:
        sine, cosine = sin_cos(v[0].heading)
        out[0, CURVATURE] = w.av[0].curvature
        out[0, YAW_RATE] = (v[0].speed * cosine + v[0].lateral_speed * sine) * w.av[0].curvature


@kernel
def show_to_av(w: World, road: RoadNumbers, s: AvScratch, out: NDArray[Any]) -> None:
    """Write what an AV outside the kernels sees into `out`: a view (`av_view`), a scene, or at a site `site.scene`."""
    show_as_seen(w, w.state[0].substep, road, s)
    if at_site(road.site):
        site_scene_of_av(w, road.site, s.found, out)
    elif out.shape[1] == VIEW_COLUMNS:
        view_of_av(w, road, VISIBLE, s.found, out)
    else:
        scene_of_av(w, road, s.found, out)
    show_as_is(w, road, s)
