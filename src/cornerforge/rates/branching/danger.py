"""How dangerous a BV is to the AV at a moment: what is seen of both, and a small network that was taught by crashes.

The number is used to decide which worlds are worth driving on, and never enters a rate by itself: a wrong one costs
tests, not truth (docs/adr/0030-natural-rates.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._elementary import exp, log
from cornerforge._jit import inlined_kernel, kernel
from cornerforge.rates.branching.at_site import see_meeting
from cornerforge.road.straight import ahead_by, distance_left, half_lengths, half_widths
from cornerforge.site.tables import at_site

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim import World

__all__ = [
    "N_SEEN",
    "REACH",
    "WIDTH",
    "Ahead",
    "Intent",
    "Network",
    "add_ahead",
    "danger",
    "look_ahead",
    "look_at",
    "untaught",
]

N_SEEN = 29
"""Numbers that are seen of a BV and the AV."""
WIDTH = 24
"""Width of both hidden layers."""
REACH = 90.0
"""BVs further from the AV than this are not looked at [m, centre to centre]."""
_LEAST_CHANCE = 1e-9
_SOON, _AV_BRAKES, _AV_BRAKES_MOST = 2.5, 6.0, 4.0


class Network(NamedTuple):
    """log danger of what is seen: two hidden layers with ReLU; float32.

    Attributes:
        first, first_bias: (N_SEEN, WIDTH), (WIDTH,).
        second, second_bias: (WIDTH, WIDTH), (WIDTH,).
        last: (WIDTH + 1,), the bias at the end.
    """

    first: NDArray[np.float32]
    first_bias: NDArray[np.float32]
    second: NDArray[np.float32]
    second_bias: NDArray[np.float32]
    last: NDArray[np.float32]


def untaught(danger: float) -> Network:
    """Make a network that gives every BV the same danger."""
    last = np.zeros(WIDTH + 1, dtype=np.float32)
    last[WIDTH] = np.log(danger)
    return Network(
        np.zeros((N_SEEN, WIDTH), dtype=np.float32),
        np.zeros(WIDTH, dtype=np.float32),
        np.zeros((WIDTH, WIDTH), dtype=np.float32),
        np.zeros(WIDTH, dtype=np.float32),
        last,
    )


class Intent(NamedTuple):
    """Known part of a BV's motion in the coming second.

    Attributes:
        lane: Its target lane.
        left: How long its lane change still lasts [s], 0 for none.
        away: 1 its driver looks away, -1 it does not, 0 not known.
        toward: Chance that it begins a change towards the AV, 0 where that is decided.
    """

    lane: int
    left: float
    away: float
    toward: float


class Ahead(NamedTuple):
    """Danger ahead of the AV in its lanes, or coming there: braking needed to avoid it [m/s2]; least time gap [s]."""

    braking: float
    time_gap: float


@inlined_kernel
def _braking(gap: float, closing: float) -> float:
    """Compute the deceleration that ends the closing within a gap [m/s2]; at most 20."""
    if closing <= 0.0:
        return 0.0
    return min(20.0, 0.5 * closing * closing / max(gap, 0.5))


@inlined_kernel
def add_ahead(w: World, i: int, before: Ahead) -> Ahead:
    """Add BV i, ahead of the AV and in its lanes or about to be, to what is ahead."""
    v = w.vehicles
    gap = ahead_by(v, 0, i) - half_lengths(v, 0, i)
    braking = max(before.braking, _braking(gap, v[0].speed - v[i].speed))
    return Ahead(braking, min(before.time_gap, max(gap, 0.0) / max(v[0].speed, 1.0)))


@inlined_kernel
def look_ahead(w: World) -> Ahead:
    """Look what is ahead of the AV."""
    v = w.vehicles
    ahead = Ahead(0.0, 10.0)
    for i in range(1, w.state[0].n_vehicles):
        if v[i].present and v[i].lanes & v[0].lanes:
            dx = ahead_by(v, 0, i)
            if 0.0 < dx < 200.0:
                ahead = add_ahead(w, i, ahead)
    return ahead


@inlined_kernel
def _braking_for(ahead: Ahead) -> float:
    """Guess how hard the AV will brake for what is ahead [m/s2]: as needed, or to get back to a time gap of 1 s."""
    short = 1.0 / max(ahead.time_gap, 0.1)
    return min(_AV_BRAKES_MOST, max(ahead.braking, 1.5 * (short * short - 1.0)))


@inlined_kernel
def _log10(x: float) -> float:
    return 0.4342944819032518 * log(max(x, _LEAST_CHANCE))


@kernel
def look_at(
    w: World, i: int, intent: Intent, away_chance: float, ahead: Ahead, road: RoadNumbers,
    seen: NDArray[np.float32],
) -> None:  # fmt: skip
    """Fill `seen` (N_SEEN,) with what is seen of BV i and the AV; left and right look alike.

    Args:
        w: The world.
        i: Slot of the BV; at a site it has looked around (`at_site.see_meeting` says what is seen there).
        intent: What is known of it.
        away_chance: Chance that its driver looks away in the coming second.
        ahead: What is ahead of the AV.
        road: Constants.
        seen: Where the numbers go. The last one, 1 for a BV that is beside the AV or will be within seconds, less the
            further off it is, says how much it is worth to find out what happens (`trees`).
    """
    if at_site(road.site):
        see_meeting(w, i, intent.away, intent.toward, away_chance, road.site, seen)
        return
    v = w.vehicles
    dx = ahead_by(v, 0, i)
    sign = 1.0 if dx >= 0.0 else -1.0
    gap = sign * dx - half_lengths(v, 0, i)
    closing = sign * (v[0].speed - v[i].speed)
    dy = v[i].y - v[0].y
    side = 1.0 if dy >= 0.0 else -1.0
    lanes_apart = abs(intent.lane - v[0].target_lane)
    rear_speed = v[0].speed if sign > 0.0 else v[i].speed
    seen[0] = min(max(gap, -10.0), 80.0) * 0.05
    seen[1] = 1.0 / (1.0 + max(gap, 0.0) * 0.3)
    seen[2] = sign
    seen[3] = min(max(closing, -15.0), 15.0) * 0.2
    seen[4] = _braking(gap, closing) * 0.2
    seen[5] = min(side * dy - half_widths(v, 0, i), 8.0) * 0.3
    seen[6] = side * (v[0].lateral_speed - v[i].lateral_speed)
    seen[7] = 1.0 if lanes_apart == 0 else 0.0
    seen[8] = 1.0 if lanes_apart == 1 else 0.0
    seen[9] = min(intent.left, 6.0) * 0.2
    seen[10] = v[i].acceleration * 0.25
    seen[11] = v[0].acceleration * 0.25
    seen[12] = v[i].away
    seen[13] = intent.away
    seen[14] = v[i].quantile - 0.5
    seen[15] = min(max(gap, 0.0) / max(rear_speed, 1.0), 3.0)
    seen[16] = min(ahead.braking, 10.0) * 0.2
    seen[17] = 1.0 / (0.3 + ahead.time_gap)
    seen[18] = 1.0 + _log10(intent.toward) * 0.2
    seen[19] = 1.0 + _log10(away_chance) * 0.25
    seen[20] = min(max(distance_left(v, 0, road), 0.0) / max(v[0].speed, 1.0), 10.0) * 0.1
    seen[21] = 1.0 if v[0].duration > 0.0 else 0.0
    seen[22] = 1.0 if v[i].lanes & v[0].lanes else 0.0
    seen[23] = seen[4] * sign
    soon = gap - _SOON * closing
    seen[24] = min(max(soon, -10.0), 60.0) * 0.05
    slows = _braking_for(ahead)
    left = soon - (0.5 * slows * _SOON * _SOON if sign < 0.0 else 0.0)
    seen[25] = slows * 0.25
    seen[26] = min(max(left, -10.0), 60.0) * 0.05
    seen[27] = 1.0 / (1.0 + max(left, 0.0) * 0.3)
    seen[28] = 1.0 / (1.0 + max(soon - (_AV_BRAKES if sign < 0.0 else 0.0), 0.0) * 0.3)


@inlined_kernel
def _add_layer(values: NDArray[np.float32], weights: NDArray[np.float32], sums: NDArray[np.float32]) -> None:
    """Add what values give with their rows of weights to `sums`, and cut the sums off at 0.

    Four rows at a time: a sum is then loaded and stored a quarter as often, which takes most of the time.
    """
    rows = weights.shape[0]
    fours = rows - rows % 4
    for i in range(0, fours, 4):
        a, b, c, d = values[i], values[i + 1], values[i + 2], values[i + 3]
        for o in range(WIDTH):
            sums[o] += a * weights[i, o] + b * weights[i + 1, o] + c * weights[i + 2, o] + d * weights[i + 3, o]
    for i in range(fours, rows):
        for o in range(WIDTH):
            sums[o] += values[i] * weights[i, o]
    for o in range(WIDTH):
        sums[o] = max(sums[o], np.float32(0.0))


@kernel
def danger(network: Network, seen: NDArray[np.float32], layers: NDArray[np.float32]) -> float:
    """Compute the danger of what is seen, above 0 and at most 1; `layers`: scratch, float32 (2, WIDTH)."""
    for o in range(WIDTH):
        layers[0, o] = network.first_bias[o]
        layers[1, o] = network.second_bias[o]
    _add_layer(seen, network.first, layers[0])
    _add_layer(layers[0], network.second, layers[1])
    total = np.float64(network.last[WIDTH])
    for i in range(WIDTH):
        total += layers[1, i] * network.last[i]
    return exp(min(max(total, -40.0), 0.0))
