"""A recorded case at any moment: between two frames, 0.1 s apart, everything moves in straight lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.avoidability import WayOut
from cornerforge.metrics import bbd
from cornerforge.road.straight import along
from cornerforge.types import FRAME_S, Scenario

__all__ = ["Moment", "Moments", "apart", "corners_of", "overlap_of"]

Corners = NDArray[np.float64]
"""Corners of boxes [m], counter-clockwise from the front left one, shape (..., 4, 2)."""


@dataclass(frozen=True)
class Moment:
    """All vehicles at one moment; NaN where one is not there. Shapes (N,), columns as in the scenario.

    Attributes:
        time: Since the start of the test [s].
        place: Box centres along the road, from where the AV's was at the start [m].
        y, speed, heading: As in `Scenario`.
        lane: Lane that each keeps or changes to; -1 where it is not there, and at a site.
        there: It is there.
    """

    time: float
    place: NDArray[np.float64]
    y: NDArray[np.float64]
    speed: NDArray[np.float64]
    heading: NDArray[np.float64]
    lane: NDArray[np.int8]
    there: NDArray[np.bool_]


class Moments:
    """The moments of a scenario.

    Args:
        scenario: The recording.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._place = along(scenario.x[0, 0], scenario.x)
        self.partner = scenario.partner
        self.last = FRAME_S * (len(scenario.x) - 1)
        """Time of the last frame [s]."""
        self.contact = None if self.partner is None or scenario.crash is None else float(scenario.crash.time)
        """Time of the AV's crash [s]; None: there is none."""
        self.end = self.last if self.contact is None else min(self.contact, self.last)
        """Time of the contact [s]; without contact, time of the last frame."""

    def at(self, time: float) -> Moment:
        """Return the moment at a time since the start of the test [s], within the recording."""
        scenario = self.scenario
        low, high, part = self._between(time)

        def mixed(values: NDArray[np.float64]) -> NDArray[np.float64]:
            # A frame that is met exactly does not look at the next one, in which a vehicle may be absent.
            return np.asarray(values[low] if part == 0.0 else values[low] * (1.0 - part) + values[high] * part)

        there = scenario.present[low] & scenario.present[high]
        return Moment(
            time=time,
            place=mixed(self._place),
            y=mixed(scenario.y),
            speed=mixed(scenario.speed),
            heading=mixed(scenario.heading),
            lane=scenario.target_lane[low]
            if scenario.odd.site is None
            else np.full_like(scenario.target_lane[low], -1),
            there=there,
        )

    def trail(self, column: int, time: float, seconds: float) -> NDArray[np.float64]:
        """Where a vehicle's centre was in the last seconds before a time, shape (n, 2) [m], oldest first."""
        first = max(0, int(np.ceil((time - seconds) / FRAME_S - 1e-6)))
        rows = slice(first, int((time + 1e-9) / FRAME_S) + 1)
        seen = self.scenario.present[rows, column]
        now = self.at(time)
        passed = np.column_stack([self._place[rows, column], self.scenario.y[rows, column]])[seen]
        if not now.there[column]:
            return passed
        return np.concatenate([passed, np.array([[now.place[column], now.y[column]]])])

    def gap(self, moment: Moment, column: int) -> float:
        """Distance along the road between the bumpers of the AV and another vehicle [m]; below 0: side by side.

        At a site the distance of the boxes, 0 where they touch.
        """
        if not moment.there[column]:
            return float("nan")
        if self.scenario.odd.site is not None:
            return apart(*self.boxes(moment, [0, column]))
        ahead = abs(float(moment.place[column]) - float(moment.place[0]))
        lengths = self.scenario.length
        return float(bbd(0.0, ahead, float(lengths[0]), float(lengths[column])))

    def meeting(self) -> NDArray[np.float64]:
        """Where the AV and its partner touch, without contact where the AV is at the end, (2,) [m]."""
        moment = self.at(self.end)
        if self.partner is not None and moment.there[self.partner]:
            area = overlap_of(*self.boxes(moment, [0, self.partner]))
            if len(area):
                return np.asarray(area.mean(axis=0))
        return np.array([moment.place[0], moment.y[0]])

    def boxes(self, moment: Moment, columns: Sequence[int]) -> Corners:
        """Corners of vehicles, shape (n, 4, 2)."""
        index = np.array(columns, dtype=np.intp)
        return corners_of(
            moment.place[index], moment.y[index], moment.heading[index],
            self.scenario.length[index], self.scenario.width[index],
        )  # fmt: skip

    def ghost(self, way_out: WayOut, time: float) -> Corners | None:
        """Corners of the AV on a way out, shape (4, 2); None before it begins, after it ends and without a contact."""
        if self.contact is None:
            return None
        local = (time - (self.contact - way_out.begin_s)) / FRAME_S
        last = len(way_out.x) - 1
        if local < -1e-6 or local > last + 1e-6:
            return None
        frames, start = np.arange(last + 1), self.scenario.x[0, 0]
        place, y, heading = (
            np.array([np.interp(local, frames, values)])
            for values in (along(start, way_out.x), way_out.y, way_out.heading)
        )
        return np.asarray(corners_of(place, y, heading, self.scenario.length[:1], self.scenario.width[:1])[0])

    def _between(self, time: float) -> tuple[int, int, float]:
        frame = min(max(time / FRAME_S, 0.0), len(self.scenario.x) - 1.0)
        low = int(frame + 1e-6)
        part = frame - low
        return (low, low, 0.0) if part < 1e-6 else (low, low + 1, part)


def corners_of(
    place: NDArray[np.float64],
    y: NDArray[np.float64],
    heading: NDArray[np.float64],
    length: NDArray[np.float64],
    width: NDArray[np.float64],
) -> Corners:
    """Corners of boxes, counter-clockwise from the front left one, shape (n, 4, 2) [m]; arguments of shape (n,)."""
    forth = np.array([0.5, -0.5, -0.5, 0.5]) * length[:, None]
    left = np.array([0.5, 0.5, -0.5, -0.5]) * width[:, None]
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return np.stack([place[:, None] + forth * c - left * s, y[:, None] + forth * s + left * c], axis=-1)


def apart(a: Corners, b: Corners) -> float:
    """Distance of two boxes by their corners [m]; 0 where they touch.

    >>> apart(np.array([[2, 1], [0, 1], [0, 0], [2, 0]]), np.array([[9, 9], [5, 9], [5, 5], [9, 5]]))
    5.0
    """
    if len(overlap_of(a, b)):
        return 0.0
    sides = [(p, q[i], q[(i + 1) % 4]) for one, q in ((a, b), (b, a)) for p in one for i in range(4)]
    found = []
    for point, begin, end in sides:
        part = np.clip(np.dot(point - begin, end - begin) / np.dot(end - begin, end - begin), 0.0, 1.0)
        found.append(float(np.hypot(*(begin + part * (end - begin) - point))))
    return min(found)


def overlap_of(a: Corners, b: Corners) -> NDArray[np.float64]:
    """Corners of the common area of two boxes, shape (n, 2) [m]; n = 0 where they share none.

    Source: clipping of polygons (Sutherland and Hodgman 1974).

    >>> overlap_of(np.array([[2, 2], [0, 2], [0, 0], [2, 0]]), np.array([[3, 3], [1, 3], [1, 1], [3, 1]])).shape
    (4, 2)
    """
    kept = [(float(px), float(py)) for px, py in a]
    for i in range(len(b)):
        (ax, ay), (bx, by) = b[i], b[(i + 1) % len(b)]
        given, kept = kept, []
        sides = [float((bx - ax) * (py - ay) - (by - ay) * (px - ax)) for px, py in given]
        for j, point in enumerate(given):
            before, side_before, side = given[j - 1], sides[j - 1], sides[j]
            if (side_before >= 0.0) != (side >= 0.0):
                t = side_before / (side_before - side)
                kept.append((before[0] + t * (point[0] - before[0]), before[1] + t * (point[1] - before[1])))
            if side >= 0.0:
                kept.append(point)
    return np.array(kept, dtype=np.float64).reshape(-1, 2)
