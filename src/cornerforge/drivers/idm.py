"""Intelligent driver model: how a vehicle accelerates behind its lead (Treiber et al. 2000; paper reference 19)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from cornerforge._jit import inlined_kernel
from cornerforge._schema import check_fields, meant

__all__ = ["IdmNumbers", "IdmParams", "desired_gap", "free_acceleration", "idm_acceleration"]


@dataclass(frozen=True)
class IdmParams:
    """Parameters of the IDM. Defaults: the surrogate AV of the paper's group (NADE, Feng et al. 2021).

    The command is cut to [-max_braking, max_acceleration]. The exponent delta is 4, fixed.
    """

    max_acceleration: Annotated[float, meant("Largest acceleration.", "m/s2", 0.1, 10)] = 2.0
    comfortable_braking: Annotated[float, meant("Braking that it aims at.", "m/s2", 0.1, 10)] = 4.0
    standstill_gap: Annotated[float, meant("Gap that it leaves standing.", "m", 0, 50)] = 5.0
    time_gap: Annotated[float, meant("Gap that it leaves driving, over its speed.", "s", 0, 10)] = 1.5
    desired_speed: Annotated[float, meant("Speed on a free road.", "m/s", 1, 80)] = 35.0
    max_braking: Annotated[float, meant("Hardest braking.", "m/s2", 0.1, 12)] = 4.0

    def __post_init__(self) -> None:
        check_fields(self, "idm.")


class IdmNumbers(NamedTuple):
    """`IdmParams` as compiled kernels take them: the same fields in the same order and units."""

    max_acceleration: float
    comfortable_braking: float
    standstill_gap: float
    time_gap: float
    desired_speed: float
    max_braking: float


@inlined_kernel
def desired_gap(speed: float, range_rate: float, p: IdmNumbers) -> float:
    """Compute the IDM's desired gap s* [m], at least the standstill gap.

    Args:
        speed: Speed of the subject [m/s].
        range_rate: Lead minus subject [m/s]; negative when closing.
        p: Parameters.
    """
    dynamic = speed * p.time_gap - speed * range_rate / (2.0 * math.sqrt(p.max_acceleration * p.comfortable_braking))
    return p.standstill_gap + max(0.0, dynamic)


@inlined_kernel
def free_acceleration(speed: float, p: IdmNumbers) -> float:
    """Compute the acceleration without a lead [m/s2]: same bits as `idm_acceleration` for an infinite gap, and cheaper.

    Args:
        speed: Speed of the subject [m/s].
        p: Parameters.
    """
    ratio = speed / p.desired_speed
    ratio *= ratio
    command = p.max_acceleration * (1.0 - ratio * ratio)
    return min(p.max_acceleration, max(-p.max_braking, command))


@inlined_kernel
def idm_acceleration(speed: float, gap: float, range_rate: float, p: IdmNumbers) -> float:
    """Compute the IDM's acceleration [m/s2], in [-max_braking, max_acceleration].

    Args:
        speed: Speed of the subject [m/s].
        gap: Bumper-to-bumper distance to the lead [m]; +inf for none; below 0.1 m counts as 0.1 m.
        range_rate: Lead minus subject [m/s]; negative when closing; 0 without a lead.
        p: Parameters.
    """
    ratio = speed / p.desired_speed
    ratio *= ratio
    wish = desired_gap(speed, range_rate, p) / max(gap, 0.1)
    command = p.max_acceleration * (1.0 - ratio * ratio - wish * wish)
    return min(p.max_acceleration, max(-p.max_braking, command))
