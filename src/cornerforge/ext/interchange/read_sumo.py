"""SUMO networks (.net.xml), as they stand there: edges that lead one way, their lanes, and what connects them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.ext.interchange.xml_input import Element, read_xml

__all__ = ["BESIDE", "Connection", "Lane", "Name", "Net", "apart", "read_sumo"]

BESIDE = ("stop", "shoulder", "border", "restricted", "parking", "sidewalk", "biking", "median", "none")
"""Types of lanes that netconvert takes over from OpenDRIVE and lets cars into."""
_WIDE = 3.2
"""Width of a lane that states none [m]."""
_FARTHEST = 1e7
"""Largest coordinate [m]."""
_MOST_POINTS, _LONGEST = 10_000, 1e5
"""Most points of a lane, and how far they go [m]."""
_CARS = "passenger"
Name = tuple[str, int]
"""Id of an edge, and index of a lane from the right."""


@dataclass(frozen=True, eq=False)
class Lane:
    """A lane of an edge: where it stands, the points of its middle (P, 2) [m], width [m] and speed limit [m/s].

    Attributes:
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


@dataclass(frozen=True)
class Connection:
    """A way from a lane to one of the next edge, and its points in the junction (P, 2) [m]."""

    element: Element
    begin: Name
    end: Name
    way: NDArray[np.float64]

    @property
    def edges(self) -> tuple[str, str]:
        """Ids of the edges that it connects."""
        return self.begin[0], self.end[0]


@dataclass
class Net:
    """A network.

    Attributes:
        edges: By id, those that cars may use; their attributes `from` and `to` are junctions.
        lanes: Of these edges.
        connections: Between them, but those that turn back, by junction.
        lights: Where the lights, crossings of people and rails of junctions stand, and what they are, by junction.
        level: All its points have one height.
    """

    edges: dict[str, Element] = field(default_factory=dict)
    lanes: dict[Name, Lane] = field(default_factory=dict)
    connections: defaultdict[str, list[Connection]] = field(default_factory=lambda: defaultdict(list))
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
        top.fault("its traffic drives on the left; networks with traffic on the right are read")
    net, inner = Net(), {}
    for edge in top.all("edge"):
        name, function = edge.string("id"), edge.string("function", "normal")
        if function == "crossing":
            net.lights[name.removeprefix(":").rpartition("_c")[0]] = edge, "a crossing for people"
        elif function == "internal":
            inner.update({one.string("id"): one for one in edge.all("lane")})
        elif function == "normal":
            if name in net.edges:
                edge.fault(f"edge {name} is there twice")
            lanes = _lanes(edge, net)
            if any(lane.cars for lane in lanes.values()):
                net.edges[name] = edge
                net.lanes |= {(name, index): lane for index, lane in lanes.items()}
    for junction in top.all("junction"):
        kind = junction.string("type", "priority")
        if kind.startswith(("traffic_light", "rail")):
            net.lights[junction.string("id")] = junction, "traffic lights" if kind[0] == "t" else "a rail crossing"
    _connect(top, net, inner)
    return net


def apart(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out points (P, 2) that lie on the one before."""
    found: NDArray[np.float64] = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-3)]
    return found


def _lanes(edge: Element, net: Net) -> dict[int, Lane]:
    found: dict[int, Lane] = {}
    for lane in edge.all("lane"):
        index = lane.integer("index", low=0, high=99)
        if index in found:
            lane.fault(f"edge {edge.string('id')} has two lanes of index {index}")
        lane.number("length", low=0.1, high=1e6, unit="m")
        found[index] = Lane(
            lane, read_shape(lane, net), lane.number("width", _WIDE, low=0.1, high=100.0, unit="m"),
            lane.number("speed", low=0.1, high=100.0, unit="m/s"),
            _may(lane, "allow", "disallow") and lane.string("type", "") not in BESIDE,
            lane.string("acceleration", "0") in ("1", "true"), _may(lane, "changeLeft"), _may(lane, "changeRight"),
        )  # fmt: skip
    return found


def _may(lane: Element, allow: str, disallow: str = "") -> bool:
    """Say whether a lane lets cars do something, by its list of classes that may, or of those that may not."""
    given, barred = (lane.string(one, "").split() for one in (allow, disallow))
    return (_CARS in given or "all" in given) if given else not (_CARS in barred or "all" in barred)


def read_shape(lane: Element, net: Net, least: int = 2) -> NDArray[np.float64]:
    """Read the points of a lane, of which `least` must lie apart."""
    found = []
    for point in lane.string("shape").split():
        try:
            numbers = [float(number) for number in point.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3) or not all(abs(number) <= _FARTHEST for number in numbers):
            lane.fault(f'shape of lane {lane.string("id")[:40]} has the point "{point[:40]}"; x,y or x,y,z is needed')
        net.level &= len(numbers) == 2
        found.append(numbers[:2])
    points = apart(np.array(found)) if found else np.empty((0, 2))
    if not least <= len(points) <= _MOST_POINTS or float(np.hypot(*np.diff(points, axis=0).T).sum()) > _LONGEST:
        what = f"{least} to {_MOST_POINTS:,} points that lie apart, over {_LONGEST / 1000:.0f} km at most, are needed"
        lane.fault(f"shape of lane {lane.string('id')[:40]} has {len(points)}; {what}")
    return points


def _connect(top: Element, net: Net, inner: dict[str, Element]) -> None:
    """Read the connections, each with its way through the junction."""
    after: dict[str, dict[Name, str]] = defaultdict(dict)
    outer = []
    for one in top.all("connection"):
        begin, end = ((one.string(name), one.integer(f"{name}Lane", low=0, high=99)) for name in ("from", "to"))
        if begin[0].startswith(":"):
            after[f"{begin[0]}_{begin[1]}"][end] = one.string("via", "")
        elif one.string("dir", "s") != "t" and begin[0] in net.edges and end[0] in net.edges:
            outer.append((one, begin, end))
    for one, begin, end in outer:
        for name in (begin, end):
            if name not in net.lanes:
                one.fault(f"it connects lane {name[1]} of edge {name[0]}, which has none")
        points, via = [np.empty((0, 2))], one.string("via", "")
        while via:
            if via not in inner:
                one.fault(f"it goes via lane {via[:40]}, which is not there")
            points.append(read_shape(inner.pop(via), net, 1))
            via = after[via].get(end, "")
        junction = net.edges[begin[0]].string("to")
        net.connections[junction].append(Connection(one, begin, end, np.concatenate(points)))
        if one.string("tl", ""):
            net.lights.setdefault(junction, (one, "traffic lights"))
