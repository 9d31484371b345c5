"""`reproduce` makes the paper's figures and tables again, item by item, with our values beside the paper's."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Unpack

from cornerforge._arguments import checked
from cornerforge._checks import check_in, check_integer
from cornerforge._locks import claims
from cornerforge.execution.progress import NO_PROGRESS, Progress
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
from cornerforge.ext.paper.item import Item
from cornerforge.ext.paper.registry import ITEMS
from cornerforge.ndd.model import model_hash
from cornerforge.results import Reproduced, from_json
from cornerforge.results.reproduction import PaperItem
from cornerforge.world_options import RoadKeywords, WorldOptions

__all__ = ["REPRODUCE_EFFORTS", "reproduce", "reproduction_text"]

_SHOWN = tuple(one.name for one in fields(PaperItem))


@checked
@claims()
def reproduce(
    *,
    out: Path | str,
    figures: Sequence[str] | None = None,
    effort: str | None = None,
    paper_policy: Path | str | None = None,
    avs: Sequence[str] = (),
    resume: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
    **world: Unpack[RoadKeywords],
) -> Reproduced:
    """Make the paper's figures and tables again, and a page that shows ours beside theirs.

    `OUT` then holds `index.html`, `figures/` (PNG and SVG), `items.json`, `provenance.json`, and what is kept to go on
    with: `policies/`, `parts/`, `items/`, `libraries/`.

    Args:
        out: Folder for everything; must be new or empty unless `resume`.
        figures: Ids of items, such as "figure3"; None for all. The page shows them and those made earlier.
        effort: "quick", "standard" or "full" (see `REPRODUCE_EFFORTS`); None: "standard".
        paper_policy: A policy of preset `paper`, for Figure 2; None to leave that curve out.
        avs: AVs that the matrix shows besides the built-in ones: files of `train-av`, or AVs from outside.
        resume: Go on with what is in `out`: finished items, measurements and policies are kept as long as what they
            were made of is the same (policies even after changes of code), and an unfinished training goes on.
        seed: 0 or more; the k-th training of a kind has seed + k.
        threads: None for all cores; does not change the result, timings excepted.
        progress: Told how far it is.
        world: The world, keyword by keyword; see `WorldOptions`.

    Returns:
        What `cornerforge reproduce --json` prints.

    Raises:
        CornerForgeError: Input, files or output place are not right; an extra is missing.
    """
    from cornerforge.ext.paper.reproduction import check_reproduction, write_reproduction

    start = time.perf_counter()
    folder = Path(out)
    effort = check_in("effort", effort or "standard", tuple(REPRODUCE_EFFORTS))
    size = REPRODUCE_EFFORTS[effort]
    check_integer("seed", seed, low=0, high=2**32 - 1)
    wanted = [ITEMS[check_in("figure", name, tuple(ITEMS))] for name in (ITEMS if figures is None else figures)]
    bench = Bench(
        folder, size, WorldOptions(**world), seed=seed, threads=threads, progress=progress,
        paper_policy=None if paper_policy is None else Path(paper_policy), more_avs=avs,
    )  # fmt: skip
    run = bench.experiment("idm-mobil")
    check_reproduction()
    identity = {
        "seed": seed,
        "effort": effort,
        "odd": run.odd.name,
        "lanes": run.odd.n_lanes,
        "model_hash": model_hash(run.model),
        "config_hash": config_hash({"size": asdict(size), "odd": run.odd.stated()}),
        "cornerforge": version(),
    }
    open_output(folder, identity, resume=resume)
    for item in wanted:
        _made(bench, item)
    items = [found for item in ITEMS.values() if (found := _finished(bench, item)) is not None]
    write_json(folder / "items.json", {"effort": effort, "seed": seed, "items": items})
    seconds = round(time.perf_counter() - start, 3)
    more = {"code": code_hash(), "avs": _av_hashes(bench)}
    write_json(folder / "provenance.json", provenance({**identity, **more}, seconds))
    page = write_reproduction(folder)
    names = [item.id for item in wanted]
    shown = [from_json(PaperItem, {key: item[key] for key in _SHOWN}) for item in items if item["id"] in names]
    return Reproduced(items=tuple(shown), out=str(folder), page=str(page), effort=effort, seed=seed, seconds=seconds)


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
