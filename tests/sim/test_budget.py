"""The likelihood budget in worlds that learn: seen, spent, renewed, and the mask that of `allowed_actions`."""

from __future__ import annotations

import numpy as np
from hand_built import setting_of

from cornerforge.adversary.replay import allocate_transitions
from cornerforge.ndd.model import NddModel
from cornerforge.sim.adversaries import allocate_choice_scratch
from cornerforge.sim.chances import action_probabilities
from cornerforge.sim.drive import Setting, world_row
from cornerforge.sim.drive_bv import N_FINISHED, History, collect, start_worlds
from cornerforge.sim.observe import UNITS_PER_NAT, budget_units
from cornerforge.sim.reach import allocate_pairs
from cornerforge.sim.rewards import reward_numbers
from cornerforge.sim.step import SUBSTEPS, allocate_recording
from cornerforge.sim.world import BUDGET_LEFT, CONTROLLED, allocate_worlds, n_slots
from cornerforge.types import Odd

WORLDS, STEPS, BUDGET = 48, 40, 6.0
REWARD = reward_numbers("crash", 1.0)


def history_of(n: int, setting: Setting, slots: int) -> History:
    longest = setting.road.max_decisions
    return History(
        np.zeros((n, longest), np.int16), np.zeros((n, longest), np.int8), allocate_worlds(1, slots),
        allocate_recording(SUBSTEPS * longest + 1, slots),
    )  # fmt: skip


def test_worlds_that_learn_keep_to_their_budget(model: NddModel) -> None:
    odd = Odd()
    setting = setting_of(model, odd, adversary="uniform", bounded=True, budget=BUDGET)
    worlds = allocate_worlds(WORLDS, n_slots(odd))
    scratch = allocate_choice_scratch(setting.policy)
    tests = np.arange(WORLDS, dtype=np.int64)
    observation = allocate_transitions(WORLDS).observation
    allowed = np.zeros((WORLDS, 33), dtype=np.bool_)
    out, finished = allocate_transitions(WORLDS), np.zeros(N_FINISHED, dtype=np.int64)
    history = history_of(WORLDS, setting, n_slots(odd))
    pairs, nothing = allocate_pairs(n_slots(odd)), allocate_recording(0, n_slots(odd))
    start_worlds(1, tests, setting, worlds, scratch, observation, allowed)
    assert (worlds.info[:, BUDGET_LEFT] == budget_units(BUDGET)).all()
    p = np.zeros(33)
    poor = 0
    for _ in range(STEPS):
        before = worlds.info[:, BUDGET_LEFT].copy()
        costs = np.zeros((WORLDS, 33))
        for b in range(WORLDS):
            world = world_row.py_func(worlds, b)  # type: ignore[attr-defined]
            action_probabilities(
                world, world.info[CONTROLLED], True, world.vehicles["target_lane"][0], setting.road, setting.tables,
                scratch.starters, p,
            )  # fmt: skip
            with np.errstate(divide="ignore"):
                costs[b] = np.log(p.max()) - np.log(p)
            left = (before[b] - 1) / UNITS_PER_NAT
            close = np.abs(costs[b] - left) < 2.0 / UNITS_PER_NAT
            np.testing.assert_array_equal(allowed[b][~close], (costs[b] <= left)[~close])
            assert observation[b, 20] == np.float32(min(1.0, left / 10.0))
        collect(
            1, 0, WORLDS, tests, 0.0, 0, 0.0, setting, REWARD, worlds, pairs, scratch, nothing, history, observation,
            allowed, out, finished,
        )  # fmt: skip
        after = worlds.info[:, BUDGET_LEFT]
        goes_on = ~out.end
        spent = (before - after)[goes_on] / UNITS_PER_NAT
        expected = costs[np.arange(WORLDS), out.action][goes_on]
        np.testing.assert_allclose(spent, expected, atol=1.1 / UNITS_PER_NAT)
        assert (after[out.end] == budget_units(BUDGET)).all()  # a new test, a new budget
        assert (after >= 1).all()
        poor += int((after < budget_units(0.5)).sum())
    assert finished[0] > WORLDS
    assert poor > 20  # the budget bites


def test_without_a_budget_nothing_is_counted(model: NddModel) -> None:
    odd = Odd()
    setting = setting_of(model, odd, adversary="uniform", bounded=True)
    worlds = allocate_worlds(4, n_slots(odd))
    scratch = allocate_choice_scratch(setting.policy)
    out = allocate_transitions(4)
    observation, allowed = out.observation.copy(), np.zeros((4, 33), dtype=np.bool_)
    tests = np.arange(4, dtype=np.int64)
    start_worlds(1, tests, setting, worlds, scratch, observation, allowed)
    for _ in range(5):
        collect(
            1, 0, 4, tests, 0.0, 0, 0.0, setting, REWARD, worlds, allocate_pairs(n_slots(odd)), scratch,
            allocate_recording(0, n_slots(odd)), history_of(4, setting, n_slots(odd)), observation, allowed, out,
            np.zeros(N_FINISHED, dtype=np.int64),
        )  # fmt: skip
        assert (worlds.info[:, BUDGET_LEFT] == 0).all()
        assert (observation[:, 20] == 1.0).all()
