"""Junctions of SUMO networks (.net.xml) as sites: routes, right of way, signals, crosswalks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator

from cornerforge.errors import InputError, UnknownNameError
from cornerforge.ext.interchange.read_sumo import Connection, Name, Net, read_shape, read_sumo
from cornerforge.ext.interchange.sumo_ways import Chain, RightOfWay, chains_of, junction_of
from cornerforge.ext.interchange.xml_input import Element, read_xml
from cornerforge.site.mending import with_kerbs
from cornerforge.site.network import STEP, Phase, Route, Site, Turn, headings_of

__all__ = ["REACH", "site_of_sumo"]

REACH = 100.0
"""Routes begin so far before the junction, and end so far behind it, where its lanes reach so far [m]."""
_TURNS: dict[str, Turn] = {"s": "straight", "l": "left", "L": "left", "r": "right", "R": "right", "t": "back"}
_JOINT = 8.0
"""Where edges go on in one another, lanes are joined over so much of each [m]."""
_BENT = 0.4
"""Length of the handles of a way that joins two lanes, over the distance of its ends."""
_BENTS = (0.4, 0.35, 0.3, 0.25)
"""Lengths that are tried for a way through a junction; the one nearest the file's own is taken."""
_OFF = 1.0
"""A way that leads so far from the file's own is named [m]."""
_STRAIGHT = np.radians(20.0)
"""A way over another junction is straight if it bends by no more [rad]."""
_AWAY = 15.0
"""Where a route over several junctions comes from and leads is seen so far before and behind them [m]."""
_ISLAND = 5.0
"""Crosswalks in a row so near each other are one [m]."""
_LONGEST, _MOST = 400.0, 64
"""Length of a route [m], and how many a site has, at most."""
_WALKS = 1.5
"""Speed that stands for a limit where people walk [m/s]."""


def site_of_sumo(path: Path, junctions: str, *, reach: float = REACH, over: bool = False) -> Site:
    """Take a junction of a network, or several as one.

    A route is the last part of a lane, a smooth way through the junctions and over the lanes between them, and the
    first part of a lane behind them, over edges that merely go on in one another; it passes no junction twice. A
    crosswalk is one route each way. Who yields, and the signals' programme, are the file's.

    Args:
        path: The network.
        junctions: Ids of the junctions, with commas.
        reach: How far routes lead before the junctions and behind them, where lanes reach so far [m].
        over: Lead them back over other junctions too: by the only way to a lane, or the straightest, if it bends by 20
            degrees at most.

    Raises:
        InputError: The file is missing, or the junctions have nothing to drive on, or too much.
        UnknownNameError: It has no junction of that name.
        FileFormatError, DataError: It is damaged; with the line.
    """
    net, top = read_sumo(path), read_xml(path, root="net", what="a SUMO network")
    named = {one.string("id"): one for one in top.all("junction") if one.string("type", "") != "internal"}
    wanted = tuple(dict.fromkeys(junctions.split(",")))
    for junction in wanted:
        if junction not in named:
            raise UnknownNameError("junction", junction, sorted(named))
    chains = list(islice(chains_of(net, wanted), _MOST + 1))
    if not chains:
        raise InputError(f"Junction {junctions} of {path} connects no lanes of cars; take another one.")
    if len(chains) > _MOST:
        raise InputError(f"More than {_MOST} routes lead over {junctions}; take fewer junctions.")
    notes: list[str] = []
    rules = RightOfWay(top, named)
    missing = sum(len(rules.links(junction)) for junction in wanted)
    missing -= sum(len(net.connections.get(junction, [])) for junction in wanted)
    if missing:
        notes.append(f"{missing} connections that turn back, or are not for cars, are left out")
    made = [_route(net, chain, reach, over, notes) for chain in chains]
    if (longest := max(route.length for route, _ in made)) > _LONGEST:
        raise InputError(
            f"A route is {longest:.0f} m long; {_LONGEST:g} m is most. Take fewer junctions, or less reach."
        )
    routes = [route for route, _ in made]
    passed = [[(*rules.place(junction, way), at) for junction, way, at in passes] for _, passes in made]
    for walk in _walks(net, top, wanted, rules, notes):
        routes += walk.routes()
        passed += walk.passed()
    if len(routes) > _MOST:
        raise InputError(f"More than {_MOST} routes lead over {junctions}; take fewer junctions.")
    several = len(wanted) > 1 or over
    return with_kerbs(
        Site(
            name=f"{path.name.partition('.')[0]} {junctions}",
            routes=tuple(_with_right_of_way(routes, passed, rules, several=several)),
            programme=_programme(top, routes, [way for chain in chains for way in chain], notes),
            notes=tuple(dict.fromkeys(notes)),
        )
    )


def _with_right_of_way(
    routes: Sequence[Route], passed: Sequence[Sequence[tuple[str, int, float]]], rules: RightOfWay, *, several: bool
) -> Iterator[Route]:
    """Say to which routes each yields, and where, if there are several junctions in which it may."""
    for route, own in zip(routes, passed, strict=True):
        found = [
            (k, round(at, 3)) for k, others in enumerate(passed) for junction, link, at in own
            if any(where == junction and other in rules.rows(junction).get(link, ()) for where, other, _ in others)
        ]  # fmt: skip
        yield replace(
            route, yields_to=tuple(k for k, _ in found), yields_at=tuple(at for _, at in found) if several else ()
        )


@dataclass(frozen=True, eq=False)
class _Walk:
    """A crosswalk, or two in a row with an island between.

    Attributes:
        line: Points, (P, 2) [m].
        over: Edges that it crosses.
        rows: Its junctions, its places in their rows, and where along it their middles are [m].
    """

    name: str
    line: NDArray[np.float64]
    width: float
    over: str
    signal: int
    rows: tuple[tuple[str, int, float], ...]

    def joined(self, other: _Walk) -> _Walk | None:
        """Join it to another that goes on where it ends; None if that does not."""
        for one, two in ((self, other), (other, self)):
            gap, ways = two.line[0] - one.line[-1], (_direction(one.line[-2:]), _direction(two.line[:2]))
            near = np.hypot(*gap) < _ISLAND and ways[0] @ ways[1] > np.cos(_STRAIGHT)
            if near and one.signal == two.signal and ways[0] @ gap > np.cos(_STRAIGHT) * np.hypot(*gap):
                behind = _length(one.line) + float(np.hypot(*gap))
                return _Walk(
                    f"{one.name}+{two.name}", np.concatenate([one.line, two.line]), min(one.width, two.width),
                    f"{one.over} {two.over}", one.signal,
                    (*one.rows, *((where, row, behind + at) for where, row, at in two.rows)),
                )  # fmt: skip
        return None

    def turned(self) -> _Walk:
        """Give it the other way round."""
        length = _length(self.line)
        rows = tuple((where, row, length - at) for where, row, at in self.rows)
        return replace(self, line=self.line[::-1], rows=rows)

    def routes(self) -> list[Route]:
        """Make its routes, there and back."""
        length = round(_length(self.line), 3)
        return [
            Route(
                name=f"{self.name} {which}", approach=f"{self.name} {which}", exit=self.over[:80], turn="walk",
                points=_listed(line), width=self.width, stop=0.0, leaves=length, limits=(_WALKS, _WALKS),
                signal=self.signal,
            )
            for which, line in (("there", self.line), ("back", self.line[::-1]))
        ]  # fmt: skip

    def passed(self) -> list[list[tuple[str, int, float]]]:
        """List the places in the rows of each of its routes."""
        return [list(self.rows), list(self.turned().rows)]


def _walks(net: Net, top: Element, junctions: Sequence[str], rules: RightOfWay, notes: list[str]) -> list[_Walk]:
    """Read the crosswalks of junctions; two of different junctions that an island parts are one."""
    found: list[_Walk] = []
    for junction in junctions:
        for k, walk in enumerate(rules.crosswalks(junction)):
            lane = walk.need("lane")
            line = read_shape(lane, net)
            name = walk.string("id").removeprefix(":")
            one = _Walk(
                name if len(junctions) > 1 else name.rpartition("_")[2], line,
                lane.number("width", low=0.5, high=10.0, unit="m"), walk.string("crossingEdges", ""),
                _signal_of_walk(top, walk), ((junction, len(rules.links(junction)) + k, 0.5 * _length(line)),),
            )  # fmt: skip
            pairs = (
                (k, other.joined(way)) for k, other in enumerate(found) for way in (one, one.turned())
                if junction not in {row[0] for row in other.rows}
            )  # fmt: skip
            for at, both in pairs:
                if both is not None:
                    notes.append(f"crosswalks {both.name.replace('+', ' and ')} are one, with an island between")
                    found[at] = both
                    break
            else:
                found.append(one)
    return found


def _signal_of_walk(top: Element, walk: Element) -> int:
    """Look up the place of a crosswalk's letter, on the way into it; -1: no signal."""
    for one in top.all("connection"):
        if one.string("to") == walk.string("id") and one.string("tl", ""):
            return one.integer("linkIndex", low=0, high=255)
    return -1


def _route(
    net: Net, chain: Chain, reach: float, over: bool, notes: list[str]
) -> tuple[Route, list[tuple[str, Connection, float]]]:
    """Make the route of a chain of connections; with it where along it are the middles of junctions that it passes."""
    first, last = chain[0], chain[-1]
    before = _further(net, first.begin, {way.edges[1] for way in chain}, reach, over, back=True)
    behind = _further(net, last.end, {way.edges[0] for way in chain}, reach, over, back=False)
    approach, leaving = before.line, behind.line
    name = f"{first.begin[0]}_{first.begin[1]}>{last.end[0]}_{last.end[1]}"
    line, inside = approach, []
    for way in chain:
        then = leaving if way is last else _rounded(net.lanes[way.end].shape)
        through = min((_curve(line, then, bent) for bent in _BENTS), key=lambda curve: _farthest(way.way, curve))
        off = _farthest(way.way, through)
        if off > _OFF:
            notes.append(f"{name}: the way through the junction is up to {off:.1f} m from the file's own")
        inside.append((junction_of(net, way), way, _length(line) + 0.5 * _length(through)))
        leaves = _length(line) + _length(through)
        line = np.concatenate([line, through[1:-1], then])
    stop = _length(approach)
    notes += [f"{first.begin[0]}_{first.begin[1]} {note}" for note in before.notes]
    lanes = [net.lanes[first.begin], *(net.lanes[way.end] for way in chain)]
    signals = [way.element for way in chain if way.element.string("tl", "")]
    if len(signals) > 1:
        signals[1].fault(f"route {name} passes two signals; a route has one")
    whole = _even(line)
    route = Route(
        name=name, approach=first.begin[0], exit=last.end[0],
        turn=_turn(chain, whole, stop, leaves), points=_listed(whole),
        width=min(lane.width for lane in lanes), stop=round(stop, 3), leaves=round(min(leaves, _length(whole)), 3),
        limits=(lanes[0].limit, min(lane.limit for lane in lanes)),
        signal=signals[0].integer("linkIndex", low=0, high=255) if signals else -1,
    )  # fmt: skip
    passes = [(junction, way, stop - at) for junction, way, at in before.passed]
    return route, [*passes, *inside, *((junction, way, leaves + at) for junction, way, at in behind.passed)]


def _rounded(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lead a smooth line through the points of a lane, which is drawn with kinks."""
    if len(line) < 3:
        return line
    along = _along(line)
    at = np.linspace(0.0, along[-1], max(3, round(2.0 * float(along[-1])) + 1))
    rounded: NDArray[np.float64] = Akima1DInterpolator(along, line, method="makima")(at)
    return rounded


def _turn(chain: Chain, line: NDArray[np.float64], stop: float, leaves: float) -> Turn:
    """Say where a route leads: as its connection says, or by how far it turns from before the junctions to behind."""
    if len(chain) == 1:
        return _TURNS.get(chain[0].element.string("dir", "s"), "straight")
    along = _along(line)
    part = (along >= stop - _AWAY) & (along <= leaves + _AWAY)
    headings = headings_of(line[part])
    turned = float(np.degrees(headings[-1] - headings[0]))
    return "straight" if abs(turned) < 45.0 else "back" if abs(turned) > 135.0 else "left" if turned > 0.0 else "right"


@dataclass
class _Further:
    """A lane that was lengthened.

    Attributes:
        line: Its points, those of the junction's side unmoved, (P, 2) [m].
        passed: Junctions that it passes, with the connections, and how far from that side [m].
        notes: About those that are more than one edge that goes on in another.
    """

    line: NDArray[np.float64]
    passed: list[tuple[str, Connection, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def _further(net: Net, name: Name, own: set[str], reach: float, over: bool, *, back: bool) -> _Further:
    """Lengthen a lane to `reach`, back or ahead, over places where one edge merely goes on in another.

    With `over` also back over other junctions, but not onto `own` edges of the route.
    """
    found, met = _Further(net.lanes[name].shape), {name[0], *own}
    while _length(found.line) < reach:
        junction = net.edges[name[0]].string("from" if back else "to")
        ways = net.connections.get(junction, [])
        plain = junction not in net.lights and len({way.edges for way in ways}) == 1
        there = [way for way in ways if (way.end if back else way.begin) == name]
        there = [way for way in there if plain or (back and over and (len(there) == 1 or _bend(net, way) <= _STRAIGHT))]
        there = [way for way in there if way.edges[0 if back else 1] not in met]
        if not there:
            break
        way = min(there, key=lambda way: (0.0 if plain else _bend(net, way), _aside(net, way)))
        name = way.begin if back else way.end
        met.add(name[0])
        more, along = net.lanes[name].shape, _length(found.line)
        before, behind = (more, found.line) if back else (found.line, more)
        found.line = (
            _joined(before, behind) if plain else np.concatenate([before, _curve(before, behind)[1:-1], behind])
        )
        found.passed.append((junction, way, 0.5 * (along + _length(found.line) - _length(more))))
        if not plain:
            found.notes.append(f"comes over {junction}, whose other ways, crosswalks and lights are not there")
    length = _length(found.line)
    found.line = _part(found.line, max(0.0, length - reach) if back else 0.0, length if back else min(reach, length))
    return found


def _bend(net: Net, way: Connection) -> float:
    """Measure by how much a way leads in another direction than it came from [rad]."""
    from_, to = _direction(net.lanes[way.begin].shape[-2:]), _direction(net.lanes[way.end].shape[:2])
    return float(np.arccos(np.clip(from_ @ to, -1.0, 1.0)))


def _aside(net: Net, way: Connection) -> float:
    """Measure how far apart two lanes that follow each other end and begin [m]."""
    return float(np.hypot(*(net.lanes[way.end].shape[0] - net.lanes[way.begin].shape[-1])))


def _joined(before: NDArray[np.float64], behind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Join two lines where lanes may lie aside of each other: smoothly, over `_JOINT` of each or a third of it."""
    before = _part(before, 0.0, _length(before) - min(_JOINT, _length(before) / 3.0))
    behind = _part(behind, min(_JOINT, _length(behind) / 3.0), _length(behind))
    return np.concatenate([before, _curve(before, behind)[1:-1], behind])


def _part(line: NDArray[np.float64], begin: float, end: float) -> NDArray[np.float64]:
    """Cut a line, from where to where along it [m]."""
    along = _along(line)
    ends = np.stack([np.interp([begin, end], along, values) for values in line.T], axis=1)
    return np.concatenate([ends[:1], line[(along > begin + 1e-6) & (along < end - 1e-6)], ends[1:]])


def _curve(before: NDArray[np.float64], behind: NDArray[np.float64], bent: float = _BENT) -> NDArray[np.float64]:
    """Lead smoothly from the end of a line to the begin of another: a cubic of Bezier, its directions those of both."""
    a, d = before[-1], behind[0]
    distance = float(np.hypot(*(d - a)))
    b = a + bent * distance * _direction(before[-2:])
    c = d - bent * distance * _direction(behind[:2])
    t = np.linspace(0.0, 1.0, max(3, round(4.0 * distance)))[:, None]
    curve: NDArray[np.float64] = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
    return curve


def _direction(pair: NDArray[np.float64]) -> NDArray[np.float64]:
    way = pair[1] - pair[0]
    unit: NDArray[np.float64] = way / np.hypot(*way)
    return unit


def _even(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Put points a metre apart on a line; its ends stay."""
    along = _along(line)
    kept = np.append(True, np.diff(along) > 1e-9)
    at = np.linspace(0.0, along[-1], max(2, round(float(along[-1]) / STEP) + 1))
    return np.stack([np.interp(at, along[kept], values[kept]) for values in line.T], axis=1)


def _along(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measure how far along a line each of its points is, (P,) [m]."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))


def _length(line: NDArray[np.float64]) -> float:
    return float(_along(line)[-1])


def _listed(line: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    return tuple((round(x, 3), round(y, 3)) for x, y in line.tolist())


def _farthest(points: NDArray[np.float64], line: NDArray[np.float64]) -> float:
    """Measure how far the points of the file lie from a line, at most [m]."""
    if not len(points):
        return 0.0
    return float(np.hypot(*(points[:, None] - line[None]).transpose(2, 0, 1)).min(axis=1).max())


def _programme(
    top: Element, routes: Sequence[Route], ways: Sequence[Connection], notes: list[str]
) -> tuple[Phase, ...]:
    """Read the phases of the junction's signals; none if it has none."""
    names = {way.element.string("tl", "") for way in ways} - {""}
    if not names:
        return ()
    if len(names) > 1:
        ways[0].element.fault(f"the junction has several programmes of signals: {', '.join(sorted(names))}")
    logics = {one.string("programID", "0"): one for one in top.all("tlLogic") if one.string("id") in names}
    if not logics:
        ways[0].element.fault(f"its signals {names.pop()} have no programme")
    logic = next(iter(logics.values()))
    if len(logics) > 1:
        notes.append(f"of {len(logics)} programmes of the signals the first is taken")
    if logic.string("type", "static") != "static":
        notes.append(f"the signals are {logic.string('type')}; the programme is taken with its stated lengths")
    most = max(route.signal for route in routes)
    return tuple(_phase(one, most) for one in logic.all("phase"))


_LETTERS: Mapping[str, str] = {"G": "G", "g": "g", "y": "y", "Y": "y", "u": "r", "r": "r", "s": "g"}
"""Letters of SUMO: u is red and amber, s a right turn that must stop first (taken as one that yields)."""


def _phase(phase: Element, most: int) -> Phase:
    states = phase.string("state")
    if len(states) <= most:
        phase.fault(f"state has {len(states)} letters; connections use {most + 1}")
    if unknown := sorted(set(states) - set(_LETTERS)):
        phase.fault(f"state has the letter {unknown[0]}, of a signal that is off; signals that work are read")
    return Phase(
        phase.number("duration", low=0.1, high=1000.0, unit="s"), "".join(_LETTERS[letter] for letter in states)
    )
