"""Search for a way out of a recorded crash: every sequence of the AV's manoeuvres, from a moment on.

docs/adr/0014-avoidability.md says what counts as a way out, which sequences are tried and why none is missed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.counterfactual.motion import STRONGEST_ACCELERATION, allocate_rows, change_to, take_over_av
from cornerforge.geometry import Box, boxes_overlap, path_at
from cornerforge.recordings import box_in
from cornerforge.road.lanes import has_left, may_change
from cornerforge.sim import actions, motion
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.recordings import Trajectories
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim import World

__all__ = [
    "BRAKING",
    "COMBINED",
    "FOUND",
    "GAVE_UP",
    "KINDS",
    "NONE",
    "STEERING",
    "Manoeuvres",
    "Plans",
    "SearchScratch",
    "allocate_plans",
    "allocate_search",
    "latest_ways_out",
    "stopping_frames",
]

BRAKING, STEERING, COMBINED = 0, 1, 2
"""Kinds of ways out: accelerations only, on the lateral path that the AV is on; lane changes only, at constant speed;
both."""
KINDS = 3
NONE, FOUND, GAVE_UP = 0, 1, 2
"""Results of a search: there is no way out, there is one, or there were more states than the hash table may hold."""

_DT = FRAME_S
_LANE_CHOICES = 3
_PLACE_CHOICES = 5
_SLOTS = 1 << 18
_PER_UNIT = 1e6
"""States are rounded to a millionth of each unit [m, m/s, ...]; states that are then equal count as one."""
_ODD = np.uint64(0x9E3779B97F4A7C15)
_SHIFT = np.uint64(29)
_MASK = np.uint64(_SLOTS - 1)

OBSTACLE = np.dtype([("x", "f8"), ("y", "f8"), ("heading", "f8"), ("length", "f8"), ("width", "f8")])


class Manoeuvres(NamedTuple):
    """Manoeuvres that the AV may try, as kernels take them.

    Attributes:
        accelerations: Accelerations that it may command from one decision to the next [m/s2], 0 among them, (A,).
        every: Frames between two decisions.
        horizon: Frames after the contact until which no vehicle may touch the AV.
        lane_changes: Largest number of decisions for another lane.
        stopping: Deceleration [m/s2], above 0, with which it must be able to stop at the end without touching a vehicle
            that is then ahead of it.
        lookback: Frames before the contact that are tried as the first moment.
        only_partner: See `motion.continue_recording`.
        road: Constants of the recording.
        evasive: The same constants, with the duration and the lateral acceleration of the AV's own lane changes, and
            `parts` times as many lanes, each so much narrower.
        parts: Places in a lane at which the AV may drive (`motion.take_over_av`): 1, or 3 for an AV that steers, which
            may also pass by an obstacle within its lane.
    """

    accelerations: NDArray[np.float64]
    every: int
    horizon: int
    lane_changes: int
    stopping: float
    lookback: int
    only_partner: int
    road: RoadNumbers
    evasive: RoadNumbers
    parts: int


class Plans(NamedTuple):
    """The latest way out of each kind: decisions `Manoeuvres.every` frames apart.

    Attributes:
        moment: Frame of the first decision, -1 where there is no way out, int64 (KINDS,).
        steps: Number of decisions, int64 (KINDS,).
        acceleration: Acceleration commanded from each decision on [m/s2], (KINDS, decisions).
        lane: Target lane from each decision on, of `Manoeuvres.evasive`, int64 (KINDS, decisions).
    """

    moment: NDArray[np.int64]
    steps: NDArray[np.int64]
    acceleration: NDArray[np.float64]
    lane: NDArray[np.int64]


class SearchScratch(NamedTuple):
    """Memory for a search; one serves one thread.

    Attributes:
        rows: Row k is the AV after k decisions; one more row serves to try stopping.
        choice: Next choice to try after k decisions.
        chosen: Index of the acceleration commanded before decision k.
        changes: Number of decisions for another lane before decision k.
        near: The vehicles that the AV can meet at a frame, (frames, slots) of OBSTACLE.
        n_near: Their number, (frames,).
        seen: Hash table of the states seen.
        seen_by: Number of the search that saw the state.
        counts: [states seen in this search, number of this search, states seen in all searches].
    """

    rows: World
    choice: NDArray[np.int64]
    chosen: NDArray[np.int64]
    changes: NDArray[np.int64]
    near: NDArray[np.void]
    n_near: NDArray[np.int64]
    seen: NDArray[np.uint64]
    seen_by: NDArray[np.int64]
    counts: NDArray[np.int64]


def allocate_plans(decisions: int) -> Plans:
    """Allocate plans of at most `decisions` decisions."""
    shape = (KINDS, decisions)
    moment, steps = np.full(KINDS, -1, dtype=np.int64), np.zeros(KINDS, dtype=np.int64)
    return Plans(moment, steps, np.zeros(shape), np.zeros(shape, dtype=np.int64))


def allocate_search(decisions: int, frames: int, slots: int) -> SearchScratch:
    """Allocate memory for searches of at most `decisions` decisions.

    Args:
        decisions: Decisions of a way out.
        frames: Largest number of frames of a recording with its continuation.
        slots: Vehicles of a recording, at most.
    """
    choice, chosen, changes = (np.zeros(decisions + 2, dtype=np.int64) for _ in range(3))
    return SearchScratch(
        allocate_rows(decisions + 2),
        choice,
        chosen,
        changes,
        near=np.zeros((frames, slots), dtype=OBSTACLE),
        n_near=np.zeros(frames, dtype=np.int64),
        seen=np.zeros(_SLOTS, dtype=np.uint64),
        seen_by=np.zeros(_SLOTS, dtype=np.int64),
        counts=np.zeros(3, dtype=np.int64),
    )


def stopping_frames(road: RoadNumbers, deceleration: float) -> int:
    """Compute an upper bound of the frames that stopping at `deceleration` [m/s2] takes, from any acceleration.

    While the brakes come on, the vehicle is at most at its highest speed.
    """
    ramp = (STRONGEST_ACCELERATION + deceleration) * road.ramp_time
    return int(np.ceil((ramp + road.max_speed / deceleration) / FRAME_S)) + 1


@inlined_kernel
def _diagonal(bodies: NDArray[np.void], i: int) -> float:
    """Compute the diagonal of vehicle i's box [m]."""
    length, width = bodies[i].length, bodies[i].width
    diagonal: float = np.sqrt(length * length + width * width)
    return diagonal


@kernel
def _gather_near(test: Trajectories, moment: int, end: int, m: Manoeuvres, road: RoadNumbers, s: SearchScratch) -> None:
    """List, for each frame from `moment` + 1 to `end`, the vehicles that the AV can meet, however it accelerates."""
    frames, bodies = test.frames, test.bodies
    x, speed = frames[moment, 0].x, frames[moment, 0].speed
    slowest = speed
    fastest = speed
    behind = x
    ahead = x
    hardest = 0.0
    quickest = 0.0
    for k in range(m.accelerations.size):
        hardest = min(hardest, m.accelerations[k])
        quickest = max(quickest, m.accelerations[k])
    if road.ramp_time > 0.0:  # until the first decision has come into force
        hardest = min(hardest, frames[moment, 0].acceleration)
        quickest = max(quickest, frames[moment, 0].acceleration)
    largest = 0.0
    for j in range(1, test.n):
        largest = max(largest, _diagonal(bodies, j))
    reach = 0.5 * (_diagonal(bodies, 0) + largest)
    for f in range(moment + 1, end + 1):
        # the speed at the frame's end while braking, at its end while accelerating: bounds, not the motion itself
        slowest = max(0.0, slowest + hardest * _DT)
        fastest = min(road.max_speed, fastest + quickest * _DT)
        behind += slowest * _DT
        ahead += fastest * _DT
        found = 0
        for j in range(1, test.n):
            if frames[f, j].present and behind - reach < frames[f, j].x < ahead + reach:
                s.near[f, found].x = frames[f, j].x
                s.near[f, found].y = frames[f, j].y
                s.near[f, found].heading = frames[f, j].heading
                s.near[f, found].length = bodies[j].length
                s.near[f, found].width = bodies[j].width
                found += 1
        s.n_near[f] = found


@inlined_kernel
def _mix(state: np.uint64, value: float) -> np.uint64:
    state = (state ^ np.uint64(np.int64(np.rint(value * _PER_UNIT)))) * _ODD
    return state ^ (state >> _SHIFT)


@inlined_kernel
def _is_new(s: SearchScratch, k: int, road: RoadNumbers) -> bool:
    """Note the AV's state after k decisions; False if this search has seen it before.

    The state is all that its future depends on, so a state seen before leads nowhere new. Two states with the same
    64-bit hash are taken for one: with a hundred thousand states this happens in one of four thousand million searches.
    """
    v = s.rows.vehicles
    key = np.uint64(k * 64 + s.changes[k] * 8 + v[k].target_lane)
    key = _mix(key, v[k].x)
    key = _mix(key, v[k].speed)
    key = _mix(key, v[k].y)
    key = _mix(key, v[k].heading)
    if road.ramp_time > 0.0:
        key = _mix(key, v[k].acceleration)
    if v[k].duration > 0.0:
        _, speed, acceleration = path_at(motion.path_of(v, k), v[k].clock)
        key = _mix(key, speed)
        key = _mix(key, acceleration)
        key = _mix(key, v[k].duration - v[k].clock)
    place = key & _MASK
    while s.seen_by[place] == s.counts[1]:
        if s.seen[place] == key:
            return False
        place = (place + np.uint64(1)) & _MASK
    s.seen[place] = key
    s.seen_by[place] = s.counts[1]
    s.counts[0] += 1
    return True


@inlined_kernel
def _drives_clear(s: SearchScratch, k: int, body: Any, f0: int, m: Manoeuvres, road: RoadNumbers) -> bool:
    """Move row k from frame f0 to the next decision; False as soon as a vehicle touches it, or its lane ended."""
    v = s.rows.vehicles
    for i in range(1, m.every + 1):
        motion.move_vehicle(v, k, i * _DT, road)
        for c in range(s.n_near[f0 + i]):
            o = s.near[f0 + i, c]
            if boxes_overlap(
                Box(v[k].x, v[k].y, v[k].heading, body.length, body.width),
                Box(o.x, o.y, o.heading, o.length, o.width),
            ):
                return False
    return not (road.lanes.varied and has_left(v, k, road))


@inlined_kernel
def _can_stop(s: SearchScratch, k: int, test: Trajectories, end: int, m: Manoeuvres, road: RoadNumbers) -> bool:
    """Can the AV of row k, at frame `end`, stop without touching a vehicle that is ahead of it at that frame?"""
    v = s.rows.vehicles
    frames, body = test.frames, test.bodies[0]
    v[k + 1] = v[k]
    x = v[k].x
    actions.hold(v, k + 1, -m.stopping, road)
    f = end
    while v[k + 1].speed > 0.0:
        f += 1
        motion.move_vehicle(v, k + 1, (f - end) * _DT, road)
        for j in range(1, test.n):
            if (
                frames[f, j].present
                and frames[end, j].x > x
                and boxes_overlap(
                    Box(v[k + 1].x, v[k + 1].y, v[k + 1].heading, body.length, body.width), box_in(test, f, j)
                )
            ):
                return False
    return not (road.lanes.varied and has_left(v, k + 1, road))


@inlined_kernel
def _decides(s: SearchScratch, k: int, choice: int, kind: int, m: Manoeuvres, road: RoadNumbers) -> bool:
    """Put the AV into row k + 1 as it is just after choice number `choice` at decision k; False if that is no choice.

    Choices that keep the lane come first, and among them the one that keeps the acceleration: so the first way out that
    is found is a calm one.
    """
    v = s.rows.vehicles
    n_accelerations = m.accelerations.size
    lateral = choice // n_accelerations
    index = choice % n_accelerations
    if k > 0 and index == 0:
        index = s.chosen[k]
    elif k > 0 and index <= s.chosen[k]:
        index -= 1
    if (kind == STEERING and m.accelerations[index] != 0.0) or (lateral > 0 and s.changes[k] == m.lane_changes):
        return False
    far = m.parts if lateral > 2 else 1
    lane = v[k].target_lane + (0 if lateral == 0 else far if lateral % 2 == 1 else -far)
    if lane < 0 or lane >= road.n_lanes or (lateral > 0 and not may_change(v, k, lane, road)):
        return False
    v[k + 1] = v[k]
    actions.hold(v, k + 1, m.accelerations[index], road)
    if lateral > 0:
        change_to(s.rows, k + 1, lane, m.parts, road)
    s.chosen[k + 1] = index
    s.changes[k + 1] = s.changes[k] + (1 if lateral > 0 else 0)
    return True


@kernel
def _find_way_out(test: Trajectories, last: int, moment: int, kind: int, m: Manoeuvres, s: SearchScratch) -> int:
    """Try all sequences of decisions, depth first, each state once; return NONE, FOUND or GAVE_UP.

    Row 0 holds the AV at `moment`. After FOUND, rows 1 .. steps hold the AV at the end of each decision's period.
    """
    evasive = m.evasive
    body = test.bodies[0]
    steps = -((moment - last - m.horizon) // m.every)
    s.counts[0] = 0
    s.counts[1] += 1
    s.changes[0] = 0
    s.choice[0] = 0
    laterally = _LANE_CHOICES if m.parts == 1 else _PLACE_CHOICES
    choices = m.accelerations.size * (1 if kind == BRAKING else laterally)
    k = 0
    while k >= 0:
        choice = s.choice[k]
        if choice == choices:
            k -= 1
            continue
        s.choice[k] += 1
        frame = moment + k * m.every
        if not _decides(s, k, choice, kind, m, evasive) or not _drives_clear(s, k + 1, body, frame, m, evasive):
            continue
        if k + 1 < steps:
            if _is_new(s, k + 1, evasive):
                k += 1
                s.choice[k] = 0
            if 2 * s.counts[0] > _SLOTS:
                s.counts[2] += s.counts[0]
                return GAVE_UP
        elif (kind != STEERING or s.changes[k + 1] > 0) and _can_stop(s, k + 1, test, frame + m.every, m, evasive):
            s.counts[2] += s.counts[0]
            return FOUND
    s.counts[2] += s.counts[0]
    return NONE


@inlined_kernel
def _note_plan(s: SearchScratch, kind: int, moment: int, steps: int, plans: Plans) -> None:
    """Keep the decisions that led to the rows of a search that found a way out."""
    v = s.rows.vehicles
    plans.moment[kind] = moment
    plans.steps[kind] = steps
    for k in range(steps):
        plans.acceleration[kind, k] = v[k + 1].commanded
        plans.lane[kind, k] = v[k + 1].target_lane


@kernel
def latest_ways_out(
    test: Trajectories, last: int, since: int, earliest: int, m: Manoeuvres, s: SearchScratch, plans: Plans
) -> int:
    """Find the latest way out of each kind, going back frame by frame from the contact.

    Args:
        test: Recording with its continuation (`continue_recording`) until `stopping_frames` after the end of the last
            decision's period.
        last: Frame of the contact.
        since: First moment at which braking and steering are tried alone.
        earliest: First moment to look at, at least 0; moments before `since` are tried only while no way out is found.
        m: What the AV may do.
        s: Scratch.
        plans: Filled; COMBINED holds the latest way out of any kind, with accelerations or lane changes only if one of
            these is enough.

    Returns:
        1 if some search gave up: `plans` may then hold an earlier moment than the true one, or none.
    """
    gave_up = 0
    for kind in range(KINDS):
        plans.moment[kind] = -1
        plans.steps[kind] = 0
    for moment in range(last - 1, earliest - 1, -1):
        steps = -((moment - last - m.horizon) // m.every)
        _gather_near(test, moment, moment + steps * m.every, m, m.road, s)
        take_over_av(s.rows, 0, test, moment, m.parts, m.road, m.evasive)
        for kind in range(KINDS):
            if plans.moment[kind] >= 0 or (kind != COMBINED and moment < since):
                continue
            result = _find_way_out(test, last, moment, kind, m, s)
            if result == GAVE_UP:
                gave_up = 1
            elif result == FOUND:
                _note_plan(s, kind, moment, steps, plans)
                if plans.moment[COMBINED] < 0:
                    _note_plan(s, COMBINED, moment, steps, plans)
        both = plans.moment[BRAKING] >= 0 and plans.moment[STEERING] >= 0
        if both or (moment <= since and plans.moment[COMBINED] >= 0):
            break
    return gave_up
