"""SUMO networks (.net.xml), as they stand there: edges that lead one way, their lanes, and what connects them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.interchange.xml_input import Element, read_xml

__all__ = ["Connection", "Edge", "Lane", "Net", "read_sumo"]

_BESIDE = ("stop", "shoulder", "border", "restricted", "parking", "sidewalk", "biking", "median", "none")
"""Types of lanes that netconvert takes over from OpenDRIVE and lets cars into."""
_WIDE = 3.2
"""Width of a lane that states none [m]."""
_FARTHEST = 1e7
"""Largest coordinate [m]."""
_CARS = "passenger"


@dataclass(frozen=True, eq=False)
class Lane:
    """A lane of an edge.

    Attributes:
        element: Where it stands.
        shape: Points of its middle, (P, 2) [m], no two in a row the same.
        width, limit: [m], [m/s].
        cars: Cars may use it.
        merges: It is marked as an acceleration lane.
        left, right: Cars may leave it to that side, as far as its marks go.
    """

    element: Element
    shape: NDArray[np.float64]
    width: float
    limit: float
    cars: bool
    merges: bool
    left: bool
    right: bool


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge: where it stands, its junctions, and its lanes that vehicles of the road use, by index from the right."""

    element: Element
    begin: str
    end: str
    lanes: dict[int, Lane]


@dataclass(frozen=True)
class Connection:
    """A way from a lane of an edge to a lane of the next, with the points of the ways through the junction."""

    element: Element
    begin: tuple[str, int]
    end: tuple[str, int]
    direction: str
    way: NDArray[np.float64]


@dataclass
class Net:
    """A network.

    Attributes:
        edges: That cars may use, by id.
        connections: Between lanes that cars may use, turns back left out.
        lights: Where the junctions with lights, crossings of people or rails stand, and what they have, by id.
        level: All its points have one height.
    """

    edges: dict[str, Edge] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    lights: dict[str, tuple[Element, str]] = field(default_factory=dict)
    level: bool = True


def read_sumo(path: Path) -> Net:
    """Read a network, .net.xml or .net.xml.gz.

    Raises:
        InputError: The file is missing, or cannot be read.
        FileFormatError, DataError: It is damaged, or its traffic drives on the left; with the line.
    """
    top = read_xml(path, root="net", what="a SUMO network")
    if top.string("lefthand", "false") in ("true", "1"):
        top.fault("its traffic drives on the left; right-hand networks are read")
    net, inner = Net(), {}
    for element in top.all("edge"):
        name, function = element.string("id"), element.string("function", "normal")
        if function == "crossing":
            junction = name.removeprefix(":").rpartition("_c")[0]
            net.lights.setdefault(junction, (element, "a crossing for people"))
        elif function == "internal":
            inner.update({one.string("id"): one for one in element.all("lane")})
        elif function == "normal":
            lanes = _lanes(element, net)
            if name in net.edges:
                element.fault(f"edge {name} is there twice")
            if any(lane.cars for lane in lanes.values()):
                net.edges[name] = Edge(element, element.string("from"), element.string("to"), lanes)
    for element in top.all("junction"):
        kind = element.string("type", "priority")
        if kind.startswith(("traffic_light", "rail")):
            net.lights[element.string("id")] = element, "traffic lights" if kind[0] == "t" else "a rail crossing"
    _connect(top, net, inner)
    return net


def _lanes(edge: Element, net: Net) -> dict[int, Lane]:
    """Read the lanes of an edge; those beside the road are left out."""
    found: dict[int, Lane] = {}
    indices = set()
    for lane in edge.all("lane"):
        index = lane.integer("index", low=0, high=99)
        if index in indices:
            lane.fault(f"edge {edge.string('id')} has two lanes of index {index}")
        indices.add(index)
        lane.number("length", low=0.1, high=1e6, unit="m")
        cars = _may(lane, "allow", "disallow") and lane.string("type", "") not in _BESIDE
        found[index] = Lane(
            lane, _shape(lane, net), lane.number("width", _WIDE, low=0.1, high=100.0, unit="m"),
            lane.number("speed", low=0.1, high=100.0, unit="m/s"), cars,
            lane.string("acceleration", "0") in ("1", "true"), _may(lane, "changeLeft"), _may(lane, "changeRight"),
        )  # fmt: skip
    if not found:
        edge.fault(f"edge {edge.string('id')} has no lane")
    return found


def _may(lane: Element, allow: str, disallow: str = "") -> bool:
    """Say whether a lane lets cars do something, by its list of classes that may, or of those that may not."""
    given, barred = (lane.string(one, "").split() for one in (allow, disallow))
    return (_CARS in given or "all" in given) if given else not (_CARS in barred or "all" in barred)


def _shape(lane: Element, net: Net, least: int = 2) -> NDArray[np.float64]:
    """Read the points of a lane, of which `least` must lie apart."""
    points = []
    for point in lane.string("shape").split():
        try:
            numbers = np.array([float(number) for number in point.split(",")])
        except ValueError:
            numbers = np.array([])
        if len(numbers) not in (2, 3) or not (np.abs(numbers) <= _FARTHEST).all():
            lane.fault(f'shape of lane {lane.string("id")[:40]} has the point "{point[:40]}"; x,y or x,y,z is needed')
        net.level &= len(numbers) == 2
        points.append(numbers[:2])
    apart = [k for k in range(len(points)) if k == 0 or np.hypot(*(points[k] - points[k - 1])) > 1e-3]
    if len(apart) < least:
        lane.fault(f"shape of lane {lane.string('id')[:40]} has fewer than {least} points that lie apart")
    return np.array([points[k] for k in apart])


def _connect(top: Element, net: Net, inner: dict[str, Element]) -> None:
    """Read the connections, each with its way through the junction."""
    after: dict[str, dict[tuple[str, int], str]] = defaultdict(dict)  # the next lane inside, by lane inside and end
    outer = []
    for one in top.all("connection"):
        begin, end = ((one.string(name), one.integer(f"{name}Lane", low=0, high=99)) for name in ("from", "to"))
        if begin[0].startswith(":"):
            after[f"{begin[0]}_{begin[1]}"][end] = one.string("via", "")
        elif one.string("dir", "s") != "t" and all(name in net.edges for name, _ in (begin, end)):
            outer.append((one, begin, end))
    for one, begin, end in outer:
        for name, index in (begin, end):
            if index not in net.edges[name].lanes:
                one.fault(f"it connects lane {index} of edge {name}, which has none")
        shapes, via = [np.empty((0, 2))], one.string("via", "")
        while via:
            if via not in inner:
                one.fault(f"it goes via lane {via[:40]}, which is not there")
            shapes.append(_shape(inner.pop(via), net, 1))
            via = after[via].get(end, "")
        if all(net.edges[name].lanes[index].cars for name, index in (begin, end)):
            net.connections.append(Connection(one, begin, end, one.string("dir", "s"), np.concatenate(shapes)))
        if one.string("tl", ""):
            net.lights.setdefault(net.edges[begin[0]].end, (one, "traffic lights"))
