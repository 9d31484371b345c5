"""How the adversary chooses for the controlled BV: a learned policy, and the plain rules that it is compared with."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cornerforge._elementary import exp, log
from cornerforge._jit import inlined_kernel, kernel, kernel_by_code
from cornerforge._philox import PURPOSE_ACT, PURPOSE_EXPLORE, block, uniform
from cornerforge.drivers.policy import HEADS, best_action, q_values
from cornerforge.road.straight import ahead_by
from cornerforge.sim.controllers import ADVERSARIES, POLICY
from cornerforge.sim.site.choice import GIVES_WAY, GOES, WALKS
from cornerforge.sim.site.people import AT_KERB
from cornerforge.sim.site.views import (
    AHEAD,
    AV_ROOM,
    AV_SPEED,
    AV_TIME,
    LIGHT,
    MERGES,
    PER_METRE,
    PER_MPS,
    PER_SECOND,
    ROOM,
    TIME,
    TURN,
    YIELDS,
)
from cornerforge.sim.world import moment_of
from cornerforge.types import ACTION_ACCELERATIONS, ACTION_LEFT, ACTION_RIGHT, FIRST_ACCELERATION, N_ACTIONS, PERSON

if TYPE_CHECKING:
    from numpy import uint64
    from numpy.typing import NDArray

    from cornerforge.drivers.policy import PolicyNumbers
    from cornerforge.sim.scratch import ChoiceScratch
    from cornerforge.sim.world import World

    Words = tuple[uint64, uint64, uint64, uint64]

__all__ = ["choose_action"]

_WALKS = WALKS
_TOO_LATE, _HARD = 2.5, 2.0
"""A person darts out that the AV reaches within so long [s], if it would have to brake harder than this [m/s2]."""
_EARLIER, _LATER, _SOON = 1.5, 1.0, 5.0
"""A vehicle goes if it is at the zone at most so much before or after the AV, which is there soon [s]."""
_MOST = 4.0  # a vehicle aims at the AV with so much at most [m/s2]


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


@inlined_kernel
def _nearest_allowed(acceleration: float, allowed: NDArray[np.bool_]) -> int:
    """The allowed acceleration action nearest to a wish [m/s2]; else the first allowed action."""
    best = -1
    nearest = 0.0
    for a in range(FIRST_ACCELERATION, N_ACTIONS):
        wished = abs(ACTION_ACCELERATIONS[a] - acceleration)
        if allowed[a] and (best < 0 or wished < nearest):
            best = a
            nearest = wished
    return best if best >= 0 else _pick_allowed(allowed, 0, N_ACTIONS, 0.0)


@inlined_kernel
def _uniform(_w: World, _bv: int, words: Words, s: ChoiceScratch) -> int:
    """Any allowed action, one as likely as another."""
    return _pick_allowed(s.allowed, 0, N_ACTIONS, uniform(words[1]))


@inlined_kernel
def _lane_changer(_w: World, _bv: int, words: Words, s: ChoiceScratch) -> int:
    """Two times in three an allowed lane change, else an allowed acceleration."""
    draw = uniform(words[1])
    if uniform(words[0]) < 2.0 / 3.0:
        change = _pick_allowed(s.allowed, 0, FIRST_ACCELERATION, draw)
        if change >= 0:
            return change
    rest = _pick_allowed(s.allowed, FIRST_ACCELERATION, N_ACTIONS, draw)
    # In a running change that every attentive driver would break off, turning back is all that is left.
    return rest if rest >= 0 else _pick_allowed(s.allowed, 0, N_ACTIONS, draw)


@inlined_kernel
def _swerve(w: World, bv: int, _words: Words, s: ChoiceScratch) -> int:
    """Come level with the AV in the next lane, its centre 1 m behind, then change into the AV's lane."""
    v = w.vehicles
    allowed = s.allowed
    dx = ahead_by(v, 0, bv)
    lanes_left = v[0].target_lane - v[bv].target_lane
    level = abs(dx + 1.0) < 3.0
    toward = ACTION_LEFT if lanes_left > 0 else ACTION_RIGHT
    if abs(lanes_left) == 1 and level and allowed[toward]:
        return toward
    if abs(lanes_left) > 1 and allowed[toward]:
        return toward
    if lanes_left == 0 and v[bv].duration == 0.0 and abs(dx) > 10.0:
        if allowed[ACTION_LEFT]:
            return ACTION_LEFT
        if allowed[ACTION_RIGHT]:
            return ACTION_RIGHT
    return _nearest_allowed(0.4 * (-1.0 - dx) + 1.0 * (v[0].speed - v[bv].speed), allowed)


@kernel
def _lawful(w: World, bv: int, s: ChoiceScratch) -> int:
    """Do what an agent at a site most likely does, as far as it is allowed."""
    own = w.agents[bv]
    if own.chooses == 0:
        return _nearest_allowed(own.free, s.allowed)
    wished = GOES if own.goes >= 0.5 else GIVES_WAY
    return wished if s.allowed[wished] else _pick_allowed(s.allowed, 0, N_ACTIONS, 0.0)


@kernel
def _goes_on(w: World, bv: int, acceleration: float, s: ChoiceScratch) -> int:
    """Go if that is a choice now, else accelerate [m/s2], as far as it is allowed."""
    if w.agents[bv].chooses and s.allowed[GOES]:
        return GOES
    return _nearest_allowed(acceleration, s.allowed)


@kernel
def _meets_now(s: ChoiceScratch) -> bool:
    """Is the agent at the common zone at nearly the same time as the AV, soon, and not yet in it?"""
    seen = s.observation
    av_time, time = seen[AV_TIME] / PER_SECOND, seen[TIME] / PER_SECOND
    meets: bool = seen[AHEAD] == 0.0 and 0.0 < av_time < _SOON and -_EARLIER < time - av_time < _LATER
    return meets and seen[ROOM] > 0.0


@kernel
def _dart_out(w: World, bv: int, _words: Words, s: ChoiceScratch) -> int:
    """Leave the kerb when the AV can hardly stop, at the least speed that brings a person there before the AV.

    A vehicle does what its law says.
    """
    seen = s.observation
    room, speed = seen[AV_ROOM] / PER_METRE, seen[AV_SPEED] / PER_MPS
    time, way = seen[AV_TIME] / PER_SECOND, seen[ROOM] / PER_METRE
    at_kerb = w.agents[bv].s <= AT_KERB
    too_late = 0.0 < time < _TOO_LATE and 0.5 * speed * speed > _HARD * room
    if w.vehicles[bv].kind != PERSON or (at_kerb and not too_late) or time == 0.0:
        return _lawful(w, bv, s)
    best, chosen, needed = -1, 0.0, way / time
    for a in range(GOES, FIRST_ACCELERATION + _WALKS.size):
        walks = w.vehicles[bv].desired_speed if a == GOES else _WALKS[a - FIRST_ACCELERATION]
        better = walks > chosen if chosen < needed else needed <= walks < chosen
        if s.allowed[a] and (best < 0 or better):
            best, chosen = a, walks
    return best if best >= 0 else _lawful(w, bv, s)


@kernel
def _red_runner(w: World, bv: int, _words: Words, s: ChoiceScratch) -> int:
    """Go over a red or yellow light so that the vehicle meets the AV; else do what its law says."""
    seen = s.observation
    time, way = seen[AV_TIME] / PER_SECOND, seen[ROOM] / PER_METRE
    crosses = seen[AHEAD] == 0.0 and seen[MERGES] == 0.0 and 0.0 < time < 2.0 * _SOON and way > 0.0
    if w.vehicles[bv].kind == PERSON or seen[LIGHT] >= 0.0 or not crosses:
        return _lawful(w, bv, s)
    aims = 2.0 * (way - w.vehicles[bv].speed * time) / (time * time)
    return _goes_on(w, bv, aims, s) if _meets_now(s) or abs(aims) < _MOST else _lawful(w, bv, s)


@kernel
def _goes_before(w: World, bv: int, merges: bool, s: ChoiceScratch) -> int:
    """Go before the AV where a vehicle must yield to it and crosses its way, or merges; else do what its law says.

    It goes when it has to choose: one that pushed earlier would be seen, and let go.
    """
    seen = s.observation
    owes = w.vehicles[bv].kind != PERSON and seen[YIELDS] < 0.0 and (seen[MERGES] > 0.0) == merges
    if owes and w.agents[bv].chooses and s.allowed[GOES] and _meets_now(s):
        return GOES
    return _lawful(w, bv, s)


@inlined_kernel
def _turns_across(w: World, bv: int, _words: Words, s: ChoiceScratch) -> int:
    """A left turn goes before the AV."""
    return _goes_before(w, bv, False, s) if s.observation[TURN] > 0.0 else _lawful(w, bv, s)


@inlined_kernel
def _cuts_in(w: World, bv: int, _words: Words, s: ChoiceScratch) -> int:
    """A vehicle enters the AV's way before it."""
    return _goes_before(w, bv, True, s)


_RULES = {
    "uniform": _uniform,
    "lane-changer": _lane_changer,
    "swerve": _swerve,
    "dart-out": _dart_out,
    "red-runner": _red_runner,
    "turns-across": _turns_across,
    "cuts-in": _cuts_in,
}
"""The rule of each plain adversary. Each takes the world, the BV's slot, four random words of this decision, and
scratch that holds the mask, and at a site the observation; it returns an allowed action."""
_PLAIN = {name: code for name, code in ADVERSARIES.items() if name not in ("nobody", "policy")}
_rule_of: Any = kernel_by_code(_PLAIN, _RULES)


@inlined_kernel
def _best(_w: World, _bv: int, s: ChoiceScratch) -> tuple[int, float]:
    """The action of the largest value, and the natural log of its probability."""
    return best_action(s.q, s.allowed), 0.0


@kernel
def _draw(w: World, bv: int, temperature: float, s: ChoiceScratch) -> tuple[int, float]:
    """An action drawn with odds exp(value / T), and the natural log of its probability."""
    state = w.state[0]
    best = best_action(s.q, s.allowed)
    most = np.float64(s.q[best])
    total = 0.0
    for a in range(N_ACTIONS):
        if s.allowed[a]:
            total += exp((s.q[a] - most) / temperature)
    draw = total * uniform(block(state.seed, state.test, moment_of(w), bv, PURPOSE_ACT)[0])
    chosen = best
    for a in range(N_ACTIONS):
        if s.allowed[a]:
            weight = exp((s.q[a] - most) / temperature)
            if weight > 0.0:
                chosen = a
                draw -= weight
                if draw < 0.0:
                    break
    return chosen, (s.q[chosen] - most) / temperature - log(total)


@inlined_kernel
def _softmax(w: World, bv: int, s: ChoiceScratch) -> tuple[int, float]:
    """Draw at temperature 1."""
    action, log_prob = _draw(w, bv, 1.0, s)
    return action, log_prob


_act_by_head: Any = kernel_by_code(HEADS, {"greedy": _best, "softmax": _softmax})
"""What each head does with the values in the scratch."""


@kernel
def _act(w: World, bv: int, temperature: float, policy: PolicyNumbers, s: ChoiceScratch) -> tuple[int, float]:
    """Choose a policy's action, and give the natural log of its probability."""
    q_values(policy, s.observation, s.layers, s.q)
    if temperature < 0.0:
        action, log_prob = _act_by_head(policy.head, w, bv, s)
    elif temperature == 0.0:
        action, log_prob = _best(w, bv, s)
    else:
        action, log_prob = _draw(w, bv, temperature, s)
    return action, log_prob


@inlined_kernel
def choose_action(
    w: World, bv: int, kind: int, epsilon: float, temperature: float, policy: PolicyNumbers, s: ChoiceScratch
) -> tuple[int, float]:
    """Choose the controlled BV's action among the actions marked in `s.allowed`.

    Args:
        w: The world.
        bv: Slot of the controlled BV.
        kind: A code of ADVERSARIES except NOBODY.
        epsilon: Chance of a uniformly drawn allowed action instead.
        temperature: For POLICY: 0 for the best action, T in units of its values to draw by exp(value / T), or
            AS_LEARNED.
        policy: The network, for POLICY.
        s: Scratch; `s.allowed` must be filled, and for POLICY and at a site `s.observation`.

    Returns:
        The action, and the natural log of its probability under the policy that drew it; 0 where none drew it.
    """
    state = w.state[0]
    words = block(state.seed, state.test, moment_of(w), bv, PURPOSE_EXPLORE)
    if epsilon > 0.0 and uniform(words[0]) < epsilon:
        return _uniform(w, bv, words, s), 0.0
    if kind == POLICY:
        action, log_prob = _act(w, bv, temperature, policy, s)
        return action, log_prob
    plain: int = _rule_of(kind, w, bv, words, s)
    return plain, 0.0
