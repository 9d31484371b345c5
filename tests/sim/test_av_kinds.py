"""What the AVs that are not plain do, in worlds placed by hand; the plain one beside them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, Car, change_lane, setting_of, world_of

from cornerforge.drivers.avs import AVS, SITE_AVS, AvModel, AvNetwork, av_named
from cornerforge.drivers.idm import idm_acceleration
from cornerforge.drivers.policy import NO_POLICY, NetworkShape, n_weights
from cornerforge.experiment.av_file import av_of
from cornerforge.ndd.model import NddModel
from cornerforge.sim.av_features import AV_FEATURES_VERSION, N_AV_FEATURES
from cornerforge.sim.av_kinds import built_in_av_decides
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import World

ROAD = WIDE
PLAIN, WATCHFUL, CAUTIOUS = "idm-mobil", "idm-mobil-watchful", "rss-cautious"
BESIDE_LEFT = [Car(100.0, 1, 30.0), Car(100.0, 2, 30.0)]
FREE = pytest.approx(2.0 * (1.0 - (30.0 / 35.0) ** 4))


def decide(model: NddModel, av: str | AvModel, world: World, substep: int = 0) -> tuple[float, int]:
    """(acceleration, target lane)."""
    setting = setting_of(model, ROAD, av=av_named(av) if isinstance(av, str) else av)
    scratch = allocate_scratch(world.vehicles.size, NO_POLICY)
    return built_in_av_decides(world, substep, setting.road, setting.av, scratch.av)


def changing(model: NddModel, cars: list[Car], changes: dict[int, int]) -> World:
    """A world in which slots change to lanes for 1.5 s now: all AVs see it, and no centre is over the line."""
    world = world_of(cars)
    for slot, lane in changes.items():
        change_lane(world, slot, lane, setting_of(model, ROAD).road, ago=1.5)
    return world


@pytest.mark.parametrize("av", [WATCHFUL, CAUTIOUS])
class TestSomebodyComesInBeside:
    def test_they_make_room_to_the_other_side(self, model: NddModel, av: str) -> None:
        assert decide(model, av, changing(model, BESIDE_LEFT, {1: 1}))[1] == 0
        mirrored = [Car(100.0, 1, 30.0), Car(100.0, 0, 30.0)]
        assert decide(model, av, changing(model, mirrored, {1: 1}))[1] == 2

    def test_they_brake_where_there_is_no_room(self, model: NddModel, av: str) -> None:
        world = changing(model, [*BESIDE_LEFT, Car(99.0, 0, 30.0)], {1: 1})
        command, lane = decide(model, av, world)
        assert command == {WATCHFUL: -4.0, CAUTIOUS: -8.0}[av]
        assert lane == 1

    def test_they_go_ahead_of_one_that_is_behind(self, model: NddModel, av: str) -> None:
        cars = [Car(100.0, 1, 30.0), Car(97.0, 2, 30.0), Car(99.0, 0, 30.0)]
        assert decide(model, av, changing(model, cars, {1: 1})) == (2.0, 1)

    def test_who_keeps_its_lane_or_is_far_concerns_them_not(self, model: NddModel, av: str) -> None:
        assert decide(model, av, world_of(BESIDE_LEFT)) == (FREE, 1)
        assert decide(model, av, changing(model, [BESIDE_LEFT[0], Car(92.9, 2, 20.0)], {1: 1})) == (FREE, 1)

    def test_the_plain_one_sees_nothing(self, model: NddModel, av: str) -> None:
        world = changing(model, [*BESIDE_LEFT[:1], Car(99.9, 2, 30.0)], {1: 1})
        assert decide(model, PLAIN, world) == (FREE, 1)
        assert decide(model, av, world) != (FREE, 1)


@pytest.mark.parametrize("av", [WATCHFUL, CAUTIOUS])
class TestWhileTheyChangeLanes:
    def test_they_turn_back_before_one_who_comes_fast(self, model: NddModel, av: str) -> None:
        world = changing(model, [Car(100.0, 0, 25.0), Car(80.0, 1, 38.0)], {0: 1})
        assert decide(model, av, world)[1] == 0
        assert decide(model, PLAIN, world)[1] == 1

    def test_they_turn_back_from_one_who_enters_from_the_far_side(self, model: NddModel, av: str) -> None:
        world = changing(model, [Car(100.0, 0, 30.0), Car(108.0, 2, 30.0)], {0: 1, 1: 1})
        assert decide(model, av, world)[1] == 0

    def test_not_into_somebody_beside_them(self, model: NddModel, av: str) -> None:
        cars = [Car(100.0, 0, 25.0), Car(80.0, 1, 38.0), Car(98.0, 0, 25.0)]
        assert decide(model, av, changing(model, cars, {0: 1}))[1] == 1

    def test_not_when_their_centre_is_over(self, model: NddModel, av: str) -> None:
        world = changing(model, [Car(100.0, 0, 25.0), Car(80.0, 1, 38.0)], {0: 1})
        world.vehicles["y"][0] = 4.1
        assert decide(model, av, world)[1] == 1

    def test_they_go_on_where_nothing_is_wrong(self, model: NddModel, av: str) -> None:
        assert decide(model, av, changing(model, [Car(100.0, 0, 25.0)], {0: 1}))[1] == 1


def test_the_cautious_one_restores_the_rss_distance(model: NddModel) -> None:
    beside = [Car(100.0, 0, 30.0), Car(100.0, 2, 30.0)]  # no lane change helps
    setting = setting_of(model, ROAD)
    for gap, expected in ((20.0, -6.0), (30.86, -6.0), (30.88, idm_acceleration(30.0, 30.88, 0.0, setting.av.idm))):
        world = world_of([Car(100.0, 1, 30.0), Car(105.0 + gap, 1, 30.0), *beside])
        command, _ = decide(model, CAUTIOUS, world)
        assert command == pytest.approx(expected, abs=1e-9)
    near = world_of([Car(100.0, 1, 30.0), Car(110.0, 1, 20.0), *beside])
    assert decide(model, CAUTIOUS, near)[0] == -8.0
    assert decide(model, PLAIN, near)[0] == -4.0


def test_the_cautious_one_minds_who_enters_its_lane_ahead(model: NddModel) -> None:
    cars = [Car(100.0, 1, 30.0), Car(120.0, 2, 30.0)]
    assert decide(model, CAUTIOUS, world_of(cars))[0] > 0.0
    assert decide(model, CAUTIOUS, changing(model, cars, {1: 1}))[0] == pytest.approx(-900.0 / (2.0 * (15.0 + 56.25)))


@pytest.mark.parametrize(("gap", "changes"), [(54.0, False), (54.5, True)])
def test_the_cautious_one_changes_at_rss_distance_of_the_rear(model: NddModel, gap: float, changes: bool) -> None:
    # Behind: 30 + 0.5 + 31^2 / 12 - 30^2 / 16 = 54.33 m.
    cars = [Car(100.0, 0, 30.0), Car(150.0, 0, 25.0), Car(95.0 - gap, 1, 30.0)]
    assert decide(model, CAUTIOUS, world_of(cars))[1] == changes
    assert decide(model, PLAIN, world_of(cars))[1] == 1
    # ... and turns back when it is no longer safe.
    assert decide(model, CAUTIOUS, changing(model, cars, {0: 1}))[1] == changes


def biased(model: AvModel, action: int) -> AvModel:
    """A learned AV that always likes one action best, and holding its speed second."""
    shape = NetworkShape(N_AV_FEATURES, 1, 0, 8)
    weights = np.zeros(n_weights(shape), dtype=np.float32)
    weights[len(weights) - 33 + 22] = 0.5
    weights[len(weights) - 33 + action] = 1.0
    return replace(model, network=AvNetwork(shape, weights, AV_FEATURES_VERSION))


def test_the_learned_one_decides_twice_a_second_and_goes_on_between(model: NddModel) -> None:
    av = biased(av_named("rl"), 2)
    world = world_of([Car(100.0, 1, 30.0)])
    world.vehicles["commanded"][0] = 0.6
    decided = [decide(model, av, world, substep) for substep in range(10)]
    assert decided == [(-4.0 if substep in (0, 5) else 0.6, 1) for substep in range(10)]


def test_the_learned_one_stays_on_the_road(model: NddModel) -> None:
    left, right = biased(av_named("rl"), 0), biased(av_named("rl"), 1)
    assert [decide(model, left, world_of([Car(100.0, lane, 30.0)]))[1] for lane in range(3)] == [1, 2, 2]
    assert [decide(model, right, world_of([Car(100.0, lane, 30.0)]))[1] for lane in range(3)] == [0, 0, 1]
    # A running change is not repeated, but may be turned.
    running = changing(model, [Car(100.0, 0, 30.0)], {0: 1})
    assert decide(model, left, running)[1] == 1
    assert decide(model, right, running) == (0.0, 0)


@pytest.mark.parametrize("name", sorted(set(AVS) - set(SITE_AVS)))
def test_no_av_commands_more_than_its_law_declares(model: NddModel, name: str) -> None:
    """The bounds of who can touch whom within a second rest on it; the hostile BV gives cause for hard braking."""
    odd = replace(WIDE, max_jerk=math.inf)  # then an acceleration is the command
    setting = setting_of(model, odd, av=av_of(name), adversary="swerve")
    recorder = Recorder(setting, odd)
    commands = np.concatenate([recorder.record(3, test).acceleration[:, 0] for test in range(60)])
    assert commands.min() >= -setting.av.hardest_braking
    assert commands.max() <= setting.av.strongest_acceleration
    if name == "rss-cautious":  # the negative control: with the IDM's limits it would be a wrong declaration
        assert commands.min() < -setting.av.idm.max_braking
