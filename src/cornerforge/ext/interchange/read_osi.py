"""Reads ASAM OSI ground-truth traces as cases on a straight road.

Places are turned and shifted as a whole, never moved. A frame of a case between two of the trace takes the straight
line between them. Objects that a straight road of one direction cannot hold are left out by name; if one of them comes
near the AV, the trace is refused, because without it the case would be another one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import DataError, InputError, UnknownNameError
from cornerforge.ext.interchange.differences import jumps, rates
from cornerforge.ext.interchange.left_out import gaps, in_lanes, nearest, within
from cornerforge.ext.interchange.osi_lanes import frame_of_traffic
from cornerforge.ext.interchange.osi_messages import VEHICLE
from cornerforge.ext.interchange.osi_trace import (
    ACCELERATION_X,
    ACCELERATION_Y,
    HEIGHT,
    POSITION_X,
    POSITION_Y,
    POSITION_Z,
    SPEED_X,
    SPEED_Y,
    YAW,
    Body,
    Trace,
    read_trace,
)
from cornerforge.ext.interchange.read_opendrive import read_opendrive
from cornerforge.ext.interchange.straight_frame import Frame, frame_of
from cornerforge.library.out_case import MOST_VEHICLES, ONE_LANE, Fact, MovingCase, plain_text, safe_name, straight_road
from cornerforge.types import CAR, FRAME_S, MOTORCYCLE, TRUCK

__all__ = ["read_osi"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_AV_NAMES = frozenset({"ego", "hero", "host", "egovehicle", "ego_vehicle", "hostvehicle", "av", "sut"})
_KINDS = {
    **dict.fromkeys((0, 1, 2, 3, 4, 5, 6, 22), CAR), **dict.fromkeys((7, 8, 9, 12, 16, 19), TRUCK), 10: MOTORCYCLE,
}  # fmt: skip
"""Type of an OSI vehicle -> class. Bicycles, scooters, wheelchairs, trams, trains, ships and aircraft are none."""
_NAMED_KINDS = {11: "a bicycle", 13: "a tram", 14: "a train", 15: "a wheelchair", 17: "a scooter"}
_OTHERS = {-1: "a stationary object", 3: "a pedestrian", 4: "an animal"}
_SIZES = ((0.5, 30.0), (0.3, 4.0))
"""Lengths and widths that can be driven [m]."""
_SAME_TIME = 1e-6
"""A frame this near to one of the trace is that one, in parts of the step between two."""
_LONGEST_GAP = 0.5
"""More time between two frames of a trace is a hole [s]."""
_LONGEST_S = 600.0
_SUDDEN = 20.0
"""An object that comes or goes is near the AV within 20 m [m]."""
_CROSSING = 0.5
"""Cosine of the angle between a vehicle and the road from which on it crosses the road."""
_BACKWARDS = -0.1
_ASIDE = 0.1
"""A vehicle that moves aside slower than this keeps its lane [m/s]."""


def read_osi(path: Path, *, ego: str | None = None, road: Path | None = None) -> MovingCase:
    """Read a trace.

    Args:
        path: An .osi file or an MCAP file.
        ego: The vehicle in the AV's seat: its id, or its name in the scenario. None: the trace's host vehicle, the one
            that is called Ego, hero or the like, or the only one.
        road: Its OpenDRIVE road. None: the file that the trace names, if that lies beside it; else lanes are where the
            traffic drives.

    Returns:
        The case, from the AV's first frame to its last; it starts at x = 0. Its `notes` name what is left out.

    Raises:
        InputError: A file is missing, nothing says which vehicle is the AV, or the simulator does not have the road.
        UnknownNameError: There is no vehicle `ego`.
        FileFormatError: A file is damaged.
        DataError: Something in it cannot be, or cannot be held by a straight road and is near the AV.
        MissingExtraError: protobuf or mcap is not installed.
    """
    trace = read_trace(path)
    av = _av_of(path, trace, ego)
    times, states = _resampled(path, trace, av)
    where = road or _beside(path, trace.map_reference)
    if where is not None:
        first = states[0, av]
        ahead = float(np.hypot(*(states[:, av, :2] - first[:2]).T).max())
        along = np.cos(states[..., YAW] - first[YAW]) > _CROSSING
        x, y, yaw = (float(first[number]) for number in (POSITION_X, POSITION_Y, YAW))
        frame = frame_of(read_opendrive(where), x, y, yaw, ahead, states[along][:, :2])
    else:
        frame = frame_of_traffic(path.name, states, av)
    poses = _poses(frame, states)
    scene = _Scene(path, trace, av, times, states, poses, frame)
    kept = [k for k in range(len(trace.bodies)) if k == av or scene.keep(k)]
    scene.note_stationary()
    scene.notes += [ONE_LANE] * (frame.lanes == 1)
    kept.sort(key=lambda k: k != av)
    bodies = [trace.bodies[k] for k in kept]
    if len(kept) > MOST_VEHICLES:
        raise InputError(f"{path.name}: {len(kept):,} vehicles are on its road; up to {MOST_VEHICLES} can be driven.")
    whole = poses[:, kept]
    try:
        odd = straight_road(
            lanes=frame.lanes, lane_width=frame.lane_width, vehicles=len(kept), seconds=FRAME_S * len(times),
            fastest=float(np.nanmax(whole[:, :, SPEED])), av_size=bodies[0].size[:2],
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None
    return MovingCase(
        safe_name(path.stem), odd, np.array([_KINDS[body.vehicle] for body in bodies], np.int8),
        np.array([body.size[0] for body in bodies]), np.array([body.size[1] for body in bodies]), whole,
        _facts(path, trace, where, frame, times, bodies), (*frame.notes, *scene.notes),
        tuple(_called(body) for body in bodies),
    )  # fmt: skip


def _called(body: Body) -> str:
    return body.name if body.kind < 0 or body.name != str(body.ident) else f"object {body.ident}"


def _facts(
    path: Path, trace: Trace, where: Path | None, frame: Frame, times: Floats, bodies: list[Body]
) -> dict[str, Fact]:
    return {
        "source": path.name,
        "format": f"ASAM OSI {trace.version}".strip(),
        "road": None if where is None else where.name,
        "map_reference": plain_text(trace.map_reference, 200) or None,
        "frames": len(trace.times),
        "start_time_s": float(times[0]),
        "world_x_m": frame.x, "world_y_m": frame.y, "world_heading_rad": frame.direction,
        "vehicles": ", ".join(_called(body) for body in bodies)[:2000],
    }  # fmt: skip


def _beside(path: Path, reference: str) -> Path | None:
    """Find the road that a trace names, beside it; None: it lies elsewhere, or is none."""
    name = reference.replace("\\", "/").rpartition("/")[2]
    found = path.with_name(name) if name.lower().endswith(".xodr") and name.isprintable() else None
    return found if found is not None and found.is_file() else None


def _av_of(path: Path, trace: Trace, ego: str | None) -> int:
    vehicles = {k: body for k, body in enumerate(trace.bodies) if body.kind == VEHICLE}
    if ego is not None:
        found = [k for k, body in vehicles.items() if ego in (body.name, str(body.ident))]
        if not found:
            raise UnknownNameError(f"vehicle of {path.name}", ego[:80], [body.name for body in vehicles.values()])
    elif trace.host is not None:
        found = [k for k, body in vehicles.items() if body.ident == trace.host]
        if not found:
            raise DataError(
                f"{path.name}: the host vehicle, {trace.host}, is no vehicle of it; name another as ego (--ego)."
            )
    else:
        found = [k for k, body in vehicles.items() if body.name.lower() in _AV_NAMES] or list(vehicles)
    if len(found) != 1:
        named = ", ".join(
            str(body.ident) if body.name == str(body.ident) else f"{body.ident} ({body.name})"
            for body in list(vehicles.values())[:8]
        )
        raise InputError(
            f"{path.name} does not say which vehicle is the AV; name one as ego (--ego): {named or 'it has none'}."
        )
    return found[0]


def _resampled(path: Path, trace: Trace, av: int) -> tuple[Floats, Floats]:
    """Take the states at each tenth of a second from the AV's first frame on: times (F,), states (F, V, 8).

    Between two frames of the trace the straight line between them counts, for an object that both hold.
    """
    there = np.flatnonzero(np.isfinite(trace.states[:, av, POSITION_X]))
    first, last = int(there[0]), int(there[-1])
    if there.size != last - first + 1:
        gone = first + int(np.argmax(np.diff(there) > 1)) + 1
        raise DataError(f"{path.name}, frame {gone}: the AV, {_called(trace.bodies[av])}, is not there; cut the trace.")
    given, states = trace.times[first : last + 1], trace.states[first : last + 1]
    holes = np.flatnonzero(np.diff(given) > _LONGEST_GAP)
    if holes.size:
        at = int(holes[0])
        raise DataError(
            f"{path.name}, frame {first + at + 1}: {given[at + 1] - given[at]:.3g} s are missing before it; at most "
            f"{_LONGEST_GAP:g} s are bridged. Cut the trace."
        )
    seconds = float(given[-1] - given[0])
    if seconds > _LONGEST_S:
        raise DataError(f"{path.name}: the AV drives for {seconds:.0f} s; up to {_LONGEST_S:.0f} s are read. Cut it.")
    times = given[0] + FRAME_S * np.arange(int((seconds + _SAME_TIME) / FRAME_S) + 1)
    if given.size == 1:
        return times, _with_rates(states)
    before = np.clip(np.searchsorted(given, times, side="right") - 1, 0, given.size - 2)
    part = (times - given[before]) / np.diff(given)[before]
    part[np.abs(part) < _SAME_TIME] = 0.0
    part[np.abs(part - 1.0) < _SAME_TIME] = 1.0
    a, b, part = states[before], states[before + 1], part[:, None, None]
    step = b - a
    step[..., YAW] = np.mod(step[..., YAW] + math.pi, 2.0 * math.pi) - math.pi
    return times, _with_rates(np.where(part == 0.0, a, np.where(part == 1.0, b, a + part * step)))


def _with_rates(states: Floats) -> Floats:
    """Put differences where an object has no velocity, or no acceleration, in one of its frames."""
    there = np.isfinite(states[..., POSITION_X])
    for k in range(states.shape[1]):
        sources = (POSITION_X, POSITION_Y, SPEED_X, SPEED_Y)
        for given, of in zip(range(SPEED_X, ACCELERATION_Y + 1), sources, strict=True):
            if not np.isfinite(states[there[:, k], k, given]).all():
                states[:, k, given] = rates(states[:, k, of], bent_ends=True)
    return states


def _poses(frame: Frame, states: Floats) -> Floats:
    """Poses (F, V, POSE_NUMBERS) in a frame, of states (F, V, 8); NaN where absent."""
    poses = np.full((*states.shape[:2], POSE_NUMBERS), np.nan)
    poses[..., X], poses[..., Y] = frame.of_world(states[..., POSITION_X], states[..., POSITION_Y])
    poses[..., HEADING] = np.mod(states[..., YAW] - frame.direction + math.pi, 2.0 * math.pi) - math.pi
    poses[..., SPEED], poses[..., LATERAL_SPEED] = frame.turned(states[..., SPEED_X], states[..., SPEED_Y])
    poses[..., ACCELERATION], _ = frame.turned(states[..., ACCELERATION_X], states[..., ACCELERATION_Y])
    for k in range(states.shape[1]):
        poses[:, k, LANE] = _lanes(frame, poses[:, k])
    return poses


def _lanes(frame: Frame, pose: Floats) -> Floats:
    """Lane that a vehicle keeps, or to which it moves, at each of its frames (F,)."""
    own = np.clip(np.floor(pose[:, Y] / frame.lane_width), 0.0, frame.lanes - 1.0)
    steady = np.abs(pose[:, LATERAL_SPEED]) < _ASIDE
    there = np.flatnonzero(np.isfinite(own))
    goal = np.full(own.size, np.nan)
    for stretch in np.split(there, np.flatnonzero(np.diff(there) > 1) + 1):
        lane = np.nan
        for k in stretch[::-1]:
            lane = own[k] if steady[k] or np.isnan(lane) else lane
            goal[k] = lane
    return goal


@dataclass
class _Scene:
    """All that is around the AV, and what becomes of it."""

    path: Path
    trace: Trace
    av: int
    times: Floats
    states: Floats
    poses: Floats
    frame: Frame

    def __post_init__(self) -> None:
        self.notes: list[str] = []
        body = self.trace.bodies[self.av]
        for what, mask in self._unfit(self.av, body):
            if mask.any():
                self._refuse(int(np.argmax(mask)), f"the AV, {_called(body)}, {what}")
        self.poses[:, self.av, SPEED] = np.maximum(self.poses[:, self.av, SPEED], 0.0)

    def keep(self, k: int) -> bool:
        """Whether an object is part of the case; where it cannot be held, its poses become NaN, and a note says so.

        Raises:
            DataError: It cannot be held and is near the AV, or comes or goes near the AV.
        """
        body, pose = self.trace.bodies[k], self.poses[:, k]
        there = np.isfinite(pose[:, X])
        if not there.any():
            self.notes.append(f"{_called(body)} is left out: it is not there when the AV is")
            return False
        gap = self._gaps(pose, body)
        fit, why = there.copy(), np.full(there.size, "", dtype=object)
        for what, mask in self._unfit(k, body):
            new = mask & fit
            fit &= ~mask
            why[new] = what
        off = there & ~fit
        if off.any():
            self._leave_out(body, pose, np.where(off, gap, np.inf), why, fit)
        for edge, word in ((fit[1:] & ~fit[:-1], "appears"), (fit[:-1] & ~fit[1:], "vanishes")):
            for at in np.flatnonzero(edge) + (word == "appears"):
                said = f"{_called(body)} {word} {gap[at]:.1f} m from the AV, after {FRAME_S * at:.1f} s"
                if gap[at] < _SUDDEN:
                    self._refuse(int(at), said)
                self.notes.append(said)
        pose[~fit] = np.nan
        pose[:, SPEED] = np.maximum(pose[:, SPEED], 0.0)
        return bool(fit.any())

    def note_stationary(self) -> None:
        """Count the objects that do not move.

        Raises:
            DataError: One stands in the lanes, near the AV.
        """
        count, least = 0, math.inf
        for body, (x, y, z, yaw) in self.trace.stationary:
            pose = np.zeros((len(self.poses), POSE_NUMBERS))
            pose[:, X], pose[:, Y] = self.frame.of_world(x, y)
            pose[:, HEADING] = yaw - self.frame.direction
            gap = self._gaps(pose, body)
            count, least = count + 1, min(least, float(gap.min()))
            apart = abs(z - self.states[:, self.av, POSITION_Z])
            level = apart < 0.5 * (body.size[HEIGHT] + self.trace.bodies[self.av].size[HEIGHT])
            at, near = nearest(np.where(level, gap, np.inf), self._in_lanes(pose, body), stands=True)
            if near:
                self._refuse(at, f"{_called(body)} stands in the lanes, {gap[at]:.1f} m from the AV")
        if count:
            said = "1 stationary object is" if count == 1 else f"{count:,} stationary objects are"
            self.notes.append(f"{said} left out; the closest comes within {least:.1f} m of the AV")

    def _refuse(self, at: int, what: str) -> None:
        frame = int(np.searchsorted(self.trace.times, self.times[at] + _SAME_TIME, side="right")) - 1
        raise DataError(
            f"{self.path.name}, frame {frame}: {what}; a case on a straight road of one direction cannot hold that. "
            "Cut the trace, or take another AV."
        )

    def _leave_out(self, body: Body, pose: Floats, gap: Floats, why: NDArray[np.object_], fit: Bools) -> None:
        """Name an object that is left out where `gap` is finite, or refuse it."""
        at, near = nearest(gap, self._in_lanes(pose, body))
        if near:
            self._refuse(at, f"{_called(body)} {why[at]}, {gap[at]:.1f} m from the AV")
        part = f" for {FRAME_S * np.isfinite(gap).sum():.1f} s" if fit.any() else ""
        self.notes.append(f"{_called(body)} is left out{part}: it {why[at]}; {within(gap, at)}")

    def _gaps(self, pose: Floats, body: Body) -> Floats:
        return gaps(self.poses[:, self.av], self.trace.bodies[self.av].size, pose, body.size)

    def _in_lanes(self, pose: Floats, body: Body) -> Bools:
        return in_lanes(pose, body.size, self.frame.lanes * self.frame.lane_width)

    def _unfit(self, k: int, body: Body) -> Iterator[tuple[str, Bools]]:
        """Say what a straight road cannot hold of an object, and in which frames."""
        pose = self.poses[:, k]
        there = np.isfinite(pose[:, X])
        if body.kind != VEHICLE:
            yield f"is {_OTHERS.get(body.kind, 'no vehicle')}", there
        elif body.vehicle not in _KINDS:
            yield f"is {_NAMED_KINDS.get(body.vehicle, 'no road vehicle')}", there
        for what, value, (low, high) in zip(("long", "wide"), body.size, _SIZES, strict=False):
            if not low <= value <= high:
                yield f"is {value:g} m {what}, which no vehicle is", there
        turn = np.cos(pose[:, HEADING])
        yield "drives against the AV's direction", turn < -_CROSSING
        yield "stands or drives across the road", np.abs(turn) <= _CROSSING
        yield "drives backwards", pose[:, SPEED] < _BACKWARDS
        yield "moves otherwise than its velocity says", jumps(pose, 1.0)
        yield "is beside the lanes", there & ~self._in_lanes(pose, body)
