"""Natural choices at a site: the probability of each of the 33 actions, the draw, and how an action begins.

Actions of a driver: give way, go, and 31 accelerations. Where it has to choose (`look`), it does one of the first two;
else an acceleration about its law's. A driver that looks away does not accelerate, and brakes no harder. Actions of a
person: wait, go on at the own speed, and four speeds.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import uniform
from cornerforge.sim.actions import hold_from, nearest_action
from cornerforge.sim.site.claims import BLIND, GOING, LOOKED, STOPS
from cornerforge.sim.site.people import AT_KERB
from cornerforge.sim.world import ALL_OF_THEM, NO_ACTION, NO_VEHICLE
from cornerforge.site.tables import NOISE_CELLS
from cornerforge.types import ACCELERATION_STEP, ACCELERATIONS, FIRST_ACCELERATION, N_ACTIONS, PERSON

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim.world import World

__all__ = ["GIVES_WAY", "GOES", "WALKS", "act_at_site", "draw_action", "natural_choice", "possible_actions"]

GIVES_WAY, GOES = 0, 1
"""Actions of a driver and of a person: to give way or wait, and to go on."""
WALKS = np.array([0.8, 1.3, 2.0, 3.0])
"""Speeds of the actions of a person from 2 on [m/s]."""
_WALKS = WALKS
_ACCELERATIONS = ACCELERATIONS
_HALF = NOISE_CELLS // 2
_HARDEST = float(ACCELERATIONS[0])
_HALF_STEP = 0.5 * ACCELERATION_STEP
_STANDS = 0.05
_CALM = 0.5
"""A driver that should lower its acceleration by more than this does not begin to look away [m/s2]."""


@inlined_kernel
def _law(w: World, i: int) -> tuple[int, int]:
    """Find the acceleration of a driver's law, and the largest that noise may lead to, as actions; -1: no noise."""
    own = w.agents[i]
    centre = nearest_action(own.free)
    if centre > FIRST_ACCELERATION and _ACCELERATIONS[centre - FIRST_ACCELERATION] > own.most + 1e-9:
        centre -= 1
    if (w.vehicles[i].speed < _STANDS and own.free <= 0.0) or own.free <= _HARDEST:
        return centre, NO_ACTION
    return centre, max(centre, nearest_action(min(own.most, 100.0) - _HALF_STEP))


@inlined_kernel
def _about(centre: int, k: int, most: int) -> int:
    """Find the acceleration of noise cell k about the law's, as an action."""
    return min(most, max(FIRST_ACCELERATION, min(N_ACTIONS - 1, centre + k - _HALF)))


@inlined_kernel
def _add_law(w: World, i: int, site: NDArray[np.void], p: NDArray[np.float64]) -> None:
    """Add the probabilities of a driver that looks at the road."""
    own = w.agents[i]
    if own.chooses:
        p[GOES] = own.goes
        p[GIVES_WAY] = 1.0 - own.goes
        return
    centre, most = _law(w, i)
    if most < 0:
        p[centre] = 1.0
        return
    for k in range(NOISE_CELLS):
        if site[0].noise_shares[k] > 0.0:
            p[_about(centre, k, most)] += site[0].noise_shares[k]


@inlined_kernel
def _unseeing(w: World, i: int) -> int:
    """Find the action of a driver that looks away: it brakes on as it does, or keeps its speed."""
    return nearest_action(min(w.vehicles[i].commanded, 0.0))


@kernel
def natural_choice(w: World, i: int, site: NDArray[np.void], p: NDArray[np.float64]) -> None:
    """Compute P(action) of the agent in slot i, which has looked around, float64 (33,); the sum is 1."""
    one, own = site[0], w.agents[i]
    for a in range(N_ACTIONS):
        p[a] = 0.0
    if w.vehicles[i].kind == PERSON:
        p[GIVES_WAY] = 1.0 - own.goes
        change = one.walk_change if own.s > AT_KERB and own.for_whom < 0 else 0.0
        p[GOES] = own.goes * (1.0 - change)
        for k in range(_WALKS.size):
            p[FIRST_ACCELERATION + k] = own.goes * change / _WALKS.size
        return
    _add_law(w, i, site, p)
    away = away_chance(w, i, site)
    if away > 0.0:
        for a in range(N_ACTIONS):
            p[a] *= 1.0 - away
        p[_unseeing(w, i)] += away


@inlined_kernel
def away_chance(w: World, i: int, site: NDArray[np.void]) -> float:
    """Compute P(the driver of slot i looks away in this second).

    None begins where it has to choose, or to brake harder than it does: drivers look away while little happens ahead.
    """
    me, own = w.vehicles[i], w.agents[i]
    if me.kind == PERSON:
        return 0.0
    if me.away:
        goes_on: float = 1.0 - site[0].looks_back
        return goes_on
    if own.chooses or own.free < me.commanded - _CALM:
        return 0.0
    begins: float = site[0].looks_away
    return begins


@inlined_kernel
def draw_action(w: World, i: int, word: uint64, away_word: uint64, site: NDArray[np.void]) -> int:
    """Draw the action of the agent in slot i, with the chances of `natural_choice`, by two random words."""
    own, draw = w.agents[i], uniform(word)
    if w.vehicles[i].kind == PERSON:
        if draw >= own.goes:
            return GIVES_WAY
        part = draw / own.goes * (1.0 / site[0].walk_change if site[0].walk_change > 0.0 else np.inf)
        changes = own.s > AT_KERB and own.for_whom < 0 and part < 1.0
        return FIRST_ACCELERATION + math.floor(part * _WALKS.size) if changes else GOES
    away = uniform(away_word) < away_chance(w, i, site)
    w.vehicles[i].away = 1 if away else 0
    if away:
        return _unseeing(w, i)
    if own.chooses:
        return GOES if draw < own.goes else GIVES_WAY
    centre, most = _law(w, i)
    if most < 0:
        return centre
    k = 0
    while k < NOISE_CELLS - 1:
        draw -= site[0].noise_shares[k]
        if draw < 0.0:
            break
        k += 1
    return _about(centre, k, most)


@kernel
def possible_actions(w: World, i: int, allowed: NDArray[np.bool_]) -> None:
    """Write which actions the agent in slot i could take at all, bool (33,), natural or not."""
    walks = w.vehicles[i].kind == PERSON
    for a in range(N_ACTIONS):
        allowed[a] = not walks or a < FIRST_ACCELERATION + _WALKS.size


@inlined_kernel
def act_at_site(w: World, i: int, action: int, road: RoadNumbers) -> None:
    """Let the agent in slot i, which has looked around, begin an action."""
    own, me = w.agents[i], w.vehicles[i]
    if me.kind == PERSON:
        _walk(w, i, action)
        return
    command = own.stops
    own.marks &= ~GOING
    if action == GIVES_WAY:
        own.heeds = own.for_whom
        if own.chooses and own.for_whom == NO_VEHICLE:
            own.marks |= STOPS
    elif action == GOES:
        own.marks |= GOING
        own.heeds = NO_VEHICLE
        own.cleared = max(own.cleared, own.until)
        if own.unseen:
            own.overlooks = own.for_whom
        command = own.free
    else:
        command = _ACCELERATIONS[action - FIRST_ACCELERATION]
        if action == FIRST_ACCELERATION:
            command = min(command, own.free)
    me.x_held = own.s + hold_from(w.vehicles, i, command, road)


@inlined_kernel
def _walk(w: World, i: int, action: int) -> None:
    own, me = w.agents[i], w.vehicles[i]
    own.marks |= LOOKED
    me.speed = own.free
    if action == GIVES_WAY:
        me.speed = own.stops
    elif action >= FIRST_ACCELERATION:
        me.speed = _WALKS[min(action - FIRST_ACCELERATION, _WALKS.size - 1)]
    if action != GIVES_WAY and own.unseen:
        own.marks |= BLIND
        own.overlooks = ALL_OF_THEM
    me.x_held = own.s
    me.speed_held = me.speed
    me.acceleration = 0.0
    me.acceleration_held = 0.0
    me.commanded = 0.0
