"""Figures 8 and 10: majority, minority and their clusters at 1 s, without and with the bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cornerforge.analysis.analyse import Analysis, analyse
from cornerforge.analysis.dbscan import MAJORITY_SHARE, neighbour_distance
from cornerforge.analysis.sensitivity import split_sensitivity
from cornerforge.ext.paper.bench import (
    BOUNDED,
    FREE,
    PAPER_BOUNDED_CASES,
    PAPER_CASES,
    Adversary,
    Bench,
    library_of,
    missing_note,
)
from cornerforge.ext.paper.figure7 import thinned
from cornerforge.ext.paper.item import Finding, Item, Row, Value, nothing
from cornerforge.intervals import binomial_interval
from cornerforge.library import CaseLibrary

__all__ = ["FIGURE8", "FIGURE10", "Analysed", "analysed", "letters"]

_DRAWN = 2_000
_CURVE = 400


@dataclass(frozen=True)
class Analysed:
    """A library and its analysis at 1 s."""

    library: CaseLibrary
    analysis: Analysis


def analysed(bench: Bench, adversary: Adversary) -> Analysed | str:
    """Analyse the library of an adversary, or say why it does not exist."""
    filled = library_of(bench, adversary)
    if filled is None:
        return missing_note(bench, adversary)
    library = filled.open()
    ids, history = library.history()
    length, width = library.sizes()
    bench.progress(f"analyse ({adversary.key})", 0, 1)
    found = analyse(ids, history, seed=bench.seed, vehicle_length=length, vehicle_width=width)
    bench.progress(f"analyse ({adversary.key})", 1, 1)
    return Analysed(library, found)


def letters(analysis: Analysis) -> list[str]:
    """Names of the clusters as in the paper: A for the majority (A1, A2, ... if it has several), B, C, ... else."""
    n_majority = sum(cluster.group == "majority" for cluster in analysis.clusters)
    return [
        ("A" if n_majority == 1 else f"A{number + 1}") if number < n_majority else chr(ord("B") + number - n_majority)
        for number in range(len(analysis.clusters))
    ]


def compute(bench: Bench, adversary: Adversary) -> Finding:
    """Clusters of the library of an adversary against the surrogate AV."""
    found = analysed(bench, adversary)
    if isinstance(found, str):
        return nothing(_headline_of(adversary), _paper(adversary)["clusters"], found)
    rows = _rows(found.analysis, _paper(adversary))
    headline = next(row for row in rows if row.what == _headline_of(adversary))
    return Finding(headline, rows, _data(found.analysis), list(_NOTES))


def _headline_of(adversary: Adversary) -> str:
    return "main clusters of the majority (dense)" if adversary.bounded else "clusters of the minority (K-means)"


def _paper(adversary: Adversary) -> dict[str, Value]:
    if adversary.bounded:
        return {"cases": PAPER_BOUNDED_CASES, "dense": 2, "minority": "several outliers", "clusters": 2}
    return {"cases": PAPER_CASES, "clusters": 4, "smallest": 1, "majority": "closely connected, a rectangle"}


def _rows(analysis: Analysis, paper: dict[str, Value]) -> list[Row]:
    cases = len(analysis.case_ids)
    minority = int((~analysis.is_majority).sum())
    sizes = {
        name: [cluster.size for cluster in analysis.clusters if cluster.group == name]
        for name in ("majority", "minority")
    }
    noise, n_dense, n_main = 0, 0, 0
    if analysis.density is not None:
        labels = analysis.density.labels
        counts = np.bincount(labels[labels >= 0])
        noise, n_dense = int((labels < 0).sum()), len(counts)
        n_main = max(int((counts >= MAJORITY_SHARE * cases).sum()), min(1, n_dense))
    is_bounded = "dense" in paper
    smallest = min(sizes["minority"], default=None)
    rows = [
        Row("cases", paper["cases"], cases, note="the paper: about 50,000" if not is_bounded else ""),
        Row(
            "main clusters of the majority (dense)", paper.get("dense", paper.get("majority")), n_main,
            note=f"of {n_dense} dense; main: at least {MAJORITY_SHARE:.0%} of all cases",
        ),
        Row(
            "share of the minority", paper.get("minority"), minority / cases, binomial_interval(minority, cases),
            "share of cases", f"{minority:,} cases, {noise:,} of them noise",
        ),
        Row(
            "clusters of the minority (K-means)", None if is_bounded else paper["clusters"], len(sizes["minority"]),
            note=_why(analysis, "minority", sizes["minority"]),
        ),
        Row(
            "clusters of the majority (K-means)", None, len(sizes["majority"]),
            note=_why(analysis, "majority", sizes["majority"]),
        ),
        Row("smallest cluster of the minority", paper.get("smallest"), smallest, None, "cases"),
        *[
            Row(f"loading of {name} in components 1; 2", None, f"{one:.2f}; {two:.2f}")
            for name, (one, two) in zip(analysis.features.names, analysis.projection.loadings.T, strict=True)
        ],
        Row(
            "variance that the plane shows", None, float(analysis.projection.explained_variance.sum()), None,
            "share of variance", " + ".join(f"{share:.3f}" for share in analysis.projection.explained_variance),
        ),
    ]  # fmt: skip
    if analysis.density is not None:
        rows.append(
            Row(
                "eps",
                None,
                analysis.density.eps,
                None,
                "",
                f"min_samples {analysis.density.min_samples}; see the curve",
            )
        )
    return rows


def _why(analysis: Analysis, group: str, sizes: list[int]) -> str:
    """Sizes of the clusters, and what decided about their number."""
    said = f"sizes {', '.join(f'{size:,}' for size in sizes)}" if sizes else "no such case"
    choice = analysis.choices.get(group)
    if choice is None or choice.bound is None:
        return said
    best = max(choice.scores)
    sign = "above" if best > choice.bound else "not above"
    at = choice.scores.index(best) + 2
    return f"{said}; largest silhouette {best:.2f} at k = {at}, {sign} the bound {choice.bound:.2f}"


def _data(analysis: Analysis) -> dict[str, Any]:
    points = analysis.projection.points
    row_of = {name: row for row, name in enumerate(analysis.case_ids)}
    clusters = [
        {
            "letter": letter,
            "group": cluster.group,
            "size": cluster.size,
            "points": points[thinned(np.flatnonzero(analysis.cluster_index == number), _DRAWN)].round(3).tolist(),
            "typical": [points[row_of[name]].round(3).tolist() for name in cluster.typical],
        }
        for number, (letter, cluster) in enumerate(zip(letters(analysis), analysis.clusters, strict=True))
    ]
    shown: dict[str, Any] = {
        "clusters": clusters,
        "rare": [points[row_of[name]].round(3).tolist() for name in analysis.rare],
        "explained": analysis.projection.explained_variance.tolist(),
        "silhouettes": {name: choice.to_json() for name, choice in analysis.choices.items()},
    }
    density = analysis.density
    if density is not None:
        distance = np.sort(neighbour_distance(points, min(len(points), 2 * density.min_samples)))
        at = thinned(np.arange(len(distance)), _CURVE)
        shown["density"] = {
            "eps": density.eps,
            "min_samples": density.min_samples,
            "rank": (at / max(1, len(distance) - 1)).round(5).tolist(),
            "distance": distance[at].tolist(),
            "sensitivity": [one.to_json() for one in split_sensitivity(points, density)],
        }
    return shown


_NOTES = (
    "A: the majority (A1, A2, ... where K-means parts it); B, C, ...: the minority, by size. The letters are ours: the "
    "paper's B need not be our B; Figures 9 and 11 say what happens in each.",
    "The paper states no rule for eps or the number of clusters, so numbers of clusters can be compared in kind only. "
    "Ours: eps is the knee of the distances to the (2 x min_samples)-th neighbour; k has the largest mean silhouette "
    "if that exceeds what evenly spread points reach by three standard deviations, else 1.",
    "Where ours differ: the clusters are those of the adversary that made the cases, and ours is not the paper's "
    "(Figure 2). How much the rules decide is in the picture of the choices: other eps, other min_samples, other k.",
)

FIGURE8 = Item(
    id="figure8",
    title="Figure 8: majority and minority, unbounded",
    place="Figure 8; section Corner Case Clustering",
    says=(
        "The majority is closely connected, a rectangle in the plane; K-means finds 4 clusters in the minority, of "
        "which one is a single case."
    ),
    compute=lambda bench: compute(bench, FREE),
)
FIGURE10 = Item(
    id="figure10",
    title="Figure 10: clusters, NDD-bounded",
    place="Figure 10; section “NDD Bounded” Case Study",
    says="1,627 cases form two main clusters with several outliers; one of the two is drawn as B and C.",
    compute=lambda bench: compute(bench, BOUNDED),
)
