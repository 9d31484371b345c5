"""Options of pictures for print: `figure`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork
from cornerforge._schema import meant

__all__ = ["COMMANDS", "Figure"]


class Figure(LongWork):
    """Draw for a paper: the charts of the page, or a case as a strip of snapshots."""

    place: Annotated[Path | str, meant("A library, or a folder of run or rate.", metavar="LIB|RUN")] = field(
        kw_only=False
    )
    case: Annotated[
        str | None,
        meant(
            "Draw this case as a strip of snapshots, instead of the charts of the page; natural/ID for a natural case "
            "of a run."
        ),
    ] = field(kw_only=False, default=None)
    out: Annotated[
        Path | str | None,
        meant("Folder for the charts; new file .pdf or .svg for a case. Without it charts are only listed."),
    ] = None
    listing: Annotated[bool, meant("Only tell which charts there may be.", name="--list")] = False
    times: Annotated[
        str | Sequence[float] | None,
        meant("Seconds of the snapshots, such as -3,-2,-1,0; 0 is the contact. By default what matters in the case."),
    ] = None
    figures: Annotated[
        Sequence[str] | None, meant("Chart; may be given again. All by default.", name="--figure", metavar="NAME")
    ] = None
    file_format: Annotated[str, meant("Of charts: pdf or svg.", name="--format", near=("pdf", "svg"))] = "pdf"
    width: Annotated[str, meant("column (3.5 in) or page (7.16 in).", near=("column", "page"))] = "column"


COMMANDS = (
    Command(
        Figure, "ext.pictures.figure:figure", "ext.pictures.figure:figure_text",
        (
            "cornerforge figure out/demo --out out/figures --format svg",
            "cornerforge figure out/demo/library 0:0 --times -3,-2,-1,0 --out out/crash.pdf",
        ),
    ),
)  # fmt: skip
