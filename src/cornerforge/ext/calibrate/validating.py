"""`ndd validate` compares a model with held-out trajectories, and its free-running traffic with published facts."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from cornerforge._files import write_bytes
from cornerforge._options import verb
from cornerforge.experiment.counting import distributions_of
from cornerforge.experiment.output import open_output, write_json, write_text
from cornerforge.experiment.setting import experiment
from cornerforge.ext.calibrate.facts import CRASH_LIMIT, CUT_IN_FACTS, compare_crashes, compare_with_facts
from cornerforge.ext.calibrate.free_running import (
    DRIFT_WINDOWS,
    WHOLE,
    FreeRunning,
    quantities_of,
    simulate_free_running,
    speeds_of,
    upper_rate,
)
from cornerforge.ext.calibrate.options import NddValidate
from cornerforge.ext.calibrate.persistence import compare_persistence
from cornerforge.ext.calibrate.stopping import compare_merges, compare_queues
from cornerforge.ext.calibrate.transitions import compare_transitions
from cornerforge.ext.calibrate.validation_page import (
    allowed,
    check_matplotlib,
    figures_of,
    interval,
    number,
    page_of,
    published,
)
from cornerforge.ndd.model import model_hash
from cornerforge.results import NddValidated, as_json, from_json
from cornerforge.results.validation import (
    AcceptedGaps,
    FactFound,
    LaneChangeRate,
    PartDistance,
    PartLikelihood,
    RecordedQuantity,
    RecordedTtc,
)
from cornerforge.sim import statistics

__all__ = ["did_not_pass", "ndd_validate", "validation_text"]

THEMES = {
    "drift": (
        "Drift",
        "Traffic must be at 60 s what it is at the start: otherwise rates depend on when a test happens to begin. "
        "Follows: gap of at most 115.5 m.",
    ),
    "crashes": (
        "Crashes between background vehicles",
        "Natural drivers hardly ever crash, and no more often in the first seconds of a test than later. The whole "
        "drive is judged by the upper end of its interval, a period of it by the lower end.",
    ),
    "cut-ins": (
        "Cut-ins",
        "At the moment when a vehicle at 25-35 m/s crosses the marking ahead of a faster one, at most 75 m behind: how "
        "near and how fast, and both at once? That decides which crashes the traffic can make.",
    ),
    "persistence": (
        "Memory of drivers",
        "A driver who is close now is close half a minute later, but not for ever; what a second's state does not "
        "explain goes on in the next.",
    ),
    "transitions": (
        "Lane changes that people made",
        "A lane change that was recorded must be no rarity for an attentive driver of the model two seconds before the "
        "crossing.",
    ),
    "queues": (
        "Traffic that stops",
        "In a queue vehicles must stand and crawl as near to each other as in the files.",
    ),
    "merging": (
        "Merging",
        "Drivers from a ramp must merge in time, and recorded merges must be no rarity. The law is stated, not fitted.",
    ),
}
"""Checks: name -> title, and their meaning in a sentence."""
VALIDATION = "validation.json"
_PAGE = "validation.html"
_CURVES = ("time_gap", "gap", "range_rate", "acceleration_following", "acceleration_free")


@verb(NddValidate)
def ndd_validate(options: NddValidate) -> NddValidated:
    """Compare a model with held-out trajectories and with published facts.

    Returns:
        What `cornerforge ndd validate --json` prints. `passed` means: more likely than the IDM and than
        uniform guessing on every file, with the whole 95 % interval, and every gated fact within its allowed range, in
        all windows.

    Raises:
        CornerForgeError: Input, files or output place are not right.
    """
    from cornerforge.ext.calibrate.compare import compare_decisions, compare_traffic
    from cornerforge.ext.calibrate.readers import read_decisions, reading_names
    from cornerforge.ext.calibrate.validate import validate_readings

    start = time.perf_counter()
    run = experiment(model=Path(options.model))
    options.progress("validate: reading", 0, 1)
    readings = read_decisions([Path(file) for file in options.against], options.data_format)
    folder = None if options.out is None else Path(options.out)
    if folder is not None:
        files = ",".join(sorted(reading.sha256[:16] for reading in readings))
        check_matplotlib()
        about = {"command": "ndd validate", "miles": options.miles, "files": files}
        open_output(folder, run.identity(options.seed) | about, resume=True)
    options.progress("validate: scoring", 0, 1)
    scores = validate_readings(run.model, readings)
    conditional = compare_decisions(run.model, readings)
    traffic = simulate_free_running(
        run, miles=options.miles, seed=options.seed, threads=options.threads, progress=options.progress
    )
    whole, parts = traffic.during(WHOLE), [traffic.during(window) for window in DRIFT_WINDOWS]
    options.progress("validate: comparing", 0, 1)

    def plain(parts: Mapping[str, PartLikelihood | PartDistance]) -> dict[str, Any]:
        return {name: asdict(part) for name, part in parts.items()}

    facts = [
        *(row for part in parts for row in compare_with_facts(part)),
        *compare_crashes(traffic),
        *compare_with_facts(whole, CUT_IN_FACTS),
        *compare_persistence(traffic.pairs),
        *compare_transitions(run, reading_names(readings), readings),
        *compare_queues(run, reading_names(readings), readings, seed=options.seed),
        *compare_merges(run, reading_names(readings), readings, seed=options.seed),
    ]
    changes = int(whole.total().totals[statistics.LANE_CHANGES]) / whole.miles
    content = {
        "model": str(options.model),
        "model_hash": model_hash(run.model),
        "log_likelihood_per_decision": {file: plain(parts) for file, parts in scores.files.items()},
        "idm": {name: asdict(idm) for name, idm in scores.idms.items()},
        "distances": {
            "acceleration": {file: plain(parts) for file, parts in scores.accelerations.items()},
            **compare_traffic(run.model, readings, quantities_of(whole), changes),
        },
        "one_step_ahead": conditional,
        "facts": [as_json(fact) for fact in facts],
        "traffic": [_traffic(part) for part in parts],
        "themes": {name: {"title": title, "meaning": meaning} for name, (title, meaning) in THEMES.items()},
        "notes": [*scores.notes, *_traffic_notes(whole, parts)],
        "passed": scores.passed and all(fact.within is not False for fact in facts),
        "seconds": round(time.perf_counter() - start, 3),
    }
    if folder is not None:
        content |= {"out": str(folder), "report": str(folder / _PAGE)}
    found = from_json(NddValidated, content)
    if folder is not None:
        write_json(folder / VALIDATION, content)
        figures = figures_of(found)
        for name, png in figures.items():
            write_bytes(folder / f"{name}.png", png)
        write_text(folder / _PAGE, page_of(found, figures))
    return found


def _traffic(part: FreeRunning) -> dict[str, Any]:
    """Describe one window: how much was counted, its distributions, and shares of bins for pictures."""
    from cornerforge.ext.calibrate.compare import shares_of

    quantities = quantities_of(part)
    curves = {
        name: {
            "low": q.low,
            "width": q.width,
            "unit": q.unit,
            "shares": shares_of(q.counts, max(int(q.counts.sum()), 1)),
        }
        for name, q in [*((name, quantities[name]) for name in _CURVES), ("speed", speeds_of(quantities))]
    }
    return {
        "when": part.window.name,
        "worlds": part.tests,
        "miles": part.miles,
        "vehicles_per_km": part.vehicles_per_km,
        "distributions": as_json(distributions_of(part.total())),
        "curves": curves,
    }


def _traffic_notes(whole: FreeRunning, parts: list[FreeRunning]) -> list[str]:
    """Return notes that a reader needs about the simulated traffic."""
    notes = [
        f"Free-running traffic: {whole.tests:,} worlds of {whole.window.until} s, {whole.miles:,.0f} vehicle-miles; "
        f"in the windows of the drift {', '.join(f'{part.miles:,.0f} ({part.window.name})' for part in parts)}."
    ]
    enough = upper_rate(0, CRASH_LIMIT)
    if whole.miles < enough:
        notes.append(
            f"With fewer than {enough:,.0f} vehicle-miles even no crash at all does not show that crashes between "
            f"background vehicles are below {CRASH_LIMIT:g} per mile."
        )
    early, late = parts[0].vehicles_per_km, parts[-1].vehicles_per_km
    if abs(late / max(early, 1e-9) - 1.0) > 0.05:
        notes.append(
            f"The counted stretch holds {late:.1f} vehicles per km at {parts[-1].window.name}, {early:.1f} before: its "
            "traffic thins out or is cut off, and the later figures are not those of free-running traffic."
        )
    return notes


def validation_text(result: NddValidated) -> str:
    """Make a table for people of the findings of `ndd_validate`."""
    lines = [*_likelihood_lines(result), *_fact_lines(result), *_distance_lines(result)]
    lines += [f"Note: {note}" for note in result.notes]
    if result.report is not None:
        lines.append(f"Report: {result.report}")
    return "\n".join([*lines, "Passed." if result.passed else "NOT passed."])


def _likelihood_lines(result: NddValidated) -> list[str]:
    from cornerforge.ext.calibrate.validate import GATED_PARTS, GATES

    lines = ["Log-likelihood per decision; model minus baseline with 95 % interval"]
    for name, parts in result.log_likelihood_per_decision.items():
        for part, score in parts.items():
            far = result.distances.acceleration[name][part]
            lines.append(
                f"{name}, {part}: {score.model:.3f} ({score.decisions:,} decisions, {score.vehicles:,} "
                f"vehicles); accelerations: Wasserstein {far.wasserstein:.3f} m/s2, "
                f"Kolmogorov-Smirnov {far.kolmogorov_smirnov:.3f}"
            )
            for baseline, versus in score.model_minus.items():
                low, high = versus.interval95
                value = score.baselines[baseline]
                worse = "  NOT BETTER" if part in GATED_PARTS and baseline in GATES and low <= 0.0 else ""
                numbers = f"{value:>8.3f}{versus.difference:>+9.3f}  ({low:+.3f} to {high:+.3f})"
                lines.append(f"  {baseline:<10}{numbers}{worse}")
    return lines


def _fact_lines(result: NddValidated) -> list[str]:
    lines = []
    for name, theme in result.themes.items():
        facts = [fact for fact in result.facts if fact.theme == name]
        if not facts:
            continue
        lines.append(f"{theme.title}. {theme.meaning}")
        lines += _window_lines(facts) if name == "drift" else [_fact_line(fact) for fact in facts]
    return lines


def _window_lines(facts: Sequence[FactFound]) -> list[str]:
    """One line for each quantity, with the value found in each window."""
    whens = list(dict.fromkeys(fact.when for fact in facts))
    head = f"  {'found at (! outside what is allowed)':<58}" + "".join(f"{when:>11}" for when in whens)
    lines = [f"{head}  {'least n':>9}  {'allowed':<20}published"]
    for name in dict.fromkeys(fact.fact for fact in facts):
        same = [fact for fact in facts if fact.fact == name]
        cells = "".join(f"{number(fact.found) + '!' * (fact.within is False):>11}" for fact in same)
        one, n = same[0], min(fact.n for fact in same)
        lines.append(
            f"  {f'{name} {one.unit}':<58}{cells}  {n:>9,}  {allowed(one):<20}{(published(one) or '-')}".rstrip()
        )
    return lines


def _fact_line(fact: FactFound) -> str:
    ends = f"({interval(fact)})" if fact.interval95 else ""
    verdict = "  OUTSIDE" if fact.within is False else ""
    return (
        f"  {f'{fact.fact} {fact.unit}':<68}{fact.when:<9}{number(fact.found):>9} {ends:<24}n {fact.n:<9,}"
        f"{allowed(fact):<20}{published(fact) or '-'}".rstrip()
        + verdict
    )


def _distance_lines(result: NddValidated) -> list[str]:
    """Recorded against simulated traffic at the same speeds, from 19.5 m/s on; why not, where not."""
    lines = ["Recorded against simulated traffic at the same speeds, from 19.5 m/s on"]
    for name in result.log_likelihood_per_decision:
        reasons: dict[str, list[str]] = {}
        for one in fields(result.distances):
            if one.name == "acceleration":
                continue
            row = getattr(result.distances, one.name)[name]
            for reason in (row.not_compared, getattr(row, "caution", None)):
                if reason is not None:
                    reasons.setdefault(reason, []).append(one.name)
            if row.not_compared is None:
                lines.append(f"  {name}, {one.name}: {_distance_text(row)}")
        lines += [f"  {name}, {', '.join(quantities)}: {reason}" for reason, quantities in reasons.items()]
    return lines


def _distance_text(row: RecordedQuantity | AcceptedGaps | RecordedTtc | LaneChangeRate) -> str:
    """Comparison of a row; the row must be of a quantity that was compared."""
    if isinstance(row, LaneChangeRate):
        return f"{row.recorded:.3g} ({row.simulated:.3g} simulated)"
    if isinstance(row, RecordedTtc):
        return "recorded (simulated) " + "; ".join(
            f"{limit} s {share.recorded:.3g} ({share.simulated:.3g})" for limit, share in (row.shares or {}).items()
        )
    low, high = row.wasserstein_interval95 or (0.0, 0.0)
    return (
        f"Wasserstein {row.wasserstein:.3g} {row.unit} ({low:.3g} to {high:.3g}), Kolmogorov-Smirnov "
        f"{row.kolmogorov_smirnov:.3f} ({row.decisions:,} observations, {row.vehicles:,} vehicles)"
    )


def did_not_pass(found: NddValidated) -> str | None:
    """Say that the command fails, which its text has told already; None if the model passed."""
    return None if found.passed else ""
