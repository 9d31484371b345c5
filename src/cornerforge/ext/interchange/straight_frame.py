"""The straight stretch of an OpenDRIVE road on which a case happens, in our axes.

Ours: x along the travel, y to the left from the right edge of the lanes that are driven in the AV's direction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import DataError
from cornerforge.ext.interchange.read_opendrive import SAME_HEADING, Road, Roads

__all__ = ["Frame", "frame_of"]

_Numbers = TypeVar("_Numbers", float, NDArray[np.float64])

_SAME_WIDTH = 0.01
_MOST_OFF = 0.3
"""How far the border of a lane may lie from where lanes of one width, all along, would have it [m]."""
_WIDTHS = (2.5, 6.0)
"""Lane widths that can be driven [m]."""
_STEP = 5.0
"""Distance of the places at which lanes are looked at [m]."""


@dataclass(frozen=True)
class Frame:
    """A straight stretch of lanes in the world, and our axes there.

    Attributes:
        x, y: Place in the world of our origin, on the right edge of the rightmost lane [m].
        direction: In which our x goes [rad].
        lanes: Number of lanes in this direction.
        lane_width: [m].
        notes: What of the road is not carried over.
    """

    x: float
    y: float
    direction: float
    lanes: int
    lane_width: float
    notes: tuple[str, ...] = ()

    def turned(self, dx: _Numbers, dy: _Numbers) -> tuple[_Numbers, _Numbers]:
        """Our vector of one of the world."""
        cos, sin = math.cos(self.direction), math.sin(self.direction)
        return dx * cos + dy * sin, dy * cos - dx * sin

    def of_world(self, x: _Numbers, y: _Numbers) -> tuple[_Numbers, _Numbers]:
        """Our x and y of a point of the world."""
        return self.turned(x - self.x, y - self.y)

    def to_world(self, x: float, y: float) -> tuple[float, float]:
        """Point of the world at our x and y."""
        cos, sin = math.cos(self.direction), math.sin(self.direction)
        return self.x + x * cos - y * sin, self.y + x * sin + y * cos


def frame_of(
    roads: Roads, x: float, y: float, heading: float, ahead: float, others: NDArray[np.float64] | None = None
) -> Frame:
    """Make the frame of a case: the lanes that its AV drives beside, all the way.

    Args:
        roads: The roads.
        x, y: Where the AV starts in the world [m]; the frame's origin is the foot of that on the right edge.
        heading: In which direction it looks [rad].
        ahead: How far it drives [m]; so far the road must be straight and keep its lanes.
        others: Places (P, 2) of vehicles that drive the AV's way [m]: a lane beside for oncoming traffic in which one
            of them does is a lane of the case. None: there are none.

    Raises:
        DataError: It starts in no driven lane of a straight road, or drives against its direction; lanes differ in
            width, or are narrower or wider than can be driven; a bend, a junction, the road's end, or a change of lanes
            lies on its way.
    """
    spot = roads.find(x, y, heading)
    if spot is None:
        raise DataError(
            f"{roads.file}: the AV starts in no lane of a straight road. There ({x:.1f}, {y:.1f}) is "
            f"{roads.at(x, y)}. Roads with parallel, straight lanes can be read."
        )
    road, way, s = spot.road, spot.way, spot.s
    where = f"{roads.file}, line {road.line}"
    if not road.driven(s, spot.lane, way):
        kind = road.section(s).lanes[spot.lane].kind
        raise DataError(f"{where}: the AV starts in lane {spot.lane} ({kind}), which is not driven its way.")
    direction = spot.piece.heading + (0.0 if way > 0 else math.pi)
    offset = np.zeros((0, 2)) if others is None else others - np.array([x, y])
    aside = offset @ np.array([-math.sin(direction), math.cos(direction)])

    def borders_of(lane: int) -> tuple[float, float]:
        """Right and left border of a lane, to the left of the AV's start."""
        low, high = sorted(way * (t - spot.t) for t in road.borders(lane, s))
        return low, high

    def is_used(lane: int) -> bool:
        if road.driven(s, lane, way):
            return True
        low, high = borders_of(lane) if road.driven(s, lane, 0) else (0.0, 0.0)
        return bool(((aside > low) & (aside < high)).any())

    lanes = [spot.lane]
    for step in (1, -1):
        while is_used(after := lanes[-1] + step or step):
            lanes.append(after)
        lanes.reverse()
    lanes.sort(key=borders_of)
    borders = [borders_of(lane) for lane in lanes]
    right = borders[0][0]
    width = (borders[-1][1] - right) / len(lanes)
    if not _WIDTHS[0] <= width <= _WIDTHS[1]:
        low, high = _WIDTHS
        raise DataError(f"{where}: lanes are {width:.3g} m wide; those of {low:g} to {high:g} m can be driven.")
    if any(abs(low - right - k * width) > _MOST_OFF for k, (low, _) in enumerate(borders)):
        raise DataError(f"{where}: the lanes of road {road.ident} differ too much in width; equal ones can be driven.")
    notes = tuple(f"{where}: {note}" for note in _notes(road, s, way, lanes))
    x, y = x - right * math.sin(direction), y + right * math.cos(direction)
    frame = Frame(x, y, direction, len(lanes), width, notes)
    _check_way(roads, frame, ahead)
    return frame


def _check_way(roads: Roads, frame: Frame, ahead: float) -> None:
    """Refuse a way on which a lane ends, begins, bends or becomes narrower.

    Raises:
        DataError: One does.
    """
    for k in range(max(1, math.ceil(ahead / _STEP)) + 1):
        x = min(_STEP * k, ahead)
        for lane in range(frame.lanes):
            place = frame.to_world(x, (lane + 0.5) * frame.lane_width)
            spot = roads.find(*place, frame.direction)
            why = "no such lane is there any more"
            if spot is not None and spot.road.driven(spot.s, spot.lane, 0):
                turn = math.remainder(spot.piece.heading - frame.direction, math.pi)
                low, high = (t - spot.t for t in spot.road.borders(spot.lane, spot.s))
                half = 0.5 * frame.lane_width
                why = "it turns" if abs(turn) > 10.0 * SAME_HEADING else "its borders are elsewhere"
                if abs(turn) <= 10.0 * SAME_HEADING and max(abs(low + half), abs(high - half)) <= 2.0 * _MOST_OFF:
                    continue
            raise DataError(
                f"{roads.file}: the lanes of the AV's start do not go on straight for the {ahead:.0f} m that it "
                f"drives: after {x:.0f} m {why}, at ({place[0]:.1f}, {place[1]:.1f}), by {roads.at(*place)}."
            )


def _notes(road: Road, s: float, way: int, lanes: list[int]) -> Iterator[str]:
    section = road.section(s)
    for words in road.besides:
        yield f"road {road.ident}: {words}"
    others = [f"{lane.ident} ({lane.kind})" for lane in section.lanes.values() if lane.ident not in lanes]
    if others:
        yield f"lanes of road {road.ident} that are not driven in the AV's direction are left out: {', '.join(others)}"
    for lane in lanes:
        if not road.driven(s, lane, way):
            yield f"lane {lane} of road {road.ident} is for oncoming traffic, but vehicles drive the AV's way in it"
    if road.left_hand:
        yield f"road {road.ident} has left-hand traffic; lanes keep their places, but AVs are used to the right"
    widths = [section.lanes[lane].width(s - section.s) for lane in lanes]
    if max(widths) - min(widths) > _SAME_WIDTH:
        yield f"lanes are {', '.join(f'{w:.2f}' for w in widths)} m wide; each counts as their mean, places stay"
