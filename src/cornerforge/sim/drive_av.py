"""One second of driving as a learning step of the AV, compiled; what `drive_bv.py` is for the adversary."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_EXPLORE, block, uniform
from cornerforge.drivers.policy import best_action, q_values
from cornerforge.sim.adversaries import choose_action
from cornerforge.sim.av import av_decide
from cornerforge.sim.av_features import av_actions_allowed, av_features, av_order
from cornerforge.sim.av_kinds import DECIDES_EVERY
from cornerforge.sim.av_view import view_of_av
from cornerforge.sim.drive import world_row
from cornerforge.sim.neighbours import nearest_bv, neighbours_in_lane
from cornerforge.sim.observe import allowed_actions
from cornerforge.sim.step import SUBSTEPS, av_acts, begin_second, move_on
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import AV_CRASH, CONTROLLED, N_DECISIONS, OUTCOME
from cornerforge.types import ACCELERATIONS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cornerforge.sim.adversaries import ChoiceScratch
    from cornerforge.sim.drive import Setting
    from cornerforge.sim.drive_bv import Transitions
    from cornerforge.sim.reach import Pairs
    from cornerforge.sim.world import RoadNumbers, World

__all__ = ["AV_DECISIONS", "AvReward", "collect_av", "start_av_worlds"]

AV_DECISIONS = SUBSTEPS // DECIDES_EVERY
"""Decisions of the learned AV in a second."""
_ACCELERATIONS = ACCELERATIONS


class AvReward(NamedTuple):
    """What the AV is paid for half a second of driving; a crash costs 1, whoever is at fault.

    Attributes:
        progress: Paid in full at 35 m/s, nothing at 20 m/s, in proportion to the speed in between and below.
        acceleration: Cost at 4 m/s2 braking or accelerating, in proportion.
        lane_change: Cost of beginning or turning a lane change.
        nearness: Cost of driving bumper to bumper behind a lead in any lane that it is in, and while it changes lanes
            before a follower in its target lane; nothing at a time gap of `time_gap` [s], in proportion in between.
        time_gap: See there.
    """

    progress: float
    acceleration: float
    lane_change: float
    nearness: float
    time_gap: float


@kernel
def _lack(gap: float, speed: float, time_gap: float) -> float:
    """How much of a time gap is lacking, 0 to 1."""
    return min(1.0, max(0.0, 1.0 - gap / (time_gap * max(speed, 1.0))))


@kernel
def _nearness(w: World, time_gap: float, road: RoadNumbers) -> float:
    """The largest lack of a time gap ahead of the AV, and behind it in the lane that it changes to."""
    v = w.vehicles
    worst = 0.0
    for lane in range(road.n_lanes):
        if v[0].lanes & (1 << lane):
            lead, rear = neighbours_in_lane(w, 0, lane, road.lane_width, 1)
            if lead >= 0:
                worst = max(worst, _lack(v[lead].x - v[0].x - road.length, v[0].speed, time_gap))
            if rear >= 0 and v[0].duration > 0.0 and lane == v[0].target_lane:
                worst = max(worst, _lack(v[0].x - v[rear].x - road.length, v[rear].speed, time_gap))
    return worst


@kernel
def _reward(w: World, action: int, p: AvReward, road: RoadNumbers) -> float:
    """For the half second that ends now."""
    if w.info[OUTCOME] == AV_CRASH:
        return -1.0
    v = w.vehicles
    paid: float = p.progress * (v[0].speed - 20.0) / 15.0 - p.acceleration * abs(v[0].acceleration) / 4.0
    if action < 2:
        paid -= p.lane_change
    if p.nearness > 0.0:
        paid -= p.nearness * _nearness(w, p.time_gap, road)
    return paid


@kernel
def _look(
    w: World, setting: Setting, pairs: Pairs, observation: NDArray[np.float32], allowed: NDArray[np.bool_]
) -> None:
    """Fill the AV's observation and mask."""
    view_of_av(w, setting.road, pairs.av.found, pairs.av.seen)
    av_features(pairs.av.seen, setting.road, observation)
    av_actions_allowed(w, setting.road, allowed)


@kernel
def start_av_worlds(
    seed: int, tests: NDArray[np.int64], setting: Setting, worlds: World, pairs: Pairs,
    observation: NDArray[np.float32], allowed: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Put world b at the start of test tests[b]."""
    for b in range(tests.size):
        w = world_row(worlds, b)
        reset_world(w, seed, tests[b], setting.road, setting.av, setting.tables.initial)
        _look(w, setting, pairs, observation[b], allowed[b])


@kernel
def _as_idm_mobil(w: World, setting: Setting, allowed: NDArray[np.bool_]) -> int:
    """The action nearest to what IDM and MOBIL would do."""
    command, lane = av_decide(w, setting.road, setting.av)
    change = w.vehicles[0].target_lane - lane
    if change != 0:
        action = 0 if change < 0 else 1
        if allowed[action]:
            return action
    return 2 + max(0, min(30, math.floor((command + 4.0) * 5.0 + 0.5)))


@kernel
def _choose(
    w: World, step: int, seed: int, test: int, epsilon: float, setting: Setting, pairs: Pairs,
    observation: NDArray[np.float32], allowed: NDArray[np.bool_],
) -> int:  # fmt: skip
    """The AV's action: the best one, or with chance `epsilon` by turns that of IDM and MOBIL, and any.

    A drawn action that is not allowed becomes the next one that is.
    """
    words = block(seed, test, step, 0, PURPOSE_EXPLORE)
    if uniform(words[0]) < epsilon:
        if uniform(words[1]) < 0.5:
            return _as_idm_mobil(w, setting, allowed)
        action = min(32, math.floor(33.0 * uniform(words[2])))
        while not allowed[action]:
            action += 1
        return action
    q_values(setting.av.network, observation, pairs.av.layers, pairs.av.q)
    best: int = best_action(pairs.av.q, allowed)
    return best


@kernel
def _hostile_action(w: World, seed: int, test: int, kind: int, bounded: int, setting: Setting, s: ChoiceScratch) -> int:
    """Name the controlled BV and choose its action; -1 for nobody."""
    w.info[CONTROLLED] = -1
    if kind == 0:
        return -1
    bv = nearest_bv(w)
    if bv < 0:
        return -1
    w.info[CONTROLLED] = bv
    allowed_actions(w, bv, bounded, setting.road, setting.tables, s.starters, s.p, s.allowed)
    action: int = choose_action(w, bv, kind, 0.0, seed, test, setting.policy, s)
    return action


@kernel
def collect_av(
    seed: int, tests: NDArray[np.int64], epsilon: float, setting: Setting, mix: NDArray[np.int64], reward: AvReward,
    worlds: World, pairs: Pairs, s: ChoiceScratch, recording: NDArray[np.void],
    observation: NDArray[np.float32], allowed: NDArray[np.bool_], out: Transitions, finished: NDArray[np.int64],
) -> int:  # fmt: skip
    """One second of each world, in which the AV decides twice; fewer times where a test ends before.

    Only a crash is an end: a test that is over goes on for the learner, though it is seen no more.

    Args:
        seed: Names the random numbers, with `tests`.
        tests: Each world's test, int64 (B,); a world that ends goes on with its test number plus B.
        epsilon: Chance of exploring.
        setting: The run; `road.av_substeps` must be that of the learned AV, `av.network` is the one that acts.
        mix: Adversaries by turns, int64 (M, 2): kind (`ADVERSARIES`, 0 nobody) and mask of test t in row t mod M.
        reward: Weights.
        worlds, observation, allowed: State of B worlds and the AV's view of it.
        pairs, s, recording: Scratch; `recording` of size 0.
        out: Room for 2 B transitions.
        finished: Counts tests, AV crashes, and AV crashes in tests without an adversary.

    Returns:
        Number of transitions written.
    """
    rows = 0
    road = setting.road
    for b in range(tests.size):
        w = world_row(worlds, b)
        kind = mix[tests[b] % mix.shape[0], 0]
        hostile = _hostile_action(w, seed, tests[b], kind, mix[tests[b] % mix.shape[0], 1], setting, s)
        first = AV_DECISIONS * w.info[N_DECISIONS]
        n_pairs = 0
        for part in range(AV_DECISIONS):
            action = _choose(w, first + part, seed, tests[b], epsilon, setting, pairs, observation[b], allowed[b])
            for k in range(observation.shape[1]):
                out.observation[rows, k] = observation[b, k]
            command, lane = av_order(w, action, _ACCELERATIONS)
            if part == 0:
                n_pairs = begin_second(
                    w, seed, tests[b], setting.bv_model, hostile, command, lane, True, road, setting.av,
                    setting.tables, pairs,
                )  # fmt: skip
            else:
                av_acts(w, command, lane, road)
            ends = False
            for k in range(DECIDES_EVERY):
                if move_on(w, DECIDES_EVERY * part + k, pairs, n_pairs, road, recording):
                    ends = True
                    break
            _look(w, setting, pairs, observation[b], allowed[b])
            crashed = w.info[OUTCOME] == AV_CRASH
            out.action[rows] = action
            out.reward[rows] = _reward(w, action, reward, road)
            out.end[rows] = crashed
            for k in range(observation.shape[1]):
                out.next_observation[rows, k] = observation[b, k]
            for a in range(33):
                out.next_allowed[rows, a] = allowed[b, a]
            rows += 1
            if ends:
                finished[0] += 1
                finished[1] += crashed
                finished[2] += crashed and kind == 0
                tests[b] += tests.size
                reset_world(w, seed, tests[b], road, setting.av, setting.tables.initial)
                _look(w, setting, pairs, observation[b], allowed[b])
                break
    return rows
