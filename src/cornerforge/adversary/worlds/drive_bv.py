"""One second of driving as a learning step of the adversary, compiled; `drive_av.py` is the same for the AV.

The adversary stands outside the loop: the critical BV is TOLD what to do (`setting.Controllers.critical`), by training,
which chooses here (`collect`; with an AV outside the kernels `drive_bv_outside`), or by an environment's agent
(`collect`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_GUIDE, block, uniform
from cornerforge.adversary.worlds.judge import judge_crash
from cornerforge.adversary.worlds.rewards import AVOIDABLE, av_strikes, is_paid
from cornerforge.errors import InputError
from cornerforge.road.straight import ahead_by
from cornerforge.sim import (
    AV_MUST_ANSWER,
    BV_MUST_ANSWER,
    NEVER,
    OVER,
    Keep,
    World,
    advance,
    allocate_recording,
    allocate_worlds,
    answer_as_bv,
    choose_action,
    controllers,
    forget_frames,
    keep_nothing,
    lockstep,
    look_as_bv,
    moment_of,
    outcome,
    reset_world,
    world_of,
    world_row,
)
from cornerforge.site.tables import at_site
from cornerforge.types import ACTION_LEFT, ACTION_RIGHT, FIRST_ACCELERATION, N_ACTIONS, PERSON, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.adversary.worlds.rewards import RewardNumbers
    from cornerforge.drivers.policy import PolicyNumbers
    from cornerforge.sim import Scratch, Setting

__all__ = [
    "FINISHED",
    "MAX_TRIES",
    "Actors",
    "Exploring",
    "History",
    "Transitions",
    "advance_again",
    "allocate_actors",
    "allocate_history",
    "choose",
    "collect",
    "drive_again",
    "reward_of",
    "settle",
    "start_next",
    "start_with_bv",
    "start_worlds",
]


_UNIFORM, _SWERVE, _DART_OUT = controllers.UNIFORM, controllers.SWERVE, controllers.DART_OUT
_BY_TEST = np.array([controllers.RED_RUNNER, controllers.TURNS_ACROSS, controllers.CUTS_IN])
MAX_TRIES = 1000
"""Tests in a row without any BV after which `start_with_bv` gives up."""
_NOBODY = "There is no background vehicle to control in 1000 tests on end; use a model with more traffic."


class Transitions(NamedTuple):
    """One learning step of each of B worlds.

    Attributes:
        observation, allowed: What the critical BV saw, (B, D), and its action mask, (B, 33).
        action, log_prob: What it did, (B,), and the natural log of the probability with which the policy drew that,
            (B,); 0 where the policy did not draw.
        reward, end: What came of it, (B,); whether the test was over then, (B,).
        next_observation, next_allowed: As the first two, a second later; at the start of the next test after an end.
    """

    observation: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    action: NDArray[np.int64]
    log_prob: NDArray[np.float32]
    reward: NDArray[np.float32]
    end: NDArray[np.bool_]
    next_observation: NDArray[np.float32]
    next_allowed: NDArray[np.bool_]


class History(NamedTuple):
    """Decisions in B worlds since their tests began, and memory to drive one of these tests again.

    Attributes:
        action: Action of the critical BV at each decision, (B, decisions).
        answers: Answers of an AV outside the kernels, as `lockstep.answer_with` takes them, (B, answers, W); no
            answers for others.
        answered: How many of them were given, int64 (B,).
        crashed: The test that ended in a crash of the AV in the last second, where the reward is judged by its case; -1
            for none, int64 (B,). Who judges sets it back.
        world: One world to drive in.
        keep: Holds the frames of one whole test.
    """

    action: NDArray[np.int8]
    answers: NDArray[np.float64]
    answered: NDArray[np.int64]
    crashed: NDArray[np.int64]
    world: World
    keep: Keep


def allocate_history(n_worlds: int, setting: Setting, slots: int) -> History:
    """Allocate the history of `n_worlds` worlds of `slots` vehicle slots."""
    decisions = int(setting.road.max_decisions)
    answers = decisions * -(-SUBSTEPS // int(setting.road.av_substeps)) if controllers.is_outside(setting.who) else 0
    return History(
        np.zeros((n_worlds, decisions), dtype=np.int8),
        np.zeros((n_worlds, answers, setting.answer_width)),
        np.zeros(n_worlds, dtype=np.int64),
        np.full(n_worlds, -1, dtype=np.int64),
        world_of(allocate_worlds(1, slots, setting.road)),
        keep_nothing(slots)._replace(recording=allocate_recording(SUBSTEPS * decisions + 1, slots)),
    )


FINISHED = np.dtype([("tests", "i8"), ("av_crashes", "i8"), ("bv_crashes", "i8"), ("paid", "i8")])
"""Counts of `collect` over worlds that are not guided: tests, AV crashes, crashes of the controlled BV with another BV,
AV crashes that the reward pays for."""


class Exploring(NamedTuple):
    """How actions are chosen in the worlds of a training.

    Attributes:
        kind: Code of ADVERSARIES; it chooses when nothing is explored, a policy as its head says.
        policy: Its network.
        epsilon: Chance of a uniformly drawn allowed action instead.
        guided: Number of worlds, the first ones, in which exploring is guided: mostly an action that helps to make a
            crash. They are not counted in `Actors.finished`.
        guided_epsilon: Least chance of exploring in these worlds.
        richer: By how much their budgets exceed the budget at most, in its units; drawn evenly for each test.
    """

    kind: int
    policy: PolicyNumbers
    epsilon: float
    guided: int
    guided_epsilon: float
    richer: int = 0


class Actors(NamedTuple):
    """B worlds in which an adversary acts.

    Attributes:
        worlds: Their states, with the names of their tests.
        history: The actions of their critical BVs.
        observation, allowed: The critical BV's observation now, float32 (B, D), and its action mask, bool (B, 33).
        finished: (1,) of FINISHED.
    """

    worlds: World
    history: History
    observation: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    finished: NDArray[np.void]


def allocate_actors(n_worlds: int, setting: Setting, slots: int, n_inputs: int) -> Actors:
    """Allocate `n_worlds` idle worlds for observations of `n_inputs` entries."""
    return Actors(
        allocate_worlds(n_worlds, slots, setting.road),
        allocate_history(n_worlds, setting, slots),
        np.zeros((n_worlds, n_inputs), dtype=np.float32),
        np.zeros((n_worlds, N_ACTIONS), dtype=np.bool_),
        np.zeros(1, dtype=FINISHED),
    )


class Series(NamedTuple):
    """Tests of one world: `test`, `test + step` and so on, of a seed.

    `richer`: by how much the likelihood budget, if there is one, is more than it should be, at most.
    """

    seed: int
    test: int
    step: int
    richer: int


@kernel
def start_with_bv(
    w: World, series: Series, setting: Setting, s: Scratch, keep: Keep, observation: NDArray[np.float32],
    allowed: NDArray[np.bool_],
) -> int:  # fmt: skip
    """Put a world where the adversary begins to steer in a test, or in the first of every `step`-th that has a BV then.

    With an AV outside the kernels it is put at the start where the adversary steers later; the caller drives it on.

    Args:
        w: The world.
        series: The tests.
        setting: The run.
        s: Scratch.
        keep: Nothing is kept.
        observation, allowed: Filled with what the critical BV sees and may do.

    Returns:
        The number of the test.

    Raises:
        InputError: MAX_TRIES tests in a row have no BV.
    """
    seed, test, richer = series.seed, series.test, series.richer
    for _ in range(MAX_TRIES):
        reset_world(w, seed, test, setting)
        state = w.state[0]
        if richer > 0 and state.budget_left > 0:
            state.budget_left += math.floor(richer * uniform(block(seed, test, 0, 0, PURPOSE_GUIDE)[0]))
            state.budget_most = state.budget_left if state.budget_most > 0 else 0
        must = advance(w, setting, s, keep, state.steers_from)
        if must == AV_MUST_ANSWER or (must != OVER and look_as_bv(w, setting, s, observation, allowed) >= 0):
            return test
        test += series.step
    raise InputError(_NOBODY)


@kernel
def start_next(b: int, exploring: Exploring, setting: Setting, s: Scratch, keep: Keep, actors: Actors) -> None:
    """Begin the next test of world b's series (`start_with_bv`), with a richer budget in a guided world."""
    w, n, seen, allowed = world_row(actors.worlds, b), actors.allowed.shape[0], actors.observation[b], actors.allowed[b]
    richer = exploring.richer if b < exploring.guided else 0
    actors.history.answered[b] = 0
    series = Series(w.state[0].seed, w.state[0].test + n, n, richer)
    start_with_bv(w, series, setting, s, keep, seen, allowed)


@kernel
def start_worlds(seed: int, first: int, setting: Setting, s: Scratch, keep: Keep, actors: Actors) -> None:
    """Begin test first + b in world b, or the next of its series that has a BV (`start_with_bv`).

    The series of world b is every B-th test.
    """
    actors.history.answered[:] = 0
    n = actors.allowed.shape[0]
    for b in range(n):
        w, seen, allowed = world_row(actors.worlds, b), actors.observation[b], actors.allowed[b]
        start_with_bv(w, Series(seed, first + b, n, 0), setting, s, keep, seen, allowed)


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
def advance_again(history: History, b: int, w: World, setting: Setting, s: Scratch, keep: Keep) -> int:
    """Move on a world that drives world b's test once more, until an AV outside must answer or the test is over.

    Its critical BV does what it did. Returns AV_MUST_ANSWER or OVER.
    """
    must: int = advance(w, setting, s, keep, NEVER)
    while must == BV_MUST_ANSWER:
        answer_as_bv(w, history.action[b, w.state[0].decisions])
        must = advance(w, setting, s, keep, NEVER)
    return must


@kernel
def drive_again(
    history: History, b: int, seed: int, test: int, again: World, setting: Setting, s: Scratch, keep: Keep
) -> None:
    """Drive in `again` the test that has just ended in world b once more, with the same decisions.

    Args:
        history: Of the worlds.
        b: The world.
        seed, test: The test that ended; world b may be at the start of the next by now.
        again: A world to drive in.
        setting: The run.
        s: Scratch.
        keep: What is kept; all vehicles are absent in its recording.
    """
    reset_world(again, seed, test, setting)
    k = 0
    while advance_again(history, b, again, setting, s, keep) == AV_MUST_ANSWER:
        lockstep.answer_with(again, history.answers[b, k], setting)
        k += 1


@kernel
def reward_of(
    w: World, b: int, setting: Setting, reward: RewardNumbers, history: History, s: Scratch
) -> float:  # fmt: skip
    """Compute the reward of the decision that world b has just carried out.

    +1 for a crash of the AV that `reward` pays for (the paper: every one), -1 when the controlled BV crashes with
    another BV, else 0. A crash that is judged by its case gives 0 and is noted in `history.crashed`.

    Args:
        w: The world.
        b: Its row in `history`, which holds the actions since its test began.
        setting: The run.
        reward: Which crashes are paid.
        history: Its actions and answers are read; its world and recording are scratch.
        s: Scratch.
    """
    code = w.state[0].outcome
    if code != outcome.AV_CRASH:
        return -1.0 if code == outcome.BV_CRASH else 0.0
    if reward.by_case:
        history.crashed[b] = w.state[0].test
        return 0.0
    strikes = False
    avoidable = False
    if reward.code == AVOIDABLE:
        forget_frames(history.keep.recording, w.state[0].frame + 1, history.world.vehicles.size)
        drive_again(history, b, w.state[0].seed, w.state[0].test, history.world, setting, s, history.keep)
        strikes, avoidable = judge_crash(history.world, history.keep.recording, setting, reward.braking)
    else:
        strikes = av_strikes(w.vehicles, 0, w.state[0].slot_b, not at_site(setting.road.site))
    return 1.0 if is_paid(reward.code, strikes, avoidable) else 0.0


@kernel
def _ram(w: World, bv: int, allowed: NDArray[np.bool_]) -> int:
    """Choose an action that gets behind the AV and then accelerates as hard as allowed; -1 where neither applies."""
    v = w.vehicles
    lanes_left = v[0].target_lane - v[bv].target_lane
    behind = ahead_by(v, bv, 0)
    if lanes_left == 0 and behind > 0.0:
        for a in range(N_ACTIONS - 1, FIRST_ACCELERATION - 1, -1):
            if allowed[a]:
                return a
    toward = ACTION_LEFT if lanes_left > 0 else ACTION_RIGHT
    if abs(lanes_left) == 1 and behind > 5.0 and allowed[toward]:
        return toward
    return -1


@kernel
def _guided(w: World, bv: int, exploring: Exploring, allowed: NDArray[np.bool_]) -> tuple[int, int]:
    """Choose how a guided world acts: by the policy or, with at least the chance `guided_epsilon`, towards a crash.

    In three tests of five that is the action of `swerve`, in the other two ramming the AV from behind; at a site
    that of one of its plain adversaries. One time in four it is any allowed action instead, because a rule alone always
    does the same.

    Returns:
        The adversary that chooses, a code of ADVERSARIES; the action, -1 where the adversary has to choose it.
    """
    state = w.state[0]
    words = block(state.seed, state.test, moment_of(w), bv, PURPOSE_GUIDE)
    if uniform(words[0]) >= max(exploring.epsilon, exploring.guided_epsilon):
        return exploring.kind, -1
    if uniform(words[1]) < 0.25:
        return _UNIFORM, -1
    if w.agents.size:
        return _DART_OUT if w.vehicles[bv].kind == PERSON else _BY_TEST[state.test % _BY_TEST.size], -1
    return _SWERVE, _ram(w, bv, allowed) if state.test % 5 < 2 else -1


@kernel
def choose(b: int, exploring: Exploring, actors: Actors, s: Scratch, out: Transitions) -> int:
    """Choose the action of world b's critical BV, by the policy or by exploring, and note it with what the BV sees."""
    w = world_row(actors.worlds, b)
    _copy_view(actors.observation[b], actors.allowed[b], s.choice.observation, s.choice.allowed)
    _copy_view(actors.observation[b], actors.allowed[b], out.observation[b], out.allowed[b])
    bv = w.state[0].controlled
    kind, epsilon, action, log_prob = exploring.kind, exploring.epsilon, -1, 0.0
    if b < exploring.guided:
        kind, action = _guided(w, bv, exploring, s.choice.allowed)
        epsilon = 0.0
    if action < 0:
        action, log_prob = choose_action(w, bv, kind, epsilon, controllers.AS_LEARNED, exploring.policy, s.choice)
    out.action[b] = action
    out.log_prob[b] = log_prob
    actors.history.action[b, w.state[0].decisions] = action
    return action


@kernel
def settle(
    b: int, exploring: Exploring, setting: Setting, reward: RewardNumbers, actors: Actors, s: Scratch, keep: Keep,
    out: Transitions,
) -> None:  # fmt: skip
    """Complete the transition of world b, whose second is over, and start the next test if due.

    The next test is the one with its number plus the number of worlds. A test in which an AV outside failed (AV_FAULT)
    ends with reward 0 and is not counted.
    """
    w = world_row(actors.worlds, b)
    observation, allowed = actors.observation[b], actors.allowed[b]
    paid = reward_of(w, b, setting, reward, actors.history, s)
    out.reward[b] = paid
    code = w.state[0].outcome
    ended = code != outcome.RUNNING or look_as_bv(w, setting, s, observation, allowed) < 0
    out.end[b] = ended
    if ended:
        if b >= exploring.guided and code != outcome.AV_FAULT:
            finished = actors.finished[0]
            finished.tests += 1
            finished.av_crashes += code == outcome.AV_CRASH
            finished.bv_crashes += code == outcome.BV_CRASH
            finished.paid += code == outcome.AV_CRASH and paid > 0.0
        start_next(b, exploring, setting, s, keep, actors)
    _copy_view(observation, allowed, out.next_observation[b], out.next_allowed[b])


@kernel
def collect(
    n: int, exploring: Exploring, setting: Setting, reward: RewardNumbers, actors: Actors, s: Scratch, keep: Keep,
    out: Transitions,
) -> None:  # fmt: skip
    """Drive the first n worlds for one decision: choose, drive 1 s, store the transition, start the next test if due.

    Args:
        n: 0 (to compile) or the number of worlds.
        exploring: How actions are chosen.
        setting: The run, whose critical BV is TOLD.
        reward: Which crashes are paid (`reward_of`).
        actors: The worlds.
        s: Scratch.
        keep: Nothing is kept.
        out: Row b receives world b's transition.
    """
    for b in range(n):
        w = world_row(actors.worlds, b)
        answer_as_bv(w, choose(b, exploring, actors, s, out))
        advance(w, setting, s, keep, NEVER)
        settle(b, exploring, setting, reward, actors, s, keep, out)
