"""Whole tests and learning steps, compiled: what the thread pool of `runner.py` calls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._jit import kernel
from cornerforge._philox import PURPOSE_GUIDE, block, uniform
from cornerforge.sim.adversaries import (
    NO_CAST,
    POLICY,
    SWERVE,
    UNIFORM,
    Cast,
    ChoiceScratch,
    cast_index,
    cast_member,
    choose_action,
    sample_action,
)
from cornerforge.sim.braking import is_avoidable
from cornerforge.sim.decide import action_probabilities
from cornerforge.sim.neighbours import nearest_bv
from cornerforge.sim.observe import allowed_actions, observe, spend_budget
from cornerforge.sim.rewards import AVOIDABLE, av_strikes, is_paid
from cornerforge.sim.statistics import BV_TRAVEL_MM, Census, Counts, count_av, count_choices, count_states
from cornerforge.sim.step import SUBSTEPS, Pairs, allocate_recording, step_world
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import (
    AV_CRASH,
    BUDGET_LEFT,
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
    allocate_worlds,
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
    "allocate_decisions",
    "allocate_history",
    "choose_hostile",
    "collect",
    "drive_range",
    "drive_test",
    "judge_range",
    "look_as_bv",
    "record_choice",
    "reward_of",
    "start_test",
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
        policy: The adversary's network; of a mixture, the widest, for the size of scratch.
        budget: Likelihood budget of a test (`observe.budget_units`); 0 no limit. Needs `bounded`.
        temperature: At which a policy draws its actions; 0 for the best.
        cast: The mixture of policies, each with its own mask and budget; empty for none.
    """

    road: RoadNumbers
    av: AvNumbers
    tables: NddTables
    bv_model: int
    adversary: int
    bounded: int
    policy: PolicyNumbers
    budget: int = 0
    temperature: float = 0.0
    cast: Cast = NO_CAST


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
    """Record of the decisions of one test.

    Attributes:
        action: Of every vehicle, (K, N).
        controlled: Slot of the critical BV, (K,); -1 for none.
        log_prob: Natural log of the probability of its action under the NDE, (K,); 0 for none.
        shortfall: By how much the log-probability of its action for an attentive driver falls short of the likeliest
            action's, (K,), at least 0, +inf where it is impossible; 0 for none.
        log_prob_policy: Natural log of the probability of its action under the policy, (K,); 0 without one.
    """

    action: NDArray[np.int8]
    controlled: NDArray[np.int16]
    log_prob: NDArray[np.float64]
    shortfall: NDArray[np.float64]
    log_prob_policy: NDArray[np.float64]


def allocate_decisions(n: int, slots: int) -> Decisions:
    """Room for n decisions; 0 records nothing."""
    return Decisions(
        np.zeros((n, slots), dtype=np.int8), np.zeros(n, dtype=np.int16), np.zeros(n), np.zeros(n), np.zeros(n)
    )


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
"""Counters of `collect`: tests, AV crashes, crashes of the controlled BV with another, AV crashes that were paid."""


@kernel
def _start(w: World, seed: int, test: int, budget: int, setting: Setting) -> None:
    """Put a world at the start of a test, with its likelihood budget."""
    reset_world(w, seed, test, setting.road, setting.av, setting.tables.initial)
    w.info[BUDGET_LEFT] = budget


@kernel
def start_test(w: World, seed: int, test: int, setting: Setting) -> None:
    """Put a world at the start of a test, with the likelihood budget of the policy that drives it."""
    budget = setting.budget
    members = setting.cast.members
    if members.shape[0] > 0:
        budget = max(0, members[cast_index(seed, test, members.shape[0]), 6] - 1)
    _start(w, seed, test, budget, setting)


@kernel
def choose_hostile(
    w: World, seed: int, test: int, setting: Setting, recorded: bool, s: ChoiceScratch
) -> tuple[int, int, float]:
    """Find the critical BV and, where the setting has an adversary, choose what it does.

    Args:
        w: The world, whose info[CONTROLLED] is set.
        seed, test: Name the random numbers.
        setting: The run.
        recorded: Fill `s.p` and `s.attentive` for `record_choice`: the tables must see the state before anybody moves,
            and a natural driver's action is known only after it.
        s: Scratch.

    Returns:
        Slot of the critical BV, -1 for none; its action, -1 where it drives naturally; the natural log of the action's
        probability under the policy, 0 without one.
    """
    road, tables = setting.road, setting.tables
    bounded, policy = setting.bounded, setting.policy
    action = -1
    log_prob_policy = 0.0
    bv = nearest_bv(w)
    w.info[CONTROLLED] = -1
    if setting.adversary > 0 and bv >= 0:
        members = setting.cast.members
        if members.shape[0] > 0:
            index = cast_index(seed, test, members.shape[0])
            policy = cast_member(setting.cast, index)
            bounded = min(1, members[index, 6])
        w.info[CONTROLLED] = bv
        allowed_actions(w, bv, bounded, road, tables, s.p, s.allowed)
        if setting.adversary == POLICY:
            observe(w, bv, road, s.found, s.observation)
            action, log_prob_policy = sample_action(w, bv, setting.temperature, seed, test, policy, s)
        else:
            action = choose_action(w, bv, setting.adversary, 0.0, seed, test, policy, s)
        spend_budget(w, bv, action, road, tables, s.p)
    if recorded and bv >= 0:
        action_probabilities(w, bv, tables.overlook, road, tables, s.p)
        action_probabilities(w, bv, 0.0, road, tables, s.attentive)
    return bv, action, log_prob_policy


@kernel
def record_choice(w: World, step: int, bv: int, log_prob_policy: float, s: ChoiceScratch, decisions: Decisions) -> None:
    """Note everybody's action, and how likely the critical BV's was; `s.p` and `s.attentive` are `choose_hostile`'s."""
    decisions.controlled[step] = bv
    decisions.log_prob[step] = 0.0
    decisions.shortfall[step] = 0.0
    decisions.log_prob_policy[step] = log_prob_policy
    for i in range(w.info[N_VEHICLES]):
        decisions.action[step, i] = w.vehicles[i].action
    if bv < 0:
        return
    action = w.vehicles[bv].action
    p = s.p[action]
    decisions.log_prob[step] = math.log(p) if p > 0.0 else -math.inf
    most = 0.0
    for a in range(33):
        most = max(most, s.attentive[a])
    p = s.attentive[action]
    decisions.shortfall[step] = math.log(most) - math.log(p) if p > 0.0 else math.inf


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
    start_test(w, seed, test, setting)
    travel = 0.0
    for step in range(road.max_decisions):
        if w.info[OUTCOME] != RUNNING:
            break
        recorded = step < decisions.controlled.size
        action = -1
        bv = -1
        log_prob_policy = 0.0
        w.info[CONTROLLED] = -1
        if setting.adversary > 0 or recorded:
            bv, action, log_prob_policy = choose_hostile(w, seed, test, setting, recorded, s)
        counting = census.on and census.first <= step < census.until
        crashes = w.info[N_BV_CRASHES]
        if counting:
            count_av(w, road, counts)
            travel += count_states(w, step, road, counts, census)
        step_world(w, seed, test, bv_model, action, road, av, tables, pairs, recording)
        if counting:
            count_choices(w, crashes, road, counts)
        if recorded:
            record_choice(w, step, bv, log_prob_policy, s, decisions)
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
def look_as_bv(
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
        _start(w, seed, tests[b], setting.budget, setting)
        while not look_as_bv(w, setting, s, observation[b], allowed[b]):
            tests[b] += n
            _start(w, seed, tests[b], setting.budget, setting)


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
        strikes, avoidable = _judge(world_row(history.world, 0), history.recording, setting, reward.braking)
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
    seed: int, begin: int, end: int, tests: NDArray[np.int64], epsilon: float, guided: int, setting: Setting,
    reward: RewardNumbers,
    worlds: World, pairs: Pairs, s: ChoiceScratch, recording: NDArray[np.void], history: History,
    observation: NDArray[np.float32], allowed: NDArray[np.bool_], out: Transitions, finished: NDArray[np.int64],
) -> None:  # fmt: skip
    """One decision of each world in [begin, end): choose, drive 1 s, store the transition, start the next test if due.

    `finished` holds N_FINISHED counts. `tests`, `observation` and `allowed` hold each world's test number and present
    view, `history` what it did; a world that ends goes on with its test number plus the number of worlds.

    Rewards: `reward_of`.

    Exploring, with chance `epsilon`, takes any allowed action; in the first `guided` worlds mostly one that helps to
    make a crash.
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
        spend_budget(w, w.info[CONTROLLED], action, setting.road, setting.tables, s.p)
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
            finished[0] += 1
            finished[1] += code == AV_CRASH
            finished[2] += code == BV_CRASH
            finished[3] += code == AV_CRASH and out.reward[b] > 0.0
            tests[b] += n
            _start(w, seed, tests[b], setting.budget, setting)
            while not look_as_bv(w, setting, s, observation[b], allowed[b]):
                tests[b] += n
                _start(w, seed, tests[b], setting.budget, setting)
        _copy_view(observation[b], allowed[b], out.next_observation[b], out.next_allowed[b])
