"""Roads of OpenDRIVE files as roads of ours: one road of the file, in one direction of travel.

Lines, arcs and clothoids stay what they are; polynomials become short clothoids, less than a millimetre off. What
cannot be represented is refused with its line: oncoming traffic in a lane, reversed lanes, superelevation, lanes that
shift sideways.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cornerforge.errors import DataError, InputError
from cornerforge.ext.interchange.read_opendrive import DRIVEN, Lane, Section, read_opendrive
from cornerforge.ext.interchange.read_opendrive import Piece as TheirPiece
from cornerforge.ext.interchange.read_opendrive import Road as TheirRoad
from cornerforge.ext.interchange.slots import FULL, Seen, slots_of
from cornerforge.ext.interchange.smooth_line import clothoids
from cornerforge.road.network import Lane as OurLane
from cornerforge.road.network import LaneKind, Road, faults_of
from cornerforge.road.reference import Piece, ReferenceLine

__all__ = ["road_of_opendrive"]

_STEP = 1.0
"""Distance of the places at which lanes are looked at [m]."""
_JUST, _SLIVER = 1e-6, 1e-9
_SHORT = 4.0
"""Length of the clothoids that stand for polynomials [m]."""
_KINDS: dict[str, LaneKind] = {
    "entry": "acceleration", "onRamp": "acceleration", "mwyEntry": "acceleration", "exit": "deceleration",
    "offRamp": "deceleration", "mwyExit": "deceleration",
}  # fmt: skip

_RAMPS = ("onRamp", "offRamp")
"""Lanes that are ramps where their line to the road may not be crossed."""


def road_of_opendrive(
    path: Path, *, ident: str | None = None, begin: float = 0.0, end: float | None = None, against: bool = False
) -> Road:
    """Take one road of a file.

    Args:
        path: The OpenDRIVE file, 1.4 to 1.8.
        ident: Id of the road; None: the longest.
        begin, end: From where to where of its own s [m]; None: to its end.
        against: In the direction against its reference line.

    Returns:
        The road; its s begins with 0 at the travel's begin.

    Raises:
        InputError: The file is missing, or has no such road or stretch.
        FileFormatError, DataError: It is damaged, or holds what cannot be represented; with the line.
    """
    roads = read_opendrive(path)
    name = max(roads.roads, key=lambda one: roads.roads[one].length) if ident is None else ident
    if name not in roads.roads:
        raise InputError(f"{path.name} has no road {name[:40]!r}; it has {', '.join(list(roads.roads)[:20])}.")
    road = roads.roads[name]
    last = road.length if end is None else end
    if not 0.0 <= begin < last <= road.length + 1e-6:
        raise InputError(f"Road {name} has s from 0 to {road.length:.10g} m; from {begin:g} to {last:g} is none of it.")
    taken = _Taken(path.name, road, begin, min(last, road.length), -1 if against != road.left_hand else 1, against)
    return taken.road()


@dataclass(frozen=True)
class _Taken:
    """A stretch of a road of a file: its side (-1: lanes above 0, 1: lanes below), and whether s runs backwards."""

    file: str
    theirs: TheirRoad
    begin: float
    end: float
    side: int
    against: bool

    def fault(self, line: int, what: str) -> DataError:
        return DataError(f"{self.file}, line {line}: {what}.")

    def road(self) -> Road:
        theirs = self.theirs
        if theirs.leans:
            raise self.fault(theirs.leans, f"road {theirs.ident} leans (superelevation), which is not represented")
        pieces = self._pieces()
        length = self.end - self.begin
        centres, lanes, width = self._lanes()
        notes = tuple(f"road {theirs.ident}: {note}" for note in theirs.besides)
        name = f"{Path(self.file).stem} {theirs.ident}"
        road = Road(name, pieces, length, width, centres, lanes, notes)
        if faults := faults_of(road):
            raise self.fault(theirs.line, f"road {theirs.ident} cannot be driven: {'; '.join(faults)}")
        return road

    # Reference line

    def _pieces(self) -> tuple[Piece, ...]:
        whole: list[Piece] = []
        theirs = self.theirs.pieces
        try:
            for piece, after in zip(theirs, [*(one.s for one in theirs[1:]), self.theirs.length], strict=True):
                whole += _shapes(piece, after - piece.s)
            line = ReferenceLine(tuple(whole), self.theirs.length)
        except InputError as error:
            raise self.fault(self.theirs.line, f"road {self.theirs.ident}: {str(error).rstrip('.')}") from error
        inside = [self.begin, *(one.s for one in whole if self.begin < one.s < self.end), self.end]
        cut: list[Piece] = []
        for first, last in itertools.pairwise(inside):
            source = whole[bisect_right(whole, first + 1e-9, key=lambda one: one.s) - 1]
            bend = source.curvature + source.change * (first - source.s)
            if self.against:  # just before its end, as the next piece may begin elsewhere
                there, bend = line.at(last - 1e-9), -(bend + source.change * (last - first))
                s, turn = self.end - last, math.pi
            else:
                there, s, turn = line.at(first), first - self.begin, 0.0
            place = float(there.x), float(there.y), float(there.heading) + turn
            cut.append(Piece(s, *place, bend, source.change))
        return tuple(sorted(cut))

    # Lanes

    def _seen(self, s: float) -> list[Seen]:
        """Lanes of this side that have their full width at s, from the right edge."""
        section = self.theirs.section(s)
        found = []
        for ident, lane in section.lanes.items():
            width = lane.width(s - section.s)
            closed = lane.kind == "restricted" and lane.way == 1
            if ident * self.side >= 0 or width < FULL or (lane.kind not in DRIVEN and not closed):
                continue
            if lane.way != 1 or lane.kind == "bidirectional":
                what = "is driven both ways" if lane.way == 0 or lane.kind == "bidirectional" else "is reversed"
                raise self.fault(section.line, f"lane {ident} of road {self.theirs.ident} {what}: not represented")
            low, high = self.theirs.borders(ident, s)
            middle = 0.5 * (low + high) * (-1.0 if self.against else 1.0)
            inner = section.lanes.get(ident - (1 if ident > 0 else -1))
            ways = ("increase", "decrease") if ident < 0 else ("decrease", "increase")
            left, right = (
                _may_cross([mark for mark in marks if section.s + mark[0] <= s + _SLIVER], way)
                for marks, way in zip((section.middle if inner is None else inner.marks, lane.marks), ways, strict=True)
            )
            is_ramp = lane.kind in _RAMPS and not (right if inner is None else left)
            kind = "ramp" if is_ramp else "closed" if closed else _KINDS.get(lane.kind, "through")
            place = f"{self.file}, line {section.line}: lane {ident}"
            found.append(Seen(place, middle, width, kind, self._limit(s, lane, section), left, right))
        return sorted(found, key=lambda one: one.middle)

    def _limit(self, s: float, lane: Lane, section: Section) -> float | None:
        """Speed limit of a lane at s [m/s]: its own, else the road's."""
        own = [limit for place, limit in lane.limits if section.s + place <= s + _SLIVER]
        road = [limit for place, limit in self.theirs.limits if place <= s + _SLIVER]
        return own[-1] if own else road[-1] if road else None

    def _places(self) -> list[float]:
        """Places of the file's s at which lanes are looked at, in the order of travel: evenly, and at each change."""
        changes = [place for section in self.theirs.sections for place in (section.s - _JUST, section.s)]
        even = np.linspace(self.begin, self.end, max(2, math.ceil((self.end - self.begin) / _STEP) + 1)).tolist()
        places = sorted({place for place in [*even, *changes] if self.begin <= place <= self.end})
        return places[::-1] if self.against else places

    def _lanes(self) -> tuple[tuple[float, ...], tuple[OurLane, ...], float]:
        """Middles of the slots, the lanes in them, and the width of a slot in the simulator."""
        places = self._places()
        border = {section.s - _JUST: section.s for section in self.theirs.sections}
        at = [border.get(place, place) for place in places]
        ours = [self.end - place if self.against else place - self.begin for place in at]
        found = slots_of(ours, [self._seen(place) for place in places])
        if not found[0]:
            side = "against" if self.against else "along"
            raise self.fault(self.theirs.line, f"road {self.theirs.ident} has no lane that is driven {side} its line")
        return found


def _may_cross(marks: list[tuple[float, str, str]], way: str) -> bool:
    """Say whether the last of these lines may be crossed, "increase" or "decrease": the way that ids of lanes go.

    Broken on one side only counts as solid where the file does not say who may change.
    """
    if not marks:
        return True
    _, kind, change = marks[-1]
    return change in ("both", way) if change else kind in ("none", "broken", "botts dots")


def _shapes(piece: TheirPiece, length: float) -> list[Piece]:
    """Turn a geometry of a file into pieces of a reference line."""
    shape, x, y, heading = piece.shape, piece.x, piece.y, piece.heading
    if shape.tag == "line":
        return [Piece(piece.s, x, y, heading)]
    if shape.tag == "arc":
        return [Piece(piece.s, x, y, heading, shape.number("curvature"))]
    if shape.tag == "spiral":
        first, last = shape.number("curvStart"), shape.number("curvEnd")
        return [Piece(piece.s, x, y, heading, first, (last - first) / piece.length)]
    return _of_polynomial(piece, length)


def _of_polynomial(piece: TheirPiece, length: float) -> list[Piece]:
    """Turn a polynomial into short clothoids."""
    shape = piece.shape
    if shape.tag == "poly3":
        along: tuple[float, ...] = (0.0, 1.0, 0.0, 0.0)
        across = tuple(shape.number(name, 0.0) for name in "abcd")
        whole = piece.length
    else:
        along = tuple(shape.number(f"{name}U", 0.0) for name in "abcd")
        across = tuple(shape.number(f"{name}V", 0.0) for name in "abcd")
        whole = 1.0 if shape.string("pRange", "normalized") == "normalized" else piece.length
    n = max(1, math.ceil(length / _SHORT))
    p = whole * np.linspace(0.0, length / piece.length, n + 1)
    cos, sin = math.cos(piece.heading), math.sin(piece.heading)
    place, first, second = (
        np.array([[cos, -sin], [sin, cos]]) @ [np.polyval(np.polyder(one[::-1], order), p) for one in (along, across)]
        for order in range(3)
    )
    s = np.linspace(piece.s, piece.s + length, n + 1)
    return clothoids(s, place + np.array([[piece.x], [piece.y]]), first, second)
