"""Options of the paper's figures: `reproduce`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cornerforge._options import Command, LongWork, Resumable
from cornerforge._schema import meant
from cornerforge.world_options import RoadOptions

__all__ = ["COMMANDS", "Reproduce"]

_ITEMS = ("table1", "figure2", "figure3", *(f"figure{number}" for number in range(5, 12)), "matrix", "timings")


class Reproduce(RoadOptions, Resumable, LongWork):
    """Make the paper's figures and tables again, ours beside theirs, on one page."""

    out: Annotated[Path | str, meant("Folder for the page, figures, numbers and policies.")]
    figures: Annotated[
        Sequence[str] | None,
        meant(
            "table1, figure2, figure3, figure5 to figure11, matrix, timings; all by default.",
            name="--figure", metavar="ID...", near=_ITEMS, many=True,
        ),
    ] = None  # fmt: skip
    effort: Annotated[
        str | None,
        meant(
            "quick (ten minutes on 2 cores), standard (an hour or more) or full (hours).",
            near=("quick", "standard", "full"), default="standard",
        ),
    ] = None  # fmt: skip
    budget: Annotated[
        float | None,
        meant(
            "How far bounded adversaries may fall short of the likeliest actions in a test; no limit by default. "
            "With 8 and --odd paper they cut in as in Figures 10 and 11.",
            unit="nats",
        ),
    ] = None
    paper_policy: Annotated[Path | str | None, meant("A policy of preset paper, for Figure 2.")] = None
    avs: Annotated[
        Sequence[str],
        meant("AV for the matrix besides the built-in ones; give it again for more.", name="--more-av"),
    ] = ()


COMMANDS = (
    Command(
        Reproduce, "ext.paper.reproduce:reproduce", "ext.paper.reproduce:reproduction_text",
        ("cornerforge reproduce --effort quick --figure table1 --out out/paper",),
    ),
)  # fmt: skip
