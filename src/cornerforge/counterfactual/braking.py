"""Could the AV have avoided its crash by braking? A kernel over a recorded test, and the same for a `Scenario`.

The question (docs/adr/0011-rewards.md): had the AV braked as hard as it can from `delay` seconds after the manoeuvre
that led to the crash began, and all others had moved as they did, would no vehicle have touched it?
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._checks import check_number
from cornerforge._elementary import atan
from cornerforge._jit import kernel
from cornerforge.counterfactual.begin import AV_BRAKES, AV_MOVES, manoeuvre_begin
from cornerforge.geometry import Box, boxes_overlap, path_at, plan_path
from cornerforge.recordings import BODY_FIELDS, Trajectories, box_in, recordings_of, unpack
from cornerforge.road.straight import lane_centre, road_numbers
from cornerforge.sim import allocate_recording, motion
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.geometry import Path
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.types import Scenario

__all__ = ["Braking", "avoidable_by_braking", "is_avoidable", "lateral_plan"]

_DT = FRAME_S
_SETTLED_M = 0.01
_FULL_STEERING_SPEED = 5.0
_LONGEST_FRAMES = 100
"""A braking AV that has touched no vehicle after so many frames is safe, even if it still moves: braking at 8 m/s2 from
40 m/s takes half of them."""


class Braking(NamedTuple):
    """How the AV would have braked.

    Attributes:
        delay: From the begin of the manoeuvre to the AV's reaction [s], at least 0; taken to the nearest 0.1 s.
        deceleration: Deceleration of the AV [m/s2], above 0.
    """

    delay: float
    deceleration: float


@kernel
def _last_change(frames: NDArray[np.void], slot: int, last: int, road: RoadNumbers) -> tuple[int, int]:
    """Find first and last frame of a slot's last lane change (or return from one) up to a frame; (-1, -1) for none."""
    start = last
    while (
        start > 0
        and frames[start - 1, slot].present
        and (frames[start, slot].target_lane == frames[start - 1, slot].target_lane)
    ):
        start -= 1
    centre = lane_centre(frames[start, slot].target_lane, road.lane_width)
    if abs(frames[start, slot].y - centre) <= _SETTLED_M:
        return -1, -1
    end = start
    while end < last and abs(frames[end, slot].y - centre) > _SETTLED_M:
        end += 1
    return start, end


@kernel
def lateral_plan(
    frames: NDArray[np.void], slot: int, frame: int, change_time: float, road: RoadNumbers
) -> tuple[Path, float]:
    """Estimate how a vehicle goes on across the road from a frame: its path, and the path's duration [s], 0 for none.

    The path is a quintic from the present state to the lane's centre, in the time that is left of the lane change.
    Speed and acceleration across the road are differences of the last frames. An undisturbed change takes `change_time`
    seconds.
    """
    y = frames[frame, slot].y
    centre = lane_centre(frames[frame, slot].target_lane, road.lane_width)
    nowhere = (y, 0.0, 0.0, 0.0, 0.0, 0.0)
    start, end = _last_change(frames, slot, frame, road)
    if start < 0 or (end < frame and abs(y - centre) <= _SETTLED_M) or abs(y - centre) <= _SETTLED_M:
        return nowhere, 0.0
    speed = 0.0
    acceleration = 0.0
    if frame >= 1 and frames[frame - 1, slot].present:
        speed = (y - frames[frame - 1, slot].y) / _DT
        if frame >= 2 and frame - start >= 2 and frames[frame - 2, slot].present:
            before = (frames[frame - 1, slot].y - frames[frame - 2, slot].y) / _DT
            acceleration = (speed - before) / _DT
            speed += 0.5 * acceleration * _DT  # from the middle of the last frame to its end
    left = max(change_time - (frame - start) * _DT, 0.2)
    return plan_path(y, speed, acceleration, centre, left, max(road.max_lateral_acceleration, abs(acceleration)))


@kernel
def _across(path: Path, duration: float, clock: float, speed: float, y_end: float) -> tuple[float, float]:
    """Compute lateral position [m] and heading [rad] on a planned path at `clock` [s]; after its end `y_end` and 0."""
    if clock >= duration:
        return y_end, 0.0
    y, lateral, _ = path_at(path, clock)
    return y, atan(lateral / max(speed, _FULL_STEERING_SPEED))


@kernel
def _is_enough(test: Trajectories, last: int, partner: int, road: RoadNumbers, begin: int, deceleration: float) -> bool:
    """Does nothing touch an AV that brakes so from frame `begin` on (0: that keeps its speed)?"""
    frames = test.frames
    body = test.bodies[0]
    if begin >= last:
        return False
    x0 = frames[begin, 0].x
    v0 = min(max(frames[begin, 0].speed, 0.0), road.max_speed)
    a0 = frames[begin, 0].acceleration if road.ramp_time > 0.0 else -deceleration
    path, duration = lateral_plan(frames, 0, begin, body.change_time, road)
    centre = lane_centre(frames[begin, 0].target_lane, road.lane_width) if duration > 0.0 else frames[begin, 0].y
    clock = 0.0
    other_path, other_duration = lateral_plan(frames, partner, last, test.bodies[partner].change_time, road)
    other = frames[last, partner]
    other_centre = lane_centre(other.target_lane, road.lane_width) if other_duration > 0.0 else other.y
    other_a = min(frames[last, partner].acceleration, 0.0)
    other_x = other.x
    other_v = other.speed
    other_clock = 0.0
    for f in range(begin + 1, begin + _LONGEST_FRAMES + 1):
        way, _, speed, _ = motion.go_on(v0, a0, -deceleration, (f - begin) * _DT, road)
        x = x0 + way
        clock += _DT * min(1.0, speed / _FULL_STEERING_SPEED)
        y, heading = _across(path, duration, clock, speed, centre)
        if f <= last:
            for j in range(1, test.n):
                if frames[f, j].present and boxes_overlap(
                    Box(x, y, heading, body.length, body.width), box_in(test, f, j)
                ):
                    return False
        else:
            after = max(0.0, other_v + other_a * _DT)
            other_x += 0.5 * (other_v + after) * _DT
            other_v = after
            other_clock += _DT * min(1.0, after / _FULL_STEERING_SPEED)
            other_y, other_heading = _across(other_path, other_duration, other_clock, after, other_centre)
            if boxes_overlap(
                Box(x, y, heading, body.length, body.width),
                Box(other_x, other_y, other_heading, test.bodies[partner].length, test.bodies[partner].width),
            ):
                return False
        if f >= last and speed == 0.0:
            return True
    return True


@kernel
def is_avoidable(test: Trajectories, last: int, partner: int, road: RoadNumbers, braking: Braking) -> bool:
    """Would no vehicle have touched the AV, had it braked to a stop from `braking.delay` after the manoeuvre began?

    Up to the contact all other vehicles move as recorded, and all count, also one that drives into the AV from behind.
    After the contact nothing is recorded, and only the partner counts (the others would have seen the braking): it
    completes its lane change, and brakes on if it braked, else keeps its speed. The AV's braking begins with the
    acceleration that it then has, at the ODD's jerk. It follows the lateral path that it
    was on when it began to brake. False when the contact comes before the AV's reaction.

    A manoeuvre that the AV itself began it can leave out: then nothing waits for `braking.delay`, and to keep lane and
    speed is enough too.

    Args:
        test: The recording.
        last: Frame of the contact.
        partner: Slot that the AV touched.
        road: Constants.
        braking: How the AV brakes.
    """
    begin, kind = manoeuvre_begin(test.frames, partner, last, road)
    if kind in (AV_MOVES, AV_BRAKES):
        return _is_enough(test, last, partner, road, begin, 0.0) or _is_enough(
            test, last, partner, road, begin, braking.deceleration
        )
    return _is_enough(test, last, partner, road, begin + int(np.rint(braking.delay / _DT)), braking.deceleration)


def avoidable_by_braking(scenario: Scenario, *, delay_s: float = 1.0, deceleration_mps2: float = 8.0) -> bool:
    """Could the AV have avoided its recorded crash by braking? As the reward `avoidable` counts it.

    Args:
        scenario: Recording of a test that ended in a crash of the AV; vehicles that never came near may be missing.
        delay_s: From the begin of the manoeuvre (`manoeuvre_begin`) to the AV's reaction [s], 0 to 10.
        deceleration_mps2: Deceleration of the AV [m/s2], 0.1 to 20.

    Returns:
        False also when the contact comes before the AV's reaction.

    Raises:
        InputError: There is no crash of the AV, its contact is not in the recording, or a number is out of range.
    """
    check_number("delay_s", delay_s, low=0.0, high=10.0, unit="s")
    check_number("deceleration_mps2", deceleration_mps2, low=0.1, high=20.0, unit="m/s2")
    recordings = recordings_of(scenario)
    last, partner = int(recordings.last[0]), int(recordings.partner[0])
    test = Trajectories(
        allocate_recording(*scenario.x.shape), np.zeros(scenario.slot.size, dtype=BODY_FIELDS), scenario.slot.size
    )
    unpack(recordings, 0, test.frames, test.bodies)
    braking = Braking(float(delay_s), float(deceleration_mps2))
    return bool(is_avoidable(test, last, partner, road_numbers(scenario.odd), braking))
