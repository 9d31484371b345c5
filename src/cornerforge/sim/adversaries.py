"""How the controlled BV chooses: the learned policy, and the plain adversaries that every yield is compared with."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._elementary import exp, log
from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_ACT, PURPOSE_CAST, PURPOSE_EXPLORE, block, uniform
from cornerforge.drivers.policy import PolicyNumbers, best_action, q_values
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.world import N_DECISIONS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from cornerforge.sim.world import World

__all__ = [
    "ADVERSARIES",
    "NO_CAST",
    "Cast",
    "ChoiceScratch",
    "allocate_choice_scratch",
    "cast_index",
    "cast_member",
    "cast_of",
    "choose_action",
    "sample_action",
]

NOBODY, POLICY, UNIFORM, LANE_CHANGER, SWERVE = range(5)
ADVERSARIES = {"nobody": NOBODY, "policy": POLICY, "uniform": UNIFORM, "lane-changer": LANE_CHANGER, "swerve": SWERVE}
"""nobody: natural driving. policy: a Q-network. uniform: any allowed action. lane-changer: changes lanes two
times in three. swerve: draws level with the AV in the next lane, then changes into it."""


class ChoiceScratch(NamedTuple):
    """Scratch for one choice at a time; `p` and `attentive` are for probabilities of actions."""

    observation: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    p: NDArray[np.float64]
    attentive: NDArray[np.float64]
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
        rest = _pick_allowed(s.allowed, 2, 33, draw)
        # In a running change that every attentive driver would break off, turning back is all that is left.
        return rest if rest >= 0 else _pick_allowed(s.allowed, 0, 33, draw)
    return _swerve(w, bv, s.allowed)


@kernel
def sample_action(
    w: World, bv: int, temperature: float, seed: int, test: int, policy: PolicyNumbers, s: ChoiceScratch
) -> tuple[int, float]:
    """A policy's action, one of those marked in `s.allowed`; at temperature 0 the best, else drawn by exp(Q / T).

    Args:
        w: The world.
        bv: Slot of the controlled BV.
        temperature: In units of Q (chance of a crash), 0 or more.
        seed, test: Name the random numbers.
        policy: The network.
        s: Scratch; `s.observation` and `s.allowed` must be filled. Its `q` is overwritten.

    Returns:
        The action, and the natural log of its probability under the policy (0 for the best).
    """
    q_values(policy, s.observation, s.layers, s.q)
    best = best_action(s.q, s.allowed)
    if temperature <= 0.0:
        return best, 0.0
    most = np.float64(s.q[best])
    total = 0.0
    for a in range(33):
        if s.allowed[a]:
            total += exp((s.q[a] - most) / temperature)
    draw = total * uniform(block(seed, test, w.info[N_DECISIONS], bv, PURPOSE_ACT)[0])
    chosen = best
    for a in range(33):
        if s.allowed[a]:
            weight = exp((s.q[a] - most) / temperature)
            if weight > 0.0:
                chosen = a
                draw -= weight
                if draw < 0.0:
                    break
    return chosen, (s.q[chosen] - most) / temperature - log(total)


class Cast(NamedTuple):
    """Policies of a mixture, each test driven by one of them.

    Attributes:
        weights: Those of all networks, one after the other, float32.
        members: One row per policy, int64 (K, 7): where its weights begin and end, n_inputs, n_shared, n_stream, width,
            and its mask: 0 unbounded, else its budget as in `observe.budget_units` plus 1. K = 0: no mixture.
    """

    weights: NDArray[np.float32]
    members: NDArray[np.int64]


_MEMBER_FIELDS = 7
NO_CAST = Cast(np.zeros(1, dtype=np.float32), np.zeros((0, _MEMBER_FIELDS), dtype=np.int64))


def cast_of(policies: Sequence[PolicyNumbers], bounded: Sequence[bool], budgets: Sequence[int]) -> Cast:
    """Put policies together to a mixture.

    Args:
        policies: At least one.
        bounded: Whose mask is the NDD-bounded one.
        budgets: Each one's budget in units (`observe.budget_units`); 0: no limit.
    """
    members = np.zeros((len(policies), _MEMBER_FIELDS), dtype=np.int64)
    begin = 0
    for row, policy, is_bounded, budget in zip(members, policies, bounded, budgets, strict=True):
        row[:2] = begin, begin + policy.weights.size
        row[2:6] = policy[1:]
        row[6] = budget + 1 if is_bounded else 0
        begin += policy.weights.size
    return Cast(np.concatenate([policy.weights for policy in policies]), members)


@kernel
def cast_index(seed: int, test: int, n: int) -> int:
    """Which of n policies drives a test: each is as likely, whatever the others do; 0 for a single one."""
    draw = uniform(block(seed, test, 0, 0, PURPOSE_CAST)[0])
    return min(n - 1, math.floor(draw * n))


@kernel
def cast_member(cast: Cast, index: int) -> PolicyNumbers:
    """The network of one policy of a mixture, as views."""
    row = cast.members[index]
    return PolicyNumbers(cast.weights[row[0] : row[1]], row[2], row[3], row[4], row[5])
