"""Positions of OpenSCENARIO files, in our axes."""

from __future__ import annotations

import math
from collections.abc import Mapping

from cornerforge.errors import DataError
from cornerforge.ext.interchange.read_opendrive import Frame, Road, Roads, frame_of
from cornerforge.ext.interchange.xml_input import Element
from cornerforge.ext.interchange.xosc_motion import Body, Spot

__all__ = ["Places", "UnsupportedError", "frame_of_start"]

_FAR = 1e7
_MOST_LANES = 40


class UnsupportedError(Exception):
    """Something in a file that is not carried over; the message says what, with its line."""

    def __init__(self, element: Element, why: str = "") -> None:
        super().__init__(f"{element.place}: {element.tag} is left out{f': {why}' if why else ''}")


def frame_of_start(position: Element, starts: Mapping[str, Element], roads: Roads) -> Frame:
    """Find the straight stretch on which a vehicle starts.

    Args:
        position: Where it starts.
        starts: Where all start, by name; positions may be relative to each other.
        roads: Roads of the scenario.

    Raises:
        DataError: Positions refer to each other in a circle, or it starts on no straight road.
    """
    seen = set()
    while (entity := _refers_to(position)) is not None:
        if entity in seen or entity not in starts:
            position.fault(f'where the AV starts is relative to "{entity[:40]}", which has no place of its own')
        seen.add(entity)
        position = starts[entity]
    if (lane := position.child("LanePosition")) is not None:
        road = roads.road(lane.string("roadId"))
        s = _s(lane)
        return frame_of(roads, road, s, sum(_borders(road, lane, s)) / 2.0)
    if (place := position.child("RoadPosition")) is not None:
        road = roads.road(place.string("roadId"))
        return frame_of(roads, road, _s(place), _metres(place, "t"))
    if (world := position.child("WorldPosition")) is not None:
        found = roads.find(_metres(world, "x"), _metres(world, "y"))
        if found is None:
            world.fault(f"the AV starts on no lane of a straight road of {roads.file}; straight roads can be read")
        return frame_of(roads, *found)
    return position.fault(
        f"where the AV starts is a {position.children[0].tag if position.children else 'nothing'}; WorldPosition, "
        "LanePosition, RoadPosition and what is relative to them are read"
    )


class Places:
    """Turns positions into places.

    Args:
        roads: Roads of the scenario.
        frame: Frame of the case.
        bodies: All vehicles by name; positions relative to one are relative to where it is now.
    """

    def __init__(self, roads: Roads, frame: Frame, bodies: Mapping[str, Body]) -> None:
        self.roads, self.frame, self.bodies = roads, frame, bodies
        self._readers = {
            "WorldPosition": self._world,
            "LanePosition": self._lane,
            "RoadPosition": self._road,
            "RelativeWorldPosition": self._relative_world,
            "RelativeObjectPosition": self._relative_object,
            "RelativeLanePosition": self._relative_lane,
            "RelativeRoadPosition": self._relative_road,
        }

    def spot(self, position: Element) -> Spot:
        """Find the place that a Position element names.

        Raises:
            DataError: A number of it cannot be.
            UnsupportedError: It is of a kind that is not read, or relative to a vehicle that is not there.
        """
        for child in position.children:
            if child.tag in self._readers:
                return self._readers[child.tag](child)
        raise UnsupportedError(position.children[0] if position.children else position)

    def body(self, element: Element, name: str = "entityRef") -> Body:
        """Find the vehicle that an element refers to.

        Raises:
            DataError: There is none of this name.
            UnsupportedError: It is not there now.
        """
        wanted = element.string(name)
        if wanted not in self.bodies:
            element.fault(f'there is no entity "{wanted[:40]}"')
        body = self.bodies[wanted]
        if not body.present:
            raise UnsupportedError(element, f"{body.name} is not there yet")
        return body

    def lane_y(self, lane: int) -> float:
        """Middle of one of our lanes [m]."""
        frame = self.frame
        low, high = frame.road.borders(frame.lanes[lane], frame.start)
        return frame.of_road(frame.start, 0.5 * (low + high))[1]

    def lane_beside(self, body: Body, by: int, element: Element) -> int:
        """Index of the lane that lies `by` lanes along t from a vehicle's.

        Raises:
            UnsupportedError: No lane of this number leads in the AV's direction.
        """
        lane = self.frame.lane_of(body.y) if body.lane is None else body.lane
        wanted = lane + self.frame.along * by
        if not 0 <= wanted < len(self.frame.lanes):
            raise UnsupportedError(
                element, f"there is no lane {by:+d} beside that of {body.name} in the AV's direction"
            )
        return wanted

    def _world(self, element: Element) -> Spot:
        self._straight(element)
        x, y = self.frame.of_world(_metres(element, "x"), _metres(element, "y"))
        heading = self.frame.heading(element.number("h", 0.0, low=-1e3, high=1e3, unit="rad"))
        return Spot(x, y, heading, "h" in element.attributes)

    def _lane(self, element: Element) -> Spot:
        road, s = self.roads.road(element.string("roadId")), _s(element)
        low, high = _borders(road, element, s)
        offset = _metres(element, "offset", 0.0)
        against = (element.integer("laneId", low=-1000, high=1000) > 0) != road.left_hand
        return self._on_road(element, road, s, 0.5 * (low + high) + offset, against)

    def _road(self, element: Element) -> Spot:
        road, s, t = self.roads.road(element.string("roadId")), _s(element), _metres(element, "t")
        return self._on_road(element, road, s, t, (t > 0.0) != road.left_hand)

    def _on_road(self, element: Element, road: Road, s: float, t: float, against: bool) -> Spot:
        if road is self.frame.road:
            x, y = self.frame.of_road(s, t)
            along = self.frame.piece.heading
        else:
            self._straight(element)
            piece = road.piece(s)
            if not piece.straight:
                raise UnsupportedError(element, f"road {road.ident} is not straight there")
            x, y = self.frame.of_world(*piece.at(s, t))
            along = piece.heading
        return self._turned(element, x, y, self.frame.heading(along + (math.pi if against else 0.0)))

    def _straight(self, element: Element) -> None:
        if self.frame.curved:
            raise UnsupportedError(element, "the road bends, so only what is relative to it is read")

    def _turned(self, element: Element, x: float, y: float, along: float) -> Spot:
        """Turn a place on a lane as its orientation says; 0 and half a turn both look along the travel."""
        orientation = element.child("Orientation")
        if orientation is None:
            return Spot(x, y, along)
        h = orientation.number("h", 0.0, low=-1e3, high=1e3, unit="rad")
        if orientation.attributes.get("type", "absolute") != "relative":
            return Spot(x, y, self.frame.heading(h), True)
        if math.cos(along) * self.frame.along < 0.0 and math.cos(h) < 0.0:
            h -= math.pi  # stated from the road's direction, not from the lane's
        return Spot(x, y, (along + h + math.pi) % (2.0 * math.pi) - math.pi, True)

    def _relative_world(self, element: Element) -> Spot:
        self._straight(element)
        body = self.body(element)
        dx, dy = self.frame.turned(_metres(element, "dx"), _metres(element, "dy"))
        return self._beside(element, body, body.x + dx, body.y + dy)

    def _relative_object(self, element: Element) -> Spot:
        body = self.body(element)
        dx, dy = _metres(element, "dx"), _metres(element, "dy", 0.0)
        cos, sin = math.cos(body.heading), math.sin(body.heading)
        return self._beside(element, body, body.x + dx * cos - dy * sin, body.y + dx * sin + dy * cos)

    def _relative_lane(self, element: Element) -> Spot:
        body = self.body(element)
        lane = self.lane_beside(body, element.integer("dLane", low=-_MOST_LANES, high=_MOST_LANES), element)
        ds = _metres(element, "ds" if "ds" in element.attributes else "dsLane")
        y = self.lane_y(lane) + self.frame.along * _metres(element, "offset", 0.0)
        return self._beside(element, body, body.x + self.frame.along * ds, y, 0.0)

    def _relative_road(self, element: Element) -> Spot:
        body, along = self.body(element), self.frame.along
        x, y = body.x + along * _metres(element, "ds"), body.y + along * _metres(element, "dt")
        return self._beside(element, body, x, y, 0.0)

    def _beside(self, element: Element, body: Body, x: float, y: float, along: float | None = None) -> Spot:
        orientation = element.child("Orientation")
        if orientation is None:
            return Spot(x, y, body.heading if along is None else along)
        h = orientation.number("h", 0.0, low=-1e3, high=1e3, unit="rad")
        if orientation.attributes.get("type", "absolute") != "relative":
            return Spot(x, y, self.frame.heading(h), True)
        return Spot(x, y, h + (body.heading if along is None else along), True)


def _refers_to(position: Element) -> str | None:
    for child in position.children:
        if child.tag.startswith("Relative"):
            return child.string("entityRef")
    return None


def _metres(element: Element, name: str, default: float | None = None) -> float:
    return element.number(name, default, low=-_FAR, high=_FAR, unit="m")


def _s(element: Element) -> float:
    return element.number("s", low=-1e6, high=1e6, unit="m")


def _borders(road: Road, element: Element, s: float) -> tuple[float, float]:
    ident = element.integer("laneId", low=-1000, high=1000)
    if ident == 0 or ident not in road.section(s).lanes:
        known = ", ".join(map(str, sorted(road.section(s).lanes, reverse=True)))
        raise DataError(f"{element.place}: road {road.ident} has no lane {ident} there; it has: {known}.")
    return road.borders(ident, s)
