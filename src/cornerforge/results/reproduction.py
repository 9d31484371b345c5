"""The result of `reproduce`."""

from __future__ import annotations

from dataclasses import dataclass, field

from cornerforge.results.rates import Interval
from cornerforge.results.stating import meant

__all__ = ["PaperItem", "PaperRow", "Reproduced"]

_WHAT = meant("The quantity, in words.")
_UNIT = meant("Of the numbers.")
_PAPER = meant("The paper's value; null: its text gives none.", "`unit`")
_OURS = meant("Our value; null: none, `note` says why.", "`unit`")
_INTERVAL = meant("Our 95 % interval; null: exact, a single timing, or no value.", "`unit`")
_NOTE = meant("What to know for the comparison; may be empty.")


@dataclass(frozen=True, kw_only=True)
class PaperRow:
    """One number of the paper beside ours."""

    what: str = field(metadata=_WHAT)
    paper: float | str | None = field(metadata=_PAPER)
    ours: float | str | None = field(metadata=_OURS)
    interval: Interval | None = field(metadata=_INTERVAL)
    unit: str = field(metadata=_UNIT)
    note: str = field(metadata=_NOTE)


@dataclass(frozen=True, kw_only=True)
class PaperItem:
    """A figure or table of the paper beside ours, with the number that stands for it."""

    id: str = field(metadata=meant("Its name for `--figure`."))
    title: str = field(metadata=meant("Title on the page."))
    place: str = field(metadata=meant("Where the paper has it."))
    what: str = field(metadata=_WHAT)
    unit: str = field(metadata=_UNIT)
    paper: float | str | None = field(metadata=_PAPER)
    ours: float | str | None = field(metadata=_OURS)
    interval: Interval | None = field(metadata=_INTERVAL)
    note: str = field(metadata=_NOTE)
    rows: tuple[PaperRow, ...] = field(metadata=meant("All numbers."))
    seconds: float = field(metadata=meant("Wall-clock of its making.", "s"))


@dataclass(frozen=True, kw_only=True)
class Reproduced:
    """Figures and tables of the paper, ours beside theirs."""

    items: tuple[PaperItem, ...] = field(metadata=meant("The items that were asked for."))
    out: str = field(metadata=meant("Folder of everything."))
    page: str = field(metadata=meant("File of the page."))
    effort: str = field(metadata=meant("quick, standard or full."))
    seed: int = field(metadata=meant("Seed of everything."))
    seconds: float = field(metadata=meant("Wall-clock of this call.", "s"))
