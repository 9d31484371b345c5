from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, Car, glide, setting_of, world_of
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.drivers.avs import av_named
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import lane_bits
from cornerforge.sim.actions import start_lane_change
from cornerforge.sim.av_kinds import built_in_av_decides
from cornerforge.sim.controllers import TOLD
from cornerforge.sim.decide import decide_bvs
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.loop import MILESTONE, OVER, advance, answer_as_bv
from cornerforge.sim.outcome import AV_CRASH, BV_CRASH, COMPLETED, RUNNING, TIME_UP
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.step import allocate_recording, av_acts, begin_to_act, move_on
from cornerforge.sim.world import NO_ACTION, World
from cornerforge.types import SUBSTEPS

KEEP_SPEED = 22
ODD = replace(WIDE, n_lanes=3)
AT_ONCE = replace(ODD, max_jerk=math.inf)


def step(
    world: World,
    setting: Setting,
    *,
    action: int = NO_ACTION,
    test: int = 0,
    frames: int = 0,
    recording: np.ndarray | None = None,
) -> np.ndarray:
    """One second, in which the BV nearest to the AV does `action` (NO_ACTION: nobody is controlled)."""
    slots = world.vehicles.size
    if recording is None:
        recording = allocate_recording(frames, slots)
    keep = keep_nothing(slots)._replace(recording=recording)
    world.state["test"] = test
    if action != NO_ACTION:
        setting = setting.with_drivers(critical=TOLD)
        answer_as_bv(world, action)
    until = int(world.state["decisions"][0]) + 1
    why = advance(world, setting, allocate_scratch(slots, NO_POLICY), keep, until)
    assert why == (MILESTONE if world.state["outcome"][0] == RUNNING else OVER)
    assert world.state["decisions"][0] == until
    return recording


def step_controlling(world: World, setting: Setting, slot: int, action: int) -> None:
    """One second, in which any BV does `action`, be it the nearest to the AV or not: the parts of `advance`."""
    scratch = allocate_scratch(world.vehicles.size, NO_POLICY)
    nothing = allocate_recording(0, world.vehicles.size)
    world.state["controlled"] = slot
    for substep in range(SUBSTEPS):
        if substep % setting.road.av_substeps == 0:
            command, lane = built_in_av_decides(world, substep, setting.road, setting.av, scratch.av)
            if substep == 0:
                decide_bvs(world, action, lane, setting, scratch)
                begin_to_act(world, command, lane, False, setting, scratch)
            else:
                av_acts(world, command, lane, setting.road)
        if move_on(world, substep, setting, nothing):
            return


def ending(world: World) -> list[int]:
    """Frame of the end, and the slots in contact."""
    return [int(world.state[name][0]) for name in ("frame", "slot_a", "slot_b")]


# Motion


@given(st.floats(0.0, 40.0), st.sampled_from([-4.0, -1.0, 0.0, 2.0]))
def test_motion_is_that_of_constant_acceleration(model: NddModel, speed: float, acceleration: float) -> None:
    world = world_of([Car(0.0, 0, speed)])
    world.vehicles["acceleration"][0] = acceleration
    for _ in range(SUBSTEPS):
        glide(world, 0, setting_of(model, ODD).road)
    after = speed + acceleration
    if 0.0 <= after <= 40.0:
        assert world.vehicles["x"][0] == pytest.approx(speed + 0.5 * acceleration, abs=1e-9)
        assert world.vehicles["speed"][0] == pytest.approx(after, abs=1e-9)
    elif after < 0.0:
        assert world.vehicles["x"][0] == pytest.approx(speed * speed / 8.0 if acceleration == -4.0 else speed**2 / 2.0)
        assert world.vehicles["speed"][0] == 0.0
    else:
        assert world.vehicles["speed"][0] == 40.0
        assert speed <= world.vehicles["x"][0] <= 40.0


def test_a_lane_change_ends_in_the_centre_after_its_duration(model: NddModel) -> None:
    road = setting_of(model, ODD).road
    world = world_of([Car(0.0, 0, 30.0)])
    start_lane_change(world, 0, 1, road)
    car = world.vehicles[0]
    headings = []
    for k in range(1, 41):
        before = world.vehicles["y"][0]
        glide(world, 0, road)
        assert world.vehicles["y"][0] >= before
        assert world.vehicles["lanes"][0] == lane_bits(world.vehicles["y"][0], 1.0, 1, 4.0)
        assert (world.vehicles["duration"][0] > 0.0) == (k < 40)
        headings.append(world.vehicles["heading"][0])
    assert (car["y"], car["heading"], car["lanes"], car["lateral_speed"]) == (6.0, 0.0, 0b10, 0.0)
    # the steepest is the middle: 1.875 * 4 m / 4 s sideways at 30 m/s
    assert max(headings) == headings[19] == pytest.approx(math.atan(1.875 / 30.0))


def test_a_standing_car_does_not_move_sideways(model: NddModel) -> None:
    road = setting_of(model, ODD).road
    world = world_of([Car(0.0, 0, 0.0)])
    start_lane_change(world, 0, 1, road)
    for _ in range(50):
        glide(world, 0, road)
    assert world.vehicles["y"][0] == 2.0
    assert world.vehicles["target_lane"][0] == 1
    assert world.vehicles["lanes"][0] == 0b11


def test_a_slow_lane_change_takes_longer(model: NddModel) -> None:
    road = setting_of(model, ODD).road
    steps = []
    for speed in (5.0, 2.5):
        world = world_of([Car(0.0, 0, speed)])
        start_lane_change(world, 0, 1, road)
        count = 0
        while world.vehicles["duration"][0] > 0.0:
            glide(world, 0, road)
            count += 1
        steps.append(count)
    assert steps == [40, 80]


# Contacts and ends


def test_the_av_crashes_into_a_standing_car(model: NddModel) -> None:
    world = world_of([Car(450.0, 1, 30.0), Car(461.0, 1, 0.0)])
    recording = step(world, setting_of(model, AT_ONCE), action=KEEP_SPEED, frames=11)
    assert world.state["controlled"][0] == 1
    # bumper to bumper 6 m at 30 m/s, braking with 4 m/s2: 6 m are gone in 0.2029 s, seen at 0.3 s
    assert world.state["outcome"][0] == AV_CRASH
    assert ending(world) == [3, 0, 1]
    assert recording["present"][:, 0].tolist() == [1, 1, 1, 1] + 7 * [0]
    assert recording["x"][3, 0] == pytest.approx(450.0 + 9.0 - 2.0 * 0.09)


def test_the_controlled_bv_ends_the_test_by_crashing_another(model: NddModel) -> None:
    cars = [Car(450.0, 0, 30.0), Car(440.0, 1, 35.0), Car(440.0, 2, 35.0, change_time=1.0)]
    setting = setting_of(model, replace(ODD, max_lateral_acceleration=100.0))
    world = world_of(cars)
    step_controlling(world, setting, 2, action=1)
    assert world.state["outcome"][0] == BV_CRASH
    assert ending(world)[1:] == [1, 2]
    assert world.state["bv_crashes"][0] == 1
    assert world.vehicles["present"].tolist() == [1, 1, 1]  # the last frame shows everybody


def test_other_bvs_that_crash_are_counted_and_removed(model: NddModel) -> None:
    world = world_of([Car(450.0, 0, 30.0), Car(440.0, 2, 35.0), Car(446.0, 2, 0.0), Car(400.0, 2, 30.0)])
    step(world, setting_of(model, ODD))
    assert world.state["outcome"][0] == RUNNING
    assert world.state["bv_crashes"][0] == 1
    assert world.vehicles["present"].tolist() == [1, 0, 0, 1]


def test_a_crash_of_the_av_goes_before_all_others(model: NddModel) -> None:
    # In the first frame slot 1, controlled, is hit by slot 2 further back, and the AV runs into slot 3.
    cars = [Car(450.0, 1, 30.0), Car(430.0, 0, 30.0), Car(424.5, 0, 40.0), Car(455.5, 1, 20.0)]
    setting = setting_of(model, ODD)
    for last, outcome, slots in ((4, AV_CRASH, [0, 3]), (3, BV_CRASH, [1, 2])):
        world = world_of(cars[:last])
        step_controlling(world, setting, 1, action=KEEP_SPEED)
        assert world.state["outcome"][0] == outcome
        assert ending(world) == [1, *slots]
        assert world.state["bv_crashes"][0] == (outcome == BV_CRASH)


@pytest.mark.parametrize(("max_braking", "gap", "crashes"), [(4.0, 2.9, True), (4.0, 3.1, False), (12.0, 6.95, True)])
def test_contacts_by_acceleration_alone_are_found(
    model: NddModel, max_braking: float, gap: float, crashes: bool
) -> None:
    # Equal speeds at first; the AV brakes as hard as it can while the BV behind it accelerates with 2 m/s2: after 1 s
    # the gap is shorter by half the difference. So pairs that can touch must not be sought by present speeds alone.
    av = av_named("idm-mobil")
    av = replace(av, idm=replace(av.idm, max_braking=max_braking))
    setting = setting_of(model, replace(AT_ONCE, av_substeps=10), av=av)
    beside = [Car(450.0, 0, 30.0), Car(450.0, 2, 30.0)]
    world = world_of([Car(450.0, 1, 30.0), Car(445.0 - gap, 1, 30.0), Car(460.0, 1, 30.0), *beside])
    step_controlling(world, setting, 1, action=32)
    assert (world.state["outcome"][0] == AV_CRASH) == crashes
    if crashes:
        assert ending(world) == [10, 0, 1]


def test_the_test_is_over_at_its_length(model: NddModel) -> None:
    world = world_of([Car(798.0, 1, 30.0), Car(1000.0, 1, 30.0)])
    step(world, setting_of(model, ODD))
    assert world.state["outcome"][0] == COMPLETED
    assert world.state["frame"][0] == 1


def test_the_time_runs_out(model: NddModel) -> None:
    setting = setting_of(model, replace(ODD, time_limit=2.0))
    world = world_of([Car(400.0, 1, 0.0), Car(406.0, 1, 0.0)])
    recording = allocate_recording(21, 2)
    for k in range(2):
        assert world.state["outcome"][0] == RUNNING
        step(world, setting, action=KEEP_SPEED, recording=recording)
        assert world.state["controlled"][0] == 1
        assert recording["present"][10 * (k + 1) - 1].all()
    assert world.state["outcome"][0] == TIME_UP
    assert world.state["frame"][0] == 20
    assert recording["present"].all()


# Recordings and what nobody sees


def test_recording_changes_nothing(model: NddModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cars = [Car(float(x), int(rng.integers(3)), float(rng.uniform(25, 35))) for x in np.arange(400.0, 900.0, 35.0)]
    setting = setting_of(model, ODD)
    silent, recorded = world_of(cars), world_of(cars)
    for test in range(3):
        step(silent, setting, test=test)
        step(recorded, setting, test=test, frames=40)
    np.testing.assert_array_equal(silent.vehicles, recorded.vehicles)
    # Who is near the AV, and how many may touch, is noted otherwise where everybody is kept current.
    notes = ("av", "pairs")
    silent.state["n_pairs"] = recorded.state["n_pairs"]
    arrays = recorded.arrays()
    assert set(notes) < set(arrays)
    for name, ours in silent.arrays().items():
        if name not in notes:
            np.testing.assert_array_equal(ours, arrays[name], err_msg=name)


def drive_alone(model: NddModel, others: list[Car], decisions: int = 8) -> list[tuple[float, float, float]]:
    """The AV's way behind a slower lead, with others somewhere."""
    setting = setting_of(model, replace(ODD, test_length=1000.0))
    world = world_of([Car(400.0, 1, 33.0), Car(450.0, 1, 26.0), *others])
    way = []
    for _ in range(decisions):
        step(world, setting)
        av = world.vehicles[0]
        way.append((float(av["x"]), float(av["y"]), float(av["speed"])))
    assert world.state["outcome"][0] == RUNNING
    return way


def test_absent_vehicles_are_as_if_far_away(model: NddModel) -> None:
    poisoned = [Car(0.0, lane, 30.0, present=False) for lane in range(3)]
    far = [Car(5000.0 + 100.0 * lane, lane, 30.0) for lane in range(3)]
    alone = drive_alone(model, [])
    assert drive_alone(model, poisoned) == alone
    assert drive_alone(model, far) == alone
    # negative control: vehicles beside it do matter
    assert drive_alone(model, [Car(398.0, 0, 33.0), Car(402.0, 2, 33.0)]) != alone


def test_once_a_second_is_not_ten_times_a_second(model: NddModel) -> None:
    ways = []
    for av_substeps in (1, 10):
        setting = setting_of(model, replace(AT_ONCE, av_substeps=av_substeps))
        world = world_of([Car(400.0, 1, 33.0), Car(480.0, 1, 32.0), Car(400.0, 0, 33.0), Car(400.0, 2, 33.0)])
        recording = step(world, setting, frames=10)
        ways.append(np.unique(recording["acceleration"][:, 0]).size)
    assert ways == [10, 1]
