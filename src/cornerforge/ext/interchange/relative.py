"""The manoeuvre of the vehicle that the AV meets, relative to the AV: when it begins, and how it goes on.

A recorded case happens at times. For another AV, which drives faster or slower, the same manoeuvre at the same time may
be no danger at all. So the manoeuvre can begin when the AV is as near to it as the recorded one was.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.types import FRAME_S, Scenario

__all__ = ["LaneChange", "Manoeuvre", "SpeedChange", "Trigger", "manoeuvre_of"]

_BRAKES = -1.0
"""A vehicle brakes below this acceleration [m/s2]."""
_SLOWEST_AV = 1.0
"""Below this speed of the AV [m/s] a time gap says nothing."""
_IN_ITS_LANE = 0.1
"""A vehicle as near to the middle of its lane [m] has ended its change."""
_KNOT = 10
"""Frames between two points of the speed of a manoeuvre: drivers decide once a second."""
_SHORTEST, _LONGEST = 0.5, 30.0
_NEARLY = 1e-3


@dataclass(frozen=True)
class Trigger:
    """Condition between the AV and the other vehicle for the manoeuvre to begin.

    Attributes:
        measure: "time gap" from the AV's front to the other's rear over the AV's speed [s], or "distance" along the
            road between their reference points [m].
        rule: "lessThan" or "greaterThan".
        value: Value of the measure, between its values a tenth of a second before the recorded begin and at it.
        not_before: In the recording the same was so earlier too; this is a time [s] after that. None: it was not.
    """

    measure: str
    rule: str
    value: float
    not_before: float | None


@dataclass(frozen=True)
class LaneChange:
    """Part of a manoeuvre: `delay` after its begin [s], to `offset` [m] left of the middle of a lane, for a time [s].

    Only a change that is aborted has an offset: it ends where the vehicle turns around.
    """

    delay: float
    lane: int
    offset: float
    duration: float


@dataclass(frozen=True)
class SpeedChange:
    """Part of a manoeuvre: `delay` after its begin [s], within `duration` [s], to `speed` [m/s]."""

    delay: float
    duration: float
    speed: float


@dataclass(frozen=True)
class Manoeuvre:
    """Last manoeuvre of the AV's crash partner before the contact.

    Attributes:
        column: The partner.
        begin: Frame at which it begins.
        kind: "lane change" or "braking".
        trigger: When it begins, relative to the AV.
        lanes: Its lane changes; an aborted one is two: to where it turned around, and back.
        speeds: How its speed changes, at least one.
    """

    column: int
    begin: int
    kind: str
    trigger: Trigger
    lanes: tuple[LaneChange, ...]
    speeds: tuple[SpeedChange, ...]


def manoeuvre_of(scenario: Scenario, reference: NDArray[np.float64]) -> Manoeuvre | None:
    """Find the last lane change or braking of the AV's crash partner.

    Of the two it is the lane change, unless that had ended before the braking began; a vehicle behind the AV endangers
    no other by braking. A lane change that turned around is one manoeuvre of two changes.

    Args:
        scenario: A recorded test.
        reference: How far each vehicle's reference point is behind its box's centre [m], (N,).

    Returns:
        None where the AV touches no vehicle, or where its partner neither changed lanes nor braked, or is not there all
        the time.
    """
    column = scenario.partner
    if column is None or not scenario.present[:, [0, column]].all():
        return None
    changes, ended = _last_change(scenario, column)
    braking = _last_braking(scenario, column)
    if changes and (braking is None or ended is None or braking <= ended):
        begin, kind, lanes = changes[0], "lane change", _lane_changes(scenario, column, changes)
    elif braking is not None:
        begin, kind, lanes = braking, "braking", ()
    else:
        return None
    trigger = _trigger(scenario, column, begin, reference)
    return Manoeuvre(column, begin, kind, trigger, lanes, _speeds(scenario.speed[:, column], begin))


def _last_change(scenario: Scenario, column: int) -> tuple[list[int], int | None]:
    """Find the frames at which the parts of the last lane change begin, and the frame at which it ended, if it did."""
    width = scenario.odd.lane_width
    target, y = scenario.target_lane[:, column].astype(np.int64), scenario.y[:, column]
    starts = [int(f) + 1 for f in np.flatnonzero(target[1:] != target[:-1])]
    if target[0] != math.floor(y[0] / width):
        starts.insert(0, 0)
    if not starts:
        return [], None
    first = len(starts) - 1
    while first > 0:
        wanted = (target[starts[first] - 1] + 0.5) * width
        if abs(y[starts[first]] - wanted) < _IN_ITS_LANE:
            break
        first -= 1
    there = np.abs(y - (target[-1] + 0.5) * width) < _IN_ITS_LANE
    there[: starts[-1] + 1] = False
    return starts[first:], int(np.flatnonzero(there)[0]) if there.any() else None


def _last_braking(scenario: Scenario, column: int) -> int | None:
    """Find the frame at which the last braking of a vehicle ahead of the AV began."""
    brakes = scenario.acceleration[:, column] < _BRAKES
    begins = np.flatnonzero(brakes & ~np.concatenate([[False], brakes[:-1]]))
    if begins.size == 0 or scenario.x[begins[-1], column] <= scenario.x[begins[-1], 0]:
        return None
    return int(begins[-1])


def _lane_changes(scenario: Scenario, column: int, starts: Sequence[int]) -> tuple[LaneChange, ...]:
    y, width = scenario.y[:, column], scenario.odd.lane_width
    usual = float(scenario.change_time[column])
    lanes = [int(scenario.target_lane[start, column]) for start in starts]
    now, lane, changes = starts[0], lanes[0], []
    for (start, until), other in zip(itertools.pairwise([*starts[1:], len(y) - 1]), lanes[1:], strict=True):
        goal, end, offset = (lane + 0.5) * width, start, 0.0
        side = np.sign(goal - y[now])
        if side * ((other + 0.5) * width - y[start]) > 0.0:  # farther to the same side
            duration = _duration(y[now : start + 1], goal, usual)
        else:
            end += int(np.argmax(side * y[start : until + 1]))
            if end == until:  # told to turn around, it has not done so yet
                continue
            offset, duration = float(y[end]) - goal, max(FRAME_S * (end - now), _SHORTEST)
        changes.append(LaneChange(FRAME_S * (now - starts[0]), lane, offset, duration))
        now, lane = end, other
    duration = _duration(y[now:], (lane + 0.5) * width, usual)
    return (*changes, LaneChange(FRAME_S * (now - starts[0]), lane, 0.0, duration))


def _duration(y: NDArray[np.float64], goal: float, usual: float) -> float:
    """Fit how long a change takes, if it goes like half a wave of a cosine [s].

    It is as far as recorded at its middle, or at the end of the record if that comes first.
    """
    way = goal - y[0]
    if abs(way) < _NEARLY:
        return usual
    share = (y - y[0]) / way
    near = int(np.flatnonzero(share <= 0.5)[-1])
    if near == 0 or share[near] < _NEARLY:
        return usual
    duration = FRAME_S * near * math.pi / math.acos(1.0 - 2.0 * share[near])
    return min(max(duration, _SHORTEST), _LONGEST)


def _speeds(speed: NDArray[np.float64], begin: int) -> tuple[SpeedChange, ...]:
    last = len(speed) - 1
    if begin == last:
        return (SpeedChange(0.0, FRAME_S, float(speed[last])),)
    knots = [*range(begin, last, _KNOT), last]
    return tuple(
        SpeedChange(FRAME_S * (k - begin), FRAME_S * (n - k), float(speed[n])) for k, n in itertools.pairwise(knots)
    )


def _trigger(scenario: Scenario, column: int, begin: int, reference: NDArray[np.float64]) -> Trigger:
    until = slice(0, begin + 1)
    ahead = scenario.x[until, column] - scenario.x[until, 0]
    gap = ahead - 0.5 * (scenario.length[0] + scenario.length[column])
    speed = scenario.speed[until, 0]
    if gap[-1] > 0.0 and speed[-1] > _SLOWEST_AV:
        measure, values = "time gap", np.abs(gap) / np.maximum(speed, _NEARLY)
    else:
        behind = reference * np.cos(scenario.heading[until])
        measure, values = "distance", np.abs(ahead - behind[:, column] + behind[:, 0])
    if begin == 0:
        return Trigger(measure, "lessThan", float(values[0]) + _NEARLY, None)
    before, at = float(values[-2]), float(values[-1])
    rule = "lessThan" if at <= before else "greaterThan"
    value = 0.5 * (before + at) if abs(at - before) > _NEARLY else at + (_NEARLY if rule == "lessThan" else -_NEARLY)
    held = np.flatnonzero(values[:-1] < value if rule == "lessThan" else values[:-1] > value)
    return Trigger(measure, rule, value, FRAME_S * (int(held[-1]) + 0.5) if held.size else None)
