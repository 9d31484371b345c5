"""Roads of SUMO networks as roads of ours: edges that follow each other, with what leads through the junctions between.

The reference line runs along the leftmost lane that goes through all of it. Edges that join or leave are not part of
the road: its lanes begin and end where they meet it.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import DataError, InputError
from cornerforge.ext.interchange.read_sumo import BESIDE, Connection, Name, Net, apart, read_sumo
from cornerforge.ext.interchange.slots import FULL, SHIFT, Seen, slots_of
from cornerforge.ext.interchange.smooth_line import dense, smooth_line, ways
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
    """Take edges of a network that follow each other.

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
    if not net.edges:
        raise InputError(f"{path.name} has no edge that cars may use.")
    names = _longest(net) if edges is None else edges.replace(",", " ").split()
    if not names or not net.edges.keys() >= set(names):
        lacks = next((name for name in names if name not in net.edges), "")[:40]
        raise InputError(
            f"{path.name} has no edge {lacks!r} that cars may use; it has {', '.join(list(net.edges)[:_SHOWN])}."
        )
    for pair in itertools.pairwise(names):
        if hindrance := _hindrance(net, *pair):
            raise DataError(hindrance)
    return _Chain(path.name.partition(".")[0], net, names).road(begin, end)


def _longest(net: Net) -> list[str]:
    """Find the longest chain of edges each of which goes on straight into the next, through no lights or crossings."""
    goes_on: dict[str, str] = {}
    for here in list(net.connections.values()):
        straight = Counter(one.edges for one in here if one.element.string("dir", "s") == "s")
        for begin, end in straight:
            rivals = [pair for pair in straight if begin == pair[0] or end == pair[1]]
            most = [pair for pair in rivals if straight[pair] == max(straight[one] for one in rivals)]
            if most == [(begin, end)] and _hindrance(net, begin, end) is None:
                goes_on[begin] = end
    chains: list[list[str]] = []
    for first in [*(net.edges.keys() - goes_on.values()), *net.edges]:  # those in rings have no first one
        chain = [first]
        while (after := goes_on.get(chain[-1])) is not None and after not in chain:
            chain.append(after)
        chains.append(chain)
    length = {name[0]: float(ways(lane.shape)[-1]) for name, lane in net.lanes.items()}
    return max(chains, key=lambda chain: (sum(length[name] for name in chain), chain), default=[])


def _hindrance(net: Net, name: str, after: str) -> str | None:
    """Say what keeps a road from going on from an edge to another one; None: nothing."""
    here, road = net.edges[name].string("to"), (net.edges[after].string("to"), net.edges[name].string("from"))
    if (name, after) not in {one.edges for one in net.connections[here]}:
        return f"{net.edges[after].place}: no lane leads from edge {name} to edge {after}."
    if here in net.lights:
        element, what = net.lights[here]
        return f"{element.place}: junction {here}, to which edge {name} leads, has {what}: not represented."
    for one in net.connections[here]:
        passes = net.edges[one.edges[0]].string("from"), net.edges[one.edges[1]].string("to")
        if name != one.edges[0] and after != one.edges[1] and passes != road:
            what = f"at junction {here} edge {one.edges[0]} leads to edge {one.edges[1]}, beside or across the road"
            return f"{one.element.place}: {what}: not represented."
    return None


@dataclass(frozen=True)
class _Stretch:
    """A lane with its way through the next junction: its points along and beside the reference line, begin and end."""

    s: NDArray[np.float64]
    d: NDArray[np.float64]
    begin: float
    end: float
    seen: Seen


class _Chain:
    """Edges that become a road."""

    def __init__(self, title: str, net: Net, names: Sequence[str]) -> None:
        self.title, self.net = title, net
        self.numbers = {name: k for k, name in enumerate(names)}
        self.lanes = {
            name: lane for name, lane in net.lanes.items()
            if name[0] in self.numbers and lane.element.string("type", "") not in BESIDE
        }  # fmt: skip
        pairs = list(itertools.pairwise(names))
        inside = [one for name, _ in pairs for one in net.connections[net.edges[name].string("to")]]
        self.comes = {one.end: one for one in inside if one.edges[1] in names[1:] and one.edges not in pairs}
        self.goes = {one.begin: one for one in inside if one.edges[0] in names[:-1] and one.edges not in pairs}
        self.joins: dict[Name, Connection] = {}
        reached = set()
        within = [one for one in inside if one.edges in pairs and {one.begin, one.end} <= self.lanes.keys()]
        for one in sorted(within, key=self._aside):
            if one.begin not in self.joins and one.end not in reached:  # of several ways the straightest
                self.joins[one.begin] = one
                reached.add(one.end)
        self.paths = [[name] for name in self.lanes if name not in reached]
        for path in self.paths:
            while path[-1] in self.joins:
                path.append(self.joins[path[-1]].end)

    def _aside(self, one: Connection) -> float:
        """Say how far a connection leads sideways [m]."""
        before, after = self.lanes[one.begin].shape, self.lanes[one.end].shape
        ahead, step = before[-1] - before[-2], after[0] - before[-1]
        return abs(float(ahead[0] * step[1] - ahead[1] * step[0])) / float(np.hypot(*ahead))

    def _drawn(self, name: Name) -> NDArray[np.float64]:
        """Give the points of a lane, and of the way through the junction to the first point of the next."""
        join = self.joins.get(name)
        after = [] if join is None else [join.way, self.lanes[join.end].shape[:1]]
        return apart(np.concatenate([self.lanes[name].shape, *after]))

    def road(self, begin: float, end: float | None) -> Road:
        """Make the road."""
        (first, *_), (*_, last) = self.numbers, self.numbers
        place = f"{self.net.edges[first].place}: edge{f' {first}' if first == last else f's {first} to {last}'}"
        through = [path for path in self.paths if len(path) == len(self.numbers) and self.lanes[path[0]].cars]
        if not through:
            raise DataError(f"{place}: no lane goes all the way; name fewer edges with --road.")
        leftmost = max(through, key=lambda path: path[0][1])
        drawn = apart(np.concatenate([self._drawn(name) for name in leftmost]))
        along = ways(drawn)
        to = float(along[-1]) if end is None else end
        if not 0.0 <= begin < to <= along[-1] + _JUST:
            raise InputError(f"{place}: s goes from 0 to {along[-1]:.10g} m; from {begin:g} to {to:g} is none of it.")
        if not _SHORTEST <= to - begin <= _LONGEST:
            told = f"the road is {to - begin:.0f} m long; {_SHORTEST:g} to {_LONGEST:g} m are read"
            raise DataError(f"{place}: {told}. Name edges with --road, or cut it with --from and --to.")
        inside = np.unique([begin, *along[(along > begin) & (along < to)], to])
        try:
            line, missed = smooth_line(np.stack([np.interp(inside, along, part) for part in drawn.T], axis=1))
        except InputError as error:
            raise DataError(f"{place}: {error}") from error
        if missed > SHIFT:
            told = f"its points turn so sharply that a smooth line misses their way by {missed:.1f} m"
            raise DataError(f"{place}: {told}. --road, --from and --to choose a part.")
        stretches = [one for path in self.paths for one in self._stretches(path, line)]
        centres, lanes, width = slots_of(*_rows(stretches, line.length))
        road = Road(f"{self.title} {first}", line.pieces, line.length, width, centres, lanes)
        if faults := faults_of(road) or self._oncoming(road):
            raise DataError(f"{place} cannot be driven: {'; '.join(faults)}. --road, --from and --to choose a part.")
        return replace(road, notes=tuple(self._notes(missed)))

    def _kind(self, path: Sequence[Name], name: Name) -> LaneKind:
        """Say of which kind a lane is, one of those that follow each other in a path."""
        first, last = self.numbers[path[0][0]], self.numbers[path[-1][0]]
        if not self.lanes[name].cars:
            return "closed"
        if path[-1] in self.goes:
            return "deceleration" if first > 0 or name == path[-1] else "through"
        joins = last + 1 < len(self.numbers) and path[0] in self.comes
        return "acceleration" if joins or self.lanes[name].merges else "through"

    def _stretches(self, path: Sequence[Name], line: ReferenceLine) -> list[_Stretch]:
        """Lay lanes that follow each other along the reference line; those at the road's ends reach beyond them."""
        found = []
        for name in path:
            lane, (edge, index) = self.lanes[name], name
            if lane.cars:
                lane.element.number("width", lane.width, low=FULL, high=_WIDEST, unit="m")
            s, d = line.project(*dense(self._drawn(name)).T)
            inside = (s >= 0.0) & (s <= line.length)
            if (np.diff(s[inside]) < -_JUST).any():
                lane.element.fault(f"lane {lane.element.string('id')} turns back")
            if inside.any() and (aside := float(np.ptp(d[inside]))) > SHIFT:
                lane.element.fault(
                    f"lane {lane.element.string('id')} shifts sideways by {aside:.2f} m: not represented"
                )
            begin = -math.inf if self.numbers[edge] == 0 else float(s[0])
            end = math.inf if self.numbers[edge] + 1 == len(self.numbers) else float(s[-1])
            beside = [(edge, side) in self.lanes and self.lanes[edge, side].cars for side in (index + 1, index - 1)]
            place = f"{lane.element.place}: lane {lane.element.string('id')}"
            kind, left, right = self._kind(path, name), lane.left and beside[0], lane.right and beside[1]
            found.append(_Stretch(s, d, begin, end, Seen(place, 0.0, lane.width, kind, lane.limit, left, right)))
        return found

    def _oncoming(self, road: Road) -> list[str]:
        """Name edges that lead the other way over the same place."""
        ends = {(edge.string("to"), edge.string("from")) for edge in map(self.net.edges.get, self.numbers) if edge}
        found = []
        for (name, _), lane in self.net.lanes.items():
            edge = self.net.edges[name]
            if lane.cars and (edge.string("from"), edge.string("to")) in ends:
                s, d = road.line.project(*(0.5 * (lane.shape[1:] + lane.shape[:-1])).T)
                near = np.abs(d[:, None] - np.array(road.centres)).min(axis=1) < 0.25 * road.lane_width
                if (near & (s > 0.0) & (s < road.length)).any():
                    found.append(f"edge {name} (line {edge.line}) leads the other way over the same place")
        return found

    def _notes(self, missed: float) -> list[str]:
        """Say what the network holds and the road does not."""
        join, leave = {one.edges[0] for one in self.comes.values()}, {one.edges[1] for one in self.goes.values()}
        told = {
            f"edges that join are left out: {', '.join(sorted(join)[:_SHOWN])}": bool(join),
            f"edges that leave are left out: {', '.join(sorted(leave)[:_SHOWN])}": bool(leave),
            "it is not level; it is read as flat": not self.net.level,
            f"its points lie so far apart that the smooth line misses their way by {missed:.2f} m": missed > _MISSED,
        }
        return [note for note, holds in told.items() if holds]


def _rows(stretches: Sequence[_Stretch], length: float) -> tuple[list[float], list[list[Seen]]]:
    """Look at lanes from place to place."""
    borders = [border for one in stretches for border in (one.begin, one.end - _JUST)]
    even = np.linspace(0.0, length, math.ceil(length / _STEP) + 1).tolist()
    places = sorted({place for place in [*even, *borders] if 0.0 <= place <= length})
    rows = [
        [
            replace(one.seen, middle=float(np.interp(place, one.s, one.d)))
            for one in stretches if one.begin <= place < one.end
        ]
        for place in places
    ]  # fmt: skip
    return [length if place == length else round(place, 5) for place in places], rows
