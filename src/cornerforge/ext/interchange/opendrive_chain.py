"""Roads of OpenDRIVE files that follow each other: which ends meet, which lanes lead on there, the longest chain."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from cornerforge.errors import DataError
from cornerforge.ext.interchange.read_opendrive import END, START, Roads

__all__ = ["Joints", "Leg"]

_End = tuple[str, int]
"""Id of a road, and START or END of it."""
_WORDS = ("start", "end")


@dataclass(frozen=True)
class Leg:
    """A road that is driven along its reference line or against it."""

    ident: str
    against: bool

    @property
    def into(self) -> _End:
        """Where the travel comes in."""
        return self.ident, END if self.against else START

    @property
    def out(self) -> _End:
        """Where it goes out."""
        return self.ident, START if self.against else END


class Joints:
    """Where the roads of a file meet.

    Attributes:
        file: Its name.
        roads: By id.
        meets: To which ends of roads each one leads, with the pairs of lanes that follow each other, its own first.
    """

    def __init__(self, file: Roads) -> None:
        self.file, self.roads = file.file, file.roads
        self.meets: defaultdict[_End, dict[_End, set[tuple[int, int]]]] = defaultdict(dict)
        self._through: defaultdict[str, list[Leg]] = defaultdict(list)
        for road in self.roads.values():
            for end, link in enumerate(road.links):
                lanes = road.section(end * road.length).lanes.values()
                if link is not None and not link.junction:
                    pairs = {(lane.ident, other) for lane in lanes for other in lane.links[end]}
                    self._meet((road.ident, end), (link.ident, link.end), pairs)
            for leg in (Leg(road.ident, False), Leg(road.ident, True)) if road.junction else ():
                if any(self.driven(leg, 0.5, lane) for lane in road.section(0.5 * road.length).lanes):
                    self._through[road.junction].append(leg)
        for way in file.ways:
            for end, link in enumerate(self.roads[way.incoming].links) if way.incoming in self.roads else ():
                if link is not None and link.junction and link.ident == way.junction:
                    self._meet((way.incoming, end), (way.ident, way.end), set(way.lanes))

    def _meet(self, here: _End, there: _End, lanes: set[tuple[int, int]]) -> None:
        if there[0] in self.roads and self._leads(here, there) and self._leads(there, here):
            self.meets[here].setdefault(there, set()).update(lanes)
            self.meets[there].setdefault(here, set()).update((other, own) for own, other in lanes)

    def _leads(self, here: _End, there: _End) -> bool:
        """Whether the link of an end leads to another one, or there is none."""
        link, other = self.roads[here[0]].links[here[1]], self.roads[there[0]]
        if link is None or not link.junction:
            return link is None or (link.ident, link.end) == there
        back = other.links[there[1]]
        return other.junction == link.ident or (back is not None and back.junction and back.ident == link.ident)

    def driven(self, leg: Leg, at: float, lane: int) -> bool:
        """Whether traffic drives in a lane in a leg's direction, at a share of the road's s."""
        road = self.roads[leg.ident]
        return road.driven(at * road.length, lane, -1 if leg.against else 1)

    def others(self, leg: Leg, after: Leg, *, come: bool) -> dict[int, str]:
        """Find lanes where two legs meet that come from roads beside the first one, or go to some beside the second.

        Returns:
            Ids of lanes, of the second leg if `come`, else of the first, each with the id of the other road.
        """
        found: dict[int, str] = {}
        for there, pairs in self.meets[after.into if come else leg.out].items():
            other = Leg(there[0], there[1] == (START if come else END))
            if other not in (leg, after) and not self._parallel(other, leg) and not self._parallel(other, after):
                beyond = self._around(other)[0 if come else 1] if self.roads[other.ident].junction else None
                name = other.ident if beyond is None else beyond[0]
                found |= {own: name for own, lane in pairs if self.driven(other, there[1], lane)}
        return found

    def named(self, names: Sequence[str]) -> list[Leg]:
        """Find the directions in which roads that are named in the order of travel follow each other.

        Raises:
            DataError: They do not, or others cross them.
        """
        tries = []
        for against in (False, True):
            legs = [Leg(names[0], against)]
            while len(legs) < len(names):
                after = next((end for end in self.meets[legs[-1].out] if end[0] == names[len(legs)]), None)
                if after is None:
                    break
                legs.append(Leg(after[0], after[1] == END))
            tries.append(legs)
        legs = max(tries, key=len)
        if len(legs) < len(names):
            raise DataError(self._apart(legs[-1].ident, names[len(legs)]))
        for leg in legs:
            if hindrance := self._hindrance(leg):
                raise DataError(hindrance)
        return legs

    def _apart(self, *names: str) -> str:
        """Say that two roads do not follow each other."""
        for name, other in (names, names[::-1]):
            for link in self.roads[name].links:
                back = self.roads[other].links[link.end] if link is not None and link.ident == other else None
                if back is not None and link is not None and not link.junction:
                    what = f"{'junction' if back.junction else 'road'} {back.ident[:40]}"
                    told = f"the {_WORDS[link.end]} of road {other} is linked to {what}"
                    return f"{self.file}, line {back.line}: {told}, not to the end of road {name} that is linked to it."
        line = self.roads[names[0]].line
        return f"{self.file}, line {line}: no link leads from road {names[0]} on to road {names[1]}."

    def longest(self, against: bool) -> list[Leg]:
        """Find the longest chain of roads each of which goes on in the next, through junctions where most lanes do.

        Args:
            against: Its longest road is driven against its reference line; else along it, if both are equally long.
        """
        legs = [Leg(name, way) for name in self.roads for way in (False, True)]
        on = {leg: after for leg in legs if (after := self._after(leg)) is not None}
        chains, met, reached = [], set[Leg](), set(on.values())
        for first in [*(leg for leg in legs if leg not in reached), *legs]:  # those in rings have no first one
            chain = {} if first in met else {first: None}
            after = on.get(first)
            while (
                chain and after is not None and after not in chain and Leg(after.ident, not after.against) not in chain
            ):
                chain[after] = None
                after = on.get(after)
            met.update(chain)
            if chain and (not against or self._main(chain).against):
                chains.append(list(chain))
        length = {name: road.length for name, road in self.roads.items()}
        return max(chains, key=lambda chain: (
            round(sum(length[leg.ident] for leg in chain), 6), self._main(chain).against == against,
        ))  # fmt: skip

    def _main(self, chain: Collection[Leg]) -> Leg:
        return max(chain, key=lambda leg: self.roads[leg.ident].length)

    def _after(self, leg: Leg) -> Leg | None:
        """Find the leg in which most lanes of this one go on, if most of its own come from this one."""
        after = _most({one: self._carried(leg, one) for one in (Leg(k, end == END) for k, end in self.meets[leg.out])})
        if after is None or self._hindrance(leg) or self._hindrance(after):
            return None
        links = [self.roads[name].links[end] for name, end in (leg.out, after.into)]
        if all(link is not None and link.junction for link in links):  # a direct junction: it is passed by names only
            return None
        behind = (Leg(name, end == START) for name, end in self.meets[after.into])
        return after if _most({one: self._carried(one, after) for one in behind}) == leg else None

    def _carried(self, leg: Leg, after: Leg) -> int:
        """Count the driven lanes of a leg that go on in another one."""
        pairs = self.meets[leg.out].get(after.into, set())
        return sum(self.driven(leg, leg.out[1], a) and self.driven(after, after.into[1], b) for a, b in pairs)

    def _hindrance(self, leg: Leg) -> str:
        """Say which other road through its junction keeps a connecting road from being part of a road; "": none.

        Others may come from the road before it, go to the one behind it, or lead back beside it.
        """
        junction, ends = self.roads[leg.ident].junction, self._around(leg)
        for way in self._through[junction] if junction else ():
            told = f"{self.file}, line {self.roads[way.ident].line}: in junction {junction} road {way.ident} leads"
            before, after = self._around(way)
            if way != leg and (before, after) == ends and not self._widens(way, leg):
                return f"{told} beside road {leg.ident} to the same road: not represented."
            if before != ends[0] and after != ends[1] and (after, before) != ends:
                return f"{told} beside or across road {leg.ident}: not represented."
        return ""

    def _widens(self, way: Leg, leg: Leg) -> bool:
        """Whether lanes of a road between the same roads as a leg only begin or end beside those of the leg."""
        (before, after), found = self._around(leg), False
        for end, ways in ((before, (way.into, leg.into)), (after, (way.out, leg.out))):
            if end is not None:
                one, other = ({own for own, _ in self.meets[end].get(there, ())} for there in ways)
                found |= one <= other
        return found

    def _parallel(self, one: Leg, leg: Leg) -> bool:
        """Whether two connecting roads lead between the same roads."""
        junction = self.roads[leg.ident].junction
        return junction != "" and self.roads[one.ident].junction == junction and self._around(one) == self._around(leg)

    def _around(self, leg: Leg) -> tuple[_End | None, _End | None]:
        """Give the ends of roads to which a leg's own links lead, before it and behind it."""
        links = (self.roads[name].links[end] for name, end in (leg.into, leg.out))
        before, after = (None if link is None or link.junction else (link.ident, link.end) for link in links)
        return before, after


def _most(counts: dict[Leg, int]) -> Leg | None:
    """Give the leg of the highest count; None: there is none above 0, or several."""
    most = [leg for leg, count in counts.items() if count == max(counts.values()) > 0]
    return most[0] if len(most) == 1 else None
