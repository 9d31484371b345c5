"""The result of `retest` as text."""

from __future__ import annotations

from collections.abc import Sequence

from cornerforge.results.retest import Retested, RetestedCase
from cornerforge.verbs.retest import FIXED, NEVER, NEW

__all__ = ["got_worse", "retest_text"]

_LISTED = 10
"""Cases that the text names, at most."""


def got_worse(found: Retested) -> str | None:
    """Say that the command fails, which its text has told already; None if the AV did not get worse."""
    return "" if found.got_worse else None


def retest_text(r: Retested) -> str:
    """Tell the result in text."""
    lines = [f"{r.av} in the {r.cases:,} cases of {r.baseline} ({r.library}):"]
    for what, part in (("others as recorded", r.recorded), ("others who react", r.reacting), ("natural", r.natural)):
        if part is None:
            continue
        told = f"  {what}, {part.tests:,} {'cases' if part is r.recorded else 'tests'}: "
        if part.rounded:
            told += f"of the same AV {part.rounded:,} do not come again: rounding of scripts, ADR 40"
        elif r.same_av and part.fixed == part.new_crashes == 0:
            told += "the same AV, identical"
        else:
            told += (
                f"{part.baseline_crashes:,} crashes before, {part.av_crashes:,} now; fixed {part.fixed:,}, still "
                f"crashing {part.still_crashing:,}, new {part.new_crashes:,}"
            )
        if part.left_out:
            told += f"; left out {part.left_out:,} in which an AV failed"
        if not r.same_av and part.rate_difference is not None and part.interval95 is not None and part.verdict:
            low, high = part.interval95
            told += f"; difference {part.rate_difference:+.4g} per test ({low:+.4g} to {high:+.4g}); "
            told += _WORDS[part.verdict]
        lines.append(told)
    if r.note is not None and not r.same_av:
        lines.append(f"  {r.note}")
    lines += _named(r)
    alike = f"{r.av} is the AV that made these cases: nothing is compared, only driven again."
    unsure = alike if r.same_av else "It did not get worse, as far as these tests can tell."
    lines.append("It got WORSE." if r.got_worse else unsure)
    return "\n".join(lines)


def _named(r: Retested) -> list[str]:
    """Name the cases that matter: new crashes, failures of the AV, and crashes that do not count."""
    fresh = [one for one in r.each if NEW in (one.recorded, one.reacting)]
    lines = _listed("New crashes", fresh)
    if struck := sum(one.striker == "bv" for one in fresh):
        lines.append(f"  In {struck:,} of {len(fresh):,} another vehicle strikes the AV; --count av leaves such out.")
    lines += _listed("The AV failed", [one for one in r.each if one.failure is not None])
    gone = [one for one in r.each if one.striker is not None and one.recorded in (FIXED, NEVER)]
    return lines + _listed("Not counted, as another vehicle strikes the AV", gone)


def _listed(what: str, cases: Sequence[RetestedCase]) -> list[str]:
    """List the first ten of some cases, with what happened in them where that is known."""
    if not cases:
        return []
    more = ", ..." if len(cases) > _LISTED else ""
    if all(one.words is None and one.failure is None for one in cases):
        return [f"  {what} in cases: {', '.join(one.case for one in cases[:_LISTED])}{more}"]
    told = [f"    {one.case}: {one.failure or one.words}" for one in cases[:_LISTED]]
    return [f"  {what} in {len(cases):,} case{'s' if len(cases) > 1 else ''}:", *told, *(["    ..."] if more else [])]


_WORDS = {
    "worse": "it crashes more often",
    "better": "it crashes less often",
    "alike": "alike, within a factor of two",
    "open": "too few tests differ to tell",
}
