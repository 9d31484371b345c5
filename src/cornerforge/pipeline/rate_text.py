"""The result of `rate` as text."""

from __future__ import annotations

from cornerforge.analysis.mechanism import MECHANISMS
from cornerforge.results import NaturalRate

__all__ = ["rate_text"]

_STOPPED = {"target": "the interval is narrow enough", "max_tests": "all tests are done"}


def rate_text(found: NaturalRate) -> list[str]:
    """Write the lines below the rate: precision, BV-BV crashes, crash types, the table of mechanisms, cost."""
    width, crashes = found.relative_half_width, found.av_crashes
    narrow = "no crash yet" if width is None else f"relative half-width {width:.2f}"
    lines = [f"{crashes:,} AV crashes, {narrow}; {_STOPPED.get(found.state, found.state)}"]
    lines.append(_bv_line(found))
    if crashes:
        kinds = ", ".join(f"{name} {n:,}" for name, n in found.crash_types.items() if n)
        lines += [f"Crash types: {kinds}", "Mechanisms:"]
        common = sorted(found.mechanisms.items(), key=lambda item: -item[1])
        lines += [f"{n:>8,} {100.0 * n / crashes:5.1f} %  {MECHANISMS[name]} [{name}]" for name, n in common if n]
        seen = found.crash_circumstances
        lines.append(
            f"{seen.at_start:,} within 4 s of the start; in {seen.rare_action:,} the partner did within 5 s what "
            f"an attentive driver does with a chance below 1e-3; in {seen.overlooked:,} it overlooked a neighbour, in "
            f"{seen.looked_away:,} it looked away"
        )
    hours = found.cpu_seconds / 3600.0
    lines.append(f"{found.seconds:,.0f} s, {hours:.3g} core-hours; digest {found.digest[:16]}")
    return lines


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
