"""Roads of OpenDRIVE files (1.4 to 1.8), as they stand there.

OpenDRIVE measures s along a road's reference line and t to its left; lanes have ids that grow with t, 0 is the line
itself. Right-hand traffic drives along s in lanes below 0 and against s in lanes above, unless a lane says that its
direction is reversed.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cornerforge.ext.interchange.xml_input import Element, read_xml

__all__ = [
    "DRIVEN",
    "END",
    "SAME_HEADING",
    "START",
    "Lane",
    "Link",
    "Piece",
    "Road",
    "Roads",
    "Section",
    "Way",
    "read_opendrive",
]

DRIVEN = frozenset({
    "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "bus", "taxi", "HOV", "carpool", "mwyEntry",
    "mwyExit", "slipLane", "bidirectional",
})  # fmt: skip
START, END = 0, 1
"""Ends of a road: where its s is 0, and where it is its length."""
_FLAT = 0.05
"""A stretch that leaves its straight line by less than this is straight [m]."""
SAME_HEADING = 1e-4
"""Directions that differ by less are the same [rad]."""
_ALIGNED = 0.5
"""An AV may be turned by this against its lane, as when it changes lanes [rad]."""
_WAYS = {"standard": 1, "reversed": -1, "both": 0}
_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}
_JOINT = 1e-3
"""Gap between two pieces of a road that is none [m]."""
_SAMPLES = 16
_FARTHEST = 1e7
"""Largest coordinate [m]."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane of a section.

    Attributes:
        ident: Its id.
        kind: Its type.
        way: 1: its traffic goes as is usual on its side of the road, -1: the other way, 0: both ways.
        widths: (sOffset, a, b, c, d) of its width.
        marks: (sOffset, type, laneChange) of the line at its outer side.
        limits: (sOffset, m/s) of its speed limit.
        links: Ids of the lanes before it and of those after it.
    """

    ident: int
    kind: str
    way: int
    widths: tuple[tuple[float, float, float, float, float], ...]
    marks: tuple[tuple[float, str, str], ...] = ()
    limits: tuple[tuple[float, float], ...] = ()
    links: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())

    def width(self, ds: float) -> float:
        """Width of the lane at `ds` after the begin of its section [m]."""
        place = max(0, bisect_right(self.widths, ds, key=lambda w: w[0]) - 1)
        offset, a, b, c, d = self.widths[place]
        u = max(0.0, ds - offset)
        return a + u * (b + u * (c + u * d))


@dataclass(frozen=True, slots=True)
class Section:
    """Lanes from a place on [m]: its line in the file, the lanes by id, and the marks of the middle line."""

    s: float
    line: int
    lanes: dict[int, Lane]
    middle: tuple[tuple[float, str, str], ...]


@dataclass(frozen=True, slots=True)
class Piece:
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
    shape: Element

    @property
    def straight(self) -> bool:
        """Is it as good as straight?"""
        return self.off < _FLAT

    def where(self, x: float, y: float) -> tuple[float, float]:
        """Give s and t of a point of the world, as if the piece were straight."""
        dx, dy = x - self.x, y - self.y
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return self.s + dx * cos + dy * sin, dy * cos - dx * sin


@dataclass(frozen=True, slots=True)
class Link:
    """Target of an end of a road: its line in the file, a junction or an end (START, END) of a road."""

    line: int
    junction: bool
    ident: str
    end: int


@dataclass(frozen=True, slots=True)
class Way:
    """A connection of a junction: from a road to an end of another one, and pairs of lanes, one of each."""

    junction: str
    incoming: str
    ident: str
    end: int
    lanes: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Road:
    """A road of the file.

    Attributes:
        ident: Its id.
        line: Where it stands in the file.
        length: [m].
        junction: Id of the junction that it is part of; empty: none.
        left_hand: Its traffic drives on the left.
        pieces: Its reference line, by s.
        sections: Its lanes, by s.
        offsets: Offsets of its lanes from the reference line, as (s, a, b, c, d).
        besides: What else stands in it and moves nothing here, for notes.
        limits: (s, m/s) of its speed limit, where lanes have none.
        leans: Line of its superelevation in the file; 0: it has none.
        links: To what its START and its END lead; None: nothing.
    """

    ident: str
    line: int
    length: float
    junction: str
    left_hand: bool
    pieces: tuple[Piece, ...]
    sections: tuple[Section, ...]
    offsets: tuple[tuple[float, float, float, float, float], ...]
    besides: tuple[str, ...]
    limits: tuple[tuple[float, float], ...]
    leans: int
    links: tuple[Link | None, Link | None]

    def section(self, s: float) -> Section:
        """The section of lanes at s."""
        return self.sections[max(0, bisect_right(self.sections, s, key=lambda p: p.s) - 1)]

    def driven(self, s: float, ident: int, way: int) -> bool:
        """Whether traffic drives in a lane at s, along s (`way` 1), against it (-1) or either way (0).

        False: it does not exist.
        """
        lane = self.section(s).lanes.get(ident)
        if lane is None or lane.kind not in DRIVEN or lane.width(s - self.section(s).s) <= 1.0:
            return False
        usual = (1 if ident > 0 else -1) * (1 if self.left_hand else -1)
        return 0 in (way, lane.way) or lane.kind == "bidirectional" or usual * lane.way == way

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
class _Spot:
    """A place in a lane of a straight piece, and which way one looks there: along s (1) or against it (-1)."""

    road: Road
    piece: Piece
    s: float
    t: float
    lane: int
    way: int


@dataclass(frozen=True, slots=True)
class Roads:
    """All roads of a file, and the connections of its junctions."""

    file: str
    roads: dict[str, Road]
    ways: tuple[Way, ...] = ()

    def find(self, x: float, y: float, heading: float) -> _Spot | None:
        """Find the lane at a point of the world, of a straight road about parallel to a heading, in no junction.

        Where several are, one that is driven in this direction comes first. None: there is none.
        """
        found = None
        for road in self.roads.values():
            for piece in road.pieces:
                turn = math.cos(heading - piece.heading)
                if road.junction or not piece.straight or abs(turn) < math.cos(_ALIGNED):
                    continue
                s, t = piece.where(x, y)
                lane = road.lane_at(s, t) if -_JOINT <= s - piece.s <= piece.length + _JOINT else None
                if lane is not None:
                    spot = _Spot(road, piece, s, t, lane, 1 if turn > 0.0 else -1)
                    if road.driven(s, lane, spot.way):
                        return spot
                    found = found or spot
        return found

    def at(self, x: float, y: float) -> str:
        """Say what of the file is nearest to a point of the world, with its line, for messages."""

        def off(piece: Piece) -> float:
            s, t = piece.where(x, y)
            return math.hypot(t, max(piece.s - s, s - piece.s - piece.length, 0.0))

        pieces = ((off(piece), road, piece) for road in self.roads.values() for piece in road.pieces)
        least, road, piece = min(pieces, key=lambda one: one[0])
        shape = "straight" if piece.straight else f"{piece.kind}, radius {piece.radius:.0f} m"
        junction = f" in junction {road.junction}" if road.junction else ""
        return f"road {road.ident}{junction} ({shape}; line {piece.line}), {least:.0f} m from its line"


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
    ways = (_way(way, junction) for junction in top.all("junction") for way in junction.all("connection"))
    return Roads(path.name, roads, tuple(ways))


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
    junction = element.attributes.get("junction", "-1")
    return Road(
        element.string("id"), element.line, length, "" if junction == "-1" else junction[:40],
        element.attributes.get("rule", "RHT") == "LHT", tuple(pieces), tuple(sections), tuple(offsets),
        tuple(_besides(element)), tuple(sorted(
            (part.number("s", 0.0, low=0.0, high=1e6), limit) for part in element.all("type")
            for _, limit in _limits(part, "s")
        )), _leans(element), (_link(element.child("link", "predecessor")), _link(element.child("link", "successor"))),
    )  # fmt: skip


def _way(element: Element, junction: Element) -> Way:
    lanes = (
        (pair.integer("from", low=-1000, high=1000), pair.integer("to", low=-1000, high=1000))
        for pair in element.all("laneLink")
    )
    to = _end(element, "connectingRoad", "linkedRoad")
    return Way(junction.string("id", ""), element.string("incomingRoad", ""), *to, tuple(lanes))


def _link(element: Element | None) -> Link | None:
    if element is None:
        return None
    return Link(element.line, element.string("elementType", "road") == "junction", *_end(element, "elementId"))


def _end(element: Element, *names: str) -> tuple[str, int]:
    """Id of the road that an element names by one of these attributes, and the end of it that it means."""
    ident = next((element.string(name) for name in names if name in element.attributes), "")
    return ident, END if element.string("contactPoint", "start") == "end" else START


def _leans(element: Element) -> int:
    """Line of the first superelevation that is not 0; 0: there is none."""
    holder = element.child("lateralProfile")
    parts = holder.all("superelevation") if holder is not None else ()
    return next((part.line for part in parts if any(_polynomial(part, "s")[1:])), 0)


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


def _section(element: Element) -> Section:
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
            way = _WAYS.get(lane.attributes.get("direction", "standard"))
            if way is None:
                lane.fault(f'lane {ident} has direction "{lane.string("direction")[:40]}"')
            lanes[ident] = Lane(
                ident, lane.string("type", "none"), way, widths, _marks(lane), _limits(lane, "sOffset"),
                (_lane_links(lane, "predecessor"), _lane_links(lane, "successor")),
            )  # fmt: skip
        count = sum(k * sign > 0 for k in lanes)
        missing = next((sign * k for k in range(1, count + 1) if sign * k not in lanes), None)
        if missing is not None:
            element.fault(f"lane {missing} is missing")
    middle = element.child("center", "lane")
    marks = () if middle is None else _marks(middle)
    return Section(element.number("s", low=0.0, high=1e6, unit="m"), element.line, lanes, marks)


def _lane_links(lane: Element, tag: str) -> tuple[int, ...]:
    holder = lane.child("link")
    return () if holder is None else tuple(one.integer("id", low=-1000, high=1000) for one in holder.all(tag))


def _marks(lane: Element) -> tuple[tuple[float, str, str], ...]:
    """(sOffset, type, laneChange) of the lines along a lane's outer side."""
    return tuple(sorted(
        (mark.number("sOffset", 0.0, low=0.0, high=1e6), mark.string("type", "none"), mark.string("laneChange", ""))
        for mark in lane.all("roadMark")
    ))  # fmt: skip


def _limits(holder: Element, begin: str) -> tuple[tuple[float, float], ...]:
    """(place, m/s) of speed limits; what is no number, such as "no limit", is none."""
    found = []
    for speed in holder.all("speed"):
        if speed.string("max").replace(".", "", 1).isdigit():
            unit = _UNITS.get(speed.string("unit", "m/s"))
            if unit is None:
                speed.fault(f'its unit is "{speed.string("unit")[:20]}"; m/s, km/h and mph are known')
            found.append((speed.number(begin, 0.0, low=0.0, high=1e6), unit * speed.number("max", low=0.0, high=1e3)))
    return tuple(sorted(found))


def _piece(element: Element) -> Piece:
    s, length = (element.number(name, low=0.0, high=1e6, unit="m") for name in ("s", "length"))
    x, y = (element.number(name, low=-_FARTHEST, high=_FARTHEST, unit="m") for name in "xy")
    heading = element.number("hdg", low=-1e3, high=1e3, unit="rad")
    shape = next(iter(element.all("line", "arc", "spiral", "poly3", "paramPoly3")), None)
    if shape is None:
        element.fault("this geometry is no line, arc, spiral, poly3 or paramPoly3")
    return Piece(s, x, y, heading, length, *_bend(shape, length), element.line, shape)


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
    if abs(b) > SAME_HEADING or abs(a) > _FLAT:
        return shape.tag, max(off, _FLAT), 0.0  # it does not begin along its heading
    return shape.tag, off, 1.0 / bend if bend > 0.0 else math.inf
