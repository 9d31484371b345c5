from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import setting_of
from scipy import stats
from statistical_bounds import distance_to_law, dkw_bound, l1_bound, l1_distance

from cornerforge.drivers.avs import AVS
from cornerforge.drivers.idm import desired_gap
from cornerforge.ndd.model import NddModel
from cornerforge.sim.setting import Setting
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import RUNNING, STATE, UNKNOWN, allocate_worlds, n_slots, world_of
from cornerforge.types import Odd

ODD = Odd()
N = 20_000


def started(setting: Setting, odd: Odd, seed: int, tests: range) -> list[np.ndarray]:
    """Vehicles of each test at its start, copied."""
    world = world_of(allocate_worlds(1, n_slots(odd)))
    result = []
    for test in tests:
        reset_world(world, seed, test, setting)
        result.append(world.vehicles[: world.state["n_vehicles"][0]].copy())
    return result


@pytest.fixture(scope="module")
def worlds(model: NddModel, request: pytest.FixtureRequest) -> list[np.ndarray]:
    return started(setting_of(model, ODD), ODD, int(request.config.getoption("--seed")), range(N))


def test_all_are_there_in_their_lanes_within_the_speed_limits(worlds: list[np.ndarray], model: NddModel) -> None:
    for vehicles in worlds[:2000]:
        assert (vehicles["present"] == 1).all()
        assert (vehicles["speed"] >= model.initial.speed_low).all()
        assert (vehicles["speed"] <= min(model.initial.speed_high, ODD.max_speed)).all()
        assert (vehicles["y"] == (vehicles["target_lane"] + 0.5) * ODD.lane_width).all()
        assert (vehicles["lanes"] == 1 << vehicles["target_lane"]).all()
        assert (vehicles["x"] <= ODD.traffic_length).all()
        assert vehicles["x"][0] == ODD.av_start
        assert not vehicles["duration"].any()


def gaps_of(vehicles: np.ndarray, length: float) -> list[tuple[float, float, float]]:
    """(gap, rear's speed, lead's speed) of all that follow one another in a lane."""
    found = []
    for lane in np.unique(vehicles["target_lane"]):
        own = np.sort(vehicles[vehicles["target_lane"] == lane], order="x")
        gaps = np.diff(own["x"]) - length
        found += list(zip(gaps, own["speed"][:-1], own["speed"][1:], strict=True))
    return found


@pytest.mark.parametrize("lanes", [2, 3, 6])
@pytest.mark.parametrize("drivers", ["model", "reckless"])
def test_nobody_overlaps_and_nobody_starts_in_danger(
    request: pytest.FixtureRequest, seed: int, lanes: int, drivers: str
) -> None:
    model: NddModel = request.getfixturevalue(drivers)
    odd = replace(ODD, n_lanes=lanes)
    low, high = model.initial.min_ttc, model.initial.free_gap_high
    shortest = np.inf
    for vehicles in started(setting_of(model, odd), odd, seed, range(300)):
        assert vehicles.size < n_slots(odd)  # nobody was left out for want of a slot
        for gap, rear, lead in gaps_of(vehicles, odd.vehicle_length):
            assert 1.0 - 1e-9 <= gap <= high + 1e-9
            assert gap >= low * (rear - lead) - 1e-9
            shortest = min(shortest, gap / max(rear - lead, 1e-9))
    assert drivers == "model" or shortest < 1.02 * low  # where speeds differ much, the rule does bind


@pytest.mark.parametrize("name", sorted(AVS))
def test_the_av_starts_at_no_less_than_its_desired_gap(model: NddModel, seed: int, name: str) -> None:
    setting = setting_of(model, ODD, av=AVS[name])
    at_its_own = 0
    for vehicles in started(setting, ODD, seed, range(1000)):
        av = vehicles[0]
        ahead = vehicles[(vehicles["target_lane"] == av["target_lane"]) & (vehicles["x"] > av["x"])]
        lead = ahead[np.argmin(ahead["x"])]
        gap = lead["x"] - av["x"] - ODD.vehicle_length
        wish = desired_gap(av["speed"], lead["speed"] - av["speed"], setting.av.idm)
        assert gap >= wish - 1e-9
        at_its_own += abs(gap - wish) < 1e-9
    assert at_its_own > 50  # the rule does bind


def test_speeds_are_the_truncated_normal(worlds: list[np.ndarray], model: NddModel) -> None:
    # H0: the AVs' speeds are independent draws of the truncated normal; unit: a test; n = 20,000 sees errors of 0.02.
    law = model.initial
    ends = [(end - law.speed_mean) / law.speed_sd for end in (law.speed_low, law.speed_high)]
    truncated = stats.truncnorm(*ends, loc=law.speed_mean, scale=law.speed_sd)
    speeds = np.array([vehicles["speed"][0] for vehicles in worlds])
    bound = dkw_bound(N, comparisons=2)
    assert distance_to_law(speeds, truncated) <= bound
    # negative controls: a mean that is a tenth of the spread off; a spread that is 10 % too wide
    assert distance_to_law(speeds + 0.1 * law.speed_sd, truncated) > bound
    assert distance_to_law(law.speed_mean + 1.1 * (speeds - law.speed_mean), truncated) > bound


def test_the_av_starts_in_every_lane_alike(worlds: list[np.ndarray]) -> None:
    # H0: independent uniform draws of 3 lanes; n = 20,000 sees an L1 error of 0.04.
    counts = np.bincount([vehicles["target_lane"][0] for vehicles in worlds], minlength=3)
    bound = l1_bound(3, N)
    assert l1_distance(counts, np.full(3, 1.0 / 3.0)) <= bound
    assert l1_distance(counts, np.array([0.30, 0.35, 0.35])) > bound  # negative control


def test_without_room_for_a_lead_the_av_drives_alone(model: NddModel) -> None:
    odd = replace(ODD, traffic_length=401.0, av_start=400.0)
    for vehicles in started(setting_of(model, odd), odd, 1, range(50)):
        ahead = (vehicles["target_lane"] == vehicles["target_lane"][0]) & (vehicles["x"] > 400.0)
        assert not ahead.any()


def test_a_reset_leaves_nothing_of_the_test_before(model: NddModel) -> None:
    setting = setting_of(model, ODD)
    fresh = started(setting, ODD, 5, range(3, 4))[0]
    after_others = started(setting, ODD, 5, range(4))[-1]
    for name in ("x", "y", "speed", "target_lane", "lanes", "present", "duration", "heading", "action"):
        np.testing.assert_array_equal(after_others[name], fresh[name])
    world, unused = (world_of(allocate_worlds(1, n_slots(ODD))) for _ in range(2))
    for name in STATE.names or ():
        world.state[name] = 77
    world.av_lead[:], world.av_rear[:] = 77, 77
    reset_world(world, 5, 3, setting)
    reset_world(unused, 5, 3, setting)
    state = {name: world.state[name][0] for name in STATE.names or ()}
    draws = state.pop("draw")
    assert draws == unused.state["draw"][0] > fresh.size
    named = {"seed": 5, "test": 3, "outcome": RUNNING, "controlled": -1, "bv_action": -1}
    sizes = dict.fromkeys(("n_vehicles", "n_current", "n_seen"), fresh.size)
    assert state == dict.fromkeys(state, 0) | named | sizes
    assert (world.av_lead == UNKNOWN).all()
    assert (world.av_rear == UNKNOWN).all()
    assert sorted(world.order[: fresh.size]) == list(range(fresh.size))
