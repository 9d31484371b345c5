"""Longitudinal safe distance of responsibility-sensitive safety, RSS (Shalev-Shwartz, Shammah and Shashua 2017)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from cornerforge._jit import inlined_kernel
from cornerforge._schema import check_fields, meant

__all__ = ["RssNumbers", "RssParams", "rss_braking", "rss_distance"]

_HARDEST_BRAKING = 8.0
"""No car brakes harder on a dry road [m/s2]; the limit of every AV in cornerforge."""


@dataclass(frozen=True)
class RssParams:
    """A cautious AV's assumptions about itself, its lead, and the driver behind it in a lane that it changes to.

    The paper leaves the values open. Ours: the AV decides every 0.1 s, and its brakes need some more time; the lead may
    brake as hard as a car can; a driver behind needs a second, but brakes hard when the AV forces it to.

    Raises:
        InputError: A value is out of range.
    """

    response_time: Annotated[float, meant("Of the AV, rho.", "s", 0, 5)] = 0.3
    max_acceleration: Annotated[float, meant("Its largest during its response time.", "m/s2", 0, 10)] = 2.0
    min_braking: Annotated[float, meant("Its least when it is too near.", "m/s2", 0.1, _HARDEST_BRAKING)] = 6.0
    lead_braking: Annotated[
        float, meant("Hardest of a vehicle ahead (for one behind: of the AV).", "m/s2", 0.1, 12)
    ] = 8.0
    rear_response_time: Annotated[float, meant("Of a driver behind the AV.", "s", 0, 5)] = 1.0
    rear_acceleration: Annotated[float, meant("Its largest during its response time.", "m/s2", 0, 10)] = 1.0
    rear_braking: Annotated[float, meant("Its least when it is too near.", "m/s2", 0.1, 12)] = 6.0

    def __post_init__(self) -> None:
        check_fields(self, "rss.")


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

    The scalar form of `metrics.rss.rss_longitudinal`, which says what the numbers are, how the two drive, and where the
    paper's formula falls short; in m/s, s and m/s2, unchecked.
    """
    faster = rear_speed + response_time * acceleration
    response = rear_speed * response_time + 0.5 * acceleration * response_time * response_time
    slower = max(0.0, lead_speed - response_time * lead_braking)
    if slower < faster and faster * lead_braking < slower * rear_braking:  # so the lead still moves, and brakes less
        closing = (faster - slower) * (faster - slower) / (2.0 * (rear_braking - lead_braking))
        return max(0.0, response - 0.5 * (lead_speed + slower) * response_time + closing)
    distance = response + faster * faster / (2.0 * rear_braking) - lead_speed * lead_speed / (2.0 * lead_braking)
    return max(0.0, distance)


@inlined_kernel
def rss_braking(speed: float, gap: float, lead_speed: float, p: RssNumbers) -> float:
    """Compute how hard the AV must brake behind a lead [m/s2]: 0 at the safe distance and beyond.

    Nearer, it brakes with the least constant braking by which it never touches a lead that brakes with `lead_braking`,
    with at least `min_braking` and at most 8 m/s2. With no gap left it brakes with 8 m/s2.

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
    closing = speed - lead_speed
    if closing * lead_speed > 2.0 * gap * p.lead_braking:  # it stops first, so they are nearest when equally fast
        enough = p.lead_braking + closing * closing / (2.0 * gap)
    else:
        enough = speed * speed / (2.0 * (gap + lead_speed * lead_speed / (2.0 * p.lead_braking)))
    return min(_HARDEST_BRAKING, max(p.min_braking, enough))
