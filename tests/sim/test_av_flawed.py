"""AVs made bad on purpose: each has its flaw, and without occasion for it drives as idm-mobil does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hand_built import WIDE, Car, change_lane, setting_of, world_of

from cornerforge.drivers.avs import AVS, av_named
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ndd.model import NddModel
from cornerforge.road.lanes import lanes_of
from cornerforge.sim.av import WAITS
from cornerforge.sim.av_kinds import built_in_av_decides
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import World, n_slots
from cornerforge.types import Odd

ROAD = WIDE
RAMP = odd_on(Odd(), road_named("on-ramp"), "ramp")
WHERE_LANES_END = ("flawed-merges-blind", "flawed-stops-at-end", "flawed-blocks-mergers")
FLAWED = sorted(name for name, av in AVS.items() if av.kind == "flawed")
Decide = Callable[..., tuple[float, int]]


@pytest.fixture
def decide(model: NddModel) -> Decide:
    def decided(av: str, world: World, second: int = 0, odd: Odd = ROAD) -> tuple[float, int]:
        """(acceleration, target lane), asked twice: what an AV notes must not change its answer."""
        setting = setting_of(model, odd, av=av_named(av))
        scratch = allocate_scratch(world.vehicles.size, NO_POLICY)
        world.state["decisions"] = second
        first = built_in_av_decides(world, 0, setting.road, setting.av, scratch.av)
        assert built_in_av_decides(world, 0, setting.road, setting.av, scratch.av) == first
        return first

    return decided


def test_all_nine_are_there() -> None:
    assert {name.removeprefix("flawed-") for name in FLAWED} == {
        "brakes-late", "not-behind", "not-left", "too-close", "forgets", "hesitates", "merges-blind", "stops-at-end",
        "blocks-mergers",
    }  # fmt: skip


@pytest.mark.parametrize("av", sorted(set(FLAWED) - {"flawed-too-close"}))
def test_with_nobody_to_overlook_they_are_idm_mobil(decide: Decide, av: str) -> None:
    alone = [Car(100.0, 1, 30.0)]
    far = [*alone, Car(260.0, 1, 29.0), Car(240.0, 0, 33.0), Car(20.0, 0, 28.0)]
    assert decide(av, world_of(alone)) == decide("idm-mobil", world_of(alone))
    if av != "flawed-brakes-late":
        assert decide(av, world_of(far)) == decide("idm-mobil", world_of(far))


def test_one_brakes_late_and_then_goes_on_braking(decide: Decide) -> None:
    free = decide("idm-mobil", world_of([Car(100.0, 1, 30.0)]))
    blocked = [Car(100.0, 1, 30.0), Car(118.0, 1, 20.0), Car(100.0, 0, 30.0), Car(100.0, 2, 30.0)]
    world = world_of(blocked)
    assert decide("idm-mobil", world) == (-4.0, 1)
    assert decide("flawed-brakes-late", world) == free  # 13 m at 10 m/s: 1.3 s
    world.vehicles["x"][1] = 114.0
    assert decide("flawed-brakes-late", world) == (-4.0, 1)  # 0.9 s
    world.vehicles["x"][1] = 118.0
    assert decide("flawed-brakes-late", world) == (-4.0, 1)  # noticed


def test_one_looks_at_nobody_behind(decide: Decide) -> None:
    slower = [Car(100.0, 1, 30.0), Car(130.0, 1, 24.0), Car(100.0, 0, 30.0)]
    for behind in (98.0, 88.0):
        world = world_of([*slower, Car(behind, 2, 32.0)])
        assert decide("idm-mobil", world)[1] == 1
        assert decide("flawed-not-behind", world)[1] == 2
    assert decide("flawed-not-behind", world_of([*slower, Car(102.0, 2, 30.0)]))[1] == 1


def test_one_sees_nobody_to_its_left(decide: Decide) -> None:
    slower = [Car(100.0, 1, 30.0), Car(130.0, 1, 24.0)]
    world = world_of([*slower, Car(101.0, 2, 30.0), Car(101.0, 0, 30.0)])
    assert decide("idm-mobil", world)[1] == 1
    assert decide("flawed-not-left", world)[1] == 2
    assert decide("flawed-not-left", world_of([Car(100.0, 2, 30.0), Car(130.0, 2, 24.0), Car(101.0, 1, 30.0)]))[1] == 2


def test_one_forgets_after_two_seconds(decide: Decide) -> None:
    beside = [Car(100.0, 0, 30.0), Car(100.0, 2, 30.0)]
    world = world_of([Car(100.0, 1, 30.0), Car(130.0, 1, 27.0), *beside])
    free = decide("idm-mobil", world_of([Car(100.0, 1, 30.0)]))
    heeded = decide("idm-mobil", world)
    assert [decide("flawed-forgets", world, second) for second in (0, 1, 2)] == 3 * [heeded]
    assert decide("flawed-forgets", world, 3)[0] == free[0]
    world.vehicles["x"][1] = 210.0  # out of its sight, and back
    decide("flawed-forgets", world, 4)
    world.vehicles["x"][1] = 130.0
    assert decide("flawed-forgets", world, 5)[0] == heeded[0]


def test_one_follows_too_close(decide: Decide) -> None:
    world = world_of([Car(100.0, 1, 30.0), Car(120.0, 1, 30.0), Car(100.0, 0, 30.0), Car(100.0, 2, 30.0)])
    assert decide("idm-mobil", world)[0] == -4.0
    assert decide("flawed-too-close", world)[0] > 0.0


def test_one_turns_back_when_it_has_left_its_lane(decide: Decide, model: NddModel) -> None:
    road = setting_of(model, ROAD).road
    for ago, lane in ((1.0, 2), (2.2, 2), (3.2, 1)):
        world = world_of([Car(100.0, 1, 30.0)])
        change_lane(world, 0, 2, road, ago=ago)
        assert decide("idm-mobil", world)[1] == 2
        assert decide("flawed-hesitates", world)[1] == lane


BEGIN, END = next((lane.begin, lane.end) for lane in lanes_of(RAMP) if lane.kind == "acceleration")


def on_the_ramp_road(cars: list[Car]) -> World:
    """Cars in the middle of lanes of the road with a ramp; lane 0 is the acceleration lane."""
    world = world_of(cars)
    world.vehicles["y"] = (world.vehicles["target_lane"] + 0.5) * RAMP.lane_width
    return world


def test_one_merges_without_looking(decide: Decide) -> None:
    beside = [Car(BEGIN + 20.0, 0, 27.0), Car(BEGIN + 21.0, 1, 27.0)]
    assert decide("idm-mobil", on_the_ramp_road(beside), odd=RAMP)[1] == 0
    assert decide("flawed-merges-blind", on_the_ramp_road(beside), odd=RAMP)[1] == 1
    on_the_ramp = [Car(BEGIN - 20.0, 0, 27.0), Car(BEGIN - 19.0, 1, 27.0)]
    assert decide("flawed-merges-blind", on_the_ramp_road(on_the_ramp), odd=RAMP)[1] == 0


def test_one_stops_at_the_end_and_waits_there(decide: Decide) -> None:
    free = on_the_ramp_road([Car(BEGIN + 20.0, 0, 27.0)])
    assert decide("idm-mobil", free, odd=RAMP)[1] == 1
    assert decide("flawed-stops-at-end", free, odd=RAMP)[1] == 0
    near = on_the_ramp_road([Car(END - 60.0, 0, 15.0)])
    assert decide("flawed-stops-at-end", near, odd=RAMP)[0] < -2.5
    standing = on_the_ramp_road([Car(END - 25.0, 0, 0.0)])
    lanes = [
        decide("flawed-stops-at-end", standing, second, odd=RAMP)[1] for second in (20, 20 + WAITS - 1, 20 + WAITS)
    ]
    assert lanes == [0, 0, 1]


def test_one_speeds_up_beside_a_vehicle_that_must_merge(decide: Decide) -> None:
    fast = [Car(BEGIN + 20.0, 1, 32.0), Car(BEGIN + 45.0, 0, 30.0)]
    alone, with_it = on_the_ramp_road(fast[:1]), on_the_ramp_road(fast)
    assert decide("flawed-blocks-mergers", alone, odd=RAMP) == decide("idm-mobil", alone, odd=RAMP)
    assert decide("idm-mobil", with_it, odd=RAMP) == decide("idm-mobil", alone, odd=RAMP)
    assert decide("flawed-blocks-mergers", with_it, odd=RAMP) == (AVS["idm-mobil"].idm.max_acceleration, 1)
    coming = on_the_ramp_road([fast[0], fast[1]._replace(x=BEGIN + 32.0, speed=26.0)])
    coming.vehicles["y"][1], coming.vehicles["target_lane"][1], coming.vehicles["duration"][1] = 3.0, 1, 4.0
    coming.vehicles["lateral_speed"][1], coming.vehicles["lanes"][1] = 1.0, 0b11
    assert decide("idm-mobil", coming, odd=RAMP)[0] < -2.0
    assert decide("flawed-blocks-mergers", coming, odd=RAMP)[0] > 0.0


@pytest.mark.parametrize("av", WHERE_LANES_END)
def test_where_no_lane_ends_they_drive_as_idm_mobil_does(model: NddModel, av: str) -> None:
    odd = Odd()
    one, other = (
        drive_chunk(setting_of(model, odd, av=av_named(name)), n_slots(odd), 2, 0, 4_000, False)[0]
        for name in (av, "idm-mobil")
    )
    for name in one._fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
