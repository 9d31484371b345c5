"""Trucks: what their class can do, the accelerations and lane changes that follow, the traffic that they start in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import Car, change_lane, setting_of, world_of
from numpy.typing import NDArray
from scipy import stats
from statistical_bounds import distance_to_law, dkw_bound, l1_bound, l1_distance, rate_fits

from cornerforge._jit import kernel
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import road_numbers
from cornerforge.sim.chances import action_probabilities, allocate_starter_scratch
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.loop import advance
from cornerforge.sim.neighbours import sort_by_x
from cornerforge.sim.outcome import RUNNING
from cornerforge.sim.scratch import Scratch, allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.trucks import possible_actions
from cornerforge.sim.world import World, allocate_worlds, n_slots
from cornerforge.sim.world import world_of as world_of_batch
from cornerforge.types import ACTIONS, CAR, CLASSES, ODDS, TRUCK, Odd

MIXED = ODDS["mixed"]
TRUCKER = CLASSES[TRUCK]
N = 100_000
FAR = Car(900.0, 0, 30.0)


def as_class(world: World, slot: int, kind: int) -> None:
    """Make a vehicle one of a class; its size stays, so that its gaps do."""
    world.vehicles["kind"][slot] = kind


def stated(world: World, slot: int, setting: Setting, *, attentive: bool = False) -> NDArray[np.float64]:
    p = np.full(33, np.nan)
    lane = int(world.vehicles["target_lane"][0])
    action_probabilities(
        world, slot, attentive, lane, setting.road, setting.tables, allocate_starter_scratch(), p
    )  # fmt: skip
    return p


@kernel
def _draw(
    w: World, slot: int, setting: Setting, s: Scratch, before: NDArray[np.void], counts: NDArray[np.int64]
) -> None:
    for test in range(N):
        w.state[0].test = test
        decide_bvs(w, -1, w.vehicles[0].target_lane, setting, s)
        counts[w.vehicles[slot].action] += 1
        for i in range(before.size):
            w.vehicles[i].quantile = before[i].quantile
            w.vehicles[i].away = before[i].away


def drawn(world: World, slot: int, setting: Setting) -> NDArray[np.int64]:
    """How often a BV takes each action, of N times in the same state."""
    counts = np.zeros(33, dtype=np.int64)
    _draw(world, slot, setting, allocate_scratch(world.vehicles.size, NO_POLICY), world.vehicles.copy(), counts)
    return counts


@pytest.mark.parametrize(
    ("speed", "strongest"), [(0.0, 2.0), (10.0, 1.0), (20.0, 0.4), (28.0, 0.2), (33.0, 0.2), (33.1, 0.0), (36.0, 0.0)]
)
def test_a_truck_can_do_what_its_engine_and_brakes_allow(speed: float, strongest: float) -> None:
    world = world_of([FAR, Car(300.0, 0, speed)])
    road = road_numbers(MIXED)
    assert possible_actions(world, 1, road) == (2, 32)
    as_class(world, 1, TRUCK)
    low, high = possible_actions(world, 1, road)
    assert (ACTIONS[low].acceleration, ACTIONS[high].acceleration) == (-3.2, strongest)
    # the hardest braking of the table's that the brakes can do; the step nearest to what the engine can do
    assert -TRUCKER.braking <= ACTIONS[low].acceleration < -TRUCKER.braking + 0.2
    engine = TRUCKER.power / max(speed, 1.0) - TRUCKER.resistance
    if speed < TRUCKER.top_speed and engine < 2.0:
        assert abs(engine - strongest) <= 0.1


STATES = {
    "must brake hard": [FAR, Car(300.0, 0, 30.0, desired_speed=30.0), Car(322.0, 0, 23.5)],
    "is free and slow": [FAR, Car(300.0, 0, 24.0, desired_speed=29.0)],
    "is free and above its top speed": [FAR, Car(300.0, 0, 33.6, desired_speed=36.0)],
    "follows one who draws away": [FAR, Car(300.0, 0, 27.0, quantile=0.95, desired_speed=28.0), Car(350.0, 0, 31.4)],
    "is between two leads": [FAR, Car(300.0, 0, 28.0, away=True), Car(317.0, 0, 22.6), Car(325.0, 1, 24.3)],
}


def state(name: str, setting: Setting) -> World:
    world = world_of(STATES[name])
    if name == "is between two leads":
        change_lane(world, 1, 1, setting.road, ago=2.0)
    sort_by_x(world)
    return world


@pytest.mark.parametrize("name", sorted(STATES))
def test_what_a_truck_draws_is_what_is_stated(model: NddModel, name: str) -> None:
    # H0: a truck's action is an independent draw of what is stated; unit: a test; n = 100,000 sees an L1 distance of
    # 0.028.
    memory = replace(model.memory, away=0.05, away_again=0.1)
    setting = setting_of(replace(model, memory=memory), MIXED)
    world = state(name, setting)
    as_car = stated(world, 1, setting)
    as_class(world, 1, TRUCK)
    p = stated(world, 1, setting)
    counts = drawn(world, 1, setting)
    bound = l1_bound(33, N, comparisons=len(STATES))
    assert p.sum() == pytest.approx(1.0)
    assert l1_distance(counts, p) <= bound
    assert l1_distance(counts, as_car) > bound  # negative control: the statement without limits
    assert counts[p == 0.0].sum() == 0
    # what a car would do beyond a limit is done at the limit
    low, high = possible_actions(world, 1, setting.road)
    lane_changes = p[:2].sum(), as_car[:2].sum()
    assert lane_changes[0] == lane_changes[1]
    assert p[low] == pytest.approx(as_car[2 : low + 1].sum())
    assert p[high] == pytest.approx(as_car[high:].sum())
    np.testing.assert_allclose(p[low + 1 : high], as_car[low + 1 : high])
    assert p[2:low].sum() == p[high + 1 :].sum() == 0.0


@pytest.mark.parametrize("name", ["must brake hard", "is free and slow"])
def test_a_truck_remembers_what_somebody_else_chose_as_it_would_have_drawn_it(model: NddModel, name: str) -> None:
    setting = setting_of(replace(model, memory=replace(model.memory, near=0.0, far=0.0, away=0.0)), MIXED)
    world = state(name, setting)
    world.vehicles["speed"] = np.round(world.vehicles["speed"])  # range rates that are not rounded
    as_class(world, 1, TRUCK)
    world.state["controlled"] = 1
    p = stated(world, 1, setting)[2:]
    below = np.concatenate([[0.0], np.cumsum(p / p.sum())])
    quantiles = []
    for a in range(31):
        world.state["test"] = a
        decide_bvs(world, 2 + a, 0, setting, allocate_scratch(world.vehicles.size, NO_POLICY))
        assert world.vehicles["action"][1] == 2 + a  # an adversary that is not bounded knows no limits
        quantiles.append(world.vehicles["quantile"][1])
        assert below[a] - 1e-6 <= quantiles[-1] <= below[a + 1] + 1e-6
    assert quantiles[0] < 1e-6
    assert quantiles[-1] > 1.0 - 1e-6


def test_followers_by_idm_keep_to_their_class_too(model: NddModel) -> None:
    setting = setting_of(model, MIXED, idm_bvs=True)
    for cars, at_limit in (([FAR, Car(300.0, 1, 15.0)], 0.6), ([FAR, Car(300.0, 1, 30.0), Car(312.0, 1, 20.0)], -3.2)):
        world = world_of(cars)
        scratch = allocate_scratch(len(cars), NO_POLICY)
        decide_bvs(world, -1, 0, setting, scratch)
        beyond = ACTIONS[world.vehicles["action"][1]].acceleration
        as_class(world, 1, TRUCK)
        decide_bvs(world, -1, 0, setting, scratch)
        assert ACTIONS[world.vehicles["action"][1]].acceleration == at_limit
        assert abs(beyond) > abs(at_limit)


def willing(model: NddModel) -> NddModel:
    """Drivers that want to either side with a chance of 0.3, however they drive; a fifth overlooks a neighbour."""
    desire = np.ones_like(model.lc_desire)
    return replace(model, lc_base=np.full(21, 0.3, np.float32), lc_desire=desire, lc_desire_free=1.0, overlook=0.2)


@pytest.mark.parametrize(("lanes", "closed"), [(2, False), (3, True), (4, True)])
def test_the_leftmost_of_three_or_more_lanes_is_closed_to_trucks(model: NddModel, lanes: int, closed: bool) -> None:
    odd = replace(MIXED, n_lanes=lanes)
    for kind in (CAR, TRUCK):
        for lane in range(lanes):
            world = world_of([FAR, Car(300.0, lane, 28.0)])
            as_class(world, 1, kind)
            left, right = stated(world, 1, setting_of(willing(model), odd))[:2]
            to_closed = kind == TRUCK and closed and lane + 1 == lanes - 1
            assert (left > 0.0) == (lane + 1 < lanes and not to_closed)
            assert (right > 0.0) == (lane > 0)
    no_trucks = setting_of(willing(model), replace(odd, truck_share=0.0))  # a truck put there by hand may go anywhere
    world = world_of([FAR, Car(300.0, lanes - 2, 28.0)])
    as_class(world, 1, TRUCK)
    assert stated(world, 1, no_trucks)[0] > 0.0


# The start of a test


def started(model: NddModel, odd: Odd, seed: int, tests: int) -> list[NDArray[np.void]]:
    """Vehicles of each test at its start, copied."""
    setting, world = setting_of(model, odd), world_of_batch(allocate_worlds(1, n_slots(odd)))
    result = []
    for test in range(tests):
        reset_world(world, seed, test, setting)
        result.append(world.vehicles[: world.state["n_vehicles"][0]].copy())
    return result


def chain(vehicles: NDArray[np.void], lane: int) -> NDArray[np.void]:
    """All vehicles of a lane, from the rear to the front."""
    return np.sort(vehicles[vehicles["target_lane"] == lane], order="x")


@pytest.mark.full
@pytest.mark.parametrize("lanes", [2, 3, 6])
def test_the_farther_right_a_lane_the_more_trucks_start_in_it(model: NddModel, lanes: int, seed: int) -> None:
    # H0: the rearmost vehicle of a lane without the AV is a truck with the lane's share; unit: a test; the mean share
    # over the lanes is the ODD's.
    odd, n = replace(MIXED, n_lanes=lanes, truck_share=0.3), 4000
    worlds = started(model, odd, seed, n)
    shares = [0.6 * (lanes - 1 - lane) / (lanes - 1) for lane in range(lanes)]
    assert np.mean(shares) == pytest.approx(odd.truck_share)
    for lane, share in enumerate(shares):
        first = [chain(vehicles, lane)["kind"][0] for vehicles in worlds if vehicles["target_lane"][0] != lane]
        trucks = first.count(TRUCK)
        assert rate_fits(trucks, len(first), share, comparisons=lanes)
        assert share == 0.0 or not rate_fits(trucks, len(first), share + 0.12)  # negative control
    assert all(vehicles["kind"][0] == CAR for vehicles in worlds)


def test_lanes_to_the_right_are_slower_in_even_steps(model: NddModel) -> None:
    """The AV's speed, test by test, with the same random words: only the mean of its lane moves."""
    odd = Odd()
    usual, slower = started(model, odd, 3, 400), started(model, replace(odd, slower_right=3.0), 3, 400)
    lanes = set()
    for before, after in zip(usual, slower, strict=True):
        lane = int(before["target_lane"][0])
        assert after["target_lane"][0] == lane
        if 25.0 < before["speed"][0] < 35.0:  # nothing is cut
            lanes.add(lane)
            for name in ("speed", "desired_speed"):
                assert after[name][0] - before[name][0] == pytest.approx((-1.5, 0.0, 1.5)[lane])
    assert lanes == {0, 1, 2}


def test_truck_drivers_want_no_more_than_the_top_speed(model: NddModel, seed: int) -> None:
    quick = replace(model, initial=replace(model.initial, speed_mean=36.0, stream_sd=1.0, speed_sd=1.65))
    worlds = started(quick, MIXED, seed, 1000)
    everybody = np.concatenate(worlds)
    trucks, others = everybody[everybody["kind"] == TRUCK], everybody[everybody["kind"] != TRUCK]
    assert trucks["desired_speed"].max() == TRUCKER.top_speed < others["desired_speed"].max()
    # lanes with trucks are no faster on average than trucks; the leftmost is
    means = [np.mean([chain(vehicles, lane)["speed"].mean() for vehicles in worlds]) for lane in range(3)]
    assert means[0] == pytest.approx(TRUCKER.top_speed, abs=0.3)
    assert means[1] == pytest.approx(TRUCKER.top_speed, abs=0.3)
    assert means[2] == pytest.approx(37.0, abs=0.3)


def test_who_has_less_room_beside_takes_longer_to_change(model: NddModel, seed: int) -> None:
    """Two cars have 1.66 m, a car and a truck 1.385 m, two trucks 1.11 m between them; a motorcycle counts as a car."""
    odd = replace(MIXED, motorcycle_share=0.3)
    everybody = np.concatenate([vehicles[1:] for vehicles in started(model, odd, seed, 300)])
    for kind, room in enumerate((1.385, 1.11, 1.66)):
        times = everybody["change_time"][everybody["kind"] == kind]
        assert times.min() == pytest.approx(model.initial.change_low * 1.66 / room)
    alike = started(model, replace(odd, same_duration=True), seed, 20)
    assert {time for vehicles in alike for time in vehicles["change_time"]} == {odd.lane_change_duration}


def test_trucks_start_at_longer_time_gaps(model: NddModel, seed: int) -> None:
    # H0: the time gap of the rearmost truck of a lane has the law of all drivers, stretched; unit: a test; n > 2,500.
    odd, law = replace(MIXED, truck_share=0.5, motorcycle_share=0.0), model.initial
    found = {CAR: [], TRUCK: []}  # type: dict[int, list[tuple[float, float]]]
    for vehicles in started(model, odd, seed, 12_000):
        rear, lead = chain(vehicles, (vehicles["target_lane"][0] + 1) % 3)[:2]
        gap = lead["x"] - rear["x"] - 0.5 * (lead["length"] + rear["length"])
        if gap < law.free_gap_low:
            found[int(rear["kind"])].append((gap / rear["speed"], law.free_gap_low / rear["speed"]))
    cdf = stats.lognorm(law.time_gap_sigma, loc=law.time_gap_shift, scale=law.time_gap_median).cdf
    for kind, pairs in found.items():
        gaps, most = np.array(pairs).T
        bound = dkw_bound(gaps.size, comparisons=2)
        stretch = CLASSES[kind].time_gap
        assert gaps.size > 2500
        assert distance_to_law(cdf(gaps / stretch) / cdf(most / stretch), stats.uniform()) <= bound
        wrong = 1.3 * stretch  # negative control
        assert distance_to_law(cdf(gaps / wrong) / cdf(most / wrong), stats.uniform()) > bound


def test_trucks_keep_to_their_limits_and_lanes_while_they_drive(model: NddModel, seed: int) -> None:
    setting, slots = setting_of(model, MIXED), n_slots(MIXED)
    world, scratch, keep = (
        world_of_batch(allocate_worlds(1, slots)),
        allocate_scratch(slots, NO_POLICY),
        keep_nothing(slots),
    )
    seconds = 0
    for test in range(60):
        reset_world(world, seed, test, setting)
        while world.state["outcome"][0] == RUNNING:
            before = world.vehicles.copy()
            advance(world, setting, scratch, keep, int(world.state["decisions"][0]) + 1)
            for slot in np.flatnonzero((before["kind"] == TRUCK) & (before["present"] == 1)).tolist():
                vehicle = world.vehicles[slot]
                low, high = possible_actions(world._replace(vehicles=before), slot, setting.road)
                assert vehicle["target_lane"] < 2
                assert vehicle["action"] < 2 or low <= vehicle["action"] <= high
                seconds += 1
    assert seconds > 500
