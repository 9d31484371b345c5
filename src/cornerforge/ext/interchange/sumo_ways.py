"""Ways over junctions of SUMO networks: chains of connections, and which of two has the right of way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from cornerforge.ext.interchange.read_sumo import Connection, Net
from cornerforge.ext.interchange.xml_input import Element

__all__ = ["Chain", "RightOfWay", "chains_of", "id_of", "junction_of"]

Chain = tuple[Connection, ...]
"""Connections that follow each other."""


def id_of(connection: Element) -> tuple[str, ...]:
    """Name a connection by where it leads from and to."""
    return tuple(connection.string(name, "") for name in ("from", "fromLane", "to", "toLane"))


def junction_of(net: Net, way: Connection) -> str:
    """Name the junction in which a connection is."""
    return net.edges[way.begin[0]].string("to")


def chains_of(net: Net, junctions: Sequence[str]) -> Iterator[Chain]:
    """Find all ways over junctions, from a lane that leads to them to one that leads away, all for cars.

    None passes a junction twice.
    """
    ends = {name: (edge.string("from"), edge.string("to")) for name, edge in net.edges.items()}
    inner = {name for name, (begin, end) in ends.items() if begin != end and begin in junctions and end in junctions}
    first = [way for one in junctions for way in net.connections.get(one, []) if way.edges[0] not in inner]

    def _of_cars(way: Connection) -> bool:
        return net.lanes[way.begin].cars and net.lanes[way.end].cars

    def onward(chain: Chain) -> Iterator[Chain]:
        last = chain[-1].end
        if last[0] not in inner:
            yield chain
        elif (there := ends[last[0]][1]) not in {junction_of(net, way) for way in chain}:
            for way in net.connections.get(there, []):
                if way.begin == last:
                    yield from onward((*chain, way))

    return (chain for way in first for chain in onward((way,)) if all(map(_of_cars, chain)))


class RightOfWay:
    """Rules of a network's junctions, by their links: ways first, as netconvert numbers them, crosswalks behind."""

    def __init__(self, top: Element, junctions: Mapping[str, Element]) -> None:
        """Keep the network's elements."""
        self._top, self._junctions = top, junctions
        self._links: dict[str, dict[tuple[str, ...], int]] = {}
        self._rows: dict[str, dict[int, frozenset[int]]] = {}

    def links(self, junction: str) -> dict[tuple[str, ...], int]:
        """Number the connections of a junction by edge and lane within it."""
        if junction not in self._links:
            found: dict[tuple[str, ...], tuple[int, int]] = {}
            for one in self._top.all("connection"):
                via = one.string("via", "")
                if via.startswith(f":{junction}_") and not one.string("from").startswith(":"):
                    try:
                        edge, lane = (int(part) for part in via.removeprefix(f":{junction}_").split("_"))
                    except ValueError:
                        one.fault(f"it goes via {via[:40]}, which is no lane of junction {junction}")
                    found[id_of(one)] = edge, lane
            self._links[junction] = {name: k for k, name in enumerate(sorted(found, key=lambda name: found[name]))}
        return self._links[junction]

    def place(self, junction: str, way: Connection) -> tuple[str, int]:
        """Give a connection's junction and link; -1: none."""
        return junction, self.links(junction).get(id_of(way.element), -1)

    def crosswalks(self, junction: str) -> list[Element]:
        """List the crosswalks of a junction."""
        return [
            edge for edge in self._top.all("edge")
            if edge.string("function", "") == "crossing" and edge.string("id").rpartition("_c")[0] == f":{junction}"
        ]  # fmt: skip

    def rows(self, junction: str) -> dict[int, frozenset[int]]:
        """Read to which links each link yields: the last letter of `response` is that of link 0."""
        if junction not in self._rows:
            links, walks = len(self.links(junction)), len(self.crosswalks(junction))
            found: dict[int, frozenset[int]] = {}
            for row in self._junctions[junction].all("request"):
                own, letters = row.integer("index", low=0, high=255), row.string("response", "")
                if len(letters) != links + walks:
                    row.fault(f"response has {len(letters)} letters; it has {links} connections and {walks} crosswalks")
                found[own] = frozenset(k for k, letter in enumerate(reversed(letters)) if letter == "1")
            self._rows[junction] = found
        return self._rows[junction]
