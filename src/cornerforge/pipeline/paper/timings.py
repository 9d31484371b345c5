"""How long things take: training, generating, analysing."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

from cornerforge.adversary.policy_file import policy_hash
from cornerforge.pipeline.cases import analyse
from cornerforge.pipeline.generate import fill_library
from cornerforge.pipeline.paper.bench import Adversary, Bench
from cornerforge.pipeline.paper.figure2 import PAPER_SECONDS, PAPER_YIELD, seconds_to_yield
from cornerforge.pipeline.paper.item import Finding, Item, Row

__all__ = ["TIMINGS"]

PAPER_BOUNDED_CASES = 1_627
_MAX_TESTS = 3_000_000
"""A library that would need more tests is left out."""


def compute(bench: Bench) -> Finding:
    """Times of this machine; the only item whose numbers do not repeat."""
    free = Adversary("learned", bounded=False, trained_on="idm-mobil", reward="crash")
    policy = bench.policy(free)
    reached = seconds_to_yield(policy)
    rows = [
        Row(f"training to a yield of {PAPER_YIELD}", PAPER_SECONDS, reached, None, "s", "exploration included"),
        _whole_training(bench, free),
    ]
    notes = [
        "Single timings on this machine (provenance.json names it), not averages; other work on it counts in. The "
        "paper: training on an i9-9900k with an RTX 2080 TI, clustering on an i7-8750h laptop.",
        "The paper's 0.097 s is K-means on the minority of about 50,000 cases, of unsaid size; ours is that "
        "of both groups, with the search for the number of clusters. Its 0.0139 s is PCA and DBSCAN on 1,627 bounded "
        "cases.",
    ]
    headline = rows[0]
    bounded = Adversary("learned", bounded=True, trained_on="idm-mobil", reward="crash")
    for adversary, cases in ((free, bench.size.cases), (bounded, min(PAPER_BOUNDED_CASES, bench.size.cases))):
        made = _library(bench, adversary, cases)
        if made is None:
            missing = f"its yield is too low for {cases:,} cases in {_MAX_TESTS:,} tests"
            notes.append(f"No timing of {adversary.key}: {missing}.")
        else:
            rows += _analysis_rows(adversary, made)
    return Finding(headline, rows, {}, notes)


def _whole_training(bench: Bench, adversary: Adversary) -> Row:
    policy = bench.policy(adversary)
    curve = policy.about.get("curve")
    seconds = curve[-1]["seconds"] if isinstance(curve, list) and curve else None
    return Row(f"the whole training, {bench.size.decisions:,} decisions", PAPER_SECONDS, seconds, None, "s")


def _library(bench: Bench, adversary: Adversary, cases: int) -> dict[str, Any] | None:
    """Fill and analyse a library; None where crashes are too rare. Timings are kept, the library too."""
    share = bench.judged(adversary, "idm-mobil")["crashes_per_test"]
    if share * _MAX_TESTS < cases:
        return None
    run = bench.experiment("idm-mobil", adversary)
    folder = bench.folder / "libraries" / adversary.key
    assert run.policy is not None

    def work() -> dict[str, Any]:
        _clear(folder)
        filled = fill_library(
            run, folder, seed=bench.seed, cases=cases, threads=bench.threads, progress=bench.progress,
            stage=f"generate ({adversary.key})",
        )  # fmt: skip
        analyse(folder, seed=bench.seed, progress=bench.progress)  # loads what the analysis needs: not timed
        start = time.perf_counter()
        analysed = analyse(folder, seed=bench.seed, progress=bench.progress)
        return {
            "cases": cases,
            "minority": analysed["minority"],
            "generate_seconds": filled["seconds"],
            "analyse_seconds": round(time.perf_counter() - start, 3),
            "stages": analysed["seconds"],
        }

    return bench.kept(f"library.{adversary.key}", {"policy": policy_hash(run.policy), "cases": cases}, work)


def _clear(folder: Path) -> None:
    """Remove what an interrupted timing left: a library begun earlier would be filled faster than from nothing."""
    if folder.exists():
        shutil.rmtree(folder)


def _analysis_rows(adversary: Adversary, made: dict[str, Any]) -> list[Row]:
    cases, stages = made["cases"], made["stages"]
    where = f"{cases:,} {'bounded' if adversary.bounded else 'unbounded'} cases"
    paper: dict[str, float] = {}
    if not adversary.bounded and "kmeans" in stages:
        paper = {"kmeans": 0.097}
    rows = [
        Row(f"generate and store {where}", None, made["generate_seconds"], None, "s"),
        Row(f"the whole analysis of {where}", None, made["analyse_seconds"], None, "s"),
    ]
    if adversary.bounded and {"pca", "dbscan"} <= set(stages):
        both = stages["pca"] + stages["dbscan"]
        rows.append(Row(f"PCA and DBSCAN of {where}", 0.0139, both, None, "s", "the paper: 1,627 cases"))
    for name, seconds in stages.items():
        note = f"minority: {made['minority']:,} cases" if name == "kmeans" else ""
        rows.append(Row(f"stage {name}, {where}", paper.get(name), seconds, None, "s", note))
    return rows


TIMINGS = Item(
    id="timings",
    title="Timings",
    place="Sections Corner Case Generation, Corner Case Clustering and “NDD Bounded” Case Study",
    says="Training 4 days; K-means on the minority 0.097 s; PCA and DBSCAN of 1,627 bounded cases 0.0139 s.",
    compute=compute,
)
