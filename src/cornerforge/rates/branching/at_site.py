"""Danger and acts at a site: when another and the AV are at their common zone, and what another may do in a second.

`danger` and `acts` call it where a road has its own. An act at a site is that an agent goes where it has to choose, or
that its driver looks away; both are draws of `choice.draw_action`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._elementary import log
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.sim import ALL_OF_THEM, away_chance, look_around, meeting_with_av, steering
from cornerforge.site.tables import CROSS, NO_ZONE, SHARED
from cornerforge.types import PERSON, TRUCK

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim import World

__all__ = ["N_SEEN_AT_SITE", "note_agent", "see_meeting"]

N_SEEN_AT_SITE = 29
"""Numbers that are seen of an agent and the AV at a site, as many as on a road."""
_FAR = 15.0
"""Agents whose meeting with the AV is later than this are not looked at [s]."""
_MOST_BRAKING = 20.0
_ASKS_AV, _BEHIND_AV = 3.0, 0.7
"""Least worth of finding out what one does that chooses because of the AV, or that follows it in its lane: with errors
at 4 % 115 of 120 crashes of `idm-yield` began so, 95 with such a choice, of which a test has a quarter."""


@inlined_kernel
def _braking(speed: float, room: float) -> float:
    """Compute the deceleration with which a vehicle stops within a room [m/s2]; at most 20."""
    return min(_MOST_BRAKING, 0.5 * speed * speed / max(room, 0.5))


@inlined_kernel
def _cut(value: float) -> float:
    return max(-3.0, min(3.0, value))


@inlined_kernel
def _log10(x: float) -> float:
    return 0.4342944819032518 * log(max(x, 1e-9))


@kernel
def note_agent(w: World, i: int, site: NDArray[np.void], near: Any) -> bool:
    """Let the agent in slot i look around, and note with which words it goes; False: it does not meet the AV soon."""
    met = meeting_with_av(w, i, site)
    if met.kind == NO_ZONE or min(met.av_time, met.time) > _FAR:
        return False
    look_around(w, i, site)
    own = w.agents[i]
    near.slot = i
    near.lane = 0
    near.old_lane = -1
    near.left = 1.0  # so that what is known of its going stays known where it looks away
    near.low = steering.words_below(own.goes) if own.chooses else 0
    near.high = 0
    near.toward = own.goes
    near.away = away_chance(w, i, site)
    return True


@kernel
def see_meeting(
    w: World, i: int, away: float, toward: float, away_chance_now: float, site: NDArray[np.void],
    seen: NDArray[np.float32],
) -> None:  # fmt: skip
    """Fill `seen` (29,) with what is seen of the agent in slot i, which has looked around, and the AV.

    Of both: time to their common zone, distance to it, speed, acceleration, and the braking needed to stop before it;
    in one lane the time gap, the gap and the braking that ends the closing. How their times differ; classes; the kind
    of the zone and who yields; what each has decided and overlooks. `away` and `toward`: as of `danger.Intent`; the
    last number says how much it is worth to find out what happens.
    """
    v, av, own = w.vehicles, w.agents[0], w.agents[i]
    met = meeting_with_av(w, i, site)
    follows = met.kind == SHARED
    rear, front = (0, i) if met.ahead > 0.0 else (i, 0)
    closing = max(v[rear].speed - v[front].speed, 0.0)
    apart = met.time - met.av_time
    decided = own.cleared > met.begins or (own.chooses != 0 and toward == 1.0)
    seen[0] = _cut(0.2 * met.av_time)
    seen[1] = _cut(0.2 * met.time)
    seen[2] = met.ahead
    seen[3] = _cut(0.5 * apart)
    seen[4] = 1.0 / (1.0 + 0.7 * abs(apart))
    seen[5] = 0.1 * v[0].speed
    seen[6] = 0.1 * v[i].speed
    seen[7] = _cut(met.av_room / 20.0)
    seen[8] = _cut(met.room / 20.0)
    seen[9] = 0.2 * (_braking(closing, met.room) if follows else _braking(v[0].speed, met.av_room))
    seen[10] = 0.0 if follows else 0.2 * _braking(v[i].speed, met.room)
    seen[11] = 1.0 if v[i].kind == PERSON else 0.0
    seen[12] = 1.0 if v[i].kind == TRUCK else 0.0
    seen[13] = 1.0 if met.kind == CROSS else 0.0
    seen[14] = 1.0 if follows else 0.0
    seen[15] = met.yields
    seen[16] = 1.0 / (1.0 + 0.5 * min(met.av_time, met.time))
    seen[17] = away
    seen[18] = own.chooses
    seen[19] = 1.0 + 0.2 * _log10(toward)
    seen[20] = 1.0 + 0.25 * _log10(away_chance_now)
    seen[21] = 1.0 if own.for_whom == 0 else 0.0
    seen[22] = 1.0 if own.overlooks == 0 or own.overlooks == ALL_OF_THEM else 0.0
    seen[23] = 0.25 * v[0].acceleration
    seen[24] = 0.25 * v[i].acceleration
    seen[25] = 1.0 if decided else 0.0
    seen[26] = 1.0 if av.cleared > av.s + met.av_room else 0.0
    seen[27] = v[i].away
    worth = 0.4 * seen[16] * seen[4] * min(1.0, 0.1 * (v[0].speed + v[i].speed))
    if own.chooses and own.for_whom == 0:
        worth = _ASKS_AV
    elif met.ahead < 0.0:
        worth = max(worth, _BEHIND_AV)
    seen[28] = worth
