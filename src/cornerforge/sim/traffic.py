"""Traffic at the start of a test, drawn from the naturalistic model's initial state (DESIGN section 4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cornerforge._elementary import exp, log
from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_INITIAL, block, normal_pair, uniform
from cornerforge.drivers.idm import desired_gap
from cornerforge.geometry import lane_centre
from cornerforge.sim.world import CONTROLLED, INFO_FIELDS, N_VEHICLES, all_current

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.sim.world import AvNumbers, RoadNumbers, World

__all__ = ["reset_world"]

_MAX_TRIES = 200


@kernel
def _draw_speed(seed: int, test: int, initial: NDArray[np.float64], draw: int) -> tuple[float, int]:
    """A speed of the truncated normal [m/s], and the number of the next unused draw."""
    while True:
        words = block(seed, test, draw, 0, PURPOSE_INITIAL)
        draw += 1
        speed = initial[0] + initial[1] * normal_pair(words[0], words[1])[0]
        if initial[2] <= speed <= initial[3]:
            return speed, draw


@kernel
def _draw_neighbour(
    seed: int, test: int, initial: NDArray[np.float64], draw: int, speed: float, ahead: bool
) -> tuple[float, float, int]:
    """Gap [m] and speed [m/s] of the next vehicle ahead of (or behind) one that drives at `speed`, and the next draw.

    The chain of speeds is reversible, so that the same law serves both directions.
    """
    gap = initial[11]
    other = speed
    for _ in range(_MAX_TRIES):
        words = block(seed, test, draw, 0, PURPOSE_INITIAL)
        draw += 1
        z_gap, z_speed = normal_pair(words[0], words[1])
        follows = uniform(words[2]) < initial[4]
        time_gap = initial[5] * exp(initial[6] * z_gap)
        gap = speed * time_gap if follows else initial[10] + (initial[11] - initial[10]) * uniform(words[3])
        scale = initial[7] * exp(initial[8] * log(gap / 20.0))
        other = (
            initial[0]
            + (1.0 - scale * scale / (2.0 * initial[1] * initial[1])) * (speed - initial[0])
            + scale * z_speed
        )
        if follows and not ahead:
            gap = other * time_gap
        closing = speed - other if ahead else other - speed
        legal = initial[2] <= other <= initial[3] and gap >= 1.0 and (not follows or gap <= initial[10])
        if legal and gap >= initial[9] * closing:
            return gap, other, draw
    return initial[11], speed, draw


@kernel
def _place(w: World, slot: int, x: float, lane: int, speed: float, road: RoadNumbers) -> None:
    v = w.vehicles
    speed = min(speed, road.max_speed)
    v[slot].x = x
    v[slot].y = lane_centre(lane, road.lane_width)
    v[slot].speed = speed
    v[slot].x_held = x
    v[slot].speed_held = speed
    v[slot].lateral_speed = 0.0
    v[slot].heading = 0.0
    v[slot].acceleration = 0.0
    v[slot].clock = 0.0
    v[slot].duration = 0.0
    v[slot].target_lane = lane
    v[slot].lanes = 1 << lane
    v[slot].present = 1
    v[slot].action = -1


@kernel
def _fill_ahead(
    w: World, n: int, draw: int, x: float, speed: float, lane: int, first_gap: float, seed: int, test: int,
    road: RoadNumbers, initial: NDArray[np.float64],
) -> tuple[int, int]:  # fmt: skip
    """Chain vehicles ahead of (x, speed) up to the end of the traffic; the first at no less than `first_gap`."""
    v = w.vehicles
    while True:
        gap, speed, draw = _draw_neighbour(seed, test, initial, draw, speed, True)
        x += road.length + max(gap, first_gap)
        first_gap = 0.0
        if x > road.traffic_length or n >= v.size:
            return n, draw
        _place(w, n, x, lane, speed, road)
        n += 1


@kernel
def reset_world(w: World, seed: int, test: int, road: RoadNumbers, av: AvNumbers, initial: NDArray[np.float64]) -> None:
    """Put test `test` of `seed` at its start: the AV in slot 0 at `av_start`, then its lane, then the others.

    The AV's lead stands no nearer than the AV's own desired gap: starting closer makes crashes of its own.
    """
    v = w.vehicles
    order = w.order
    info = w.info
    for i in range(INFO_FIELDS):
        info[i] = 0
    for i in range(v.size):
        v[i].present = 0
    words = block(seed, test, 0, 0, PURPOSE_INITIAL)
    av_lane = min(road.n_lanes - 1, math.floor(uniform(words[0]) * road.n_lanes))
    speed, draw = _draw_speed(seed, test, initial, 1)
    speed = min(speed, road.max_speed)
    _place(w, 0, road.av_start, av_lane, speed, road)

    # The lead's speed decides the AV's desired gap, so the first link of the AV's chain is drawn here.
    gap, lead_speed, draw = _draw_neighbour(seed, test, initial, draw, speed, True)
    x = road.av_start + road.length + max(gap, desired_gap(speed, lead_speed - speed, av.idm))
    n = 1
    if x <= road.traffic_length:
        _place(w, n, x, av_lane, lead_speed, road)
        n, draw = _fill_ahead(w, n + 1, draw, x, lead_speed, av_lane, 0.0, seed, test, road, initial)
    x = road.av_start
    while True:
        gap, speed, draw = _draw_neighbour(seed, test, initial, draw, speed, False)
        x -= road.length + gap
        if x < 0.0 or n >= v.size:
            break
        _place(w, n, x, av_lane, speed, road)
        n += 1
    for lane in range(road.n_lanes):
        if lane != av_lane:
            words = block(seed, test, draw, 0, PURPOSE_INITIAL)
            speed, draw = _draw_speed(seed, test, initial, draw + 1)
            x = -initial[10] * uniform(words[0])
            n, draw = _fill_ahead(w, n, draw, x, speed, lane, 0.0, seed, test, road, initial)
    info[N_VEHICLES] = n
    info[CONTROLLED] = -1
    for i in range(n):
        order[i] = i
    all_current(w)
