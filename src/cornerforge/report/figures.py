"""The charts as plotly figures: plain JSON values, drawn in the browser.

A colour that begins with "css:" names a custom property of the page's style, so that a chart follows light and dark
mode; `web/src/pages/charts.ts` puts the value in. Colours are Okabe and Ito's, which colour-blind people tell apart;
no meaning hangs on colour alone: markers, dashes and labels say the same. Text from files is escaped, since plotly
reads markup.
"""

from __future__ import annotations

import html
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.intervals import binomial_interval
from cornerforge.report import text
from cornerforge.report.artefacts import NATURAL_TRAFFIC, Points
from cornerforge.results import Analysed
from cornerforge.results.analysis import Coverage
from cornerforge.results.learning import TrainingCurve
from cornerforge.results.rates import Counted
from cornerforge.results.whole import Exposed

__all__ = ["discovery_figure", "exposure_figure", "map_figure", "rate_figure", "share_figure", "training_figure"]

Figure = dict[str, Any]

NATURAL = "#009E73"
ADVERSARY = "#D55E00"
CLUSTER_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8C6D1F", "#7A7A7A")
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "pentagon", "hexagon", "hourglass")
MAX_POINTS, MAX_ALL_POINTS = 3000, 12_000
"""Largest number of points drawn of a cluster, and of all, evenly taken from the list: the page stays small."""


def rate_figure(rates: Mapping[str, Counted]) -> Figure:
    """Crashes per test of every adversary beside natural traffic, on a log axis, with 95 % intervals.

    Dots instead of bars, because a bar's length means nothing on a log axis. A rate of no crash at all appears as an
    arrow that points to the left from 3 / tests.
    """
    rows = {_row_label(name, r): r for name, r in rates.items()}
    seen = [r for r in rows.values() if not r.is_bound]
    bounds = {label: r for label, r in rows.items() if r.is_bound}
    dots = _rate_marks(rates, bound=False) | {
        "error_x": {
            "type": "data",
            "symmetric": False,
            "array": [r.interval95[1] - r.crashes_per_test for r in seen],
            # An interval that reaches 0 has no end on a log axis: its line is drawn out of the picture.
            "arrayminus": [
                r.crashes_per_test - r.interval95[0] if r.interval95[0] > 0 else 0.999 * r.crashes_per_test
                for r in seen
            ],
            "thickness": 2,
            "width": 6,
            "color": "css:ink",
        }
    }
    arrows = _rate_marks(rates, bound=True)
    arrows["marker"] |= {"symbol": "triangle-left", "size": 15}
    arrows["textposition"] = "top right"
    lowest = min([r.interval95[0] or r.crashes_per_test / 3 for r in seen] + [r.bound / 10 for r in bounds.values()])
    bottom = float(np.log10(lowest)) - 1.0
    layout = _layout(height=110 + 62 * len(rows), showlegend=False, margin={"l": 10, "r": 30, "t": 20, "b": 55})
    layout["xaxis"] = _axis(
        "crashes of the AV per drive<br>(log scale)",
        type="log",
        range=[bottom, 0.25],
        exponentformat="power",
        dtick=1 if bottom > -4.0 else 2 if bottom > -6.0 else 3,
        tickangle=0,
    )
    layout["yaxis"] = _axis("", automargin=True, autorange="reversed", categoryorder="array", showgrid=False)
    layout["yaxis"]["categoryarray"] = list(rows)
    layout["shapes"] = [_arrow_tail(label, r.bound, lowest) for label, r in bounds.items()]
    return {"data": [dots, arrows], "layout": layout}


_POWERS = {"exponentformat": "power", "dtick": 1}


def _rate_marks(rates: Mapping[str, Counted], *, bound: bool) -> dict[str, Any]:
    """One mark a rate of those that are bounds, or of the others, with its value in words."""
    marked = {name: r for name, r in rates.items() if r.is_bound == bound}
    shown = [
        f"no crash seen: below {text.rate(r.bound, 2)}" if bound else text.rate(r.crashes_per_test, r.digits)
        for r in marked.values()
    ]
    return {
        "type": "scatter",
        "mode": "markers+text",
        "x": [r.bound if bound else r.crashes_per_test for r in marked.values()],
        "y": [_row_label(name, r) for name, r in marked.items()],
        "marker": {"size": 13, "color": [NATURAL if name == NATURAL_TRAFFIC else ADVERSARY for name in marked]},
        "text": shown,
        "textposition": "top center",
        "cliponaxis": False,
        "hovertemplate": "%{y}: %{text} crashes per drive<extra></extra>",
    }


def _row_label(name: str, rate: Counted) -> str:
    return f"{_wrapped(name)}<br><sub>n = {text.count(rate.tests)} drives</sub>"


def _arrow_tail(label: str, bound: float, lowest: float) -> dict[str, Any]:
    return {
        "type": "line",
        "xref": "x",
        "yref": "y",
        "x0": lowest,
        "x1": bound,
        "y0": label,
        "y1": label,
        "line": {"color": NATURAL, "width": 2, "dash": "dot"},
    }


def training_figure(training: TrainingCurve, natural: Counted) -> Figure:
    """Yield and exploration, and below them the loss, over the decisions that the adversary has seen."""
    known = [point for point in training.points if point.crashes_per_test is not None and point.tests]
    x = [float(point.decisions) for point in known]
    share = [point.crashes_per_test for point in known]
    ends = [binomial_interval(round((point.crashes_per_test or 0.0) * point.tests), point.tests) for point in known]
    decisions = [float(point.decisions) for point in training.points]
    loss = [point.loss for point in training.points]
    traces: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": x + x[::-1],
            "y": [*(high for _, high in ends), *(low for low, _ in reversed(ends))],
            "fill": "toself",
            "fillcolor": "rgba(213,94,0,0.22)",
            "line": {"width": 0},
            "hoverinfo": "skip",
            "name": "95 % interval",
        },
        _line(x, share, "crashes per drive", color=ADVERSARY, width=2.5),
        _line(
            decisions,
            [point.epsilon for point in training.points],
            "share of random actions",
            color="css:accent",
            dash="dash",
        ),
        {**_line(decisions, loss, "loss: how far its expectations miss", color="css:muted"), "yaxis": "y2"},
    ]
    layout = _layout(height=460, legend={"orientation": "h", "y": 1.08, "x": 0, "yanchor": "bottom"})
    layout["xaxis"] = _axis("decisions that it learned from", anchor="y2", rangemode="tozero")
    layout["yaxis"] = _axis("crashes per drive;<br>share of random actions", domain=[0.36, 1.0], range=[0, 1.02])
    layout["yaxis2"] = _axis("loss (log)", domain=[0.0, 0.26], type="log", **_few_ticks(loss))
    if not natural.is_bound and natural.crashes_per_test > 1e-3:
        layout["shapes"] = [_level(natural.crashes_per_test)]
    return {"data": traces, "layout": layout}


def _few_ticks(values: Sequence[float | None]) -> dict[str, Any]:
    """Ticks of a log axis at 1, 2 and 5 times powers of ten, or at the powers alone where these would be many."""
    known = [value for value in values if value is not None and value > 0.0]
    if not known:
        return {}
    powers = range(int(np.floor(np.log10(min(known)))), int(np.ceil(np.log10(max(known)))) + 1)
    inside = [
        float(f"{first}e{power}")
        for power in powers
        for first in (1, 2, 5)
        if 0.9 * min(known) <= float(f"{first}e{power}") <= 1.1 * max(known)
    ]
    wide = [value for value in inside if np.log10(value).is_integer()]
    ticks = inside if len(inside) <= 4 else wide or inside[:: len(inside) // 3]
    return {"tickvals": ticks, "ticktext": [f"{value:g}" for value in ticks]}


def _level(value: float) -> dict[str, Any]:
    line = {"color": NATURAL, "dash": "dot", "width": 2}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value, "line": line}


def _line(x: list[float], y: list[float | None], name: str, **line: Any) -> dict[str, Any]:
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": line}


def exposure_figure(histogram: Exposed) -> Figure:
    """How often the AV saw each value, in natural traffic and with the adversary: densities, each with area 1."""
    layout = _layout(height=300, legend={"orientation": "h", "y": 1.02, "x": 0, "yanchor": "bottom"})
    unit = html.escape(histogram.unit)
    layout["xaxis"] = _axis(f"{html.escape(histogram.label)} [{unit}]")
    layout["yaxis"] = _axis(f"probability density [1/{unit}]", rangemode="tozero", tickformat=".3~g")
    worlds = (
        ("natural traffic", histogram.nde, NATURAL, "rgba(0,158,115,0.16)", "dash"),
        ("adversary", histogram.adversary, ADVERSARY, "rgba(213,94,0,0.16)", "solid"),
    )
    traces = []
    for name, counts, colour, fill, dash in worlds:
        trace = _line(list(histogram.edges), _steps(density(histogram, counts)), name, color=colour, dash=dash)
        trace["line"]["shape"] = "hv"
        traces.append(trace | {"fill": "tozeroy", "fillcolor": fill, "hovertemplate": "from %{x}: %{y:.3g}"})
    layout["hovermode"] = "x"
    return {"data": traces, "layout": layout}


def density(histogram: Exposed, counts: Sequence[int]) -> NDArray[np.float64]:
    """Counts as a density [1 / unit] with area 1; zeros where nothing was counted. Shape (n,)."""
    return np.asarray(np.array(counts) / (max(float(sum(counts)), 1.0) * np.diff(histogram.edges)))


def _steps(values: NDArray[np.float64]) -> list[float | None]:
    """One value an edge: a step line holds each value to the next edge, so the last is repeated."""
    return [float(f"{v:.5g}") for v in [*values, values[-1]]]


def share_figure(counts: dict[str, int], cases: int, what: str) -> Figure:
    """Shares of `cases` cases with exact 95 % intervals, in the order given.

    Args:
        counts: Name of each kind to its cases.
        cases: Number of cases looked at, at least 1.
        what: For the axis, such as "share of the cases looked at".
    """
    ends = np.array([binomial_interval(n, cases) for n in counts.values()]).reshape(-1, 2)
    shares = np.array(list(counts.values()), np.float64) / cases
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": (100 * shares).tolist(),
        "y": [f"{_wrapped(name)}<br>{text.count(n)} ({text.share(n / cases)})" for name, n in counts.items()],
        "marker": {"color": "css:accent"},
        "hoverinfo": "skip",
        "error_x": {
            "type": "data",
            "symmetric": False,
            "array": (100 * (ends[:, 1] - shares)).tolist(),
            "arrayminus": (100 * (shares - ends[:, 0])).tolist(),
            "thickness": 2,
            "width": 5,
            "color": "css:ink",
        },
    }
    layout = _layout(height=100 + 46 * max(1, len(counts)), margin={"l": 10, "r": 20, "t": 10, "b": 50})
    layout |= {"showlegend": False, "bargap": 0.35}
    layout["xaxis"] = _axis(f"{what} [%]<br>n = {text.count(cases)}", range=[0, 100])
    layout["yaxis"] = _axis("", automargin=True, autorange="reversed", showgrid=False, ticksuffix=" ")
    return {"data": [bars], "layout": layout}


def _wrapped(name: str, width: int = 24) -> str:
    """A long label on two lines or more."""
    return "<br>".join(html.escape(line) for line in textwrap.wrap(name, width)) or " "


def discovery_figure(coverage: Coverage) -> Figure:
    """Kinds expected among the first cases, had they come in another order: flat at its end means little is missing."""
    m, kinds = np.array(coverage.discovery_curve).T
    curve = _line(m.tolist(), [float(f"{k:.4g}") for k in kinds], "kinds seen", color="css:accent", width=2.5)
    curve |= {"mode": "lines+markers", "hovertemplate": "%{x} cases: %{y} kinds<extra></extra>"}
    layout = _layout(height=330, showlegend=False, margin={"l": 60, "r": 20, "t": 20, "b": 50})
    layout["xaxis"] = _axis("cases, in random order (log scale)", type="log", **_POWERS)
    layout["yaxis"] = _axis("kinds seen, on average", rangemode="tozero")
    return {"data": [curve], "layout": layout}


def map_figure(points: Points, analysis: Analysed, top: list[str], animated: set[str]) -> Figure:
    """The plane of the two principal components with clusters, typical, rare and top cases; a click plays a case.

    Args:
        points: Where each case lies.
        analysis: Clusters, typical and rare cases.
        top: Cases worth a look.
        animated: Case ids that the page can play.
    """
    clusters = [
        (group, int(cluster))
        for group in ("majority", "minority")
        for cluster in np.unique(points.cluster[np.array(points.group, dtype=str) == group])
    ]
    most = min(MAX_POINTS, MAX_ALL_POINTS // max(1, len(clusters)))
    traces = [_cluster_trace(points, group, cluster, most) for group, cluster in clusters]
    typical = {case for cluster in analysis.clusters for case in cluster.typical}
    traces.append(_marked(points, typical & animated, "typical", "circle-open", 13))
    traces.append(_marked(points, set(analysis.rare) & animated, "rare", "x-thin-open", 10))
    traces.append(_marked(points, set(top) & animated, "of most value", "square-open", 16))
    # The legend below has about two entries a row; it shall not eat the picture.
    layout = _layout(
        height=470 + 20 * ((len(traces) + 1) // 2),
        legend={"orientation": "h", "y": -0.16, "x": 0, "yanchor": "top", "itemsizing": "constant"},
    )
    for axis, share, number in zip(("xaxis", "yaxis"), analysis.explained_variance, (1, 2), strict=True):
        layout[axis] = _axis(f"component {number} ({100 * share:.0f} % of variance)", zeroline=True)
    layout |= {"hovermode": "closest", "dragmode": "zoom"}
    return {"data": traces, "layout": layout}


def _cluster_trace(points: Points, group: str, cluster: int, most: int) -> dict[str, Any]:
    inside = np.flatnonzero((np.array(points.group, dtype=str) == group) & (points.cluster == cluster))
    shown = inside[np.unique(np.linspace(0, len(inside) - 1, min(most, len(inside))).round().astype(int))]
    sparse = ", sparse" if group == "minority" else ""
    name = f"{'no cluster' if cluster < 0 else f'cluster {cluster}'}{sparse} ({text.count(len(inside))})"
    place = cluster % len(SYMBOLS)
    marker = {"size": 5, "opacity": 0.55, "color": CLUSTER_COLOURS[place], "symbol": SYMBOLS[place]}
    return _scatter(points, shown, name) | {"marker": marker}


def _marked(points: Points, cases: set[str], name: str, symbol: str, size: int) -> dict[str, Any]:
    index = np.array([i for i, case in enumerate(points.case_id) if case in cases], dtype=np.intp)
    line = {"width": 1.8, "color": "css:ink"}
    return _scatter(points, index, name) | {
        "marker": {"size": size, "symbol": symbol, "color": "css:ink", "line": line}
    }


def _scatter(points: Points, index: NDArray[np.intp], name: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": points.pc1[index].round(3).tolist(),
        "y": points.pc2[index].round(3).tolist(),
        "customdata": [points.case_id[i] for i in index],
        "text": [html.escape(f"case {points.case_id[i]}: {points.crash_type[i]}") for i in index],
        "hovertemplate": "%{text}<extra>" + name + "</extra>",
    }


def _axis(title: str, **more: Any) -> dict[str, Any]:
    colours = {"gridcolor": "css:grid", "zerolinecolor": "css:grid", "linecolor": "css:muted"}
    lines = "<br>".join(
        line for part in title.split("<br>") for line in textwrap.wrap(part, 34, break_long_words=False)
    )
    return {
        "title": {"text": lines, "standoff": 8, "font": {"size": 13}},
        "zeroline": False,
        "automargin": True,
        **colours,
        **more,
    }


def _layout(**more: Any) -> dict[str, Any]:
    return {
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "css:ink"},
        "hoverlabel": {"bgcolor": "css:paper", "font": {"color": "css:ink"}},
        "margin": {"l": 60, "r": 20, "t": 30, "b": 50},
        "dragmode": False,
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "css:muted", "activecolor": "css:ink"},
        **more,
    }
