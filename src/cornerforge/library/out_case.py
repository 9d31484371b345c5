"""Cases as writers take them and readers give them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.rails import ACCELERATION, HEADING, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y, keeps_on
from cornerforge.errors import InputError
from cornerforge.geometry import plan_path
from cornerforge.sim import Script, scripted
from cornerforge.types import MAX_LANES, SUBSTEPS, Odd, Scenario

__all__ = [
    "MOST_VEHICLES", "NAME_PATTERN", "ONE_LANE", "Fact", "MovingCase", "OutCase", "check_name", "fact_of_text",
    "plain_facts", "plain_text", "recorded_script", "safe_name", "script_of", "straight_on", "straight_road",
]  # fmt: skip

Fact: TypeAlias = bool | int | float | str | None
MOST_VEHICLES = 200
"""More vehicles are no case on rails: the road of a test has room for some dozens."""
NAME_PATTERN = "^[A-Za-z0-9][A-Za-z0-9_-]{0,99}$"
"""Allowed names of a case; the schema of case files says the same."""
_LONGEST_NAME = 80
"""Longer names of others are cut: there is room for a number behind them."""
_MOST_FACTS, _LONGEST_FACT, _LONGEST_FACT_NAME, _LARGEST_FACT, _LARGEST_WHOLE = 1_000, 10_000, 200, 1e300, 2**63 - 1
"""Limits of facts in a case file: how many, length of a text, length of a name, size of a number."""
_SURE_DIGITS = 15
"""Digits of whole numbers that every reader of JSON keeps; more are rather a hash."""
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
        facts: What else is known of it, for the file's metadata, in this order: its origin (versions, hashes, AV, model
            and its licence note), how likely and how frequent it is, which drivers would have prevented it. Names end
            in their unit. None: not known.
    """

    name: str
    scenario: Scenario
    facts: Mapping[str, Fact]


@dataclass(frozen=True)
class MovingCase:
    """Motion on a straight road, as readers give it: the place of each vehicle at every tenth of a second.

    Attributes:
        name: What it is called: letters, digits, - and _.
        odd: Road and limits; make it with `straight_road`.
        kind: Class of each vehicle, an index of `types.CLASSES`, int8 (N,); vehicle 0 is the AV.
        length, width: Size of each vehicle [m], (N,).
        poses: Where each is at each frame, float64 (F, N, POSE_NUMBERS) (`drivers.rails`: box centre, x along the road,
            y from its right edge to the left); NaN where it is absent. The AV is there from the first frame on, as
            recorded, or in the first frame only, if its motion is unknown.
        facts: What is known of it besides, and its source.
        notes: What could not be carried over, each with the place in the source ("line 12: ..."); empty: nothing.
        called: What the source calls each vehicle, such as "BV22" or "obstacle 104"; empty: nothing.
    """

    name: str
    odd: Odd
    kind: NDArray[np.int8]
    length: NDArray[np.float64]
    width: NDArray[np.float64]
    poses: NDArray[np.float64]
    facts: Mapping[str, Fact] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    called: tuple[str, ...] = ()

    @property
    def av_is_recorded(self) -> bool:
        """Is it known what the vehicle in the AV's seat did?"""
        return len(self.poses) > 1 and bool(np.isfinite(self.poses[1, 0]).all())


def safe_name(text: str, default: str = "case") -> str:
    """Make a name for a case of any text: letters, digits, - and _, a letter or digit first, at most 80 of them.

    Args:
        text: Name that others gave it.
        default: What it is called if nothing is left of that.

    >>> safe_name("_cut in/left (1)"), safe_name("\u00e9")
    ('cut-in-left-1', 'case')
    """
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text).lstrip("-_")[:_LONGEST_NAME].rstrip("-") or default


def check_name(name: str) -> str:
    """Check that a case can be called so, and return it.

    Raises:
        InputError: It cannot.
    """
    if re.fullmatch(NAME_PATTERN.strip("^$"), name) is None:
        raise InputError(
            f"{plain_text(name, 60)!r} cannot be the name of a case's file; use letters, digits, - and _, a letter or "
            "digit first, at most 100 of them."
        )
    return name


def plain_text(text: str, most: int) -> str:
    """Make text that a file can hold: what is no character becomes ?, and what is too long is cut, with ... at its end.

    >>> plain_text("abcdef", 4), plain_text("a" + chr(0xD800), 4)
    ('abc\u2026', 'a?')
    """
    text = text.encode("utf-8", "replace").decode("utf-8")
    return text if len(text) <= most else f"{text[: most - 1]}\u2026"


def plain_facts(facts: Mapping[str, Fact]) -> dict[str, Fact]:
    """Make facts that a case file can hold: not finite and very large numbers become text, long texts are cut.

    >>> plain_facts({"risk": float("nan"), "mass": 1e305, "n": 3, "ok": True})
    {'risk': 'nan', 'mass': '1e+305', 'n': 3, 'ok': True}
    """
    found: dict[str, Fact] = {}
    for name, fact in list(facts.items())[:_MOST_FACTS]:
        value = fact
        if isinstance(fact, float):
            value = float(fact) if abs(fact) <= _LARGEST_FACT else f"{fact:g}"
        elif isinstance(fact, int) and abs(fact) > _LARGEST_WHOLE:
            value = f"about 2^{fact.bit_length()}"
        if isinstance(value, str):
            value = plain_text(value, _LONGEST_FACT)
        found[plain_text(name, _LONGEST_FACT_NAME)] = value
    return found


def fact_of_text(text: str) -> Fact:
    """Read a fact that a file holds as text: true, false and numbers are what they say, all else stays text.

    What may be a hash stays text: whole numbers of more than 15 digits, and powers of ten without a point unless
    they are written as Python writes them.

    >>> [fact_of_text(text) for text in ("0.5", "12", "true", "1e-07", "12e4", "0123", "NaN", "1234567890123456")]
    [0.5, 12, True, 1e-07, '12e4', '0123', 'NaN', '1234567890123456']
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return text
    if isinstance(value, bool):
        return value
    if isinstance(value, int):
        return value if len(str(abs(value))) <= _SURE_DIGITS else text
    if isinstance(value, float) and math.isfinite(value) and ("." in text or json.dumps(value) == text):
        return value
    return text


ONE_LANE = "the road has one lane; another, to its left, was added, into which an AV may go"
"""Note of a reader on a road of one lane (`straight_road`)."""


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
        InputError: The simulator does not have the road: more than 6 lanes, lanes below 2.5 m or above 6 m, more than
            200 vehicles, speeds above 80 m/s, a size that no vehicle has, or more than 100 km.
    """
    if not 1 <= lanes <= MAX_LANES:
        raise InputError(f"The road has {lanes} lanes; roads of 1 to {MAX_LANES} lanes can be driven.")
    if not 1 <= vehicles <= MOST_VEHICLES:
        raise InputError(
            f"There are {vehicles:,} vehicles; 1 to {MOST_VEHICLES} can be driven. Keep those near the AV."
        )
    if not (math.isfinite(fastest) and fastest <= _MOST_SPEED):
        raise InputError(
            f"A vehicle drives at {fastest:.6g} m/s; up to {_MOST_SPEED:g} m/s can be driven. Are speeds in m/s?"
        )
    lanes = max(2, lanes)
    max_speed = min(_MOST_SPEED, max(40.0, 1.25 * fastest))
    try:
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
    except InputError as error:
        raise InputError(
            f"An AV of {av_size[0]:g} m x {av_size[1]:g} m cannot be driven on this road: {error}"
        ) from None


def script_of(case: MovingCase, *, set_speed: float | None = None, seed: int = 0, test: int = 0) -> Script:
    """Make the script that drives a moving case: the others on rails, the AV from its first frame on.

    The others go on at their last speed, straight on, for 3 s after the end of what was recorded. So does the AV on its
    own rails, which are read only where it is driven as recorded.

    Args:
        case: The case.
        set_speed: Speed that the AV is set to drive [m/s]; None: its speed at the start, but at least 10 m/s.
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
            dict.fromkeys(scripted.START_FIELDS, 0.0)
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
    start = scripted.scripted_start(np.array([[float(row[name]) for name in scripted.START_FIELDS] for row in rows]))
    n = case.poses.shape[1]
    action = np.full(((len(poses) - 1) // SUBSTEPS, n), -1, dtype=np.int8)
    return Script(np.arange(n, dtype=np.int16), start, action, seed, test, poses)


def recorded_script(case: MovingCase, *, set_speed: float | None = None, seed: int = 0, test: int = 0) -> Script:
    """Make `script_of` a case, but the AV's own rails end where its recording does."""
    script = script_of(case, set_speed=set_speed, seed=seed, test=test)
    if script.poses is not None:
        script.poses[len(case.poses) :, 0] = np.nan
    return script


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
    """Let all vehicles present at the end go straight on, to the next whole second and for some more."""
    frames = len(poses)
    wanted = SUBSTEPS * (math.ceil((frames - 1) / SUBSTEPS) + _AFTER_S) + 1
    longer = np.full((wanted, *poses.shape[1:]), np.nan)
    longer[:frames] = poses
    for slot in np.flatnonzero(np.isfinite(poses[-1, :, X])):
        longer[frames:, slot] = straight_on(poses[-1, slot], wanted - frames)
    return longer


def straight_on(pose: NDArray[np.float64], frames: int) -> NDArray[np.float64]:
    """Let a vehicle keep its speed and lane for some frames after a pose (POSE_NUMBERS,); (frames, POSE_NUMBERS)."""
    on = np.empty((frames + 1, POSE_NUMBERS))
    keeps_on(on, pose[X], pose[Y], pose[SPEED], int(pose[LANE]))
    return on[1:]
