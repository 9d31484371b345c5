"""The case that a played storyboard makes: where each vehicle is in each frame, how fast, and on which road."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y
from cornerforge.ext.interchange.differences import rates
from cornerforge.ext.interchange.read_opendrive import Frame
from cornerforge.ext.interchange.xosc_motion import Body
from cornerforge.ext.interchange.xosc_storyboard import Moment
from cornerforge.library.out_case import Fact, MovingCase, straight_road
from cornerforge.types import FRAME_S

__all__ = ["make_case"]

_ASIDE = 0.1
"""A vehicle that moves aside slower than this keeps its lane [m/s]."""
_TOLD = 1.0
"""A stated start speed that differs from the first step of a trajectory by less is believed [m/s]."""
_BACKWARDS = -0.1
_NOTE = re.compile(r"(.+?), line (\d+): (.*)", re.DOTALL)
_MOST_LINES = 40


def make_case(
    name: str, frame: Frame, bodies: Mapping[str, Body], av: Body, frames: Sequence[Sequence[Moment | None]],
    notes: dict[str, None], facts: Mapping[str, Fact],
) -> MovingCase:  # fmt: skip
    """Make the case of a play, in which the AV starts at x = 0; the fact `start_x_m` says where that is on the road.

    Args:
        name: Name of the case.
        frame: Its road.
        bodies: All vehicles.
        av: The one in the AV's seat.
        frames: Where all are, in the order of `bodies`.
        notes: What is not carried over; more is added.
        facts: What else is known.

    Raises:
        InputError: The road, the number of vehicles or their speeds are outside the simulator's limits.
        DataError: The AV is not there at the start, or drives against its lane.
    """
    order = [av, *(body for body in bodies.values() if body is not av)]
    column = {name: k for k, name in enumerate(bodies)}
    first = frames[0][column[av.name]]
    start = first.x if first is not None else 0.0
    kept: list[Body] = []
    poses: list[NDArray[np.float64]] = []
    for body in order:
        moments = [frame_of_all[column[body.name]] for frame_of_all in frames]
        motion = _poses(moments, frame)
        against = np.cos(motion[:, HEADING]) < 0.0
        if body is av and against[0]:
            av.element.fault(f"{av.name} drives against the direction of its lane")
        motion[against] = np.nan
        there = np.flatnonzero(np.isfinite(motion[:, X]))
        if against.any():
            part = "it is left out" if there.size == 0 else f"it is left out for {FRAME_S * against.sum():.1f} s"
            notes.setdefault(f"{body.element.place}: {body.name} drives against the AV's direction; {part}")
        elif there.size == 0:
            notes.setdefault(f"{body.element.place}: {body.name} is nowhere on the road; it is left out")
        if there.size:
            _note_motion(body, motion, frame, start, notes)
            _note_leaps(body, moments, motion, notes)
            kept.append(body)
            poses.append(motion)
    if not kept or kept[0] is not av or not np.isfinite(poses[0][0, X]):
        av.element.fault(f"{av.name} is not there at the start")
    whole = np.stack(poses, axis=1)
    whole[:, :, X] -= start
    if av.unknown:
        whole[1:, 0] = np.nan
    odd = straight_road(
        lanes=len(frame.lanes), lane_width=frame.lane_width, vehicles=len(kept), seconds=FRAME_S * len(frames),
        fastest=float(np.nanmax(whole[:, :, SPEED])), av_size=(av.length, av.width), start=float(whole[0, 0, X]),
    )  # fmt: skip
    return MovingCase(
        name, odd, np.array([body.kind for body in kept], np.int8),
        np.array([body.length for body in kept]), np.array([body.width for body in kept]), whole,
        {**facts, "start_x_m": start, "vehicles": ", ".join(body.name for body in kept)[:2000]}, _merged(notes),
        tuple(body.name for body in kept),
    )  # fmt: skip


def _note_motion(body: Body, motion: NDArray[np.float64], frame: Frame, start: float, notes: dict[str, None]) -> None:
    beyond = (motion[:, X] < frame.begin - 1.0) | (motion[:, X] > frame.end + 1.0)
    if beyond.any():
        when = FRAME_S * int(np.argmax(beyond))
        notes.setdefault(
            f"{body.element.place}: {body.name} is beyond the straight stretch of the road "
            f"(x = {frame.begin - start:.0f} to {frame.end - start:.0f} m) at {when:.1f} s; the road goes on straight "
            "here"
        )
    if np.nanmin(motion[:, SPEED]) < _BACKWARDS:
        notes.setdefault(f"{body.element.place}: {body.name} drives backwards for a while; its speed counts as 0 then")
    motion[:, SPEED] = np.maximum(motion[:, SPEED], 0.0)


def _note_leaps(
    body: Body, moments: Sequence[Moment | None], motion: NDArray[np.float64], notes: dict[str, None]
) -> None:
    there = np.isfinite(motion[:, X])
    for k, (a, b) in enumerate(pairwise(moments)):
        if a is not None and b is not None and a.leaps != b.leaps and there[k] and there[k + 1]:
            way = math.hypot(b.x - a.x - FRAME_S * a.speed, b.y - a.y)
            notes.setdefault(f"{body.element.place}: {body.name} leaps by {way:.1f} m at {FRAME_S * (k + 1):.1f} s")


def _poses(moments: Sequence[Moment | None], frame: Frame) -> NDArray[np.float64]:
    """Poses of one vehicle, (F, POSE_NUMBERS), NaN where it is absent."""
    poses = np.full((len(moments), POSE_NUMBERS), np.nan)
    part = np.array([-1 if moment is None else moment.leaps for moment in moments])
    for k, moment in enumerate(moments):
        if moment is not None:
            poses[k, [X, Y, HEADING, SPEED]] = moment.x, moment.y, moment.heading, moment.speed
    edges = [0, *(np.flatnonzero(np.diff(part)) + 1).tolist(), len(part)]
    for begin, end in pairwise(edges):
        if part[begin] >= 0:
            _fill(poses[begin:end], moments[begin:end], frame)
    return poses


def _fill(poses: NDArray[np.float64], moments: Sequence[Moment | None], frame: Frame) -> None:
    """Fill speeds, acceleration and lane of a vehicle that is there throughout."""
    stated = np.array([moment is not None and moment.stated for moment in moments])
    if len(poses) > 1:
        slope = rates(poses[:, X], bent_ends=True)
        told = poses[0, SPEED]
        poses[stated, SPEED] = slope[stated]
        if stated[0] and abs(told - slope[0]) < _TOLD:
            poses[0, SPEED] = told
        poses[:, LATERAL_SPEED] = rates(poses[:, Y], bent_ends=True)
        poses[:-1, ACCELERATION] = np.diff(poses[:, SPEED]) / FRAME_S
        poses[-1, ACCELERATION] = poses[-2, ACCELERATION]
    else:
        poses[0, [LATERAL_SPEED, ACCELERATION]] = 0.0
    lane = float(frame.lane_of(poses[-1, Y]))
    for k in range(len(poses) - 1, -1, -1):
        moment = moments[k]
        if moment is not None and moment.lane is not None:
            lane = float(moment.lane)
        elif abs(poses[k, LATERAL_SPEED]) < _ASIDE:
            lane = float(frame.lane_of(poses[k, Y]))
        poses[k, LANE] = lane


def _merged(notes: Mapping[str, None]) -> tuple[str, ...]:
    """Notes that say the same of several lines, as one."""
    lines: dict[tuple[str, str], list[int]] = {}
    for note in notes:
        found = _NOTE.fullmatch(note)
        file, line, text = found.groups() if found else ("", "0", note)
        lines.setdefault((file, text), []).append(int(line))
    return tuple(_listed(file, sorted(places), text) for (file, text), places in lines.items())


def _listed(file: str, places: Sequence[int], text: str) -> str:
    if not file:
        return text
    if len(places) == 1:
        return f"{file}, line {places[0]}: {text}"
    shown = ", ".join(map(str, places[:_MOST_LINES]))
    more = f" and {len(places) - _MOST_LINES} more" if len(places) > _MOST_LINES else ""
    return f"{file}, lines {shown}{more}: {text}"
