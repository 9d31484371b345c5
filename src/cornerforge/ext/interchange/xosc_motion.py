"""How the vehicles of an OpenSCENARIO file move: by speed, by lane, or along a trajectory.

In our axes: x along the travel, y to the left. A vehicle is where its reference point is, the middle of its rear axle.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from cornerforge.ext.interchange.xml_input import Element

__all__ = ["SHAPES", "Body", "Profile", "Ramp", "Shape", "Sideways", "Spot", "Trajectory", "duration_of"]

_ENDS = 1e-9
_LEAST = 1e-6
_LEAP = 1.0
"""A vehicle that is put farther off than this leaps [m]."""


@dataclass(frozen=True, slots=True)
class Shape:
    """How a value goes from 0 to 1 while u does: its course, largest slope and largest curvature."""

    at: Callable[[float], float]
    slope: float
    curvature: float


SHAPES = {
    "step": Shape(lambda _: 1.0, math.inf, math.inf),
    "linear": Shape(lambda u: u, 1.0, math.inf),
    "cubic": Shape(lambda u: u * u * (3.0 - 2.0 * u), 1.5, 6.0),
    "sinusoidal": Shape(lambda u: 0.5 - 0.5 * math.cos(math.pi * u), 0.5 * math.pi, 0.5 * math.pi**2),
}


@dataclass(frozen=True, slots=True)
class Spot:
    """A place and a direction: x, y [m], heading [rad]; `turned` says whether the file gave the direction."""

    x: float
    y: float
    heading: float = 0.0
    turned: bool = False


@dataclass(slots=True, eq=False)
class Profile:
    """Speeds [m/s] at times after its start [s], evenly between."""

    start: float
    times: Sequence[float]
    speeds: Sequence[float]
    done: bool = False

    def speed(self, t: float) -> float:
        """Speed at time t."""
        tau = t - self.start
        if tau >= self.times[-1] - _ENDS:
            return self.speeds[-1]
        k = max(1, bisect_right(self.times, tau))
        a, b = self.times[k - 1], self.times[k]
        return self.speeds[k - 1] + (self.speeds[k] - self.speeds[k - 1]) * (tau - a) / max(b - a, _ENDS)

    def check(self, t: float) -> None:
        """Note whether it is over."""
        self.done = t >= self.start + self.times[-1] - _ENDS


@dataclass(slots=True, eq=False)
class Ramp:
    """A change of speed from `before` to a target, which may move."""

    start: float
    before: float
    target: Callable[[], float]
    shape: Shape
    duration: float
    follows: bool = False
    done: bool = False

    def speed(self, t: float) -> float:
        """Speed at time t."""
        u = (t - self.start) / self.duration if self.duration > 0.0 else 1.0
        return self.before + (self.target() - self.before) * (1.0 if u >= 1.0 else self.shape.at(max(u, 0.0)))

    def check(self, t: float) -> None:
        """Note whether it is over; one that follows another vehicle never is."""
        self.done = not self.follows and t >= self.start + self.duration - _ENDS


@dataclass(slots=True, eq=False)
class Sideways:
    """A way across the road from `before` to `after` [m], over an extent [s], or along one [m] if `by_distance`."""

    start: float
    before: float
    after: float
    shape: Shape
    extent: float
    by_distance: bool
    done: bool = False

    def y(self, progress: float) -> float:
        """Where it is after this time or distance."""
        u = progress / self.extent if self.extent > 0.0 else 1.0
        return self.after if u >= 1.0 - _ENDS else self.before + (self.after - self.before) * self.shape.at(max(u, 0.0))


def duration_of(change: float, shape: Shape, dimension: str, value: float, mean: float) -> tuple[float, bool]:
    """How long a change takes, or along which distance, from the dynamics that a file states.

    Args:
        change: Change of the value, without sign.
        shape: Its course.
        dimension: "time" [s], "distance" [m], or "rate": the largest change in a second.
        value: Value in that dimension.
        mean: Mean speed, to turn a distance into a time [m/s]; 0: leave it a distance.

    Returns:
        Time [s] or distance [m], and whether it is a distance; infinite: it never ends.
    """
    value = abs(value)
    if shape.slope == math.inf or change < _LEAST:
        return 0.0, False
    if dimension == "rate":
        return (shape.slope * change / value if value > _LEAST else math.inf), False
    if dimension == "distance" and mean > 0.0:
        return value / mean, False
    return value, dimension == "distance"


@dataclass(slots=True, eq=False)
class Trajectory:
    """Places to pass, straight between: with times of the whole scenario, or with the vehicle's own speed.

    Attributes:
        spots: At least two.
        times: Times of the scenario [s], rising; empty: none are stated.
        turned: Do the places state directions? If not, the vehicle looks where it goes.
    """

    spots: Sequence[Spot]
    times: Sequence[float]
    turned: bool
    ways: list[float] = field(default_factory=list)
    gone: float = 0.0
    begun: bool = False
    done: bool = False

    def __post_init__(self) -> None:
        way = 0.0
        for k, spot in enumerate(self.spots):
            if k:
                way += math.hypot(spot.x - self.spots[k - 1].x, spot.y - self.spots[k - 1].y)
            self.ways.append(way)

    def at(self, place: float) -> Spot:
        """Where it leads at this time, or, without times, after this distance."""
        scale = self.times or self.ways
        k = min(max(1, bisect_right(scale, place)), len(scale) - 1)
        low, high = scale[k - 1], scale[k]
        u = min(max((place - low) / (high - low), 0.0), 1.0) if high > low else 1.0
        a, b = self.spots[k - 1], self.spots[k]
        if self.turned:
            turn = (b.heading - a.heading + math.pi) % (2.0 * math.pi) - math.pi
            heading = a.heading + u * turn
        else:
            heading = math.atan2(b.y - a.y, b.x - a.x) if math.hypot(b.x - a.x, b.y - a.y) > _LEAST else 0.0
        if u in (0.0, 1.0):
            spot = b if u else a
            return Spot(spot.x, spot.y, spot.heading if self.turned else heading)
        return Spot(a.x + u * (b.x - a.x), a.y + u * (b.y - a.y), heading)

    def speed(self, t: float) -> float:
        """Speed along the way that its times state."""
        k = min(max(1, bisect_right(self.times, t)), len(self.times) - 1)
        return (self.ways[k] - self.ways[k - 1]) / max(self.times[k] - self.times[k - 1], _ENDS)


@dataclass(slots=True, eq=False)
class Body:
    """A vehicle on the road.

    Attributes:
        name: Name in the file.
        element: Element that declares it.
        kind: Index of `types.CLASSES`.
        length, width: Length and width of its box [m].
        ahead, left: Place of its box's middle from its reference point [m].
        x, y, heading: Pose of its reference point, in our axes.
        speed: Along its way [m/s]; `along_road` is its part along the road.
        lane: Index of the lane that an action has it keep or go to; None: not known.
        controlled: It has a controller of its own.
        unknown: It is the AV, and its motion is unknown: here it keeps its speed and lane.
        law, way, path: What moves it: its speed, across the road, along a trajectory; None: it keeps what it has.
    """

    name: str
    element: Element
    kind: int
    length: float
    width: float
    ahead: float
    left: float
    controlled: bool = False
    unknown: bool = False
    present: bool = False
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    speed: float = 0.0
    along_road: float = 0.0
    acceleration: float = 0.0
    travelled: float = 0.0
    stands: float = 0.0
    clock: float = 0.0
    leaps: int = 0
    lane: int | None = None
    law: Profile | Ramp | None = None
    way: Sideways | None = None
    path: Trajectory | None = None

    def put(self, spot: Spot, t: float) -> None:
        """Put it somewhere, at time t."""
        self._leap(spot)
        self.present, self.clock = True, t
        self.x, self.y, self.heading = spot.x, spot.y, spot.heading
        self.along_road = self.speed * math.cos(self.heading)

    def _leap(self, spot: Spot) -> None:
        """Count it if it is put elsewhere while it is there."""
        if self.present and math.hypot(spot.x - self.x, spot.y - self.y) > _LEAP:
            self.leaps += 1

    @property
    def middle(self) -> tuple[float, float]:
        """Middle of its box."""
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return self.x + self.ahead * cos - self.left * sin, self.y + self.ahead * sin + self.left * cos

    @property
    def ends(self) -> tuple[float, float]:
        """How far its box reaches before and behind its reference point [m]."""
        return 0.5 * self.length + self.ahead, 0.5 * self.length - self.ahead

    @property
    def timed(self) -> bool:
        """Is where it is at each moment stated?"""
        return self.path is not None and bool(self.path.times)

    def start(self, t: float) -> None:
        """Let laws that begin now with a step take hold."""
        if self.law is not None:
            self.speed = self.law.speed(t)
            self._finish_law(t)
        if self.way is not None and self.way.extent == 0.0:
            self.y, self.heading, self.way.done, self.way = self.way.after, 0.0, True, None
        if self.path is not None and not (self.path.times and t < self.path.times[0] - _ENDS):
            self._follow(self.path, t, 0.0)
        else:
            self.along_road = self.speed * math.cos(self.heading)

    def advance(self, t: float) -> None:
        """Go on to t."""
        before, dt = self.speed, t - self.clock
        if not self.present or dt <= 0.0:
            return
        self.clock = t
        if self.path is not None and not (self.path.times and t < self.path.times[0] - _ENDS):
            self._follow(self.path, t, dt)
        elif self.law is None and self.way is None:
            self.x += self.along_road * dt
            self.y += self.speed * math.sin(self.heading) * dt if self.heading else 0.0
            self.travelled += self.speed * dt
        else:
            self._drive(t, dt)
        self.acceleration = (self.speed - before) / dt
        self.stands = self.stands + dt if self.speed < _LEAST else 0.0

    def _drive(self, t: float, dt: float) -> None:
        half = self.speed if self.law is None else self.law.speed(t - 0.5 * dt)
        if self.law is not None:
            self.speed = self.law.speed(t)
            self._finish_law(t)
        way, across = self.way, 0.0
        self.travelled += half * dt
        if way is not None:
            way_on = way.start + half * dt if way.by_distance else t - way.start
            y = way.y(way_on)
            if way.by_distance:
                way.start = way_on  # here `start` is the distance gone
            across, self.y = (y - self.y) / dt, y
            way.done = way_on >= way.extent - _ENDS
        along = math.sqrt(max(half * half - across * across, 0.0))
        self.x += along * dt
        self.heading = math.atan2(across, along) if along > _LEAST else 0.0
        self.along_road = self.speed * math.cos(self.heading)
        if way is not None and way.done:
            self.way, self.heading, self.along_road = None, 0.0, self.speed

    def _finish_law(self, t: float) -> None:
        if self.law is not None:
            self.law.check(t)
            if self.law.done:
                self.law = None

    def _follow(self, path: Trajectory, t: float, dt: float) -> None:
        x, y = self.x, self.y
        if path.times:
            place, last = t, path.times[-1]
            self.speed = path.speed(t)
        else:
            half = self.speed if self.law is None else self.law.speed(t - 0.5 * dt)
            if self.law is not None:
                self.speed = self.law.speed(t)
                self._finish_law(t)
            path.gone += half * dt
            place, last = path.gone, path.ways[-1]
        spot = path.at(place)
        if not path.begun:
            path.begun = True
            self._leap(spot)
        self.x, self.y, self.heading = spot.x, spot.y, spot.heading
        self.travelled += math.hypot(self.x - x, self.y - y) if dt else 0.0
        self.along_road = self.speed * math.cos(spot.heading)
        if place > last + _ENDS:
            self._leave(path, place - last)

    def _leave(self, path: Trajectory, beyond: float) -> None:
        """Go straight on after the end of a trajectory."""
        path.done, self.path, self.heading = True, None, 0.0
        self.along_road = self.speed
        self.x += beyond * self.speed if path.times else beyond
