"""The probability stated for an action is that with which it is drawn, giving way to simultaneous changes included."""

from __future__ import annotations

import itertools
import re
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from drawn_choices import draw, stated
from hand_built import WIDE, Car, setting_of, world_of
from reference import giving_way
from reference import world as slow
from reference.drivers import AvDriver
from reference.simulator import Simulator
from statistical_bounds import l1_bound, l1_distance, rate_fits

import cornerforge
from cornerforge.drivers.avs import av_named
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.ndd.model import NddModel
from cornerforge.sim import chances
from cornerforge.sim.actions import hold, start_lane_change
from cornerforge.sim.chances import MAX_SETS, MAX_STARTERS, action_probabilities, allocate_starter_scratch
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.loop import advance
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.neighbours import sort_by_x
from cornerforge.sim.outcome import RUNNING
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.scripted import NATURAL, TRAITS, Script, ScriptDriver
from cornerforge.sim.setting import Setting
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import World, allocate_worlds, n_slots
from cornerforge.sim.world import world_of as world_of_batch
from cornerforge.types import ACTION_HOLD, CLASSES, ODDS, Odd, odd_named

LANES = replace(WIDE, n_lanes=3)
N = 100_000


def eager(model: NddModel, *, wish: float, conflict: float = 0.0, overlook: float = 0.0) -> NddModel:
    """Drivers that want to either side with a chance of `wish`, however they drive."""
    return replace(
        model,
        lc_base=np.full(21, wish, dtype=np.float32),
        lc_desire=np.ones_like(model.lc_desire),
        lc_desire_free=1.0,
        overlook=overlook,
        overlook_conflict=conflict,
        memory=replace(model.memory, away=0.0),
    )


@dataclass(frozen=True)
class Scene:
    """A state with simultaneous lane changes, the first car is the AV.

    Attributes:
        cars: Everybody.
        conflict: Chance to overlook one that starts at the same moment.
        av_lane: The AV's new target lane; None where it begins no change.
        changing: Slots within a lane change and their target lanes, begun 1 s ago.
        minds: Slots whose probabilities depend on what others do at the same moment.
    """

    cars: list[Car]
    minds: set[int]
    conflict: float = 0.0
    av_lane: int | None = None
    changing: dict[int, int] | None = None

    def world(self, setting: Setting) -> World:
        world = world_of(self.cars)
        for slot, lane in (self.changing or {}).items():
            hold(world.vehicles, slot, 0.0, setting.road)
            start_lane_change(world, slot, lane, setting.road)
            for _ in range(10):
                move_vehicle(world.vehicles, slot, 0.0, setting.road)
        sort_by_x(world)
        return world

    @property
    def lane(self) -> int:
        return self.cars[0].lane if self.av_lane is None else self.av_lane


def forgotten(setting: Setting) -> Setting:
    """The same drivers without memory of what they did; they look away as often."""
    memory = setting.tables.memory._replace(near=0.0, far=0.0, habit=0.0)
    return setting._replace(tables=setting.tables._replace(memory=memory))


FAR = Car(900.0, 0, 30.0)
SCENES = {
    "two from both sides": Scene([FAR, Car(300.0, 0, 30.0), Car(318.0, 2, 30.0)], {1}),
    "two from both sides, sometimes overlooked": Scene([FAR, Car(300.0, 0, 30.0), Car(308.0, 2, 30.0)], {1}, 0.3),
    "two behind each other": Scene([FAR, Car(300.0, 0, 32.0), Car(330.0, 0, 30.0)], {1}),
    # 3 waits for nobody, 2 for 3, 1 for 2: if 3 starts, 1 has the way free more often
    "a chain of three": Scene([FAR, Car(300.0, 0, 30.0), Car(316.0, 2, 30.0), Car(330.0, 0, 30.0)], {1, 2}),
    "a chain of four, fast ones behind": Scene(
        [FAR, Car(300.0, 0, 36.0), Car(318.0, 2, 33.0), Car(335.0, 0, 31.0), Car(352.0, 2, 30.0)], {1, 2, 3}, 0.1
    ),
    "the AV starts too": Scene([Car(322.0, 2, 30.0), Car(300.0, 0, 30.0), Car(316.0, 2, 28.0)], {1, 2}, 0.1, av_lane=1),
    # 2 changes from lane 1 to 2, where 3 has come beside it: it turns back into lane 1
    "one turns back": Scene([FAR, Car(300.0, 0, 30.0), Car(318.0, 1, 30.0), Car(319.0, 2, 30.0)], {1}, changing={2: 2}),
    "side by side": Scene([FAR, Car(300.0, 0, 30.0), Car(300.0, 2, 30.0)], {1}),
}


@pytest.mark.parametrize("name", sorted(SCENES))
def test_what_is_stated_is_what_is_drawn(model: NddModel, name: str) -> None:
    # H0: a BV's action is an independent draw of its stated probabilities; unit: a test; n = 100,000 sees an L1
    # distance of 0.027; over all scenes and BVs.
    scene = SCENES[name]
    drivers = eager(model, wish=0.4, conflict=scene.conflict, overlook=0.2)
    setting = setting_of(replace(drivers, memory=replace(model.memory, away=0.1, away_again=0.2)), LANES)
    world = scene.world(setting)
    world.vehicles["away"][2:] = 1
    world.vehicles["inattention"] = np.arange(len(scene.cars))
    bvs = range(1, len(scene.cars))
    now = [stated(world, slot, setting, scene.lane) for slot in bvs]
    before = [stated(world, slot, setting, scene.lane, alone=True) for slot in bvs]
    drawn = np.empty((N, len(scene.cars)), dtype=np.int64)
    draw(world, scene.lane, setting, allocate_scratch(len(scene.cars), NO_POLICY), drawn)
    bound = l1_bound(33, N, comparisons=sum(len(each.cars) - 1 for each in SCENES.values()))
    for slot in bvs:
        counts = np.bincount(drawn[:, slot], minlength=33)
        p = now[slot - 1]
        assert l1_distance(counts, p) <= bound, slot
        assert counts[p == 0.0].sum() == 0
        # negative control: the statement that leaves giving way out is refuted wherever it matters
        if slot in scene.minds:
            assert l1_distance(counts, before[slot - 1]) > bound, slot
            assert p[:2].sum() < before[slot - 1][:2].sum()
        else:
            np.testing.assert_allclose(p, before[slot - 1], atol=1e-12)


FOLLOWERS = {
    "behind one lead": Scene([FAR, Car(300.0, 0, 31.0), Car(330.0, 0, 30.0)], set()),
    "between two lanes": Scene(
        [FAR, Car(300.0, 1, 32.0), Car(330.0, 1, 31.3), Car(331.0, 2, 27.6)], set(), changing={1: 2}
    ),
    "a lead that is beyond the tables": Scene([FAR, Car(300.0, 0, 31.0), Car(450.0, 0, 30.0)], set()),
    "no lead": Scene([FAR, Car(300.0, 0, 31.0)], set()),
}


@pytest.mark.parametrize("drivers", ["model", "mindful"])
@pytest.mark.parametrize("name", sorted(FOLLOWERS))
def test_a_follower_remembers_as_stated(request: pytest.FixtureRequest, name: str, drivers: str) -> None:
    # H0: the action of slot 1 is an independent draw of what is stated, given its last quantile, its habit and its
    # desired speed; unit: a test; n = 100,000 sees an L1 distance of 0.028; over all scenes, models and drivers.
    people = [
        (0.03, 0.2, -3.0, 4.0, 1, 0, -0.8, 3.0),
        (0.5, 0.9, 0.0, 4.0, 1, 1, 0.6, 3.0),
        (0.97, 0.6, 4.0, 4.0, 0, 0, 0.0, 0.3),
    ]
    bound = l1_bound(33, N, comparisons=2 * len(FOLLOWERS) * len(people))
    setting = setting_of(request.getfixturevalue(drivers), LANES)
    forgetful = forgotten(setting)
    refuted = quiet_refuted = 0
    for person in people:
        world = FOLLOWERS[name].world(setting)
        for trait, value in zip(TRAITS, person, strict=True):
            world.vehicles[trait][1] = value
        drawn = np.empty((N, world.vehicles.size), dtype=np.int64)
        draw(world, 0, setting, allocate_scratch(world.vehicles.size, NO_POLICY), drawn)
        counts = np.bincount(drawn[:, 1], minlength=33)
        p, without = (stated(world, 1, each, 0) for each in (setting, forgetful))
        assert l1_distance(counts, p) <= bound
        assert counts[p == 0.0].sum() == 0
        assert ((p == 0.0) == (without == 0.0)).all()  # what the tables call impossible stays impossible, and no more
        refuted += l1_distance(counts, without) > bound
        world.vehicles["noise"][1] = 0.0
        quiet_refuted += l1_distance(counts, stated(world, 1, setting, 0)) > bound
    # negative controls: a statement without memory is refuted wherever there is a lead, one without noise level always
    assert refuted == (0 if name == "no lead" else len(people))
    assert quiet_refuted == 2


def test_in_the_odd_of_the_paper_one_change_in_a_hundred_ignores_the_vehicle_behind(model: NddModel) -> None:
    # The rule of the paper's group: from 5 m on, and for attentive drivers too, so it is inside the mask.
    refusing = replace(eager(model, wish=0.4), lc_accept_rear=np.zeros_like(model.lc_accept_rear))
    for gap, ignored in ((5.01, 0.01), (40.0, 0.01), (4.99, 0.0), (-2.0, 0.0)):
        cars = [FAR, Car(300.0, 0, 30.0), Car(295.0 - gap, 1, 33.0)]
        for odd, share in ((odd_named("paper"), ignored), (LANES, 0.0)):
            setting = setting_of(refusing, odd)
            p = stated(world_of(cars), 1, setting, 0, attentive=True)
            assert p[0] == pytest.approx(0.4 * share, rel=1e-6)
            assert p[1] == 0.0


def test_over_all_drivers_the_tables_stay_what_they_are(mindful: NddModel) -> None:
    # The mean of what is stated over uniform quantiles and habits is what is stated without memory; to 1 / grid^2.
    setting = setting_of(mindful, LANES)
    forgetful = forgotten(setting)
    world = FOLLOWERS["between two lanes"].world(setting)
    grid = (np.arange(1000) + 0.5) / 1000
    means = []
    for quantile, habit in zip(grid, np.random.default_rng(0).permutation(grid), strict=True):
        world.vehicles["quantile"][1], world.vehicles["habit"][1] = quantile, habit
        means.append(stated(world, 1, setting, 0))
    np.testing.assert_allclose(np.mean(means, axis=0), stated(world, 1, forgetful, 0), atol=1e-3)
    assert np.abs(means - np.mean(means, axis=0)).max() > 0.1


@pytest.mark.parametrize("name", sorted(FOLLOWERS))
def test_over_drivers_of_all_noise_levels_the_tables_stay_what_they_are(model: NddModel, name: str) -> None:
    """Exactly, as levels are symmetric; and each driver can do what all can."""
    setting = forgotten(setting_of(model, LANES))
    world = FOLLOWERS[name].world(setting)
    alike = stated(world, 1, setting, 0)
    for noise in (0.1, 0.5, 0.95):
        pair = []
        for level in (-noise, noise):
            world.vehicles["noise"][1] = level
            pair.append(stated(world, 1, setting, 0))
            assert ((pair[-1] == 0.0) == (alike == 0.0)).all()
        np.testing.assert_allclose(np.mean(pair, axis=0), alike, atol=1e-12)
        assert np.abs(pair[0] - pair[1]).sum() > noise  # half of all moves from the middle to the outer quarters


def test_the_action_of_a_controlled_bv_is_remembered_as_one_that_was_drawn(mindful: NddModel) -> None:
    # Its quantile is one with which the tables give the action: so it lies between the distribution functions.
    setting = setting_of(replace(mindful, memory=replace(mindful.memory, away=0.0)), LANES)
    forgetful = forgotten(setting)
    for name, noise in itertools.product(("behind one lead", "no lead"), (0.0, -0.7, 0.7)):
        world = FOLLOWERS[name].world(setting)
        world.vehicles["speed"] = 30.0  # a range rate of 0, which is not rounded
        world.vehicles["noise"] = noise
        world.state["controlled"] = 1
        below = np.cumsum(stated(world, 1, forgetful, 0)[2:])
        below /= below[-1]
        for a in range(31):
            world.state["test"] = a
            decide_bvs(world, 2 + a, 0, setting, allocate_scratch(world.vehicles.size, NO_POLICY))
            assert world.vehicles["action"][1] == 2 + a
            # an impossible one is where the distribution function stands
            assert (below[a - 1] if a else 0.0) - 1e-6 <= world.vehicles["quantile"][1] <= below[a] + 1e-6


@pytest.mark.full
def test_who_holds_the_speed_may_have_looked_away(mindful: NddModel) -> None:
    # H0: of controlled BVs that hold their speed, P(looked away | held) did; unit: a test; n = 20,000 sees 0.014.
    # The rest of the statement is the law of who looks at the road, without memory: what it did is not known.
    for before in (0, 1):
        setting = setting_of(mindful, LANES)
        world = FOLLOWERS["behind one lead"].world(setting)
        world.vehicles["speed"] = 30.0
        world.vehicles["away"][1] = before
        world.vehicles["inattention"][1], world.vehicles["noise"][1] = 2.0, 0.7
        held = stated(world, 1, forgotten(setting), 0, attentive=True)[2:]
        away = (2.0 * mindful.memory.away, mindful.memory.away_again)[before]
        expected = away / (away + (1.0 - away) * held[ACTION_HOLD - 2] / held.sum())
        n, looked = 20_000, 0
        quantile = world.vehicles["quantile"][1]
        scratch = allocate_scratch(world.vehicles.size, NO_POLICY)
        world.state["controlled"] = 1
        for test in range(n):
            world.vehicles["quantile"][1], world.vehicles["away"][1] = quantile, before
            world.state["test"] = test
            decide_bvs(world, ACTION_HOLD, 0, setting, scratch)
            if world.vehicles["away"][1]:
                looked += 1
                assert world.vehicles["quantile"][1] == pytest.approx(quantile, abs=2.0**-32)
        assert rate_fits(looked, n, expected)
        assert not rate_fits(looked, n, away)  # negative control
        decide_bvs(world, ACTION_HOLD + 1, 0, setting, scratch)
        assert world.vehicles["away"][1] == 0


def test_refused_changes_become_the_acceleration_that_was_drawn(model: NddModel) -> None:
    # H0: given that slot 1 gives way, its acceleration has the law of one that wants no change; n > 20,000 sees 0.06.
    setting = setting_of(eager(model, wish=1.0, conflict=0.5), LANES)
    world = world_of([FAR, Car(300.0, 0, 31.0), Car(312.0, 0, 29.0)])
    p = stated(world, 1, setting, 0)
    quiet = stated(world, 1, setting_of(eager(model, wish=0.0), LANES), 0)
    assert 0.1 < p[0] < 0.9
    drawn = np.empty((60_000, 3), dtype=np.int64)
    draw(world, 0, setting, allocate_scratch(3, NO_POLICY), drawn)
    counts = np.bincount(drawn[:, 1], minlength=33)
    counts[:2] = 0
    bound = l1_bound(33, int(counts.sum()))
    assert counts.sum() > 20_000
    assert l1_distance(counts, quiet) <= bound
    assert l1_distance(counts, np.roll(quiet, 1)) > bound  # negative control: one bin off
    np.testing.assert_allclose(p[2:] / p[2:].sum(), quiet[2:], atol=1e-12)


def test_what_an_attentive_driver_never_does_is_exactly_impossible(model: NddModel) -> None:
    setting = setting_of(eager(model, wish=0.3, conflict=0.2, overlook=0.1), LANES)
    world = world_of([Car(304.0, 2, 30.0), Car(300.0, 0, 30.0)])
    assert stated(world, 1, setting, 2)[0] == stated(world, 1, setting, 2, attentive=True)[0] > 0.0
    assert stated(world, 1, setting, 1, attentive=True)[0] == 0.0  # the AV starts into lane 1, beside it
    assert stated(world, 1, setting, 1)[0] == pytest.approx(0.2 * 0.3)


# Against a sum over everything that everybody may do


def random_cars(rng: np.random.Generator) -> tuple[list[Car], dict[int, tuple[int, int]]]:
    """Two to seven cars within 150 m, the first the AV, and who changes lanes: target and substeps so far."""
    n = int(rng.integers(2, 8))
    cars = [Car(float(rng.uniform(0, 150)), int(rng.integers(3)), float(rng.uniform(24, 38))) for _ in range(n)]
    cars = [
        car._replace(
            quantile=rng.random(), habit=rng.random(), desired_speed=rng.normal(0.0, 3.0), signals=rng.random() < 0.5,
            away=rng.random() < 0.5, noise=rng.uniform(-0.9, 0.9), inattention=rng.uniform(0.0, 5.0),
        )
        for car in cars
    ]  # fmt: skip
    changing = {}
    for slot in range(n):
        target = cars[slot].lane + int(rng.choice([-1, 1]))
        if rng.random() < 0.25 and 0 <= target < 3:
            changing[slot] = target, int(rng.integers(1, 35))
    return cars, changing


def both_worlds(
    cars: list[Car], changing: dict[int, tuple[int, int]], setting: Setting, odd: Odd
) -> tuple[World, slow.World]:
    """The same state for the kernels and for the plain-Python simulator; half of the scenes have trucks too."""
    fast, plain = world_of(cars), slow.World(odd)
    for slot, car in enumerate(cars):
        kind = slot % 3 if len(cars) % 2 else 0
        size = CLASSES[kind].length, CLASSES[kind].width
        traits = car.quantile, car.habit, car.desired_speed, car.change_time
        plain.place(
            car.x, car.lane, car.speed, slow.Body(kind, *size, *traits, car.signals, car.noise, car.inattention)
        )
        plain.vehicles[-1].away = car.away
        fast.vehicles["kind"][slot] = kind
        fast.vehicles["length"][slot], fast.vehicles["width"][slot] = CLASSES[kind].length, CLASSES[kind].width
    for slot, (target, substeps) in changing.items():
        hold(fast.vehicles, slot, 0.0, setting.road)
        start_lane_change(fast, slot, target, setting.road)
        other = plain.vehicles[slot]
        other.hold(0.0, odd)
        other.change_lane(target, odd)
        for _ in range(substeps):
            move_vehicle(fast.vehicles, slot, 0.0, setting.road)
            other.move(odd)
        other.x = cars[slot].x
        fast.vehicles["x"][slot] = cars[slot].x
    sort_by_x(fast)
    return fast, plain


@pytest.mark.sampled(1)
@pytest.mark.parametrize("wish", [0.05, 0.3, 0.5])
def test_equal_to_a_sum_over_all_cases(model: NddModel, wish: float, seed: int) -> None:
    rng = np.random.default_rng([seed, round(100 * wish)])
    av = av_named("idm-mobil")
    odd = replace(LANES, truck_share=0.3)  # trucks, which are there by hand, are allowed for
    compared = mattered = attentive_zeros = 0
    for habit in np.linspace(0.0, 0.5, 30):
        conflict, overlook = float(rng.choice([0.0, 0.1, 0.6])), float(rng.choice([0.0, 0.2]))
        drivers = eager(model, wish=wish, conflict=conflict, overlook=overlook)
        memory = replace(model.memory, habit=habit, habit_width=0.2, away=0.1, away_again=0.6)
        drivers = replace(drivers, memory=memory)
        setting = setting_of(drivers, odd)
        simulator = Simulator(odd, drivers, AvDriver(av.idm, av.mobil, av.sight))
        for _ in range(5):
            cars, changing = random_cars(rng)
            fast, plain = both_worlds(cars, changing, setting, odd)
            av_lane = min(2, max(0, cars[0].lane + int(rng.choice([-1, 0, 1]))))
            for slot in range(1, len(cars)):
                attentive = bool(rng.random() < 0.3)
                p = stated(fast, slot, setting, av_lane, attentive=attentive)
                bv = plain.vehicles[slot]
                expected = giving_way.change_chances(simulator, plain, bv, attentive=attentive, av_lane=av_lane)
                np.testing.assert_allclose(p[:2], expected, rtol=0.0, atol=1e-12)
                quick = simulator.probabilities(plain, bv, av_lane, attentive=attentive)
                np.testing.assert_allclose(p, quick, rtol=0.0, atol=1e-12)
                if (
                    conflict > 0.0 and wish < 0.5 and not attentive
                ):  # then the same actions are possible without the others
                    np.testing.assert_array_equal(stated(fast, slot, setting, chances.ALONE) > 0.0, p > 0.0)
                compared += 1
                alone = stated(fast, slot, setting, av_lane, attentive=attentive, alone=True)
                mattered += int(np.abs(p - alone).max() > 1e-9)
                attentive_zeros += int(attentive and (p[:2] == 0.0).any())
    assert compared > 300
    assert mattered > 50
    assert attentive_zeros > 10


# The scratch is large enough


@pytest.mark.parametrize("odd", sorted(ODDS))
@pytest.mark.parametrize("often", [False, True])
def test_nobody_is_left_out_in_traffic(model: NddModel, reckless: NddModel, odd: str, often: bool) -> None:
    setting = setting_of(reckless if often else model, ODDS[odd])
    slots = n_slots(ODDS[odd])
    world, working, nothing = (
        world_of_batch(allocate_worlds(1, slots)),
        allocate_scratch(slots, NO_POLICY),
        keep_nothing(slots),
    )
    scratch, p = working.choice.starters, np.zeros(33)
    looked = 0
    for test in range(12):
        reset_world(world, 3, test, setting)
        while world.state["outcome"][0] == RUNNING:
            lane = int(world.vehicles["target_lane"][0])
            for slot in range(1, int(world.state["n_vehicles"][0])):
                if world.vehicles["present"][slot]:
                    action_probabilities(world, slot, False, lane, setting.road, setting.tables, scratch, p)
                    looked += 1
            advance(world, setting, working, nothing, int(world.state["decisions"][0]) + 1)
    assert looked > 1000
    assert scratch.left_out[0] == 0


def test_a_long_platoon_is_summed_up(model: NddModel) -> None:
    setting = setting_of(eager(model, wish=0.3, conflict=0.05), LANES)
    cars = [FAR._replace(x=5000.0)]
    cars += [Car(20.0 * k, 2 * (k % 2), 30.0) for k in range(MAX_STARTERS)]
    p = [stated(world_of(cars), slot, setting, 0) for slot in range(1, len(cars))]
    assert all(row.sum() == pytest.approx(1.0) for row in p)
    # one more is one too many: it is counted, and what is stated of the rearmost moves by nothing that matters
    longer = world_of([*cars, Car(20.0 * MAX_STARTERS, 0, 30.0)])
    scratch, last = allocate_starter_scratch(), np.zeros(33)
    action_probabilities(longer, 1, False, 0, setting.road, setting.tables, scratch, last)
    assert scratch.left_out[0] == 1
    np.testing.assert_allclose(last, p[0], atol=1e-9)


def test_who_states_too_crowded_chances_says_so(model: NddModel) -> None:
    """One platoon more than fits warns, also of a later drive; one that fits does not."""
    driver = ScriptDriver(setting_of(eager(model, wish=0.3, conflict=0.05), LANES), LANES)
    for bvs, warns in ((MAX_STARTERS, False), (MAX_STARTERS + 1, True), (MAX_STARTERS + 1, True), (2, False)):
        start = world_of([Car(5000.0, 0, 30.0), *(Car(20.0 * k, 2 * (k % 2), 30.0) for k in range(bvs))]).vehicles
        script = Script(np.arange(bvs + 1, dtype=np.int16), start, np.full((1, bvs + 1), NATURAL, dtype=np.int8))
        script.start["x_held"], script.start["speed_held"] = script.start["x"], script.start["speed"]
        with pytest.warns(UserWarning, match=f"More than {MAX_STARTERS} vehicles") if warns else nullcontext():
            driver.record(script)


def test_everything_that_drives_with_scratch_warns_of_what_was_left_out() -> None:
    package = Path(cornerforge.__file__).parent
    sources = {path: path.read_text(encoding="utf-8") for path in sorted(package.rglob("*.py"))}
    drives = {path for path, text in sources.items() if re.search(r"(?<!def )\ballocate_scratch\(", text)}
    assert len(drives) > 10
    for path in drives:
        assert "warn_of_left_out" in sources[path], f"{path.name} drives and would leave vehicles out in silence"


def test_more_sets_than_there_is_room_for_are_counted() -> None:
    scratch = allocate_starter_scratch()
    count = 0
    for k in range(MAX_SETS + 3):
        count = chances._add_set(scratch, 0, count, k, 0.5)
    assert count == MAX_SETS
    assert scratch.left_out[0] == 3
    assert scratch.chances[0, -1] == 0.5 + 3 * 0.5  # nothing is lost
