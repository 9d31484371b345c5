"""Figure 6: one case of each crash type."""

from __future__ import annotations

from typing import Any

import numpy as np

from cornerforge.analysis.crash_types import CRASH_TYPES
from cornerforge.ext.paper.bench import Adversary, Bench
from cornerforge.ext.paper.clusters import Analysed, analysed
from cornerforge.ext.paper.drawn import drawn_case, number_of_cases
from cornerforge.ext.paper.item import Finding, Item, Row
from cornerforge.ext.paper.libraries import BOUNDED, FREE, missing_note

__all__ = ["FIGURE6"]

_PAPER = {1: "shown", 2: "shown", 3: "none", 4: "shown", 5: "shown"}


def compute(bench: Bench, adversaries: tuple[Adversary, ...] = (FREE, BOUNDED)) -> Finding:
    """A typical case of each type, from the first library that has any."""
    found = {adversary: analysed(bench, adversary) for adversary in adversaries}
    notes = [missing_note(bench, adversary) for adversary, library in found.items() if library is None]
    libraries = {adversary: library for adversary, library in found.items() if library is not None}
    if not libraries:
        nothing = Row("types of which there is a case", 4, None, note="; ".join(notes))
        return Finding(nothing, [nothing], {}, notes)
    rows, examples = [], []
    for code, name in CRASH_TYPES.items():
        counts = {adversary: _members(library, name).size for adversary, library in libraries.items()}
        shown = next((adversary for adversary, n in counts.items() if n), None)
        said = ", ".join(f"{n:,} {_word(adversary)}" for adversary, n in counts.items())
        rows.append(Row(f"type {code} ({name})", _PAPER[code], sum(counts.values()), None, "cases", said))
        if shown is not None:
            title = f"type {code}, {name} ({number_of_cases(counts[shown], _word(shown))})"
            examples.append(_example(libraries[shown], name, title))
    headline = Row("types of which there is a case", 4, len(examples), note="; ".join(notes))
    return Finding(headline, [headline, *rows], {"examples": examples}, [*notes, *_NOTES])


def _word(adversary: Adversary) -> str:
    return "bounded" if adversary.bounded else "unbounded"


def _members(found: Analysed, name: str) -> np.ndarray[Any, np.dtype[np.intp]]:
    return np.flatnonzero(np.array(found.analysis.crash_types.names) == name)


def _example(found: Analysed, name: str, title: str) -> dict[str, Any]:
    """The case of a type that is nearest, in standardised features, to the mean of its type."""
    members = _members(found, name)
    values = found.analysis.features.values[members]
    spread = found.analysis.features.values.std(axis=0)
    far = ((values - values.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)) ** 2
    case_id = found.analysis.case_ids[members[int(far.sum(axis=1).argmin())]]
    return {"case": case_id, "title": title, **drawn_case(found.library.scenario(case_id).scenario)}


_NOTES = (
    "Shown is the case nearest to the mean of its type in the five features at 1 s. Counts are of the libraries of "
    "Figures 8 and 10, cases of idm-mobil alone; adversaries of other rewards and AVs make other types (the matrix).",
    "The types and their numbers: docs/adr/0002-crash-types.md. Type 3, head-on, cannot happen on a one-way road.",
)

FIGURE6 = Item(
    id="figure6",
    title="Figure 6: a case of each crash type",
    place="Figure 6; section Corner Case Generation",
    says="For each crash type that occurs (1, 2, 4 and 5) one case is shown in pictures from CARLA.",
    compute=compute,
)
