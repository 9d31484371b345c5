"""MOBIL lane changing (Kesting, Treiber and Helbing 2007; paper reference 20)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from cornerforge._jit import inlined_kernel
from cornerforge._schema import check_fields, meant
from cornerforge.drivers.idm import IdmNumbers, idm_acceleration

__all__ = ["MobilNumbers", "MobilParams", "mobil_gain"]

NO_CHANGE = -1e9
"""Result of `mobil_gain` where the change is not safe."""


@dataclass(frozen=True)
class MobilParams:
    """Parameters of MOBIL. Defaults: the surrogate AV of the paper's group (NADE)."""

    politeness: Annotated[float, meant("Weight of what others gain or lose.", "", 0, 1)] = 0.0
    min_gain: Annotated[float, meant("Gain from which on it changes lanes.", "m/s2", 0, 10)] = 0.2
    max_imposed_braking: Annotated[float, meant("Most that the driver behind must brake.", "m/s2", 0.1, 10)] = 2.0

    def __post_init__(self) -> None:
        check_fields(self, "mobil.")


class MobilNumbers(NamedTuple):
    """`MobilParams` as compiled kernels take them: the same fields in the same order and units."""

    politeness: float
    min_gain: float
    max_imposed_braking: float


@inlined_kernel
def mobil_gain(
    speed: float,
    acceleration_now: float,
    lead: tuple[float, float],
    rear: tuple[float, float],
    rear_acceleration_now: float,
    idm: IdmNumbers,
    mobil: MobilNumbers,
) -> float:
    """Compute the gain in acceleration [m/s2] of changing to a neighbouring lane, or -1e9 where that is not safe.

    Not safe: a neighbour overlaps lengthwise, or the new follower (or the subject itself behind its new lead) would
    have to brake harder than `max_imposed_braking`.

    Args:
        speed: Speed of the subject [m/s].
        acceleration_now: Its IDM acceleration in its own lane [m/s2].
        lead: Gap [m] and speed [m/s] of the vehicle ahead in the new lane; +inf and the subject's speed for none.
        rear: The same for the vehicle behind.
        rear_acceleration_now: IDM acceleration of the vehicle behind before the change [m/s2]; 0 for none.
        idm: Parameters assumed for all vehicles.
        mobil: Parameters.
    """
    lead_gap, lead_speed = lead
    rear_gap, rear_speed = rear
    if lead_gap <= 0.0 or rear_gap <= 0.0:
        return NO_CHANGE
    rear_after = idm_acceleration(rear_speed, rear_gap, speed - rear_speed, idm)
    own_after = idm_acceleration(speed, lead_gap, lead_speed - speed, idm)
    if rear_after < -mobil.max_imposed_braking or own_after < -mobil.max_imposed_braking:
        return NO_CHANGE
    gain = own_after - acceleration_now
    if rear_gap < 1e9:
        gain += mobil.politeness * (rear_after - rear_acceleration_now)
    return gain
