"""The page's charts as figures for papers: the same dictionaries, drawn by matplotlib at a column's or a page's width.

The drawing shows what the dictionaries of `figures` say, so that page and paper show the same numbers; what is for a
screen only (hover texts, sizes in pixels) is left out. Colours of the page are replaced where two of them become the
same grey in print.
"""

from __future__ import annotations

import html
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cornerforge.ext.pictures.printing import printed
from cornerforge.report.figures import ADVERSARY, NATURAL, Figure

__all__ = ["CAPTIONS", "print_chart"]

CAPTIONS = {
    "rates": "Crashes of the AV per test by who drives the other vehicles, with 95 % intervals. An arrow to the left: "
    "no crash was seen, and the rate lies somewhere below.",
    "training": "Yield of the adversary while it learns, with the exact interval of each point (shade), the share of "
    "random actions, and the loss.",
    "types": "Cases by crash type, by the pose at first contact.",
    "map": "Every point is a case, described by its features and projected on two principal components; symbols are "
    "clusters.",
    "discovery": "Kinds of crash that are expected among the first cases, had they come in random order.",
    "fault": "Share of cases by who broke a rule of RSS, with 95 % intervals.",
    "rules": "Share of cases by the rule of RSS that was broken first, with 95 % intervals.",
    "own": "Share of cases by what the AV itself did wrong, read from the recorded motion, with 95 % intervals.",
    "prevented": "Share of cases that each reference driver in the AV's place would have prevented, and of those in "
    "which its braking did it, with 95 % intervals.",
    "avoidability": "Share of cases by how the AV could have avoided the crash, with 95 % intervals.",
    "exposure-bbd_front": "Distance to the vehicle ahead that the AV met: densities of natural traffic and of tests "
    "with the adversary.",
    "exposure-bbd_rear": "Distance to the vehicle behind that the AV met: densities of natural traffic and of tests "
    "with the adversary.",
    "exposure-ttc_front": "Time to collision with the vehicle ahead that the AV met: densities of natural traffic and "
    "of tests with the adversary.",
    "exposure-ttc_rear": "Time to collision with the vehicle behind that the AV met: densities of natural traffic and "
    "of tests with the adversary.",
}
"""Content of each chart, as the caption of a figure."""

_NAMED = {"css:ink": "#000000", "css:accent": "#0072b2", "css:muted": "#666666", "css:grid": "#dddddd",
          "css:paper": "#ffffff"}  # fmt: skip
_IN_PRINT = {NATURAL.lower(): "#4dbd9d", ADVERSARY.lower(): "#b34700"}
"""Green and orange of the page are one grey; these are two."""
_MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "triangle-down": "v", "pentagon": "p",
            "hexagon": "h", "hourglass": "X", "triangle-left": "<", "x-thin": "x"}  # fmt: skip
_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
_ROW_IN, _TALL_ROW_IN, _ROWS_BESIDES_IN = 0.24, 0.36, 0.55
_LARGE = 1e5
"""Least value from which ticks are in thousands (k) or millions (M)."""
_LETTERS_IN = 13.0
"""Letters of the size of all text on an inch."""
_HEIGHT_IN, _TALL_IN = 2.2, 3.2
_ENTRY_IN = 0.15


def print_chart(chart: Figure, width: float) -> Any:
    """Draw a chart of the page for a paper.

    Args:
        chart: Chart as `figures` gives it.
        width: Width of the figure [in].

    Returns:
        A figure of matplotlib; `ext.pictures.printing.print_of` makes a file of it.
    """
    from matplotlib.figure import Figure as Drawing
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    layout, traces = chart["layout"], chart["data"]
    has_two = "yaxis2" in layout
    names = _names(traces, layout)
    rows = _rows(traces)
    with printed():
        tall = _TALL_ROW_IN if any("<br>" in row for row in rows) else _ROW_IN
        height = _ROWS_BESIDES_IN + tall * len(rows) if rows else _TALL_IN if has_two or names[4:] else _HEIGHT_IN
        longest = max(map(len, names), default=0)
        columns = max(1, min(4, int(_LETTERS_IN * width / (longest + 8.0))))
        height += _ENTRY_IN * math.ceil(len(names) / columns)
        drawing = Drawing(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.03))
        if has_two:
            upper, lower = drawing.subplots(2, 1, sharex=True, height_ratios=[2.4, 1.0])
            panels = {"y": upper, "y2": lower}
        else:
            upper = lower = drawing.subplots()
            panels = {"y": upper}
        if rows:
            rows = _set_rows(upper, rows, layout["yaxis"])
        for panel in panels.values():
            panel.spines[["top", "right"]].set_visible(False)
            panel.set_axisbelow(True)
            panel.grid(visible=True, axis="x" if rows else "both")
            panel.margins(x=0.02)
        for shape in layout.get("shapes", []):
            _draw_shape(upper, shape, rows)
        handles = []
        for trace in traces:
            handle = _draw_trace(panels[trace.get("yaxis", "y")], trace, rows)
            if handle is not None and trace.get("name") in names:
                handles.append((handle, _plain(trace["name"])))
        _set_axis(lower, "x", layout["xaxis"], width)
        if not rows:
            _set_axis(upper, "y", layout["yaxis"], 0.5 * height if has_two else height)
        if has_two:
            _set_axis(lower, "y", layout["yaxis2"], 0.2 * height)
        if handles:
            drawing.legend(
                [handle for handle, _ in handles], [name for _, name in handles], loc="outside lower left",
                ncols=columns, frameon=False, borderpad=0.0, labelspacing=0.25, handlelength=2.0, columnspacing=1.5,
            )  # fmt: skip
    return drawing


def _names(traces: Sequence[Mapping[str, Any]], layout: Mapping[str, Any]) -> list[str]:
    """Names for the legend; none where the page shows none, or there is one only."""
    names = [trace["name"] for trace in traces if "name" in trace and len(trace.get("x", ()))]
    return names if len(names) > 1 and layout.get("showlegend", True) else []


def _rows(traces: Sequence[Mapping[str, Any]]) -> list[str]:
    """Labels of the y axis, the first on top; none for an axis of numbers."""
    labels = [y for trace in traces for y in trace.get("y", ()) if isinstance(y, str)]
    return list(dict.fromkeys(labels))


def _set_rows(panel: Any, rows: list[str], axis: Mapping[str, Any]) -> list[str]:
    """Write the labels down the side; return them in their order."""
    rows = [row for row in axis.get("categoryarray", rows) if row in rows]
    panel.set_yticks(range(len(rows)), [_plain(row) for row in rows])
    panel.tick_params(axis="y", length=0)
    panel.set_ylim(len(rows) - 0.5, -0.6)
    return rows


def _set_axis(panel: Any, which: str, axis: Mapping[str, Any], room: float) -> None:
    """Set title, scale and ends of an axis; `room`: length of the figure along it [in]."""
    from matplotlib.ticker import EngFormatter, MaxNLocator, NullFormatter

    lines = _plain(axis.get("title", {}).get("text", "")).split("\n")
    title = "\n".join(part for line in lines for part in textwrap.wrap(line, round(_LETTERS_IN * room)))
    getattr(panel, f"set_{which}label")(title)
    is_log = axis.get("type") == "log"
    if is_log:
        getattr(panel, f"set_{which}scale")("log")
        getattr(panel, f"{which}axis").set_minor_formatter(NullFormatter())
    limits = axis.get("range")
    if limits is not None:
        getattr(panel, f"set_{which}lim")(*(10.0**end for end in limits) if is_log else limits)
    elif axis.get("rangemode") == "tozero":
        getattr(panel, f"set_{which}lim")(**{"left" if which == "x" else "bottom": 0.0})
    if which == "x" and not is_log:
        panel.xaxis.set_major_locator(MaxNLocator(5))
        if max(map(abs, panel.get_xlim())) >= _LARGE:
            panel.xaxis.set_major_formatter(EngFormatter(sep=""))


def _draw_trace(panel: Any, trace: Mapping[str, Any], rows: list[str]) -> Any:
    """Draw a trace; return what stands for it in the legend."""
    x = np.array(trace["x"], dtype=float)
    y = np.array([rows.index(one) for one in trace["y"]] if rows else trace["y"], dtype=float)
    if not len(x):
        return None
    if trace["type"] == "bar":
        return _draw_bars(panel, trace, x, y)
    if trace.get("fill") == "toself":
        n = len(x) // 2
        return panel.fill_between(x[:n], y[n:][::-1], y[:n], color=_colour(trace["fillcolor"]), linewidth=0)
    mode = trace["mode"].split("+")
    handle = None
    if "lines" in mode:
        handle = _draw_line(panel, trace, x, y, with_markers="markers" in mode)
    elif "markers" in mode:
        handle = _draw_markers(panel, trace, x, y)
    if "text" in mode:
        _write(panel, trace, x, y)
    return handle


def _draw_bars(panel: Any, trace: Mapping[str, Any], x: Any, y: Any) -> Any:
    error = trace.get("error_x")
    bars = panel.barh(y, x, height=0.55, color=_pale(_colour(trace["marker"]["color"])) if error else
                      _colour(trace["marker"]["color"]))  # fmt: skip
    if error is not None:
        _draw_errors(panel, error, x, y)
    for text, value, row in zip(trace.get("text", []), x, y, strict=False):
        panel.annotate(_plain(text), (value, row), xytext=(3, 0), textcoords="offset points", va="center",
                       annotation_clip=False)  # fmt: skip
    return bars


def _draw_errors(panel: Any, error: Mapping[str, Any], x: Any, y: Any) -> None:
    ends = np.array([error["arrayminus"], error["array"]], dtype=float)
    panel.errorbar(x, y, xerr=ends, fmt="none", ecolor="black", elinewidth=0.8, capsize=2.0, capthick=0.8, zorder=3)


def _draw_line(panel: Any, trace: Mapping[str, Any], x: Any, y: Any, *, with_markers: bool) -> Any:
    line = trace["line"]
    colour, dash = _colour(line.get("color", "css:ink")), _DASHES[line.get("dash", "solid")]
    if line.get("shape") == "hv":
        if trace.get("fill") == "tozeroy":
            panel.fill_between(x, y, step="post", color=colour, alpha=0.12, linewidth=0)
        return panel.step(x, y, where="post", color=colour, linestyle=dash)[0]
    return panel.plot(x, y, color=colour, linestyle=dash, marker="o" if with_markers else "", markersize=2.5)[0]


def _draw_markers(panel: Any, trace: Mapping[str, Any], x: Any, y: Any) -> Any:
    marker = trace["marker"]
    symbol = marker.get("symbol", "circle")
    colours = marker["color"]
    colours = [_colour(one) for one in colours] if isinstance(colours, list) else _colour(colours)
    shape = _MARKERS[symbol.removesuffix("-open")]
    size = 0.55 * marker["size"]
    if "error_x" in trace:
        _draw_errors(panel, trace["error_x"], x, y)
    look: dict[str, Any] = {"c": colours, "linewidths": 0.0}
    if symbol.endswith("-open"):
        look = {"c": colours, "linewidths": 0.8} if shape == "x" else {
            "facecolors": "none", "edgecolors": colours, "linewidths": 0.8}  # fmt: skip
    # Thousands of points would make a file of megabytes and print as a blot; each is small and has no outline.
    panel.scatter(x, y, s=size**2, marker=shape, alpha=marker.get("opacity", 1.0), zorder=4, clip_on=len(x) > 100,
                  **look)  # fmt: skip
    from matplotlib.lines import Line2D

    colour = colours if isinstance(colours, str) else colours[0]
    is_open = symbol.endswith("-open")
    return Line2D([], [], linestyle="", marker=shape, markersize=4.5, color=colour, markeredgewidth=0.8 * is_open,
                  markerfacecolor="none" if is_open else colour)  # fmt: skip


def _write(panel: Any, trace: Mapping[str, Any], x: Any, y: Any) -> None:
    """Write the texts beside or above the points; the layout makes room for texts beside the axes."""
    is_beside = trace["textposition"] == "middle right"
    for what, at, row in zip(trace["text"], x, y, strict=True):
        share = panel.transAxes.inverted().transform(panel.transData.transform((at, row)))[0]
        side = "left" if is_beside or share < 0.25 else "right" if share > 0.75 else "center"
        panel.annotate(
            _plain(what), (at, row), xytext=(2, 0) if is_beside else (0, 5), textcoords="offset points", ha=side,
            va="center" if is_beside else "bottom", annotation_clip=False,
        )  # fmt: skip


def _draw_shape(panel: Any, shape: Mapping[str, Any], rows: list[str]) -> None:
    """Draw a line of the layout: a level across the picture, or one within a row."""
    line = shape["line"]
    look = {"color": _colour(line["color"]), "linestyle": _DASHES[line.get("dash", "solid")], "linewidth": 1.2}
    if shape.get("xref") == "paper":
        panel.axhline(shape["y0"], **look)
    else:
        panel.plot([shape["x0"], shape["x1"]], [rows.index(shape["y0"]), rows.index(shape["y1"])], **look)


def _colour(name: str) -> Any:
    """A colour of the page as one of matplotlib for print."""
    if name in _NAMED:
        return _NAMED[name]
    found = re.fullmatch(r"rgba\((\d+),(\d+),(\d+),([\d.]+)\)", name)
    if found:
        *levels, opacity = found.groups()
        return (*(int(level) / 255.0 for level in levels), float(opacity))
    return _IN_PRINT.get(name.lower(), name)


def _pale(colour: str) -> str:
    """A lighter tone, on which an interval's black line can be seen."""
    levels = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#" + "".join(f"{round(255 - 0.5 * (255 - level)):02x}" for level in levels)


def _plain(text: str) -> str:
    """Text of a chart without markup, and without hints for a screen."""
    lines = re.sub(r"<br\s*/?>", "\n", text)
    bare = html.unescape(re.sub(r"<[^>]+>", "", lines)).strip()
    return bare.replace(" (click to play)", "")  # paper has no links
