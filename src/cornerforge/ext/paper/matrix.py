"""The matrix: every adversary against every AV, with the paper's two yields as two of its cells."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cornerforge.ext.paper.bench import PLAIN, Adversary, Bench, pooled
from cornerforge.ext.paper.item import Finding, Item, Row

__all__ = ["MATRIX", "adversaries"]

_PAPER = {"idm-mobil": 0.286, "rl": 0.10}


def adversaries(bench: Bench) -> Iterator[Adversary]:
    """The rows of the matrix: plain ones, then one trained on each AV for each reward; free, then bounded."""
    for bounded in (False, True):
        for name in PLAIN:
            yield Adversary(name, bounded=bounded)
        for trained_on in bench.trained_on:
            for reward in bench.rewards:
                yield Adversary("learned", bounded=bounded, trained_on=trained_on, reward=reward)


def compute(bench: Bench) -> Finding:
    """Yield, net of the AV's own natural rate, avoidable yield and crash types, for each cell."""
    natural = {av: bench.natural(av) for av in bench.avs}
    cells = [_cell(bench, adversary, av, natural[av]) for adversary in adversaries(bench) for av in bench.avs]
    rows = [_natural_row(av, rate) for av, rate in natural.items()]
    rows += [row(cell) for row in (_row, _avoidable_row) for cell in cells]
    of_paper = {cell["av"]: _row(cell) for cell in cells if cell["paper"] is not None}
    headline = of_paper["rl" if "rl" in of_paper else "idm-mobil"]
    notes = [
        "Each cell: crashes of the AV per test, less those that it has in natural traffic anyhow (first rows of the "
        f"table), on {bench.size.tests:,} tests that nothing was trained on, the same ones in all cells. "
        "Learned adversaries: "
        f"preset fast, {bench.size.decisions:,} decisions ({bench.size.bounded_decisions:,} bounded), "
        f"{bench.size.seeds} seed(s): the mean, with an interval from the lowest to the highest end of the seeds' "
        "exact intervals.",
        "Avoidable: by braking at 8 m/s2 from 1 s after the manoeuvre began that led to the crash (docs/adr, rewards). "
        "A yield of unavoidable crashes says little about an AV; compare both maps.",
        "The paper has two of these cells: 0.286 for the AV that the adversary was trained on, and 0.10 for an "
        "RL-based AV that it never met. It reports no bounded yield. Its RL AV is not published: the claim that an "
        "adversary carries over to another AV, at a lower yield, can be compared; the number 0.10 cannot.",
    ]
    if "rl" not in bench.avs:
        notes.append('There is no AV "rl" in this version, so the cell with the paper\'s 0.10 is missing.')
    return Finding(headline, rows, {"cells": cells, "avs": list(bench.avs), "natural": natural}, notes)


def _cell(bench: Bench, adversary: Adversary, av: str, natural: dict[str, Any]) -> dict[str, Any]:
    seeds = bench.size.seeds if adversary.trained_on is not None else 1
    judged = pooled([bench.judged(adversary, av, k) for k in range(seeds)])
    (low, high), (natural_low, natural_high) = judged["interval95"], natural["interval95"]
    return {
        "adversary": adversary.name,
        "trained_on": adversary.trained_on,
        "reward": adversary.reward,
        "bounded": adversary.bounded,
        "av": av,
        **judged,
        "paper": _paper(adversary, av),
        "net_per_test": judged["crashes_per_test"] - natural["crashes_per_test"],
        "net_interval95": [max(-1.0, low - natural_high), high - natural_low],
        "key": adversary.key,
    }


def _paper(adversary: Adversary, av: str) -> float | None:
    """The paper's yield of a cell; it has two."""
    is_paper = (adversary.trained_on, adversary.reward, adversary.bounded) == ("idm-mobil", "crash", False)
    return _PAPER.get(av) if is_paper else None


def _row(cell: dict[str, Any]) -> Row:
    low, high = cell["net_interval95"]
    types = ", ".join(f"{name} {count}" for name, count in cell["crash_types"].items() if count)
    note = f"crash types of {cell['typed']}: {types}" if types else ""
    what = f"{cell['key']} against {cell['av']}"
    return Row(what, cell["paper"], cell["net_per_test"], (low, high), "crashes per test", note)


def _avoidable_row(cell: dict[str, Any]) -> Row:
    note = f"the AV's front took part in {cell['struck']} of {cell['crashes']} crashes"
    what = f"avoidable crashes, {cell['key']} against {cell['av']}"
    return Row(what, None, cell["avoidable_per_test"], cell["avoidable_interval95"], "crashes per test", note)


def _natural_row(av: str, rate: dict[str, Any]) -> Row:
    low, high = rate["interval95"]
    paper = 1e-6 if av == "idm-mobil" else None
    note = f"{rate['tests']:,} tests; `cornerforge rate` measures it sharper"
    return Row(f"natural traffic against {av}", paper, rate["crashes_per_test"], (low, high), "crashes per test", note)


MATRIX = Item(
    id="matrix",
    title="Adversaries against AVs",
    place="Section Corner Case Generation (0.286 and the RL-based AV's 10 %); section “NDD Bounded” Case Study",
    says="About 28.6 % of crashes for the surrogate IDM-based AV and 10 % for an RL-based AV with the same adversary.",
    compute=compute,
)
