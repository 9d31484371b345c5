"""The page of `suite run`: where an AV fails beside what reference drivers prevent, a picture for each family."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.studies.scenarios import Driven, Suite, glued
from cornerforge.report import text
from cornerforge.report.drawing import check_matplotlib, png_of
from cornerforge.report.rendering import content_policy, environment, template, write_page
from cornerforge.results import Regulated

__all__ = ["check_suite_page", "write_suite_page"]

_LINES: dict[str, tuple[str, Any]] = {
    "cc-human": ("#0072B2", "-"),
    "reg157": ("#000000", "--"),
    "rss-brake": ("#009E73", "-."),
    "fsm": ("#8A2D6B", ":"),
}
"""Colour (Okabe and Ito's) and dashes of the edge of what each reference driver prevents."""
_WITHIN, _BEYOND, _NO_POINT = "#E69F00", "#F9E4B5", "#E4E7EA"
_PREVENTED, _NOT, _OUT = 2, 1, 3
_LEAST = 1e-6
_FEW = 2
"""Largest number of panels for each speed of the AV that stand below each other."""


def check_suite_page() -> None:
    """Check, before long work, that the page can be made.

    Raises:
        MissingExtraError: matplotlib or jinja2 is not installed.
    """
    check_matplotlib()
    environment()


def write_suite_page(path: Path, suite: Suite, result: Regulated, driven: Sequence[Driven]) -> None:
    """Write the page, which opens from disk and asks nothing from the network.

    Args:
        path: The file.
        suite: The suite.
        result: What was found.
        driven: All its panels.

    Raises:
        OutputError: It cannot be written.
    """
    pages = environment()
    from markupsafe import Markup

    pages.filters["n"] = text.count
    pages.filters["part"] = text.share_in_words
    pages.filters["in10000"] = lambda value: text.rate(10_000 * value, 2)
    pages.filters["small"] = lambda value: "< 0.0001 %" if 0.0 < value < _LEAST else text.share_in_words(value)
    sections = []
    of_name = {family.name: family for family in suite.families}
    for family in result.families:
        here = [one for one in driven if one.panel.family.name == family.family]
        sections.append(
            {
                "family": family,
                "head": of_name[family.family].head,
                "of": of_name[family.family],
                "titles": [title for one in glued(here) if (title := _title(one))],
                "picture": base64.b64encode(png_of(_drawing(glued(here)))).decode("ascii"),
                "pairs": [pair for pair in result.pairs if pair.family == family.family],
                "tests": [test for test in result.tests if test.family == family.family],
            }
        )
    page = pages.get_template("suite.html.j2").render(
        r=result,
        suite=suite,
        sections=sections,
        drivers=list(_LINES),
        style=Markup(template("report.css")),
        policy=content_policy([]),
    )
    write_page(page, path)


def _drawing(driven: Sequence[Driven]) -> Any:
    """Draw the panels of a family, a row for each speed of the AV where that has many, else a column."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    speeds = list(dict.fromkeys(one.panel.av_kmh for one in driven))
    rows = [[one for one in driven if one.panel.av_kmh == speed] for speed in speeds]
    columns = max(len(row) for row in rows)
    if columns <= _FEW:
        rows = [list(row) for row in zip(*rows, strict=True)]
        columns = len(speeds)
    size = (8.6, 4.8) if len(driven) == 1 else (1.2 + 2.1 * columns, 1.0 + 1.9 * len(rows))
    drawing = Figure(figsize=size, layout="constrained")
    panels = drawing.subplots(len(rows), columns, squeeze=False)
    for row, line in zip(panels, rows, strict=True):
        for place, panel in enumerate(row):
            if place < len(line):
                below = len(rows) > (at := rows.index(line)) + 1 and place < len(rows[at + 1])
                _draw(panel, line[place], first=place == 0, last=not below)
            else:
                panel.set_axis_off()
    handles = [
        Patch(facecolor=_WITHIN, label="the AV fails, some reference driver does not"),
        Patch(facecolor=_BEYOND, label="the AV fails, and so do all four"),
        *([Patch(facecolor=_NO_POINT, label="not possible: the lead would hit it")]
          if any(not one.panel.possible.all() for one in driven) else []),
        *([Line2D([], [], color="#333333", marker="o", markersize=2.5, linestyle="", label="a test of a protocol")]
          if any(one.panel.tests.any() for one in driven) else []),
        *(Line2D([], [], color=colour, linestyle=dash, linewidth=1.6, label=f"{name}: edge of its crashes")
          for name, (colour, dash) in _LINES.items()),
    ]  # fmt: skip
    many = 4 if len(driven) > 1 else 2
    drawing.legend(handles=handles, loc="outside lower center", ncols=many, fontsize=9, frameon=False)
    return drawing


def _draw(panel: Any, one: Driven, *, first: bool, last: bool) -> None:
    """Draw one panel: a cell for each scenario, and along cells the edges of what reference drivers prevent."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    of = one.panel
    x, y = _edges(of.across), _edges(of.up)
    crashes = {name: one.cells(one.crashes[name]) for name in _LINES}
    prevented = ~np.logical_and.reduce(list(crashes.values()))
    cells = np.where(one.cells(one.failed), np.where(prevented, _PREVENTED, _NOT), 0)
    cells = np.where(of.possible, cells, _OUT)
    panel.pcolormesh(x, y, cells.T, cmap=ListedColormap(["#FFFFFF", _BEYOND, _WITHIN, _NO_POINT]), vmin=0, vmax=3)
    for name, (colour, dash) in _LINES.items():
        lines = _outline(crashes[name] & of.possible, of.possible, x, y)
        panel.add_collection(LineCollection(lines, colors=colour, linestyles=dash, linewidths=1.5))
    at_x, at_y = np.nonzero(one.cells(of.tests))
    panel.plot(of.across[at_x], of.up[at_y], "o", color="#333333", markersize=2.5)
    panel.set_title(_title(one), fontsize=9)
    panel.tick_params(labelsize=7)
    panel.spines[["top", "right"]].set_visible(False)
    if first:
        panel.set_ylabel(of.family.up.label, fontsize=8)
    if last:
        panel.set_xlabel(of.family.across.label, fontsize=8)


def _title(one: Driven) -> str:
    """Name the speeds of a panel; "" where its axis does."""
    of = one.panel
    if of.family.across.column == "av_kmh":
        return ""
    return f"{of.av_kmh} km/h" if of.av_kmh == of.other_kmh else f"{of.av_kmh} → {of.other_kmh} km/h"


def _edges(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the edges of cells about values, (V + 1,)."""
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[1.5 * values[0] - 0.5 * values[1]], middle, [1.5 * values[-1] - 0.5 * values[-2]]])


def _outline(
    inside: NDArray[np.bool_], possible: NDArray[np.bool_], x: NDArray[np.float64], y: NDArray[np.float64]
) -> list[list[tuple[float, float]]]:
    """Find where cells (A, B) change between inside and outside, as lines; neighbours are joined in one line."""
    lines = []
    upright = (inside[1:] != inside[:-1]) & possible[1:] & possible[:-1]
    for i in range(len(upright)):
        lines += [[(x[i + 1], y[a]), (x[i + 1], y[b])] for a, b in _runs(upright[i])]
    level = (inside[:, 1:] != inside[:, :-1]) & possible[:, 1:] & possible[:, :-1]
    for j in range(level.shape[1]):
        lines += [[(x[a], y[j + 1]), (x[b], y[j + 1])] for a, b in _runs(level[:, j])]
    return lines


def _runs(marks: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Find runs of True: first place, and the place after the last."""
    changes = np.flatnonzero(np.diff(np.concatenate([[False], marks, [False]]).astype(np.int8)))
    return list(zip(changes[::2].tolist(), changes[1::2].tolist(), strict=True))
