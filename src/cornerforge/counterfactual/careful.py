"""Reference drivers in a recorded crash: each drives in the AV's place among the recorded others (ADR 39).

Each takes over when the manoeuvre that led to the crash began, holds its speed until it sees danger, and brakes
(`drivers.careful`) on the path that the AV was on. If the AV was approaching the partner before that, the driver takes
over earlier, at the first moment of the approach at which it sees danger; where the approach is all that led to the
crash, it drives as the AV did until then. The motion of the others, the end and the
contacts that count are those of the search for ways out (`search`). One more driver, HOLDS, only holds its speed, in an
approach from when the last of the others has seen danger: where that is enough, braking has prevented nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.counterfactual.begin import APPROACH, manoeuvre_begin
from cornerforge.counterfactual.motion import allocate_rows, continue_recording, take_over_av
from cornerforge.counterfactual.search import Manoeuvres, stopping_frames
from cornerforge.drivers.careful import CAREFUL, HOLDS, Threat, braking_demanded, braking_of, own_reaction
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.recordings import BODY_FIELDS, Recordings, Trajectories, box_in, unpack
from cornerforge.road.straight import way_from
from cornerforge.sim import World, actions, allocate_recording, motion
from cornerforge.types import FRAME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "JudgeScratch",
    "Judgements",
    "allocate_judge_scratch",
    "allocate_judgements",
    "judge_cases",
    "no_tracks",
]

DRIVERS = HOLDS + 1
AT_ONCE = CAREFUL["reg157"]
"""Driver that brakes at once; the others have a jerk of their own, which the ODD may limit further."""
_DT = FRAME_S
_PAUSE = 10


class Judgements(NamedTuple):
    """Outcomes of the reference drivers, one row a case, one column a driver in the order of `CAREFUL`, then HOLDS.

    Attributes:
        manoeuvre: What led to the crash, its place in `MANOEUVRES`, int64 (C,).
        begin: Frame at which each takes over, int64 (C, DRIVERS).
        touched: Frame at which a vehicle touches the driver, -1 for none, int64 (C, DRIVERS).
        reacted: Frame at which the driver sees danger first, -1 for never, int64 (C, DRIVERS).
        least_ttc: Least time to collision with a vehicle in front until the horizon [s], inf where it never closes in,
            (C, DRIVERS).
        braking: Its hardest braking until the horizon [m/s2], at least 0, (C, DRIVERS).
    """

    manoeuvre: NDArray[np.int64]
    begin: NDArray[np.int64]
    touched: NDArray[np.int64]
    reacted: NDArray[np.int64]
    least_ttc: NDArray[np.float64]
    braking: NDArray[np.float64]


class JudgeScratch(NamedTuple):
    """Memory for `judge_cases`; one serves one thread."""

    frames: NDArray[np.void]
    bodies: NDArray[np.void]
    rows: World
    tail: int


def allocate_judgements(cases: int) -> Judgements:
    """Allocate the results of so many cases."""
    shape = (cases, DRIVERS)
    none = np.full(shape, -1, dtype=np.int64)
    begin = np.zeros(shape, dtype=np.int64)
    return Judgements(
        np.zeros(cases, dtype=np.int64), begin, none, none.copy(), np.full(shape, np.inf), np.zeros(shape)
    )


def no_tracks(cases: int) -> NDArray[np.float64]:
    """Allocate empty `tracks` for `judge_cases`: they are for drawing, and judging needs none."""
    return np.empty((cases, DRIVERS, 0, 4))


def allocate_judge_scratch(m: Manoeuvres, frames: int, vehicles: int) -> JudgeScratch:
    """Allocate memory for cases of at most so many frames and vehicles."""
    tail = stopping_frames(m.road, m.stopping)
    return JudgeScratch(
        allocate_recording(frames + m.horizon + tail, vehicles),
        np.zeros(vehicles, dtype=BODY_FIELDS),
        allocate_rows(1),
        tail,
    )


@inlined_kernel
def _look(test: Trajectories, f: int, kind: int, w: World, ttc: float) -> tuple[float, float]:
    """Ask the driver about all vehicles ahead of it at a frame.

    Returns:
        The hardest braking that one of them demands [m/s2]; the least of `ttc` and the times to collision [s].
    """
    me, body = w.vehicles[0], test.bodies[0]
    demanded = 0.0
    for j in range(1, test.n):
        other = test.frames[f, j]
        ahead = way_from(me.x, other.x)
        if other.present == 0 or ahead <= 0.0:
            continue
        half = 0.5 * (body.length + test.bodies[j].length)
        across = other.y - me.y
        sine, cosine = sin_cos(other.heading)
        drifts = other.speed * sine / cosine - me.lateral_speed
        threat = Threat(
            ahead - half,
            ahead + half,
            abs(across) - 0.5 * (body.width + test.bodies[j].width),
            -drifts if across > 0.0 else drifts,
            other.speed,
        )
        demanded = max(demanded, braking_demanded(kind, me.speed, me.acceleration, threat))
        closing = me.speed - other.speed
        if threat.aside <= 0.0 and closing > 0.0:
            ttc = min(ttc, max(threat.gap, 0.0) / closing)
    return demanded, ttc


@inlined_kernel
def _approach_begin(test: Trajectories, partner: int, begin: int) -> int:
    """Find the first frame of the AV's approach to a partner in front of it, up to `begin`; without one, give `begin`.

    In an approach the AV is the faster one, but for pauses of less than 1 s.
    """
    frames = test.frames
    beside = 0.5 * (test.bodies[0].width + test.bodies[partner].width)
    first, paused = begin, 0
    for f in range(begin, -1, -1):
        me, other = frames[f, 0], frames[f, partner]
        is_in_front = other.present != 0 and way_from(me.x, other.x) > 0.0 and abs(other.y - me.y) < beside
        if not is_in_front or paused >= _PAUSE:
            break
        if me.speed > other.speed:
            first, paused = f, 0
        else:
            paused += 1
    return first


@kernel
def _takes_over(test: Trajectories, approach: int, begin: int, kind: int, m: Manoeuvres, w: World) -> int:
    """Find the frame at which a driver stops doing what the AV did: it sees danger, or the manoeuvre begins.

    Args:
        test: The recording.
        approach: Frame from which the AV neared the partner.
        begin: Frame at which the manoeuvre began, not before `approach`.
        kind: The driver.
        m: As for `judge_cases`.
        w: Scratch.
    """
    for f in range(approach, begin):
        take_over_av(w, 0, test, f, m.parts, m.road, m.evasive)
        if _look(test, f, kind, w, np.inf)[0] > 0.0:
            return f
    return begin


@kernel
def _drive(
    test: Trajectories, moment: int, end: int, kind: int, reaction: float, m: Manoeuvres, w: World,
    track: NDArray[np.float64],
) -> tuple[int, int, float, float]:  # fmt: skip
    """Let a reference driver drive from a moment to `end` and then stop; returns all of `Judgements` but `begin`.

    `track`, (F, 4), is filled with [x m, y m, speed m/s, heading rad] of its first F frames, up to where it is touched.
    """
    v = w.vehicles
    frames, body = test.frames, test.bodies[0]
    take_over_av(w, 0, test, moment, m.parts, m.road, m.evasive)
    since, reacted, ttc, hardest = -1.0, -1, np.inf, 0.0
    x_end = 0.0
    f = moment
    while True:
        if f - moment < track.shape[0]:
            row = track[f - moment]
            row[0], row[1], row[2], row[3] = v[0].x, v[0].y, v[0].speed, v[0].heading
        if f > moment:
            for j in range(1, test.n):
                counts = frames[f, j].present != 0 and (f <= end or frames[end, j].x > x_end)
                if counts and boxes_overlap(
                    Box(v[0].x, v[0].y, v[0].heading, body.length, body.width), box_in(test, f, j)
                ):
                    return f, reacted, ttc, hardest
        if f >= end:
            if f == end:
                x_end = v[0].x
                actions.hold(v, 0, -m.stopping, m.evasive)
            elif v[0].speed == 0.0:
                return -1, reacted, ttc, hardest
            f += 1
            motion.move_vehicle(v, 0, (f - end) * _DT, m.evasive)
            continue
        demanded, ttc = _look(test, f, kind, w, ttc)
        if kind == HOLDS:
            demanded = 0.0
        if demanded > 0.0 and since < 0.0:
            since, reacted = 0.0, f
        command = 0.0
        if since >= 0.0:
            command = braking_of(kind, since, demanded, v[0].acceleration, _DT, reaction)
            since += _DT
        hardest = max(hardest, -command)
        if kind == AT_ONCE:
            v[0].acceleration = command
        actions.hold(v, 0, command, m.evasive)
        f += 1
        motion.move_vehicle(v, 0, _DT, m.evasive)


@kernel
def judge_cases(
    r: Recordings, first: int, stop: int, m: Manoeuvres, reaction: float, s: JudgeScratch, out: Judgements,
    tracks: NDArray[np.float64],
) -> None:  # fmt: skip
    """Let each driver drive in cases first .. stop - 1; a case with partner 0 is left out.

    Args:
        r: The recordings.
        first, stop: Range of cases.
        m: As for the search of ways out; `accelerations`, `every`, `lane_changes` and `lookback` are not read.
        reaction: Time from seeing danger to braking, of all drivers [s]; below 0: each has its own (`own_reaction`).
        s: Scratch.
        out: Holds stop - first rows, for the cases in order.
        tracks: Tracks of each driver in each case [x m, y m, speed m/s, heading rad] in the first F frames from its
            `out.begin` on, up to where it is touched, (stop - first, DRIVERS, F, 4); F may be 0 (`no_tracks`).
    """
    for c in range(first, stop):
        row = c - first
        if r.partner[c] == 0:
            continue
        last = r.last[c]
        unpack(r, c, s.frames, s.bodies)
        test = Trajectories(s.frames, s.bodies, r.vehicles[c])
        begin, out.manoeuvre[row] = manoeuvre_begin(s.frames, r.partner[c], last, m.road)
        begin = max(0, min(begin, last - 1))
        approach = _approach_begin(test, r.partner[c], begin)
        if out.manoeuvre[row] == APPROACH:
            begin = last - 1
        end = last + m.horizon
        continue_recording(test, last, end + s.tail, r.partner[c], m.only_partner, m.road, s.rows)
        latest = -1
        for kind in range(DRIVERS):
            if kind != HOLDS:
                moment = _takes_over(test, approach, begin, kind, m, s.rows)
                latest = max(latest, moment) if moment < begin else latest
            else:
                moment = latest if out.manoeuvre[row] == APPROACH and latest >= 0 else begin
            out.begin[row, kind] = moment
            delay = reaction if reaction >= 0.0 else own_reaction(kind)
            touched, reacted, ttc, hardest = _drive(test, moment, end, kind, delay, m, s.rows, tracks[row, kind])
            out.touched[row, kind] = touched
            out.reacted[row, kind] = reacted
            out.least_ttc[row, kind] = ttc
            out.braking[row, kind] = hardest
