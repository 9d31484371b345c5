"""The result of `analyse` as text."""

from __future__ import annotations

from collections.abc import Sequence

from cornerforge.analysis.flaw import headline
from cornerforge.results import Analysed
from cornerforge.results.analysis import Judges, NaturalKind, ShareAtReaction
from cornerforge.verbs.sentences.numbers import short

__all__ = ["analyse_text", "judgement_text", "natural_text", "wrong_text"]


def analyse_text(found: Analysed) -> str:
    """Write what was found: sizes, types, rates, clusters, rare cases, judgements."""
    share = 100.0 * sum(found.explained_variance)
    lines = [
        *wrong_text(None, found),
        f"{found.cases:,} cases, {len(found.features)} features, {share:.0f} % of variance in two components; "
        f"majority {found.majority:,}, minority {found.minority:,}",
        "Crash types: " + ", ".join(f"{name} {n:,}" for name, n in found.crash_types.items()),
        *natural_text(found),
        *(f"Cluster {c.id} ({c.group}, {c.size:,} cases): typical {', '.join(c.typical)}" for c in found.clusters),
        "Rare: " + (", ".join(found.rare) or "none"),
        *judgement_text(found),
    ]
    return "\n".join(lines if found.note is None else [*lines, found.note])


def natural_text(r: Analysed) -> list[str]:
    """How often natural cases happen, kind by kind; nothing for cases of an adversary."""
    if r.natural is None:
        return []
    found = r.natural
    lines = [f"In natural traffic a touch {_miles(found.all)}; from {found.effective_cases:,.0f} effective cases:"]
    for what, kinds in (("cluster", found.clusters), ("type", found.crash_types), ("mechanism", found.mechanisms)):
        lines += [
            f"  {100.0 * kind.share:5.1f} %  {what} {name}: {_miles(kind)}, {kind.cases:,} cases"
            for name, kind in kinds.items()
        ]
    if found.avoidable is not None:
        after = f"{found.avoidable_after_s or 0.0:g} s after the manoeuvre began"
        lines.append(
            f"  {100.0 * found.avoidable.share:5.1f} %  avoidable by the AV, {after}: {_miles(found.avoidable)}"
        )
    lines.append(f"  A serious injury in the AV (MAIS 3 or more) {_miles(found.serious_injuries)}")
    return lines


def _miles(kind: NaturalKind) -> str:
    low, high = kind.interval95_miles
    return f"once in {short(kind.miles_between)} miles ({short(low)} to {short(high)})"


def wrong_text(natural: Analysed | None, adversary: Analysed | None) -> list[str]:
    """Say what the AV does wrong, by natural cases and by those of an adversary; "" where no judge looked."""
    told = [None if one is None else one.own_doing for one in (natural, adversary)]
    if told == [None, None]:
        return []
    return [headline(*told)]


def judgement_text(r: Analysed) -> list[str]:
    """Fault, avoidability, coverage and the most valuable cases of an analysis."""
    lines = ["At fault (RSS): " + ", ".join(f"{who} {n:,}" for who, n in r.fault.items())]
    if r.prevented is not None:
        told = r.prevented
        shares = ", ".join(f"{name} {one.cases:,} ({one.by_braking:,})" for name, one in told.by.items())
        if told.careful is not None:
            low, high = told.careful.interval95
            lines.append(
                f"A careful driver would have prevented {100.0 * told.careful.share:.1f} % (95 % interval "
                f"{100.0 * low:.1f} to {100.0 * high:.1f} %): {told.careful.by_braking:,} of {told.cases:,} cases by "
                f"braking, {told.careful.cases - told.careful.by_braking:,} by leaving out what the AV began"
            )
        lines.append(
            f"Of {told.cases:,} cases reference drivers in the AV's place would have prevented (by braking): {shares}; "
            f"holding the speed is enough in {told.held:,}"
        )
    if r.judges is not None:
        lines += _judges_text(r.judges)
    if r.avoidability is not None:
        seen = r.avoidability
        labels = ", ".join(f"{label} {n:,}" for label, n in seen.labels.items() if n)
        lines.append(
            f"Ways out of {seen.cases:,} cases, {seen.reaction_s:g} s after the manoeuvre began or later: {labels}"
        )
    cover = r.coverage
    low, high = cover.unseen_kind_interval95
    lines.append(
        f"Kinds: {len(cover.cells)} seen, {len(cover.empty)} cells empty; chance that the next case is of a new "
        f"kind {cover.unseen_kind_chance:.2g} (95 % interval {low:.2g} to {high:.2g})"
    )
    if r.value.top:
        which = "what shows a flaw, then what happens most; " if r.purpose == "road" else ""
        lines.append(f"Worth a look first ({which}value: case: what happened):")
        lines += [f"  {one.value:.2f}: {one.case_id}: {one.text}" for one in r.value.top]
    return lines


def _judges_text(found: Judges) -> list[str]:
    """Write the share of avoidable crashes, first with a time to react, then by reaction time, and what judges say."""

    def shares(each: Sequence[ShareAtReaction]) -> str:
        return ", ".join(f"{one.reaction_s:g} s {100.0 * one.share:.1f}" for one in each)

    low, high = found.lead.interval95
    names = list(found.agreement)
    table = [
        f"  {row} {name:<22}"
        + "".join(
            f"{100.0 * (found.both[a][a] / found.cases if a == name else found.agreement[name][a]):6.1f}" for a in names
        )
        for row, name in enumerate(names, 1)
    ]
    return [
        f"Avoidable: {100.0 * found.lead.share:.1f} % (95 % interval {100.0 * low:.1f} to {100.0 * high:.1f} %, "
        f"{found.cases:,} cases) by an AV that reacts {found.lead.reaction_s:g} s after the manoeuvre began",
        f"  by its reaction time [%]: {shares(found.avoidable)}",
        *(f"  {name} prevents, by its own [%]: {shares(each)}" for name, each in found.prevented.items()),
        "Judges: cases that each calls preventable (diagonal), and of which two say the same [%]",
        "    " + " " * 22 + "".join(f"{number:6d}" for number in range(1, len(names) + 1)),
        *table,
    ]
