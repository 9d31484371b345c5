"""Right of way at a site: lights that hold, decisions to go, and which of two claims a zone more.

Both of two agents compute their claims from the same state, so one of them always keeps itself able to stop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim.site.moves import STANDS, STRONGEST, held_then_stops_within, stops_within, will_stop
from cornerforge.site.network import TURNS
from cornerforge.site.tables import RED, YELLOW, letter_at, walk_letter
from cornerforge.types import PERSON

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.sim.world import World

__all__ = [
    "AT_LINE", "BLIND", "EARLY", "GOING", "LOOKED", "PAST_LINE", "STOPS", "TURNS_ON_RED", "UNDER_WAY", "goes_before",
    "has_committed", "is_held", "stands_still", "surely_passes",
]  # fmt: skip

EARLY, TURNS_ON_RED, STOPS, LOOKED, BLIND, GOING = (1 << k for k in range(6))
"""Bits of `AGENT.marks`. Of a person: it leaves the kerb when Walk is about to come. Of a driver: it turns right on
red; it has decided to stop at this light. Of a person: it has looked at the traffic once; it looks no more. Of a
driver: it chose to go in the last second."""
PAST_LINE, AT_LINE = 0.5, 5.0
"""A vehicle that is less past its stop line has not passed it; one that is nearer stands at it [m]."""
UNDER_WAY = 1.0
"""A vehicle this quick is under way [m/s]."""
_LEFT_KERB = 0.05
_RIGHT = TURNS.index("right")
_SPURTS, _NEXT, _THROUGH = 2.2, 2.0, 0.5
"""A person may come so much nearer in a second than it walks [m]; a driver passes before one that needs so long to the
zone, and so much longer than itself to its end [s]."""


@inlined_kernel
def is_held(w: World, j: int, clock: float, site: NDArray[np.void]) -> bool:
    """Does a light hold the vehicle in slot j, which can stop for it?"""
    me, own = w.vehicles[j], w.agents[j]
    row = site[0].route[own.route]
    room = row.stop - own.s - 0.5 * me.length
    if row.signal < 0 or room < -PAST_LINE or own.cleared >= row.stop:
        return False
    letter = letter_at(site, own.route, clock)
    if letter != RED and (letter != YELLOW or own.marks & STOPS == 0):
        return False
    turns = letter == RED and row.turn == _RIGHT and own.marks & TURNS_ON_RED and me.speed < 1.0 and room < AT_LINE
    return not turns and will_stop(me.speed, room)


@inlined_kernel
def stands_still(me: Any) -> bool:
    """Does a vehicle stand, and not set off?"""
    still: bool = me.speed < STANDS and me.commanded < 0.05
    return still


@inlined_kernel
def has_committed(w: World, j: int, begin: float) -> bool:
    """Has the driver in slot j decided to go through a zone that begins at `begin` [m], and does it?"""
    me, own = w.vehicles[j], w.agents[j]
    goes = w.agents[j].marks & GOING != 0 or (j == 0 and me.commanded > 0.0)
    return own.cleared > begin and (me.speed >= UNDER_WAY or goes)


@kernel
def _claim(w: World, j: int, to_zone: float, begin: float, first: bool, clock: float, site: NDArray[np.void]) -> int:
    """Rank the claim of slot j on a zone, which it has `to_zone` [m] to: the higher one of two goes first.

    Who is in it or cannot stop before it; then who has decided to go; then who has priority; last who has a red light.
    Both compute it from the same state, so one of the two always keeps itself able to stop.
    """
    me, own = w.vehicles[j], w.agents[j]
    if me.kind == PERSON:
        if own.s > _LEFT_KERB:
            return 7 if to_zone <= 0.0 else 3
        if site[0].route[own.route].signal >= 0:
            return 1 if walk_letter(site, own.route, clock) != RED else -3
        return 1 if first else -3
    if stops_within(me.speed, me.acceleration) > to_zone + 1e-6:
        return 7 if to_zone <= 0.0 else 6
    if is_held(w, j, clock, site):
        return -2
    claim = 2 if has_committed(w, j, begin) else 0
    row = site[0].route[own.route]
    if row.signal >= 0 and own.s + 0.5 * me.length < row.stop + PAST_LINE and letter_at(site, own.route, clock) == RED:
        return claim - 1
    return claim + (1 if first and not stands_still(me) else 0)


@kernel
def goes_before(
    w: World, i: int, j: int, zone: Any, to_zone: float, to_other: float, clock: float, site: NDArray[np.void]
) -> bool:
    """Does slot i go first through a zone, which it and slot j have `to_zone` and `to_other` [m] to?"""
    mine = _claim(w, i, to_zone, zone.begin, zone.goes_first != 0 and zone.yields == 0, clock, site)
    theirs = _claim(w, j, to_other, zone.other_begin, zone.yields != 0 and zone.goes_first == 0, clock, site)
    soon, then = to_zone / (w.vehicles[i].speed + 1.0), to_other / (w.vehicles[j].speed + 1.0)
    first: bool = mine > theirs or (mine == theirs and (soon < then or (soon == then and i < j)))
    return first


@inlined_kernel
def surely_passes(w: World, j: int, to_other: float, leaves: float) -> bool:
    """May slot i enter a zone that slot j can claim, and leaves it after `leaves` [s]?

    Yes if slot j can stop before it after a second, whatever that one does; and before a person that is not there yet.
    """
    other = w.vehicles[j]
    if other.kind == PERSON:
        time = (to_other - _SPURTS) / max(other.desired_speed, other.speed)
        passes: bool = time >= _NEXT and leaves + _THROUGH < time
    else:
        passes = held_then_stops_within(other.speed, other.acceleration, STRONGEST) <= to_other
    return passes
