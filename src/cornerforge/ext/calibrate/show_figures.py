"""Figures of a naturalistic model's tables, as PNG; needs matplotlib (extra `report`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._files import writing
from cornerforge.ext.calibrate.ivbss_initial import gap_law, speed_law
from cornerforge.ext.calibrate.shown import (
    FREE_FACTS,
    GAP_FACTS,
    SHOWN_SPEEDS,
    SPEED_FACTS,
    TIME_GAP_FACTS,
    counted_states,
    mean_and_sd,
    quantiles,
)
from cornerforge.ndd.grids import GAP_GRID, RANGE_RATE_GRID
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel
from cornerforge.report.drawing import check_matplotlib
from cornerforge.types import ACCELERATIONS

__all__ = ["check_matplotlib", "draw_figures"]

Floats = NDArray[np.float64]

_DPI = 110
_TTC = (3.0, 5.0, 10.0, 20.0)
_EXTENT = (RANGE_RATE_GRID.lower, RANGE_RATE_GRID.upper, GAP_GRID.lower, GAP_GRID.upper)


def draw_figures(model: NddModel, folder: Path) -> list[Path]:
    """Draw the model into `folder`, which must exist; the same model and matplotlib give the same bytes.

    Returns:
        The files, in the order in which to look at them.

    Raises:
        MissingExtraError: No matplotlib.
        OutputError: A file cannot be written.
    """
    check_matplotlib()
    drawn = {
        "following-mean": _following_mean(model),
        "following-sd": _following_sd(model),
        "following-support": _support(model),
        "free-flow": _free_flow(model),
        "lane-change": _lane_change(model),
        "initial-state": _initial(model),
        "counted": _counted(model),
    }
    paths = []
    for name, figure in drawn.items():
        paths.append(folder / f"{name}.png")
        with writing(paths[-1], "the figure") as part:
            figure.savefig(part, format="png", dpi=_DPI, metadata={"Software": None})
    return paths


def _panels(columns: int, width: float, height: float, title: str) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(1, columns, squeeze=False)[0]
    return figure, list(axes)


def _state_map(axes: Any, values: Floats, **colours: Any) -> Any:
    """A table over range rate (across) and gap (up), with lines of equal time to collision."""
    from matplotlib.patheffects import withStroke

    seen = [withStroke(linewidth=2.0, foreground="white")]  # on dark cells and light ones
    image = axes.imshow(values, origin="lower", aspect="auto", extent=_EXTENT, interpolation="nearest", **colours)
    closing = np.linspace(0.05, 10.0, 100)
    for ttc in _TTC:
        axes.plot(-closing, ttc * closing, color="black", linewidth=0.9, linestyle=":", path_effects=seen)
        at = min(9.2, 106.0 / ttc)
        axes.annotate(f"{ttc:g} s", (-at, ttc * at), fontsize=8, ha="center", va="bottom", path_effects=seen)
    axes.set_xlim(_EXTENT[0], _EXTENT[1])
    axes.set_ylim(_EXTENT[2], _EXTENT[3])
    axes.set_xlabel("range rate [m/s], negative: closing")
    return image


def _three_maps(title: str, tables: Floats, label: str, contour: tuple[float, ...] = (), **colours: Any) -> Any:
    """Maps at the three shown speeds; `tables` has shape (21, 116, 19)."""
    figure, panels = _panels(len(SHOWN_SPEEDS), 12.0, 4.6, f"{title} (dotted: equal time to collision)")
    for axes, speed in zip(panels, SHOWN_SPEEDS, strict=True):
        table = tables[int(SPEEDS.searchsorted(speed))]
        image = _state_map(axes, table, **colours)
        levels = [level for level in contour if table.min() < level < table.max()]
        if levels:
            lines = axes.contour(
                RANGE_RATES, GAPS, table, levels=levels, colors="black", linewidths=0.8, linestyles="solid"
            )
            axes.clabel(lines, fontsize=8, fmt="%g")
        axes.set_title(f"at {speed:g} m/s")
    panels[0].set_ylabel("gap, bumper to bumper [m]")
    figure.colorbar(image, ax=panels, label=label)
    return figure


def _following_mean(model: NddModel) -> Any:
    from matplotlib.colors import TwoSlopeNorm

    mean = mean_and_sd(model.following)[0]
    return _three_maps(
        "Following: mean acceleration", mean, "mean acceleration [m/s²]",
        contour=(-3.0, -1.0, -0.3, 0.0, 0.3, 1.0),
        cmap="RdBu", norm=TwoSlopeNorm(0.0, ACCELERATIONS[0], ACCELERATIONS[-1]),
    )  # fmt: skip


def _following_sd(model: NddModel) -> Any:
    sd = mean_and_sd(model.following)[1]
    return _three_maps(
        "Following: spread of acceleration", sd, "standard deviation [m/s²]", cmap="viridis", vmin=0.0,
        vmax=max(1.0, float(sd.max())),
    )  # fmt: skip


def _support(model: NddModel) -> Any:
    possible = (model.following > 0).sum(axis=-1).astype(np.float64)
    return _three_maps(
        "Following: what is possible at all", possible, "accelerations with a probability above 0, of 31",
        cmap="cividis", vmin=1.0, vmax=float(ACCELERATIONS.size),
    )  # fmt: skip


def _free_flow(model: NddModel) -> Any:
    figure, (left, middle, right) = _panels(3, 12.0, 4.0, "Free flow (no leader within 115 m); dots: published facts")
    mean, sd = mean_and_sd(model.free)
    hard = model.free[:, ACCELERATIONS <= -0.99].sum(axis=-1, dtype=np.float64)
    speed, fact_sd, fact_hard = zip(*FREE_FACTS, strict=True)
    left.axhspan(0.02, 0.05, color="tab:orange", alpha=0.3, label="published: 0.02 to 0.05")
    left.plot(SPEEDS, mean, label="model")
    left.axhline(0.0, color="grey", linewidth=0.5)
    left.set_ylabel("mean acceleration [m/s²]")
    left.legend(fontsize=8)
    middle.plot(SPEEDS, sd)
    middle.plot(speed, fact_sd, "o", color="tab:orange")
    middle.set_ylim(bottom=0.0)
    middle.set_ylabel("standard deviation [m/s²]")
    right.semilogy(SPEEDS, np.where(hard > 0.0, hard, np.nan))
    right.semilogy(speed, fact_hard, "o", color="tab:orange")
    right.set_ylabel("share at or below -1 m/s²")
    for axes in (left, middle, right):
        axes.set_xlabel("speed [m/s]")
        axes.grid(alpha=0.3)
    return figure


def _lane_change(model: NddModel) -> Any:
    title = f"Lane changes; overlooking a neighbour: {model.overlook:g}, a conflict: {model.overlook_conflict:g}"
    figure, (base, desire, lead, rear) = _panels(4, 16.0, 4.4, title)
    base.plot(SPEEDS, 100.0 * model.lc_base.astype(np.float64))
    base.set_ylim(bottom=0.0)
    base.set_xlabel("speed [m/s]")
    base.set_ylabel("percent per decision (1 s) and side")
    base.set_title("base chance")
    base.grid(alpha=0.3)
    image = _state_map(desire, model.lc_desire.astype(np.float64), cmap="magma_r", vmin=0.0)
    figure.colorbar(image, ax=desire, label="multiplier of the base chance")
    desire.set_title(f"desire by leader (without one: {model.lc_desire_free:g})")
    desire.set_ylabel("gap [m]")
    for axes, table, who in ((lead, model.lc_accept_lead, "ahead"), (rear, model.lc_accept_rear, "behind")):
        image = _state_map(axes, table.astype(np.float64), cmap="viridis", vmin=0.0, vmax=1.0)
        figure.colorbar(image, ax=axes, label="chance that the gap is accepted")
        axes.set_title(f"acceptance, adjacent vehicle {who}")
    return figure


def _initial(model: NddModel) -> Any:
    title = "Start of a test; 5, 25, 50, 75, 95 % points: solid the model's, dashed the published ones"
    figure, panels = _panels(4, 16.0, 4.0, title)
    speeds = speed_law(model.initial)
    joint = speeds[:, None, None] * gap_law(model.initial)
    joint /= joint.sum()
    gap = joint.sum(axis=(0, 2))
    panels[0].bar(SPEEDS, speeds, width=1.0, alpha=0.5)
    panels[0].set_xlabel("speed [m/s]")
    panels[1].bar(GAPS, gap, width=1.0, alpha=0.5)
    panels[1].set_xlabel("gap while following [m]")
    inner = np.linspace(-0.45, 0.45, 10)  # each grid gap stands for a whole metre
    time_gap = ((GAPS[None, :, None] + inner) / SPEEDS[:, None, None]).reshape(-1)
    weight = np.repeat(joint.sum(axis=2).reshape(-1) / inner.size, inner.size)
    panels[2].hist(time_gap, weights=weight, bins=list(np.arange(0.0, 5.01, 0.1)), alpha=0.5)
    panels[2].set_xlabel("time gap while following [s]")
    own = (quantiles(SPEEDS, speeds), quantiles(GAPS, gap), quantiles(time_gap, weight))
    for axes, facts, points in zip(panels[:3], (SPEED_FACTS, GAP_FACTS, TIME_GAP_FACTS), own, strict=True):
        for percent, value in facts.items():
            axes.axvline(points[percent], color="tab:blue", linewidth=1.2)
            axes.axvline(value, color="tab:orange", linestyle="--", linewidth=1.4)
        axes.set_ylabel("share")
    _range_rate_by_gap(panels[3], joint.sum(axis=0))
    return figure


def _range_rate_by_gap(axes: Any, by_gap: Floats) -> None:
    """Mean and sd of the range rate by gap, of P(gap, range rate), shape (116, 19)."""
    total = by_gap.sum(axis=1)
    weight = np.where(total > 0.0, total, 1.0)
    mean = by_gap @ RANGE_RATES / weight
    sd = np.sqrt(np.maximum(by_gap @ RANGE_RATES**2 / weight - mean**2, 0.0))
    axes.plot(GAPS[1:], mean[1:], label="mean")
    axes.plot(GAPS[1:], sd[1:], label="standard deviation")
    axes.axhline(1.3, color="tab:orange", linestyle="--", linewidth=1.0, label="published, all gaps: 1.3")
    axes.set_xlabel("gap [m]")
    axes.set_ylabel("range rate [m/s]")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)


def _counted(model: NddModel) -> Any:
    figure, (left, right) = _panels(2, 11.0, 4.4, "What the tables rest on: decisions counted from data")
    counts = counted_states(model)
    if counts is None:
        for axes in (left, right):
            axes.set_axis_off()
        left.text(0.0, 0.5, "The model's provenance says nothing of counted decisions.")
        return figure
    led = counts.sum(axis=(1, 2))
    left.bar(SPEEDS, led, width=0.9, label="behind a leader")
    alone = model.provenance.get("counted_free")
    if isinstance(alone, (list, tuple)) and len(alone) == SPEEDS.size:
        left.bar(SPEEDS, alone, width=0.9, bottom=led, label="without one")
    left.set_ylim(0.0, 1.1 * max(1.0, float(led.max())))
    left.legend(fontsize=8)
    left.set_xlabel("speed [m/s]")
    left.set_ylabel("decisions counted")
    left.set_title(f"{int(counts.sum()):,} behind a leader, in {int((counts > 0).sum()):,} of {counts.size:,} states")
    total = counts.sum(axis=0).astype(np.float64)
    image = _state_map(right, np.where(total > 0.0, np.log10(np.maximum(total, 1.0)), np.nan), cmap="viridis_r")
    right.set_ylabel("gap [m]")
    right.set_title("all speeds together; white: prior alone")
    figure.colorbar(image, ax=right, label="log10 of decisions")
    return figure
