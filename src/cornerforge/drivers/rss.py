"""Longitudinal safe distance of responsibility-sensitive safety, RSS (Shalev-Shwartz, Shammah and Shashua 2017)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from cornerforge._checks import check_number
from cornerforge._jit import inlined_kernel

__all__ = ["RssNumbers", "RssParams", "rss_braking", "rss_distance"]

_HARDEST_BRAKING = 8.0
"""No car brakes harder on a dry road [m/s2]; the limit of every AV in cornerforge."""


@dataclass(frozen=True)
class RssParams:
    """A cautious AV's assumptions about itself, its lead, and the driver behind it in a lane that it changes to.

    The paper leaves the values open. Ours: the AV decides every 0.1 s, and its brakes need some more time; the lead may
    brake as hard as a car can; a driver behind needs a second, but brakes hard when the AV forces it to.

    Attributes:
        response_time: The AV's response time, rho.
        max_acceleration: The AV's largest acceleration during its response time.
        min_braking: The AV's least braking when it is too near (proper response).
        lead_braking: The hardest braking of a vehicle ahead (for a driver behind: of the AV).
        rear_response_time, rear_acceleration, rear_braking: The first three for a driver behind the AV.

    Raises:
        InputError: A value is out of range.
    """

    response_time: float = field(default=0.3, metadata={"unit": "s"})
    max_acceleration: float = field(default=2.0, metadata={"unit": "m/s2"})
    min_braking: float = field(default=6.0, metadata={"unit": "m/s2"})
    lead_braking: float = field(default=8.0, metadata={"unit": "m/s2"})
    rear_response_time: float = field(default=1.0, metadata={"unit": "s"})
    rear_acceleration: float = field(default=1.0, metadata={"unit": "m/s2"})
    rear_braking: float = field(default=6.0, metadata={"unit": "m/s2"})

    def __post_init__(self) -> None:
        check_number("rss.response_time", self.response_time, low=0.0, high=5.0, unit="s")
        check_number("rss.max_acceleration", self.max_acceleration, low=0.0, high=10.0, unit="m/s2")
        check_number("rss.min_braking", self.min_braking, low=0.1, high=_HARDEST_BRAKING, unit="m/s2")
        check_number("rss.lead_braking", self.lead_braking, low=0.1, high=12.0, unit="m/s2")
        check_number("rss.rear_response_time", self.rear_response_time, low=0.0, high=5.0, unit="s")
        check_number("rss.rear_acceleration", self.rear_acceleration, low=0.0, high=10.0, unit="m/s2")
        check_number("rss.rear_braking", self.rear_braking, low=0.1, high=12.0, unit="m/s2")


class RssNumbers(NamedTuple):
    """`RssParams` as compiled kernels take them: the same fields in the same order and units."""

    response_time: float
    max_acceleration: float
    min_braking: float
    lead_braking: float
    rear_response_time: float
    rear_acceleration: float
    rear_braking: float


@inlined_kernel
def rss_distance(
    rear_speed: float,
    lead_speed: float,
    response_time: float,
    acceleration: float,
    rear_braking: float,
    lead_braking: float,
) -> float:
    """Compute the least bumper-to-bumper distance [m] at which the rear vehicle cannot hit the lead, at least 0.

    The lead brakes with `lead_braking` from now on; the rear one accelerates with `acceleration` during its response
    time and brakes with `rear_braking` after it, both until they stand (definition 1 of the paper).

    Args:
        rear_speed, lead_speed: [m/s], not negative.
        response_time: Of the rear vehicle [s].
        acceleration: Of the rear vehicle during its response time [m/s2], not negative.
        rear_braking, lead_braking: [m/s2], positive.
    """
    faster = rear_speed + response_time * acceleration
    response = rear_speed * response_time + 0.5 * acceleration * response_time * response_time
    distance = response + faster * faster / (2.0 * rear_braking) - lead_speed * lead_speed / (2.0 * lead_braking)
    return max(0.0, distance)


@inlined_kernel
def rss_braking(speed: float, gap: float, lead_speed: float, p: RssNumbers) -> float:
    """Compute how hard the AV must brake behind a lead [m/s2]: 0 at the safe distance and beyond.

    Nearer, it brakes so that it could stop behind a lead that brakes with `lead_braking`, with at least `min_braking`
    and at most 8 m/s2. With no gap left it brakes with 8 m/s2.

    Args:
        speed: The AV's [m/s].
        gap: Bumper-to-bumper distance to the lead [m]; +inf for none.
        lead_speed: The lead's [m/s].
        p: Parameters.
    """
    needed = rss_distance(
        speed, lead_speed, p.response_time, p.max_acceleration, p.min_braking, p.lead_braking
    )  # fmt: skip
    if gap >= needed:
        return 0.0
    if gap <= 0.0:
        return _HARDEST_BRAKING
    room = gap + lead_speed * lead_speed / (2.0 * p.lead_braking)
    return min(_HARDEST_BRAKING, max(p.min_braking, speed * speed / (2.0 * room)))
