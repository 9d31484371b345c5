from __future__ import annotations

import math
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from hand_built import WIDE, Car, change_lane, glide, setting_of, world_of
from hypothesis import assume, given
from hypothesis import strategies as st
from statistical_bounds import l1_bound, l1_distance, rate_fits

from cornerforge.drivers.avs import av_named
from cornerforge.drivers.idm import idm_acceleration
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.drivers.sight import BY_CENTRE, DECIDED, HUMAN, VISIBLE, SightNumbers
from cornerforge.ndd.model import GAPS, RANGE_RATES, NddModel
from cornerforge.road.straight import lane_centre, road_numbers
from cornerforge.sim.actions import apply_action, hold, start_lane_change
from cornerforge.sim.av import av_decide
from cornerforge.sim.chances import action_probabilities, allocate_starter_scratch
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.neighbours import SIGHT, nearest_bv, neighbours_in_lane, sort_by_x
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import World
from cornerforge.types import ACCELERATIONS

ROAD = replace(WIDE, n_lanes=4)


def probabilities(
    world: World, slot: int, setting: Setting, *, attentive: bool = False, av_lane: int | None = None
) -> np.ndarray:
    p, scratch = np.full(33, np.nan), allocate_starter_scratch()
    lane = int(world.vehicles["target_lane"][0]) if av_lane is None else av_lane
    action_probabilities(world, slot, attentive, lane, setting.road, setting.tables, scratch, p)
    assert scratch.left_out[0] == 0
    return p


def decide(
    world: World, setting: Setting, test: int, controlled_action: int = -1, seed: int = 11, av_lane: int | None = None
) -> np.ndarray:
    """Let everybody decide, and forget it: the next decision is made on the same state."""
    lane = int(world.vehicles["target_lane"][0]) if av_lane is None else av_lane
    world.state["seed"], world.state["test"] = seed, test
    quantiles = world.vehicles["quantile"].copy()
    decide_bvs(world, controlled_action, lane, setting, allocate_scratch(world.vehicles.size, NO_POLICY))
    world.vehicles["quantile"] = quantiles
    return np.array(world.vehicles["action"])


# Random worlds: positions in eighths of a metre, so that shifts by powers of two are exact

SPOT = st.tuples(
    st.integers(0, 2400).map(lambda k: k / 8.0),
    st.integers(0, 3),
    st.integers(60, 160).map(lambda k: k / 4.0),
    st.sampled_from([-1, 0, 0, 1]),  # side of a running lane change
    # Its substeps so far. After 20 of 40 its centre is on the line, which counts as the left lane: no mirror there.
    st.integers(1, 35).filter(lambda substeps: substeps != 20),
)
Spots = list[tuple[float, int, float, int, int]]
SPOTS = st.lists(SPOT, min_size=2, max_size=9, unique_by=lambda spot: spot[0])


def build(spots: Spots, setting: Setting, *, shift: float = 0.0, mirror: bool = False) -> World:
    """These vehicles, the first the AV; those with a side are within a lane change."""
    lanes = setting.road.n_lanes

    def lane_of(lane: int) -> int:
        return lanes - 1 - lane if mirror else lane

    world = world_of([Car(x, lane_of(lane), speed) for x, lane, speed, _, _ in spots])
    for slot, (x, lane, speed, side, substeps) in enumerate(spots):
        if side and 0 <= lane + side < lanes:
            start_lane_change(world, slot, lane_of(lane + side), setting.road)
            for _ in range(substeps):
                glide(world, slot, setting.road)
        world.vehicles["x"][slot], world.vehicles["speed"][slot] = x + shift, speed
    sort_by_x(world)
    return world


@given(SPOTS)
def test_translation_changes_nothing(model: NddModel, spots: Spots) -> None:
    setting = setting_of(model, ROAD)
    here, there = build(spots, setting), build(spots, setting, shift=1024.0)
    assert av_decide(here, setting.road, setting.av) == av_decide(there, setting.road, setting.av)
    np.testing.assert_array_equal(decide(here, setting, 1), decide(there, setting, 1))
    for slot in range(1, len(spots)):
        np.testing.assert_array_equal(probabilities(here, slot, setting), probabilities(there, slot, setting))
    assert nearest_bv(here, setting.road) == nearest_bv(there, setting.road)


@given(SPOTS, st.booleans(), st.integers(0, 3))
def test_mirrored_drivers_take_the_other_side(
    model: NddModel, reckless: NddModel, spots: Spots, often: bool, av_lane: int
) -> None:
    # where both sides together would have more than 1, the left has the first choice
    eager = replace(reckless, lc_base=0.5 * reckless.lc_base)
    setting = setting_of(eager if often else model, ROAD)
    here, there = build(spots, setting), build(spots, setting, mirror=True)
    np.testing.assert_allclose(there.vehicles["y"], 16.0 - here.vehicles["y"], atol=1e-9)
    for slot in range(1, len(spots)):
        swapped = probabilities(there, slot, setting, av_lane=3 - av_lane)
        swapped[:2] = swapped[1::-1]
        np.testing.assert_allclose(swapped, probabilities(here, slot, setting, av_lane=av_lane), atol=1e-12)


@given(SPOTS, st.lists(st.integers(10, 60), min_size=4, max_size=4, unique=True))
def test_a_mirrored_av_takes_the_other_side(model: NddModel, spots: Spots, ahead: list[int]) -> None:
    # A lead in every lane, each at its own distance: no two lanes are equally good, so no tie hides a preference.
    setting = setting_of(model, ROAD)
    av = (0.0, *spots[0][1:])
    leads = [(float(gap) + lane / 8.0, lane, 20.0 + lane, 0, 1) for lane, gap in enumerate(ahead)]
    spots = [av, *leads, *((spot[0] + 100.0, *spot[1:]) for spot in spots[1:])]
    here, there = (
        av_decide(build(spots, setting, mirror=mirror), setting.road, setting.av) for mirror in (False, True)
    )
    assert there[0] == pytest.approx(here[0], abs=1e-9)
    assert there[1] == 3 - here[1]


@given(SPOTS, st.randoms(use_true_random=False))
def test_the_order_of_slots_does_not_matter(model: NddModel, spots: Spots, random: Random) -> None:
    setting = setting_of(model, ROAD)
    numbers = list(range(1, len(spots)))
    random.shuffle(numbers)
    here = build(spots, setting)
    there = build([spots[0], *(spots[k] for k in numbers)], setting)
    assert av_decide(here, setting.road, setting.av) == av_decide(there, setting.road, setting.av)
    for slot, number in enumerate(numbers, start=1):
        np.testing.assert_array_equal(probabilities(there, slot, setting), probabilities(here, number, setting))


@given(SPOTS, st.integers(1, 8))
def test_absent_is_as_far_away(model: NddModel, spots: Spots, slot: int) -> None:
    assume(slot < len(spots))
    setting = setting_of(model, ROAD)
    far, absent = build(spots, setting), build(spots, setting)
    far.vehicles["x"][slot] += 10_000.0
    for name in ("x", "y", "speed", "heading", "clock", "duration", "acceleration"):
        absent.vehicles[name][slot] = np.nan
    absent.vehicles["present"][slot] = 0
    sort_by_x(far)
    absent.order[:] = far.order
    assert av_decide(far, setting.road, setting.av) == av_decide(absent, setting.road, setting.av)
    others = [k for k in range(1, len(spots)) if k != slot]
    for other in others:
        np.testing.assert_array_equal(probabilities(far, other, setting), probabilities(absent, other, setting))
    if others:
        assert nearest_bv(far, setting.road) == nearest_bv(absent, setting.road)


@given(SPOTS, st.booleans(), st.booleans(), st.integers(0, 3))
def test_probabilities_sum_to_one(
    model: NddModel, reckless: NddModel, spots: Spots, often: bool, attentive: bool, av_lane: int
) -> None:
    setting = setting_of(reckless if often else model, ROAD)
    world = build(spots, setting)
    for slot in range(1, len(spots)):
        p = probabilities(world, slot, setting, attentive=attentive, av_lane=av_lane)
        assert (p >= 0.0).all()
        assert p.sum() == pytest.approx(1.0, abs=1e-9)
        lane, changing = int(world.vehicles["target_lane"][slot]), world.vehicles["duration"][slot] > 0.0
        old = int(world.vehicles["y"][slot] // 4.0)
        assert p[0] == 0.0 or (old > lane if changing else lane < 3)
        assert p[1] == 0.0 or (old < lane if changing else lane > 0)


@given(SPOTS, st.integers(0, 10_000))
def test_nobody_does_what_the_model_calls_impossible(model: NddModel, spots: Spots, test: int) -> None:
    setting = setting_of(model, ROAD)
    world = build(spots, setting)
    possible = [probabilities(world, slot, setting) for slot in range(1, len(spots))]
    actions = decide(world, setting, test)[1:]
    for p, action in zip(possible, actions, strict=True):
        assert p[action] > 0.0


# Frequencies


WORLDS = {
    "alone": [Car(0.0, 0, 30.0), Car(1000.0, 1, 30.0)],
    "behind a slower lead, both sides half free": [
        Car(0.0, 3, 30.0),
        Car(300.0, 1, 31.0),
        Car(335.0, 1, 28.0),
        Car(350.0, 2, 30.0),
        Car(262.0, 0, 32.0),
    ],
    "a neighbour alongside": [Car(0.0, 3, 30.0), Car(300.0, 1, 31.0), Car(330.0, 1, 30.0), Car(302.0, 2, 30.0)],
}


@pytest.mark.full
@pytest.mark.parametrize("name", sorted(WORLDS))
def test_frequencies_match_the_probabilities(reckless: NddModel, name: str) -> None:
    # H0: the action of slot 1 is an independent draw of `action_probabilities`; unit: a test; n = 100,000 sees 0.027.
    n = 100_000
    setting = setting_of(reckless, ROAD)
    world = world_of(WORLDS[name])
    p = probabilities(world, 1, setting)
    assert p[:2].sum() > 0.05  # lane changes matter here
    drawn = np.empty(n, dtype=np.int64)
    for test in range(n):
        drawn[test] = decide(world, setting, test, seed=5)[1]
    counts = np.bincount(drawn, minlength=33)
    bound = l1_bound(33, n, comparisons=3)
    assert l1_distance(counts, p) <= bound
    assert counts[p == 0.0].sum() == 0
    # negative controls: accelerations one bin off; left and right mistaken
    assert l1_distance(counts, np.concatenate([p[:2], np.roll(p[2:], 1)])) > bound
    if abs(p[0] - p[1]) > bound:
        assert l1_distance(counts, np.concatenate([p[1::-1], p[2:]])) > bound


@pytest.mark.full
def test_between_two_lanes_both_leads_are_minded(model: NddModel) -> None:
    # H0 as above, for a vehicle in a lane change with a lead in each of its lanes; n = 50,000 sees 0.04.
    n = 50_000
    setting = setting_of(model, ROAD)
    world = world_of([Car(0.0, 3, 30.0), Car(300.0, 1, 32.0), Car(330.0, 1, 31.3), Car(335.0, 2, 27.6)])
    start_lane_change(world, 1, 2, setting.road)
    sort_by_x(world)
    p = probabilities(world, 1, setting)
    counts = np.zeros(33, dtype=np.int64)
    for test in range(n):
        counts[decide(world, setting, test, seed=6)[1]] += 1
    assert p[:2].tolist() == [0.0, 0.0]
    assert l1_distance(counts, p) <= l1_bound(33, n)
    # negative control: minding the nearer one alone is seen
    alone = world_of([Car(0.0, 3, 30.0), Car(300.0, 2, 32.0), Car(500.0, 1, 31.3), Car(335.0, 2, 27.6)])
    start_lane_change(alone, 1, 3, setting.road)
    single = probabilities(alone, 1, setting)
    lead_1 = world_of([Car(0.0, 3, 30.0), Car(300.0, 1, 32.0), Car(330.0, 1, 31.3)])
    start_lane_change(lead_1, 1, 2, setting.road)
    other = probabilities(lead_1, 1, setting)
    assert (np.cumsum(p) >= np.cumsum(single) - 1e-12).all()
    assert (np.cumsum(p) >= np.cumsum(other) - 1e-12).all()
    assert l1_distance(counts, other) > l1_bound(33, n)


# Lanes and neighbours


def test_neighbours_by_decision_by_motion_and_by_centre(model: NddModel) -> None:
    setting, centres = setting_of(model, ROAD), SightNumbers(BY_CENTRE, 0.0, 0.0, indicators=False)
    world = world_of([Car(100.0, 0, 30.0), Car(150.0, 1, 30.0), Car(60.0, 1, 30.0), Car(140.0, 2, 30.0)])
    assert neighbours_in_lane(world, 0, 0, 4.0, DECIDED) == (-1, -1)
    assert neighbours_in_lane(world, 0, 1, 4.0, DECIDED) == (1, 2)
    start_lane_change(world, 3, 1, setting.road)
    assert neighbours_in_lane(world, 0, 1, 4.0, DECIDED) == (3, 2)
    assert neighbours_in_lane(world, 0, 2, 4.0, DECIDED) == (3, -1)
    assert neighbours_in_lane(world, 0, 1, 4.0, VISIBLE) == (1, 2)
    assert neighbours_in_lane(world, 0, 1, 4.0, HUMAN) == (3, 2)  # its indicator is on
    world.vehicles["signals"][3] = 0
    assert neighbours_in_lane(world, 0, 1, 4.0, HUMAN) == (1, 2)
    change_lane(world, 3, 1, setting.road, ago=1.0)
    assert neighbours_in_lane(world, 0, 1, 4.0, VISIBLE) == (3, 2)
    assert neighbours_in_lane(world, 0, 2, 4.0, VISIBLE) == (3, -1)
    assert neighbours_in_lane(world, 0, 1, 4.0, centres) == (1, 2)


def test_sight_ends(model: NddModel) -> None:
    assert model is not None
    for distance, seen in ((SIGHT - 1e-6, True), (SIGHT, False), (SIGHT + 1.0, False)):
        world = world_of([Car(500.0, 0, 30.0), Car(500.0 + distance, 0, 30.0), Car(500.0 - distance, 0, 30.0)])
        assert neighbours_in_lane(world, 0, 0, 4.0, DECIDED) == ((1, 2) if seen else (-1, -1))


def test_side_by_side_vehicles_are_ordered_by_slot() -> None:
    world = world_of([Car(100.0, 0, 30.0), Car(100.0, 1, 30.0), Car(100.0, 1, 30.0)])
    assert neighbours_in_lane(world, 1, 1, 4.0, DECIDED) == (2, -1)
    assert neighbours_in_lane(world, 2, 1, 4.0, DECIDED) == (-1, 1)


def test_nearest_bv_is_by_distance_and_present() -> None:
    cars = [Car(100.0, 0, 30.0), Car(107.0, 0, 30.0), Car(105.0, 2, 30.0), Car(100.0, 1, 30.0, present=False)]
    road = road_numbers(ROAD)
    assert nearest_bv(world_of(cars), road) == 1
    assert nearest_bv(world_of([cars[0], cars[2], cars[1]]), road) == 2
    assert nearest_bv(world_of([cars[0], cars[3]]), road) == -1


def test_sorting_by_x() -> None:
    rng = np.random.default_rng(3)
    x = rng.integers(0, 30, 40).astype(float)
    world = world_of([Car(float(place), 0, 30.0) for place in x])
    sort_by_x(world)
    assert world.order.tolist() == sorted(range(40), key=lambda k: (x[k], k))


# Acting


def test_actions_set_acceleration_or_start_a_change(model: NddModel) -> None:
    setting = setting_of(model, ROAD)
    for action in range(33):
        world = world_of([Car(0.0, 0, 30.0), Car(50.0, 1, 30.0)])
        apply_action(world, 1, action, ACCELERATIONS, setting.road)
        car = world.vehicles[1]
        assert car["commanded"] == (ACCELERATIONS[action - 2] if action >= 2 else 0.0)
        assert car["target_lane"] == {0: 2, 1: 0}.get(action, 1)
        assert (car["duration"] > 0.0) == (action < 2)


def test_a_change_may_be_turned_back_but_not_doubled(model: NddModel) -> None:
    setting = setting_of(model, ROAD)
    world = world_of([Car(0.0, 0, 30.0), Car(50.0, 1, 30.0)])
    apply_action(world, 1, 0, ACCELERATIONS, setting.road)
    for _ in range(10):
        glide(world, 1, setting.road)
    hold(world.vehicles, 1, 0.0, setting.road)
    before = world.vehicles[1].copy()
    apply_action(world, 1, 0, ACCELERATIONS, setting.road)  # in its direction: nothing changes
    assert world.vehicles[1] == before
    apply_action(world, 1, 1, ACCELERATIONS, setting.road)
    assert world.vehicles["target_lane"][1] == 1
    for _ in range(200):
        glide(world, 1, setting.road)
    assert world.vehicles["y"][1] == lane_centre(1, 4.0)
    assert world.vehicles["duration"][1] == 0.0


@pytest.mark.parametrize(("lane", "action"), [(0, 1), (3, 0)])
def test_nobody_leaves_the_road(model: NddModel, lane: int, action: int) -> None:
    setting = setting_of(model, ROAD)
    world = world_of([Car(0.0, 1, 30.0), Car(50.0, lane, 30.0)])
    world.vehicles["acceleration"][1] = 1.0
    apply_action(world, 1, action, ACCELERATIONS, setting.road)
    assert world.vehicles["target_lane"][1] == lane
    assert world.vehicles["duration"][1] == 0.0
    assert world.vehicles["commanded"][1] == 0.0


# Conflicts: two that start into one lane from both sides


def conflict(model: NddModel, overlook_conflict: float) -> tuple[World, Setting]:
    """Slots 1 (lane 0) and 2 (lane 2, ahead by 8 m) that always want to change; lane 1 is free.

    They accept every gap of 50 m, and none below.
    """
    accept = np.repeat((GAPS[:, None] >= 50.0).astype(np.float32), RANGE_RATES.size, axis=1)
    always = replace(
        model,
        lc_accept_lead=accept,
        lc_accept_rear=accept,
        lc_base=np.ones(21, dtype=np.float32),
        lc_desire=np.ones_like(model.lc_desire),
        lc_desire_free=1.0,
        overlook=0.0,
        overlook_conflict=overlook_conflict,
    )
    odd = replace(WIDE, n_lanes=3)
    return world_of([Car(900.0, 1, 30.0), Car(300.0, 0, 30.0), Car(308.0, 2, 30.0)]), setting_of(always, odd)


def test_the_one_behind_gives_way(model: NddModel) -> None:
    world, setting = conflict(model, overlook_conflict=0.0)
    for test in range(200):
        actions = decide(world, setting, test)
        assert actions[2] == 1
        assert actions[1] >= 2


def test_a_conflict_is_overlooked_at_its_rate(model: NddModel) -> None:
    # H0: independent with chance 0.3; n = 5,000 tells it from 0.3 +- 0.04.
    world, setting = conflict(model, overlook_conflict=0.3)
    n = 5000
    both = sum(int((decide(world, setting, test)[1:] < 2).all()) for test in range(n))
    assert rate_fits(both, n, 0.3)
    assert not rate_fits(both, n, 0.25)  # negative control


def platoon(model: NddModel, gap: float, rear_speed: float, overlook_conflict: float) -> tuple[World, Setting]:
    """Slots 1 and 2, one behind the other on the right of two lanes, both always wanting to the left."""
    _, setting = conflict(model, overlook_conflict=overlook_conflict)
    setting = setting._replace(road=setting.road._replace(n_lanes=2))
    cars = [Car(900.0, 0, 30.0), Car(300.0, 0, rear_speed), Car(300.0 + 5.0 + gap, 0, 30.0)]
    return world_of(cars), setting


def test_two_of_one_lane_change_together_when_their_gap_allows(model: NddModel) -> None:
    world, setting = platoon(model, 100.0, 30.0, 0.0)
    assert all((decide(world, setting, test)[1:] == 0).all() for test in range(50))
    world, setting = platoon(model, 20.0, 38.0, 0.0)  # closing by 8 m/s on 20 m: nobody accepts that gap
    for test in range(200):
        actions = decide(world, setting, test)
        assert actions[2] == 0
        assert actions[1] >= 2
    world, setting = platoon(model, 20.0, 38.0, 1.0)
    assert (decide(world, setting, 0)[1:] == 0).all()


def test_who_starts_behind_the_av_at_its_moment_waits(model: NddModel) -> None:
    _, setting = platoon(model, 20.0, 38.0, 0.0)
    world = world_of([Car(325.0, 0, 30.0), Car(300.0, 0, 38.0)])
    for test in range(50):
        assert decide(world, setting, test, av_lane=0)[1] == 0
        assert decide(world, setting, test, av_lane=1)[1] >= 2


def mid_change(model: NddModel, neighbour: Car, substeps: int = 10) -> tuple[World, Setting]:
    """Slot 1 has been changing from lane 1 to lane 2 for some substeps; slot 2 is the neighbour."""
    setting = setting_of(replace(model, overlook=0.25, memory=replace(model.memory, away=0.0)), ROAD)
    world = world_of([Car(900.0, 0, 30.0), Car(300.0, 1, 30.0), neighbour])
    hold(world.vehicles, 1, 0.0, setting.road)
    start_lane_change(world, 1, 2, setting.road)
    for _ in range(substeps):
        move_vehicle(world.vehicles, 1, 0.0, setting.road)
    return world, setting


@pytest.mark.parametrize(
    ("neighbour", "substeps", "chance"),
    [
        (Car(303.0, 2, 30.0), 10, 0.75),  # beside it: it turns back, unless it overlooks that (0.25)
        (Car(290.0, 2, 38.0), 10, 0.75),  # from behind, fast
        (Car(330.0, 2, 30.0), 10, 0.0),  # 25 m ahead at equal speed: acceptable
        (Car(303.0, 2, 30.0), 25, 0.0),  # its centre has crossed: no way back
        (Car(303.0, 1, 30.0), 10, 0.0),  # beside it in its old lane
    ],
)
def test_a_lane_change_is_broken_off_before_its_middle(
    model: NddModel, neighbour: Car, substeps: int, chance: float
) -> None:
    world, setting = mid_change(model, neighbour, substeps)
    p = probabilities(world, 1, setting)
    assert p[0] == 0.0
    assert p[1] == chance
    assert p.sum() == pytest.approx(1.0)
    n = 2000  # tells 0.75 from 0.70 (CONTRIBUTING, Tests)
    backs = sum(int(decide(world, setting, test)[1] == 1) for test in range(n))
    assert rate_fits(backs, n, chance)


def test_far_apart_is_no_conflict(model: NddModel) -> None:
    world, setting = conflict(model, overlook_conflict=0.0)
    world.vehicles["x"][2] = 300.0 + 5.0 + 116.0  # beyond the tables any gap is accepted
    assert (decide(world, setting, 0)[1:] < 2).all()


def test_the_controlled_bv_takes_its_action_and_gives_no_way(model: NddModel) -> None:
    world, setting = conflict(model, overlook_conflict=0.0)
    world.state["controlled"] = 1
    for action in (0, 17):
        assert decide(world, setting, 3, controlled_action=action)[1] == action


def test_decisions_of_another_second_differ(model: NddModel) -> None:
    setting = setting_of(model, ROAD)
    world = world_of([Car(0.0, 0, 30.0)] + [Car(40.0 * k, k % 4, 30.0) for k in range(1, 30)])
    first = decide(world, setting, 0)
    world.state["decisions"] = 1
    assert (decide(world, setting, 0) != first).any()


# The AV and IDM background vehicles


def test_the_av_follows_the_worst_lead_of_its_lanes(model: NddModel) -> None:
    setting = setting_of(model, ROAD)
    idm = setting.av.idm
    world = world_of([Car(100.0, 1, 30.0), Car(150.0, 1, 25.0), Car(140.0, 2, 28.0)])
    own = idm_acceleration(30.0, 45.0, -5.0, idm)
    side = idm_acceleration(30.0, 35.0, -2.0, idm)
    assert av_decide(world, setting.road, setting.av)[0] == own
    start_lane_change(world, 0, 2, setting.road)
    assert av_decide(world, setting.road, setting.av) == (min(own, side), 2)


def test_the_av_overtakes_where_it_gains(model: NddModel) -> None:
    setting = setting_of(model, ROAD)
    slow_lead = [Car(100.0, 1, 30.0), Car(150.0, 1, 25.0)]
    assert av_decide(world_of(slow_lead), setting.road, setting.av)[1] == 2  # both sides free: the left first
    blocked = [*slow_lead, Car(100.0, 2, 30.0)]
    assert av_decide(world_of(blocked), setting.road, setting.av)[1] == 0
    assert av_decide(world_of([*blocked, Car(98.0, 0, 30.0)]), setting.road, setting.av)[1] == 1
    assert av_decide(world_of([Car(100.0, 1, 30.0)]), setting.road, setting.av)[1] == 1  # nothing to gain


@pytest.mark.parametrize(
    ("av", "ago", "lane"),
    [("idm-mobil-oracle", 0.0, 0), ("idm-mobil", 0.0, 1), ("idm-mobil", 0.96, 1), ("idm-mobil", 0.97, 0),
     ("idm-mobil-blind", 0.97, 1)],
)  # fmt: skip
def test_the_av_gives_way_once_it_sees_a_lane_change(model: NddModel, av: str, ago: float, lane: int) -> None:
    setting = setting_of(model, ROAD, av=av_named(av))
    world = world_of([Car(100.0, 0, 30.0), Car(108.0, 2, 30.0)])
    start_lane_change(world, 0, 1, setting.road)
    change_lane(world, 1, 1, setting.road, ago=ago)
    assert av_decide(world, setting.road, setting.av)[1] == lane


def test_idm_bvs_take_the_nearest_action_and_keep_their_lanes(model: NddModel) -> None:
    setting = setting_of(model, ROAD, idm_bvs=True)
    world = world_of([Car(900.0, 0, 30.0), Car(300.0, 1, 31.0), Car(335.0, 1, 28.0), Car(600.0, 2, 20.0)])
    commands = [
        idm_acceleration(31.0, 30.0, -3.0, setting.av.idm),
        idm_acceleration(28.0, math.inf, 0.0, setting.av.idm),
        idm_acceleration(20.0, math.inf, 0.0, setting.av.idm),
    ]
    expected = [2 + int(np.argmin(np.abs(ACCELERATIONS - command))) for command in commands]
    for test in range(5):
        assert decide(world, setting, test)[1:].tolist() == expected
