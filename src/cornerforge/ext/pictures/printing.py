"""Figures for papers: of a column's or a page's width, 8 pt text at that size, fonts embedded, the same bytes again.

PDF holds the font itself (Type 42, so that text can be searched and edited); SVG holds letters as paths, because a
viewer that lacks the font would put another in its place, with other widths.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from cornerforge.errors import InputError
from cornerforge.report.drawing import check_matplotlib

__all__ = ["FORMATS", "POINTS", "WIDTHS", "check_print", "print_of", "printed", "width_named"]

WIDTHS = {"column": 3.5, "page": 7.16}
"""Widths of a column and of a page with two columns [in]: IEEE's, and nearly other publishers'."""
POINTS = 8.0
"""Size of all text [pt]."""
FORMATS = (".pdf", ".svg")
_STYLE: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib, so it is everywhere the same
    "font.size": POINTS,
    **dict.fromkeys(
        (
            "axes.titlesize",
            "axes.labelsize",
            "xtick.labelsize",
            "ytick.labelsize",
            "legend.fontsize",
            "figure.titlesize",
        ),
        POINTS,
    ),
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "grid.linewidth": 0.4,
    "grid.color": "#dddddd",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "cornerforge",  # without it element ids are random
}


def check_print(path: Path) -> None:
    """Check, before long work, that a figure of this name can be made.

    Raises:
        InputError: The name ends neither in .pdf nor in .svg.
        MissingExtraError: matplotlib is not installed.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path} ends neither in .pdf nor in .svg; name the figure with one of them.")
    check_matplotlib()


def width_named(name: str) -> float:
    """Look up a width [in].

    Raises:
        InputError: No width has that name.
    """
    if name not in WIDTHS:
        raise InputError(f'No width "{name}"; choose {" or ".join(WIDTHS)}.')
    return WIDTHS[name]


@contextmanager
def printed() -> Iterator[None]:
    """Set the style of figures for papers; draw and save within it.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    check_matplotlib()
    import matplotlib

    with matplotlib.rc_context(cast(Any, _STYLE)):
        yield


def print_of(drawing: Any, suffix: str) -> bytes:
    """Return a figure that was drawn within `printed` as PDF or SVG, without program, machine or time.

    Args:
        drawing: Figure of matplotlib.
        suffix: One of `FORMATS`.
    """
    with io.BytesIO() as file, printed():
        if suffix == ".pdf":
            from matplotlib.backends.backend_pdf import FigureCanvasPdf

            FigureCanvasPdf(drawing)
            nothing = dict.fromkeys(("Creator", "Producer", "CreationDate"))
            drawing.savefig(file, format="pdf", metadata=nothing)
        else:
            from matplotlib.backends.backend_svg import FigureCanvasSVG

            FigureCanvasSVG(drawing)
            drawing.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
        return file.getvalue()
