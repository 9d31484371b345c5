"""How a vehicle at a site stops, sets off and takes a gap: ways and times that drivers and people reckon with."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cornerforge._elementary import exp, log
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.site.tables import WARM_UP

if TYPE_CHECKING:
    from cornerforge.sim.world import World

__all__ = [
    "HARDEST", "STANDS", "STRONGEST", "WARM_STEP", "held_then_stops_within", "seconds_of", "still_stops",
    "stops_within", "sure", "time_to", "to_stop", "will_stop",
]  # fmt: skip

WARM_STEP = 1 << 15
"""Numbers of decisions from here on are those of the warm-up."""
HARDEST, STRONGEST = 8.0, 3.0
"""Hardest braking, and more than any vehicle accelerates [m/s2]."""
STANDS = 0.5
"""Below this speed a vehicle stands [m/s]."""
_RAMP_TIME = 0.08
"""An acceleration takes so long to change [s per m/s2], a little longer than it does (`experiment.sites`)."""
_EXPECTED = 4.0
"""A vehicle that needs to brake harder than this is thought not to stop [m/s2]."""
_RAMP = 0.2
"""Braking begins so late, because the acceleration must change first [s]."""
_SLOPE, _BEND, _LEAST_ODDS = 1.5976, 0.07056, -30.0
"""The normal law by exp alone, to 1.4e-4, and with its thin tails: Bowling et al. (2009), J. Ind. Eng. Manag. 2(1)."""


@inlined_kernel
def seconds_of(w: World) -> float:
    """Compute the time since the start of the test at the coming decision [s], less than 0 in the warm-up."""
    state = w.state[0]
    if state.decisions >= WARM_STEP:
        return float(state.decisions - WARM_STEP) - WARM_UP
    return float(state.decisions)


@inlined_kernel
def sure(ratio: float, spread: float) -> float:
    """Compute the chance that a gap of this ratio to the critical one is taken, if it is judged with such a spread."""
    if ratio <= 0.0:
        return 0.0
    z = log(ratio) / spread
    odds = z * (_SLOPE + _BEND * z * z)
    return 1.0 / (1.0 + exp(-odds)) if odds > _LEAST_ODDS else 0.0


@inlined_kernel
def will_stop(speed: float, room: float) -> bool:
    """Can a vehicle of a speed [m/s] be thought to stop within a room [m]?"""
    return speed < STANDS or 0.5 * speed * speed <= _EXPECTED * max(room, 0.0)


@kernel
def to_stop(speed: float, room: float, braking: float) -> float:
    """Compute the acceleration with which a vehicle stops within a room [m], if it decides again in a second [m/s2].

    Gipps's (1981) rule with comfortable braking, or the braking that is needed.
    """
    room = max(room - _RAMP * speed, 0.0)
    b = max(braking, 1.05 * 0.5 * speed * speed / max(room, 0.05))
    inside = b * b + b * (2.0 * room - speed)
    safe = -b + math.sqrt(max(inside, 0.0))
    return max(-HARDEST, max(safe, 0.0) - speed)


@kernel
def time_to(room: float, speed: float, wanted: float, a: float) -> float:
    """Compute the time over a distance [s] of a vehicle that accelerates from a speed to the wanted one [m/s]."""
    if room <= 0.0:
        return 0.0
    if speed >= wanted:
        return room / max(speed, 0.3)
    way = 0.5 * (wanted * wanted - speed * speed) / a
    if way >= room:
        return (math.sqrt(speed * speed + 2.0 * a * room) - speed) / a
    return (wanted - speed) / a + (room - way) / wanted


@inlined_kernel
def stops_within(speed: float, now: float) -> float:
    """Bound the way on which a vehicle stops that brakes as hard as it can, from a speed and an acceleration [m]."""
    late = max(now + HARDEST, 0.0)
    return speed * (late * late * _RAMP_TIME + speed) / (2.0 * HARDEST)


@kernel
def held_then_stops_within(speed: float, now: float, command: float) -> float:
    """Compute the way on which a vehicle stops that first goes to an acceleration `command` for a second [m].

    Args:
        speed: Its speed now [m/s].
        now: Its acceleration now [m/s2].
        command: The acceleration that it goes to [m/s2].
    """
    change = max(now, -math.sqrt(2.0 * speed / _RAMP_TIME)) - command  # it does not lose more than its speed
    ramp = abs(change) * _RAMP_TIME
    gained = 0.5 * change * ramp
    after = speed + command + gained
    if after < 0.0:
        if command > -0.1:
            return 0.3 * speed + 0.5 * max(command, 0.0) + stops_within(max(command, 0.0), command)
        late = max(change, 0.0)
        speed += 0.5 * max(now, 0.0) * max(now, 0.0) * _RAMP_TIME  # it goes faster first
        return speed * (late * late * _RAMP_TIME + speed) / (-2.0 * command)
    return speed + 0.5 * command + gained * (1.0 - ramp / 3.0) + stops_within(after, command)


@kernel
def still_stops(speed: float, now: float, room: float, most: float) -> float:
    """Find the largest acceleration, up to `most` [m/s2], after a second of which one can stop within `room` [m]."""
    high = min(most, STRONGEST)
    if held_then_stops_within(speed, now, high) <= room:
        return most
    low = -HARDEST
    if held_then_stops_within(speed, now, low) >= room:
        return low
    for _ in range(6):
        middle = 0.5 * (low + high)
        if held_then_stops_within(speed, now, middle) <= room:
            low = middle
        else:
            high = middle
    return low
