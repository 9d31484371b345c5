"""The result of `rate` as text."""

from __future__ import annotations

from cornerforge.analysis.mechanism import MECHANISMS
from cornerforge.analysis.site_case import KINDS_AT_SITES
from cornerforge.intervals import binomial_interval
from cornerforge.rates.plain import ASKED
from cornerforge.rates.weighted import LEAST_EFFECTIVE, LEAST_TREES
from cornerforge.results import NaturalRate
from cornerforge.verbs.sentences.numbers import fault_text, rate_text, short

__all__ = ["doubt_text", "miles_text", "model_text", "rate_lines", "rated_text"]

_STOPPED = {"target": "the interval is narrow enough", "max_tests": "all tests are done"}


def rated_text(found: NaturalRate) -> str:
    """Write the rate and all lines below it."""
    lines = [rate_text(found, f"{found.av}, natural traffic"), *fault_text(found.av_faults), *rate_lines(found)]
    return "\n".join(lines)


def rate_lines(found: NaturalRate) -> list[str]:
    """Write the lines below the rate: miles, precision, what more would take, BV-BV crashes, kinds of crash, cost."""
    lines = [
        *miles_text(found),
        *model_text(found),
        _precision_line(found),
        *_need_line(found, found.target_rhw),
        _bv_line(found),
    ]
    if found.mechanism_rates:
        lines += _kind_lines(found)
    seen = found.crash_circumstances
    if found.av_crashes and seen is not None:
        lines.append(
            f"{seen.at_start:,} within 4 s of the start; in {seen.rare_action:,} the partner did within 5 s what "
            f"an attentive driver does with a chance below 1e-3; in {seen.overlooked:,} it overlooked a neighbour, in "
            f"{seen.looked_away:,} it looked away"
        )
    return [*lines, *_cost_lines(found)]


def doubt_text(found: NaturalRate, command: str = "") -> str | None:
    """Say in one line why a rate cannot be trusted yet, and what would help; None if it can be.

    Args:
        found: The rate.
        command: With which to go on, up to `--max-tests`.
    """
    if not found.doubts:
        return None
    plain, taught = found.effort.plain.tests, found.effort.teaching.tests
    times = min(20.0, max(2.0, 1.5 * LEAST_EFFECTIVE / max(1, found.effective_sample_size)))
    more = plain + taught + max(LEAST_TREES, found.effort.estimation.tests * times)
    rounded = int(float(f"{more:.1e}"))
    return (
        f"Not to be trusted yet: {'; '.join(found.doubts)}. More {_units(found)} help: {command}--max-tests {rounded}"
    )


def miles_text(found: NaturalRate) -> list[str]:
    """Say how far the AV drives between two crashes, at a site how often it crashes when it enters, in one line.

    None if it drove no mile on a road.
    """
    if found.crashes_per_million_entering is not None and found.interval95_per_million_entering is not None:
        return [_entering_line(found.crashes_per_million_entering, found.interval95_per_million_entering, found)]
    if found.interval95_per_mile is None:
        return []
    low, high = found.interval95_per_mile
    if not found.crashes_per_mile:
        return [f"No touch; at most once in {short(1.0 / high)} miles (95 %)"]
    most = short(1.0 / low) if low > 0.0 else "no bound"
    return [f"A touch once in {short(1.0 / found.crashes_per_mile)} miles ({short(1.0 / high)} to {most})"]


def _entering_line(rate: float, interval: tuple[float, float], found: NaturalRate) -> str:
    low, high = interval
    line = (
        f"{rate:.3g} crashes per million vehicles that enter the site ({low:.3g} to {high:.3g}); a test is a crossing"
    )
    if found.crashes_per_vehicle_km is None or found.interval95_per_vehicle_km is None:
        return line
    low, high = found.interval95_per_vehicle_km
    return f"{line}; {found.crashes_per_vehicle_km:.3g} per vehicle-km ({low:.3g} to {high:.3g})"


def model_text(found: NaturalRate) -> list[str]:
    """Say how uncertain the naturalistic model makes the rate, or that this is left out; nothing without a crash."""
    if not found.crashes_per_test or found.state == "no crash":
        return []
    model = found.model_uncertainty
    if model is None:
        return [
            "This interval is of sampling alone; it leaves out the model's own uncertainty (--model-draws 30 adds it)."
        ]
    low, high = model.interval95
    if model.interval95_per_mile is None:
        wide = f"{low:.3g} to {high:.3g} per test"
    else:
        low, high = model.interval95_per_mile
        wide = f"once in {short(1.0 / high)} to {short(1.0 / low) if low > 0.0 else 'no bound'} miles"
    least, most = model.cv_interval95
    unit = "tests" if found.method == "mc" else "trees"
    apart = (
        f"their rates scatter by {100.0 * model.cv:.0f} % of the mean (95 % interval {100.0 * least:.0f} to "
        f"{100.0 * most:.0f} %)"
    )
    if model.cv == 0.0:
        apart = f"no difference is seen (up to {100.0 * most:.0f} % of the mean are possible, and taken in)"
    doubts = f"; read with care: {'; '.join(model.doubts)}" if model.doubts else ""
    return [
        f"With the model's own uncertainty: {wide} (95 %). {model.draws} drawn models ({model.effective_draws:.1f} "
        f"effective: BVs must crash as people do), {model.tests_each:,} {unit} each: {apart}{doubts}."
    ]


def _precision_line(found: NaturalRate) -> str:
    width = found.relative_half_width
    narrow = "no crash yet" if width is None else f"relative half-width {width:.2f}"
    stopped = _STOPPED.get(found.state, found.state)
    if found.method == "mc":
        why = "" if found.reason == ASKED else f" Counted: {found.reason.rstrip('.')}."
        return f"{found.av_crashes:,} AV crashes, {narrow}; {stopped}.{why}"
    how, why = ("trees of tests", "Trees") if found.method == "splitting" else ("weighted tests", "Importance sampling")
    return (
        f"{found.tests:,} {how}, {found.effective_sample_size:,} effective, {narrow}; {stopped}. {why}: {found.reason}."
    )


def _need_line(found: NaturalRate, target: float | None) -> list[str]:
    """Say how many tests a half-width needs that `--max-tests` was too few for; nothing if no crash tells."""
    width = found.relative_half_width
    if target is None or width is None or width <= target or found.doubts:
        return []
    before = 0 if found.method == "mc" else found.effort.plain.tests + found.effort.teaching.tests
    needed = before + found.tests * (width / target) ** 2
    return [f"A half-width of {target:g} needs about --max-tests {float(f'{needed:.1e}'):.0f}"]


def _units(found: NaturalRate) -> str:
    return "tests" if found.method == "is" else "trees"


def _kind_lines(found: NaturalRate) -> list[str]:
    """Write crash types and mechanisms, the most frequent first."""
    types = ", ".join(f"{name} {kind.crashes:,}" for name, kind in found.crash_type_rates.items())
    lines, at_site = [f"Crash types: {types}", "Mechanisms:"], found.crashes_per_million_entering is not None
    for name, kind in sorted(found.mechanism_rates.items(), key=lambda item: -item[1].crashes_per_test):
        share = 100.0 * kind.crashes_per_test / found.crashes_per_test
        per, low, high = (1e6 * rate for rate in (kind.crashes_per_test, *kind.interval95))
        entering = f"; {per:.3g} per million entering ({low:.2g} to {high:.2g})" if at_site else ""
        lines.append(f"{kind.crashes:>8,} {share:5.1f} %  {(MECHANISMS | KINDS_AT_SITES)[name]} [{name}]{entering}")
    unseen = "], [".join(name for name in found.mechanisms if name not in found.mechanism_rates)
    if at_site and unseen and found.method == "mc":
        most = 1e6 * binomial_interval(0, found.tests)[1]
        lines.append(f"    none [{unseen}]: each at most {most:.2g} per million entering")
    return lines


def _cost_lines(found: NaturalRate) -> list[str]:
    lines = []
    if found.method != "mc":
        parts, of_estimate = found.effort, f"{found.effort.estimation.tests:,} {_units(found)}"
        lines.append(
            f"CPU: {parts.plain.cpu_seconds:,.0f} s for {parts.plain.tests:,} plain tests, "
            f"{parts.teaching.cpu_seconds:,.0f} s to learn from {parts.teaching.tests:,} trees, "
            f"{parts.estimation.cpu_seconds:,.0f} s for {of_estimate} of the estimate; counting "
            f"would take {found.acceleration:,.3g} times as long"
        )
    hours = found.cpu_seconds / 3600.0
    return [*lines, f"{found.seconds:,.0f} s, {hours:.3g} core-hours; digest {found.digest[:16]}"]


def _bv_line(found: NaturalRate) -> str:
    text = f"{found.bv_crashes:,} crashes between BVs"
    if found.bv_crashes_per_bv_mile is None or found.interval95_bv_crashes_per_bv_mile is None:
        return text
    low, high = found.interval95_bv_crashes_per_bv_mile
    estimate = found.bv_miles_estimate
    error = estimate.relative_error
    exact = "" if error is None else f", good to {100.0 * error:.1f} %"
    return (
        f"{text}: {found.bv_crashes_per_bv_mile:.3g} per BV-mile (95 % interval {low:.2g} to {high:.2g}; "
        f"{found.bv_miles:,.0f} BV-miles, from {estimate.tests:,} counted tests{exact})"
    )
