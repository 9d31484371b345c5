"""The result of `reproduce`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import Whole, meant
from cornerforge.results.html import Result
from cornerforge.results.rates import Interval

__all__ = ["PaperItem", "PaperRow", "Reproduced"]

_WHAT = meant("The quantity, in words.")
_UNIT = meant("Of the numbers.")
_PAPER = meant("The paper's value; null: its text gives none.", "`unit`")
_OURS = meant("Our value; null: none, `note` says why.", "`unit`")
_INTERVAL = meant("Our 95 % interval; null: exact, a single timing, or no value.", "`unit`")
_NOTE = meant("What to know for the comparison; may be empty.")


class PaperRow(Result):
    """One number of the paper beside ours."""

    what: Annotated[str, _WHAT]
    paper: Annotated[float | str | None, _PAPER]
    ours: Annotated[float | str | None, _OURS]
    interval: Annotated[Interval | None, _INTERVAL]
    unit: Annotated[str, _UNIT]
    note: Annotated[str, _NOTE]


class PaperItem(Result):
    """A figure or table of the paper beside ours, with the number that stands for it."""

    id: Annotated[str, meant("Its name for `--figure`.")]
    title: Annotated[str, meant("Title on the page.")]
    place: Annotated[str, meant("Where the paper has it.")]
    what: Annotated[str, _WHAT]
    unit: Annotated[str, _UNIT]
    paper: Annotated[float | str | None, _PAPER]
    ours: Annotated[float | str | None, _OURS]
    interval: Annotated[Interval | None, _INTERVAL]
    note: Annotated[str, _NOTE]
    rows: Annotated[tuple[PaperRow, ...], meant("All numbers.")]
    seconds: Annotated[float, meant("Wall-clock of its making.", "s")]


class Reproduced(Result):
    """Figures and tables of the paper, ours beside theirs."""

    items: Annotated[tuple[PaperItem, ...], meant("The items that were asked for.")]
    out: Annotated[str, meant("Folder of everything.")]
    page: Annotated[str, meant("File of the page.")]
    effort: Annotated[str, meant("quick, standard or full.")]
    seed: Annotated[Whole, meant("Seed of everything.")]
    seconds: Annotated[float, meant("Wall-clock of this call.", "s")]
