"""Roads of OpenDRIVE files (1.4 to 1.8): the straight stretch on which a case happens, in our axes.

OpenDRIVE measures s along a road's reference line and t to its left; lanes have ids that grow with t, 0 is the line
itself. Right-hand traffic drives along s in lanes below 0 and against s in lanes above. Ours: x along the travel, y to
the left from the right edge of the lanes that are driven in the AV's direction.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cornerforge.errors import DataError
from cornerforge.ext.interchange.xml_input import Element, read_xml

__all__ = ["Frame", "Lane", "Road", "Roads", "frame_of", "read_opendrive"]

_DRIVEN = frozenset({
    "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "bus", "taxi", "HOV", "carpool", "mwyEntry",
    "mwyExit", "slipLane", "bidirectional",
})  # fmt: skip
_FLAT = 0.05
"""A stretch that leaves its straight line by less than this is straight [m]."""
_GENTLE = 1500.0
"""A road of this radius or a larger one is read as if it were straight, along its line [m]."""
_SAME_HEADING = 1e-4
_SAME_PLACE = 0.5
_SAME_WIDTH = 0.01
_MOST_OFF = 0.5
"""How far the middle of a lane may lie from where lanes of one width would have it [m]."""
_SAMPLES = 16
_FARTHEST = 1e7
"""Largest coordinate [m]."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane of a section: its borders' t as (sOffset, a, b, c, d) of their widths, summed up from the middle."""

    ident: int
    kind: str
    widths: tuple[tuple[float, float, float, float, float], ...]

    def width(self, ds: float) -> float:
        """Width of the lane at `ds` after the begin of its section [m]."""
        place = max(0, bisect_right(self.widths, ds, key=lambda w: w[0]) - 1)
        offset, a, b, c, d = self.widths[place]
        u = max(0.0, ds - offset)
        return a + u * (b + u * (c + u * d))


@dataclass(frozen=True, slots=True)
class _Section:
    s: float
    line: int
    lanes: dict[int, Lane]


@dataclass(frozen=True, slots=True)
class _Piece:
    """A piece of a reference line: where it begins, how far it leaves its straight line, its smallest radius [m]."""

    s: float
    x: float
    y: float
    heading: float
    length: float
    kind: str
    off: float
    radius: float
    line: int

    @property
    def straight(self) -> bool:
        return self.off < _FLAT

    @property
    def gentle(self) -> bool:
        return self.straight or self.radius >= _GENTLE

    def at(self, s: float, t: float) -> tuple[float, float]:
        u = s - self.s
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return self.x + u * cos - t * sin, self.y + u * sin + t * cos

    def where(self, x: float, y: float) -> tuple[float, float]:
        dx, dy = x - self.x, y - self.y
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return self.s + dx * cos + dy * sin, dy * cos - dx * sin


@dataclass(frozen=True, slots=True)
class Road:
    """A road of the file.

    Attributes:
        ident: Its id.
        line: Where it stands in the file.
        length: [m].
        left_hand: Its traffic drives on the left.
        pieces: Its reference line, by s.
        sections: Its lanes, by s.
        offsets: Offsets of its lanes from the reference line, as (s, a, b, c, d).
        besides: What else stands in it and moves nothing here, for notes.
    """

    ident: str
    line: int
    length: float
    left_hand: bool
    pieces: tuple[_Piece, ...]
    sections: tuple[_Section, ...]
    offsets: tuple[tuple[float, float, float, float, float], ...]
    besides: tuple[str, ...]

    def piece(self, s: float) -> _Piece:
        """The piece of the reference line at s; the first or the last one beyond the ends."""
        return self.pieces[max(0, bisect_right(self.pieces, s, key=lambda p: p.s) - 1)]

    def section(self, s: float) -> _Section:
        """The section of lanes at s."""
        return self.sections[max(0, bisect_right(self.sections, s, key=lambda p: p.s) - 1)]

    def borders(self, ident: int, s: float) -> tuple[float, float]:
        """Smallest and largest t of a lane at s [m].

        Raises:
            KeyError: The lane does not exist.
        """
        section = self.section(s)
        side = 1 if ident > 0 else -1
        inner = self._offset(s)
        for k in range(1, abs(ident)):
            inner += side * section.lanes[side * k].width(s - section.s)
        outer = inner + side * section.lanes[ident].width(s - section.s)
        return min(inner, outer), max(inner, outer)

    def lane_at(self, s: float, t: float) -> int | None:
        """Id of the lane at a place; None: beside all lanes."""
        section = self.section(s)
        way = t - self._offset(s)
        side = 1 if way > 0.0 else -1
        border, ident = 0.0, side
        while ident in section.lanes:
            border += section.lanes[ident].width(s - section.s)
            if abs(way) <= border:
                return ident
            ident += side
        return None

    def _offset(self, s: float) -> float:
        """Where the lanes' middle line is beside the reference line [m]."""
        place = max(0, bisect_right(self.offsets, s, key=lambda p: p[0]) - 1)
        begin, a, b, c, d = self.offsets[place]
        u = max(0.0, s - begin)
        return a + u * (b + u * (c + u * d))


@dataclass(frozen=True, slots=True)
class Roads:
    """All roads of a file."""

    file: str
    roads: dict[str, Road]

    def road(self, ident: str) -> Road:
        """Find a road.

        Raises:
            DataError: There is none of this id.
        """
        if ident not in self.roads:
            known = ", ".join(sorted(self.roads)[:8])
            raise DataError(f'{self.file} has no road "{ident[:40]}"; it has: {known}.')
        return self.roads[ident]

    def find(self, x: float, y: float) -> tuple[Road, float, float] | None:
        """Find the road with lanes at a point of the world, and s and t there; None: no straight one does."""
        for road in self.roads.values():
            for piece in road.pieces:
                if not piece.straight:
                    continue
                s, t = piece.where(x, y)
                if piece.s <= s <= piece.s + piece.length and road.lane_at(s, t) is not None:
                    return road, s, t
        return None


@dataclass(frozen=True)
class Frame:
    """The straight stretch of a case, in our axes.

    Attributes:
        road: On which the AV starts.
        piece: Piece of its reference line.
        along: 1 if the travel goes along s, -1 if against it.
        begin, end: The stretch is straight between these x [m].
        lanes: Ids of the lanes in the AV's direction, the rightmost first.
        lane_width: [m].
        edge: `along` times t of the right edge of the rightmost lane [m].
        origin: x where s is 0 [m]: a road along the world's x axis keeps the world's x.
        start: s where the AV starts.
        curved: The road bends gently and is read as straight; places of the world are not known then.
        notes: What of the road is not carried over.
    """

    road: Road
    piece: _Piece
    along: int
    begin: float
    end: float
    lanes: tuple[int, ...]
    lane_width: float
    edge: float
    origin: float
    start: float
    curved: bool
    notes: tuple[str, ...]

    def of_road(self, s: float, t: float) -> tuple[float, float]:
        """Our x and y of a place on the road of the AV."""
        return self.origin + self.along * s, self.along * t - self.edge

    def of_world(self, x: float, y: float) -> tuple[float, float]:
        """Our x and y of a point of the world."""
        return self.of_road(*self.piece.where(x, y))

    def heading(self, of_world: float) -> float:
        """Our heading, in [-pi, pi), of one of the world."""
        return _wrapped(of_world - self.piece.heading - (0.0 if self.along > 0 else math.pi))

    def turned(self, dx: float, dy: float) -> tuple[float, float]:
        """Our vector of one of the world."""
        cos, sin = self.along * math.cos(self.piece.heading), self.along * math.sin(self.piece.heading)
        return dx * cos + dy * sin, dy * cos - dx * sin

    def lane_of(self, y: float) -> int:
        """Index of the lane at y, the nearest one beside the road."""
        return min(max(int(y // self.lane_width), 0), len(self.lanes) - 1)


def read_opendrive(path: Path) -> Roads:
    """Read the roads of an OpenDRIVE file.

    Raises:
        InputError: The file is missing.
        FileFormatError: It is no OpenDRIVE file, or an unsafe or damaged one.
        DataError: A number of it cannot be, or there is no road.
    """
    top = read_xml(path, root="OpenDRIVE", what="an OpenDRIVE file")
    roads: dict[str, Road] = {}
    for element in top.all("road"):
        road = _road(element)
        if road.ident in roads:
            element.fault(f'there are two roads "{road.ident[:40]}"')
        roads[road.ident] = road
    if not roads:
        top.fault("the file holds no road")
    return Roads(path.name, roads)


def frame_of(roads: Roads, road: Road, s: float, t: float) -> Frame:
    """Make the frame of a case from where its AV starts.

    Raises:
        DataError: The road is not straight there, has no driven lane, or lanes of too different widths.
    """
    where = f"{roads.file}, line {road.line}"
    piece = road.piece(s)
    if not piece.gentle:
        raise DataError(
            f"{roads.file}, line {piece.line}: road {road.ident} is not straight where the AV starts ({piece.kind}, "
            f"radius {piece.radius:.0f} m); roads with parallel lanes that are straight or have a radius of "
            f"{_GENTLE:.0f} m or more can be read."
        )
    curved = not piece.straight
    ident = road.lane_at(s, t)
    side = (1 if ident > 0 else -1) if ident is not None else (1 if t > 0.0 else -1)
    lanes = _driven(road, s, side, ident)
    if not lanes:
        raise DataError(f"{where}: road {road.ident} has no lane to drive in where the AV starts.")
    along = -side if not road.left_hand else side
    lanes.sort(key=lambda lane: along * sum(road.borders(lane, s)))
    low, high = road.borders(lanes[0], s), road.borders(lanes[-1], s)
    edge = min(along * low[0], along * low[1])
    width = (max(along * high[0], along * high[1]) - edge) / len(lanes)
    begin, end = _stretch(roads, road, piece, curved)
    origin = 0.0 if along > 0 else road.length
    if along > 0 and piece.heading == 0.0 and not curved:
        origin = piece.x - piece.s
    begin, end = sorted((origin + along * begin, origin + along * end))
    notes = tuple(f"{where}: {note}" for note in _notes(road, s, lanes, width, curved))
    for k, lane in enumerate(lanes):
        off = abs(along * sum(road.borders(lane, s)) / 2.0 - edge - (k + 0.5) * width)
        if off > _MOST_OFF:
            raise DataError(
                f"{where}: the lanes of road {road.ident} differ too much in width; equal ones can be driven."
            )
    return Frame(road, piece, along, begin, end, tuple(lanes), width, edge, origin, s, curved, notes)


def _driven(road: Road, s: float, side: int, ident: int | None) -> list[int]:
    """Ids of the driven lanes of a side that lie beside one another; with `ident`, if that is driven, around it."""
    lanes = road.section(s).lanes
    groups: list[list[int]] = [[]]
    k = side
    while k in lanes:
        if lanes[k].kind in _DRIVEN and lanes[k].width(s - road.section(s).s) > 1.0:
            groups[-1].append(k)
        elif groups[-1]:
            groups.append([])
        k += side
    return next((group for group in groups if ident in group), max(groups, key=len))


def _stretch(roads: Roads, road: Road, piece: _Piece, curved: bool) -> tuple[float, float]:
    """First and last s up to which it goes on as in a piece, over the ends of roads too if it is straight."""
    spans = []
    for other in road.pieces if curved else (p for r in roads.roads.values() for p in r.pieces):
        s, off = piece.where(other.x, other.y)
        turn = abs(_wrapped(other.heading - piece.heading))
        if curved and other.gentle:
            spans.append((other.s, other.s + other.length))
        elif not curved and other.straight and abs(off) < _FLAT:
            if turn < _SAME_HEADING:
                spans.append((s, s + other.length))
            elif math.pi - turn < _SAME_HEADING:
                spans.append((s - other.length, s))
    begin, end = piece.s, piece.s + piece.length
    for low, high in sorted(spans):
        if low <= end + _SAME_PLACE:
            end = max(end, high)
    for low, high in sorted(spans, key=lambda span: -span[1]):
        if high >= begin - _SAME_PLACE:
            begin = min(begin, low)
    return begin, end


def _notes(road: Road, s: float, lanes: list[int], width: float, curved: bool) -> Iterator[str]:
    section = road.section(s)
    if curved:
        least = min(piece.radius for piece in road.pieces if piece.gentle)
        yield f"road {road.ident} bends (radius {least:.0f} m or more); it is read as straight, along its line"
    for words in road.besides:
        yield f"road {road.ident}: {words}"
    others = [f"{lane.ident} ({lane.kind})" for lane in section.lanes.values() if lane.ident not in lanes]
    if others:
        yield f"lanes of road {road.ident} that are not driven in the AV's direction are left out: {', '.join(others)}"
    if road.left_hand:
        yield f"road {road.ident} has left-hand traffic; lanes keep their places, but AVs are used to the right"
    widths = [road.section(s).lanes[lane].width(s - section.s) for lane in lanes]
    if max(widths) - min(widths) > _SAME_WIDTH:
        yield f"lanes are {', '.join(f'{w:.2f}' for w in widths)} m wide; each counts as {width:.2f} m, places stay"
    if any(not _same_lanes(road, s, other.s, lanes) for other in road.sections):
        yield f"road {road.ident} has other lanes or widths farther on; those where the AV starts are used throughout"
    if len(road.sections) == 1 and not _same_lanes(road, s, road.length, lanes):
        yield f"lanes of road {road.ident} change their width; that where the AV starts is used throughout"


def _same_lanes(road: Road, s: float, other: float, lanes: list[int]) -> bool:
    if any(lane not in road.section(other).lanes for lane in lanes):
        return False
    pairs = zip((road.borders(k, s) for k in lanes), (road.borders(k, other) for k in lanes), strict=True)
    return all(abs(a[0] - b[0]) < _SAME_WIDTH and abs(a[1] - b[1]) < _SAME_WIDTH for a, b in pairs)


def _road(element: Element) -> Road:
    length = element.number("length", low=1e-3, high=1e6, unit="m")
    pieces = sorted((_piece(g) for g in element.need("planView").all("geometry")), key=lambda p: p.s)
    if not pieces:
        element.fault("its planView holds no geometry")
    lanes = element.need("lanes")
    sections = sorted((_section(part) for part in lanes.all("laneSection")), key=lambda p: p.s)
    if not sections:
        lanes.fault("there is no laneSection")
    offsets = sorted(_polynomial(part, "s") for part in lanes.all("laneOffset")) or [(0.0, 0.0, 0.0, 0.0, 0.0)]
    left = element.attributes.get("rule", "RHT") == "LHT"
    return Road(
        element.string("id"), element.line, length, left, tuple(pieces), tuple(sections), tuple(offsets),
        tuple(_besides(element)),
    )  # fmt: skip


def _besides(element: Element) -> Iterator[str]:
    for profile, tag, words in (
        ("elevationProfile", "elevation", "is not level"), ("lateralProfile", "superelevation", "leans"),
    ):  # fmt: skip
        holder = element.child(profile)
        for part in holder.all(tag) if holder is not None else ():
            if any(_polynomial(part, "s")[2 if tag == "elevation" else 1 :]):
                yield f"it {words}; it is read as flat"
                break
    for holder, tag in ((element.child("objects"), "object"), (element.child("signals"), "signal")):
        count = sum(1 for _ in holder.all(tag)) if holder is not None else 0
        if count:
            yield f"{count:,} {tag}{'s' if count > 1 else ''} beside or on it {'are' if count > 1 else 'is'} left out"


def _polynomial(element: Element, begin: str) -> tuple[float, float, float, float, float]:
    a, b, c, d = (element.number(name, 0.0, low=-1e6, high=1e6) for name in "abcd")
    return element.number(begin, 0.0, low=0.0, high=1e6, unit="m"), a, b, c, d


def _section(element: Element) -> _Section:
    lanes: dict[int, Lane] = {}
    for side, sign in (("left", 1), ("right", -1)):
        part = element.child(side)
        for lane in part.all("lane") if part is not None else ():
            ident = lane.integer("id", low=-1000, high=1000)
            if ident * sign <= 0:
                lane.fault(f"a lane on the {side} has id {ident}")
            if ident in lanes:
                lane.fault(f"there are two lanes {ident}")
            widths = tuple(sorted(_polynomial(width, "sOffset") for width in lane.all("width")))
            if not widths:
                lane.fault(f"lane {ident} has no width (borders are not read)")
            lanes[ident] = Lane(ident, lane.string("type", "none"), widths)
        count = sum(k * sign > 0 for k in lanes)
        missing = next((sign * k for k in range(1, count + 1) if sign * k not in lanes), None)
        if missing is not None:
            element.fault(f"lane {missing} is missing")
    return _Section(element.number("s", low=0.0, high=1e6, unit="m"), element.line, lanes)


def _piece(element: Element) -> _Piece:
    s, length = (element.number(name, low=0.0, high=1e6, unit="m") for name in ("s", "length"))
    x, y = (element.number(name, low=-_FARTHEST, high=_FARTHEST, unit="m") for name in "xy")
    heading = element.number("hdg", low=-1e3, high=1e3, unit="rad")
    shape = next(iter(element.all("line", "arc", "spiral", "poly3", "paramPoly3")), None)
    if shape is None:
        element.fault("this geometry is no line, arc, spiral, poly3 or paramPoly3")
    return _Piece(s, x, y, heading, length, *_bend(shape, length), element.line)


def _bend(shape: Element, length: float) -> tuple[str, float, float]:
    """Kind of a geometry, its distance from the straight line, and its smallest radius [m]."""
    if shape.tag == "line":
        return "line", 0.0, math.inf
    if shape.tag in ("arc", "spiral"):
        names = ("curvature",) if shape.tag == "arc" else ("curvStart", "curvEnd")
        curvature = max(abs(shape.number(name, low=-100.0, high=100.0, unit="1/m")) for name in names)
        return shape.tag, 0.5 * curvature * length**2, 1.0 / curvature if curvature > 0.0 else math.inf
    across = ("a", "b", "c", "d") if shape.tag == "poly3" else ("aV", "bV", "cV", "dV")
    a, b, c, d = (shape.number(name, 0.0, low=-1e6, high=1e6) for name in across)
    whole = 1.0 if shape.tag == "paramPoly3" and shape.string("pRange", "normalized") == "normalized" else length
    samples = [whole * k / _SAMPLES for k in range(_SAMPLES + 1)]
    bend = max(abs(2.0 * c + 6.0 * d * u) for u in samples) * (whole / length) ** 2 if length > 0.0 else 0.0
    off = max(abs(a + u * (b + u * (c + u * d))) for u in samples)
    if abs(b) > _SAME_HEADING or abs(a) > _FLAT:
        return shape.tag, max(off, _FLAT), 0.0  # it does not begin along its heading
    return shape.tag, off, 1.0 / bend if bend > 0.0 else math.inf


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
