"""Picture of a site: its routes, stop lines, crosswalks, and where routes cross."""

from __future__ import annotations

from typing import Any

import numpy as np

from cornerforge.report.drawing import BLUE, GREEN, ORANGE, new_figure
from cornerforge.site.network import Site, headings_of
from cornerforge.site.zones import Zone

__all__ = ["site_figure"]

_COLOURS = {"straight": BLUE, "left": ORANGE, "right": GREEN, "back": "#8a6d9e", "walk": "#c9c9c9"}
_MARGIN = 45.0


def site_figure(site: Site, zones: tuple[Zone, ...]) -> Any:
    """Draw a site from above, to scale, about the middle of its stop lines; dots are the middles of crossing zones.

    Returns:
        A matplotlib figure.

    Raises:
        MissingExtraError: No matplotlib.
    """
    drawing, (panel,) = new_figure(1, 1, 9.0, 9.0)
    from matplotlib.lines import Line2D

    panel.grid(visible=False)
    panel.set_facecolor("#e6ebe4")
    stops = []
    for k in site.vehicles:
        route = site.routes[k]
        _band(panel, route.line, route.width, "#4a4e57")
        stops.append([np.interp(route.stop, route.along, values) for values in route.line.T])
    for k in site.people:
        _band(panel, site.routes[k].line, site.routes[k].width, _COLOURS["walk"])
    for k in site.vehicles:
        route = site.routes[k]
        panel.plot(*route.line.T, color=_COLOURS[route.turn], linewidth=1.0)
        x, y = (float(np.interp(route.stop, route.along, values)) for values in route.line.T)
        heading = float(np.interp(route.stop, route.along, headings_of(route.line)))
        aside = 0.5 * route.width * np.array([-np.sin(heading), np.cos(heading)])
        panel.plot([x - aside[0], x + aside[0]], [y - aside[1], y + aside[1]], color="white", linewidth=2.0)
    for zone in zones:
        route = site.routes[zone.first]
        if zone.kind == "cross":
            middle = 0.5 * sum(zone.of_first)
            panel.plot(*(np.interp(middle, route.along, v) for v in route.line.T), ".", color="#d62728", markersize=4)
    low, high = np.min(stops, axis=0) - _MARGIN, np.max(stops, axis=0) + _MARGIN
    panel.set_aspect("equal")
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="east [m]", ylabel="north [m]", title=site.name)
    turns = [turn for turn in _COLOURS if any(route.turn == turn for route in site.routes)]
    handles = [Line2D([], [], color=_COLOURS[turn], label=turn) for turn in turns]
    handles.append(Line2D([], [], color="#d62728", marker=".", linestyle="", label="zones where routes cross"))
    panel.legend(handles=handles, loc="upper right", fontsize=8)
    return drawing


def _band(panel: Any, line: Any, width: float, colour: str) -> None:
    """Fill a lane along a line."""
    heading = headings_of(line)
    aside = 0.5 * width * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    left, right = line + aside, line - aside
    panel.fill(*np.concatenate([left, right[::-1]]).T, color=colour, linewidth=0.0)
