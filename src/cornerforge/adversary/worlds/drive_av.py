"""One second of driving as two learning steps of the AV, compiled; `drive_bv.py` is the same for the adversary."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import inlined_kernel, kernel
from cornerforge._philox import PURPOSE_EXPLORE, block, uniform
from cornerforge.drivers.policy import best_action, q_values
from cornerforge.drivers.sight import DECIDED
from cornerforge.road.straight import gap
from cornerforge.sim import (
    NEVER,
    OVER,
    Setting,
    World,
    actions,
    advance,
    allocate_worlds,
    answer_as_av,
    av_decide,
    av_features,
    controllers,
    neighbours,
    outcome,
    perception,
    reset_world,
    world_row,
)
from cornerforge.types import ACCELERATIONS, FIRST_ACCELERATION, N_ACTIONS, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.adversary.worlds.drive_bv import Transitions
    from cornerforge.road.straight import RoadNumbers
    from cornerforge.sim import Keep, Scratch

__all__ = [
    "AV_DECISIONS",
    "AV_FINISHED",
    "HOSTILE",
    "AvActors",
    "AvReward",
    "allocate_av_actors",
    "collect_av",
    "start_av_worlds",
]

AV_DECISIONS = SUBSTEPS // av_features.DECIDES_EVERY
"""Decisions of the learned AV in a second."""
HOSTILE = np.dtype([("critical", "i8"), ("bounded", "i8")])
"""One of the adversaries that take turns: code of ADVERSARIES (0: nobody), and 1 for the NDD-bounded mask."""
AV_FINISHED = np.dtype([("tests", "i8"), ("av_crashes", "i8"), ("natural_av_crashes", "i8")])
"""Counts of `collect_av`: tests, AV crashes, and AV crashes in tests without an adversary."""
_ACCELERATIONS = ACCELERATIONS


class AvReward(NamedTuple):
    """Weights of the AV's reward for half a second of driving; a crash gives -1 instead, whichever vehicle is at fault.

    Attributes:
        progress: Reward at 35 m/s; it is 0 at 20 m/s, linear in the speed, and negative below.
        acceleration: Cost at 4 m/s2 braking or accelerating, in proportion.
        lane_change: Cost of beginning a lane change or turning back in one.
        nearness: Cost of no gap at all to a lead in any lane that the AV is in, or, while it changes lanes, to a
            follower in its target lane. It is 0 from a time gap of `time_gap` on, linear in between.
        time_gap: See `nearness` [s].
    """

    progress: float
    acceleration: float
    lane_change: float
    nearness: float
    time_gap: float


@kernel
def _lack(gap: float, speed: float, time_gap: float) -> float:
    """Compute which share of a time gap [s] is missing at a gap [m] and a speed [m/s], 0 to 1."""
    return min(1.0, max(0.0, 1.0 - gap / (time_gap * max(speed, 1.0))))


@kernel
def _nearness(w: World, time_gap: float, road: RoadNumbers) -> float:
    """Find the largest `_lack` ahead of the AV, and behind it in the lane that it changes to."""
    v = w.vehicles
    worst = 0.0
    for lane in range(road.n_lanes):
        if v[0].lanes & (1 << lane):
            lead, rear = neighbours.neighbours_in_lane(w, 0, lane, road.lane_width, DECIDED)
            if lead >= 0:
                worst = max(worst, _lack(gap(v, 0, lead), v[0].speed, time_gap))
            if rear >= 0 and v[0].duration > 0.0 and lane == v[0].target_lane:
                worst = max(worst, _lack(gap(v, rear, 0), v[rear].speed, time_gap))
    return worst


@kernel
def _reward(w: World, action: int, p: AvReward, road: RoadNumbers) -> float:
    """Compute the AV's reward for the half second that ends now, which began with `action`."""
    if w.state[0].outcome == outcome.AV_CRASH:
        return -1.0
    v = w.vehicles
    paid: float = p.progress * (v[0].speed - 20.0) / 15.0 - p.acceleration * abs(v[0].acceleration) / 4.0
    if action < FIRST_ACCELERATION:
        paid -= p.lane_change
    if p.nearness > 0.0:
        paid -= p.nearness * _nearness(w, p.time_gap, road)
    return paid


class AvActors(NamedTuple):
    """B worlds in which an AV learns to drive.

    Attributes:
        worlds: Their states, with the names of their tests.
        hostile: Adversaries that take turns, (M,) of HOSTILE: test t meets the one in row t mod M.
        observation, allowed: The AV's features now, float32 (B, D), and its action mask, bool (B, 33).
        finished: (1,) of AV_FINISHED.
    """

    worlds: World
    hostile: NDArray[np.void]
    observation: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    finished: NDArray[np.void]


def allocate_av_actors(
    n_worlds: int, slots: int, n_inputs: int, hostile: NDArray[np.void], road: RoadNumbers | None = None
) -> AvActors:
    """Allocate `n_worlds` idle worlds for features of `n_inputs` entries; `road`: of the tests."""
    return AvActors(
        allocate_worlds(n_worlds, slots, road),
        hostile,
        np.zeros((n_worlds, n_inputs), dtype=np.float32),
        np.zeros((n_worlds, N_ACTIONS), dtype=np.bool_),
        np.zeros(1, dtype=AV_FINISHED),
    )


@kernel
def _look(w: World, setting: Setting, s: Scratch, observation: NDArray[np.float32], allowed: NDArray[np.bool_]) -> None:
    """Fill the AV's observation and mask."""
    perception.show_as_seen(w, w.state[0].substep, setting.road, s.av)
    av_features.look_as_av(w, setting.road, setting.av.sight, s.av, observation, allowed)
    perception.show_as_is(w, setting.road, s.av)


@inlined_kernel
def _setting_of_test(test: int, setting: Setting, hostile: NDArray[np.void]) -> Setting:
    """Make the setting of one test: the adversary is the one whose turn it is, the AV answers from outside the loop."""
    row = hostile[test % hostile.size]
    old = setting.who
    who = controllers.Controllers(
        controllers.OUTSIDE,
        row.critical,
        old.others,
        row.bounded,
        old.policy,
        0,
        0,
        0,
        old.temperature,
        old.cast,
        old.script,
        old.rails,
    )
    return Setting(setting.road, setting.av, setting.tables, who)


@kernel
def start_av_worlds(seed: int, first: int, setting: Setting, s: Scratch, actors: AvActors) -> None:
    """Put world b at the start of test first + b."""
    for b in range(actors.allowed.shape[0]):
        w = world_row(actors.worlds, b)
        reset_world(w, seed, first + b, _setting_of_test(first + b, setting, actors.hostile))
        _look(w, setting, s, actors.observation[b], actors.allowed[b])


@kernel
def _as_idm_mobil(w: World, setting: Setting, allowed: NDArray[np.bool_]) -> int:
    """Choose the action nearest to the decision of IDM and MOBIL."""
    command, lane = av_decide(w, setting.road, setting.av)
    change = w.vehicles[0].target_lane - lane
    if change != 0:
        action = 0 if change < 0 else 1
        if allowed[action]:
            return action
    nearest: int = actions.nearest_action(command)
    return nearest


@kernel
def _choose(
    w: World, epsilon: float, setting: Setting, s: Scratch, observation: NDArray[np.float32],
    allowed: NDArray[np.bool_],
) -> int:  # fmt: skip
    """Choose the AV's action: the best one, or with chance `epsilon` half and half that of IDM and MOBIL, and any.

    "Any" is drawn uniformly from all 33; one that is not allowed becomes the next allowed one.
    """
    state = w.state[0]
    step = AV_DECISIONS * state.decisions if state.substep == 0 else AV_DECISIONS * (state.decisions - 1) + 1
    words = block(state.seed, state.test, step, 0, PURPOSE_EXPLORE)
    if uniform(words[0]) < epsilon:
        if uniform(words[1]) < 0.5:
            return _as_idm_mobil(w, setting, allowed)
        action = min(N_ACTIONS - 1, math.floor(N_ACTIONS * uniform(words[2])))
        while not allowed[action]:
            action += 1
        return action
    q_values(setting.av.network, observation, s.av.layers, s.av.q)
    best: int = best_action(s.av.q, allowed)
    return best


@kernel
def collect_av(
    n: int, epsilon: float, setting: Setting, reward: AvReward, actors: AvActors, s: Scratch, keep: Keep,
    out: Transitions,
) -> int:  # fmt: skip
    """Drive each of the first n worlds for one second, in which the AV decides twice, or once if the test ends then.

    Only a crash is marked as an end: any other test that is over counts as going on, although it is not driven on. A
    world whose test is over starts the test with its number plus the number of worlds.

    Args:
        n: 0 (to compile) or the number of worlds.
        epsilon: Chance of exploring.
        setting: The run; `road.av_substeps` must be DECIDES_EVERY, and `av.network` is the network that acts.
        reward: Weights.
        actors: The worlds.
        s: Scratch.
        keep: Nothing is kept.
        out: Holds at least 2 B transitions.

    Returns:
        Number of transitions written.
    """
    rows = 0
    finished = actors.finished[0]
    for b in range(n):
        w = world_row(actors.worlds, b)
        state = w.state[0]
        observation, allowed = actors.observation[b], actors.allowed[b]
        own = _setting_of_test(state.test, setting, actors.hostile)
        for _ in range(AV_DECISIONS):
            action = _choose(w, epsilon, setting, s, observation, allowed)
            for k in range(observation.size):
                out.observation[rows, k] = observation[k]
            for a in range(allowed.size):
                out.allowed[rows, a] = allowed[a]
            command, lane = av_features.av_order(w, action, _ACCELERATIONS)
            answer_as_av(w, command, lane)
            over = advance(w, own, s, keep, NEVER) == OVER
            _look(w, setting, s, observation, allowed)
            crashed = state.outcome == outcome.AV_CRASH
            out.action[rows] = action
            out.reward[rows] = _reward(w, action, reward, setting.road)
            out.end[rows] = crashed
            for k in range(observation.size):
                out.next_observation[rows, k] = observation[k]
            for a in range(allowed.size):
                out.next_allowed[rows, a] = allowed[a]
            rows += 1
            if over:
                finished.tests += 1
                finished.av_crashes += crashed
                finished.natural_av_crashes += crashed and own.who.critical == controllers.NOBODY
                test = state.test + actors.allowed.shape[0]
                reset_world(w, state.seed, test, _setting_of_test(test, setting, actors.hostile))
                _look(w, setting, s, observation, allowed)
                break
    return rows
