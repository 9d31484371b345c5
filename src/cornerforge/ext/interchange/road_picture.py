"""Picture of a road: as it lies in the world, and its lanes unrolled."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cornerforge._files import writing
from cornerforge.report.drawing import check_matplotlib
from cornerforge.road.network import Lane, Road

__all__ = ["draw_road"]

_COLOURS = {"through": "#4a4e57", "acceleration": "#0072B2", "deceleration": "#009E73", "closed": "#D55E00"}
_STEP = 2.0


def draw_road(road: Road, path: Path) -> None:
    """Draw a road into a new .png, .svg or .pdf file; the upper part is to scale, the lower one is not.

    Raises:
        MissingExtraError: No matplotlib.
        InputError, OutputError: The name ends in nothing that can be drawn, or the file cannot be written.
    """
    check_matplotlib()
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    for lane in road.lanes:
        s = np.linspace(lane.begin, lane.end, max(2, int((lane.end - lane.begin) / _STEP)))
        right, left = _edges(road, lane)
        a, b = road.pose_at(s, right), road.pose_at(s, left)
        colour = _COLOURS[lane.kind]
        above.fill(np.concatenate([a.x, b.x[::-1]]), np.concatenate([a.y, b.y[::-1]]), color=colour, linewidth=0.0)
        for edge in (a, b):
            above.plot(edge.x, edge.y, color="white", linewidth=0.3)
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
    with writing(path, "the picture") as part:
        figure.savefig(part, format=path.suffix.removeprefix(".") or "png", dpi=130, metadata=None)


def _edges(road: Road, lane: Lane) -> tuple[float, float]:
    """Y of the right and left edge of a lane."""
    return lane.slot * road.lane_width, (lane.slot + 1) * road.lane_width
