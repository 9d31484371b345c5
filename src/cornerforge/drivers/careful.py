"""Reference drivers: four models of what a competent and careful human driver prevents; they brake and do not steer.

Each says when danger is seen (`braking_demanded`) and how the driver then brakes (`braking_of`). UN Regulation 157
measures automated lane keeping by them. They differ: `cc-human` reacts late, `fsm` early (Olleja, Markkula and Baergman
2024), so results name the driver, and none of them is called human.

Sources: UN Regulation 157, Annex 4, Appendix 3, and paragraph 5.2.5.2; Mattas et al., Accident Analysis and Prevention
148 (2020) 105794 and 174 (2022), for `fsm` and for the forms in which all four were compared; Shalev-Shwartz, Shammah
and Shashua (2017) for the distances of `rss-brake`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge._checks import check_in
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.drivers.rails import (
    LATERAL_SPEED,
    POSE_NUMBERS,
    SPEED,
    X,
    Y,
    frames_before,
    keeps_on,
    move_aside,
    way_before,
)
from cornerforge.drivers.rss import rss_distance
from cornerforge.errors import InputError
from cornerforge.road.straight import way_from
from cornerforge.types import FRAME_S

__all__ = [
    "CAREFUL",
    "CC_BRAKING",
    "CC_DELAY",
    "HOLDS",
    "SCENARIOS",
    "CarefulParams",
    "Threat",
    "braking_demanded",
    "braking_of",
    "crashes_at_cut_ins",
    "cut_in_poses",
    "drives_into",
    "own_reaction",
]

CAREFUL = {"cc-human": 0, "reg157": 1, "rss-brake": 2, "fsm": 3}
"""Name and code of each reference driver."""
CC_BRAKING, CC_DELAY = 0.774 * 9.81, 0.75
"""Braking of `cc-human` [m/s2], and its time from seeing danger to braking [s]."""
_CC_HUMAN, _REG157, _RSS, _FSM = range(4)

_HARDEST = CC_BRAKING
"""Braking of `cc-human`, and the most of `rss-brake` and `fsm` [m/s2]."""
_JERK = 12.65
"""Jerk at which they reach it [m/s3]."""
_DELAY = CC_DELAY
"""Time from seeing danger to braking; of `fsm` and `rss-brake` too [s]."""
_OFF_PEDAL = 0.4
"""Deceleration of `cc-human` while its foot leaves the accelerator [m/s2]."""
_TTC = 2.0
"""Time to collision at which `cc-human` sees danger [s]."""
_REG_BRAKING, _REG_DELAY, _REG_SIDE, _REG_STEP = 6.0, 0.35, 0.5, 0.1
"""Braking [m/s2], reaction [s], side gap at which a cut-in is seen [m], and one step [s], of `reg157`."""
_RSS_ACCELERATION, _RSS_BRAKING, _RSS_LATERAL, _RSS_MARGIN = 3.0, 6.0, 1.0, 0.3
_LEAST, _MOST, _LEAD, _MARGIN = 4.0, 6.0, 7.0, 2.0
"""Braking of the follower, least and most, and of the one ahead [m/s2], and margin [m], of `fsm`."""
_SLIVER = 1e-9


@dataclass(frozen=True)
class CarefulParams:
    """Kind of reference driver; all else is fixed.

    Attributes:
        driver: A name of `CAREFUL`.

    Raises:
        UnknownNameError: The driver is unknown.
    """

    driver: str = "cc-human"

    def __post_init__(self) -> None:
        check_in("careful.driver", self.driver, tuple(CAREFUL))


class Threat(NamedTuple):
    """One vehicle ahead of a driver, as it sees it.

    Attributes:
        gap: Between the bumpers [m].
        clear: How much farther the driver must come than the other until the driver has passed it [m].
        aside: Free space between the sides [m]; 0 or less: one is in front of the other.
        towards: How fast the other comes nearer sideways [m/s]; negative: it goes away.
        lead_speed: Speed of the other [m/s].
    """

    gap: float
    clear: float
    aside: float
    towards: float
    lead_speed: float


@inlined_kernel
def _membership(value: float, safe: float, unsafe: float) -> float:
    """Degree of danger: 0 at `safe` and above, 1 at `unsafe` and below."""
    if value >= safe:
        return 0.0
    if value <= unsafe:
        return 1.0
    return (safe - value) / (safe - unsafe)


@kernel
def _fuzzy_braking(speed: float, acceleration: float, t: Threat) -> float:
    """Compute how hard `fsm` wants to brake [m/s2]: by the critical measure where it is above 0, else the proactive."""
    u, lead = speed, t.lead_speed
    ahead = u * _DELAY - lead * lead / (2.0 * _LEAD)
    safe, unsafe = ahead + u * u / (2.0 * _LEAST) + _MARGIN, ahead + u * u / (2.0 * _MOST)
    proactive = _membership(t.gap - _MARGIN, safe, unsafe)
    critical = 0.0
    if u > lead:
        a = max(acceleration, -_LEAST)
        after = u + _DELAY * a
        if after < lead:  # it is slowing down enough already, unless the gap closes before
            critical = 1.0 if t.gap < (u - lead) * (u - lead) / abs(2.0 * a) else 0.0
        else:
            closes = (u + 0.5 * a * _DELAY - lead) * _DELAY
            faster = (after - lead) * (after - lead)
            critical = _membership(t.gap, closes + faster / (2.0 * _LEAST), closes + faster / (2.0 * _MOST))
    if critical > 0.0:
        return min(critical * (_MOST - _LEAST) + _LEAST, _HARDEST)
    return proactive * _LEAST


@kernel
def braking_demanded(kind: int, speed: float, acceleration: float, t: Threat) -> float:
    """Say how hard a reference driver wants to brake for a vehicle ahead [m/s2]; 0: it sees no danger.

    Args:
        kind: Code of `CAREFUL`.
        speed, acceleration: The driver's own [m/s], [m/s2].
        t: The vehicle ahead.
    """
    closing = speed - t.lead_speed
    if kind == _CC_HUMAN:
        return _HARDEST if t.aside <= 0.0 and closing > 0.0 and t.gap <= _TTC * closing else 0.0
    if kind == _REG157:
        enough = closing / (2.0 * _REG_BRAKING) + _REG_DELAY + _REG_STEP
        return _REG_BRAKING if t.aside <= _REG_SIDE and closing > 0.0 and t.gap <= enough * closing else 0.0
    if kind == _RSS:
        faster = max(t.towards, 0.0) + _RSS_LATERAL * _DELAY
        needed = _RSS_MARGIN + 0.5 * (max(t.towards, 0.0) + faster) * _DELAY + faster * faster / (2.0 * _RSS_LATERAL)
        along = rss_distance(speed, t.lead_speed, _DELAY, _RSS_ACCELERATION, _RSS_BRAKING, _RSS_BRAKING)
        return _HARDEST if t.gap < along and t.aside < needed else 0.0
    is_coming = t.aside <= 0.0
    if not is_coming and t.towards > 0.0:
        is_coming = closing <= 0.0 or t.aside / t.towards <= t.clear / closing + _REG_STEP
    return _fuzzy_braking(speed, acceleration, t) if is_coming else 0.0


@inlined_kernel
def own_reaction(kind: int) -> float:
    """Look up the time from seeing danger to braking that a driver's source gives it [s]."""
    return _REG_DELAY if kind == _REG157 else _DELAY


@inlined_kernel
def braking_of(kind: int, since: float, demanded: float, acceleration: float, step: float, reaction: float) -> float:
    """Compute the acceleration [m/s2] that a reference driver has in a step that begins `since` it saw danger [s].

    Args:
        kind: Code of `CAREFUL`.
        since: 0 in the step in which danger is seen first [s].
        demanded: What `braking_demanded` says now [m/s2]; 0: danger is over, and it holds its speed.
        acceleration: Its own in the step before [m/s2].
        step: Length of a step [s].
        reaction: From seeing danger to braking [s], `own_reaction` or another; what it calls danger stays as it is.
    """
    if demanded <= 0.0:
        return 0.0
    if kind == _REG157:
        return 0.0 if since < reaction - _SLIVER else -demanded
    if since < reaction - _SLIVER:
        return -_OFF_PEDAL if kind == _CC_HUMAN else 0.0
    return max(-demanded, acceleration - _JERK * step)


# In the place of an AV, among others that move as they are told

HOLDS = len(CAREFUL)
"""Code of a driver that only holds its speed, after the codes of `CAREFUL`; where it is enough, no care was needed."""
SCENARIOS = {"cut-in": 0, "cut-out": 1, "deceleration": 2}
"""Families of scenarios of UN R157 and their codes: `cc-human` sees danger differently in them."""
_CUT_IN = SCENARIOS["cut-in"]
_OFF_LINE = 0.375
"""A vehicle is seen past a nearer one that is so far off the line to it [m]: R157's deviation that is perceived."""
_EVALUATION = 4
"""Frames that `cc-human` needs to see the risk of a vehicle in its lane that it nears: 0.4 s."""
_STEP = FRAME_S


@inlined_kernel
def _is_hidden(poses: NDArray[np.float64], f: int, j: int, x: float, y: float) -> bool:
    """Does a nearer vehicle stand on the line from the driver's centre to vehicle j's centre?"""
    far = way_from(x, poses[f, j, X])
    for i in range(1, poses.shape[1]):
        near = way_from(x, poses[f, i, X])
        if i != j and 0.0 < near < far:
            line = y + (poses[f, j, Y] - y) * near / far
            if abs(poses[f, i, Y] - line) < _OFF_LINE:
                return True
    return False


@inlined_kernel
def _as_human(threat: Threat, speed: float, frames: int) -> float:
    """Say how hard `cc-human` wants to brake for a vehicle in its lane that it has neared for some frames [m/s2]."""
    nears = threat.aside <= 0.0 and speed > threat.lead_speed
    return _HARDEST if nears and frames >= _EVALUATION else 0.0


@kernel
def drives_into(
    kind: int, scenario: int, speed: float, place: tuple[float, float], sizes: NDArray[np.float64],
    poses: NDArray[np.float64],
) -> int:  # fmt: skip
    """Let a reference driver drive straight on among vehicles on rails; give the frame in which it touches one, or -1.

    It holds its speed until it sees danger from a vehicle ahead that no nearer one hides. Positions are summed after
    speeds, as where the models were compared (Mattas et al. 2022); boxes are parallel to the road. What is danger for
    `cc-human` depends on the scenario (R157, Annex 4, Appendix 3). In a cut-in it is a TTC of 2 s when the other comes
    in front of it; more counts as prevented at once, as in that comparison. In the others it is a vehicle in its
    lane that it has neared for 0.4 s, from when that brakes or is uncovered.

    Args:
        kind: Code of `CAREFUL`, or HOLDS.
        scenario: Code of `SCENARIOS`.
        speed: Speed of the driver at frame 0 [m/s].
        place: x and y of its centre at frame 0 [m].
        sizes: Length and width of each vehicle [m], (N, 2); row 0 is the driver.
        poses: Rails (F, N, POSE_NUMBERS) (`drivers.rails`).
    """
    x, y = place
    acceleration, since = 0.0, -1.0
    was_in_front = False
    neared = 0
    for f in range(poses.shape[0] - 1):
        demanded = 0.0
        nears = False
        for j in range(1, poses.shape[1]):
            ahead = way_from(x, poses[f, j, X])
            if not ahead > 0.0 or _is_hidden(poses, f, j, x, y):  # NaN is not there
                continue
            half = 0.5 * (sizes[0, 0] + sizes[j, 0])
            across = poses[f, j, Y] - y
            drifts = poses[f, j, LATERAL_SPEED]
            aside = abs(across) - 0.5 * (sizes[0, 1] + sizes[j, 1])
            threat = Threat(ahead - half, ahead + half, aside, -drifts if across > 0.0 else drifts, poses[f, j, SPEED])
            nears = nears or (aside <= 0.0 and speed > threat.lead_speed)
            wants = 0.0 if kind == HOLDS else braking_demanded(kind, speed, acceleration, threat)
            if kind == _CC_HUMAN and scenario != _CUT_IN:
                wants = max(wants, _as_human(threat, speed, neared))
            elif kind == _CC_HUMAN and since < 0.0 and aside <= 0.0:
                if not was_in_front and wants == 0.0:
                    return -1
                was_in_front = True
            demanded = max(demanded, wants)
        neared = neared + 1 if nears else 0
        if demanded > 0.0 and since < 0.0:
            since = 0.0
        if since >= 0.0:
            acceleration = braking_of(kind, since, demanded, acceleration, _STEP, own_reaction(kind))
            since += _STEP
        speed = max(speed + acceleration * _STEP, 0.0)
        x += speed * _STEP
        for j in range(1, poses.shape[1]):
            ahead = way_from(x, poses[f + 1, j, X])
            half = 0.5 * (sizes[0, 0] + sizes[j, 0])
            if abs(ahead) < half and abs(poses[f + 1, j, Y] - y) < 0.5 * (sizes[0, 1] + sizes[j, 1]):
                return f + 1
    return -1


# The cut-in by which the models were compared (Mattas et al. 2022)

_LENGTH, _WIDTH = 4.3, 1.9
_LANE = 3.5
_STEPS = 350


@kernel
def cut_in_poses(poses: NDArray[np.float64], lane_centre: float, ego: float, other: float, gap: float, across: float,
                 lane: int) -> None:  # fmt: skip
    """Fill the poses (F, POSE_NUMBERS) of a vehicle that comes, from the right, in front of a driver at x = 0.

    Args:
        poses: Array to fill.
        lane_centre: y of the driver's lane [m].
        ego, other: Speeds [m/s].
        gap: Between the bumpers when the lateral speed is reached, if the driver holds its speed [m].
        across: The lateral speed [m/s], above 0.
        lane: The driver's.
    """
    before = frames_before(across)
    ahead = gap + _LENGTH + (ego - other) * _STEP * before
    keeps_on(poses, ahead, lane_centre - _LANE - way_before(across), other, lane - 1)
    move_aside(poses, _LANE, across, lane)


@kernel
def _crash_each(
    kind: int, ego: NDArray[np.float64], other: NDArray[np.float64], gap: NDArray[np.float64],
    across: NDArray[np.float64], sizes: NDArray[np.float64], room: NDArray[np.float64], crashes: NDArray[np.bool_],
) -> None:  # fmt: skip
    for k in range(ego.size):
        if across[k] > 0.0:
            poses = room[: frames_before(across[k]) + _STEPS + 1]
            cut_in_poses(poses[:, 1], 0.0, ego[k], other[k], gap[k], across[k], 1)
            crashes[k] = drives_into(kind, _CUT_IN, ego[k], (0.0, 0.0), sizes, poses) >= 0


def crashes_at_cut_ins(
    driver: str, ego_speed: ArrayLike, cut_in_speed: ArrayLike, gap: ArrayLike, lateral_speed: ArrayLike
) -> NDArray[np.bool_]:
    """Say in which cut-ins a reference driver crashes, in the scenario by which Mattas et al. (2022) compared them.

    Both vehicles are 4.3 m x 1.9 m and hold their speeds. At first the other one is a lane (3.5 m) aside; it moves over
    at a constant lateral speed, which it has gained at 1.5 m/s2 before, and stops sideways when it is there. Steps of
    0.1 s; 35 s.

    Args:
        driver: A name of `CAREFUL`.
        ego_speed, cut_in_speed: Along the road, at first [m/s], not negative, shape (*d).
        gap: Between the bumpers, the driver behind, when the lateral speed is reached [m], not negative, shape (*d).
        lateral_speed: Lateral speed of the other, towards the driver's lane [m/s], shape (*d); 0: it never comes over.

    Returns:
        Shape (*d), True where the boxes overlap at a step.

    Raises:
        UnknownNameError: The driver is unknown.
        InputError: A value is negative or not finite, or the shapes do not match.

    >>> crashes_at_cut_ins("cc-human", 36.0, 20.0, [40.0, 80.0], 1.0).tolist()
    [True, False]
    """
    check_in("reference driver", driver, tuple(CAREFUL))
    try:
        arrays = np.broadcast_arrays(
            *(np.asarray(one, np.float64) for one in (ego_speed, cut_in_speed, gap, lateral_speed))
        )
    except ValueError as error:
        raise InputError("ego_speed, cut_in_speed, gap and lateral_speed have shapes that do not match.") from error
    for name, values in zip(("ego_speed", "cut_in_speed", "gap", "lateral_speed"), arrays, strict=True):
        if not (np.isfinite(values) & (values >= 0.0)).all():
            raise InputError(f"{name} must be finite and at least 0 everywhere.")
    crashes = np.zeros(arrays[0].size, dtype=np.bool_)
    ego, other, between, across = (np.ascontiguousarray(one).ravel() for one in arrays)
    longest = frames_before(float(across.max(initial=0.0))) + _STEPS + 1
    room = np.zeros((longest, 2, POSE_NUMBERS))
    sizes = np.array([[_LENGTH, _WIDTH]] * 2)
    _crash_each(CAREFUL[driver], ego, other, between, across, sizes, room, crashes)
    return crashes.reshape(arrays[0].shape)
