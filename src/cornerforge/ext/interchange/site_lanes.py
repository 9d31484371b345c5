"""Lanes of a site for files of other tools: its routes cut where the stop line is and where they leave the junction.

Routes that come by one lane share it up to the stop line; those that leave by one lane share it behind the junction.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cornerforge.site.network import Route, Site, headings_of

__all__ = ["SiteLane", "lanes_at", "within_a_turn"]

_SAME = 0.3
"""Ends that are so near to each other are one [m]."""
_SHORTEST = 0.5


@dataclass
class SiteLane:
    """A lane of a site.

    Attributes:
        part: Where it lies; walk: it is a crosswalk, along which people go both ways.
        line: Its middle, (P, 2) [m].
        headings: Its direction at each point, (P,) [rad].
        widths: At its begin and its end [m]; between them it changes evenly along it.
        limit: Of speed [m/s].
        routes: Indices of the routes that lead along it.
        before, behind: Indices of the lanes that lead to it, and to which it leads.
    """

    part: Literal["approach", "inner", "exit", "walk"]
    line: NDArray[np.float64]
    headings: NDArray[np.float64]
    widths: tuple[float, float]
    limit: float
    routes: list[int]
    before: list[int] = field(default_factory=list)
    behind: list[int] = field(default_factory=list)

    @property
    def sides(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Left and right bound, (P, 2) each [m]."""
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(self.line, axis=0).T)))
        half = 0.5 * np.interp(along, along[[0, -1]], self.widths)
        aside = half[:, None] * np.stack([-np.sin(self.headings), np.cos(self.headings)], axis=1)
        return self.line + aside, self.line - aside


def lanes_at(site: Site) -> list[SiteLane]:
    """Cut the routes of a site into lanes: of vehicles in the order of routes, then crosswalks."""
    lanes: list[SiteLane] = []
    for k in site.vehicles:
        route = site.routes[k]
        cuts = (0.0, route.stop, max(route.leaves, route.stop), route.length)
        chain = []
        for part, begin, end in zip(("approach", "inner", "exit"), cuts[:-1], cuts[1:], strict=True):
            if end - begin >= _SHORTEST:
                limit = route.limits[0 if part == "approach" else 1]
                found = SiteLane(part, *_cut(route, begin, end), (route.width,) * 2, limit, [k])  # type: ignore[arg-type]
                chain.append(_shared(lanes, found))
        for one, after in itertools.pairwise(chain):
            for known, other in ((lanes[one].behind, after), (lanes[after].before, one)):
                if other not in known:
                    known.append(other)
    for k in site.people:
        route = site.routes[k]
        walk = SiteLane("walk", route.line, headings_of(route.line), (route.width,) * 2, route.limits[0], [k])
        _shared(lanes, walk)
    for lane in lanes:
        if lane.part == "inner":  # it leads from the width of one to that of the other
            sides = (lanes[found[0]].widths[0] if found else lane.widths[0] for found in (lane.before, lane.behind))
            lane.widths = (next(sides), next(sides))
    return lanes


def within_a_turn(heading: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take full turns away from headings [rad], as files of others want them; those within (-pi, pi] stay as they are.

    >>> within_a_turn(np.array([0.1, 7.0])).round(4).tolist()
    [0.1, 0.7168]
    """
    turned = np.pi - np.mod(np.pi - heading, 2.0 * np.pi)
    return np.where((heading > -np.pi) & (heading <= np.pi), heading, turned)


def _shared(lanes: list[SiteLane], found: SiteLane) -> int:
    """Find the lane that is the same, or add it; return its index."""
    for n, one in enumerate(lanes):
        if one.part != found.part or found.part == "inner":
            continue
        turned = found.line[::-1] if found.part == "walk" else found.line
        if any(np.abs(one.line[[0, -1]] - ends[[0, -1]]).max() < _SAME for ends in (found.line, turned)):
            one.routes += found.routes
            one.widths = (max(*one.widths, *found.widths),) * 2
            return n
    lanes.append(found)
    return len(lanes) - 1


def _cut(route: Route, begin: float, end: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give the points of a stretch of a route, (P, 2), and its direction there, (P,)."""
    inner = route.along[(route.along > begin + 0.2) & (route.along < end - 0.2)]
    at = np.concatenate([[begin], inner, [end]])
    line = np.stack([np.interp(at, route.along, values) for values in route.line.T], axis=1)
    return line, np.interp(at, route.along, headings_of(route.line))
