"""What writers take and what readers give."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import InputError
from cornerforge.geometry import plan_path
from cornerforge.sim import START_FIELDS, SUBSTEPS, Script, scripted_start
from cornerforge.types import FRAME_S, MAX_LANES, Odd, Scenario

__all__ = ["Fact", "MovingCase", "OutCase", "script_of", "straight_road"]

Fact: TypeAlias = bool | int | float | str | None
_MOST_VEHICLES = 200
"""More vehicles are no case: the road of a test has room for some dozens."""
_LEAST_SPEED, _MOST_SPEED = 10.0, 80.0
_IN_THE_MIDDLE = 0.01
_AFTER_S = 3
"""How long the others go on after the end of what was recorded, at their last speed [s]."""


@dataclass(frozen=True)
class OutCase:
    """A case as writers take it.

    Attributes:
        name: Stem of its files: letters, digits, - and _.
        scenario: Its motion, the AV in column 0, up to the contact or to its end.
        facts: What else is known of it, for the file's metadata, in this order: who made it with what (versions,
            hashes, AV, model and its licence note), how likely and how frequent it is, who would have prevented it.
            Names end in their unit. None: not known.
    """

    name: str
    scenario: Scenario
    facts: Mapping[str, Fact]


@dataclass(frozen=True)
class MovingCase:
    """Motion on a straight road, as readers give it: who was where at every tenth of a second.

    Attributes:
        name: What it is called: letters, digits, - and _.
        odd: Road and limits; make it with `straight_road`.
        kind: Class of each vehicle, an index of `types.CLASSES`, int8 (N,); vehicle 0 is the AV.
        length, width: Size of each vehicle [m], (N,).
        poses: Where each is at each frame, float64 (F, N, POSE_NUMBERS) (`drivers.rails`: box centre, x along the road,
            y from its right edge to the left); NaN where it is absent. The AV is there from the first frame on, as
            recorded, or in the first frame only, if nobody knows what it did.
        facts: What is known of it besides, and its source.
        notes: What could not be carried over, each with the place in the source ("line 12: ..."); empty: nothing.
    """

    name: str
    odd: Odd
    kind: NDArray[np.int8]
    length: NDArray[np.float64]
    width: NDArray[np.float64]
    poses: NDArray[np.float64]
    facts: Mapping[str, Fact] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def av_is_recorded(self) -> bool:
        """Is it known what the vehicle in the AV's seat did?"""
        return len(self.poses) > 1 and bool(np.isfinite(self.poses[1, 0]).all())


def straight_road(
    *, lanes: int, lane_width: float, vehicles: int, seconds: float, fastest: float,
    av_size: tuple[float, float], start: float = 0.0, name: str = "imported",
) -> Odd:  # fmt: skip
    """Make the road of a moving case.

    Args:
        lanes: Number of lanes in the direction of travel; a road of one lane gets a second one to its left.
        lane_width: [m].
        vehicles: How many vehicles there are, the AV among them.
        seconds: How long it takes at most.
        fastest: Speed of the fastest vehicle [m/s].
        av_size: Length and width of the AV [m].
        start: Where the AV begins along the road [m]; from there the road is longer than any AV can drive.
        name: Name of the ODD.

    Raises:
        InputError: The simulator has no such road: more than 6 lanes, lanes below 2.5 m or above 6 m, more than 200
            vehicles, speeds above 80 m/s, a size that no vehicle has, or more than 100 km.
    """
    if not 1 <= lanes <= MAX_LANES:
        raise InputError(f"The road has {lanes} lanes; roads of 1 to {MAX_LANES} lanes can be driven.")
    if not 1 <= vehicles <= _MOST_VEHICLES:
        raise InputError(
            f"There are {vehicles:,} vehicles; 1 to {_MOST_VEHICLES} can be driven. Keep those near the AV."
        )
    if not (math.isfinite(fastest) and fastest <= _MOST_SPEED):
        raise InputError(
            f"A vehicle drives at {fastest:.6g} m/s; up to {_MOST_SPEED:g} m/s can be driven. Are speeds in m/s?"
        )
    lanes = max(2, lanes)
    max_speed = min(_MOST_SPEED, max(40.0, 1.25 * fastest))
    return Odd(
        name=name,
        n_lanes=lanes,
        lane_width=lane_width,
        vehicle_length=av_size[0],
        vehicle_width=av_size[1],
        max_speed=max_speed,
        test_length=max(400.0, math.ceil(start + max_speed * (seconds + _AFTER_S + 1.0))),
        time_limit=float(math.ceil(seconds) + _AFTER_S),
        av_start=0.0,
        traffic_length=max(50.0, 40.0 * math.ceil(vehicles / lanes)),
    )


def script_of(case: MovingCase, *, set_speed: float | None = None, seed: int = 0, test: int = 0) -> Script:
    """Make the script that drives a moving case: the others on rails, the AV from its first frame on.

    The others go on at their last speed, straight on, for 3 s after the end of what was recorded. So does the AV on its
    own rails, which are read only where it is driven as recorded.

    Args:
        case: The case.
        set_speed: At which speed the AV is set to drive [m/s]; None: at the one it starts with, but at least 10 m/s.
        seed, test: Name of the case in a library, and what an AV from outside is told.

    Raises:
        InputError: The AV does not begin in the first frame, a vehicle is nowhere, or in a lane that the road lacks.
    """
    first = case.poses[0, 0]
    if not np.isfinite(first).all():
        raise InputError(f"Case {case.name}: the AV is not there in the first frame.")
    lanes = case.poses[..., LANE]
    beside = np.argwhere(np.isfinite(lanes) & ((lanes < 0) | (lanes >= case.odd.n_lanes) | (lanes != np.floor(lanes))))
    if beside.size:
        frame, slot = beside[0].tolist()
        raise InputError(
            f"Case {case.name}: vehicle {slot} is in lane {lanes[frame, slot]:g} in frame {frame}; the road has "
            f"lanes 0 to {case.odd.n_lanes - 1}."
        )
    poses = _prolonged(case.poses)
    rows = []
    for slot in range(case.poses.shape[1]):
        there = np.flatnonzero(np.isfinite(case.poses[:, slot, X]))
        if there.size == 0:
            raise InputError(f"Case {case.name}: vehicle {slot} is nowhere.")
        pose = case.poses[there[0], slot]
        lane = int(pose[LANE])
        desired = pose[SPEED] if slot or set_speed is None else set_speed
        rows.append(
            dict.fromkeys(START_FIELDS, 0.0)
            | {
                "x": pose[X], "y": pose[Y], "speed": pose[SPEED], "lateral_speed": pose[LATERAL_SPEED],
                "heading": pose[HEADING], "acceleration": pose[ACCELERATION], "target_lane": lane,
                "lanes": 1 << lane, "length": case.length[slot],
                "width": case.width[slot], "kind": case.kind[slot], "quantile": 0.5, "habit": 0.5,
                "desired_speed": max(desired, _LEAST_SPEED) if slot == 0 and set_speed is None else desired,
                "change_time": case.odd.lane_change_duration, "signals": slot == 0, "inattention": 1.0,
                **(_to_its_lane(pose, case.odd) if slot == 0 else {}),
            }
        )  # fmt: skip
    start = scripted_start(np.array([[float(row[name]) for name in START_FIELDS] for row in rows]))
    n = case.poses.shape[1]
    action = np.full(((len(poses) - 1) // SUBSTEPS, n), -1, dtype=np.int8)
    return Script(np.arange(n, dtype=np.int16), start, action, seed, test, poses)


def _to_its_lane(pose: NDArray[np.float64], odd: Odd) -> dict[str, float]:
    """Plan how an AV that starts beside the middle of its lane goes there: it cannot know what was begun before."""
    middle = (pose[LANE] + 0.5) * odd.lane_width
    off = abs(middle - pose[Y])
    if off < _IN_THE_MIDDLE and pose[LATERAL_SPEED] == 0.0:
        return {}
    wanted = max(1.0, odd.lane_change_duration * off / odd.lane_width)
    path, duration = plan_path(pose[Y], pose[LATERAL_SPEED], 0.0, middle, wanted, odd.max_lateral_acceleration)
    return {"duration": duration, **dict(zip(("c0", "c1", "c2", "c3", "c4", "c5"), path, strict=True))}


def _prolonged(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Let all who are there at the end go straight on, to the next whole second and for some more."""
    frames = len(poses)
    wanted = SUBSTEPS * (math.ceil((frames - 1) / SUBSTEPS) + _AFTER_S) + 1
    longer = np.full((wanted, *poses.shape[1:]), np.nan)
    longer[:frames] = poses
    last = poses[-1]
    after = FRAME_S * np.arange(1, wanted - frames + 1)
    for slot in np.flatnonzero(np.isfinite(last[:, X])):
        on = np.zeros((after.size, POSE_NUMBERS))
        on[:, X] = last[slot, X] + last[slot, SPEED] * after
        on[:, Y] = last[slot, Y]
        on[:, SPEED] = last[slot, SPEED]
        on[:, LANE] = last[slot, LANE]
        longer[frames:, slot] = on
    return longer
