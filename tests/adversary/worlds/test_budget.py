"""The likelihood budget in worlds that learn: seen, spent, renewed, and the mask that of `allowed_actions`."""

from __future__ import annotations

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.worlds.drive_bv import Exploring, allocate_actors, collect, start_worlds
from cornerforge.adversary.worlds.rewards import reward_numbers
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.ndd.model import NddModel
from cornerforge.sim.chances import action_probabilities
from cornerforge.sim.controllers import TOLD, UNIFORM
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.observe import N_OBSERVATION, UNITS_PER_NAT, budget_units
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import n_slots, world_of

WORLDS, STEPS, BUDGET = 48, 40, 6.0
REWARD = reward_numbers("crash", 1.0)
AT_RANDOM = Exploring(UNIFORM, NO_POLICY, 0.0, 0, 0.0)


def test_worlds_that_learn_keep_to_their_budget(model: NddModel) -> None:
    odd = WIDE
    setting = setting_of(model, odd, bounded=True, budget=BUDGET).with_drivers(critical=TOLD)
    actors = allocate_actors(WORLDS, setting, n_slots(odd), N_OBSERVATION)
    observation, allowed, state = actors.observation, actors.allowed, actors.worlds.state[:, 0]
    scratch, nothing = allocate_scratch(n_slots(odd), NO_POLICY), keep_nothing(n_slots(odd))
    out = allocate_transitions(WORLDS)
    start_worlds(1, 0, setting, scratch, nothing, actors)
    assert (state["budget_left"] == budget_units(BUDGET)).all()
    p = np.zeros(33)
    poor = 0
    for _ in range(STEPS):
        before = state["budget_left"].copy()
        costs = np.zeros((WORLDS, 33))
        for b in range(WORLDS):
            world = world_of(actors.worlds, b)
            lane = int(world.vehicles["target_lane"][0])
            bv, starters = int(state["controlled"][b]), scratch.choice.starters
            action_probabilities(world, bv, False, lane, setting.road, setting.tables, starters, p)
            with np.errstate(divide="ignore"):
                costs[b] = np.log(p.max()) - np.log(p)
            left = (before[b] - 1) / UNITS_PER_NAT
            close = np.abs(costs[b] - left) < 2.0 / UNITS_PER_NAT
            np.testing.assert_array_equal(allowed[b][~close], (costs[b] <= left)[~close])
            assert observation[b, 20] == np.float32(min(3.0, left / 10.0))
        collect(WORLDS, AT_RANDOM, setting, REWARD, actors, scratch, nothing, out)
        after = state["budget_left"]
        goes_on = ~out.end
        spent = (before - after)[goes_on] / UNITS_PER_NAT
        expected = costs[np.arange(WORLDS), out.action][goes_on]
        np.testing.assert_allclose(spent, expected, atol=1.1 / UNITS_PER_NAT)
        assert (after[out.end] == budget_units(BUDGET)).all()  # a new test, a new budget
        assert (after >= 1).all()
        poor += int((after < budget_units(0.5)).sum())
    assert actors.finished["tests"][0] > WORLDS
    assert poor > 20  # the budget bites


def test_without_a_budget_nothing_is_counted(model: NddModel) -> None:
    odd = WIDE
    setting = setting_of(model, odd, bounded=True).with_drivers(critical=TOLD)
    actors = allocate_actors(4, setting, n_slots(odd), N_OBSERVATION)
    scratch, nothing = allocate_scratch(n_slots(odd), NO_POLICY), keep_nothing(n_slots(odd))
    start_worlds(1, 0, setting, scratch, nothing, actors)
    for _ in range(5):
        collect(4, AT_RANDOM, setting, REWARD, actors, scratch, nothing, allocate_transitions(4))
        assert (actors.worlds.state["budget_left"] == 0).all()
        assert (actors.observation[:, 20] == 1.0).all()


@pytest.mark.parametrize("excess", [0, 1])
def test_guided_worlds_have_richer_budgets_and_later_worlds_begin_later(model: NddModel, excess: int) -> None:
    odd, guided, begin = WIDE, WORLDS // 2, 4
    setting = setting_of(model, odd, bounded=True, budget=BUDGET)
    setting = setting.with_drivers(critical=TOLD, excess=excess, steers_from=begin)
    actors = allocate_actors(WORLDS, setting, n_slots(odd), N_OBSERVATION)
    state = actors.worlds.state[:, 0]
    scratch, nothing = allocate_scratch(n_slots(odd), NO_POLICY), keep_nothing(n_slots(odd))
    out = allocate_transitions(WORLDS)
    start_worlds(1, 0, setting, scratch, nothing, actors)
    assert (state["decisions"] == begin).all()
    exploring = AT_RANDOM._replace(guided=guided, richer=budget_units(4.0))
    rich = []
    for _ in range(STEPS):
        collect(WORLDS, exploring, setting, REWARD, actors, scratch, nothing, out)
        assert (state["decisions"] >= begin).all()
        new = np.flatnonzero(out.end)
        given = (state["budget_left"][new] - 1) / UNITS_PER_NAT
        np.testing.assert_array_equal(given[new >= guided], BUDGET)
        assert ((given >= BUDGET) & (given <= BUDGET + 4.0)).all()
        np.testing.assert_array_equal(state["budget_most"][new], state["budget_left"][new] if excess else 0)
        rich += given[new < guided].tolist()
    assert np.std(rich) > 0.8  # evenly drawn
