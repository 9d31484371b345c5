"""Roads whose lanes begin and end: what AVs from outside are told of them, and how they drive there."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

import cornerforge
from cornerforge.errors import InputError
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.experiment.setting import experiment
from cornerforge.foreign.interface import AvContext
from cornerforge.foreign.scene import COLUMNS, Scenes
from cornerforge.foreign.session import context_of
from cornerforge.road.lanes import must_leave_by
from cornerforge.road.straight import road_numbers
from cornerforge.sim.outcome import COMPLETED, LEFT_ROAD
from cornerforge.types import Odd
from cornerforge.verbs.sentences.driving import simulate_text
from cornerforge.world_options import WorldOptions

EXAMPLE = Path(__file__).parents[2] / "examples" / "merging_av.py"
ROADS = [
    ("on-ramp", "through"), ("on-ramp", "ramp"), ("exit", "through"), ("exit", "exit"), ("weaving", "ramp"),
    ("weaving", "exit"), ("lane-drop", "through"), ("work-zone", "through"),
]  # fmt: skip
AVS = """
from cornerforge.errors import InputError

class Keeps:
    memory = False
    def plan(self, scene):
        return 0.3 * (30.0 - scene.own.vx), 0

class Refuses:
    def setup(self, context):
        if context.lanes:
            raise InputError("Refuses plans on lanes without an end.")
    def plan(self, scene):
        return 0, 0

class Right:
    memory = False
    def plan(self, scene):
        return 0.3 * (25.0 - scene.own.vx), -1
"""


def context_on(name: str, task: str = "through") -> tuple[Odd, AvContext]:
    odd = odd_on(Odd(), road_named(name), task)
    return odd, context_of(odd, batch=2, seed=0)


@pytest.mark.parametrize(("name", "task"), ROADS)
def test_lanes_end_where_the_simulator_says(name: str, task: str, seed: int) -> None:
    odd, context = context_on(name, task)
    road = road_numbers(odd)
    for x in np.random.default_rng(seed).uniform(-400.0, 1500.0, 300):
        by = [must_leave_by(lane, x + odd.av_start, task == "exit", road) - odd.av_start for lane in range(odd.n_lanes)]
        expected = [0.0 if leave_by == -inf else leave_by - x for leave_by in by]
        np.testing.assert_allclose(context.lane_ends_in(np.arange(odd.n_lanes), x), expected, atol=1e-9)
        assert context.lane_ends_in([-1, odd.n_lanes], x).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("name", "task"), ROADS)
def test_an_av_is_told_in_plain_json(name: str, task: str) -> None:
    _, context = context_on(name, task)
    text = json.dumps(context.stated(), allow_nan=False)
    assert AvContext.of_stated(json.loads(text)) == context
    assert json.loads(text)["task"] == task


def test_limits_are_told() -> None:
    _, context = context_on("work-zone")
    assert {(one.slot, one.limit) for one in context.lanes if one.begin < 600.0 < one.end} == {(0, 22.2), (1, 22.2)}
    assert {one.limit for one in context_on("on-ramp")[1].lanes} == {33.3}
    road = road_named("lane-drop")
    free = replace(road, lanes=tuple(replace(lane, limit=None) for lane in road.lanes))
    assert {one.limit for one in context_of(odd_on(Odd(), free), batch=1, seed=0).lanes} == {inf}


@pytest.mark.parametrize("odd", [Odd(), context_on("straight")[0], context_on("curves")[0]])
def test_where_lanes_go_on_nothing_more_is_told(odd: Odd) -> None:
    context = context_of(odd, batch=2, seed=0)
    stated = context.stated()
    assert {**stated, "task": "through", "lanes": (), "site": ""} == asdict(context)
    assert list(stated)[-1] == "most_lateral_acceleration"
    assert AvContext.of_stated(stated) == context
    assert context.lane_ends_in([-1, 0, 2, 3], 50.0).tolist() == [0.0, inf, inf, 0.0]
    assert context.route_lanes == (0, 1, 2)
    assert context.centre_line(-1, 0.0, 10.0).tolist() == [[x, -1.83] for x in (0.0, 5.0, 10.0)]


def test_lines_of_lanes_are_no_longer_than_lanes() -> None:
    _, ramp = context_on("on-ramp", "ramp")  # it starts 150 m before the acceleration lane of 250 m
    merging, through = ramp.centre_line(0, -900.0, 900.0), ramp.centre_line(1, -900.0, 900.0)
    assert (merging[[0, -1], 0].tolist(), set(merging[:, 1])) == ([-350.0, 400.0], {1.83})
    assert through[[0, -1], 0].tolist() == [-900.0, 900.0]
    assert [ramp.edge(k, -900.0, 900.0)[-1, 0] for k in range(3)] == [400.0, 900.0, 900.0]
    assert ramp.centre_line(0, 400.0, 900.0).shape == ramp.edge(0, 400.0, 900.0).shape == (0, 2)
    _, works = context_on("work-zone")
    begins, ends = (next(one for one in works.lanes if one.slot == 2 and getattr(one, end) == far)
                    for end, far in (("begin", -inf), ("end", inf)))  # fmt: skip
    assert works.centre_line(2, 0.0, 2000.0)[-1, 0] == begins.end
    assert works.centre_line(2, begins.end, 2000.0)[0, 0] == ends.begin


def test_the_route_is_what_leads_to_the_goal() -> None:
    found = {(name, task): context_on(name, task)[1].route_lanes for name, task in ROADS}
    assert found == {
        ("on-ramp", "through"): (1, 2, 3), ("on-ramp", "ramp"): (1, 2, 3), ("exit", "through"): (1, 2, 3),
        ("exit", "exit"): (0,), ("weaving", "ramp"): (1, 2, 3), ("weaving", "exit"): (0,),
        ("lane-drop", "through"): (1, 2), ("work-zone", "through"): (0, 1),
    }  # fmt: skip


def test_scenes_know_how_far_lanes_go() -> None:
    _, context = context_on("on-ramp", "ramp")
    table = np.zeros((2, 1, len(COLUMNS)))
    table[:, 0, COLUMNS.index("x")], table[:, 0, COLUMNS.index("length")] = (0.0, 300.0), 5.0
    scenes = Scenes(table, context)
    assert scenes.lane_ends_in(0).tolist() == [400.0, 100.0]
    assert scenes.lane_ends_in(np.array([0, 1])).tolist() == [400.0, inf]
    assert [scenes.scene(1).lane_ends_in(lane) for lane in (-1, 0, 1)] == [0.0, 100.0, inf]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(EXAMPLE, tmp_path)
    (tmp_path / "others.py").write_text(AVS, encoding="utf-8")


@pytest.mark.usefixtures("in_memory", "here")
@pytest.mark.parametrize(
    ("av", "name", "task", "code"),
    [
        ("merging_av:MergingAv", "on-ramp", "ramp", COMPLETED),
        ("merging_av:MergingAv", "exit", "through", COMPLETED),
        ("others:Keeps", "on-ramp", "ramp", LEFT_ROAD),
    ],
)
def test_an_av_that_heeds_the_end_of_its_lane_merges(av: str, name: str, task: str, code: int) -> None:
    run = experiment(WorldOptions(av=av, road=name, task=task), takes_foreign=True)
    assert run.asked is not None
    outcomes, _ = run.asked(run.setting, run.slots, 3, 0, 10, False)
    run.rest()
    assert outcomes.code.tolist().count(code) >= 9


@pytest.mark.usefixtures("in_memory", "here")
def test_an_order_to_where_no_lane_is_is_not_carried_out() -> None:
    run = experiment(WorldOptions(av="others:Right", road="exit"), bv="idm", takes_foreign=True)
    begin = min(one.begin for one in context_of(run.odd, batch=1, seed=0).lanes if one.slot == 0)
    driven = run.recorder().record(3, 0)
    run.rest()
    x, y = driven.x[:, 0] - run.odd.av_start, driven.y[:, 0]
    assert (y[x < begin] > run.odd.lane_width).all()
    assert (x < begin).sum() > 50
    assert y.min() < run.odd.lane_width


@pytest.mark.usefixtures("in_memory", "here")
def test_a_planner_may_refuse_such_a_road() -> None:
    assert cornerforge.simulate(av="others:Refuses", tests=2).tests == 2
    with pytest.raises(InputError, match="Refuses plans on lanes without an end"):
        cornerforge.simulate(av="others:Refuses", road="on-ramp", tests=2)


@pytest.mark.full
@pytest.mark.usefixtures("in_memory", "here")
@pytest.mark.parametrize(
    ("av", "package"), [("fiss_av.py:FissPlus", "fiss_planner"), ("highway_env_av.py:HighwayIdm", "highway_env")]
)
def test_planners_of_others_refuse_it(av: str, package: str) -> None:
    pytest.importorskip(package)
    with pytest.raises(InputError, match="lanes without an end"):
        cornerforge.simulate(av=str(EXAMPLE.parent / av), road="on-ramp", tests=2)


@pytest.mark.usefixtures("in_memory", "here")
def test_tests_in_which_the_av_left_the_road_are_counted() -> None:
    found = cornerforge.simulate(av="others:Keeps", road="on-ramp", task="ramp", tests=20, seed=2)
    assert found.left_road is not None
    assert 15 < found.left_road <= 20 - found.av_crashes
    assert f"in {found.left_road} tests the AV left the road; " in simulate_text(found)
    assert cornerforge.simulate(road="on-ramp", task="ramp", tests=20, seed=2).left_road == 0
