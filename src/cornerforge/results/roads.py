"""Result of `road import`, `road check` and `road show`."""

from __future__ import annotations

from typing import Annotated

from cornerforge._schema import meant
from cornerforge.results.html import Result

__all__ = ["LaneTold", "RoadTold"]


class LaneTold(Result):
    """One lane of a road."""

    slot: Annotated[int, meant("Place from the right edge, from 0.")]
    kind: Annotated[str, meant("through, acceleration, deceleration or closed.")]
    begin_m: Annotated[float, meant("Where it begins to have its full width.", "m")]
    end_m: Annotated[float, meant("Where it ceases to.", "m")]
    limit_mps: Annotated[float | None, meant("Speed limit; null: none is known.", "m/s")]


class RoadTold(Result):
    """A road: its length, its tightest curve and its lanes."""

    name: Annotated[str, meant("Its name.")]
    length_m: Annotated[float, meant("Length of its reference line.", "m")]
    slots: Annotated[int, meant("Lanes side by side, at most.")]
    lane_width_m: Annotated[float, meant("Width of each in the simulator.", "m")]
    tightest_m: Annotated[float | None, meant("Radius of its tightest curve; null: it is straight.", "m")]
    lanes: Annotated[tuple[LaneTold, ...], meant("Its lanes.")]
    notes: Annotated[tuple[str, ...], meant("What its source holds and it does not.")]
    faults: Annotated[tuple[str, ...], meant("Why it cannot be driven; none: it can.")]
    files: Annotated[tuple[str, ...], meant("Files that were written.")]
