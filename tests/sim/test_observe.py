from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, Car, glide, setting_of, world_of

from cornerforge.ndd.model import NddModel
from cornerforge.sim.actions import start_lane_change
from cornerforge.sim.chances import action_probabilities, allocate_starter_scratch
from cornerforge.sim.observe import (
    N_OBSERVATION,
    UNITS_PER_NAT,
    allowed_actions,
    budget_units,
    observe,
    spend_budget,
)
from cornerforge.sim.world import World
from cornerforge.types import ACTION_HOLD
from cornerforge.world_options import BUDGETS

ROAD = replace(WIDE, n_lanes=4)


def seen(model: NddModel, world: World, bv: int) -> np.ndarray:
    out = np.full(N_OBSERVATION, np.nan, dtype=np.float32)
    observe(world, bv, setting_of(model, ROAD).road, np.zeros(4, dtype=np.int64), out)
    return out


def mask(model: NddModel, world: World, bv: int, *, bounded: bool = False) -> np.ndarray:
    setting = setting_of(model, ROAD)
    allowed = np.zeros(33, dtype=np.bool_)
    allowed_actions(
        world, bv, int(bounded), setting.road, setting.tables, allocate_starter_scratch(), np.zeros(33), allowed
    )
    return allowed


def test_entries_by_hand(model: NddModel) -> None:
    world = world_of([Car(500.0, 1, 32.0), Car(510.0, 3, 27.0), Car(530.0, 3, 31.0), Car(100.0, 0, 30.0)])
    world.vehicles["acceleration"][0] = -2.0
    own = [0.35, 0.2, 0, 0, -0.5, 1, 1, -0.3, 0, 0, 0, 1, 0.2, 1.0, 2.0, -0.5, 2, 0, 0, 0, 1]
    near = [0.4, 0, 0.4, 0, 1]
    far = [-3.0, -3.0, 0.3, -3, 1]  # 410 m behind: clipped
    np.testing.assert_allclose(seen(model, world, 1), [*own, *near, *far, *([0.0] * 10)], rtol=1e-6)


def test_a_running_lane_change_shows(model: NddModel) -> None:
    world = world_of([Car(500.0, 1, 30.0), Car(503.0, 2, 30.0)])
    setting = setting_of(model, ROAD)
    start_lane_change(world, 1, 1, setting.road)
    for _ in range(20):
        glide(world, 1, setting.road)
    world.vehicles["x"][1] = 503.0
    entries = seen(model, world, 1)
    assert entries[8] == pytest.approx(0.5)  # halfway: 2 m left of its target lane's centre
    assert entries[9] == pytest.approx(-1.875 / 2.0)
    assert entries[14] == pytest.approx(0.5)
    assert entries[[16, 17, 18, 19]].tolist() == [0.0, 1.0, 1.0, 0.0]


def test_the_four_nearest_others_nearest_first(model: NddModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(50):
        cars = [
            Car(
                float(rng.uniform(400, 500)), int(rng.integers(4)), float(rng.uniform(25, 35)), bool(rng.random() < 0.8)
            )
            for _ in range(int(rng.integers(2, 12)))
        ]
        cars[0], cars[1] = cars[0]._replace(present=True), cars[1]._replace(present=True)
        bv = cars[1]
        others = sorted((abs(c.x - bv.x) + 4.0 * abs(c.lane - bv.lane), c) for c in cars[2:] if c.present)[:4]
        expected = np.zeros((4, 5))
        for row, (_, c) in zip(expected, others, strict=False):
            row[:] = [(c.x - bv.x) / 50.0, c.lane - bv.lane, (c.speed - bv.speed) / 10.0, c.lane - bv.lane, 1.0]
        entries = seen(model, world_of(cars), 1)
        np.testing.assert_allclose(entries[21:].reshape(4, 5), expected, atol=1e-5)
        assert np.isfinite(entries).all()


def test_unbounded_mask_is_the_road_and_the_running_change(model: NddModel) -> None:
    setting = setting_of(model, ROAD)
    for lane, sides in ((0, [True, False]), (1, [True, True]), (3, [False, True])):
        allowed = mask(model, world_of([Car(0.0, 1, 30.0), Car(50.0, lane, 30.0)]), 1)
        assert allowed[:2].tolist() == sides
        assert allowed[2:].all()
    world = world_of([Car(0.0, 1, 30.0), Car(50.0, 1, 30.0)])
    start_lane_change(world, 1, 2, setting.road)
    assert mask(model, world, 1)[:2].tolist() == [False, True]  # it may turn back
    start_lane_change(world, 1, 1, setting.road)
    glide(world, 1, setting.road)


@pytest.mark.parametrize("lead_gap", [3.0, 20.0, 80.0, 300.0])
def test_bounded_mask_is_what_a_natural_driver_may_do(model: NddModel, lead_gap: float) -> None:
    setting = setting_of(model, ROAD)
    cars = [Car(0.0, 0, 30.0), Car(400.0, 1, 30.0), Car(405.0 + lead_gap, 1, 28.0), Car(401.0, 2, 30.0)]
    world = world_of(cars)
    p = np.zeros(33)
    action_probabilities(world, 1, False, 0, setting.road, setting.tables, allocate_starter_scratch(), p)
    bounded = mask(model, world, 1, bounded=True)
    np.testing.assert_array_equal(bounded, p > 0.0)
    assert bounded[0]  # slot 3 is alongside: who overlooks it may change
    assert bounded[ACTION_HOLD]  # so does who looks away
    attentive = np.zeros(33)
    action_probabilities(world, 1, True, 0, setting.road, setting.tables, allocate_starter_scratch(), attentive)
    assert attentive[0] == 0.0
    assert not bounded.all()  # negative control: some accelerations nobody chooses
    assert (p[0] < 1e-8) == (lead_gap < 5.0)  # nearer, hardly anybody begins a change behind a leader 2 m/s slower
    assert bounded.any()


# Likelihood budget


def costs(model: NddModel, world: World, kind: str) -> np.ndarray:
    """What each action of slot 1 falls short of the likeliest, or exceeds the entropy by; inf where impossible."""
    setting = setting_of(model, ROAD)
    p = np.zeros(33)
    action_probabilities(world, 1, False, 0, setting.road, setting.tables, allocate_starter_scratch(), p)
    with np.errstate(divide="ignore"):
        return (np.log(p.max()) if kind == "shortfall" else (p[p > 0.0] * np.log(p[p > 0.0])).sum()) - np.log(p)


def give(world: World, budget: float | None, kind: str) -> None:
    world.state["budget_left"] = budget_units(budget)
    world.state["budget_most"] = budget_units(budget) if kind == "excess" else 0


def behind(lead_gap: float) -> World:
    return world_of([Car(0.0, 0, 30.0), Car(400.0, 1, 30.0), Car(405.0 + lead_gap, 1, 28.0), Car(401.0, 2, 30.0)])


@pytest.mark.parametrize("lead_gap", [3.0, 20.0, 80.0, 300.0])
@pytest.mark.parametrize("budget", [0.0, 0.5, 3.0, 7.0, 1000.0])
@pytest.mark.parametrize("kind", BUDGETS)
def test_a_budget_allows_what_it_can_pay_for(model: NddModel, lead_gap: float, budget: float, kind: str) -> None:
    world = behind(lead_gap)
    cost = costs(model, world, kind)
    give(world, budget, kind)
    allowed = mask(model, world, 1, bounded=True)
    assert allowed[cost.argmin()]  # the likeliest costs nothing
    near = np.abs(cost - budget) < 2.0 / UNITS_PER_NAT  # costs are rounded up
    np.testing.assert_array_equal(allowed[~near], (cost <= budget)[~near])
    give(world, None, kind)
    np.testing.assert_array_equal(mask(model, world, 1, bounded=True), np.isfinite(cost))


@pytest.mark.parametrize("lead_gap", [20.0, 300.0])
@pytest.mark.parametrize("kind", BUDGETS)
def test_an_action_costs_by_how_much_less_likely_it_is(model: NddModel, lead_gap: float, kind: str) -> None:
    world = behind(lead_gap)
    setting = setting_of(model, ROAD)
    cost = costs(model, world, kind)
    assert (cost.min() < -0.2) == (kind == "excess")  # the likeliest gives back to a budget of excess
    for action in np.flatnonzero(np.isfinite(cost)):
        for budget in (5.0, 40.0):
            give(world, budget, kind)
            world.state["budget_left"] -= 100_000
            spend_budget(world, 1, int(action), setting.road, setting.tables, allocate_starter_scratch(), np.zeros(33))
            left = (world.state["budget_left"][0] - 1) / UNITS_PER_NAT
            most = budget if kind == "excess" else math.inf
            assert left == pytest.approx(min(most, max(0.0, budget - 0.1 - cost[action])), abs=1.1 / UNITS_PER_NAT)
    assert len(set(np.round(cost[np.isfinite(cost)], 3))) > 5
    give(world, None, kind)  # no limit stays no limit
    first = int(np.flatnonzero(np.isfinite(cost))[0])
    spend_budget(world, 1, first, setting.road, setting.tables, allocate_starter_scratch(), np.zeros(33))
    assert world.state["budget_left"][0] == 0


@pytest.mark.parametrize(("budget", "entry"), [(None, 1.0), (0.0, 0.0), (2.5, 0.25), (10.0, 1.0), (50.0, 3.0)])
def test_the_rest_of_the_budget_is_seen(model: NddModel, budget: float | None, entry: float) -> None:
    world = behind(20.0)
    before = seen(model, world, 1)
    world.state["budget_left"] = budget_units(budget)
    after = seen(model, world, 1)
    assert after[20] == pytest.approx(entry)
    np.testing.assert_array_equal(np.delete(after, 20), np.delete(before, 20))
