"""Junctions of SUMO networks (.net.xml) as sites: routes, right of way, signals, crosswalks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import InputError, UnknownNameError
from cornerforge.ext.interchange.read_sumo import Connection, Name, Net, read_shape, read_sumo
from cornerforge.ext.interchange.xml_input import Element, read_xml
from cornerforge.site.network import STEP, Phase, Route, Site, Turn

__all__ = ["REACH", "site_of_sumo"]

REACH = 100.0
"""Routes begin so far before the junction, and end so far behind it, where its lanes reach so far [m]."""
_TURNS: dict[str, Turn] = {"s": "straight", "l": "left", "L": "left", "r": "right", "R": "right", "t": "back"}
_JOINT = 8.0
"""Where edges go on in one another, lanes are joined over so much of each [m]."""
_BENT = 0.4
"""Length of the handles of a way through the junction, over the distance of its ends."""
_OFF = 1.0
"""A way that leads so far from the file's own is named [m]."""
_WALKS = 1.5
"""Speed that stands for a limit where people walk [m/s]."""


def site_of_sumo(path: Path, junction: str) -> Site:
    """Take a junction of a network.

    A route is the last part of a lane, a smooth way through the junction, and the first part of a lane behind it, over
    edges that merely go on in one another; a crosswalk is one route each way. Who yields, and the signals' programme,
    are the file's.

    Raises:
        InputError: The file is missing, or the junction has nothing to drive on.
        UnknownNameError: It has no junction of that name.
        FileFormatError, DataError: It is damaged; with the line.
    """
    net, top = read_sumo(path), read_xml(path, root="net", what="a SUMO network")
    named = {one.string("id"): one for one in top.all("junction") if one.string("type", "") != "internal"}
    if junction not in named:
        raise UnknownNameError("junction", junction, sorted(named))
    ways = net.connections.get(junction, [])
    if not ways:
        raise InputError(f"Junction {junction} of {path} connects no lanes of cars; take another one.")
    links = _links(top, junction)
    notes: list[str] = []
    walks = _crosswalks(top, junction)
    after = _right_of_way(named[junction], len(links), len(walks))
    place = {id_of(way.element): k for k, way in enumerate(ways)}
    index = [links.get(id_of(way.element), -1) for way in ways]
    people = [len(ways) + 2 * k + back for k in range(len(walks)) for back in (0, 1)]
    missing = len(links) - len(place)
    if missing:
        notes.append(f"{missing} connections that turn back, or are not for cars, are left out")

    def yields(own: int) -> tuple[int, ...]:
        first = after.get(own, frozenset())
        of_cars = [k for k, link in enumerate(index) if link in first]
        of_people = [people[2 * k + back] for k in range(len(walks)) if len(links) + k in first for back in (0, 1)]
        return tuple(of_cars + of_people)

    routes = [_route(net, way, yields(index[k]), notes) for k, way in enumerate(ways)]
    for k, walk in enumerate(walks):
        routes += _walked(net, walk, _signal_of_walk(top, walk), yields(len(links) + k))
    return Site(
        name=f"{path.name.partition('.')[0]} {junction}",
        routes=tuple(routes),
        programme=_programme(top, routes, ways, notes),
        notes=tuple(dict.fromkeys(notes)),
    )


def id_of(connection: Element) -> tuple[str, ...]:
    """Name a connection by where it leads from and to."""
    return tuple(connection.string(name, "") for name in ("from", "fromLane", "to", "toLane"))


def _links(top: Element, junction: str) -> dict[tuple[str, ...], int]:
    """Number the connections of a junction as its rows of the right of way are numbered: by edge and lane within it."""
    found: dict[tuple[str, ...], tuple[int, int]] = {}
    for one in top.all("connection"):
        via = one.string("via", "")
        if via.startswith(f":{junction}_") and not one.string("from").startswith(":"):
            try:
                edge, lane = (int(part) for part in via.removeprefix(f":{junction}_").split("_"))
            except ValueError:
                one.fault(f"it goes via {via[:40]}, which is no lane of junction {junction}")
            found[id_of(one)] = edge, lane
    ordered = sorted(found, key=lambda name: found[name])
    return {name: k for k, name in enumerate(ordered)}


def _right_of_way(junction: Element, links: int, walks: int) -> dict[int, frozenset[int]]:
    """Read to which links each yields: the last letter of `response` is that of link 0; crosswalks come after links."""
    found: dict[int, frozenset[int]] = {}
    for row in junction.all("request"):
        own, letters = row.integer("index", low=0, high=255), row.string("response", "")
        if len(letters) != links + walks:
            row.fault(
                f"response has {len(letters)} letters; the junction has {links} connections and {walks} crosswalks"
            )
        found[own] = frozenset(k for k, letter in enumerate(reversed(letters)) if letter == "1")
    return found


def _crosswalks(top: Element, junction: str) -> list[Element]:
    return [
        edge for edge in top.all("edge")
        if edge.string("function", "") == "crossing" and edge.string("id").rpartition("_c")[0] == f":{junction}"
    ]  # fmt: skip


def _signal_of_walk(top: Element, walk: Element) -> int:
    """Look up the place of a crosswalk's letter, on the way into it; -1: no signal."""
    for one in top.all("connection"):
        if one.string("to") == walk.string("id") and one.string("tl", ""):
            return one.integer("linkIndex", low=0, high=255)
    return -1


def _walked(net: Net, walk: Element, signal: int, yields: tuple[int, ...]) -> list[Route]:
    """Make the routes of a crosswalk, there and back."""
    lane = walk.need("lane")
    line, width = read_shape(lane, net), lane.number("width", low=0.5, high=10.0, unit="m")
    name = walk.string("id").rpartition("_")[2]
    over = walk.string("crossingEdges", "").split()
    return [
        Route(
            name=f"{name} {which}", approach=f"{name} {which}", exit=" ".join(over)[:80], turn="walk",
            points=_listed(points), width=width, stop=0.0, leaves=round(_length(line), 3), limits=(_WALKS, _WALKS),
            signal=signal, yields_to=yields,
        )
        for which, points in (("there", line), ("back", line[::-1]))
    ]  # fmt: skip


def _route(net: Net, way: Connection, yields: tuple[int, ...], notes: list[str]) -> Route:
    """Make the route of a connection."""
    before, behind = net.lanes[way.begin], net.lanes[way.end]
    approach = _last(_further(net, way.begin, back=True))
    leaving = _last(_further(net, way.end, back=False)[::-1])[::-1]
    through = _curve(approach, leaving)
    off = _farthest(way.way, through)
    if off > _OFF:
        notes.append(f"{_name(way)}: the way through the junction is up to {off:.1f} m from the file's own")
    stop = _length(approach)
    leaves = stop + _length(through)
    line = _even(np.concatenate([approach, through[1:-1], leaving]))
    element = way.element
    return Route(
        name=_name(way), approach=way.begin[0], exit=way.end[0],
        turn=_TURNS.get(element.string("dir", "s"), "straight"), points=_listed(line),
        width=min(before.width, behind.width), stop=round(stop, 3), leaves=round(min(leaves, _length(line)), 3),
        limits=(before.limit, min(before.limit, behind.limit)),
        signal=element.integer("linkIndex", low=0, high=255) if element.string("tl", "") else -1, yields_to=yields,
    )  # fmt: skip


def _name(way: Connection) -> str:
    return f"{way.begin[0]}_{way.begin[1]}>{way.end[0]}_{way.end[1]}"


def _further(net: Net, name: Name, *, back: bool) -> NDArray[np.float64]:
    """Lengthen a lane to `REACH`, back or ahead, over places where one edge merely goes on in another."""
    line, passed = net.lanes[name].shape, {name[0]}
    while _length(line) < REACH:
        junction = net.edges[name[0]].string("from" if back else "to")
        ways = net.connections.get(junction, [])
        if junction in net.lights or len({way.edges for way in ways}) != 1:
            return line
        there = [way for way in ways if (way.end if back else way.begin) == name]
        if not there or there[0].edges[0 if back else 1] in passed:
            return line
        name = min(
            (way.begin if back else way.end for way in there), key=lambda lane: _aside(net, name, lane, back=back)
        )
        passed.add(name[0])
        more = net.lanes[name].shape
        line = _joined(more, line) if back else _joined(line, more)
    return line


def _aside(net: Net, name: Name, other: Name, *, back: bool) -> float:
    """Measure how far apart two lanes that follow each other end and begin [m]."""
    first, second = (other, name) if back else (name, other)
    return float(np.hypot(*(net.lanes[second].shape[0] - net.lanes[first].shape[-1])))


def _joined(before: NDArray[np.float64], behind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Join two lines where lanes may lie aside of each other: smoothly, over `_JOINT` of each or a third of it."""
    before = _part(before, 0.0, _length(before) - min(_JOINT, _length(before) / 3.0))
    behind = _part(behind, min(_JOINT, _length(behind) / 3.0), _length(behind))
    return np.concatenate([before, _curve(before, behind)[1:-1], behind])


def _last(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take the last `REACH` metres of a line."""
    return _part(line, max(0.0, _length(line) - REACH), _length(line))


def _part(line: NDArray[np.float64], begin: float, end: float) -> NDArray[np.float64]:
    """Cut a line, from where to where along it [m]."""
    along = _along(line)
    ends = np.stack([np.interp([begin, end], along, values) for values in line.T], axis=1)
    return np.concatenate([ends[:1], line[(along > begin + 1e-6) & (along < end - 1e-6)], ends[1:]])


def _curve(before: NDArray[np.float64], behind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lead smoothly from the end of a line to the begin of another: a cubic of Bezier, its directions those of both."""
    a, d = before[-1], behind[0]
    distance = float(np.hypot(*(d - a)))
    b = a + _BENT * distance * _direction(before[-2:])
    c = d - _BENT * distance * _direction(behind[:2])
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
