"""What `cornerforge reproduce` found, as Markdown.

    cornerforge reproduce --effort standard --out out/reproduction
    .venv/bin/python benchmarks/reproduction.py out/reproduction --write docs/results.md
    .venv/bin/python benchmarks/reproduction.py out/reproduction --rows --write docs/reproduction.md

Computes nothing: numbers are those of `items.json`, intervals and notes included. Without `--rows`: one line an item
and the matrix as four tables; with it: all numbers of all other items, the paper's beside ours.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from document import MarkedBlock
from measuring import table

from cornerforge.ext.paper.reproduce import REPRODUCE_EFFORTS

IN_DOCUMENT = MarkedBlock("benchmarks/reproduction.py")
Json = Mapping[str, Any]
_YIELDS = (
    ("crashes per test, less the AV's natural rate", "net_per_test", "net_interval95"),
    ("avoidable crashes per test (by braking with 8 m/s2 from 1 s on)", "avoidable_per_test", "avoidable_interval95"),
)
"""What the tables of the matrix show: title, and keys of a cell."""


def render(items: Json, provenance: Json, *, rows: bool) -> str:
    """Lines of all items and the matrix, or the rows of all items but the matrix."""
    size = REPRODUCE_EFFORTS[items["effort"]]
    head = (
        f"Effort `{items['effort']}`, seed {items['seed']}: {size.seeds} training(s) of each kind, "
        f"{size.decisions:,} decisions each ({size.bounded_decisions:,} bounded); {size.tests:,} evaluation tests a "
        f"training and AV.\nCode `{provenance['identity']['code']}`, model `{provenance['identity']['model_hash']}`. A "
        "mean over trainings has an interval from the lowest to the highest end of\ntheir exact 95 % intervals; other "
        "intervals are 95 %."
    )
    parts = [head]
    if not rows:
        parts.append(_rows([{**item, "what": f"{item['title']}: {item['what']}"} for item in items["items"]]))
    for item in items["items"]:
        if item["id"] == "matrix" and not rows:
            parts += [f"### {item['title']}", *_matrix(item["data"])]
        elif item["id"] != "matrix" and rows:
            parts += [f"## {item['title']}", f"The paper ({item['place']}): {item['says']}", _rows(item["rows"])]
    return "\n\n".join(parts)


def _rows(rows: Sequence[Json]) -> str:
    """A row a number; those that neither the paper nor we have are left out."""
    head = ["quantity", "paper", "ours", "interval", "note"]
    known = [row for row in rows if row["paper"] is not None or row["ours"] is not None]
    return table(head, [[row["what"], _value(row["paper"]), _ours(row), _ends(row), row["note"]] for row in known])


def _ours(row: Json) -> str:
    return _value(row["ours"]) if row["ours"] is None else f"{_value(row['ours'])} {row['unit']}".strip()


def _ends(row: Json) -> str:
    if row["interval"] is None:
        return ""
    return " to ".join(_value(end) for end in row["interval"])


def _matrix(data: Json) -> list[str]:
    """Natural rates; then yields and avoidable yields, unbounded and bounded."""
    avs, cells = data["avs"], data["cells"]
    natural = [
        [
            f"`{av}`",
            f"{rate['crashes_per_test'] * rate['tests']:,.0f} of {rate['tests']:,}",
            " to ".join(_value(end) for end in rate["interval95"]),
        ]
        for av, rate in data["natural"].items()
    ]
    parts = ["Natural traffic:", table(["AV", "crashes of tests", "per test, 95 %"], natural)]
    for bounded in (False, True):
        of_kind = [cell for cell in cells if cell["bounded"] == bounded]
        names = list(dict.fromkeys(_name(cell) for cell in of_kind))
        cell_of = {(_name(cell), cell["av"]): cell for cell in of_kind}
        word = "Bounded" if bounded else "Unbounded"
        for title, value, ends in _YIELDS:
            rows = [[name, *(_cell(cell_of[name, av], value, ends) for av in avs)] for name in names]
            parts += [f"{word}: {title}. Rows: adversaries, by the AV and the reward of their training.",
                      table(["adversary", *(f"against `{av}`" for av in avs)], rows)]  # fmt: skip
    return parts


def _name(cell: Json) -> str:
    return cell["adversary"] if cell["trained_on"] is None else f"on `{cell['trained_on']}`, {cell['reward']}"


def _cell(cell: Json, value: str, ends: str) -> str:
    low, high = (max(0.0, end) for end in cell[ends])
    said = f" [paper {cell['paper']:g}]" if value == "net_per_test" and cell["paper"] is not None else ""
    return f"{_value(max(0.0, cell[value]))} ({_value(low)} to {_value(high)}){said}"


def _value(value: float | str | None) -> str:
    """A text, a dash, or a number: three digits, thousands apart, an exponent only for what is tiny."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if float(value).is_integer():
        return f"{value:,.0f}"
    if abs(value) < 1e-3:
        return f"{value:.1e}"
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.2g}" if abs(value) < 0.01 else f"{value:.3g}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print, and write with `--write`."""
    parser = argparse.ArgumentParser(description="Tables of a finished `cornerforge reproduce`.")
    parser.add_argument("folder", type=Path, metavar="OUT", help="what `cornerforge reproduce --out` wrote")
    parser.add_argument("--rows", action="store_true", help="all numbers of all items but the matrix")
    parser.add_argument("--write", type=Path, metavar="PATH", help="replace the marked block of this document")
    given = parser.parse_args(arguments)
    if given.write and (fault := IN_DOCUMENT.missing_in(given.write)):
        parser.error(fault)
    try:
        items, provenance = (json.loads((given.folder / f"{name}.json").read_text("utf-8"))
                             for name in ("items", "provenance"))  # fmt: skip
    except (OSError, ValueError) as error:
        parser.error(f"{given.folder} is no finished reproduction ({error}); run: cornerforge reproduce --out OUT")
    block = render(items, provenance, rows=given.rows)
    IN_DOCUMENT.publish(block, given.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
