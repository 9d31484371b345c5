"""The C yardstick against the Numba kernels: outcomes and final states, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hand_built import WIDE, setting_of
from yardstick import COMPILER, INFO, Memory, Yardstick, allocate_memory, has_compiler, same_outcomes

from cornerforge.drivers.avs import AVS, av_named
from cornerforge.ndd.model import Memory as DriverMemory
from cornerforge.ndd.model import NddModel
from cornerforge.sim.drive import drive_range
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.outcome import AV_CRASH, allocate_outcomes
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.scratch import Scratch, allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.world import World, allocate_worlds, n_slots, world_of
from cornerforge.types import ODDS, Odd, odd_named

pytestmark = pytest.mark.skipif(not has_compiler(), reason=f"no {COMPILER}")

PLAIN = sorted(name for name, av in AVS.items() if av.kind == "plain")
TESTS = 500
"""Per setting: 2 lanes and 3, both AV parameter sets and the blind one, make 3,000."""


@pytest.fixture(scope="module")
def reckless(model: NddModel) -> NddModel:
    """Drivers with habits that change lanes often, overlook much and start at unlike speeds: every branch is taken."""
    initial = replace(
        model.initial, speed_sd=3.5, rr_scale=3.0, min_ttc=8.0, habit_spread=0.3, change_median=5.17, noise_spread=1.0
    )
    memory = DriverMemory(near=0.25, near_width=0.1, far=0.2, far_width=0.45, habit=0.35, habit_width=0.2)
    base = np.full(21, 0.2, dtype=np.float32)
    return replace(model, lc_base=base, overlook=0.5, overlook_conflict=0.5, memory=memory, initial=initial)


def final_state(held: World | Memory, info: np.ndarray) -> tuple[bytes, ...]:
    """All of a world that means something, as bytes."""
    n_vehicles, n_current = info[INFO.index("n_vehicles")], info[INFO.index("n_current")]
    return (
        held.vehicles[:n_vehicles].tobytes(),
        held.order[:n_vehicles].tobytes(),
        held.current[:n_current].tobytes(),
        info.tobytes(),
    )


def info_of(world: World, scratch: Scratch) -> np.ndarray:
    """What the yardstick has in `info`."""
    numbers = [world.state[name] for name in INFO]
    return np.concatenate([*numbers, world.av["lead"][0], world.av["rear"][0], scratch.front])


class Happened(NamedTuple):
    """Over some tests: AV crashes, BV-BV crashes, and BVs that were turning back from a lane change at the end."""

    av_crashes: int
    bv_crashes: int
    returns: int


def running_returns(world: World) -> int:
    """BVs on their way back to the lane they came from: only such a path begins with a lateral speed."""
    bvs = world.vehicles[1 : world.state["n_vehicles"][0]]
    return int(((bvs["present"] == 1) & (bvs["duration"] > 0.0) & (bvs["c1"] != 0.0)).sum())


def assert_equal_test_by_test(setting: Setting, odd: Odd, tests: int, seed: int = 5) -> Happened:
    """Drive tests one by one in both and compare bytes; returns what happened in them."""
    slots = n_slots(odd)
    yardstick = Yardstick(setting)
    world, scratch = world_of(allocate_worlds(1, slots)), allocate_scratch(slots, setting.who.policy)
    memory, nothing = allocate_memory(slots), keep_nothing(slots)
    ours, theirs = allocate_outcomes(1), allocate_outcomes(1)
    av_crashes = bv_crashes = returns = 0
    for test in range(tests):
        drive_range(seed, test, setting, world, scratch, nothing, ours)
        yardstick.drive_range(seed, test, memory, theirs)
        assert same_outcomes(ours, theirs), f"test {test}: other outcomes"
        our_state, their_state = final_state(world, info_of(world, scratch)), final_state(memory, memory.info)
        assert our_state == their_state, f"test {test}: other final states"
        av_crashes += int(ours.code[0] == AV_CRASH)
        bv_crashes += int(ours.bv_crashes[0])
        returns += running_returns(world)
    return Happened(av_crashes, bv_crashes, returns)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("av", PLAIN)
@pytest.mark.parametrize("lanes", [2, 3])
def test_natural_traffic_is_the_same_bit_for_bit(model: NddModel, lanes: int, av: str) -> None:
    odd = replace(WIDE, n_lanes=lanes)
    assert_equal_test_by_test(setting_of(model, odd, av=av_named(av)), odd, TESTS)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", sorted(set(ODDS) - {"mixed"}))  # the yardstick knows cars only
@pytest.mark.parametrize("av", PLAIN)
def test_reckless_traffic_is_the_same_bit_for_bit(reckless: NddModel, name: str, av: str) -> None:
    odd = replace(odd_named(name), n_lanes=4, traffic_length=700.0)
    happened = assert_equal_test_by_test(setting_of(reckless, odd, av=av_named(av)), odd, TESTS)
    assert happened.av_crashes > 1, f"too little happened that is worth comparing: {happened}"
    assert happened.bv_crashes > 100, f"too little happened that is worth comparing: {happened}"
    if odd.lane_change_duration > 1.0:  # a shorter one is over before the next decision
        assert happened.returns > 100, f"too little happened that is worth comparing: {happened}"


def test_a_polite_av_is_the_same_bit_for_bit(model: NddModel) -> None:
    av = av_named("idm-mobil")
    polite = replace(av, mobil=replace(av.mobil, politeness=0.5))
    assert_equal_test_by_test(setting_of(model, av=polite), WIDE, 100)


def test_chunks_are_the_same(model: NddModel) -> None:
    setting, slots = setting_of(model), n_slots(WIDE)
    ours, _ = drive_chunk(setting, slots, 3, 100, 200, False)
    assert same_outcomes(ours, Yardstick(setting).drive_chunk(slots, 3, 100, 200))


def test_the_comparison_sees_the_last_bit(model: NddModel) -> None:
    # Negative control: an AV whose desired speed is one bit larger.
    setting, slots = setting_of(model), n_slots(WIDE)
    idm = setting.av.idm
    other = setting._replace(
        av=setting.av._replace(idm=idm._replace(desired_speed=float(np.nextafter(idm.desired_speed, 99.0))))
    )
    ours, _ = drive_chunk(setting, slots, 3, 0, 300, False)
    assert not same_outcomes(ours, Yardstick(other).drive_chunk(slots, 3, 0, 300))


def test_other_settings_are_refused(model: NddModel) -> None:
    with pytest.raises(ValueError, match="without an adversary"):
        Yardstick(setting_of(model, adversary="uniform"))
    with pytest.raises(ValueError, match="without an adversary"):
        Yardstick(setting_of(model, idm_bvs=True))
    with pytest.raises(ValueError, match="plain AV"):
        Yardstick(setting_of(model, av=av_named("rss-cautious")))
