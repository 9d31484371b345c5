"""Roads of SUMO networks as roads of ours: edges that follow each other, with what leads through the junctions between.

The reference line runs along the leftmost lane that goes through all of it. Edges that join or leave are not part of
the road: their lanes begin and end where they meet it.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import DataError, InputError
from cornerforge.ext.interchange.read_sumo import Connection, Edge, Lane, Net, read_sumo
from cornerforge.ext.interchange.slots import FULL, Seen, slots_of
from cornerforge.ext.interchange.smooth_line import smooth_line, ways
from cornerforge.road.network import LaneKind, Road, faults_of
from cornerforge.road.reference import ReferenceLine

__all__ = ["road_of_sumo"]

_STEP = 1.0
"""Distance of the places at which lanes are looked at [m]."""
_JUST = 1e-6
_WIDEST = 6.0
_SHORTEST, _LONGEST = 100.0, 50_000.0
"""Lengths of a road [m]."""
_SHOWN = 10
_MISSED = 0.05
"""A line that misses the drawn one by more is told [m]."""


def road_of_sumo(path: Path, *, edges: str | None = None, begin: float = 0.0, end: float | None = None) -> Road:
    """Take a chain of edges of a network.

    Args:
        path: The network.
        edges: Their ids in the order of travel, with blanks or commas between; None: the longest chain.
        begin, end: From where to where along its leftmost lane that goes through [m]; None: to its end.

    Returns:
        The road; its s begins with 0 at the travel's begin.

    Raises:
        InputError: The file is missing, or has no such edges or stretch.
        FileFormatError, DataError: It is damaged, or holds what cannot be represented; with the line.
    """
    net = read_sumo(path)
    chain = _longest(net, path.name) if edges is None else _named(net, edges.replace(",", " ").split(), path.name)
    return _Chain(path.name, net, chain).road(begin, end)


# Chains of edges


def _longest(net: Net, file: str) -> list[Edge]:
    """Find the longest chain of edges each of which goes on straight into the next, through no lights or crossings."""
    straight = Counter((one.begin[0], one.end[0]) for one in net.connections if one.direction == "s")
    goes_on: dict[str, str] = {}
    for begin, end in straight:
        rivals = [pair for pair in straight if begin == pair[0] or end == pair[1]]
        most = [pair for pair in rivals if straight[pair] == max(straight[one] for one in rivals)]
        if most == [(begin, end)] and _hindrance(net, net.edges[begin], net.edges[end]) is None:
            goes_on[begin] = end
    chains = []
    for first in [*(net.edges.keys() - goes_on.values()), *net.edges]:  # those in rings have no first one
        chain = [first]
        while (after := goes_on.get(chain[-1])) is not None and after not in chain:
            chain.append(after)
        chains.append([net.edges[name] for name in chain])
    if not chains:
        raise DataError(f"{file} has no edge that cars may use.")
    return max(chains, key=lambda chain: sum(ways(_any_lane(edge).shape)[-1] for edge in chain))


def _any_lane(edge: Edge) -> Lane:
    return next(lane for lane in edge.lanes.values() if lane.cars)


def _named(net: Net, names: Sequence[str], file: str) -> list[Edge]:
    for name in names or ("",):
        if name not in net.edges:
            some = ", ".join(list(net.edges)[:_SHOWN])
            raise InputError(f"{file} has no edge {name[:40]!r} that cars may use; it has {some}.")
    chain = [net.edges[name] for name in names]
    for edge, after in itertools.pairwise(chain):
        if found := _hindrance(net, edge, after):
            raise DataError(found)
    return chain


def _hindrance(net: Net, edge: Edge, after: Edge) -> str | None:
    """Say what keeps a road from going on from an edge to another one; None: nothing."""
    ours = [one.element for one in net.connections if (one.begin[0], one.end[0]) == (_id(edge), _id(after))]
    if not ours:
        return f"{after.element.place}: no lane leads from edge {_id(edge)} to edge {_id(after)}."
    if edge.end in net.lights:
        element, what = net.lights[edge.end]
        return f"{element.place}: junction {edge.end}, which edge {_id(edge)} leads to, has {what}: not represented."
    for one in net.connections:
        begin, end = net.edges[one.begin[0]], net.edges[one.end[0]]
        back = begin.begin == after.end and end.end == edge.begin
        if begin.end == edge.end and begin is not edge and end is not after and not back:
            where = f"junction {edge.end}, where edge {_id(begin)} leads to edge {_id(end)} beside or across the road"
            return f"{one.element.place}: {where}: not represented."
    return None


def _apart(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out points that lie on the one before."""
    apart: NDArray[np.float64] = points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-3)]
    return apart


def _id(edge: Edge) -> str:
    return edge.element.attributes["id"]


# Lanes


@dataclass(frozen=True)
class _Stretch:
    """A lane of an edge with the way through the next junction: where it lies along and beside the reference line."""

    s: NDArray[np.float64]
    d: NDArray[np.float64]
    begin: float
    end: float
    kind: LaneKind
    lane: Lane
    left: bool
    right: bool

    def seen(self, s: float) -> Seen:
        """Give the lane as it is at s."""
        place = f"{self.lane.element.place}: lane {self.lane.element.string('id', '')}"
        middle = float(np.interp(s, self.s, self.d))
        return Seen(place, middle, self.lane.width, self.kind, self.lane.limit, self.left, self.right)


class _Chain:
    """Edges that become a road; lanes are named by the number of their edge and their index."""

    def __init__(self, file: str, net: Net, edges: Sequence[Edge]) -> None:
        self.file, self.net, self.edges = file, net, edges
        self.numbers = {_id(edge): k for k, edge in enumerate(edges)}
        self.lanes = {(k, index): lane for k, edge in enumerate(edges) for index, lane in edge.lanes.items()}
        self.joins: dict[tuple[int, int], Connection] = {}
        self.comes: set[tuple[int, int]] = set()
        self.goes: set[tuple[int, int]] = set()
        within = []
        for one in net.connections:
            k, after = self.numbers.get(one.begin[0]), self.numbers.get(one.end[0])
            if k is not None and after == k + 1:
                within.append(one)
            elif k is not None and k + 1 < len(edges):
                self.goes.add((k, one.begin[1]))
            if after and k != after - 1:
                self.comes.add((after, one.end[1]))
        reached = set()
        for one in sorted(within, key=self._aside):  # of several ways into or out of a lane the straightest
            if self._at(one.begin) not in self.joins and one.end not in reached:
                self.joins[self._at(one.begin)] = one
                reached.add(one.end)

    def _at(self, lane: tuple[str, int]) -> tuple[int, int]:
        return self.numbers[lane[0]], lane[1]

    def _aside(self, one: Connection) -> float:
        """Say how far a connection leads sideways [m]."""
        before, after = (self.lanes[self._at(end)].shape for end in (one.begin, one.end))
        ahead, step = before[-1] - before[-2], after[0] - before[-1]
        return abs(float(ahead[0] * step[1] - ahead[1] * step[0])) / float(np.hypot(*ahead))

    def _after(self, name: tuple[int, int]) -> tuple[int, int] | None:
        return self._at(self.joins[name].end) if name in self.joins else None

    def _paths(self) -> list[list[tuple[int, int]]]:
        """Put the lanes that follow each other one after the other."""
        after = {self._after(name) for name in self.joins}
        paths = [[name] for name in self.lanes if name not in after]
        for path in paths:
            while (name := self._after(path[-1])) is not None:
                path.append(name)
        return paths

    def _drawn(self, name: tuple[int, int]) -> NDArray[np.float64]:
        """Give the points of a lane, and of the way through the junction to the first point of the next."""
        parts = [self.lanes[name].shape]
        if (after := self._after(name)) is not None:
            parts += [self.joins[name].way, self.lanes[after].shape[:1]]
        return _apart(np.concatenate(parts))

    def road(self, begin: float, end: float | None) -> Road:
        """Make the road."""
        first, last, paths = self.edges[0], self.edges[-1], self._paths()
        chain = f"edge {_id(first)}" if first is last else f"edges {_id(first)} to {_id(last)}"
        place = f"{first.element.place}: {chain}"
        through = [path for path in paths if len(path) == len(self.edges) and self.lanes[path[0]].cars]
        if not through:
            raise DataError(f"{place}: no lane goes all the way; name fewer edges with --road.")
        drawn = _apart(np.concatenate([self._drawn(name) for name in max(through, key=lambda path: path[0][1])]))
        along = ways(drawn)
        to = float(along[-1]) if end is None else end
        if not 0.0 <= begin < to <= along[-1] + 1e-6:
            raise InputError(f"{chain} have s from 0 to {along[-1]:.10g} m; from {begin:g} to {to:g} is none of it.")
        if not _SHORTEST <= to - begin <= _LONGEST:
            lengths = f"{to - begin:.0f} m long; {_SHORTEST:g} to {_LONGEST:g} m are read"
            raise DataError(f"{place}: the road is {lengths}. Name edges with --road, or cut it with --from and --to.")
        inside = np.unique([begin, *along[(along > begin) & (along < to)], to])
        try:
            line, missed = smooth_line(np.stack([np.interp(inside, along, part) for part in drawn.T], axis=1))
            stretches = [one for path in paths for one in self._stretches(path, line)]
            centres, lanes, width = slots_of(*self._rows(stretches, line.length))
            road = Road(f"{self.file.partition('.')[0]} {_id(first)}", line.pieces, line.length, width, centres, lanes)
        except InputError as error:
            raise DataError(f"{place}: {str(error).rstrip('.')}.") from error
        if faults := faults_of(road) or self._oncoming(line, centres):
            raise DataError(f"{place} cannot be driven: {'; '.join(faults)}. --road, --from and --to choose a part.")
        return replace(road, notes=tuple(self._notes(missed)))

    def _kinds(self, path: Sequence[tuple[int, int]]) -> list[LaneKind]:
        """Say of which kind lanes are that follow each other."""
        (first, _), (last, _) = path[0], path[-1]
        kinds: list[LaneKind] = ["through"] * len(path)
        if last + 1 < len(self.edges):
            if path[-1] in self.goes:
                kinds = ["deceleration"] * len(path) if first > 0 else [*kinds[1:], "deceleration"]
            elif (first > 0 and path[0] in self.comes) or any(self.lanes[name].merges for name in path):
                kinds = ["acceleration"] * len(path)
        return [kind if self.lanes[name].cars else "closed" for name, kind in zip(path, kinds, strict=True)]

    def _stretches(self, path: Sequence[tuple[int, int]], line: ReferenceLine) -> list[_Stretch]:
        """Lay lanes that follow each other along the reference line; those of the road's ends reach beyond them."""
        found = []
        for name, kind in zip(path, self._kinds(path), strict=True):
            lane, lanes = self.lanes[name], self.edges[name[0]].lanes
            if lane.cars:
                lane.element.number("width", lane.width, low=FULL, high=_WIDEST, unit="m")
            s, d = line.project(*self._drawn(name).T)
            if (np.diff(s) < -_JUST).any():
                lane.element.fault(f"lane {lane.element.string('id')} turns back")
            begin = -math.inf if name[0] == 0 else float(s[0])
            end = math.inf if name[0] + 1 == len(self.edges) else float(s[-1])
            left, right = (side in lanes and lanes[side].cars for side in (name[1] + 1, name[1] - 1))
            found.append(_Stretch(s, d, begin, end, kind, lane, lane.left and left, lane.right and right))
        return found

    def _rows(self, stretches: Sequence[_Stretch], length: float) -> tuple[list[float], list[list[Seen]]]:
        """Look at the lanes from place to place."""
        borders = [border for one in stretches for border in (one.begin, one.end - _JUST)]
        even = np.linspace(0.0, length, math.ceil(length / _STEP) + 1).tolist()
        places = sorted({place for place in [*even, *borders] if 0.0 <= place <= length})
        rows = [[one.seen(place) for one in stretches if one.begin <= place < one.end] for place in places]
        return [length if place == length else round(place, 5) for place in places], rows

    def _oncoming(self, line: ReferenceLine, centres: Sequence[float]) -> list[str]:
        """Name edges that lead the other way over the same place."""
        found = []
        for edge in self.edges:
            for name, other in self.net.edges.items():
                if (other.begin, other.end) != (edge.end, edge.begin):
                    continue
                shapes = [lane.shape for lane in other.lanes.values() if lane.cars]
                s, d = line.project(*np.concatenate([0.5 * (shape[1:] + shape[:-1]) for shape in shapes]).T)
                over = (np.abs(d[:, None] - np.array(centres)).min(axis=1) < 1.0) & (s > 0.0) & (s < line.length)
                if over.any():
                    found.append(f"edge {name} (line {other.element.line}) is driven the other way over the same place")
        return found

    def _notes(self, missed: float) -> list[str]:
        """Say what the network holds and the road does not."""
        lanes: dict[str, set[str]] = defaultdict(set)
        for one in self.net.connections:
            begin, end = (self.numbers.get(name) for name, _ in (one.begin, one.end))
            if begin is None and end:
                lanes["join"].add(one.begin[0])
            elif end is None and begin is not None and begin + 1 < len(self.edges):
                lanes["leave"].add(one.end[0])
        notes = [
            f"edges that {how} are left out: {', '.join(sorted(names)[:_SHOWN])}"
            for how, names in sorted(lanes.items())
        ]
        if not self.net.level:
            notes.append("it is not level; it is read as flat")
        if missed > _MISSED:
            notes.append(f"its points are drawn so far apart that the smooth line misses them by up to {missed:.2f} m")
        return notes
