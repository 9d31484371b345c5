"""Items of the paper: where the paper has it, what it says, how ours is computed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from cornerforge.ext.paper.bench import Bench

__all__ = ["Finding", "Item", "Row", "Value", "nothing"]

Value: TypeAlias = float | int | str | None


@dataclass(frozen=True)
class Row:
    """One number of the paper beside ours.

    Attributes:
        what: The quantity, in words.
        paper: The paper's value as its text states it; None where the text states none (a picture is not read off).
        ours: Our value; None without a number; `note` then says why.
        interval: Ends of our 95 % interval, or None for what is exact or a single timing.
        unit: Unit of `paper`, `ours` and `interval`; empty for texts and plain numbers.
        note: What a reader must know to compare the two.
    """

    what: str
    paper: Value
    ours: Value
    interval: tuple[float, float] | None = None
    unit: str = ""
    note: str = ""


@dataclass(frozen=True)
class Finding:
    """Our result for an item.

    Attributes:
        headline: The row that stands for the item.
        rows: All rows, the headline's quantity among them where it is one of many.
        data: What the figures are drawn from, JSON-compatible; its shape is between the item and its renderer.
        notes: Sentences for the page: definitions, and why ours differ.
    """

    headline: Row
    rows: list[Row] = field(default_factory=list)
    data: Mapping[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """The headline's keys (`what`, `paper`, `ours`, `interval`, `unit`, `note`), then rows, data and notes."""
        rows = [asdict(row) for row in self.rows]
        return {**asdict(self.headline), "rows": rows, "data": dict(self.data), "notes": list(self.notes)}


def nothing(what: str, paper: Value, why: str, unit: str = "") -> Finding:
    """Make the result of an item that has none, and say why."""
    row = Row(what, paper, None, None, unit, why)
    return Finding(row, [row], {}, [why])


@dataclass(frozen=True)
class Item:
    """A figure, table or claim of the paper.

    Attributes:
        id: What `reproduce --figure` calls it; its renderer in `ext/paper/reproduction.py` has the same key.
        title: For the page.
        place: Where the paper has it (the preprint's text has no page numbers: table, figure and section).
        says: What the paper says there, in our words.
        compute: Ours, from a bench.
        inputs: What else than code, effort, seed and world decides the result, from a bench; JSON-compatible.
    """

    id: str
    title: str
    place: str
    says: str
    compute: Callable[[Bench], Finding]
    inputs: Callable[[Bench], dict[str, Any]] = field(default=lambda bench: {})  # noqa: ARG005
