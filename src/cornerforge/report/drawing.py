"""Figures by matplotlib and plain pages, the same bytes for the same numbers; no window, no global state.

Colours are Okabe and Ito's, which colour-blind people can tell apart; line styles carry the same meaning.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape
from typing import Any

from cornerforge.errors import MissingExtraError, printable

__all__ = [
    "BLUE",
    "GREEN",
    "GREY",
    "ORANGE",
    "Bad",
    "check_matplotlib",
    "inline",
    "new_figure",
    "page",
    "png_of",
    "svg_of",
    "table",
]

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
_STYLE = """
:root {
  color-scheme: light dark;
  --ink: #1b1f24; --muted: #5d6673; --paper: #ffffff; --line: #dddddd; --plate: #f6f6f6; --bad: #b00020;
}
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e9ec; --muted: #a0a9b4; --paper: #1c2126; --line: #343b43; --plate: #14181c; --bad: #ff6b6b; }
  img { filter: invert(0.88) hue-rotate(180deg); } /* figures are drawn on white */
}
body {
  font: 15px/1.5 system-ui, sans-serif; max-width: 64em; margin: 2em auto; padding: 0 1em;
  color: var(--ink); background: var(--paper);
}
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: .5em 0; font-variant-numeric: tabular-nums; }
td, th { padding: .2em .8em; border-bottom: 1px solid var(--line); text-align: right; vertical-align: top; }
td:first-child, th:first-child { text-align: left; }
pre { background: var(--plate); padding: 1em; overflow: auto; }
img { max-width: 100%; height: auto; }
figure { margin: 1em 0; }
figcaption, .sources { color: var(--muted); }
.bad { color: var(--bad); font-weight: 600; }
.dense { font-size: 12.5px; }
.dense td, .dense th { padding: .15em .45em; }
.sources { font-size: 13px; }
code { overflow-wrap: anywhere; }
@media (max-width: 640px) {
  body { margin: 1em auto; }
  h1 { font-size: 1.4rem; overflow-wrap: anywhere; }
  td, th { padding: .2em .5em; font-size: 13px; }
}
@media print {
  :root {
    color-scheme: light;
    --ink: #1b1f24; --muted: #5d6673; --paper: #ffffff; --line: #dddddd; --plate: #f6f6f6; --bad: #b00020;
  }
  img { filter: none; }
  body { max-width: none; margin: 0; padding: 0; }
  figure, tr { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  .scroll { overflow: visible; }
}
"""


def check_matplotlib() -> None:
    """Check that figures can be drawn.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise MissingExtraError("matplotlib", "report") from None


def new_figure(rows: int, columns: int, width: float, height: float) -> tuple[Any, list[Any]]:
    """Make a figure of `width` x `height` inches; return it and its panels, row by row.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(width, height), layout="constrained")
    panels = [drawing.add_subplot(rows, columns, number + 1) for number in range(rows * columns)]
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
        panel.tick_params(labelsize=8)
        panel.grid(color="#e6e6e6", linewidth=0.6)
        panel.set_axisbelow(True)
    return drawing, panels


def png_of(drawing: Any) -> bytes:
    """Return the figure as PNG, without machine or time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(drawing)
    with io.BytesIO() as file:
        drawing.savefig(file, format="png", dpi=120, metadata={"Software": None})
        return file.getvalue()


def svg_of(drawing: Any) -> bytes:
    """Return the figure as SVG, with text as text, without machine or time."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    FigureCanvasSVG(drawing)
    # Without a salt element ids are random.
    with io.BytesIO() as file, matplotlib.rc_context({"svg.hashsalt": "cornerforge", "svg.fonttype": "none"}):
        drawing.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
        return file.getvalue()


def inline(png: bytes, caption: str) -> str:
    """Return an HTML figure that contains the picture's data."""
    code = base64.b64encode(png).decode("ascii")
    text = escape(caption)
    return f'<figure><img alt="{text}" src="data:image/png;base64,{code}"><figcaption>{text}</figcaption></figure>'


class Bad(str):
    """Text of a cell that a table shows in the colour of what is wrong."""


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return an HTML table; cells are escaped. Long file names in the head may break after an underscore."""
    cells = "".join(f"<th>{escape(text).replace('_', '_<wbr>')}</th>" for text in head)
    lines = ["<tr>" + "".join(_cell(cell) for cell in row) + "</tr>" for row in rows]
    return f'<div class="scroll" tabindex="0"><table><tr>{cells}</tr>{"".join(lines)}</table></div>'


def _cell(cell: object) -> str:
    text = escape(str(cell)).replace("\n", "<br>")
    return f'<td class="bad">{text}</td>' if isinstance(cell, Bad) else f"<td>{text}</td>"


def page(title: str, body: str) -> str:
    """Return a self-contained HTML page; what is not seen in it is escaped."""
    return printable(
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body>{body}</body></html>\n"
    )
