"""A road along which lanes begin and end: one reference line, lanes side by side in slots, and the world's plane.

Slots are numbered from 0 at the right edge, like the lanes of the straight road. A lane lies in one slot from where it
begins to where it ends; another may follow it there. In a slot two axes are the same but for the width: y is the
simulator's, in which all slots are equally wide and the right edge is 0; `d` is the world's, metres left of the
reference line.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from cornerforge._schema import meant
from cornerforge.road.reference import Piece, Pose, ReferenceLine

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["GAP", "KINK", "LANE_KINDS", "MOST_LANES", "Lane", "LaneKind", "Marking", "Road", "faults_of"]

LaneKind = Literal["through", "acceleration", "deceleration", "ramp", "closed"]
LANE_KINDS: dict[LaneKind, str] = {
    "through": "goes on, or ends where the road becomes narrower",
    "acceleration": "begins at a ramp and ends: its traffic must merge",
    "deceleration": "leads to an exit: where it ends, its traffic has left the road",
    "ramp": "runs to an acceleration lane, or from an exit, beside the road: none may change into it or out of it",
    "closed": "must not be driven in, as in a work zone",
}
"""Kind of a lane, and what that means."""
_WIDTHS = (2.0, 6.0)
"""Widths of lanes that can be driven [m]."""
_MOST_SLOTS, MOST_LANES = 6, 8
"""Most lanes side by side, and one after the other."""
GAP, KINK = 0.05, 0.02
"""A reference line may have gaps and kinks of so much [m, rad]."""
_TIGHTEST = 100.0
"""Radius below which a road is no motorway [m]; ramps may have it, through lanes not."""


@dataclass(frozen=True)
class Marking:
    """The line along a side of a lane, from a place on.

    Attributes:
        s: From where on [m].
        may_cross: A vehicle in this lane may cross it.
    """

    s: Annotated[float, meant("From where on.", "m")]
    may_cross: Annotated[bool, meant("A vehicle in this lane may cross it.")]


@dataclass(frozen=True)
class Lane:
    """A lane in one slot.

    Attributes:
        slot: From 0 at the right edge.
        begin, end: From where to where it has its full width, along the reference line [m].
        kind: One of `LANE_KINDS`.
        limit: Speed limit [m/s]; None: none is known.
        left, right: Lines at its sides, by s; empty: may be crossed all along.
    """

    slot: Annotated[int, meant("Place from the right edge, from 0.", low=0, high=_MOST_SLOTS - 1)]
    begin: Annotated[float, meant("Where it begins to have its full width.", "m")]
    end: Annotated[float, meant("Where it ceases to.", "m")]
    kind: Annotated[LaneKind, meant("; ".join(f"{name}: {what}" for name, what in LANE_KINDS.items()) + ".")] = (
        "through"
    )
    limit: Annotated[float | None, meant("Speed limit.", "m/s")] = None
    left: Annotated[tuple[Marking, ...], meant("Lines at its left; none: it may be crossed.")] = ()
    right: Annotated[tuple[Marking, ...], meant("Lines at its right; none: it may be crossed.")] = ()

    def may_cross(self, s: float, *, left: bool) -> bool:
        """Say whether a vehicle in it may change to the left or right at s [m], as far as the marking goes."""
        lines = [line for line in (self.left if left else self.right) if line.s <= s]
        return lines[-1].may_cross if lines else True


@dataclass(frozen=True)
class Road:
    """A road in one direction of travel.

    Attributes:
        name: For people.
        pieces: Pieces of its reference line.
        length: Of the reference line [m].
        lane_width: Width of each slot in the simulator [m].
        centres: Middle of each slot, left of the reference line [m], ascending: from the right edge.
        lanes: By slot and begin.
        notes: What its source holds and it does not.
    """

    name: Annotated[str, meant("For people.")]
    pieces: Annotated[tuple[Piece, ...], meant("Pieces of its reference line: s, x, y, heading, curvature, change.")]
    length: Annotated[float, meant("Of the reference line.", "m")]
    lane_width: Annotated[float, meant("Width of each slot in the simulator.", "m", low=_WIDTHS[0], high=_WIDTHS[1])]
    centres: Annotated[tuple[float, ...], meant("Middle of each slot, left of the reference line.", "m")]
    lanes: Annotated[tuple[Lane, ...], meant("By slot and begin.")]
    notes: Annotated[tuple[str, ...], meant("What its source holds and it does not.")] = field(default=())

    @cached_property
    def line(self) -> ReferenceLine:
        """Reference line of the road."""
        return ReferenceLine(self.pieces, self.length)

    @property
    def slots(self) -> int:
        """Number of lanes side by side, at most."""
        return len(self.centres)

    def lane_at(self, slot: int, s: float) -> Lane | None:
        """Find the lane in a slot at s [m]; None: there is none."""
        return next((lane for lane in self.lanes if lane.slot == slot and lane.begin <= s <= lane.end), None)

    def next_lanes(self, lane: Lane) -> tuple[Lane, ...]:
        """Give the lanes that follow in its slot where a lane ends, closed ones too."""
        return tuple(one for one in self.lanes if one.slot == lane.slot and one.begin == lane.end)

    def ends_ahead(self, slot: int, s: float) -> float:
        """Say how far one may drive in a slot from s [m]; inf: to the road's end; 0: there is no open lane."""
        lane = self.lane_at(slot, s)
        if lane is None or lane.kind == "closed":
            return 0.0
        while lane.end < self.length:
            after = self.open_after(lane)
            if after is None:
                return lane.end - s
            lane = after
        return float("inf")

    def open_after(self, lane: Lane) -> Lane | None:
        """Give the lane that may be driven where a lane ends; None: its traffic must have left it by then."""
        return next((one for one in self.next_lanes(lane) if one.kind != "closed"), None)

    def aside(self, y: ArrayLike) -> NDArray[np.float64]:
        """Turn y of the simulator [m] into metres left of the reference line."""
        return _between(np.asarray(y, np.float64), self._middles, np.array(self.centres, np.float64))

    def across(self, d: ArrayLike) -> NDArray[np.float64]:
        """Turn metres left of the reference line into y of the simulator [m]: what `aside` undoes."""
        return _between(np.asarray(d, np.float64), np.array(self.centres), self._middles)

    @property
    def _middles(self) -> NDArray[np.float64]:
        return np.asarray((np.arange(self.slots) + 0.5) * self.lane_width, np.float64)

    def pose_at(self, s: ArrayLike, y: ArrayLike) -> Pose:
        """Give the pose in the world of places of the simulator: s along the road, y from the right edge [m]."""
        return self.line.at(s, self.aside(y))

    def project(self, x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Say where points of the world are: s along the road and y of the simulator [m]."""
        s, d = self.line.project(x, y)
        return s, self.across(d)


def _between(at: NDArray[np.float64], known: NDArray[np.float64], given: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate from the middles of slots on one axis to those on the other; beyond the outer ones distances stay."""
    inside = np.clip(at, known[0], known[-1])
    return np.asarray(np.interp(inside, known, given) + (at - inside))


def faults_of(road: Road) -> list[str]:
    """Say what is wrong with a road, a sentence each; none: it can be driven."""
    found = []
    if road.line.tightest < _TIGHTEST:
        found.append(f"its tightest curve has a radius of {road.line.tightest:.0f} m; {_TIGHTEST:.0f} m are the least")
    if not 1 <= road.slots <= _MOST_SLOTS:
        found.append(f"it has {road.slots} lanes side by side; 1 to {_MOST_SLOTS} can be driven")
    for k, (gap, kink) in enumerate(road.line.gaps.tolist(), start=1):
        if gap > GAP or kink > KINK:
            place = f"at s = {road.pieces[k].s:.1f} m"
            found.append(f"the reference line has a gap of {gap:.2f} m and a kink of {kink:.3f} rad {place}")
    widths = np.diff(road.centres)
    if not _WIDTHS[0] <= road.lane_width <= _WIDTHS[1]:
        found.append(f"its lanes are {road.lane_width:.2f} m wide; {_WIDTHS[0]:g} to {_WIDTHS[1]:g} m can be driven")
    if (widths < _WIDTHS[0]).any() or (widths > _WIDTHS[1]).any():
        found.append(f"its lanes lie {', '.join(f'{w:.2f}' for w in widths)} m apart; {_WIDTHS[0]:g} to {_WIDTHS[1]:g}")
    for lane in road.lanes:
        named = f"the lane in slot {lane.slot} from {lane.begin:.0f} to {lane.end:.0f} m"
        if not 0 <= lane.slot < road.slots or not 0.0 <= lane.begin < lane.end <= road.length:
            found.append(f"{named} lies outside the road")
        elif lane.end < road.length and lane.kind in ("through", "acceleration") and road.open_after(lane) is None:
            beside = [one for one in road.lanes if abs(one.slot - lane.slot) == 1 and one.kind != "closed"]
            if not any(one.begin <= lane.end < one.end for one in beside):
                found.append(f"{named} ends, and no lane beside it goes on")
    for slot in range(road.slots):
        ends = [(lane.begin, lane.end) for lane in road.lanes if lane.slot == slot]
        if not ends:
            found.append(f"there is no lane in slot {slot}")
        if len(ends) > MOST_LANES:
            found.append(f"slot {slot} has {len(ends)} lanes, one after the other; {MOST_LANES} can be driven")
        if any(after[0] < before[1] for before, after in itertools.pairwise(ends)):
            found.append(f"lanes in slot {slot} lie over each other, or are not in order")
    return found
