"""Is there a way out of a crash? All sequences of decisions, one by one: nothing merged, nothing left out.

The traffic is that of objects that go on by themselves, so what a vehicle does after the contact is not taken from
frames, as it is in the package.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from itertools import product

from cornerforge.types import Odd
from reference.shapes import Box
from reference.world import Vehicle

__all__ = ["Actions", "Traffic", "has_way_out"]

Row = list[Vehicle]


@dataclass(frozen=True)
class Actions:
    """What the AV may do: accelerations [m/s2], frames between decisions, number of lane decisions, its own lane
    changes as an ODD; and frames after the contact that count.
    """

    accelerations: tuple[float, ...]
    every: int
    lane_changes: int
    evasive: Odd
    horizon: int


@dataclass(frozen=True)
class Traffic:
    """Every 0.1 s all vehicles, the AV first; until the contact at frame `last` as they drove, then nobody reacts."""

    odd: Odd
    rows: list[Row]
    last: int

    def grown(self, margin: float) -> Odd:
        """The ODD with vehicles longer and wider by a margin [m]."""
        odd = self.odd
        return replace(odd, vehicle_length=odd.vehicle_length + margin, vehicle_width=odd.vehicle_width + margin)


def has_way_out(traffic: Traffic, moment: int, kind: str, actions: Actions, margin: float = 0.0) -> bool:
    """Does some sequence from frame `moment` on keep the AV clear of everybody?

    Args:
        traffic: Long enough for the horizon, one decision more, and stopping.
        moment: Frame of the first decision.
        kind: "braking" (no lane decision), "steering" (constant speed, at least one lane decision), or "any".
        actions: What the AV may do.
        margin: By which all boxes are longer and wider [m]; negative: smaller.
    """
    av = copy(traffic.rows[moment][0])
    return _some(traffic, av, moment, 0, kind, actions, traffic.grown(margin))


def _some(traffic: Traffic, av: Vehicle, frame: int, changes: int, kind: str, actions: Actions, size: Odd) -> bool:
    if frame >= traffic.last + actions.horizon:
        return (kind != "steering" or changes > 0) and _stops(traffic, av, frame, actions, size)
    for following, changed in _decisions(av, kind, actions, changes):
        if _drives(traffic, following, frame, actions, size) and _some(
            traffic, following, frame + actions.every, changes + changed, kind, actions, size
        ):
            return True
    return False


def _decisions(av: Vehicle, kind: str, actions: Actions, changes: int) -> Iterator[tuple[Vehicle, int]]:
    """The AV after each decision that it has, and 1 if that is one about the lane."""
    sides = (0,) if kind == "braking" or changes == actions.lane_changes else (0, -1, 1)
    for side, acceleration in product(sides, (0.0,) if kind == "steering" else actions.accelerations):
        lane = av.target_lane + side
        if 0 <= lane < actions.evasive.n_lanes:
            following = copy(av)
            following.hold(acceleration, actions.evasive)
            if side:
                following.change_time = actions.evasive.lane_change_duration
                following.change_lane(lane, actions.evasive)
            yield following, abs(side)


def _drives(traffic: Traffic, av: Vehicle, frame: int, actions: Actions, size: Odd) -> bool:
    for f in range(frame + 1, frame + actions.every + 1):
        av.move(actions.evasive)
        if any(_touch(av, other, size) for other in traffic.rows[f][1:]):
            return False
    return True


def _stops(traffic: Traffic, av: Vehicle, frame: int, actions: Actions, size: Odd) -> bool:
    """Can it stop, without touching who is ahead of it?"""
    av = copy(av)
    ahead = [i for i, other in enumerate(traffic.rows[frame]) if i > 0 and other.x > av.x]
    av.hold(min(actions.accelerations), actions.evasive)
    while av.speed > 0.0:
        frame += 1
        av.move(actions.evasive)
        if any(_touch(av, traffic.rows[frame][i], size) for i in ahead):
            return False
    return True


def _touch(a: Vehicle, b: Vehicle, size: Odd) -> bool:
    return _body(a, size).overlaps(_body(b, size))


def _body(vehicle: Vehicle, size: Odd) -> Box:
    return Box(vehicle.x, vehicle.y, vehicle.heading, size.vehicle_length, size.vehicle_width)
