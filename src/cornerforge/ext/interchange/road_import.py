"""Roads of OpenDRIVE files as roads of ours: one of the file or several that follow each other, in one direction.

Lines, arcs and clothoids stay what they are; polynomials become short clothoids, less than a millimetre off. What
cannot be represented is refused with its line: oncoming traffic in a lane, reversed lanes, superelevation, lanes that
shift sideways, and gaps between roads. At a joint of two roads a lane goes on where a link says so.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cornerforge.errors import DataError, InputError
from cornerforge.ext.interchange.opendrive_chain import Joints, Leg
from cornerforge.ext.interchange.read_opendrive import DRIVEN, Lane, Section, read_opendrive
from cornerforge.ext.interchange.read_opendrive import Piece as TheirPiece
from cornerforge.ext.interchange.read_opendrive import Road as TheirRoad
from cornerforge.ext.interchange.slots import FULL, SHIFT, Seen, slots_of
from cornerforge.ext.interchange.smooth_line import clothoids
from cornerforge.road.network import GAP, KINK, LaneKind, Road, faults_of
from cornerforge.road.reference import Piece, ReferenceLine

__all__ = ["road_of_opendrive"]

_STEP = 1.0
"""Distance of the places at which lanes are looked at [m]."""
_JUST, _SLIVER = 1e-6, 1e-9
_SHOWN = 10
_PART = ". --road, --from and --to choose a part"
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
    """Take a road of a file, or several that follow each other.

    Args:
        path: The OpenDRIVE file, 1.4 to 1.8.
        ident: Id of the road, or of several in the order of travel, with commas between; None: the longest chain.
        begin, end: From where to where, of one road along its own s, of several along the travel [m]; None: to the end.
        against: Against the reference line of the road, or of the chain's longest.

    Returns:
        The road; its s begins with 0 at the travel's begin.

    Raises:
        InputError: The file is missing, or has no such road or stretch.
        FileFormatError, DataError: It is damaged, or holds what cannot be represented; with the line.
    """
    joints = Joints(read_opendrive(path))
    legs = joints.longest(against) if ident is None else _named(joints, ident, against)
    roads = [joints.roads[leg.ident] for leg in legs]
    length = sum(road.length for road in roads)
    last = length if end is None else end
    if not 0.0 <= begin < last - _JUST or last > length + _JUST:
        called = f"Road {legs[0].ident} has" if len(legs) == 1 else f"The chain of roads {_called(legs)} has"
        raise InputError(f"{called} s from 0 to {length:.10g} m; from {begin:g} to {last:g} is none of it.")
    taken: list[_Taken] = []
    at = before = 0.0
    for leg, road in zip(legs, roads, strict=True):
        part = max(begin - before, 0.0), min(last - before, road.length)
        before += road.length
        if part[1] - part[0] > _JUST:
            if leg.against and len(legs) > 1:
                part = road.length - part[1], road.length - part[0]
            taken.append(_Taken(path.name, road, *part, -1 if leg.against != road.left_hand else 1, leg, at))
            at = taken[-1].until
    return _joined(joints, taken)


def _named(joints: Joints, ident: str, against: bool) -> list[Leg]:
    """Find the roads that are named."""
    names = [ident] if ident in joints.roads else [name.strip() for name in ident.split(",")]
    for name in names:
        if name not in joints.roads:
            raise InputError(f"{joints.file} has no road {name[:40]!r}; it has {', '.join(list(joints.roads)[:20])}.")
    if len(set(names)) < len(names):
        raise InputError(f"--road {ident[:40]} names a road twice; a chain takes each once.")
    if len(names) > 1 and against:
        raise InputError("The order of the roads that --road names is the direction of travel: leave out --against.")
    return joints.named(names) if len(names) > 1 else [Leg(names[0], against)]


def _called(legs: Sequence[Leg]) -> str:
    return legs[0].ident if len(legs) == 1 else f"{legs[0].ident} to {legs[-1].ident}"


def _joined(joints: Joints, taken: Sequence[_Taken]) -> Road:
    """Make one road of stretches that follow each other."""
    pieces: list[Piece] = []
    places: list[float] = []
    rows: list[dict[int, Seen]] = []
    begins: list[int] = []
    for one in taken:
        own, (at, seen) = one.pieces(), one.lanes()
        if pieces:
            one.check_joint(pieces[-1], own[0])
        begins.append(len(rows))
        pieces, places, rows = [*pieces, *own], [*places, *at], [*rows, *seen]
    legs = [one.leg for one in taken]
    besides = _join(joints, legs, rows, begins)
    centres, lanes, width = slots_of(places, [list(row.values()) for row in rows])
    notes = *(f"road {one.theirs.ident}: {note}" for one in taken for note in one.theirs.besides), *besides
    name = f"{Path(joints.file).stem} {_called(legs)}"
    road = Road(name, tuple(pieces), taken[-1].until, width, centres, lanes, notes)
    if faults := faults_of(road):
        called = f"road{'s' if len(legs) > 1 else ''} {_called(legs)}"
        raise taken[0].fault(
            taken[0].theirs.line, f"{called} cannot be driven: {'; '.join(faults)}{_PART if len(legs) > 1 else ''}"
        )
    return road


def _join(joints: Joints, legs: Sequence[Leg], rows: list[dict[int, Seen]], begins: Sequence[int]) -> list[str]:
    """Cut lanes that no link leads on, and tell those into which or out of which roads lead that are not taken.

    Args:
        joints: Of the file.
        legs: The roads that are taken.
        rows: Lanes at each place, changed here.
        begins: The first row of each road.

    Returns:
        Notes on the roads that are not taken.
    """
    lead: list[tuple[int, int, float]] = []
    beside: dict[str, set[str]] = {"join": set(), "leave": set()}
    for (leg, after), begin in zip(itertools.pairwise(legs), begins[1:], strict=True):
        left, right = rows[begin - 1], rows[begin]
        on = _on(left, right, joints.meets[leg.out].get(after.into, set()))
        comes, goes = joints.others(leg, after, come=True), joints.others(leg, after, come=False)
        beside["join"] |= {name for lane, name in comes.items() if lane in right}
        beside["leave"] |= {name for lane, name in goes.items() if lane in left}
        lead += [(begin, 1, right[lane].middle) for lane in comes if lane in right and lane not in on.values()]
        lead += [(begin - 1, -1, left[lane].middle) for lane in goes if lane in left and lane not in on]
        rows[begin] = {
            lane: one for lane, one in right.items()
            if not any(_same(left[a], one.middle) and on.get(a) != lane for a in left)
        }  # fmt: skip
    for place, step, middle in sorted(lead, key=lambda one: -one[1]):  # where one leads in and one out, it leads out
        _tell(rows, place, step, middle, begins)
    told = {how: ", ".join(sorted(names)[:_SHOWN]) for how, names in beside.items() if names}
    return [f"roads that {how} are left out: {names}" for how, names in told.items()]


def _on(left: dict[int, Seen], right: dict[int, Seen], links: Iterable[tuple[int, int]]) -> dict[int, int]:
    """Find in which lane behind a joint each one before it goes straight on.

    Raises:
        DataError: A link leads sideways, and neither lane has one that leads straight on.
    """
    pairs = {(a, b): abs(left[a].middle - right[b].middle) for a, b in links if a in left and b in right}
    on = {a: b for (a, b), off in pairs.items() if off <= SHIFT + 0.5 * abs(left[a].width - right[b].width)}
    for (a, b), off in pairs.items():
        if a not in on and b not in on.values():
            raise DataError(f"{right[b].place} is linked to lane {a}, which ends {off:.2f} m beside: not represented.")
    return on


def _same(one: Seen, middle: float) -> bool:
    """Say whether a lane lies where another has its middle."""
    return abs(one.middle - middle) <= 0.5 * one.width


def _tell(rows: list[dict[int, Seen]], place: int, step: int, middle: float, begins: Sequence[int]) -> None:
    """Make a lane one of acceleration (`step` 1) or deceleration (-1), from a row on to where it ends or begins.

    One of acceleration that does not end stays; one of deceleration that does not begin is one on its last road.
    """
    found = []
    at = place
    while 0 <= at < len(rows):
        lane = next((ident for ident, one in rows[at].items() if _same(one, middle)), None)
        if lane is None and at != place:  # at a joint it may have been cut
            break
        if lane is not None:
            found.append((at, lane))
        at += step
    if at == len(rows):
        return
    least = 0 if at >= 0 else begins[bisect_right(begins, place) - 1]
    for at, lane in found:
        if at >= least and rows[at][lane].kind not in ("closed", "ramp"):
            rows[at][lane] = replace(rows[at][lane], kind="acceleration" if step > 0 else "deceleration")


@dataclass(frozen=True)
class _Taken:
    """A stretch of a road of a file: its side (-1: lanes above 0, 1: lanes below), and where it begins on ours [m]."""

    file: str
    theirs: TheirRoad
    begin: float
    end: float
    side: int
    leg: Leg
    at: float

    @property
    def until(self) -> float:
        """Where it ends on our road [m]."""
        return self.at + (self.end - self.begin)

    def fault(self, line: int, what: str) -> DataError:
        return DataError(f"{self.file}, line {line}: {what}.")

    # Reference line

    def check_joint(self, before: Piece, after: Piece) -> None:
        """Refuse a gap or kink between the last piece of the road before and the first one of this."""
        moved = before._replace(s=0.0), after._replace(s=after.s - before.s)
        ((gap, kink),) = ReferenceLine(moved, moved[1].s + 1.0).gaps.tolist()
        if gap > GAP or kink > KINK:
            told = f"road {self.theirs.ident} begins {gap:.2f} m and {kink:.3f} rad from the end of the road before it"
            raise self.fault(self.theirs.line, f"{told}; {GAP:g} m and {KINK:g} rad are the most{_PART}")

    def pieces(self) -> list[Piece]:
        """Give its part of the reference line.

        Raises:
            DataError: It is damaged, or leans.
        """
        if self.theirs.leans:
            told = f"road {self.theirs.ident} leans (superelevation), which is not represented"
            raise self.fault(self.theirs.leans, told)
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
            if self.leg.against:  # just before its end, as the next piece may begin elsewhere
                there, bend = line.at(last - 1e-9), -(bend + source.change * (last - first))
                s, turn = self.end - last, math.pi
            else:
                there, s, turn = line.at(first), first - self.begin, 0.0
            place = float(there.x), float(there.y), float(there.heading) + turn
            cut.append(Piece(self.at + s, *place, bend, source.change))
        return sorted(cut)

    # Lanes

    def _seen(self, s: float) -> dict[int, Seen]:
        """Lanes of this side that have their full width at s, by id, from the right edge."""
        section = self.theirs.section(s)
        found = {}
        for ident, lane in section.lanes.items():
            width = lane.width(s - section.s)
            closed = lane.kind == "restricted" and lane.way == 1
            if ident * self.side >= 0 or width < FULL or (lane.kind not in DRIVEN and not closed):
                continue
            if lane.way != 1 or lane.kind == "bidirectional":
                what = "is driven both ways" if lane.way == 0 or lane.kind == "bidirectional" else "is reversed"
                raise self.fault(section.line, f"lane {ident} of road {self.theirs.ident} {what}: not represented")
            low, high = self.theirs.borders(ident, s)
            middle = 0.5 * (low + high) * (-1.0 if self.leg.against else 1.0)
            inner = section.lanes.get(ident - (1 if ident > 0 else -1))
            ways = ("increase", "decrease") if ident < 0 else ("decrease", "increase")
            left, right = (
                _may_cross([mark for mark in marks if section.s + mark[0] <= s + _SLIVER], way)
                for marks, way in zip((section.middle if inner is None else inner.marks, lane.marks), ways, strict=True)
            )
            is_ramp = lane.kind in _RAMPS and not (right if inner is None else left)
            kind = "ramp" if is_ramp else "closed" if closed else _KINDS.get(lane.kind, "through")
            place = f"{self.file}, line {section.line}: lane {ident}"
            found[ident] = Seen(place, middle, width, kind, self._limit(s, lane, section), left, right)
        return dict(sorted(found.items(), key=lambda one: one[1].middle))

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
        return places[::-1] if self.leg.against else places

    def lanes(self) -> tuple[list[float], list[dict[int, Seen]]]:
        """Give places along our road, and the lanes at each.

        Raises:
            DataError: No lane is driven in this direction, or one is driven both ways.
        """
        places = self._places()
        border = {section.s - _JUST: section.s for section in self.theirs.sections}
        at = [border.get(place, place) for place in places]
        ours = [self.at + (self.end - place if self.leg.against else place - self.begin) for place in at]
        rows = [self._seen(place) for place in places]
        if all(one.kind == "closed" for row in rows for one in row.values()):
            side = "against" if self.leg.against else "along"
            raise self.fault(self.theirs.line, f"road {self.theirs.ident} has no lane that is driven {side} its line")
        return ours, rows


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
    if min(length, piece.length) <= 0.0:
        raise InputError(f"The {shape.tag} of line {shape.line} is 0 m long, or lies behind the road's end.")
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
