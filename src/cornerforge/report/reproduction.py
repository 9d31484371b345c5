"""The page of `reproduce`: figures and tables from `items.json`, nothing computed anew.

An item without a renderer of its own is shown as its table; `RENDERERS` lists the items with pictures.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

from cornerforge._files import writing
from cornerforge.errors import MissingExtraError, OutputError
from cornerforge.ndd.drawing import check_matplotlib, png_of, svg_of
from cornerforge.report import text
from cornerforge.report.reader import Reader, read_json
from cornerforge.report.reproduction_clusters import cluster_pictures, example_pictures, period_pictures
from cornerforge.report.reproduction_figures import (
    Picture,
    crash_type_pictures,
    exposure_pictures,
    matrix_pictures,
    training_pictures,
)
from cornerforge.report.tables import Table

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


@dataclass(frozen=True)
class _Section:
    """One item as the template takes it."""

    id: str
    title: str
    place: str
    says: str
    headline: str
    pictures: list[tuple[str, str]]
    notes: list[str]
    table: Table
    is_long: bool


def check_reproduction() -> None:
    """Check, before long work, that the page can be made.

    Raises:
        MissingExtraError: matplotlib or jinja2 is not installed.
    """
    check_matplotlib()
    try:
        import jinja2  # noqa: F401
    except ImportError:
        raise MissingExtraError("jinja2", "report") from None


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
    file = read_json(out / "items.json", COMMAND)
    made = read_json(out / "provenance.json", COMMAND)
    try:
        sections = [_section(item, out / "figures") for item in file.children("items")]
        page = _render(file, made, sections)
        with writing(out / "index.html") as part:
            part.write_text(page, encoding="utf-8", newline="\n")
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{out} cannot be written: {error.strerror}; choose another --out.") from None
    return out / "index.html"


def _section(item: Reader, folder: Path) -> _Section:
    name = item.text("id")
    drawn = RENDERERS[name](item.child("data").values) if name in RENDERERS else []
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    for picture in drawn:
        png = png_of(picture.drawing)
        (folder / f"{picture.name}.png").write_bytes(png)
        (folder / f"{picture.name}.svg").write_bytes(svg_of(picture.drawing))
        pictures.append((base64.b64encode(png).decode("ascii"), picture.caption))
    rows = item.children("rows")
    return _Section(
        id=name,
        title=item.text("title"),
        place=item.text("place"),
        says=item.text("says"),
        headline=_headline(item),
        pictures=pictures,
        notes=item.texts("notes"),
        table=_table(item.text("title"), rows),
        is_long=len(rows) > 16,
    )


def _headline(item: Reader) -> str:
    paper, ours = (_value(item.values.get(key)) for key in ("paper", "ours"))
    unit = f" {item.text('unit')}" if item.text("unit") else ""
    ends = _ends(item)
    note = f"; {item.text('note').rstrip('.')}" if item.text("note") else ""
    return (
        f"{item.text('what')}: the paper {paper}, ours {ours}{unit}{f' (95 % interval {ends})' if ends else ''}{note}."
    )


def _table(title: str, rows: list[Reader]) -> Table:
    head = ["quantity", "the paper", "ours", "95 % interval", "unit", "note"]
    cells = [
        [
            row.text("what"),
            _value(row.values.get("paper")),
            _value(row.values.get("ours")),
            _ends(row),
            row.text("unit"),
            row.text("note"),
        ]
        for row in rows
    ]
    return Table(title, head, cells)


def _value(value: Any) -> str:
    """A number, a text, or a dash."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    if float(value).is_integer() and abs(value) < 1e12:
        return text.count(value)
    return ("−" if value < 0 else "") + text.rate(abs(value))


def _ends(row: Reader) -> str:
    if not row.has("interval"):
        return ""
    low, high = row.numbers("interval", 2)
    return f"{_value(low)} to {_value(high)}"


def _render(file: Reader, made: Reader, sections: list[_Section]) -> str:
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cornerforge.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style = resources.files("cornerforge.report").joinpath("templates", "report.css").read_text(encoding="utf-8")
    return environment.get_template("reproduction.html.j2").render(
        sections=sections,
        effort=file.text("effort"),
        seed=file.count("seed"),
        version=made.text("cornerforge"),
        command=made.text("command"),
        identity={key: value for key, value in made.child("identity").values.items() if not isinstance(value, dict)},
        machine=made.child("machine").values,
        # Marked as safe is our own file, nothing else.
        style=Markup(style),
    )
