"""Traffic where lanes end: what is stated is what is drawn, none drives where no lane is, and most merge."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from drawn_choices import draw, stated
from hand_built import setting_of
from statistical_bounds import l1_bound, l1_distance

from cornerforge.drivers.policy import NO_POLICY
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.ndd.model import NddModel
from cornerforge.road.lanes import PACE_STEP, lanes_of, must_leave_by, side_to_leave
from cornerforge.road.reference import ReferenceLine
from cornerforge.road.straight import STATED, LawFactors, road_numbers
from cornerforge.sim.keep import keep_nothing, keep_whole_test
from cornerforge.sim.loop import NEVER, advance
from cornerforge.sim.merging import pressed_chance
from cornerforge.sim.neighbours import sort_by_x
from cornerforge.sim.outcome import COMPLETED, LEFT_ROAD, RUNNING
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.step import forget_frames
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import World, allocate_worlds, n_slots, world_of
from cornerforge.types import TRAFFIC, Odd

ROADS = [
    ("on-ramp", "through"), ("on-ramp", "ramp"), ("exit", "exit"), ("weaving", "ramp"), ("lane-drop", "through"),
    ("work-zone", "through"),
]  # fmt: skip
N = 40_000


def odd_of(name: str, task: str = "through") -> Odd:
    return Odd(traffic=name) if name in TRAFFIC else odd_on(Odd(), road_named(name), task)


def a_world(odd: Odd) -> World:
    return world_of(allocate_worlds(1, n_slots(odd)))


def driven(odd: Odd, setting: Setting, seconds: int, test: int = 0) -> World:
    """Traffic of a test after some seconds."""
    world = a_world(odd)
    reset_world(world, 5, test, setting)
    advance(world, setting, allocate_scratch(n_slots(odd), NO_POLICY), keep_nothing(n_slots(odd)), seconds)
    assert world.state["outcome"][0] == RUNNING
    sort_by_x(world)
    return world


def must_merge(world: World, setting: Setting) -> list[int]:
    """BVs that must leave their lane."""
    v = world.vehicles
    there = range(1, int(world.state["n_vehicles"][0]))
    return [i for i in there if v["present"][i] and side_to_leave(v, i, setting.road)[0] != 0]


@pytest.mark.parametrize(
    ("name", "seconds", "law"),
    [
        ("on-ramp", 3, STATED), ("lane-drop", 4, STATED), ("weaving", 4, STATED), ("dense", 5, STATED),
        ("queue", 8, STATED), ("weaving", 4, LawFactors(1.5, 2.0, 0.5, 1.5, 4.0, 0.7, 0.8, 1.4, 0.5)),
    ],
)  # fmt: skip
def test_what_is_stated_is_what_is_drawn_where_traffic_stops(
    model: NddModel, name: str, seconds: int, law: LawFactors
) -> None:  # fmt: skip
    # H0: a BV's action is an independent draw of its stated probabilities; unit: a draw; n = 40,000 sees an L1
    # distance of 0.045; over all BVs of five worlds.
    odd = odd_of(name)
    setting = setting_of(replace(model, memory=replace(model.memory, away=0.05)), odd)
    setting = setting._replace(road=setting.road._replace(law=law))
    worlds = (driven(odd, setting, seconds, test) for test in range(20))
    world = next(w for w in worlds if name in TRAFFIC or len(must_merge(w, setting)) > 1)
    v = world.vehicles
    lane = int(v["target_lane"][0])
    bvs = [i for i in range(1, int(world.state["n_vehicles"][0])) if v["present"][i] and v["x"][i] < 900.0][:30]
    now = {slot: stated(world, slot, setting, lane) for slot in bvs}
    drawn = np.empty((N, len(v)), dtype=np.int64)
    draw(world, lane, setting, allocate_scratch(len(v), NO_POLICY), drawn)
    bound = l1_bound(33, N, comparisons=300)
    for slot in bvs:
        counts = np.bincount(drawn[:, slot], minlength=33)
        assert l1_distance(counts, now[slot]) <= bound, slot
        assert counts[now[slot] == 0.0].sum() == 0
    assert name in TRAFFIC or set(must_merge(world, setting)) & set(bvs)


@pytest.mark.parametrize(("name", "task"), ROADS)
def test_vehicles_drive_where_lanes_are(model: NddModel, name: str, task: str) -> None:
    odd = odd_of(name, task)
    setting, slots = setting_of(model, odd), n_slots(odd)
    world, scratch, keep = a_world(odd), allocate_scratch(slots, NO_POLICY), keep_whole_test(setting, slots)
    lanes = [lane for lane in lanes_of(odd) if lane.kind != "closed"]
    ends: Counter[int] = Counter()
    merged = 0
    for test in range(40):
        forget_frames(keep.recording, keep.recording.shape[0], slots)
        reset_world(world, 7, test, setting)
        advance(world, setting, scratch, keep, NEVER)
        ends[int(world.state["outcome"][0])] += 1
        seen = keep.recording[: int(world.state["frame"][0]) : 10]
        there = seen["present"].astype(bool)
        slot = np.clip(np.floor(seen["y"] / odd.lane_width), 0, odd.n_lanes - 1)
        on_lane = np.zeros_like(there)
        for lane in lanes:
            on_lane |= (slot == lane.slot) & (seen["x"] >= lane.begin) & (seen["x"] < lane.end + 10.0)
        assert on_lane[there].all()
        first, last = seen["target_lane"][0, 0], seen["target_lane"][-1, 0]
        by = must_leave_by(int(first), float(seen["x"][0, 0]), task == "exit", setting.road)
        merged += np.isfinite(by) and first != last
    assert ends[COMPLETED] >= 38
    assert ends[LEFT_ROAD] == 0
    if task == "ramp":
        assert merged >= 38


def test_a_road_whose_lanes_go_on_is_the_straight_one(model: NddModel) -> None:
    straight = odd_of("straight")
    plain = replace(straight, road=None, road_at=0.0)
    one, other = (drive_chunk(setting_of(model, odd), n_slots(odd), 3, 0, 300, False)[0] for odd in (straight, plain))
    for name in one._fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_gaps_are_taken_that_the_rear_vehicle_can_bear() -> None:
    assert pressed_chance(1.0, 14.0, 0.0, 20.0, STATED) == pytest.approx(12.0 / 13.0)
    assert pressed_chance(1.0, 37.0, -10.0, 30.0, STATED) == 0.0  # a second later it would need 2 m/s2
    assert 0.0 < pressed_chance(1.0, 38.0, -10.0, 30.0, STATED) < 0.05
    assert pressed_chance(1.0, 7.8, -3.9, 33.0, STATED) == 0.0  # TTC 2 s: crashes of an AV began so
    assert pressed_chance(0.0, 50.0, 0.0, 30.0, STATED) == pressed_chance(1.0, 2.0, 5.0, 30.0, STATED) == 0.0


def test_urgency_grows_to_the_end_of_a_lane() -> None:
    odd = odd_of("on-ramp", "ramp")
    road = road_numbers(odd)
    v = allocate_worlds(1, 1).vehicles[0]
    v["target_lane"], v["speed"] = 0, 25.0
    end = next(lane.end for lane in lanes_of(odd) if lane.kind == "acceleration")
    for left, urgency in ((600.0, 0.0), (250.0, 0.5), (0.0, 1.0)):
        v["x"] = end - left - 1e-9
        side, found = side_to_leave(v, 0, road)
        assert found == pytest.approx(urgency)
        assert side == (1 if urgency else 0)


def test_drivers_slow_down_for_limits_and_curves(model: NddModel) -> None:
    odd = odd_of("work-zone")
    lanes = road_numbers(odd).lanes
    s = np.arange(lanes.pace.shape[1]) * PACE_STEP
    inside = (s >= 700.0) & (s < 1200.0)
    np.testing.assert_allclose(lanes.pace[1, inside], 22.2 / 33.3)
    speeds = 30.0 * lanes.pace[1]
    assert (np.diff(speeds**2) >= -2.0 * 1.0 * PACE_STEP - 1e-9).all()  # 1 m/s2 is enough
    assert speeds[0] == 30.0
    curves = road_named("curves")
    tight = replace(curves, pieces=ReferenceLine.of_curvature([(2000.0, 0.003, 0.003)]).pieces)
    assert 30.0 * road_numbers(odd_on(Odd(), tight)).lanes.pace.min() == pytest.approx(np.sqrt(2.5 / 0.003))
    assert road_numbers(odd_of("on-ramp")).lanes.pace.size == road_numbers(odd_of("curves")).lanes.pace.size == 0

    setting, slots = setting_of(model, odd), n_slots(odd)
    world, scratch, keep = a_world(odd), allocate_scratch(slots, NO_POLICY), keep_whole_test(setting, slots)
    before: list[float] = []
    within: list[float] = []
    for test in range(30):
        forget_frames(keep.recording, keep.recording.shape[0], slots)
        reset_world(world, 4, test, setting)
        advance(world, setting, scratch, keep, NEVER)
        seen = keep.recording[: int(world.state["frame"][0]) : 10]
        s, there = seen["x"] + odd.road_at, seen["present"].astype(bool)
        before += seen["speed"][there & (s < 400.0)].tolist()
        within += seen["speed"][there & (s > 900.0) & (s < 1200.0)].tolist()
    assert np.median(before) > 27.0
    assert 18.0 < np.median(within) < 23.0
