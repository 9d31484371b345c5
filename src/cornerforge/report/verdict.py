"""Verdicts on a single case: fault, what reference drivers would have prevented, how long there was a way out."""

from __future__ import annotations

from cornerforge.analysis.conduct import CONDUCTS, NO_CONDUCT
from cornerforge.report.judged import CaseJudgement

__all__ = ["verdict"]


def verdict(known: CaseJudgement) -> str:
    """Say which vehicle was at fault in a case, and whether the AV could have avoided it."""
    if known.fault == "none":
        fault = "No rule of RSS was broken"
    else:
        who = {"av": "The AV", "bv": "The BV"}.get(known.fault, "Both")
        when = "" if known.fault_s is None else f", {known.fault_s:.1f} s before contact"
        fault = f"{who} broke a rule of RSS ({known.rule}{when})"
    fault += f".{_conduct_in_words(known)}{_prevented_in_words(known)}"
    if known.avoidability is None:
        return fault
    begun = "" if known.manoeuvre_s is None else f" The manoeuvre began {known.manoeuvre_s:.1f} s before contact."
    return f"{fault}{begun} {_way_in_words(known)}"


def _conduct_in_words(known: CaseJudgement) -> str:
    """Say what the AV did wrong in a case; "" where it did nothing wrong."""
    if known.conduct == NO_CONDUCT:
        return ""
    return f" The AV's own doing, from {known.conduct_s:.1f} s before contact: {CONDUCTS[known.conduct]}."


def _prevented_in_words(known: CaseJudgement) -> str:
    """Say which reference drivers would have prevented a case; "" where it was not judged."""
    if known.prevented_by is None:
        return ""
    if known.held_speed_prevents:
        return " To hold the speed would have been enough to prevent it."
    if known.prevented_by == "nobody":
        return " No reference driver would have prevented it."
    return f" In the AV's place it would have been prevented, by braking, by {known.prevented_by}."


_HOW = {"by both": "by braking or by steering", "by combination": "by braking and steering together"}


def _way_in_words(known: CaseJudgement) -> str:
    """Say until when the AV could have avoided a case that was searched for a way out."""
    last = "" if known.latest_s is None else f"{known.latest_s:.1f} s before contact"
    if known.avoidability == "undecided":
        return "No way out of the AV was found, but not all could be tried."
    if known.avoidability == "unavoidable":
        if known.latest_s is None:
            return "Unavoidable: the AV had no way out in the time looked at."
        foreseen = known.manoeuvre_s is not None and known.latest_s > known.manoeuvre_s
        when = "before the manoeuvre, so that it had to foresee it" if foreseen else "within its reaction time"
        return f"Unavoidable: the AV's last way out began {last}, {when}."
    how = _HOW.get(str(known.avoidability), known.avoidability)
    return f"The AV could have avoided the crash {how}" + (f"; its last way out began {last}." if last else ".")
