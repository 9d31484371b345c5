"""`reproduce` makes the paper's figures and tables again, item by item, with our values beside the paper's."""

from __future__ import annotations

import time
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from cornerforge._checks import check_in, check_integer
from cornerforge._options import verb
from cornerforge.experiment.output import (
    code_hash,
    config_hash,
    open_output,
    provenance,
    read_json_file,
    version,
    write_json,
)
from cornerforge.ext.paper.bench import REPRODUCE_EFFORTS, Bench, keep
from cornerforge.ext.paper.clusters import FIGURE8, FIGURE10
from cornerforge.ext.paper.examples import FIGURE6, FIGURE9, FIGURE11
from cornerforge.ext.paper.figure2 import FIGURE2
from cornerforge.ext.paper.figure3 import FIGURE3
from cornerforge.ext.paper.figure5 import FIGURE5
from cornerforge.ext.paper.figure7 import FIGURE7
from cornerforge.ext.paper.item import Item
from cornerforge.ext.paper.matrix import MATRIX
from cornerforge.ext.paper.options import Reproduce
from cornerforge.ext.paper.table1 import TABLE1
from cornerforge.ext.paper.timings import TIMINGS
from cornerforge.ndd.model import model_hash
from cornerforge.results import Reproduced, from_json
from cornerforge.results.reproduction import PaperItem

__all__ = ["ITEMS", "REPRODUCE_EFFORTS", "reproduce", "reproduction_text"]

ITEMS: dict[str, Item] = {
    item.id: item
    for item in (
        TABLE1, FIGURE2, FIGURE3, FIGURE5, FIGURE6, FIGURE7, FIGURE8, FIGURE9, FIGURE10, FIGURE11, MATRIX, TIMINGS,
    )
}  # fmt: skip
"""All items, in the order of the page. A new one: a module, an entry here, a renderer in the report."""
_SHOWN = tuple(one.name for one in fields(PaperItem))


@verb(Reproduce)
def reproduce(options: Reproduce) -> Reproduced:
    """Make the paper's figures and tables again, and a page that shows ours beside theirs.

    `OUT` then holds `index.html`, `figures/` (PNG and SVG), `items.json`, `provenance.json`, and what is kept to go on
    with: `policies/`, `parts/`, `items/`, `libraries/`.

    Returns:
        What `cornerforge reproduce --json` prints.

    Raises:
        CornerForgeError: Input, files or output place are not right; an extra is missing.
    """
    from cornerforge.ext.paper.reproduction import check_reproduction, write_reproduction

    start = time.perf_counter()
    folder = Path(options.out)
    effort = check_in("effort", options.effort or "standard", tuple(REPRODUCE_EFFORTS))
    size = REPRODUCE_EFFORTS[effort]
    check_integer("seed", options.seed, low=0, high=2**32 - 1)
    wanted = [
        ITEMS[check_in("figure", name, tuple(ITEMS))]
        for name in (ITEMS if options.figures is None else options.figures)
    ]
    bench = Bench(
        folder, size, options.world().without_mask(), seed=options.seed, threads=options.threads,
        progress=options.progress,
        paper_policy=None if options.paper_policy is None else Path(options.paper_policy), more_avs=options.avs,
        budget=options.budget,
    )  # fmt: skip
    run = bench.experiment("idm-mobil")
    check_reproduction()
    identity = {
        "seed": options.seed,
        "effort": effort,
        "odd": run.odd.name,
        "lanes": run.odd.n_lanes,
        "model_hash": model_hash(run.model),
        "config_hash": config_hash({"size": asdict(size), "odd": run.odd.stated(), "budget": options.budget}),
        "cornerforge": version(),
    }
    open_output(folder, identity, resume=options.resume)
    for item in wanted:
        _made(bench, item)
    items = [found for item in ITEMS.values() if (found := _finished(bench, item)) is not None]
    write_json(folder / "items.json", {"effort": effort, "seed": options.seed, "items": items})
    seconds = round(time.perf_counter() - start, 3)
    more = {"code": code_hash(), "avs": _av_hashes(bench)}
    write_json(folder / "provenance.json", provenance({**identity, **more}, seconds))
    page = write_reproduction(folder)
    names = [item.id for item in wanted]
    shown = [from_json(PaperItem, {key: item[key] for key in _SHOWN}) for item in items if item["id"] in names]
    return Reproduced(
        items=tuple(shown), out=str(folder), page=str(page), effort=effort, seed=options.seed, seconds=seconds
    )


def _path(bench: Bench, item: Item) -> Path:
    return bench.folder / "items" / f"{item.id}.json"


def _inputs(bench: Bench) -> dict[str, Any]:
    """Return what decides every item: code, seed, effort, world, and the AVs and rewards to compare."""
    return {**bench.inputs(), "avs": _av_hashes(bench), "rewards": list(bench.rewards)}


def _av_hashes(bench: Bench) -> dict[str, str]:
    """Hash each AV as it drives."""
    return {name: bench.av_hash(name) for name in bench.avs}


def _made(bench: Bench, item: Item) -> dict[str, Any]:
    """Return an item's object: the kept one if its inputs are the same, else compute it."""

    def work() -> dict[str, Any]:
        start = time.perf_counter()
        found = item.compute(bench).as_json()
        about = {"id": item.id, "title": item.title, "place": item.place, "says": item.says}
        return {**about, **found, "seconds": round(time.perf_counter() - start, 3)}

    return keep(_path(bench, item), {"all": _inputs(bench), "own": item.inputs(bench)}, work)


def _finished(bench: Bench, item: Item) -> dict[str, Any] | None:
    """Return a finished item; None if there is none, or if code or world have changed since.

    The item's own inputs may differ: a request for Figure 3 alone does not remove a curve from Figure 2.
    """
    path = _path(bench, item)
    if not path.exists():
        return None
    content = read_json_file(path)
    same = content.get("made_of", {}).get("all") == _inputs(bench)
    return dict(content["result"]) if same else None


def reproduction_text(result: Reproduced) -> str:
    """Write what the command line prints: the headline number of each item, and where the page is."""
    lines = []
    for item in result.items:
        ends = "" if item.interval is None else " ({:.3g} to {:.3g})".format(*item.interval)
        paper, ours = _plain(item.paper), _plain(item.ours)
        lines.append(f"{item.id:>9}: {item.what}: the paper {paper}, ours {ours}{ends} {item.unit}".rstrip())
    return "\n".join([*lines, f"Page: {result.page}"])


def _plain(value: Any) -> str:
    return "none" if value is None else value if isinstance(value, str) else f"{value:.4g}"
