"""The fit report: what went into a model, how well it predicts held-out drivers, and where it only extrapolates."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path

import numpy as np

from cornerforge.errors import OutputError
from cornerforge.ndd.model import GAPS, RANGE_RATES, SPEEDS, NddModel, model_hash
from cornerforge.types import ACCELERATIONS

__all__ = ["FitReport", "write_fit_report"]


@dataclass(frozen=True)
class FitReport:
    """What went into a fit, and what came out.

    Attributes:
        rows_read: Rows of all files.
        rows_used: Rows that passed every check.
        bad_rows: For each file, reason -> rows left out and the line of the first.
        decisions_fitted: Decisions (one a second) that were fitted on.
        decisions_on_grid: Those of them that were counted into the following table.
        states: Following states with at least one counted decision.
        states_total: Following states of the grid.
        data_share_of_states: Share of the table's probability that is counts, not prior, mean over all states.
        data_share_where_data: The same, mean over the counted decisions.
        speed_99_percent: 99th percentile of the fitted decisions' speeds [m/s].
        held_out_log_likelihood: For each file with held-out decisions: see `scores.held_out_scores`.
        notes: What a reader must know, one plain sentence each.
    """

    rows_read: int
    rows_used: int
    bad_rows: Mapping[str, Mapping[str, Mapping[str, int]]]
    decisions_fitted: int
    decisions_on_grid: int
    states: int
    states_total: int
    data_share_of_states: float
    data_share_where_data: float
    speed_99_percent: float
    held_out_log_likelihood: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """All fields, JSON-compatible."""
        return {**asdict(self), "notes": list(self.notes)}


_FREE_FACTS = ((20, 0.61, 0.06), (30, 0.38, 0.008), (36, 0.32, 0.004))
"""Speed [m/s], published standard deviation [m/s2] and share at or below -1 m/s2 of free-flow accelerations (IVBSS)."""

_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;margin:.5em 0}"
    "td,th{padding:.2em .8em;border-bottom:1px solid #ddd;text-align:right}"
    "td:first-child,th:first-child{text-align:left}pre{background:#f6f6f6;padding:1em;overflow:auto}"
)


def write_fit_report(report: FitReport, model: NddModel, path: Path) -> None:
    """Write the report as one HTML page that needs nothing else; the same fit gives the same bytes.

    Raises:
        OutputError: The page cannot be written there.
    """
    parts = [
        f"<h1>Naturalistic driving model {model_hash(model)}</h1>",
        _summary(report),
        "<h2>What to know</h2><ul>" + "".join(f"<li>{escape(note)}</li>" for note in report.notes) + "</ul>",
        "<h2>Held-out decisions: mean log-probability</h2>",
        "<p>Higher is better. <code>log</code> is the fitted law, <code>idm</code> the baseline with the same noise; "
        "<code>model</code> is the law blended into its safe response; <code>table</code> the shipped table.</p>",
        *(_score_table(name, row) for name, row in report.held_out_log_likelihood.items()),
        "<h2>Rows left out</h2>",
        _bad_rows(report),
        "<h2>Mean acceleration behind a leader, at 30 m/s [m/s²]</h2>",
        _response_table(model),
        "<h2>Free flow against the published facts</h2>",
        _free_table(model),
        "<h2>Provenance</h2>",
        _provenance(model),
    ]
    page = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Fit report</title>'
        f"<style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"The fit report cannot be written to {path} ({error.strerror}).") from error


def _table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    lines = ["<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows]
    return f"<table><tr>{cells}</tr>{''.join(lines)}</table>"


def _summary(report: FitReport) -> str:
    return _table(
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


def _score_table(name: str, row: Mapping[str, float]) -> str:
    cells = [[key, f"{value:.3f}" if isinstance(value, float) else f"{value:,}"] for key, value in row.items()]
    return f"<h3>{escape(name)}</h3>{_table(['law', 'per decision'], cells)}"


def _bad_rows(report: FitReport) -> str:
    rows = [
        [name, reason, f"{entry['rows']:,}", entry["first_line"]]
        for name, reasons in report.bad_rows.items()
        for reason, entry in reasons.items()
    ]
    return _table(["file", "reason", "rows", "first line"], rows) if rows else "<p>None.</p>"


def _response_table(model: NddModel) -> str:
    speed = int(np.flatnonzero(SPEEDS == 30.0)[0])
    mean = model.following[speed].astype(np.float64) @ ACCELERATIONS
    gaps = [10, 20, 30, 45, 60, 90, 115]
    rates = [-8, -4, -2, -1, 0, 1, 2, 4]
    rows = [
        [
            f"gap {gap} m",
            *(f"{mean[int(GAPS.searchsorted(gap)), int(RANGE_RATES.searchsorted(rate))]:.2f}" for rate in rates),
        ]
        for gap in gaps
    ]
    return _table(["range rate [m/s]", *(f"{rate}" for rate in rates)], rows)


def _free_table(model: NddModel) -> str:
    rows = []
    for speed, sd, share in _FREE_FACTS:
        p = model.free[int(SPEEDS.searchsorted(speed))].astype(np.float64)
        mean = float(p @ ACCELERATIONS)
        spread = float(np.sqrt(p @ (ACCELERATIONS - mean) ** 2))
        hard = float(p[ACCELERATIONS <= -0.99].sum())
        rows.append([f"{speed} m/s", f"{mean:.3f}", "0.02 to 0.05", f"{spread:.2f}", sd, f"{hard:.1%}", f"{share:.1%}"])
    head = ["speed", "mean", "published", "standard deviation", "published", "share ≤ -1 m/s²", "published"]
    return _table(head, rows)


def _provenance(model: NddModel) -> str:
    shown = {key: value for key, value in model.provenance.items() if not key.startswith("counted")}
    return f"<pre>{escape(json.dumps(shown, indent=1, sort_keys=True))}</pre>"
