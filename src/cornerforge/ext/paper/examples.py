"""Figures 6, 9 and 11: typical cases of crash types and clusters, drawn, and events in the clusters, by mechanisms."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.analysis.in_words import what_happened
from cornerforge.analysis.mechanism import MECHANISMS, mechanism_of
from cornerforge.ext.paper.bench import BOUNDED, FREE, Adversary, Bench
from cornerforge.ext.paper.clusters import Analysed, analysed, letters
from cornerforge.ext.paper.figure7 import thinned
from cornerforge.ext.paper.item import Finding, Item, Row, nothing
from cornerforge.intervals import binomial_interval
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Scenario

__all__ = ["FIGURE6", "FIGURE9", "FIGURE11"]

_SHOWN_S = (3.0, 2.0, 1.0, 0.0)
_NEAR_M = 30.0
_OF_TYPES = {1: "shown", 2: "shown", 3: "none", 4: "shown", 5: "shown"}
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
    if isinstance(found, str):
        first, (place, _) = next(iter(_KINDS[adversary.bounded].items()))
        return nothing(first, place, found)
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
    drawn = _drawn(found.library.scenario(case_id).scenario)
    return {"letter": letter, "case": case_id, "title": f"{letter} ({group}, {_number_of(size)})", **drawn}


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


def _drawn(scenario: Scenario) -> dict[str, Any]:
    """A crash at 3, 2, 1 and 0 s before contact (as far as it goes back), its mechanism, what happened, and the road.

    Each of `moments` holds the boxes `av`, `bv` (of the crash; None where it was not there) and `others` near the AV as
    [x ahead of the AV, y, heading, length, width] in m and rad.
    """
    assert scenario.crash is not None  # every case is a crash
    moments = [moment for moment in _SHOWN_S if moment <= scenario.crash.time]
    return {
        "mechanism": mechanism_of(scenario).name,
        "happened": what_happened(scenario),
        "lanes": scenario.odd.n_lanes,
        "lane_width": scenario.odd.lane_width,
        "moments": [{"before": moment, **_boxes(scenario, moment)} for moment in moments],
    }


def _number_of(n: int, kind: str = "") -> str:
    """Write the number of cases in words.

    >>> _number_of(1, "bounded"), _number_of(1627)
    ('1 bounded case', '1,627 cases')
    """
    return " ".join(word for word in (f"{n:,}", kind, "case" if n == 1 else "cases") if word)


def _boxes(scenario: Scenario, before: float) -> dict[str, Any]:
    assert scenario.crash is not None
    frame = round((scenario.crash.time - before) / FRAME_S)
    here = {
        int(slot): [
            round(float(value), 4)
            for value in (
                along(scenario.x[frame, 0], scenario.x[frame, column]),
                scenario.y[frame, column],
                scenario.heading[frame, column],
                scenario.length[column],
                scenario.width[column],
            )
        ]
        for column, slot in enumerate(scenario.slot)
        if scenario.present[frame, column]
    }
    partner = scenario.crash.slot_b
    others = [box for slot, box in here.items() if slot not in (0, partner) and abs(box[0]) <= _NEAR_M]
    return {"av": here[0], "bv": here.get(partner), "others": others}


def compute_types(bench: Bench, adversaries: tuple[Adversary, ...] = (FREE, BOUNDED)) -> Finding:
    """A typical case of each type, from the first library that has any."""
    found = {adversary: analysed(bench, adversary) for adversary in adversaries}
    notes = [why for why in found.values() if isinstance(why, str)]
    libraries = {adversary: library for adversary, library in found.items() if not isinstance(library, str)}
    if not libraries:
        none = Row("types of which there is a case", 4, None, note="; ".join(notes))
        return Finding(none, [none], {}, notes)
    rows, examples = [], []
    for code, name in CRASH_TYPES.items():
        counts = {adversary: _members(library, name).size for adversary, library in libraries.items()}
        shown = next((adversary for adversary, n in counts.items() if n), None)
        said = ", ".join(f"{n:,} {_word(adversary)}" for adversary, n in counts.items())
        rows.append(Row(f"type {code} ({name})", _OF_TYPES[code], sum(counts.values()), None, "cases", said))
        if shown is not None:
            title = f"type {code}, {name} ({_number_of(counts[shown], _word(shown))})"
            examples.append(_typical(libraries[shown], name, title))
    headline = Row("types of which there is a case", 4, len(examples), note="; ".join(notes))
    return Finding(headline, [headline, *rows], {"examples": examples}, [*notes, *_TYPE_NOTES])


def _word(adversary: Adversary) -> str:
    return "bounded" if adversary.bounded else "unbounded"


def _members(found: Analysed, name: str) -> np.ndarray[Any, np.dtype[np.intp]]:
    return np.flatnonzero(np.array(found.analysis.crash_types.names) == name)


def _typical(found: Analysed, name: str, title: str) -> dict[str, Any]:
    """The case of a type that is nearest, in standardised features, to the mean of its type."""
    members = _members(found, name)
    values = found.analysis.features.values[members]
    spread = found.analysis.features.values.std(axis=0)
    far = ((values - values.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)) ** 2
    case_id = found.analysis.case_ids[members[int(far.sum(axis=1).argmin())]]
    return {"case": case_id, "title": title, **_drawn(found.library.scenario(case_id).scenario)}


_TYPE_NOTES = (
    "Shown is the case nearest to the mean of its type in the five features at 1 s. Counts are of the libraries of "
    "Figures 8 and 10, cases of idm-mobil alone; adversaries of other rewards and AVs make other types (the matrix).",
    "The types and their numbers: docs/adr/0002-crash-types.md. Type 3, head-on, cannot happen on a one-way road.",
)

FIGURE6 = Item(
    id="figure6",
    title="Figure 6: a case of each crash type",
    place="Figure 6; section Corner Case Generation",
    says="For each crash type that occurs (1, 2, 4 and 5) one case is shown in pictures from CARLA.",
    compute=compute_types,
)
