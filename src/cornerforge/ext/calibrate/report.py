"""The fit report: what went into a model, how well it predicts held-out drivers, and where it only extrapolates."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._files import writing
from cornerforge.errors import MissingExtraError
from cornerforge.ext.calibrate.lane_fit import notes_on, told_by_data
from cornerforge.ext.calibrate.shown import counted_states, key_numbers
from cornerforge.ndd.grids import SPEED_GRID
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel, model_hash
from cornerforge.report.drawing import inline, new_figure, page, png_of, table
from cornerforge.results.naturalistic import FitReport, FittedLaneChanges

__all__ = ["PROBES", "write_fit_report"]

PROBES = ((20.0, 30.0, 0.0), (20.0, 30.0, -2.0), (30.0, 30.0, 0.0), (30.0, 30.0, -2.0))
"""States (speed, gap, range rate) at which a study of other choices shows the table's mean and spread."""


_SCORED = (
    ("law blended into its safe response, as the table is made of", "model", "model_on_grid"),
    ("fitted law alone", "log", "log_on_grid"),
    ("table, with the counts", "", "table"),
    ("fitted stochastic IDM", "idm", "idm_on_grid"),
    ("all accelerations alike", "uniform", "uniform"),
)
"""Name of each score on the page, and its keys in `scores.held_out_scores`: at all speeds, and on the grid."""
_NEAREST = 10.0
"""Least gap at which the page tells accelerations [m]."""


def write_fit_report(report: FitReport, model: NddModel, path: Path) -> None:
    """Write the report as one HTML page that needs nothing else; the same fit gives the same bytes.

    Raises:
        OutputError: The page cannot be written there.
    """
    parts = [
        f"<h1>Naturalistic driving model {model_hash(model)}</h1>",
        _summary(report),
        "<h2>What to know</h2><ul>" + "".join(f"<li>{escape(note)}</li>" for note in report.notes) + "</ul>",
        "<h2>What is data, what is prior</h2>",
        _sources(report),
        "<h2>Where the model extrapolates</h2>",
        _coverage(report, model),
        "<h2>Lane changes</h2>",
        _lane_changes(report.lane_changes),
        "<h2>Held-out decisions: mean log-probability</h2>",
        _held_out(report),
        "<h2>How far other choices matter</h2>",
        _sensitivity(report),
        "<h2>Rows left out</h2>",
        _bad_rows(report),
        "<h2>Mean acceleration behind a leader, at 30 m/s [m/s²]</h2>",
        _response_table(model),
        "<h2>Free flow against the published facts</h2>",
        _free_table(model),
        "<h2>Provenance</h2>",
        _provenance(model),
    ]
    with writing(path, "the fit report") as part:
        part.write_text(page("Fit report", "".join(parts)), encoding="utf-8")


def _sources(report: FitReport) -> str:
    """Each part of the model, where its numbers come from, and why."""
    head = ["part", "where it comes from", "on how many data, or why not"]
    return table(head, [[part.name, part.source, part.why] for part in report.parts])


def _lane_changes(changes: FittedLaneChanges) -> str:
    """Table of fitted numbers, with intervals, the prior and left-out changes; or the reason why there is no fit."""
    text = "".join(f"<p>{escape(note)}</p>" for note in notes_on(changes))
    if not changes.fitted:
        return f"<p>Not fitted: {escape(changes.why)}.</p>{text}"
    rows = [
        [
            name, number.unit, f"{number.estimate:.4g}", _between(number.interval95), f"{number.prior:.4g}",
            _between(number.prior_interval95), "yes" if told_by_data(number) else "hardly",
        ]
        for name, number in changes.numbers.items()
    ]  # fmt: skip
    head = ["parameter", "unit", "estimate", "95 %", "prior", "95 % of the prior", "told by the data"]
    return table(head, rows) + text


def _between(interval: tuple[float, float]) -> str:
    return "{:.4g} to {:.4g}".format(*interval)


def _coverage(report: FitReport, model: NddModel) -> str:
    """A map of the counted decisions: everything else is extrapolated."""
    counted = counted_states(model)
    if counted is None:
        counted = np.zeros((SPEEDS.size, GAPS.size, RANGE_RATES.size), dtype=np.int64)
    by_speed = counted.sum(axis=(1, 2))
    last = int(np.flatnonzero(by_speed)[-1]) if by_speed.any() else 0
    beyond = f"No decision at all was counted above {SPEEDS[last]:g} m/s. " if by_speed.any() else ""
    text = (
        f"<p>{report.decisions_on_grid:,} decisions were counted, {_share(by_speed[:3], by_speed)} at 20-22 m/s. "
        f"{beyond}Blank states hold the prior alone: the fitted law at speeds at which it was never seen.</p>"
    )
    try:
        drawing, panels = new_figure(1, 2, 11.0, 4.0)
    except MissingExtraError as error:
        return f"{text}<p>No map: {escape(str(error))}</p>"
    _map(panels[0], counted.sum(axis=2).T, GAPS, "gap to the leader [m]")
    mesh = _map(panels[1], counted.sum(axis=1).T, RANGE_RATES, "range rate [m/s], negative is closing")
    drawing.colorbar(mesh, ax=panels, label="decisions counted")
    return text + inline(png_of(drawing), "Decisions counted by speed and gap (left), speed and range rate (right).")


def _share(part: NDArray[np.int64], whole: NDArray[np.int64]) -> str:
    return f"{part.sum() / max(int(whole.sum()), 1):.0%}"


def _map(panel: Any, counts: NDArray[np.int64], grid: NDArray[np.float64], label: str) -> Any:
    """Counts (k, 21) over speed and a grid of k places, on a log scale; blank where the count is 0."""
    from matplotlib.colors import LogNorm

    shown = np.ma.masked_equal(counts.astype(np.float64), 0.0)
    mesh = panel.pcolormesh(
        SPEEDS, grid, shown, norm=LogNorm(1.0, max(float(counts.max(initial=1)), 10.0)), shading="nearest"
    )
    panel.set_xlim(SPEED_GRID.lower, SPEED_GRID.upper)
    panel.set_ylim(grid[0] - 0.5, grid[-1] + 0.5)
    panel.set_xlabel("speed [m/s]", fontsize=9)
    panel.set_ylabel(label, fontsize=9)
    return mesh


def _sensitivity(report: FitReport) -> str:
    """Table of other prior strengths and smoothing windows, all scored on the same decisions."""
    if not report.sensitivity:
        return "<p>Not studied for this fit; <code>cornerforge ndd fit --study</code> fits it again with others.</p>"
    places = [
        (name, part)
        for name, score in report.sensitivity[0].held_out.items()
        for part in ("law", "table")
        if getattr(score, part) is not None
    ]
    scores = [
        [row.variant, *(f"{getattr(row.held_out[name], part):.3f}" for name, part in places)]
        for row in report.sensitivity
    ]
    accelerations = [
        [row.variant, *(f"{mean:+.2f}, {sd:.2f}" for mean, sd in row.probes)] for row in report.sensitivity
    ]
    return (
        "<p>Whole fits of the same files with one choice changed. Log-likelihood per held-out decision, read as the "
        "fit itself reads them:</p>"
        + table(["choice", *(f"{part}, {name}" for name, part in places)], scores)
        + "<p>Mean and standard deviation of the table's acceleration [m/s²], at a speed, a gap and a range rate:</p>"
        + table(["choice", *map(_probe, PROBES)], accelerations)
        + "<p>A shorter window takes more of the measuring error for driving: it sets the spread of accelerations, and "
        "with it how near drivers come to each other in simulated traffic.</p>" + _crash_rates(report)
    )


def _crash_rates(report: FitReport) -> str:
    """How often the traffic of each variant crashes, where it was driven."""
    driven = [(row.variant, row.traffic) for row in report.sensitivity if row.traffic is not None]
    if not driven:
        return "<p>How far the crash rate moves was not asked for.</p>"
    rows = [
        [
            name,
            f"{t.bv_crashes:,} in {t.bv_miles:.3g} miles",
            _rate(t.bv_crashes_per_mile, t.bv_interval95),
            f"{t.av_crashes:,} in {t.tests:,} tests",
            _rate(t.av_crashes_per_test, t.av_interval95),
        ]
        for name, t in driven
    ]
    head = [
        "choice",
        "crashes between background vehicles",
        "per vehicle-mile (95 %)",
        "crashes of the AV idm-mobil",
        "per test of 400 m (95 %)",
    ]
    return (
        "<h3>How far the crash rate moves</h3>"
        + table(head, rows)
        + "<p>The same tests of the same seed for every choice. Intervals are exact (Poisson, Clopper-Pearson); two "
        "that overlap widely show no difference, and rule out none that fits into both. "
        "<code>cornerforge rate --model</code> counts longer.</p>"
    )


def _rate(value: float, interval: Sequence[float]) -> str:
    return f"{value:.2g} ({interval[0]:.2g} to {interval[1]:.2g})"


def _probe(state: tuple[float, float, float]) -> str:
    return "{:g} m/s, {:g} m, {:+g} m/s".format(*state)


def _summary(report: FitReport) -> str:
    return table(
        ["", ""],
        [
            ["rows read", f"{report.rows_read:,}"],
            ["rows used", f"{report.rows_used:,}"],
            ["decisions fitted, one a second", f"{report.decisions_fitted:,}"],
            ["of these on the grid (19.5 m/s and above)", f"{report.decisions_on_grid:,}"],
            ["states with data", f"{report.states:,} of {report.states_total:,}"],
            ["share of the table that is data, over all states", f"{report.data_share_of_states:.3%}"],
            ["the same where there are data, over decisions", f"{report.data_share_where_data:.1%}"],
        ],
    )


def _held_out(report: FitReport) -> str:
    """Show how well each law and the table predict drivers that the fit did not see, in a table for each file."""
    if not report.held_out_log_likelihood:
        return "<p>No decision was held out.</p>"
    text = (
        "<p>Natural log, mean over the decisions; higher is better. The IDM has the same noise with the same "
        "state-dependent spread, and v0 fixed; <code>cornerforge ndd validate</code> fits it to the compared files' "
        "own training decisions, and gives intervals.</p>"
    )
    return text + "".join(_score_table(name, row) for name, row in report.held_out_log_likelihood.items())


def _score_table(name: str, row: Mapping[str, float]) -> str:
    head = ["what predicts", f"all {row['decisions']:,} decisions"]
    if "table" in row:
        head.append(f"the {row['table_decisions']:,} from 19.5 m/s, where the table begins")
    scores = [
        [label, *(f"{row[key]:.3f}" if key in row else "" for key in keys)][: len(head)] for label, *keys in _SCORED
    ]
    return f"<h3>{escape(name)}</h3>{table(head, [line for line in scores if any(line[1:])])}"


def _bad_rows(report: FitReport) -> str:
    rows = [
        [name, reason, f"{entry.rows:,}", entry.first_line]
        for name, reasons in report.bad_rows.items()
        for reason, entry in reasons.items()
    ]
    return table(["file", "reason", "rows", "first line"], rows) if rows else "<p>None.</p>"


def _response_table(model: NddModel) -> str:
    found = key_numbers(model)["following"]
    means = found["mean_mps2"][found["speed_mps"].index(30.0)]
    rows = [
        [f"gap {gap:g} m", *(f"{mean:.2f}" for mean in row)]
        for gap, row in zip(found["gap_m"], means, strict=True)
        if gap >= _NEAREST
    ]
    return table(["range rate [m/s]", *(f"{rate:g}" for rate in found["range_rate_mps"])], rows)


def _free_table(model: NddModel) -> str:
    free, rows = key_numbers(model)["free_flow"], []
    for fact in free["published"]:
        mean, sd, hard = (
            free[name][free["speed_mps"].index(fact["speed_mps"])]
            for name in ("mean_mps2", "sd_mps2", "share_braking_1_mps2")
        )
        rows.append(
            [
                f"{fact['speed_mps']:g} m/s", f"{mean:.3f}", "{:g} to {:g}".format(*fact["mean_mps2"]), f"{sd:.2f}",
                fact["sd_mps2"], f"{hard:.1%}", f"{fact['share_braking_1_mps2']:.1%}",
            ]
        )  # fmt: skip
    head = ["speed", "mean", "published", "standard deviation", "published", "share ≤ -1 m/s²", "published"]
    return table(head, rows)


def _provenance(model: NddModel) -> str:
    shown = {key: value for key, value in model.provenance.items() if not key.startswith("counted")}
    return f"<pre>{escape(json.dumps(shown, indent=1, sort_keys=True))}</pre>"
