"""No AV knows what a driver has decided: it sees a lane change by its motion."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_built import WIDE, Car, change_lane, setting_of, world_of

import cornerforge.sim
from cornerforge.drivers.avs import AVS, SITE_AVS, AvModel, AvNetwork, av_named
from cornerforge.drivers.policy import NO_POLICY, NetworkShape, n_weights
from cornerforge.drivers.sight import VISIBLE, Sight, numbers_of_sight
from cornerforge.experiment.av_file import av_of
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import RoadNumbers, lane_bits, road_numbers
from cornerforge.sim.actions import nearest_action, start_lane_change
from cornerforge.sim.av_features import AV_FEATURES_VERSION, N_AV_FEATURES
from cornerforge.sim.av_kinds import built_in_av_decides
from cornerforge.sim.av_view import VIEW_COLUMNS, VIEW_ROWS, view_of_av
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.setting import Setting
from cornerforge.sim.sight import lane_entered, lanes_seen
from cornerforge.sim.step import allocate_recording, av_acts, begin_to_act, move_on
from cornerforge.sim.world import World
from cornerforge.types import ACTION_RIGHT

ROAD = WIDE
LANE = ROAD.lane_width
KNOW_DECISIONS = {"idm-mobil-oracle", "idm-mobil-d2rl"}
HOLD = nearest_action(0.0)
"""The action that holds the speed, as a lane change does."""


def learned_by_motion() -> AvModel:
    """A network of random weights, which reacts to anything that it is shown; the shipped `rl` need not."""
    shape = NetworkShape(N_AV_FEATURES, 1, 0, 16)
    weights = np.random.default_rng(1).normal(0.0, 0.3, n_weights(shape)).astype(np.float32)
    return replace(av_named("rl"), network=AvNetwork(shape, weights, AV_FEATURES_VERSION))


def model_of(name: str) -> AvModel:
    return learned_by_motion() if name == "learned" else av_of(name)


def beside_and_ahead() -> World:
    """A slower car ahead of the AV in the left lane, where a change into the AV's lane makes every AV react."""
    return world_of([Car(300.0, 1, 30.0), Car(320.0, 2, 27.0), Car(400.0, 0, 30.0)])


def commands(world: World, setting: Setting, action: int, seconds: int) -> tuple[list[tuple[float, int]], list[float]]:
    """What the AV does every 0.1 s while BV 1 takes an action and then holds its speed; and BV 1's offsets then."""
    scratch, nothing = allocate_scratch(world.vehicles.size, NO_POLICY), allocate_recording(0, 0)
    v = world.vehicles
    found, offsets = [], []
    for second in range(seconds):
        for substep in range(10):
            found.append(built_in_av_decides(world, substep, setting.road, setting.av, scratch.av))
            offsets.append(abs(float(v["y"][1]) - 10.0))
            if substep == 0:
                v["action"][1:] = HOLD
                v["action"][1] = action if second == 0 else HOLD
                world.order[:] = np.argsort(v["x"])
                begin_to_act(world, *found[-1], False, setting, scratch)
            else:
                av_acts(world, *found[-1], setting.road)
            assert not move_on(world, substep, setting, nothing)
    return found, offsets


@pytest.mark.parametrize("name", [*(name for name in AVS if name not in SITE_AVS), "learned"])
def test_an_av_reacts_to_a_lane_change_when_it_shows(model: NddModel, name: str) -> None:
    """Two worlds differ only in what a BV decides. Those that know decisions are the negative control."""
    setting = setting_of(model, ROAD, av=model_of(name))
    changes, offsets = commands(beside_and_ahead(), setting, ACTION_RIGHT, 3)
    keeps, _ = commands(beside_and_ahead(), setting, HOLD, 3)
    differ = [k for k in range(30) if changes[k] != keeps[k]]
    assert differ, "the AV never reacts: the case shows nothing"
    seen = {"centre": 2.0, "motion": 0.375, "decision": 0.0}[model_of(name).sight.by]
    if model_of(name).kind in ("learned", "careful"):
        assert offsets[differ[0]] > 0.0  # it is shown lateral position and speed too
    elif name in KNOW_DECISIONS:
        assert differ[0] <= 5
        assert offsets[differ[0]] < 0.375
    else:
        assert offsets[differ[0]] >= seen
        at_first = next(k for k in range(30) if offsets[k] >= seen)
        assert differ[0] >= at_first + round(10.0 * model_of(name).sight.perception_time)


@pytest.mark.parametrize("name", [*(name for name in AVS if name not in SITE_AVS), "learned"])
@pytest.mark.parametrize("ago", [0.0, 0.5, 1.0, 1.3, 1.6, 1.9, 2.1, 2.6, 3.2])
def test_a_decision_alone_changes_no_command(model: NddModel, name: str, ago: float) -> None:
    """At whatever place of a lane change a driver decides to turn back, or in which lane to begin one."""
    setting = setting_of(model, ROAD, av=model_of(name))
    scratch = allocate_scratch(3, NO_POLICY)
    found, views = [], []
    for turns in (False, True):
        world = beside_and_ahead()
        change_lane(world, 1, 1, setting.road, ago=ago)
        if turns:
            start_lane_change(world, 1, 2, setting.road)
        found.append(built_in_av_decides(world, 0, setting.road, setting.av, scratch.av))
        views.append(shown(world, setting.road))
    assert views[0] == views[1]
    if name not in KNOW_DECISIONS:
        assert found[0] == found[1]


def test_the_oracle_sees_a_decision(model: NddModel) -> None:
    """Negative control of the test above."""
    setting = setting_of(model, ROAD, av=av_named("idm-mobil-oracle"))
    found = []
    for turns in (False, True):
        world = beside_and_ahead()
        change_lane(world, 1, 1, setting.road, ago=0.5)
        if turns:
            start_lane_change(world, 1, 2, setting.road)
            world.vehicles["lanes"][1] = lane_bits(world.vehicles["y"][1], 1.0, 2, LANE)  # as after the next substep
        found.append(built_in_av_decides(world, 0, setting.road, setting.av, allocate_scratch(3, NO_POLICY).av))
    assert found[0] != found[1]


def shown(world: World, road: RoadNumbers) -> bytes:
    """What an AV from outside is shown."""
    view = np.zeros((VIEW_ROWS, VIEW_COLUMNS), dtype=np.float32)
    view_of_av(world, road, VISIBLE, np.zeros(VIEW_ROWS - 1, dtype=np.int64), view)
    return view.tobytes()


@pytest.mark.parametrize("width", [0.8, 2.0, 2.55])
@pytest.mark.parametrize("start", [0, 1])
@pytest.mark.parametrize("wait", [0.0, 0.4])
def test_the_lanes_of_a_lane_change(start: int, width: float, wait: float) -> None:
    """In the old lane until the body has left it; in the new one from 0.375 m on, or 0.4 s later, or the line on."""
    road, sight = road_numbers(ROAD), numbers_of_sight(Sight(perception_time=wait))
    first_in: dict[int, float] = {}
    for tenth in range(40):
        world = world_of([Car(100.0, start, 30.0)])
        v = world.vehicles
        v["width"] = width
        end = 1 - start
        change_lane(world, 0, end, road, ago=0.1 * tenth)
        y = float(v["y"][0])
        body = {int((y - width / 2.0) // LANE), int((y + width / 2.0) // LANE)}
        lanes = {lane for lane in range(3) if lanes_seen(v, 0, LANE, sight) & (1 << lane)}
        assert body <= lanes <= {start, end}
        assert lane_entered(v, 0, LANE, sight) in lanes
        if end in lanes:
            first_in.setdefault(end, 0.1 * tenth)
        elif end in first_in:
            pytest.fail("it is no longer seen in the lane that it enters")
        if not wait:
            assert (end in lanes) == (abs(y - (start + 0.5) * LANE) >= min(0.375, LANE / 2.0 - width / 2.0))
    over_line = {0.8: 1.8, 2.0: 1.5, 2.55: 1.3}[width]
    assert first_in[end] == pytest.approx(1.0 if not wait else min(1.4, over_line))


def test_who_keeps_its_lane_is_in_it_alone() -> None:
    world = world_of([Car(100.0, 1, 30.0)])
    for sight in (Sight(), Sight("decision"), Sight("centre"), Sight(offset=0.0)):
        numbers = numbers_of_sight(sight)
        assert lane_entered(world.vehicles, 0, LANE, numbers) == 1
        assert lanes_seen(world.vehicles, 0, LANE, numbers) == 0b10


def test_a_vehicle_that_stands_enters_no_lane() -> None:
    world = world_of([Car(100.0, 0, 0.0)])
    change_lane(world, 0, 1, road_numbers(ROAD), ago=1.0)
    assert lane_entered(world.vehicles, 0, LANE, VISIBLE) == 1
    world.vehicles["lateral_speed"] = 0.0
    assert lane_entered(world.vehicles, 0, LANE, VISIBLE) == 0


def test_nothing_lies_beyond_the_right_edge() -> None:
    world = world_of([Car(100.0, 1, 30.0)])
    change_lane(world, 0, 0, road_numbers(ROAD), ago=2.5)
    world.vehicles["y"] = 0.9  # as if it swung over the edge
    assert lane_entered(world.vehicles, 0, LANE, VISIBLE) == 0
    assert lanes_seen(world.vehicles, 0, LANE, VISIBLE) == 1


@pytest.mark.parametrize("name", ["av", "av_features", "av_kinds", "av_view"])
def test_no_law_reads_what_other_drivers_decided(name: str) -> None:
    """Of another vehicle than the AV only `sim/sight.py` reads its target lane, lanes and path."""
    path = Path(cornerforge.sim.__file__).with_name(f"{name}.py")
    hidden = re.compile(r"\b(v|w\.vehicles)\[(?!0\])[^\]]+\]\.(target_lane|lanes|duration|clock|action|c[0-5])\b")
    assert not hidden.findall(path.read_text(encoding="utf-8"))
    assert hidden.search("if v[j].target_lane == lane:")
