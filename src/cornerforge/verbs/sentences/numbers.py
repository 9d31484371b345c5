"""Rates, yields, speeds and faults as text; several verbs share them."""

from __future__ import annotations

from cornerforge.foreign.av_log import latest_log
from cornerforge.results import Filled, NaturalRate
from cornerforge.results.rates import Rate, Yield

__all__ = ["ABANDONED", "fault_text", "paid_text", "rate_text", "short", "yield_text"]


ABANDONED = "training tests abandoned"
"""What is done with tests of a training that the AV spoils."""


def rate_text(r: Rate | Filled, what: str) -> str:
    """A rate with its interval and its tests (or trees of them), per test and, where it is known, per mile."""
    low, high = r.interval95
    unit = {"splitting": "trees of tests", "is": "weighted tests"}
    method = r.method if isinstance(r, NaturalRate) else ""
    tests = f"{r.tests:,} {unit.get(method, 'tests')}"
    line = f"{what}: {r.crashes_per_test:.4g} crashes per test (95 % interval {low:.3g} to {high:.3g}, {tests})"
    if isinstance(r, Rate) and r.crashes_per_mile is not None:
        line += f", {r.crashes_per_mile:.4g} per mile" + ("" if method in unit else f" ({r.miles:,.0f} miles)")
    return line


def paid_text(r: Yield, reward: str | None) -> str:
    """Write how many crashes a reward pays for that is judged by cases, after a yield; "" under any other."""
    if r.paid_per_test is None or r.paid_interval95 is None or r.strictly_paid_per_test is None:
        return ""
    low, high = r.paid_interval95
    stricter = {"own-fault": "AV alone at fault", "own-doing": "a reference driver prevents it"}
    strictly = stricter.get(str(reward), "by braking")
    return f"; {reward}: {r.paid_per_test:.4g} ({low:.3g} to {high:.3g}; {strictly} {r.strictly_paid_per_test:.4g})"


def yield_text(r: Yield, what: str, reward: str) -> str:
    """Write an adversary's yield, how much of it braking would have avoided, and in how many crashes the AV struck."""
    line = rate_text(r, what)
    if r.avoidable_per_test is not None and r.avoidable_interval95 is not None:
        low, high = r.avoidable_interval95
        line += f", {r.avoidable_per_test:.4g} avoidable by braking ({low:.3g} to {high:.3g})"
    line += paid_text(r, reward)
    share = r.striking_share
    return line if share is None else f"{line}; the AV strikes in {100.0 * share:.1f} %"


def fault_text(av_faults: int, what: str = "tests left out") -> list[str]:
    """A line on tests that the AV spoiled, and what was done with them, if it did."""
    if av_faults == 0:
        return []
    path = latest_log()
    log = "" if path is None else f"; what it printed, and its tracebacks: {path}"
    return [f"{av_faults:,} {what}, because the AV raised, hung or gave no usable answer in them{log}."]


def short(value: float) -> str:
    """A number in three digits, a power of ten without its plus and zero."""
    return f"{value:.3g}".replace("e+0", "e").replace("e+", "e")
