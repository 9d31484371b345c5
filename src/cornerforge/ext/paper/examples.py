"""Figures 9 and 11: events in the clusters, by mechanisms and by one typical case of each."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.mechanism import MECHANISMS, mechanism_of
from cornerforge.ext.paper.bench import Adversary, Bench
from cornerforge.ext.paper.clusters import Analysed, analysed, letters
from cornerforge.ext.paper.drawn import drawn_case, number_of_cases
from cornerforge.ext.paper.figure7 import thinned
from cornerforge.ext.paper.item import Finding, Item, Row
from cornerforge.ext.paper.libraries import BOUNDED, FREE, missing_note
from cornerforge.intervals import binomial_interval

__all__ = ["FIGURE9", "FIGURE11"]

_BOTH_CHANGE = ("same-lane-same-side", "same-lane-opposite-sides", "swap")
_KINDS: dict[bool, dict[str, tuple[str, tuple[str, ...]]]] = {
    False: {
        "the BV drives into an AV that keeps its lane": ("A, the majority; D", ("bv-side", "bv-rear-bv-change")),
        "the AV changes lanes and a BV runs into its rear": ("B", ("bv-rear-av-cut-in",)),
        "both change lanes at the same time": ("C", _BOTH_CHANGE),
        "the BV has changed into the AV's lane, then rear-end": ("E, one case", ("av-rear-bv-cut-in",)),
    },
    True: {
        "aggressive cut-in: the BV cuts in, then rear-end": ("A", ("av-rear-bv-cut-in",)),
        "lane conflict: both change lanes at the same time": ("B, C and the outliers D", _BOTH_CHANGE),
    },
}
"""Bounded or not -> kinds of crash in the paper's text, their places there, and our mechanisms of each kind."""
_LEAST = 5
"""Least number of cases read of each cluster."""


def compute(bench: Bench, adversary: Adversary) -> Finding:
    """Mechanisms of the clusters of an adversary's library, and a typical case of each."""
    found = analysed(bench, adversary)
    if found is None:
        why = missing_note(bench, adversary)
        first = next(iter(_KINDS[adversary.bounded]))
        nothing = Row(first, _KINDS[adversary.bounded][first][0], None, None, "", why)
        return Finding(nothing, [nothing], {}, [why])
    every = thinned(np.arange(len(found.analysis.case_ids)), bench.size.typed)
    rows = _kind_rows(_mechanisms(bench, found, every, adversary), adversary.bounded)
    cells = []
    of_each = max(_LEAST, bench.size.typed // len(found.analysis.clusters))
    for number, (letter, cluster) in enumerate(zip(letters(found.analysis), found.analysis.clusters, strict=True)):
        members = thinned(np.flatnonzero(found.analysis.cluster_index == number), of_each)
        rows.append(_cluster_row(letter, cluster.size, _mechanisms(bench, found, members, adversary)))
        cells.append(_example(found, letter, cluster.size, cluster.group, cluster.typical[0]))
    return Finding(rows[0], rows, {"examples": cells}, list(_NOTES))


def _mechanisms(bench: Bench, found: Analysed, rows: NDArray[np.intp], adversary: Adversary) -> list[str]:
    """Mechanism of each of these cases."""
    names = []
    for done, row in enumerate(rows.tolist()):
        names.append(mechanism_of(found.library.scenario(found.analysis.case_ids[row]).scenario).name)
        bench.progress(f"read cases ({adversary.key})", done + 1, len(rows))
    return names


def _kind_rows(names: list[str], bounded: bool) -> list[Row]:
    rows = []
    counts = Counter(names)
    for kind, (place, mechanisms) in _KINDS[bounded].items():
        n = sum(counts[name] for name in mechanisms)
        note = f"{n:,} of {len(names):,} cases; our mechanisms {', '.join(mechanisms)}"
        rows.append(
            Row(kind, f"cluster {place}", n / len(names), binomial_interval(n, len(names)), "share of cases", note)
        )
    told = {name for _, mechanisms in _KINDS[bounded].values() for name in mechanisms}
    for name, n in counts.most_common():
        if name not in told:
            rows.append(
                Row(
                    f"not in the paper's figure: {MECHANISMS[name]}",
                    None,
                    n / len(names),
                    binomial_interval(n, len(names)),
                    "share of cases",
                    f"{n:,} of {len(names):,} cases; {name}",
                )
            )
    return rows


def _cluster_row(letter: str, size: int, names: list[str]) -> Row:
    name, n = Counter(names).most_common(1)[0]
    return Row(
        f"cluster {letter} ({size:,} cases): share of its most frequent mechanism", None, n / len(names),
        binomial_interval(n, len(names)), "share of cases", f"{n:,} of {len(names):,} cases read: {MECHANISMS[name]}",
    )  # fmt: skip


def _example(found: Analysed, letter: str, size: int, group: str, case_id: str) -> dict[str, Any]:
    """The typical case of a cluster."""
    drawn = drawn_case(found.library.scenario(case_id).scenario)
    return {"letter": letter, "case": case_id, "title": f"{letter} ({group}, {number_of_cases(size)})", **drawn}


_NOTES = (
    "The paper describes its clusters in words; we count how many of our cases are of each kind that it names, by the "
    "mechanism of each recording (who changed lanes when, which faces met: `cornerforge.analysis.mechanism`), on cases "
    "evenly taken from the library. What a cluster mostly holds is in its row, of cases evenly taken from it.",
    "The picture shows the typical case of each cluster (nearest to its centre) 3, 2, 1 and 0 s before contact, seen "
    "from above in a frame that moves along the road with the AV: the AV stays at 0 and moves across only.",
    "A mechanism looks further back than the 1 s of the features, so a cluster need not be of one mechanism.",
)

FIGURE9 = Item(
    id="figure9",
    title="Figure 9: examples of the clusters, unbounded",
    place="Figure 9; section Corner Case Clustering",
    says=(
        "Majority A: the AV goes straight and a BV drives into it. Minority: B, a cut-in makes the AV change lanes and "
        "a BV there hits its rear; C, both change lanes at once; D, the BV changes into the AV; E, rear-end after it."
    ),
    compute=lambda bench: compute(bench, FREE),
)
FIGURE11 = Item(
    id="figure11",
    title="Figure 11: examples of the clusters, NDD-bounded",
    place="Figure 11; section “NDD Bounded” Case Study",
    says="A: aggressive cut-in with a rear-end crash; B, C and the outliers D: lane conflict, both change at once.",
    compute=lambda bench: compute(bench, BOUNDED),
)
