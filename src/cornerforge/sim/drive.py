"""Whole tests, compiled: what the thread pool of `runner.py` calls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cornerforge._elementary import log
from cornerforge._jit import kernel
from cornerforge.sim.adversaries import (
    NO_CAST,
    POLICY,
    Cast,
    ChoiceScratch,
    cast_index,
    cast_member,
    choose_action,
    sample_action,
)
from cornerforge.sim.decide import action_probabilities
from cornerforge.sim.neighbours import nearest_bv
from cornerforge.sim.observe import allowed_actions, observe, spend_budget
from cornerforge.sim.reach import Pairs
from cornerforge.sim.statistics import BV_TRAVEL_MM, Census, Counts, count_av, count_choices, count_states
from cornerforge.sim.step import step_world
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import (
    BUDGET_LEFT,
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

__all__ = [
    "Decisions",
    "Outcomes",
    "Setting",
    "allocate_decisions",
    "choose_hostile",
    "drive_range",
    "drive_test",
    "put_at_start",
    "record_choice",
    "start_test",
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


@kernel
def put_at_start(w: World, seed: int, test: int, budget: int, setting: Setting) -> None:
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
    put_at_start(w, seed, test, budget, setting)


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
    decisions.log_prob[step] = log(p) if p > 0.0 else -math.inf
    most = 0.0
    for a in range(33):
        most = max(most, s.attentive[a])
    p = s.attentive[action]
    decisions.shortfall[step] = log(most) - log(p) if p > 0.0 else math.inf


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
    return World(worlds.vehicles[b], worlds.order[b], worlds.current[b], worlds.info[b], worlds.words[b])
