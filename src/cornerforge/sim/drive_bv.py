"""One second of driving as a learning step of the adversary, compiled; what `drive_av.py` is for the AV."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_GUIDE, block, uniform
from cornerforge.sim.adversaries import SWERVE, UNIFORM, ChoiceScratch, choose_action
from cornerforge.sim.drive import put_at_start, world_row
from cornerforge.sim.judge import forget_frames, judge_crash
from cornerforge.sim.neighbours import nearest_bv
from cornerforge.sim.observe import allowed_actions, observe, spend_budget
from cornerforge.sim.reach import Pairs
from cornerforge.sim.rewards import AVOIDABLE, av_strikes, is_paid
from cornerforge.sim.step import SUBSTEPS, allocate_recording, step_world
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import (
    AV_CRASH,
    BV_CRASH,
    CONTROLLED,
    FRAME,
    N_DECISIONS,
    OUTCOME,
    RUNNING,
    SLOT_B,
    World,
    allocate_worlds,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.sim.drive import Setting
    from cornerforge.sim.rewards import RewardNumbers

__all__ = [
    "N_FINISHED",
    "History",
    "Transitions",
    "allocate_history",
    "collect",
    "look_as_bv",
    "reward_of",
    "start_worlds",
]


class Transitions(NamedTuple):
    """One learning step of each of B worlds: (B, D) observations, (B,) actions, rewards and ends, (B, 33) masks."""

    observation: NDArray[np.float32]
    action: NDArray[np.int64]
    reward: NDArray[np.float32]
    end: NDArray[np.bool_]
    next_observation: NDArray[np.float32]
    next_allowed: NDArray[np.bool_]


class History(NamedTuple):
    """What B worlds did since their tests began, and room to drive one of them again.

    Attributes:
        bv, action: Controlled slot and its action at each decision, (B, decisions).
        world: A batch of one.
        recording: Room for one whole test.
    """

    bv: NDArray[np.int16]
    action: NDArray[np.int8]
    world: World
    recording: NDArray[np.void]


def allocate_history(n_worlds: int, setting: Setting, slots: int) -> History:
    """Room for the tests of so many worlds."""
    decisions = setting.road.max_decisions
    return History(
        np.zeros((n_worlds, decisions), dtype=np.int16),
        np.zeros((n_worlds, decisions), dtype=np.int8),
        allocate_worlds(1, slots),
        allocate_recording(SUBSTEPS * decisions + 1, slots),
    )


N_FINISHED = 4
"""Counters of `collect`, of worlds that are not guided: tests, AV crashes, crashes of the controlled BV with another,
AV crashes that were paid."""


@kernel
def look_as_bv(
    w: World, setting: Setting, s: ChoiceScratch, observation: NDArray[np.float32], allowed: NDArray[np.bool_]
) -> bool:
    """Name the controlled BV and fill its observation and mask; False when there is no BV."""
    bv = nearest_bv(w)
    w.info[CONTROLLED] = bv
    if bv < 0:
        return False
    observe(w, bv, setting.road, s.found, observation)
    allowed_actions(w, bv, setting.bounded, setting.road, setting.tables, s.starters, s.p, allowed)
    return True


@kernel
def start_worlds(
    seed: int, tests: NDArray[np.int64], setting: Setting, worlds: World, s: ChoiceScratch,
    observation: NDArray[np.float32], allowed: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Put world b at the start of test tests[b] (the next of its series that has a BV)."""
    n = tests.size
    for b in range(n):
        w = world_row(worlds, b)
        put_at_start(w, seed, tests[b], setting.budget, setting)
        while not look_as_bv(w, setting, s, observation[b], allowed[b]):
            tests[b] += n
            put_at_start(w, seed, tests[b], setting.budget, setting)


@kernel
def _copy_view(
    observation: NDArray[np.float32], allowed: NDArray[np.bool_], to: NDArray[np.float32], to_allowed: NDArray[np.bool_]
) -> None:
    """Copy an observation and its mask element by element (a slice assignment would allocate)."""
    for k in range(observation.size):
        to[k] = observation[k]
    for a in range(allowed.size):
        to_allowed[a] = allowed[a]


@kernel
def _drive_again(
    history: History, b: int, w: World, seed: int, test: int, setting: Setting, pairs: Pairs
) -> None:  # fmt: skip
    """Drive the test that world `w` has just ended once more, with the same actions, and record it."""
    again = world_row(history.world, 0)
    forget_frames(history.recording, w.info[FRAME] + 1, again.vehicles.size)
    reset_world(again, seed, test, setting.road, setting.av, setting.tables.initial)
    for k in range(w.info[N_DECISIONS]):
        again.info[CONTROLLED] = history.bv[b, k]
        step_world(
            again, seed, test, setting.bv_model, history.action[b, k], setting.road, setting.av, setting.tables, pairs,
            history.recording,
        )  # fmt: skip


@kernel
def reward_of(
    w: World, b: int, seed: int, test: int, setting: Setting, reward: RewardNumbers, history: History, pairs: Pairs
) -> float:  # fmt: skip
    """The reward of the decision that world b has just carried out.

    +1 for a crash of the AV that `reward` pays for (the paper: every one), -1 when the controlled BV crashes with
    another BV, else 0.

    Args:
        w: The world.
        b: Its row in `history`, which holds what was decided since its test began.
        seed, test, setting: What it drives.
        reward: What is paid for.
        history: Read; its world and recording are scratch.
        pairs: Scratch.
    """
    code = w.info[OUTCOME]
    if code != AV_CRASH:
        return -1.0 if code == BV_CRASH else 0.0
    strikes = False
    avoidable = False
    if reward.code == AVOIDABLE:
        _drive_again(history, b, w, seed, test, setting, pairs)
        strikes, avoidable = judge_crash(world_row(history.world, 0), history.recording, setting, reward.braking)
    else:
        a = w.vehicles[0]
        o = w.vehicles[w.info[SLOT_B]]
        strikes = av_strikes(a.x, a.y, a.speed, a.heading, o.x, o.y, o.speed, o.heading, setting.road)
    return 1.0 if is_paid(reward.code, strikes, avoidable) else 0.0


@kernel
def _ram(w: World, bv: int, allowed: NDArray[np.bool_]) -> int:
    """Get behind the AV, then accelerate as hard as allowed; -1 where that is no help."""
    v = w.vehicles
    lanes_left = v[0].target_lane - v[bv].target_lane
    behind = v[0].x - v[bv].x
    if lanes_left == 0 and behind > 0.0:
        for a in range(32, 1, -1):
            if allowed[a]:
                return a
    toward = 0 if lanes_left > 0 else 1
    if abs(lanes_left) == 1 and behind > 5.0 and allowed[toward]:
        return toward
    return -1


@kernel
def _guided_action(w: World, epsilon: float, seed: int, test: int, setting: Setting, s: ChoiceScratch) -> int:
    """The policy's action, but with chance epsilon one that helps to make a crash.

    In three tests of five that is what `swerve` would do, in the others to ram the AV from behind; and one time in four
    any allowed action, for a bare rule always does the same.
    """
    bv = w.info[CONTROLLED]
    words = block(seed, test, w.info[N_DECISIONS], bv, PURPOSE_GUIDE)
    if uniform(words[0]) >= epsilon:
        return choose_action(w, bv, setting.adversary, 0.0, seed, test, setting.policy, s)
    if uniform(words[1]) < 0.25:
        return choose_action(w, bv, UNIFORM, 0.0, seed, test, setting.policy, s)
    if test % 5 < 2:
        action = _ram(w, bv, s.allowed)
        if action >= 0:
            return action
    return choose_action(w, bv, SWERVE, 0.0, seed, test, setting.policy, s)


@kernel
def collect(
    seed: int, begin: int, end: int, tests: NDArray[np.int64], epsilon: float, guided: int, guided_epsilon: float,
    setting: Setting, reward: RewardNumbers,
    worlds: World, pairs: Pairs, s: ChoiceScratch, recording: NDArray[np.void], history: History,
    observation: NDArray[np.float32], allowed: NDArray[np.bool_], out: Transitions, finished: NDArray[np.int64],
) -> None:  # fmt: skip
    """One decision of each world in [begin, end): choose, drive 1 s, store the transition, start the next test if due.

    `finished` holds N_FINISHED counts. `tests`, `observation` and `allowed` hold each world's test number and present
    view, `history` what it did; a world that ends goes on with its test number plus the number of worlds.

    Rewards: `reward_of`.

    Exploring, with chance `epsilon`, takes any allowed action; in the first `guided` worlds, with chance
    `guided_epsilon` or more, mostly one that helps to make a crash: those count for nothing in `finished`.
    """
    n = tests.size
    for b in range(begin, end):
        w = world_row(worlds, b)
        _copy_view(observation[b], allowed[b], s.observation, s.allowed)
        _copy_view(observation[b], allowed[b], out.observation[b], s.allowed)
        if b < guided:
            action = _guided_action(w, max(epsilon, guided_epsilon), seed, tests[b], setting, s)
        else:
            action = choose_action(w, w.info[CONTROLLED], setting.adversary, epsilon, seed, tests[b], setting.policy, s)
        spend_budget(w, w.info[CONTROLLED], action, setting.road, setting.tables, s.starters, s.p)
        history.bv[b, w.info[N_DECISIONS]] = w.info[CONTROLLED]
        history.action[b, w.info[N_DECISIONS]] = action
        step_world(
            w, seed, tests[b], setting.bv_model, action, setting.road, setting.av, setting.tables, pairs, recording
        )
        out.action[b] = action
        code = w.info[OUTCOME]
        out.reward[b] = reward_of(w, b, seed, tests[b], setting, reward, history, pairs)
        ended = code != RUNNING or not look_as_bv(w, setting, s, observation[b], allowed[b])
        out.end[b] = ended
        if ended:
            if b >= guided:
                finished[0] += 1
                finished[1] += code == AV_CRASH
                finished[2] += code == BV_CRASH
                finished[3] += code == AV_CRASH and out.reward[b] > 0.0
            tests[b] += n
            put_at_start(w, seed, tests[b], setting.budget, setting)
            while not look_as_bv(w, setting, s, observation[b], allowed[b]):
                tests[b] += n
                put_at_start(w, seed, tests[b], setting.budget, setting)
        _copy_view(observation[b], allowed[b], out.next_observation[b], out.next_allowed[b])
