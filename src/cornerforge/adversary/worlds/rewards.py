"""The adversary's rewards: for which crashes it is paid, by name, and the kernel that knows the rules.

CONTRIBUTING.md says how to add a reward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from cornerforge._checks import check_number
from cornerforge._elementary import sin_cos
from cornerforge._jit import inlined_kernel, kernel, kernel_by_code
from cornerforge.counterfactual import Braking
from cornerforge.drivers.careful import CAREFUL
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.road.straight import ahead_by

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = [
    "DRIVER",
    "REWARDS",
    "SITE_REWARDS",
    "Reward",
    "RewardNumbers",
    "av_strikes",
    "driver_of_reward",
    "is_paid",
    "reward_named",
    "reward_numbers",
]

CRASH, STRIKING, AVOIDABLE, PREVENTABLE, BY_BRAKING, OWN_FAULT, OWN_DOING = range(7)
DRIVER = "cc-human"
"""The reference driver of rewards that ask one, where the name gives none."""
_FACING = 0.5
"""Cosine of 60 degrees, as in `analysis.contact`: closer than that to facing the other box, a front takes part."""


@dataclass(frozen=True)
class Reward:
    """A named reward.

    Attributes:
        code: The number by which kernels know it.
        pays_for: Which crashes of the AV give +1, in words. Under every reward a crash of the controlled BV with
            another BV gives -1, and all else 0.
        by_case: Each crash is judged outside the kernels, by the functions that analyse stored cases, on the case that
            a library would hold of it (`crash_cases`).
    """

    code: int
    pays_for: str
    by_case: bool = False


REWARDS = {
    "crash": Reward(CRASH, "every crash of the AV (the paper's)"),
    "striking": Reward(STRIKING, "a crash in which the AV strikes: its front takes part in the first contact"),
    "avoidable": Reward(
        AVOIDABLE,
        "a crash that the AV would have avoided by braking at 8 m/s2 from d seconds after the manoeuvre began (d = 1)",
    ),
    "preventable": Reward(
        PREVENTABLE,
        f"a crash that a reference driver in the AV's place would have prevented: {DRIVER}, or preventable:DRIVER",
        by_case=True,
    ),
    "preventable-by-braking": Reward(
        BY_BRAKING,
        "such a crash that holding the speed would not have prevented, so that the driver's braking was needed",
        by_case=True,
    ),
    "own-fault": Reward(OWN_FAULT, "a crash in which the AV broke a rule of RSS, alone or both did", by_case=True),
    "own-doing": Reward(
        OWN_DOING,
        "a crash in which the AV did something wrong, as the analysis says it (docs/adr/0069-one-judgement.md)",
        by_case=True,
    ),
}
"""The rewards by name; the two that ask a reference driver may end in a colon and a name of `careful.CAREFUL`."""
SITE_REWARDS = ("crash", "striking")
"""Rewards at a site; the others are judged by what roads have."""


class RewardNumbers(NamedTuple):
    """A reward as kernels take it.

    Attributes:
        code: Of `REWARDS`.
        braking: How the AV would have braked (used by `avoidable` only).
        by_case: Kernels pay for no crash; they note each in `drive_bv.History`, to be judged outside.
    """

    code: int
    braking: Braking
    by_case: bool


def reward_named(name: str) -> Reward:
    """Look up a reward.

    Raises:
        UnknownNameError: There is none of that name, or no such reference driver.
        InputError: A driver is named for a reward that asks none.
    """
    plain, colon, driver = name.partition(":")
    if plain not in REWARDS:
        raise UnknownNameError("reward", name, REWARDS)
    if colon and REWARDS[plain].code not in (PREVENTABLE, BY_BRAKING):
        raise InputError(f'reward = "{name}" is not allowed: {plain} asks no driver; leave out "{colon}{driver}".')
    if colon and driver not in CAREFUL:
        raise UnknownNameError("reference driver", driver, CAREFUL)
    return REWARDS[plain]


def driver_of_reward(name: str) -> str | None:
    """Give the reference driver by which a reward judges; None: it judges by none.

    Raises:
        UnknownNameError, InputError: As `reward_named`.
    """
    if reward_named(name).code not in (PREVENTABLE, BY_BRAKING):
        return None
    return name.partition(":")[2] or DRIVER


def reward_numbers(name: str, delay_s: float = 1.0, deceleration_mps2: float = 8.0) -> RewardNumbers:
    """Make a reward as kernels take it.

    Args:
        name: One of `REWARDS`, as `reward_named` takes it.
        delay_s: For `avoidable`: time from the begin of the manoeuvre to the AV's braking [s], 0 to 10.
        deceleration_mps2: For `avoidable`: deceleration of that braking [m/s2], 0.1 to 20.

    Raises:
        UnknownNameError, InputError: The name is not known, or a number out of range.
    """
    delay = check_number("delay_s", delay_s, low=0.0, high=10.0, unit="s")
    deceleration = check_number("deceleration_mps2", deceleration_mps2, low=0.1, high=20.0, unit="m/s2")
    reward = reward_named(name)
    return RewardNumbers(reward.code, Braking(float(delay), float(deceleration)), reward.by_case)


class _Boxes(NamedTuple):
    """The two boxes: cosine and sine of the AV's heading, then of the other's; lengths and widths [m]."""

    ca: float
    sa: float
    cb: float
    sb: float
    length_a: float
    width_a: float
    length_b: float
    width_b: float


@kernel
def _separation(
    axis: tuple[float, float], apart: tuple[float, float], speed: tuple[float, float], boxes: _Boxes
) -> tuple[float, float]:
    """Compute how long ago the boxes began to overlap on an axis [s] (+inf: not closing), and their overlap there [m].

    `apart` [m] and `speed` [m/s] are the other box's centre and velocity relative to the AV's.
    """
    ax, ay = axis
    distance = apart[0] * ax + apart[1] * ay
    reach = 0.5 * boxes.length_a * abs(ax * boxes.ca + ay * boxes.sa)
    reach += 0.5 * boxes.length_b * abs(ax * boxes.cb + ay * boxes.sb)
    reach += 0.5 * boxes.width_a * abs(ay * boxes.ca - ax * boxes.sa)
    reach += 0.5 * boxes.width_b * abs(ay * boxes.cb - ax * boxes.sb)
    overlap = reach - abs(distance)
    rate = speed[0] * ax + speed[1] * ay
    closing = abs(rate) if distance == 0.0 else -math.copysign(rate, rate * distance)
    since = max(overlap, 0.0) / closing if closing > 1e-6 else math.inf
    return since, overlap


@kernel
def av_strikes(v: NDArray[np.void], i: int, j: int, along_road: bool) -> bool:
    """Does the AV's front take part in the first contact? The geometry of `analysis.contact`, for one crash.

    Both boxes are moved back along their velocities to the moment at which they touched; the axis of the contact is the
    separating axis on which they began to overlap last.

    Args:
        v: Vehicles with x, y [m], speed [m/s], heading [rad], length and width [m], in the first frame of overlap.
        i, j: The AV, and the other vehicle.
        along_road: Speeds are along the road; else, at a site, along each one's way.
    """
    av, other = v[i], v[j]
    sa, ca = sin_cos(av.heading)
    sb, cb = sin_cos(other.heading)
    path_speed = av.speed / ca if along_road and ca > 0.5 else av.speed  # as in `analysis.contact`
    other_path_speed = other.speed / cb if along_road and cb > 0.5 else other.speed
    vx = other_path_speed * cb - path_speed * ca
    vy = other_path_speed * sb - path_speed * sa
    dx = ahead_by(v, i, j)
    dy = other.y - av.y
    boxes = _Boxes(ca, sa, cb, sb, av.length, av.width, other.length, other.width)
    best_since = math.inf
    best_overlap = math.inf
    facing = 0.0
    for k in range(4):
        if k == 0:
            ax, ay = ca, sa
        elif k == 1:
            ax, ay = cb, sb
        elif k == 2:
            ax, ay = -sa, ca
        else:
            ax, ay = -sb, cb
        since, overlap = _separation((ax, ay), (dx, dy), (vx, vy), boxes)
        if since < best_since or (best_since == math.inf and since == math.inf and overlap < best_overlap):
            best_since = since
            best_overlap = overlap
            apart = dx * ax + dy * ay
            facing = 0.0 if apart == 0.0 else math.copysign(1.0, apart) * (ax * ca + ay * sa)
    return facing >= _FACING


@inlined_kernel
def _every_crash(_strikes: bool, _avoidable: bool) -> bool:
    return True


@inlined_kernel
def _that_strikes(strikes: bool, _avoidable: bool) -> bool:
    return strikes


@inlined_kernel
def _that_was_avoidable(_strikes: bool, avoidable: bool) -> bool:
    return avoidable


@inlined_kernel
def _none_here(_strikes: bool, _avoidable: bool) -> bool:
    return False


_RULES: dict[str, Any] = {
    "crash": _every_crash,
    "striking": _that_strikes,
    "avoidable": _that_was_avoidable,
    "preventable": _none_here,
    "preventable-by-braking": _none_here,
    "own-fault": _none_here,
    "own-doing": _none_here,
}
"""Which crashes of the AV each reward pays for, by whether the AV strikes and whether braking would have avoided it."""
_rule_of: Any = kernel_by_code({name: reward.code for name, reward in REWARDS.items()}, _RULES)


for _name, _rule in _RULES.items():
    _asks = any(_rule.py_func(strikes, True) != _rule.py_func(strikes, False) for strikes in (False, True))
    if _asks and REWARDS[_name].code != AVOIDABLE:  # without this its rule would always get False
        raise LookupError(
            f'Reward "{_name}" asks whether braking would have avoided the crash, which is found out for "avoidable" '
            "only; name its code in `reward_of` of adversary/worlds/drive_bv.py, and here."
        )


@kernel
def is_paid(code: int, strikes: bool, avoidable: bool) -> bool:
    """Does a crash of the AV give +1 under a reward?"""
    paid: bool = _rule_of(code, strikes, avoidable)
    return paid
