"""Features of the learned AV: the view of `av_view.py`, sorted by lane and scaled to order 1.

"Its lane" is the AV's target lane: the one that it keeps or changes to. A vehicle is in all lanes that its body touches
and in the lane of column 6 of the view, which it is seen to enter. Entries, float32 (N_AV_FEATURES,):

- The AV: distance left in the test / 400 m; (speed - 30) / 10; offset from its target lane / 4 m; lateral speed / 2;
  acceleration / 4; whether there is a lane to the left, to the right (0 or 1); whether it changes lanes; 1.
- Then for each of its lane, the left one, the right one, first ahead, then behind, of the nearest vehicle in view:
  1; bumper-to-bumper distance / 50 m (from -0.1 to 3); 10 m / (10 m + that distance), a negative distance counts as 0;
  (speed minus the AV's) / 10; closing speed / distance [1/s], a distance under 1 m counts as 1 m (from 0 to 2); centre
  to the left of the AV's / 4 m; lateral speed / 2; acceleration / 4. All 0 where the vehicle does not exist.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._jit import inlined_kernel
from cornerforge.road.lanes import may_change
from cornerforge.road.straight import lane_bits, lane_centre
from cornerforge.sim.av_view import (
    ACCELERATION,
    AHEAD,
    CHANGES,
    LANE,
    LATERAL_SPEED,
    LEFT,
    SPEED,
    THERE,
    VIEW_ROWS,
    view_of_av,
)
from cornerforge.types import ACTION_LEFT, ACTION_RIGHT, ACTION_SIDES, FIRST_ACCELERATION, N_ACTIONS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.drivers.sight import SightNumbers
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.scratch import AvScratch
    from cornerforge.sim.world import World

__all__ = [
    "AV_FEATURES_VERSION",
    "DECIDES_EVERY",
    "N_AV_FEATURES",
    "av_actions_allowed",
    "av_features",
    "av_order",
    "look_as_av",
]

AV_FEATURES_VERSION = 2
DECIDES_EVERY = 5
"""Substeps (0.1 s) between two decisions of the learned AV."""
"""Raised whenever the meaning of an entry changes; stored with every learned AV.

In version 1 a vehicle was in its target lane as soon as its driver had decided. AVs that learned so go on seeing so
(`experiment.av_file`).
"""
_N_OWN = 9
_PER_OTHER = 8
_LANES = (0, 1, -1)
N_AV_FEATURES = _N_OWN + 2 * len(_LANES) * _PER_OTHER


@inlined_kernel
def _describe(view: NDArray[np.float32], row: int, length: float, place: int, out: NDArray[np.float32]) -> None:
    """Write the eight entries of the vehicle in a row of the view, from `place` on; length: of a car [m]."""
    dx = view[row, AHEAD]
    gap = abs(dx) - length
    rate = view[row, SPEED] - view[0, SPEED]
    closing = -rate if dx >= 0.0 else rate
    out[place] = 1.0
    out[place + 1] = min(3.0, max(-0.1, gap / 50.0))
    out[place + 2] = 10.0 / (10.0 + max(0.0, gap))
    out[place + 3] = rate / 10.0
    out[place + 4] = min(2.0, max(0.0, closing / max(1.0, gap)))
    out[place + 5] = view[row, LEFT] / 4.0
    out[place + 6] = view[row, LATERAL_SPEED] / 2.0
    out[place + 7] = view[row, ACCELERATION] / 4.0


@inlined_kernel
def av_features(view: NDArray[np.float32], road: RoadNumbers, out: NDArray[np.float32]) -> None:
    """Write the learned AV's observation into `out`.

    Args:
        view: What `view_of_av` gave, float32 (13, 8).
        road: Constants.
        out: float32 (N_AV_FEATURES,), as the head of this module says.
    """
    for k in range(out.size):
        out[k] = 0.0
    target = int(view[0, LANE])
    out[0] = view[0, AHEAD] / 400.0
    out[1] = (view[0, SPEED] - 30.0) / 10.0
    out[2] = (view[0, LEFT] - lane_centre(target, road.lane_width)) / 4.0
    out[3] = view[0, LATERAL_SPEED] / 2.0
    out[4] = view[0, ACCELERATION] / 4.0
    out[5] = 1.0 if target + 1 < road.n_lanes else 0.0
    out[6] = 1.0 if target > 0 else 0.0
    out[7] = view[0, CHANGES]
    out[8] = 1.0
    for row in range(1, VIEW_ROWS):
        if view[row, THERE] == 0.0:
            return
        bits = lane_bits(view[0, LEFT] + view[row, LEFT], 0.5 * road.width, int(view[row, LANE]), road.lane_width)
        place = _N_OWN if view[row, AHEAD] >= 0.0 else _N_OWN + _PER_OTHER
        for relative in _LANES:
            lane = target + relative
            # Rows come nearest first.
            if lane >= 0 and bits & (1 << lane) and out[place] == 0.0:
                _describe(view, row, road.length, place, out)
            place += 2 * _PER_OTHER


@inlined_kernel
def av_actions_allowed(w: World, road: RoadNumbers, allowed: NDArray[np.bool_]) -> None:
    """Mark the actions that the learned AV may take in `allowed`, bool (33,).

    These are all except lane changes that would leave the road or that repeat the running one.
    """
    v = w.vehicles
    for a in range(N_ACTIONS):
        allowed[a] = True
    lane = v[0].target_lane
    allowed[ACTION_LEFT] = may_change(v, 0, lane + 1, road)
    allowed[ACTION_RIGHT] = may_change(v, 0, lane - 1, road)
    if v[0].duration > 0.0:
        if v[0].c0 < lane_centre(lane, road.lane_width):
            allowed[ACTION_LEFT] = False
        else:
            allowed[ACTION_RIGHT] = False


@inlined_kernel
def av_order(w: World, action: int, accelerations: NDArray[np.float64]) -> tuple[float, int]:
    """Translate an allowed action into the AV's acceleration [m/s2] and target lane; a lane change holds the speed."""
    lane = w.vehicles[0].target_lane
    if action >= FIRST_ACCELERATION:
        return accelerations[action - FIRST_ACCELERATION], lane
    return 0.0, lane + ACTION_SIDES[action]


@inlined_kernel
def look_as_av(
    w: World, road: RoadNumbers, sight: SightNumbers, s: AvScratch, features: NDArray[np.float32],
    allowed: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Fill what the learned AV sees, float32 (N_AV_FEATURES,), and the actions that it may take, bool (33,)."""
    view_of_av(w, road, sight, s.found, s.seen)
    av_features(s.seen, road, features)
    av_actions_allowed(w, road, allowed)
