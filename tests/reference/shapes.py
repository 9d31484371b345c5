"""Rectangles and lateral paths, as objects."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Box", "LateralPath", "plan"]

Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A rectangle by its centre [m], heading [rad], length and width [m]."""

    x: float
    y: float
    heading: float
    length: float
    width: float

    def corners(self) -> list[Point]:
        """The four corners, counter-clockwise from the front left."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        halves = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
        return [
            (
                self.x + 0.5 * (a * self.length * c - b * self.width * s),
                self.y + 0.5 * (a * self.length * s + b * self.width * c),
            )
            for a, b in halves
        ]

    def overlaps(self, other: Box) -> bool:
        """Two convex shapes are apart when their shadows on the normal of some side are; touching is apart."""
        reach = 0.5 * (math.hypot(self.length, self.width) + math.hypot(other.length, other.width))
        if math.hypot(other.x - self.x, other.y - self.y) >= reach:
            return False
        mine, theirs = self.corners(), other.corners()
        for box in (self, other):
            for angle in (box.heading, box.heading + 0.5 * math.pi):
                c, s = math.cos(angle), math.sin(angle)
                # from this box's centre: far from x = 0 the corners would lose their last digits
                a = [(px - self.x) * c + (py - self.y) * s for px, py in mine]
                b = [(px - self.x) * c + (py - self.y) * s for px, py in theirs]
                if max(a) <= min(b) or max(b) <= min(a):
                    return False
        return True


@dataclass(frozen=True)
class LateralPath:
    """y(t) = sum of c_k t^k, k = 0..5, for t in [0, duration]."""

    c: tuple[float, float, float, float, float, float]
    duration: float

    @classmethod
    def between(cls, y: float, speed: float, acceleration: float, y_end: float, duration: float) -> LateralPath:
        """From a lateral state to rest at `y_end`."""
        t = duration
        half = 0.5 * acceleration
        # What the first three terms leave to the last three, in position, speed and acceleration at the end.
        way = y_end - y - speed * t - half * t * t
        rate = -speed - 2.0 * half * t
        bend = -2.0 * half
        t3 = t * t * t
        t4 = t3 * t
        t5 = t4 * t
        c3 = (10.0 * way - 4.0 * rate * t + 0.5 * bend * t * t) / t3
        c4 = (-15.0 * way + 7.0 * rate * t - bend * t * t) / t4
        c5 = (6.0 * way - 3.0 * rate * t + 0.5 * bend * t * t) / t5
        return cls((y, speed, half, c3, c4, c5), duration)

    def position(self, t: float) -> float:
        """By Horner's rule."""
        value = self.c[5]
        for c in reversed(self.c[:5]):
            value = c + t * value
        return value

    def speed(self, t: float) -> float:
        """First derivative."""
        _, c1, c2, c3, c4, c5 = self.c
        return c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))

    def acceleration(self, t: float) -> float:
        """Second derivative."""
        _, _, c2, c3, c4, c5 = self.c
        return 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))

    def peak_acceleration(self) -> float:
        """Largest |acceleration|: at an end or where the third derivative, c + b t + a t^2, is zero."""
        a, b, c = 60.0 * self.c[5], 24.0 * self.c[4], 6.0 * self.c[3]
        places = [0.0, self.duration]
        square = b * b - 4.0 * a * c
        if a != 0.0 and square > 0.0:
            places += [(-b + math.sqrt(square)) / (2.0 * a), (-b - math.sqrt(square)) / (2.0 * a)]
        elif a == 0.0 and b != 0.0:
            places.append(-c / b)
        return max(abs(self.acceleration(t)) for t in places if 0.0 <= t <= self.duration)


def plan(
    y: float, speed: float, acceleration: float, y_end: float, duration: float, max_acceleration: float
) -> LateralPath:
    """The first duration, growing by a tenth at a time, that keeps the bound, or the present acceleration if more."""
    bound = max(max_acceleration, abs(acceleration)) + 1e-9
    longest = 8.0 * duration
    path = LateralPath.between(y, speed, acceleration, y_end, duration)
    while path.duration < longest and path.peak_acceleration() > bound:
        path = LateralPath.between(y, speed, acceleration, y_end, 1.1 * path.duration)
    return path
