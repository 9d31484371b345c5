"""The surface of a road: where asphalt is and which lines are on it, for all that draws a case.

A lane has its full width from its begin to its end. Beyond an end it becomes narrower over `TAPER` towards the lane
beside it, and likewise before its begin; a lane that comes from a ramp or leads to an exit bends away from the road
there. Lanes beside each other are parted by a broken line, an acceleration or deceleration lane by wide short dashes,
ramps and what may not be crossed by a solid line, a closed lane by a barrier.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from math import inf, isfinite
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge.road.lanes import lanes_of
from cornerforge.road.network import Lane, Marking
from cornerforge.road.straight import along
from cornerforge.types import Odd

__all__ = ["MARKS", "Area", "Line", "Mark", "Surface", "lane_on", "marks_between", "outline", "strokes", "surface_of"]

Mark = Literal["solid", "broken", "wide", "barrier", "hatch"]
MARKS: dict[Mark, tuple[float, float, float]] = {
    "solid": (0.15, 0.0, 0.0), "broken": (0.15, 3.0, 12.0), "wide": (0.3, 3.0, 6.0), "barrier": (0.4, 0.0, 0.0),
    "hatch": (0.4, 3.0, 6.0),
}  # fmt: skip
"""Width of each mark [m], how long its dashes are and how often they come [m]; 0: it is one dash."""
TAPER = 40.0
_BEND = 120.0, 3.0
"""A ramp is shown so far beyond its end [m], and so many lane widths aside there."""
_APART = 0.15
"""Half the distance of the two lines of a border that may be crossed from one side only [m]."""


class Area(NamedTuple):
    """A piece of asphalt with straight sides, without shoulders; infinite: it goes on.

    Attributes:
        begin, end: From where to where along the road [m].
        right, left: Its sides at the begin, across the road [m].
        right_end, left_end: Its sides at the end [m].
    """

    begin: float
    end: float
    right: float
    left: float
    right_end: float
    left_end: float


class Line(NamedTuple):
    """A line on the road, or what stands on it; a hatch fills the rectangle of which it is the diagonal.

    Attributes:
        begin, y: Where it begins, along and across the road [m]; -inf: it comes from far.
        end, y_end: Where it ends; inf: it goes on.
        mark: What it looks like.
    """

    begin: float
    y: float
    end: float
    y_end: float
    mark: Mark


class Surface(NamedTuple):
    """Areas and lines of a road; x as in `surface_of`, y as in the simulator."""

    areas: tuple[Area, ...]
    lines: tuple[Line, ...]


def surface_of(odd: Odd, start: float = 0.0) -> Surface:
    """Find the surface of an ODD's road, along x counted from `start` [m].

    >>> [line.mark for line in surface_of(Odd(n_lanes=2)).lines]
    ['solid', 'broken', 'solid']
    """
    lanes, width = lanes_of(odd), odd.lane_width
    areas, lines = [], []
    bare: list[tuple[int, float, float]] = []
    for lane in lanes:
        right, left = lane.slot * width, (lane.slot + 1) * width
        areas.append(Area(lane.begin, lane.end, right, left, right, left))
        if lane.kind == "closed":
            across = (Line(place, right, place, left, "barrier") for place in (lane.begin, lane.end))
            lines += [
                Line(lane.begin, right, lane.end, left, "hatch"),
                *(line for line in across if isfinite(line.end)),
            ]
    for lane, place, way in _free_ends(lanes):
        sides = lane.slot * width, (lane.slot + 1) * width
        if lane.kind in ("ramp", "acceleration" if way < 0.0 else "deceleration"):
            far, aside = place + way * _BEND[0], width * _BEND[1] * (-1.0 if 2 * lane.slot < odd.n_lanes else 1.0)
            aims = sides[0] + aside, sides[1] + aside
        else:
            is_left = any(one.slot == lane.slot + 1 and one.begin <= place <= one.end for one in lanes)
            far, aims = place + way * TAPER, (sides[is_left],) * 2
            bare.append((lane.slot + is_left, min(place, far), max(place, far)))
        (begin, right, left), (end, right_end, left_end) = sorted([(place, *sides), (far, *aims)])
        areas.append(Area(begin, end, right, left, right_end, left_end))
        edges = ((right, right_end), (left, left_end))
        lines += [Line(begin, y, end, y_end, "solid") for y, y_end in edges if y != y_end]
    for border in range(odd.n_lanes + 1):
        lines += _border(lanes, border, border * width, [part[1:] for part in bare if part[0] == border])

    def moved(place: float) -> float:
        return float(along(start, place))

    return Surface(
        tuple(area._replace(begin=moved(area.begin), end=moved(area.end)) for area in areas),
        tuple(line._replace(begin=moved(line.begin), end=moved(line.end)) for line in lines),
    )


def _free_ends(lanes: Sequence[Lane]) -> Iterator[tuple[Lane, float, float]]:
    """Find the ends of lanes at which their slot holds no other: the lane, the end, -1 for a begin."""
    for lane in lanes:
        if lane.kind == "closed":
            continue
        others = [one for one in lanes if one.slot == lane.slot]
        if isfinite(lane.begin) and all(one.end != lane.begin for one in others):
            yield lane, lane.begin, -1.0
        if isfinite(lane.end) and all(one.begin != lane.end for one in others):
            yield lane, lane.end, 1.0


def _border(lanes: Sequence[Lane], border: int, y: float, bare: Sequence[tuple[float, float]]) -> Iterator[Line]:
    """Give the lines between two slots, or at a side of the outer ones; none where a lane becomes narrower to there."""
    below, above = ([one for one in lanes if one.slot == slot] for slot in (border - 1, border))
    cuts = {-inf, inf, *itertools.chain(*bare)}
    for lane, marks in (*((one, one.left) for one in below), *((one, one.right) for one in above)):
        cuts |= {lane.begin, lane.end, *(one.s for one in marks[1:] if lane.begin < one.s < lane.end)}

    def painted(part: tuple[float, float]) -> list[tuple[float, Mark]]:
        s = part[0]
        return [] if any(a <= s < b for a, b in bare) else marks_between(lane_on(below, s), lane_on(above, s), s)

    for found, parts in itertools.groupby(itertools.pairwise(sorted(cuts)), key=painted):
        begins, ends = zip(*parts, strict=True)
        yield from (Line(begins[0], y + aside, ends[-1], y + aside, mark) for aside, mark in found)


def lane_on(lanes: Sequence[Lane], s: float) -> Lane | None:
    """Find the lane of a slot at a place [m] among all of that slot; None: there is none."""
    return next((one for one in lanes if one.begin <= s < one.end), None)


def marks_between(right: Lane | None, left: Lane | None, s: float) -> list[tuple[float, Mark]]:
    """Say which marks part two lanes, and how far to the left of the border each is [m]."""
    if right is None or left is None:
        return [] if right is left else [(0.0, "solid")]
    kinds = {right.kind, left.kind}
    if "closed" in kinds:
        return [(0.0, "barrier")] if len(kinds) > 1 else []
    may = _may_cross(right, right.left, s, left=True), _may_cross(left, left.right, s, left=False)
    if "ramp" in kinds or may == (False, False):
        return [(0.0, "solid")]
    dashes: Mark = "wide" if len(kinds) == 2 and "through" in kinds else "broken"
    if may == (True, True):
        return [(0.0, dashes)]
    return [(-_APART, dashes if may[0] else "solid"), (_APART, dashes if may[1] else "solid")]


def _may_cross(lane: Lane, marks: Sequence[Marking], s: float, *, left: bool) -> bool:
    """Say whether a line may be crossed; a lane that comes from far has its first line there too."""
    return not marks or lane.may_cross(max(s, marks[0].s), left=left)


def outline(area: Area, low: float, high: float, shoulder: float) -> NDArray[np.float64]:
    """Give the corners of asphalt with its shoulders, shape (4, 2) [m]; between two places where it goes on."""
    begin, end = low if area.begin == -inf else area.begin, high if area.end == inf else area.end
    across = np.array([area.right, area.right_end, area.left_end, area.left]) + shoulder * np.array([-1, -1, 1, 1])
    return np.column_stack([[begin, end, end, begin], across])


def strokes(line: Line, low: float, high: float) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Cut a line into what is painted of it between two places along the road [m].

    Returns:
        Ends of straight strokes, each (x, y) [m].
    """
    _, long, every = MARKS[line.mark]
    begin, end = max(line.begin, low), min(line.end, high)
    if begin > end:
        return []
    if every == 0.0:
        return [((begin, line.y), (end, line.y))] if line.y == line.y_end else [(line[:2], line[2:4])]
    places = (every * np.arange(begin // every, end // every + 1.0)).tolist()
    if line.mark == "hatch":
        inside = [s for s in places if line.begin <= s and s + long <= line.end]
        return [((s, line.y), (s + long, line.y_end)) for s in inside]
    return [((max(s, begin), line.y), (min(s + long, end), line.y)) for s in places if s + long > begin and s < end]
