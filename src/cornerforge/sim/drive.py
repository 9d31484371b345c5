"""Whole tests and learning steps, compiled: what the thread pool of `runner.py` calls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_GUIDE, block, uniform
from cornerforge.sim.adversaries import SWERVE, UNIFORM, ChoiceScratch, choose_action
from cornerforge.sim.braking import is_avoidable
from cornerforge.sim.decide import action_probabilities
from cornerforge.sim.neighbours import nearest_bv
from cornerforge.sim.observe import allowed_actions, observe
from cornerforge.sim.rewards import AVOIDABLE, av_strikes, is_paid
from cornerforge.sim.statistics import BV_TRAVEL_MM, Census, Counts, count_av, count_choices, count_states
from cornerforge.sim.step import Pairs, step_world
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import (
    AV_CRASH,
    BV_CRASH,
    CONTROLLED,
    FRAME,
    N_BV_CRASHES,
    N_DECISIONS,
    N_VEHICLES,
    OUTCOME,
    RUNNING,
    SLOT_A,
    SLOT_B,
    AvNumbers,
    RoadNumbers,
    World,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cornerforge.drivers.naturalistic import NddTables
    from cornerforge.drivers.policy import PolicyNumbers
    from cornerforge.sim.braking import Braking
    from cornerforge.sim.rewards import RewardNumbers

__all__ = [
    "N_FINISHED",
    "Decisions",
    "History",
    "Outcomes",
    "Setting",
    "Transitions",
    "collect",
    "drive_range",
    "drive_test",
    "judge_range",
    "start_worlds",
    "world_row",
]


class Setting(NamedTuple):
    """All that is constant in a run.

    Attributes:
        road, av, tables: The world.
        bv_model: 0 naturalistic, 1 IDM.
        adversary: Code of `ADVERSARIES` for the BV nearest to the AV; 0 nobody.
        bounded: 1 for the NDD-bounded mask.
        policy: The adversary's network.
    """

    road: RoadNumbers
    av: AvNumbers
    tables: NddTables
    bv_model: int
    adversary: int
    bounded: int
    policy: PolicyNumbers


class Outcomes(NamedTuple):
    """One entry per test: outcome code, crash or end frame, slots in contact, BV-BV crashes, decisions, metres."""

    code: NDArray[np.uint8]
    frame: NDArray[np.int32]
    slot_a: NDArray[np.int16]
    slot_b: NDArray[np.int16]
    bv_crashes: NDArray[np.int16]
    decisions: NDArray[np.int32]
    distance: NDArray[np.float64]


class Decisions(NamedTuple):
    """Record of the decisions of one test: actions (K, N), controlled slot (K,), log-probability under the NDE (K,)."""

    action: NDArray[np.int8]
    controlled: NDArray[np.int16]
    log_prob: NDArray[np.float64]


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


N_FINISHED = 4
"""Counters of `collect`: tests, AV crashes, crashes of the controlled BV with another, AV crashes that were paid."""


@kernel
def drive_test(
    w: World, seed: int, test: int, setting: Setting, pairs: Pairs, s: ChoiceScratch,
    recording: NDArray[np.void], decisions: Decisions, counts: Counts, census: Census,
) -> None:  # fmt: skip
    """Drive one test from its start to its end; the outcome is in `w.info`. `census` says what goes into `counts`.

    The critical BV is always found, so that recordings of natural crashes name it too; it is controlled only when the
    setting has an adversary.
    """
    road, av, tables, bv_model = setting.road, setting.av, setting.tables, setting.bv_model
    adversary, bounded, policy = setting.adversary, setting.bounded, setting.policy
    reset_world(w, seed, test, road, av, tables.initial)
    travel = 0.0
    for step in range(road.max_decisions):
        if w.info[OUTCOME] != RUNNING:
            break
        recorded = step < decisions.controlled.size
        action = -1
        bv = -1
        w.info[CONTROLLED] = -1
        if adversary > 0 or recorded:
            bv = nearest_bv(w)
        if adversary > 0 and bv >= 0:
            w.info[CONTROLLED] = bv
            if adversary == 1:
                observe(w, bv, road, s.found, s.observation)
            allowed_actions(w, bv, bounded, road, tables, s.p, s.allowed)
            action = choose_action(w, bv, adversary, 0.0, seed, test, policy, s)
        if recorded and bv >= 0:
            # The tables must see the state before anybody moves; the action of a natural driver is known only after it.
            action_probabilities(w, bv, tables.overlook, road, tables, s.p)
        counting = census.on and census.first <= step < census.until
        crashes = w.info[N_BV_CRASHES]
        if counting:
            count_av(w, road, counts)
            travel += count_states(w, step, road, counts, census)
        step_world(w, seed, test, bv_model, action, road, av, tables, pairs, recording)
        if counting:
            count_choices(w, crashes, road, counts)
        if recorded:
            decisions.controlled[step] = bv
            decisions.log_prob[step] = 0.0
            if bv >= 0:
                p = s.p[w.vehicles[bv].action]
                decisions.log_prob[step] = math.log(p) if p > 0.0 else -math.inf
            for i in range(w.info[N_VEHICLES]):
                decisions.action[step, i] = w.vehicles[i].action
    if census.on:
        counts.totals[BV_TRAVEL_MM] += int(travel * 1000.0)


@kernel
def drive_range(
    seed: int, first: int, count: int, setting: Setting, worlds: World, pairs: Pairs, s: ChoiceScratch,
    recording: NDArray[np.void], decisions: Decisions, counts: Counts, census: Census, out: Outcomes,
) -> None:  # fmt: skip
    """Drive tests first .. first + count - 1 of a seed one after the other and write entry k of `out` for each.

    Args:
        seed, first, count: Which tests.
        setting: The run.
        worlds: Scratch, a batch of one world.
        pairs, s: Scratch.
        recording, decisions: Of size 0, or large enough for one test when `count` is 1.
        counts, census: Histograms to add to, and what to count.
        out: Arrays of at least `count` entries.
    """
    w = world_row(worlds, 0)
    for k in range(count):
        drive_test(w, seed, first + k, setting, pairs, s, recording, decisions, counts, census)
        out.code[k] = w.info[OUTCOME]
        out.frame[k] = w.info[FRAME]
        out.slot_a[k] = w.info[SLOT_A]
        out.slot_b[k] = w.info[SLOT_B]
        out.bv_crashes[k] = w.info[N_BV_CRASHES]
        out.decisions[k] = w.info[N_DECISIONS]
        out.distance[k] = w.vehicles[0].x - setting.road.av_start


@kernel
def world_row(worlds: World, b: int) -> World:
    """World b of a batch, as views."""
    return World(worlds.vehicles[b], worlds.order[b], worlds.current[b], worlds.info[b])


@kernel
def _prepare(
    w: World, setting: Setting, s: ChoiceScratch, observation: NDArray[np.float32], allowed: NDArray[np.bool_]
) -> bool:
    """Name the controlled BV and fill its observation and mask; False when there is no BV."""
    bv = nearest_bv(w)
    w.info[CONTROLLED] = bv
    if bv < 0:
        return False
    observe(w, bv, setting.road, s.found, observation)
    allowed_actions(w, bv, setting.bounded, setting.road, setting.tables, s.p, allowed)
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
        reset_world(w, seed, tests[b], setting.road, setting.av, setting.tables.initial)
        while not _prepare(w, setting, s, observation[b], allowed[b]):
            tests[b] += n
            reset_world(w, seed, tests[b], setting.road, setting.av, setting.tables.initial)


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
def _forget(recording: NDArray[np.void], frames: int, slots: int) -> None:
    """Nobody is there in the first frames of a recording."""
    for f in range(min(frames, recording.shape[0])):
        for i in range(slots):
            recording[f, i].present = 0


@kernel
def _judge(w: World, recording: NDArray[np.void], setting: Setting, braking: Braking) -> tuple[bool, bool]:
    """Did the AV strike, and could it have avoided the crash by braking? Of a recorded test that ended in its crash."""
    last = w.info[FRAME]
    partner = w.info[SLOT_B]
    a = w.vehicles[0]
    b = w.vehicles[partner]
    strikes = av_strikes(a.x, a.y, a.speed, a.heading, b.x, b.y, b.speed, b.heading, setting.road)
    return strikes, is_avoidable(recording, w.info[N_VEHICLES], last, partner, setting.road, braking)


@kernel
def judge_range(
    seed: int, tests: NDArray[np.int64], setting: Setting, braking: Braking, worlds: World, pairs: Pairs,
    s: ChoiceScratch, recording: NDArray[np.void], decisions: Decisions, counts: Counts, census: Census,
    strikes: NDArray[np.bool_], avoidable: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Drive tests again that ended in a crash of the AV, and say of each whether the AV struck, and could have braked.

    Args:
        seed, tests, setting: Which tests, (n,); a test that ends otherwise gets False twice.
        braking: How the AV would have braked.
        worlds, pairs, s: Scratch, a batch of one world.
        recording: Room for one whole test, nobody there; left so.
        decisions, counts, census: Of size 0, scratch, and nobody.
        strikes, avoidable: The answers, (n,).
    """
    w = world_row(worlds, 0)
    for k in range(tests.size):
        drive_test(w, seed, tests[k], setting, pairs, s, recording, decisions, counts, census)
        strikes[k] = False
        avoidable[k] = False
        if w.info[OUTCOME] == AV_CRASH:
            strikes[k], avoidable[k] = _judge(w, recording, setting, braking)
        _forget(recording, w.info[FRAME] + 1, recording.shape[1])


@kernel
def _drive_again(
    history: History, b: int, w: World, seed: int, test: int, setting: Setting, pairs: Pairs
) -> None:  # fmt: skip
    """Drive the test that world `w` has just ended once more, with the same actions, and record it."""
    again = world_row(history.world, 0)
    _forget(history.recording, w.info[FRAME] + 1, again.vehicles.size)
    reset_world(again, seed, test, setting.road, setting.av, setting.tables.initial)
    for k in range(w.info[N_DECISIONS]):
        again.info[CONTROLLED] = history.bv[b, k]
        step_world(
            again, seed, test, setting.bv_model, history.action[b, k], setting.road, setting.av, setting.tables, pairs,
            history.recording,
        )  # fmt: skip


@kernel
def _reward(
    w: World, b: int, seed: int, test: int, setting: Setting, reward: RewardNumbers, history: History, pairs: Pairs
) -> float:  # fmt: skip
    """The reward of the decision that world b has just carried out."""
    code = w.info[OUTCOME]
    if code != AV_CRASH:
        return -1.0 if code == BV_CRASH else 0.0
    strikes = False
    avoidable = False
    if reward.code == AVOIDABLE:
        _drive_again(history, b, w, seed, test, setting, pairs)
        strikes, avoidable = _judge(world_row(history.world, 0), history.recording, setting, reward.braking)
    else:
        a = w.vehicles[0]
        o = w.vehicles[w.info[SLOT_B]]
        strikes = av_strikes(a.x, a.y, a.speed, a.heading, o.x, o.y, o.speed, o.heading, setting.road)
    return 1.0 if is_paid(reward.code, strikes, avoidable) else 0.0


@kernel
def _guided_action(
    w: World, epsilon: float, seed: int, test: int, setting: Setting, s: ChoiceScratch
) -> int:  # fmt: skip
    """The policy's action, but with chance epsilon one that a plain adversary would take.

    Of these three in four are `swerve`'s and the others uniform: a bare swerve always does the same.
    """
    bv = w.info[CONTROLLED]
    words = block(seed, test, w.info[N_DECISIONS], bv, PURPOSE_GUIDE)
    kind = setting.adversary
    if uniform(words[0]) < epsilon:
        kind = SWERVE if uniform(words[1]) < 0.75 else UNIFORM
    return choose_action(w, bv, kind, 0.0, seed, test, setting.policy, s)


@kernel
def collect(
    seed: int, begin: int, end: int, tests: NDArray[np.int64], epsilon: float, guided: int, setting: Setting,
    reward: RewardNumbers,
    worlds: World, pairs: Pairs, s: ChoiceScratch, recording: NDArray[np.void], history: History,
    observation: NDArray[np.float32], allowed: NDArray[np.bool_], out: Transitions, finished: NDArray[np.int64],
) -> None:  # fmt: skip
    """One decision of each world in [begin, end): choose, drive 1 s, store the transition, start the next test if due.

    `finished` holds N_FINISHED counts. `tests`, `observation` and `allowed` hold each world's test number and present
    view, `history` what it did; a world that ends goes on with its test number plus the number of worlds.

    Reward: +1 for a crash of the AV that `reward` pays for (the paper: every one), -1 when the controlled BV crashes
    with another BV, else 0.

    Exploring, with chance `epsilon`, takes any allowed action; in the first `guided` worlds mostly what `swerve` would
    do.
    """
    n = tests.size
    for b in range(begin, end):
        w = world_row(worlds, b)
        _copy_view(observation[b], allowed[b], s.observation, s.allowed)
        _copy_view(observation[b], allowed[b], out.observation[b], s.allowed)
        if b < guided:
            action = _guided_action(w, epsilon, seed, tests[b], setting, s)
        else:
            action = choose_action(w, w.info[CONTROLLED], setting.adversary, epsilon, seed, tests[b], setting.policy, s)
        history.bv[b, w.info[N_DECISIONS]] = w.info[CONTROLLED]
        history.action[b, w.info[N_DECISIONS]] = action
        step_world(
            w, seed, tests[b], setting.bv_model, action, setting.road, setting.av, setting.tables, pairs, recording
        )
        out.action[b] = action
        code = w.info[OUTCOME]
        out.reward[b] = _reward(w, b, seed, tests[b], setting, reward, history, pairs)
        ended = code != RUNNING or not _prepare(w, setting, s, observation[b], allowed[b])
        out.end[b] = ended
        if ended:
            finished[0] += 1
            finished[1] += code == AV_CRASH
            finished[2] += code == BV_CRASH
            finished[3] += code == AV_CRASH and out.reward[b] > 0.0
            tests[b] += n
            reset_world(w, seed, tests[b], setting.road, setting.av, setting.tables.initial)
            while not _prepare(w, setting, s, observation[b], allowed[b]):
                tests[b] += n
                reset_world(w, seed, tests[b], setting.road, setting.av, setting.tables.initial)
        _copy_view(observation[b], allowed[b], out.next_observation[b], out.next_allowed[b])
