"""Picture of a road: as it lies in the world, and its lanes unrolled."""

from __future__ import annotations

from typing import Any

import numpy as np

from cornerforge.report.drawing import BLUE, GREEN, ORANGE, new_figure
from cornerforge.road.network import Road

__all__ = ["road_figure"]

_COLOURS = {"through": "#4a4e57", "ramp": "#8a6d9e", "acceleration": BLUE, "deceleration": GREEN, "closed": ORANGE}
_STEP = 2.0


def road_figure(road: Road) -> Any:
    """Draw a road: the upper part is to scale, the lower one is not.

    Returns:
        A matplotlib figure.

    Raises:
        MissingExtraError: No matplotlib.
    """
    drawing, (above, below) = new_figure(2, 1, 10.0, 6.0)
    from matplotlib.patches import Patch

    above.get_gridspec().set_height_ratios([3.0, 2.0])
    for panel in (above, below):
        panel.grid(visible=False)
    for lane in road.lanes:
        s = np.linspace(lane.begin, lane.end, max(2, int((lane.end - lane.begin) / _STEP)))
        right, left = lane.slot * road.lane_width, (lane.slot + 1) * road.lane_width
        a, b = road.pose_at(s, right), road.pose_at(s, left)
        colour = _COLOURS[lane.kind]
        # A road of kilometres is thinner than a line: without edges of its colour it would not be seen.
        above.fill(np.concatenate([a.x, b.x[::-1]]), np.concatenate([a.y, b.y[::-1]]), color=colour, linewidth=0.8)
        below.fill_between([lane.begin, lane.end], right, left, color=colour, linewidth=0.0)
        below.plot([lane.begin, lane.end, lane.end], [left, left, right], color="white", linewidth=0.8)
        if lane.limit is not None and lane.kind != "closed":
            text = f"{lane.limit:.0f} m/s"
            below.text(lane.begin + 10.0, 0.5 * (left + right), text, color="white", fontsize=7, va="center")
    x, y = road.pose_at([0.0, 60.0], 0.5 * road.slots * road.lane_width)[:2]
    arrow = {"arrowstyle": "->", "color": "red"}
    above.annotate("", xy=(x[1], y[1]), xytext=(x[0], y[0]), arrowprops=arrow)
    above.set_aspect("equal", adjustable="datalim")
    above.set(xlabel="east [m]", ylabel="north [m]", title=f"{road.name}: to scale; the arrow is the travel")
    below.set(xlabel="along the road [m]", ylabel="from the right edge [m]", xlim=(0.0, road.length))
    kinds = [kind for kind in _COLOURS if any(lane.kind == kind for lane in road.lanes)]
    below.legend(handles=[Patch(color=_COLOURS[kind], label=kind) for kind in kinds], loc="upper right", fontsize=8)
    return drawing
