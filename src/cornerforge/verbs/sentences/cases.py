"""Results on cases as text: `generate`, `shrink`, `replay`, `query`, `verify`, `migrate`."""

from __future__ import annotations

from cornerforge.results import Filled, Migrated, Queried, Replayed, ShrunkLibrary, Verified
from cornerforge.results.cases import CaseSize, MedianSize
from cornerforge.verbs.sentences.numbers import fault_text, rate_text

__all__ = [
    "generate_text", "is_damaged", "migrate_text", "query_text", "replay_differs", "replay_text", "shrink_text",
    "verify_text",
]  # fmt: skip


def generate_text(found: Filled) -> str:
    """Write how many cases there are, and how often tests became one."""
    return "\n".join([rate_text(found, f"{found.cases:,} cases in {found.library}"), *fault_text(found.av_faults)])


def shrink_text(r: ShrunkLibrary) -> str:
    """Tell the result in text: a line for each case and, if there are several, a line of medians."""
    lines = [f"Case {c.case}, {c.crash_type}: {_change(c.before, c.after)}" for c in r.cases]
    if len(lines) > 1:
        lines.append(f"Median of {len(lines)} cases: {_change(r.median.before, r.median.after)}")
    return "\n".join([*lines, f"Library: {r.library}"])


def _change(before: CaseSize | MedianSize, after: CaseSize | MedianSize) -> str:
    return (
        f"{before.vehicles:g} -> {after.vehicles:g} vehicles, {before.seconds:g} -> {after.seconds:g} s, "
        f"{before.deviating_actions:g} -> {after.deviating_actions:g} deviating actions"
    )


def replay_text(found: Replayed) -> str:
    """Write whether the case, or all, happened as stored, and which pictures were drawn."""
    verdict = {None: "driven again", True: "identical", False: "NOT identical"}[found.identical]
    if found.cases is not None:
        differ = f"; different: {', '.join(found.differ[:10])}" if found.differ else ""
        return f"{found.cases:,} cases: {verdict}{differ}"
    files = {"picture": found.picture, "film": found.video}
    drawn = "".join(f"; {what}: {file}" for what, file in files.items() if file is not None)
    return f"Case {found.case}: {verdict}; crash at {found.crash_time_s} s{drawn}"


def replay_differs(found: Replayed) -> str | None:
    """Say why a case may happen differently; None if none does, or none was compared."""
    return (found.note or "") if found.identical is False else None


def query_text(found: Queried) -> str:
    """Write the table with tabs."""
    return "\n".join("\t".join(map(str, row)) for row in [found.columns, *found.rows])


def verify_text(found: Verified) -> str:
    """Write a line for each damaged file, and the counts."""
    lines = [one.fault if one.file in one.fault else f"{one.file}: {one.fault}" for one in found.damaged]
    counts = f"{found.whole:,} whole, {len(found.damaged):,} damaged"
    if found.without_checksum:
        counts += f", {len(found.without_checksum):,} without a checksum (such as {found.without_checksum[0]})"
    return "\n".join([*lines, f"{counts}; {found.other:,} of other kinds, not read"])


def is_damaged(found: Verified) -> str | None:
    """Say that the command fails, which its text has told already; None if all files are whole."""
    return "" if found.damaged else None


def migrate_text(found: Migrated) -> str:
    """Write what was brought where."""
    return f"{found.cases:,} cases of version {found.made_by}: {found.library}"
