"""Figure 5: kinds of crashes of two AVs."""

from __future__ import annotations

from typing import Any

from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.ext.paper.bench import BOUNDED, FREE, Bench, pooled
from cornerforge.ext.paper.item import Finding, Item, Row
from cornerforge.intervals import binomial_interval

__all__ = ["FIGURE5"]

_SURROGATE = "idm-mobil"
_SECOND = "rl"


def compute(bench: Bench) -> Finding:
    """Types of the crashes that the adversary of the surrogate makes, unbounded and bounded, of each AV."""
    groups, rows = [], []
    for adversary in (FREE, BOUNDED):
        for av in (name for name in (_SURROGATE, _SECOND) if name in bench.avs):
            judged = pooled([bench.judged(adversary, av, k) for k in range(bench.size.seeds)])
            group = _group(judged, av, adversary.bounded)
            groups.append(group)
            rows += _rows(group)
    main = groups[0]
    headline = Row(
        f"share of type 4 ({CRASH_TYPES[4]}), {main['name']}", "the largest", main["shares"][3], main["intervals"][3]
    )
    notes = [
        "The paper draws its five types (Figure 4) and names none in the text; which of ours carries which number is "
        "our choice (docs/adr/0002-crash-types.md), so compare what the types are, not their numbers.",
        "The adversary was trained on idm-mobil; the second AV is one that it never met, as in the paper. Bounded: "
        "only actions that the naturalistic model calls possible. Intervals: exact, over crashes.",
        "Type 3, head-on, cannot happen on a one-way road; the paper has none either.",
    ]
    if _SECOND not in bench.avs:
        notes.append(f'There is no AV "{_SECOND}" in this version, so its half of the figure is missing.')
    return Finding(headline, rows, {"groups": groups, "types": list(CRASH_TYPES.values())}, notes)


def _group(judged: dict[str, Any], av: str, bounded: bool) -> dict[str, Any]:
    n = judged["typed"]
    counts = [judged["crash_types"][name] for name in CRASH_TYPES.values()]
    return {
        "name": f"{av}, {'bounded' if bounded else 'unbounded'}",
        "av": av,
        "bounded": bounded,
        "crashes": n,
        "counts": counts,
        "shares": [count / n if n else None for count in counts],
        "intervals": [binomial_interval(count, n) if n else None for count in counts],
        "strikers": judged["strikers"],
    }


def _rows(group: dict[str, Any]) -> list[Row]:
    rows = []
    for index, (code, name) in enumerate(CRASH_TYPES.items()):
        paper = None if group["bounded"] else {3: "none", 4: "the largest"}.get(code, "occurs")
        share, ends = group["shares"][index], group["intervals"][index]
        note = f"{group['counts'][index]} of {group['crashes']} crashes"
        rows.append(Row(f"type {code} ({name}), {group['name']}", paper, share, ends, "share of crashes", note))
    return rows


FIGURE5 = Item(
    id="figure5",
    title="Figure 5: crash types",
    place="Figures 4 and 5; section Corner Case Generation",
    says="For the IDM-based and the RL-based AV, types 1, 2, 4 and 5 of the five occur, and type 4 most often.",
    compute=compute,
)
