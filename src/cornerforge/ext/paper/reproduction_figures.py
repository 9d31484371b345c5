"""Pictures of the paper's items, by matplotlib, from the `data` of each; the same bytes for the same numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cornerforge.report.drawing import BLUE, GREEN, GREY, ORANGE, new_figure

__all__ = ["Picture", "crash_type_pictures", "exposure_pictures", "matrix_pictures", "training_pictures"]

Data = Mapping[str, Any]

_WORLDS = {"natural": (GREEN, "--"), "adversary": (ORANGE, "-"), "bounded adversary": (BLUE, ":")}
_TYPE_COLOURS = ("#0072B2", "#56B4E9", "#000000", "#D55E00", "#F0E442")
_TYPE_HATCHES = ("", "//", "xx", "", "..")
_SEEDS = (ORANGE, "#E69F00", "#CC79A7", "#56B4E9", "#F0E442")


@dataclass(frozen=True)
class Picture:
    """A drawing with its file's name (no ending) and what it shows."""

    name: str
    caption: str
    drawing: Any


def training_pictures(data: Data) -> list[Picture]:
    """Figure 2: yield over decisions and over time, with the paper's end as a mark."""
    drawing, (by_decisions, by_time) = new_figure(1, 2, 10.5, 4.2)
    for number, curve in enumerate(data["curves"]):
        is_paper_preset = curve["name"].startswith("preset paper")
        colour = BLUE if is_paper_preset else _SEEDS[number % len(_SEEDS)]
        share = curve["crashes_per_test"]
        for panel, x in (
            (by_decisions, np.array(curve["decisions"]) / 1e6),
            (by_time, np.array(curve["seconds"], dtype=float)),
        ):
            panel.fill_between(x, curve["low"], curve["high"], color=colour, alpha=0.2, linewidth=0)
            panel.plot(x, share, color=colour, linewidth=1.6, linestyle="--" if is_paper_preset else "-",
                       label=curve["name"])  # fmt: skip
    paper = data["paper"]
    for panel in (by_decisions, by_time):
        panel.axhline(paper["crashes_per_test"], color="black", linewidth=1, linestyle=(0, (5, 3)))
        for name, level in data["levels"].items():
            panel.axhline(level, color=GREY, linewidth=1, linestyle=":")
            panel.annotate(name, (0.99, level), xycoords=("axes fraction", "data"), fontsize=8, color=GREY,
                           ha="right", va="bottom")  # fmt: skip
        panel.set_ylim(0.0, 1.02)
    by_time.plot(
        [paper["seconds"]], [paper["crashes_per_test"]], "D", color="black", label="the paper: 0.286 after 4 days"
    )
    by_time.set_xscale("log")
    by_time.set_xlabel("training time [s], log scale")
    by_decisions.set_xlabel("decisions of the critical BV [million]")
    by_decisions.set_ylabel("crashes of the AV per test, while exploring")
    by_decisions.annotate("the paper's end: 0.286", (0.99, paper["crashes_per_test"]),
                          xycoords=("axes fraction", "data"), fontsize=8, ha="right", va="bottom")  # fmt: skip
    by_time.legend(fontsize=8, loc="upper right", bbox_to_anchor=(1.0, 0.68), framealpha=0.9)
    caption = (
        "Yield during training, by decisions and by time; shade: exact 95 % interval of each point. Dashed level and "
        "diamond: all that the paper's text says of its curve. Dotted: plain rules that learn nothing."
    )
    return [Picture("figure2", caption, drawing)]


def exposure_pictures(data: Data) -> list[Picture]:
    """Figure 3: densities of BBD and TTC ahead and behind, in each world."""
    drawing, panels = new_figure(2, 2, 10.0, 6.6)
    for panel, quantity in zip(panels, data["quantities"].values(), strict=True):
        edges = np.array(quantity["edges"])
        for name, counts in quantity["counts"].items():
            colour, style = _WORLDS[name]
            density = np.array(counts) / (data["miles"][name] * np.diff(edges))
            label = f"{name} ({data['miles'][name]:,.0f} miles)"
            panel.stairs(density, edges, color=colour, linestyle=style, linewidth=1.6, label=label)
        panel.set_xlim(edges[0], edges[-1])
        panel.set_ylim(bottom=0.0)
        panel.set_xlabel(f"{quantity['label']} [{quantity['unit']}]", fontsize=9)
        panel.set_ylabel(f"seconds per mile and {quantity['unit']}", fontsize=9)
    panels[0].legend(fontsize=8)
    caption = (
        "What the AV (idm-mobil) is exposed to: seconds per mile at each distance (BBD) to, and time to collision "
        "(TTC) with, the vehicles ahead and behind in its lane; TTC only while closing."
    )
    return [Picture("figure3", caption, drawing)]


def crash_type_pictures(data: Data) -> list[Picture]:
    """Figure 5: share of each type for each AV, unbounded and bounded."""
    groups, types = data["groups"], data["types"]
    drawing, (panel,) = new_figure(1, 1, 9.5, 4.2)
    width = 0.8 / max(1, len(groups))
    for number, group in enumerate(groups):
        if not group["crashes"]:
            continue
        x = np.arange(len(types)) + (number - 0.5 * (len(groups) - 1)) * width
        shares = np.array(group["shares"])
        ends = np.array(group["intervals"]).T
        colour = ORANGE if group["av"] == groups[0]["av"] else BLUE
        panel.bar(
            x, shares, 0.92 * width, color=colour, alpha=0.55 if group["bounded"] else 1.0,
            hatch="///" if group["bounded"] else "", edgecolor="white", linewidth=0.5,
            label=f"{group['name']} ({group['crashes']:,} crashes)",
        )  # fmt: skip
        panel.errorbar(x, shares, np.abs(ends - shares), fmt="none", ecolor="black", elinewidth=1, capsize=2)
    panel.set_xticks(range(len(types)), [f"type {code}\n{name}" for code, name in enumerate(types, 1)])
    panel.set_ylabel("share of the AV's crashes")
    panel.set_ylim(0.0, 1.05)
    panel.grid(axis="x", visible=False)
    panel.legend(fontsize=8)
    caption = "Crash types that the adversary of idm-mobil makes of each AV's crashes; lines are exact 95 % intervals."
    return [Picture("figure5", caption, drawing)]


def matrix_pictures(data: Data) -> list[Picture]:
    """The matrix: yields as a map, free and bounded; and the types of the crashes of the surrogate AV."""
    pictures = [_yield_map(data, "net_per_test", "matrix", "Crashes of the AV per test, less its natural rate")]
    if any(cell.get("avoidable_per_test") is not None for cell in data["cells"]):
        pictures.append(
            _yield_map(data, "avoidable_per_test", "matrix-avoidable", "Avoidable crashes of the AV per test")
        )
    return [*pictures, _types_picture(data)]


def _row_names(cells: list[Data]) -> list[str]:
    """Rows of a map, in order of appearance, without the part that says whether bounded."""
    return list(dict.fromkeys(cell["key"].rpartition(".")[0] for cell in cells))


def _shown(key: str) -> str:
    trained_on, dot, reward = key.partition(".")
    return f"on {trained_on}, {reward}" if dot else trained_on


def _yield_map(data: Data, what: str, name: str, title: str) -> Picture:
    cells, avs = data["cells"], data["avs"]
    rows = _row_names(cells)
    drawing, panels = new_figure(1, 2, 3.6 + 1.9 * len(avs), 1.9 + 0.38 * len(rows))
    for panel, bounded in zip(panels, (False, True), strict=True):
        values = np.full((len(rows), len(avs)), np.nan)
        said: dict[tuple[int, int], float] = {}
        for cell in cells:
            if cell["bounded"] == bounded and cell.get(what) is not None:
                place = rows.index(cell["key"].rpartition(".")[0]), avs.index(cell["av"])
                values[place] = cell[what]
                if what == "net_per_test" and cell.get("paper") is not None:
                    said[place] = cell["paper"]
        darkest = max(float(np.nanmax(values, initial=0.0)), 1e-4) if bounded else 1.0
        panel.grid(visible=False)
        panel.imshow(values, cmap="Blues", vmin=0.0, vmax=darkest, aspect="auto")
        for (y, x), value in np.ndenumerate(values):
            if np.isfinite(value):
                paper = f"\n(paper {said[y, x]:g})" if (y, x) in said else ""
                panel.text(x, y, _short(value) + paper, ha="center", va="center", fontsize=8,
                           color="white" if value > 0.55 * darkest else "black")  # fmt: skip
        panel.set_xticks(range(len(avs)), avs, rotation=30, ha="right")
        panel.set_yticks(range(len(rows)), [_shown(row) for row in rows] if not bounded else [])
        panel.set_title("bounded to what the naturalistic model allows" if bounded else "unbounded", fontsize=9)
        panel.set_xlabel("AV under test", fontsize=9)
    caption = (
        f"{title}: adversaries (rows: plain ones, then by the AV and the reward they learned with) against AVs. "
        "The bounded map has a colour scale of its own, up to its largest number."
    )
    return Picture(name, caption, drawing)


def _short(value: float) -> str:
    """A share in few digits; 0 for what no test of this size tells from 0."""
    if abs(value) < 5e-5:
        return "0"
    return f"{value:.4f}" if abs(value) < 0.01 else f"{value:.2f}" if value >= 0.1 else f"{value:.3f}"


def _types_picture(data: Data) -> Picture:
    """Types of crashes of the first AV, by adversary."""
    av = data["avs"][0]
    cells = [cell for cell in data["cells"] if cell["av"] == av and cell["typed"]]
    types = list(cells[0]["crash_types"]) if cells else []
    drawing, (panel,) = new_figure(1, 1, 9.5, 1.4 + 0.3 * max(1, len(cells)))
    left = np.zeros(len(cells))
    for number, name in enumerate(types):
        share = np.array([cell["crash_types"][name] / cell["typed"] for cell in cells])
        panel.barh(range(len(cells)), share, left=left, color=_TYPE_COLOURS[number], hatch=_TYPE_HATCHES[number],
                   edgecolor="white", linewidth=0.5, label=name)  # fmt: skip
        left += share
    names = [
        f"{_shown(cell['key'].rpartition('.')[0])}{', bounded' if cell['bounded'] else ''} ({cell['typed']:,})"
        for cell in cells
    ]
    panel.set_yticks(range(len(cells)), names)
    panel.set_ylim(len(cells) - 0.5, -0.5)
    panel.set_xlim(0.0, 1.0)
    panel.set_xlabel(f"share of the crashes of {av} (number of crashes in brackets)", fontsize=9)
    panel.grid(axis="y", visible=False)
    if types:
        panel.legend(fontsize=8, ncols=len(types), loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return Picture("matrix-types", f"Crash types of {av} by adversary.", drawing)
