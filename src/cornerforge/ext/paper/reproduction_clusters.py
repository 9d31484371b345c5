"""Pictures of the paper's Figures 7 to 11, by matplotlib, from the `data` of each item."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cornerforge.ext.paper.reproduction_figures import Picture
from cornerforge.report.drawing import BLUE, GREEN, GREY, ORANGE, new_figure
from cornerforge.report.moments import corners_of

__all__ = ["cluster_pictures", "example_pictures", "period_pictures"]

Data = Mapping[str, Any]

_MAJORITY = (GREEN, "#56B4E9", "#0072B2", "#004D36", "#7FD6B9", "#003F66", "#8FA9B8", "#4C6B5D")
_MINORITY = (ORANGE, "#CC79A7", "#E69F00", "#8B1A1A", "#7A4B9D", "#F0C23B", "#A65628", "#D81B60")
_MARKS = "osD^vPXh"
_COLUMNS = 4


def period_pictures(data: Data) -> list[Picture]:
    """Figure 7: one panel a period; majority and minority in the plane; one picture for each library."""
    pictures = []
    for world in data["worlds"]:
        periods = world["periods"]
        drawing, panels = new_figure(math.ceil(len(periods) / _COLUMNS), _COLUMNS, 12.0, 6.2)
        for panel, period in zip(panels, periods, strict=False):
            for group, colour, mark in (("majority", GREEN, "."), ("minority", ORANGE, "x")):
                points = np.array(period["points"][group]).reshape(-1, 2)
                panel.plot(points[:, 0], points[:, 1], mark, color=colour, markersize=3.5, alpha=0.6, label=group)
            share = period["minority"] / period["cases"]
            panel.set_title(
                f"{period['steps']} s: minority {100 * share:.1f} %, plane {100 * period['explained']:.0f} %",
                fontsize=9,
            )
        for panel in panels[len(periods) :]:
            panel.set_visible(False)
        panels[0].legend(fontsize=8, markerscale=2)
        for panel in panels[::_COLUMNS]:
            panel.set_ylabel("component 2", fontsize=8)
        for panel in panels[-_COLUMNS:]:
            panel.set_xlabel("component 1", fontsize=8)
        name = "figure7" if world["name"] == "unbounded" else f"figure7-{world['name']}"
        caption = (
            f"The {world['name']} library in the plane of two principal components, for each length of history; "
            "share of cases in the minority, and of the variance that the plane shows. At most 1,500 points of each "
            "group are drawn, so the minority looks larger than it is."
        )
        pictures.append(Picture(name, caption, drawing))
    return pictures


def cluster_pictures(data: Data, *, name: str) -> list[Picture]:
    """Figure 8 or 10: the clusters in the plane, with typical and rare cases; and what the split hangs on."""
    if not data:
        return []
    drawing, (panel,) = new_figure(1, 1, 8.4, 5.4)
    seen = {"majority": 0, "minority": 0}
    for cluster in data["clusters"]:
        group = cluster["group"]
        number = seen[group]
        seen[group] += 1
        colours = _MAJORITY if group == "majority" else _MINORITY
        points = np.array(cluster["points"]).reshape(-1, 2)
        size = 2.5 if group == "majority" else 5.5
        panel.plot(points[:, 0], points[:, 1], _MARKS[number % len(_MARKS)], color=colours[number % len(colours)],
                   markersize=size, alpha=0.55 if group == "majority" else 0.9, markeredgewidth=0,
                   label=f"{cluster['letter']}: {cluster['size']:,} ({group})")  # fmt: skip
    for cluster in data["clusters"]:
        x, y = cluster["typical"][0]
        panel.annotate(cluster["letter"], (x, y), fontsize=11, fontweight="bold", ha="center", va="center",
                       bbox={"boxstyle": "circle,pad=0.15", "facecolor": "white", "alpha": 0.8, "lw": 0.6})  # fmt: skip
    rare = np.array(data["rare"]).reshape(-1, 2)
    panel.plot(rare[:, 0], rare[:, 1], "o", color="black", markersize=10, fillstyle="none", markeredgewidth=0.9,
               label=f"{len(rare)} rarest")  # fmt: skip
    for axis, number, share in zip("xy", (1, 2), data["explained"], strict=True):
        getattr(panel, f"set_{axis}label")(f"component {number} ({100 * share:.0f} % of the variance)", fontsize=9)
    panel.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), markerscale=1.5, frameon=False)
    caption = (
        "Clusters in the plane of two principal components at 1 s: A the majority, further letters the minority; a "
        "letter stands at its cluster's most typical case. At most 2,000 points of each are drawn."
    )
    pictures = [Picture(name, caption, drawing)]
    if "density" in data:
        pictures.append(_split_picture(data, name))
    return pictures


def _split_picture(data: Data, name: str) -> Picture:
    """The rules and how much hangs on them: k-distances, sensitivity of the split, silhouettes."""
    density = data["density"]
    drawing, (curve, shares, counts, scores) = new_figure(2, 2, 10.0, 6.4)
    curve.plot(density["rank"], density["distance"], color=BLUE, linewidth=1.6)
    curve.axhline(density["eps"], color=ORANGE, linewidth=1, linestyle="--")
    curve.annotate(f"eps {density['eps']:.2g}, the knee", (0.02, density["eps"]), fontsize=8, color=ORANGE, va="bottom")
    positive = [value for value in density["distance"] if value > 0.0]
    if positive and max(positive) > 30.0 * min(positive):
        curve.set_yscale("log")
    curve.set_xlabel("share of cases", fontsize=9)
    curve.set_ylabel(f"distance to neighbour no. {2 * density['min_samples']}", fontsize=9)
    styles: dict[int, list[Data]] = {}
    for one in density["sensitivity"]:
        styles.setdefault(one["min_samples"], []).append(one)
    for (min_samples, line), style in zip(styles.items(), (":", "-", "--", "-."), strict=False):
        factor = [one["eps_factor"] for one in line]
        label = f"min_samples {min_samples}{' (chosen)' if min_samples == density['min_samples'] else ''}"
        shares.plot(factor, [one["majority_share"] for one in line], style, color=GREEN, label=f"majority, {label}")
        shares.plot(factor, [one["noise_share"] for one in line], style, color=ORANGE, label=f"noise, {label}")
        counts.plot(factor, [one["dense_clusters"] for one in line], style, color=BLUE, label=label)
    for panel, what in ((shares, "share of cases"), (counts, "dense clusters")):
        panel.axvline(1.0, color=GREY, linewidth=0.8)
        panel.set_xscale("log")
        panel.set_xticks([0.5, 0.7, 1.0, 1.4, 2.0], ["0.5", "0.7", "1", "1.4", "2"])
        panel.minorticks_off()
        panel.set_xlabel("eps over the chosen one", fontsize=9)
        panel.set_ylabel(what, fontsize=9)
        panel.legend(fontsize=7)
    shares.set_ylim(-0.02, 1.02)
    counts.set_ylim(bottom=0.0)
    counts.yaxis.get_major_locator().set_params(integer=True)
    for (group, choice), colour in zip(data["silhouettes"].items(), (GREEN, ORANGE), strict=False):
        if choice["bound"] is None:
            continue
        k = [int(value) for value in choice["silhouettes"]]
        scores.plot(k, list(choice["silhouettes"].values()), "o-", color=colour, markersize=4,
                    label=f"{group}: {choice['k']} chosen")  # fmt: skip
        scores.axhline(choice["bound"], color=colour, linewidth=1, linestyle="--")
    scores.set_xlabel("number of K-means clusters (dashed: what no structure would reach)", fontsize=9)
    scores.set_ylabel("mean silhouette", fontsize=9)
    if scores.get_legend_handles_labels()[1]:
        scores.legend(fontsize=8)
    caption = (
        "How the split and the clusters were chosen, and what would change: the k-distances with the knee; shares and "
        "dense clusters when eps or min_samples were others; silhouettes against the bound for no structure."
    )
    return Picture(f"{name}-choices", caption, drawing)


def example_pictures(data: Data, *, name: str, of: str) -> list[Picture]:
    """Figures 6, 9 and 11: the typical case `of` each kind, 3 to 0 s before contact, moving along with the AV."""
    examples = data.get("examples", [])
    if not examples:
        return []
    rows = math.ceil(len(examples) / 2)
    drawing, panels = new_figure(rows, 2, 12.0, 0.5 + 1.95 * rows)
    for panel, example in zip(panels, examples, strict=False):
        _draw_example(panel, example)
    for panel in panels[len(examples) :]:
        panel.set_visible(False)
    for panel in panels[max(0, len(examples) - 2) : len(examples)]:
        panel.set_xlabel("ahead of the AV [m]", fontsize=8)
    caption = (
        f"The typical case of each {of} (blue: the AV; orange: the BV in the crash; grey: others at contact) "
        "3, 2, 1 s before contact (pale to strong) and at contact (filled). The AV drives to the right and stays at 0."
    )
    return [Picture(name, caption, drawing)]


def _draw_example(panel: Any, example: Data) -> None:
    from matplotlib.patches import Polygon

    for edge in range(example["lanes"] + 1):
        is_outer = edge in (0, example["lanes"])
        panel.axhline(edge * example["lane_width"], color=GREY, linewidth=1.2 if is_outer else 0.8,
                      linestyle="-" if is_outer else (0, (6, 6)))  # fmt: skip
    for moment in example["moments"]:
        is_contact = moment["before"] == 0.0
        strength = 1.0 if is_contact else 0.75 - 0.18 * moment["before"]
        for other in moment["others"] if is_contact else []:
            panel.add_patch(Polygon(_corners(other), facecolor="#BBBBBB", edgecolor="none"))
        for key, colour in (("bv", ORANGE), ("av", BLUE)):
            if moment[key] is not None:
                panel.add_patch(
                    Polygon(_corners(moment[key]), facecolor=colour if is_contact else "none", edgecolor=colour,
                            alpha=0.85 if is_contact else strength, linewidth=1.2)
                )  # fmt: skip
    paths = {key: [moment[key] for moment in example["moments"] if moment[key] is not None] for key in ("av", "bv")}
    for key, colour in (("bv", ORANGE), ("av", BLUE)):
        path = np.array(paths[key])
        panel.plot(path[:, 0], path[:, 1], color=colour, linewidth=0.8, alpha=0.6)
    panel.set_xlim(-34.0, 34.0)
    panel.set_ylim(-0.6, example["lanes"] * example["lane_width"] + 0.6)
    panel.set_aspect("equal")
    panel.grid(visible=False)
    panel.set_yticks([])
    happened = example["happened"]
    panel.set_title(f"{example['title']}\n{happened[:1].upper()}{happened[1:]}", fontsize=9, loc="left")


def _corners(box: list[float]) -> Any:
    return corners_of(*np.array(box)[:, None])[0]
