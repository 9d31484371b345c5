"""How the controlled BV chooses: the learned policy, and the plain adversaries that every yield is compared with."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_EXPLORE, block, uniform
from cornerforge.drivers.policy import best_action, q_values
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.world import N_DECISIONS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.policy import PolicyNumbers
    from cornerforge.sim.world import World

__all__ = ["ADVERSARIES", "ChoiceScratch", "allocate_choice_scratch", "choose_action"]

NOBODY, POLICY, UNIFORM, LANE_CHANGER, SWERVE = range(5)
ADVERSARIES = {"nobody": NOBODY, "policy": POLICY, "uniform": UNIFORM, "lane-changer": LANE_CHANGER, "swerve": SWERVE}
"""nobody: natural driving. policy: the Q-network, greedy. uniform: any allowed action. lane-changer: changes lanes two
times in three. swerve: draws level with the AV in the next lane, then changes into it."""


class ChoiceScratch(NamedTuple):
    """Scratch for one choice at a time."""

    observation: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    p: NDArray[np.float64]
    q: NDArray[np.float32]
    layers: NDArray[np.float32]
    found: NDArray[np.int64]


def allocate_choice_scratch(policy: PolicyNumbers) -> ChoiceScratch:
    """Scratch that fits a policy."""
    widest = max(policy.width, policy.n_inputs, 33)
    return ChoiceScratch(
        np.zeros(N_OBSERVATION, dtype=np.float32),
        np.zeros(33, dtype=np.bool_),
        np.zeros(33),
        np.zeros(33, dtype=np.float32),
        np.zeros((4, widest), dtype=np.float32),
        np.zeros(4, dtype=np.int64),
    )


@kernel
def _pick_allowed(allowed: NDArray[np.bool_], first: int, end: int, draw: float) -> int:
    """A uniformly drawn allowed action in [first, end), -1 when there is none."""
    count = 0
    for a in range(first, end):
        if allowed[a]:
            count += 1
    rank = min(count - 1, math.floor(draw * count))
    for a in range(first, end):
        if allowed[a]:
            if rank == 0:
                return a
            rank -= 1
    return -1


@kernel
def _nearest_allowed(acceleration: float, allowed: NDArray[np.bool_]) -> int:
    """The allowed acceleration action nearest to a wish [m/s2]; the first allowed action when there is none."""
    best = -1
    for a in range(2, 33):
        wished = abs(-4.0 + 0.2 * (a - 2) - acceleration)
        if allowed[a] and (best < 0 or wished < abs(-4.0 + 0.2 * (best - 2) - acceleration)):
            best = a
    return best if best >= 0 else _pick_allowed(allowed, 0, 33, 0.0)


@kernel
def _swerve(w: World, bv: int, allowed: NDArray[np.bool_]) -> int:
    """Draw level a little behind the AV in the next lane, then change into its lane."""
    v = w.vehicles
    dx = v[bv].x - v[0].x
    lanes_left = v[0].target_lane - v[bv].target_lane
    level = abs(dx + 1.0) < 3.0
    toward = 0 if lanes_left > 0 else 1
    if abs(lanes_left) == 1 and level and allowed[toward]:
        return toward
    if abs(lanes_left) > 1 and allowed[toward]:
        return toward
    if lanes_left == 0 and v[bv].duration == 0.0 and abs(dx) > 10.0:
        if allowed[0]:
            return 0
        if allowed[1]:
            return 1
    return _nearest_allowed(0.4 * (-1.0 - dx) + 1.0 * (v[0].speed - v[bv].speed), allowed)


@kernel
def choose_action(
    w: World, bv: int, kind: int, epsilon: float, seed: int, test: int, policy: PolicyNumbers, s: ChoiceScratch
) -> int:
    """The controlled BV's action, one of those marked in `s.allowed`; `s.observation` must be filled for the policy.

    Args:
        w: The world.
        bv: Slot of the controlled BV.
        kind: One of ADVERSARIES' values but 0.
        epsilon: Chance of a uniformly drawn allowed action instead.
        seed, test: Name the random numbers.
        policy: The network, used by kind 1 only.
        s: Scratch.
    """
    info = w.info
    words = block(seed, test, info[N_DECISIONS], bv, PURPOSE_EXPLORE)
    draw = uniform(words[1])
    if kind == UNIFORM or (epsilon > 0.0 and uniform(words[0]) < epsilon):
        return _pick_allowed(s.allowed, 0, 33, draw)
    if kind == POLICY:
        q_values(policy, s.observation, s.layers, s.q)
        return best_action(s.q, s.allowed)
    if kind == LANE_CHANGER:
        if uniform(words[0]) < 2.0 / 3.0:
            change = _pick_allowed(s.allowed, 0, 2, draw)
            if change >= 0:
                return change
        return _pick_allowed(s.allowed, 2, 33, draw)
    return _swerve(w, bv, s.allowed)
