from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hand_built import WIDE, Car, change_lane, setting_of, world_of

from cornerforge.drivers.policy import NO_POLICY
from cornerforge.drivers.sight import Sight, SightNumbers, numbers_of_sight
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import lane_bits
from cornerforge.sim.actions import hold, start_lane_change
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.neighbours import SIGHT, neighbours_in_lane
from cornerforge.sim.reach import bound_motion, choose_current, find_pairs
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.sight import lanes_seen
from cornerforge.sim.world import UNKNOWN, World, n_slots
from cornerforge.types import ODDS, SUBSTEPS

ODD = replace(WIDE, n_lanes=3)
SIGHTS = [numbers_of_sight(Sight(by)) for by in ("motion", "decision", "centre")]
SIGHTS.append(numbers_of_sight(Sight(perception_time=0.4)))


def test_nobody_drives_farther_or_less_far_than_was_bounded(model: NddModel) -> None:
    """Also an AV that decides anew every 0.1 s, and vehicles that come to a standstill or to the highest speed."""
    rng = np.random.default_rng(6)
    road, passed = setting_of(model, ODD).road, 0
    scratch = allocate_scratch(8, NO_POLICY)
    for _ in range(200):
        world = world_of([Car(100.0 * i, 1, float(rng.choice([0.5, 39.5, rng.uniform(2.0, 39.0)]))) for i in range(8)])
        v = world.vehicles
        v["x_held"], v["speed_held"] = v["x"], v["speed"]
        v["acceleration_held"], v["commanded"] = rng.uniform(-4.0, 2.0, (2, v.size))
        v["acceleration"] = v["acceleration_held"]
        bound_motion(world, 8.0, 2.0, scratch)
        x = v["x"].copy()
        for substep in range(SUBSTEPS):
            hold(v, 0, rng.uniform(-8.0, 2.0), road)
            move_vehicle(v, 0, 0.1, road)
            for i in range(1, v.size):
                move_vehicle(v, i, 0.1 * (substep + 1), road)
            lead = (v["x"] - x) - (v["x"][0] - x[0])
            assert (lead <= np.maximum(0.0, scratch.most - scratch.least[0]) + 1e-9)[1:].all()
            assert (lead >= np.minimum(0.0, scratch.least - scratch.most[0]) - 1e-9)[1:].all()
            passed += int((lead > np.maximum(0.0, scratch.most - scratch.least[0] - 3.0))[1:].any())
    assert passed > 0  # as if the AV braked with 2 m/s2 at most


def nearest_of_all(world: World, lane: int, sight: SightNumbers, lane_width: float) -> tuple[int, int]:
    """The AV's lead and rear in a lane, by looking at everybody."""
    v = world.vehicles
    dx = {
        j: v["x"][j] - v["x"][0]
        for j in range(1, v.size)
        if v["present"][j] and lanes_seen(v, j, lane_width, sight) & (1 << lane)
    }
    ahead = [j for j in dx if 0.0 <= dx[j] < SIGHT]
    behind = [j for j in dx if -SIGHT < dx[j] < 0.0]
    return min(ahead, key=dx.__getitem__, default=-1), max(behind, key=dx.__getitem__, default=-1)


def test_who_is_noted_as_the_avs_neighbour_is_it_all_second(model: NddModel) -> None:
    rng = np.random.default_rng(5)
    road, noted = setting_of(model, ODD).road, 0
    for _ in range(300):
        cars = [Car(200.0, int(rng.integers(3)), rng.uniform(20.0, 40.0))]
        cars += [Car(rng.uniform(-60.0, 460.0), int(rng.integers(3)), rng.uniform(20.0, 40.0)) for _ in range(12)]
        world = world_of(cars)
        v = world.vehicles
        v["x_held"], v["speed_held"] = v["x"], v["speed"]
        v["acceleration_held"], v["commanded"] = rng.choice([-4.0, 0.0, 2.0], (2, v.size))
        v["acceleration_held"][0], v["commanded"][0] = rng.choice([-8.0, 2.0], 2)
        world.order[:] = np.argsort(v["x"])
        scratch = allocate_scratch(v.size, NO_POLICY)
        bound_motion(world, 8.0, 2.0, scratch)
        find_pairs(world, road, scratch)
        choose_current(world, scratch, False, road)
        lanes = [lane for lane in range(3) if world.av["lead"][0, lane] != UNKNOWN]
        noted += len(lanes)
        for substep in range(SUBSTEPS):
            for i in range(v.size):
                move_vehicle(v, i, 0.1 * (substep + 1), road)
            for lane in lanes:
                for sight in SIGHTS:
                    now = nearest_of_all(world, lane, sight, road.lane_width)
                    assert neighbours_in_lane(world, 0, lane, road.lane_width, sight) == now
    assert 300 < noted < 800, f"{noted} of 900 lanes are noted"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["default", "swift", "paper"])
def test_whoever_may_be_seen_in_a_lane_is_looked_at(model: NddModel, name: str) -> None:
    """Many change lanes, some of them turn back: who is the AV's nearest must be among those whose state is current."""
    rng = np.random.default_rng(7)
    road, spared, by_motion_alone = (
        setting_of(model, replace(ODDS[name], n_lanes=3, lane_width=WIDE.lane_width)).road,
        0,
        0,
    )
    for _ in range(300):
        cars = [Car(200.0, int(rng.integers(3)), rng.uniform(20.0, 40.0))]
        cars += [Car(rng.uniform(-60.0, 460.0), int(rng.integers(3)), rng.uniform(20.0, 40.0)) for _ in range(16)]
        world = world_of(cars)
        v = world.vehicles
        v["change_time"] = road.lane_change_duration if road.same_duration else rng.uniform(2.0, 12.0, v.size)
        for j in map(int, np.flatnonzero(rng.random(v.size) < 0.4)):
            old = int(v["target_lane"][j])
            target = 1 if old != 1 else int(rng.choice([0, 2]))
            change_lane(world, j, target, road, ago=float(rng.uniform(0.0, 0.9 * v["change_time"][j])))
            if rng.random() < 0.5:
                start_lane_change(world, j, old, road)
                v["lanes"][j] = lane_bits(v["y"][j], 1.0, old, road.lane_width)  # as one second later
        v["x_held"], v["speed_held"] = v["x"], v["speed"]
        v["acceleration_held"], v["commanded"] = rng.choice([-4.0, 0.0, 2.0], (2, v.size))
        world.order[:] = np.argsort(v["x"])
        scratch = allocate_scratch(v.size, NO_POLICY)
        bound_motion(world, 8.0, 2.0, scratch)
        find_pairs(world, road, scratch)
        choose_current(world, scratch, False, road)
        spared += v.size - int(world.state["n_seen"][0])
        for substep in range(SUBSTEPS):
            for i in range(v.size):
                move_vehicle(v, i, 0.1 * (substep + 1), road)
            for lane in range(3):
                for sight in SIGHTS:
                    now = nearest_of_all(world, lane, sight, road.lane_width)
                    assert neighbours_in_lane(world, 0, lane, road.lane_width, sight) == now
                    by_motion_alone += sum(j > 0 and not v["lanes"][j] & (1 << lane) for j in now)
    assert spared > 300, "everybody is looked at: the case shows nothing"
    assert by_motion_alone > 10 or name == "paper", "nobody is seen in a lane that he has decided to leave"


def test_no_pair_that_touches_is_missing_however_dense_the_traffic_is(model: NddModel) -> None:
    """97 vehicles on six lanes, 6 m apart, standing or at full speed, all of them changing lanes."""
    odd = replace(WIDE, n_lanes=6)
    road, slots = setting_of(model, odd).road, n_slots(odd)
    rng = np.random.default_rng(7)
    world = world_of([Car(100.0 + 6.0 * (i // 6), i % 6, float(rng.choice([0.0, 39.0]))) for i in range(slots)])
    v = world.vehicles
    v["x_held"], v["speed_held"] = v["x"], v["speed"]
    for i in range(slots):
        start_lane_change(world, i, i % 6 + (1 if i % 6 < 3 else -1), road)
    scratch = allocate_scratch(slots, NO_POLICY)
    bound_motion(world, 8.0, 2.0, scratch)
    find_pairs(world, road, scratch)
    n_pairs = int(world.state["n_pairs"][0])
    listed = {(a, b) for a, b in world.pairs[:n_pairs].tolist()}
    assert len(listed) == n_pairs
    touching = set()
    for substep in range(SUBSTEPS):
        for i in range(slots):
            move_vehicle(v, i, 0.1 * (substep + 1), road)
        boxes = [Box(*(float(one[name]) for name in ("x", "y", "heading", "length", "width"))) for one in v]
        touching |= {pair for pair in combinations(range(slots), 2) if boxes_overlap(boxes[pair[0]], boxes[pair[1]])}
    assert touching <= listed
    assert len(touching) > 100, "too few touch"
    assert len(listed) > 8 * slots, "so few pairs fit into less room too"
