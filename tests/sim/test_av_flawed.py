"""AVs made bad on purpose: each has its flaw, and without occasion for it drives as idm-mobil does."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hand_built import WIDE, Car, change_lane, setting_of, world_of

from cornerforge.drivers.avs import AVS, av_named
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.ndd.model import NddModel
from cornerforge.sim.av_kinds import built_in_av_decides
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import World

ROAD = WIDE
FLAWED = sorted(name for name, av in AVS.items() if av.kind == "flawed")
Decide = Callable[..., tuple[float, int]]


@pytest.fixture
def decide(model: NddModel) -> Decide:
    def decided(av: str, world: World, second: int = 0) -> tuple[float, int]:
        """(acceleration, target lane), asked twice: what an AV notes must not change its answer."""
        setting = setting_of(model, ROAD, av=av_named(av))
        scratch = allocate_scratch(world.vehicles.size, NO_POLICY)
        world.state["decisions"] = second
        first = built_in_av_decides(world, 0, setting.road, setting.av, scratch.av)
        assert built_in_av_decides(world, 0, setting.road, setting.av, scratch.av) == first
        return first

    return decided


def test_all_six_are_there() -> None:
    assert {name.removeprefix("flawed-") for name in FLAWED} == {
        "brakes-late", "not-behind", "not-left", "too-close", "forgets", "hesitates",
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
