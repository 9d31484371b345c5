"""The page of `ndd validate`: figures and tables from its result, nothing computed again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from cornerforge.report.drawing import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    Bad,
    check_matplotlib,
    inline,
    new_figure,
    page,
    png_of,
    table,
)
from cornerforge.results import NddValidated
from cornerforge.results.validation import FactFound, OneStepCell
from cornerforge.types import ACCELERATIONS

__all__ = ["allowed", "check_matplotlib", "figures_of", "interval", "number", "page_of", "published"]

_WINDOW_COLOURS = ("#8ecae6", "#4a9cc9", BLUE, "#e08a3c", ORANGE)
"""Early windows blue, late ones orange."""
_MARKS = "o^svD"
_LABELS = {
    "gap": "gap [m]",
    "time_gap": "time gap [s]",
    "range_rate": "range rate [m/s]",
    "acceleration_following": "acceleration, following [m/s²]",
    "acceleration_free": "acceleration, free flow [m/s²]",
    "accepted_lead_gap": "accepted gap ahead [m]",
    "accepted_rear_gap": "accepted gap behind [m]",
    "speed": "speed [m/s]",
}
_PUBLISHED = {
    "time_gap": ((0.05, 0.25, 0.50, 0.75, 0.95), (0.55, 0.80, 1.14, 1.78, 2.90)),
    "gap": ((0.05, 0.25, 0.50, 0.75, 0.95), (16.0, 24.0, 34.0, 54.0, 89.0)),
    "speed": ((0.05, 0.25, 0.50, 0.75, 0.95), (24.0, 28.0, 30.0, 33.0, 35.0)),
}
"""Published quantiles (IVBSS): gaps while following, speeds of all to 1 m/s."""
_RANGES = {"speed": (15.0, 45.0), "range_rate": (-6.0, 6.0), "time_gap": (0.0, 5.0), "gap": (0.0, 120.0)}


def figures_of(result: NddValidated) -> dict[str, bytes]:
    """The figures by file name without ending, as PNG."""
    found = {
        "facts": _facts_figure(result),
        "traffic": _traffic_figure(result),
        "log_likelihood": _likelihood_figure(result),
    }
    for number, name in enumerate(result.log_likelihood_per_decision, 1):
        compared = {
            quantity: files[name]
            for quantity, files in vars(result.distances).items()
            if quantity in _LABELS and name in files and files[name].recorded is not None
        }
        if compared:
            found[f"recorded_{number}"] = _recorded_figure(compared)
        if result.one_step_ahead.get(name):
            found[f"one_step_{number}"] = _one_step_figure(result.one_step_ahead[name])
    return found


def _facts_figure(result: NddValidated) -> bytes:
    """Every gated fact on one scale: 0 and 1 are the ends of the allowed range."""
    gated = [row for row in result.facts if row.theme == "drift" and row.allowed is not None]
    names = list(dict.fromkeys(row.fact for row in gated))
    whens = [part.when for part in result.traffic]
    drawing, (panel,) = new_figure(1, 1, 9.0, 0.45 * len(names) + 1.2)
    panel.axvspan(0.0, 1.0, color="#e5f2ec", zorder=0)
    for row in gated:
        if row.found is None or row.allowed is None:
            continue
        low, high = row.allowed
        side = whens.index(row.when)
        y = names.index(row.fact) + 0.15 * (side - 0.5 * (len(whens) - 1))
        found, *ends = [
            float(np.clip((v - low) / (high - low), -0.6, 1.6)) for v in (row.found, *(row.interval95 or ()))
        ]
        if ends:
            panel.plot(ends, [y, y], color=_WINDOW_COLOURS[side], linewidth=2)
        panel.plot([found], [y], _MARKS[side], color=_WINDOW_COLOURS[side], markersize=5, zorder=3)
    for side, when in enumerate(whens):
        panel.plot([], [], _MARKS[side], color=_WINDOW_COLOURS[side], label=when)
    panel.set_yticks(range(len(names)), names)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.set_xlim(-0.65, 1.65)
    panel.set_xticks([0.0, 0.5, 1.0], ["lowest allowed", "middle", "highest allowed"])
    panel.legend(fontsize=8, loc="upper right")
    return png_of(drawing)


def _traffic_figure(result: NddValidated) -> bytes:
    """Simulated traffic in all windows, with published quantiles where there are."""
    names = ("time_gap", "gap", "speed", "range_rate", "acceleration_following", "acceleration_free")
    drawing, panels = new_figure(2, 3, 11.0, 6.2)
    for panel, name in zip(panels, names, strict=True):
        for side, part in enumerate(result.traffic):
            curve = part.curves[name]
            x, share = _steps(curve.low, curve.width, curve.shares)
            panel.plot(x, share, color=_WINDOW_COLOURS[side], linestyle="--" if side > 2 else "-", label=part.when)
        if name in _PUBLISHED:
            share, value = _PUBLISHED[name]
            panel.plot(value, share, "D", color="black", markersize=5, label="published")
        panel.set_xlim(*_RANGES.get(name, (-2.1, 2.1)))
        panel.set_xlabel(_LABELS[name], fontsize=9)
        panel.set_ylabel("share below", fontsize=9)
    panels[0].legend(fontsize=8)
    return png_of(drawing)


def _steps(low: float, width: float, shares: Sequence[float]) -> tuple[Any, Any]:
    """A distribution function: upper edges of the bins, and the share below each."""
    return low + width * np.arange(1, len(shares) + 1), np.cumsum(shares)


def _likelihood_figure(result: NddValidated) -> bytes:
    """Model minus baseline, per file, part and baseline, with its interval."""
    rows = [
        (f"{name[:28]}, {part}", baseline, versus)
        for name, parts in result.log_likelihood_per_decision.items()
        for part, score in parts.items()
        for baseline, versus in score.model_minus.items()
        if baseline.startswith("idm")
    ]
    drawing, (panel,) = new_figure(1, 1, 9.0, 0.26 * len(rows) + 1.2)
    for y, (_, _, versus) in enumerate(rows):
        low, high = versus.interval95
        colour = GREEN if low > 0.0 else ORANGE
        panel.plot([low, high], [y, y], color=colour, linewidth=2)
        panel.plot([versus.difference], [y], "o" if low > 0.0 else "X", color=colour, markersize=7)
    panel.axvline(0.0, color=GREY, linewidth=1)
    panel.set_yticks(range(len(rows)), [f"{where}, against {baseline}" for where, baseline, _ in rows])
    panel.set_ylim(len(rows) - 0.5, -0.5)
    panel.set_xlabel("log-likelihood per decision, model minus baseline (right of 0: the model is better)", fontsize=9)
    return png_of(drawing)


def _recorded_figure(compared: Mapping[str, Any]) -> bytes:
    """Recorded and simulated distribution functions of one file."""
    columns = min(3, len(compared))
    lines = -(-len(compared) // columns)
    drawing, panels = new_figure(lines, columns, 3.7 * columns, 3.1 * lines)
    for panel, (name, row) in zip(panels, compared.items(), strict=False):
        for side, colour, style in (("recorded", "black", "-"), ("simulated", BLUE, "--")):
            x, share = _steps(row.low, row.width, getattr(row, side))
            panel.step(x, share, color=colour, linestyle=style, label=side)
        panel.set_xlim(*_RANGES.get(name, (x[0] - row.width, x[-1])))
        panel.set_xlabel(_LABELS[name], fontsize=9)
        panel.set_title(f"{row.decisions:,} observations, KS {row.kolmogorov_smirnov:.2f}", fontsize=9)
    panels[0].set_ylabel("share below", fontsize=9)
    panels[0].legend(fontsize=8)
    for panel in panels[len(compared) :]:
        panel.set_visible(False)
    return png_of(drawing)


def _one_step_figure(cells: Sequence[OneStepCell]) -> bytes:
    """Observed and predicted accelerations from the same states, cell by cell."""
    columns = min(4, len(cells))
    lines = -(-len(cells) // columns)
    drawing, panels = new_figure(lines, columns, 2.9 * columns, 2.5 * lines)
    x = ACCELERATIONS
    for panel, cell in zip(panels, cells, strict=False):
        panel.bar(x, cell.recorded, 0.18, color="#bbbbbb", label="recorded")
        panel.plot(x, cell.predicted, color=BLUE, linewidth=1.5, label="predicted")
        low, high = cell.speed_mps
        panel.set_title(f"{low:g}-{high:g} m/s, {cell.state} ({cell.decisions:,})", fontsize=8.5)
        panel.set_xlim(-4.2, 2.2)
    panels[0].legend(fontsize=7.5)
    for panel in panels[len(cells) :]:
        panel.set_visible(False)
    drawing.supxlabel("acceleration over the next second [m/s²]", fontsize=9)
    return png_of(drawing)


def page_of(result: NddValidated, figures: Mapping[str, bytes]) -> str:
    """One page that needs nothing else."""
    verdict = "passes" if result.passed else '<span class="bad">does not pass</span>'
    gated = [row for row in result.facts if row.within is not None]
    outside = [row for row in result.facts if row.within is False]
    parts = [
        f"<h1>Validation of the naturalistic model {escape(str(result.model_hash))}</h1>",
        f"<p>The model {verdict}: {len(outside)} of {len(gated)} checks are outside what is allowed; it must also "
        "be more likely than the IDM and than uniform guessing on every file, with the whole 95 % interval.</p>",
        _summary(result),
        "<ul>" + "".join(f"<li>{escape(note)}</li>" for note in result.notes) + "</ul>",
        "<h2>Free-running traffic against published facts</h2>",
        "<p>Traffic on 3000 m of three lanes, driven for 62 s; vehicles are counted far from its ends and from "
        "the AV, which drives behind all others. Intervals: jackknife over 20 blocks of worlds; of crashes: exact. The "
        "ranges allowed are ours.</p>",
    ]
    for name, theme in result.themes.items():
        rows = [row for row in result.facts if row.theme == name]
        if not rows:
            continue
        parts.append(f"<h3>{escape(theme.title)}</h3><p>{escape(theme.meaning)}</p>")
        if name != "drift":
            parts += [f'<div class="dense">{_checks_table(rows)}</div>', _sources(rows)]
            continue
        parts += [
            inline(
                figures["facts"],
                "Checks of the drift on one scale; the shaded band is allowed. Marks at the rim lie beyond it.",
            ),
            f'<div class="dense">{_drift_table(rows)}</div>',
            _sources(rows),
            inline(
                figures["traffic"], "Distribution functions of simulated traffic; diamonds are published quantiles."
            ),
        ]
    parts += [
        "<h2>Likelihood of held-out decisions</h2>",
        _WHAT_IS_SCORED,
        inline(figures["log_likelihood"], "Model minus IDM; lines are 95 % intervals by bootstrap over vehicles."),
        _likelihood_table(result),
    ]
    for number, name in enumerate(result.log_likelihood_per_decision, 1):
        parts += _file_parts(result, figures, number, name)
    return page("Validation of a naturalistic model", "".join(parts))


def _summary(result: NddValidated) -> str:
    """Say how many checks of each theme fail, and which quantities."""
    rows = []
    for name, theme in result.themes.items():
        gated = [row for row in result.facts if row.theme == name and row.within is not None]
        failing = list(dict.fromkeys(row.fact for row in gated if row.within is False))
        if gated:
            count = f"{sum(row.within is False for row in gated)} of {len(gated)} outside"
            marked = f'<span class="bad">{count}</span>: {escape("; ".join(failing))}' if failing else count
            rows.append(f"<li>{escape(theme.title)}: {marked}</li>")
    return f"<ul>{''.join(rows)}</ul>"


_UNBROKEN = {ord(" "): "\u00a0", ord("-"): "\u2011"}
"""Characters at which a browser may break a line -> characters at which it may not."""
_WHAT_IS_SCORED = (
    "<p><code>law</code> is the car-following law at every speed, <code>table</code> what the simulator looks up from "
    "19.5 m/s on, <code>law_on_grid</code> the law on the same decisions. Fitted to the decisions of these files that "
    "are not scored: <code>idm</code>, an IDM with Student-t noise of state-dependent spread; <code>idm_fast</code>, "
    "the same from its faster decisions alone; <code>raw_table</code>, counts without smoothing. <code>uniform</code> "
    "takes all 31 accelerations for equally likely.</p>"
)


def _with_unit(fact: str, unit: str) -> str:
    return f"{fact} [{unit}]" if unit and not unit.startswith("per ") else f"{fact} {unit}".rstrip()


def number(value: float | None) -> str:
    """Write a number; "none" for None."""
    return "none" if value is None else f"{value:.3g}"


def interval(row: FactFound) -> str:
    """Write the interval of a check; "" without one."""
    return "" if row.interval95 is None else f"{row.interval95[0]:.3g} to {row.interval95[1]:.3g}"


def allowed(row: FactFound) -> str:
    """Write the range allowed."""
    return "shown only" if row.allowed is None else f"{row.allowed[0]:.3g} to {row.allowed[1]:.3g}"


def published(row: FactFound) -> str:
    """Write the published value, or range; "" without one."""
    value = row.published
    if value is None:
        return ""
    return f"{value[0]:g}-{value[1]:g}" if isinstance(value, tuple) else f"{value:g}"


def _sources(facts: Sequence[FactFound]) -> str:
    """Name the sources of the published values: the most frequent one first, the others with their quantities."""
    by_source: dict[str, list[str]] = {}
    for row in facts:
        names = by_source.setdefault(row.source, [])
        if row.fact not in names:
            names.append(row.fact)
    first, *others = sorted(by_source, key=lambda source: -len(by_source[source]))
    told = [first, *(f"{source} ({', '.join(by_source[source])})" for source in others)]
    return f'<p class="sources">Published: {escape("; ".join(told))}.</p>'


def _drift_table(facts: Sequence[FactFound]) -> str:
    """One line for each quantity, with the value found in each window and its interval."""
    whens = list(dict.fromkeys(row.when for row in facts))
    rows = []
    for name in dict.fromkeys(row.fact for row in facts):
        same = [row for row in facts if row.fact == name]
        cells = [f"{number(row.found)}\n{interval(row).replace(' to ', '–').translate(_UNBROKEN)}" for row in same]
        marked = [Bad(cell) if row.within is False else cell for cell, row in zip(cells, same, strict=True)]
        one = same[0]
        rows.append(
            [
                _with_unit(name, one.unit), *marked, f"{min(row.n for row in same):,}", allowed(one),
                published(one),
            ]
        )  # fmt: skip
    head = ["quantity", *(when.translate(_UNBROKEN) for when in whens), "least n", "allowed", "published"]
    return table(head, rows)


def _checks_table(facts: Sequence[FactFound]) -> str:
    rows = [
        [
            _with_unit(row.fact, row.unit),
            row.when.translate(_UNBROKEN),
            Bad(number(row.found)) if row.within is False else number(row.found),
            interval(row),
            f"{row.n:,}",
            allowed(row),
            {None: "", True: "yes", False: Bad("NO")}[row.within],
            published(row),
        ]
        for row in facts
    ]
    head = ["quantity", "when", "found", "95 % interval", "n", "allowed", "within", "published"]
    return table(head, rows)


def _likelihood_table(result: NddValidated) -> str:
    rows = []
    for name, parts in result.log_likelihood_per_decision.items():
        for part, score in parts.items():
            rows.append(
                [f"{name}, {part}", f"{score.decisions:,}", score.vehicles, _with(score.model, score.interval95, "")]
            )
            rows += [
                [f"… minus {baseline}", "", "", _with(versus.difference, versus.interval95, "+")]
                for baseline, versus in score.model_minus.items()
            ]
    return table(["file, part", "decisions", "vehicles", "per decision (95 % interval)"], rows)


def _with(value: float, interval: tuple[float, float], sign: str) -> str:
    return f"{value:{sign}.3f} ({interval[0]:{sign}.3f} to {interval[1]:{sign}.3f})"


def _file_parts(result: NddValidated, figures: Mapping[str, bytes], number: int, name: str) -> list[str]:
    """Show one file: recorded against simulated traffic, and predictions one step ahead."""
    rows: list[list[object]] = []
    reasons: dict[str, list[str]] = {}
    for quantity, files in vars(result.distances).items():
        row = files.get(name)
        for reason in (getattr(row, "not_compared", None), getattr(row, "caution", None)):
            if reason is not None:
                reasons.setdefault(reason, []).append(quantity.replace("_", " "))
        if getattr(row, "wasserstein", None) is not None:
            low, high = row.wasserstein_interval95
            ks = "{:.3f} ({:.3f} to {:.3f})".format(row.kolmogorov_smirnov, *row.kolmogorov_smirnov_interval95)
            far = f"{row.wasserstein:.3g} {row.unit} ({low:.3g} to {high:.3g})"
            rows.append([quantity.replace("_", " "), f"{row.decisions:,}", row.vehicles, far, ks])
    parts = [f"<h2>{escape(name)}: recorded against simulated</h2>"]
    if rows:
        parts.append("<p>States from 19.5 m/s on; the simulated side is taken at the same speeds, class by class.</p>")
        parts.append(
            table(["quantity", "observations", "vehicles", "Wasserstein (95 %)", "Kolmogorov-Smirnov (95 %)"], rows)
        )
    if f"recorded_{number}" in figures:
        parts.append(inline(figures[f"recorded_{number}"], "Recorded and simulated distribution functions."))
    parts.append(_rates(result, name))
    told = [f"<li>{escape(', '.join(names))}: {escape(reason)}</li>" for reason, names in reasons.items()]
    parts.append(f"<ul>{''.join(told)}</ul>" if told else "")
    if f"one_step_{number}" in figures:
        parts.append("<h3>One step ahead: accelerations from the same states</h3>")
        parts.append(
            inline(figures[f"one_step_{number}"], "Bars: recorded; line: predicted by law (below 19.5 m/s) or table.")
        )
        parts.append(_one_step_table(result.one_step_ahead[name]))
    return parts


def _rates(result: NddValidated, name: str) -> str:
    """TTC shares, lane changes per mile and accepted gaps that the model calls impossible."""
    rows: list[list[object]] = []
    for limit, row in (result.distances.ttc_share_below[name].shares or {}).items():
        low, high = row.recorded_interval95
        rows.append([f"TTC below {limit} s", f"{row.recorded:.2g} ({low:.2g} to {high:.2g})", f"{row.simulated:.2g}"])
    rate = result.distances.lane_changes_per_mile[name]
    if rate.recorded is not None and rate.recorded_interval95 is not None:
        low, high = rate.recorded_interval95
        told = f"{rate.recorded:.2g} ({low:.2g} to {high:.2g})"
        rows.append(["lane changes per vehicle-mile, all speeds", told, f"{rate.simulated:.2g}"])
    for side, files in (("lead", result.distances.accepted_lead_gap), ("rear", result.distances.accepted_rear_gap)):
        gaps = files[name]
        if gaps.accepted_by_drivers:
            refused = f"{gaps.thereof_impossible_to_the_model} impossible to an attentive model driver"
            rows.append([f"accepted {side} gaps, any speed", gaps.accepted_by_drivers, refused])
    return table(["", "recorded (95 % interval)", "model"], rows) if rows else ""


def _one_step_table(cells: Sequence[OneStepCell]) -> str:
    rows = []
    for cell in cells:
        low, high = cell.wasserstein_interval95
        rows.append(
            [
                "{:g}-{:g} m/s, ".format(*cell.speed_mps) + cell.state,
                cell.by,
                f"{cell.decisions:,}",
                cell.vehicles,
                "{:+.2f}, {:.2f}".format(*cell.recorded_mean_sd),
                "{:+.2f}, {:.2f}".format(*cell.predicted_mean_sd),
                f"{cell.wasserstein:.3f} ({low:.3f} to {high:.3f})",
                f"{cell.kolmogorov_smirnov:.3f}",
            ]
        )
    head = ["state", "by", "decisions", "vehicles", "recorded mean, sd", "predicted", "Wasserstein [m/s²]", "KS"]
    return table(head, rows)
