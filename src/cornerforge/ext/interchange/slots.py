"""Lanes of other people's roads, put into slots: looked at place by place along the travel."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cornerforge.errors import DataError
from cornerforge.road.network import Lane, LaneKind, Marking

__all__ = ["FULL", "SHIFT", "Seen", "slots_of"]

FULL = 2.5
"""Width from which a lane can be driven [m]."""
SHIFT = 0.3
"""The middle of a lane may move sideways by so much [m]."""
_SHORTEST = 20.0
"""A lane must have its full width for so far [m]."""


@dataclass(frozen=True)
class Seen:
    """A lane at a place.

    Attributes:
        place: What it is and where it stands in the file, for messages.
        middle: Left of the reference line [m].
        width: [m].
        kind, limit: As of `road.network.Lane`.
        left, right: Whether its lines may be crossed there.
    """

    place: str
    middle: float
    width: float
    kind: LaneKind
    limit: float | None
    left: bool
    right: bool


def slots_of(
    places: Sequence[float], seen: Sequence[Sequence[Seen]]
) -> tuple[tuple[float, ...], tuple[Lane, ...], float]:
    """Put lanes into slots; a closed lane counts where an open one goes on in its place.

    Args:
        places: Along the travel, ascending [m].
        seen: The lanes of full width at each place.

    Returns:
        The middle of each slot, from the right edge; the lanes by slot and begin; the width of a slot in the simulator
        [m]. Nothing where no lane is driven.

    Raises:
        DataError: A lane shifts sideways by more than 0.3 m.
    """
    driven = {round(one.middle, 1) for row in seen for one in row if one.kind != "closed"}
    if not driven:
        return (), (), 0.0
    rows = [
        [one for one in row if one.kind != "closed" or min(abs(one.middle - middle) for middle in driven) <= SHIFT]
        for row in seen
    ]
    slots = [(one.middle, one.width) for one in max(rows, key=len)]
    for row in rows:
        for one in row:
            off, full = min((abs(one.middle - middle), full) for middle, full in slots)
            if off > 0.5 * one.width:
                slots.append((one.middle, one.width))
            elif off > SHIFT + 0.5 * abs(full - one.width):  # where a lane becomes narrower its middle moves
                raise DataError(f"{one.place} shifts sideways by {off:.2f} m: not represented.")
    centres = sorted(middle for middle, _ in slots)
    lanes: list[Lane] = []
    for slot, centre in enumerate(centres):
        run: list[tuple[float, Seen]] = []
        for place, row in zip([*places, places[-1]], [*rows, []], strict=True):
            here = next((one for one in row if abs(one.middle - centre) <= 0.5 * one.width), None)
            if here is not None:
                run.append((place, here))
            else:
                lanes += _lanes_of(slot, run)
                run = []
    width = float(np.mean(np.diff(centres))) if len(centres) > 1 else slots[0][1]
    return tuple(centres), tuple(lanes), round(width, 4)


def _lanes_of(slot: int, run: Sequence[tuple[float, Seen]]) -> list[Lane]:
    """Make the lanes of a stretch on which a slot holds some: a new one where kind or limit changes."""
    if not run or run[-1][0] - run[0][0] < _SHORTEST:
        return []
    kinds = [(seen.kind, seen.limit) for _, seen in run]
    cuts = sorted({0, *(k for k in range(1, len(run)) if kinds[k] != kinds[k - 1]), len(run) - 1})
    made = []
    for first, last in itertools.pairwise(cuts):
        part = run[first : last + 1]
        left = _marking([(place, seen.left) for place, seen in part[: last - first]])
        right = _marking([(place, seen.right) for place, seen in part[: last - first]])
        made.append(Lane(slot, part[0][0], part[-1][0], *kinds[first], left, right))
    return made


def _marking(may: Sequence[tuple[float, bool]]) -> tuple[Marking, ...]:
    """Make the line of a side of where it may be crossed; none if it may be all along."""
    begins = [k for k in range(len(may)) if k == 0 or may[k][1] != may[k - 1][1]]
    return tuple(Marking(*may[k]) for k in begins) if not all(one for _, one in may) else ()
