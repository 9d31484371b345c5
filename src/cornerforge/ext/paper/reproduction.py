"""The page of `reproduce`: figures and tables from `items.json`, nothing computed again.

An item without a renderer of its own is shown as its table; `RENDERERS` lists the items with pictures.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from cornerforge._files import write_bytes
from cornerforge._schema import Declared
from cornerforge.ext.paper.reproduction_clusters import cluster_pictures, example_pictures, period_pictures
from cornerforge.ext.paper.reproduction_figures import (
    Picture,
    crash_type_pictures,
    exposure_pictures,
    matrix_pictures,
    training_pictures,
)
from cornerforge.report import text
from cornerforge.report.drawing import check_matplotlib, png_of, svg_of
from cornerforge.report.rendering import environment, template, write_page
from cornerforge.report.tables import Table
from cornerforge.results.reproduction import PaperItem, PaperRow
from cornerforge.results.stating import from_file

__all__ = ["RENDERERS", "check_reproduction", "write_reproduction"]

COMMAND = "cornerforge reproduce --resume"
RENDERERS: dict[str, Callable[[Mapping[str, Any]], list[Picture]]] = {
    "figure2": training_pictures,
    "figure3": exposure_pictures,
    "figure5": crash_type_pictures,
    "figure6": partial(example_pictures, name="figure6", of="crash type"),
    "figure7": period_pictures,
    "figure8": partial(cluster_pictures, name="figure8"),
    "figure9": partial(example_pictures, name="figure9", of="cluster"),
    "figure10": partial(cluster_pictures, name="figure10"),
    "figure11": partial(example_pictures, name="figure11", of="cluster"),
    "matrix": matrix_pictures,
}
"""Item id to what draws its `data`."""


class _Item(PaperItem):
    """An item as `items.json` holds it."""

    says: str
    data: dict[str, Any]
    notes: tuple[str, ...]


class _Items(Declared):
    """Part of `items.json` that the page shows."""

    effort: str
    seed: int
    items: tuple[_Item, ...]


class _Made(Declared):
    """Part of `provenance.json` that the page shows."""

    cornerforge: str
    command: str
    identity: dict[str, Any]
    machine: dict[str, Any]


def check_reproduction() -> None:
    """Check, before long work, that the page can be made.

    Raises:
        MissingExtraError: matplotlib or jinja2 is not installed.
    """
    check_matplotlib()
    environment()


def write_reproduction(out: Path) -> Path:
    """Write `figures/*.png`, `figures/*.svg` and `index.html`, which opens from disk and asks nothing from the network.

    Args:
        out: Folder with the `items.json` of `reproduce`.

    Returns:
        The path of the page.

    Raises:
        FileFormatError: `items.json` is missing or damaged.
        MissingExtraError: matplotlib or jinja2 is not installed.
        OutputError: A file cannot be written.
    """
    check_reproduction()
    found = from_file(_Items, out / "items.json", COMMAND)
    made = from_file(_Made, out / "provenance.json", COMMAND)
    sections = [_section(item, out / "figures") for item in found.items]
    return write_page(_render(found, made, sections), out / "index.html")


def _section(item: _Item, folder: Path) -> dict[str, Any]:
    """Draw an item's pictures, and give what the template takes."""
    drawn = RENDERERS[item.id](item.data) if item.id in RENDERERS else []
    pictures = []
    for picture in drawn:
        png = png_of(picture.drawing)
        write_bytes(folder / f"{picture.name}.png", png)
        write_bytes(folder / f"{picture.name}.svg", svg_of(picture.drawing))
        pictures.append((base64.b64encode(png).decode("ascii"), picture.caption))
    return {"item": item, "headline": _headline(item), "pictures": pictures, "table": _table(item)}


def _headline(item: PaperItem) -> str:
    unit = f" {item.unit}" if item.unit else ""
    ends = _ends(item)
    note = f"; {item.note.rstrip('.')}" if item.note else ""
    return (
        f"{item.what}: the paper {_value(item.paper)}, ours {_value(item.ours)}{unit}"
        f"{f' (95 % interval {ends})' if ends else ''}{note}."
    )


def _table(item: PaperItem) -> Table:
    head = ["quantity", "the paper", "ours", "95 % interval", "unit", "note"]
    cells = [[row.what, _value(row.paper), _value(row.ours), _ends(row), row.unit, row.note] for row in item.rows]
    return Table(item.title, head, cells)


def _value(value: float | str | None) -> str:
    """A number, a text, or a dash."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    if float(value).is_integer() and abs(value) < 1e12:
        return text.count(value)
    return ("−" if value < 0 else "") + text.rate(abs(value))


def _ends(row: PaperItem | PaperRow) -> str:
    return "" if row.interval is None else " to ".join(map(_value, row.interval))


def _render(found: _Items, made: _Made, sections: list[dict[str, Any]]) -> str:
    pages = environment()
    from markupsafe import Markup

    page: str = pages.get_template("reproduction.html.j2").render(
        sections=sections,
        effort=found.effort,
        seed=found.seed,
        version=made.cornerforge,
        command=made.command,
        identity={key: value for key, value in made.identity.items() if not isinstance(value, dict)},
        machine=made.machine,
        # Marked as safe is our own file, nothing else.
        style=Markup(template("report.css")),
    )
    return page
