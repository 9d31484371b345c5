"""AVs from outside at a site: what they see, how they are asked, and what is refused."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.foreign import site_scene
from cornerforge.foreign.edge_cases import trials_of
from cornerforge.foreign.interface import AvContext
from cornerforge.foreign.programs import _question_at_site
from cornerforge.foreign.session import context_of
from cornerforge.foreign.site_cases import SITE_CASES, random_scenes, site_case
from cornerforge.sim import keep_nothing, lockstep, simulate
from cornerforge.sim.av_scene import SITE_COLUMNS
from cornerforge.sim.controllers import OUTSIDE
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.site import scene
from cornerforge.types import CLASSES, Odd
from cornerforge.verbs.check_av import check_av
from cornerforge.world_options import WorldOptions

EXAMPLE = Path(__file__).parents[2] / "examples" / "junction_av.py"
SITE = WorldOptions(site="mcity-signal")
AVS = """
import numpy as np

class One:
    answers = "acceleration"
    def plan(self, scene):
        ahead = [a for a in scene.agents if 0 < a.x < 15 and abs(a.y) < 2]
        stops = scene.light in ("red", "yellow") and 0 < scene.to_stop_line < 20
        return -4.0 if ahead or stops else float(scene.path.limit[0]) - scene.own.vx

class All:
    interface = 2
    answers = "acceleration"
    def act(self, scenes):
        a, m = scenes.agents, scenes.moment
        ahead = (a.there & (a.x > 0) & (a.x < 15) & (np.abs(a.y) < 2)).any(axis=1)
        stops = ((m.light == 1) | (m.light == 2)) & (m.to_stop_line > 0) & (m.to_stop_line < 20)
        return np.where(ahead | stops, -4.0, scenes.path.limit[:, 0] - scenes.own.vx)

class Wide(All):
    def act(self, scenes):
        return np.zeros((len(scenes.running), 2))

class Nan(All):
    def act(self, scenes):
        return np.where(scenes.moment.time > 3.0, np.nan, 0.0)

class Lane:
    def act(self, view):
        return np.zeros((len(view), 2))
"""
PROGRAM = """
import json, sys
for line in sys.stdin:
    said = json.loads(line)
    if said["type"] == "hello": print(json.dumps({"type": "hello", "answers": "acceleration", "memory": False}))
    if said["type"] == "setup":
        assert said["site"]
        print(json.dumps({"type": "ready"}))
    if said["type"] == "scene":
        ahead = any(0 < a["x"] < 15 and abs(a["y"]) < 2 for a in said["agents"])
        stops = said["light"] in ("red", "yellow") and 0 < said["to_stop_line"] < 20
        a = -4.0 if ahead or stops else said["path"][0]["limit"] - said["own"]["vx"]
        print(json.dumps({"type": "answer", "world": said["world"], "answer": a}))
    sys.stdout.flush()
"""


@pytest.fixture
def avs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "site_avs_here.py").write_text(AVS)
    shutil.copy(EXAMPLE, tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def odd() -> Odd:
    with pytest.warns(UserWarning, match="Site:"):
        return experiment(SITE, av="idm-yield").odd


def run_of(av: str, **changed: object) -> Experiment:
    with pytest.warns(UserWarning, match="Site:"):
        return experiment(replace(SITE, av=av, **changed), takes_foreign=True)  # type: ignore[arg-type]


def test_the_two_lists_of_columns_are_one() -> None:
    assert (site_scene.COLUMNS, site_scene.FIRST_AGENT) == (SITE_COLUMNS, scene.FIRST_AGENT)
    assert site_scene.PATH_POINTS == scene.PATH_POINTS
    for k, name in enumerate(site_scene.AGENT):
        assert getattr(scene, name.upper()) == k
    for k, name in enumerate(site_scene.MOMENT):
        assert getattr(scene, name.upper()) == k
    for k, name in enumerate(site_scene.PATH):
        assert getattr(scene, {"x": "PATH_X", "y": "PATH_Y", "heading": "PATH_HEADING"}.get(name, name.upper())) == k
    assert list(site_scene.KINDS) == [one.name for one in CLASSES]


def test_a_context_says_where_it_is(odd: Odd) -> None:
    told = context_of(odd, batch=2, seed=0)
    assert told.site == "mcity NODE_18"
    assert AvContext.of_stated(json.loads(json.dumps(told.stated()))) == told
    assert "site" not in context_of(Odd(), batch=2, seed=0).stated()


def test_objects_and_lines_say_what_arrays_say(odd: Odd) -> None:
    context = context_of(odd, batch=2, seed=0)
    table = random_scenes(np.random.default_rng(3), (2,))
    scenes = site_scene.SiteScenes(table, context)
    assert scenes.running.all()
    one, agents = scenes.scene(1), scenes.agents
    assert [agent.x for agent in one.agents] == agents.x[1][agents.there[1]].tolist()
    assert [site_scene.KINDS.index(agent.kind) for agent in one.agents] == agents.kind[1][agents.there[1]].tolist()
    assert one.light == site_scene.LIGHTS[scenes.moment.light[1]]
    assert one.own.vx == scenes.own.vx[1]
    said = json.loads(_question_at_site(1, table[1].tolist()))
    assert [agent["y"] for agent in said["agents"]] == [agent.y for agent in one.agents]
    assert [point["limit"] for point in said["path"]] == one.path.limit.tolist()
    assert (said["light"], said["own"]["vx"]) == (one.light, one.own.vx)
    with pytest.raises(AttributeError, match="there are: id, kind"):
        _ = agents.speed


@pytest.mark.usefixtures("avs", "in_memory")
def test_one_by_one_and_all_at_once_drive_alike() -> None:
    """The same law asked world by world, for all worlds, and in batches of another size gives the same tests."""
    codes = []
    for av, batch in (("One", 5), ("All", 5), ("All", 2)):
        run = run_of(f"site_avs_here:{av}", av_batch=batch)
        out, _ = run.asked(run.opened_setting, run.slots, 7, 0, 5, False)  # type: ignore[misc]
        codes.append([*out.code, *out.frame, *out.bv_crashes, *np.round(out.distance, 9)])
        recorded = run.recorder().record(7, 3)
        assert len(recorded.x) == out.frame[3] + 1
        run.rest()
    assert codes[0] == codes[1] == codes[2]
    assert len(set(codes[0][5:10])) > 1


@pytest.mark.usefixtures("avs")
@pytest.mark.full
@pytest.mark.processes
def test_a_program_drives_as_the_class() -> None:
    Path("program.py").write_text(PROGRAM)
    frames = []
    for av in ("site_avs_here:One", f"cmd: {sys.executable} program.py"):
        run = run_of(av, av_batch=4)
        frames.append(run.asked(run.opened_setting, run.slots, 7, 0, 4, False)[0].frame.tolist())  # type: ignore[misc]
        run.rest()
    assert frames[0] == frames[1]


@pytest.mark.usefixtures("avs", "in_memory")
def test_an_av_in_the_wrong_place_is_told_what_to_do() -> None:
    run = run_of("site_avs_here:Lane")
    with pytest.raises(InputError, match=r"drives on roads only.*answers = \"acceleration\".*docs/site-avs.md"):
        run.asked.open()  # type: ignore[union-attr]
    run = experiment(WorldOptions(av="site_avs_here:All"), takes_foreign=True)
    with pytest.raises(InputError, match="drives at sites only; give one, such as --site mcity-signal"):
        run.asked.open()  # type: ignore[union-attr]


@pytest.mark.usefixtures("avs", "in_memory")
def test_answers_of_another_shape_or_nan_are_refused() -> None:
    with pytest.warns(UserWarning, match="Site:"):
        wide = check_av("site_avs_here:Wide", site="mcity-signal", tests=2)
    assert not wide.passed
    assert any("expected (" in check.found for check in wide.checks)
    run = run_of("site_avs_here:Nan", av_batch=3)
    tally = simulate(run.opened_setting, run.slots, seed=1, tests=3, drive=run.asked)  # type: ignore[arg-type]
    assert tally.av_faults == 3
    assert {fault.message for fault in run.asked.faults.values()} == {"answered with NaN or infinity"}  # type: ignore[union-attr]
    run.rest()


def test_trials_are_of_the_place(odd: Odd) -> None:
    at_site, on_road = trials_of(odd), trials_of(Odd())
    assert set(at_site.names) == set(SITE_CASES)
    assert at_site.names != on_road.names
    for name in at_site.names:
        table = at_site.case(name)
        away = np.hypot(*table[site_scene.FIRST_AGENT :, 4:6].T)
        there = table[site_scene.FIRST_AGENT :, 0] >= 0.0
        assert (np.diff(away[there]) >= 0.0).all(), name
        assert not table[site_scene.FIRST_AGENT :][~there][:, 1:].any()
    assert at_site.doubt("red ahead", 0.5, 0.0)
    assert not at_site.doubt("red ahead", -3.0, 0.0)


@pytest.mark.full
@pytest.mark.usefixtures("avs", "in_memory")
@pytest.mark.parametrize("name", ["MyAv", "MyHastyAv"])
def test_the_examples_answer_as_one_would_expect(name: str) -> None:
    with pytest.warns(UserWarning, match="Site:"):
        found = check_av(f"junction_av.py:{name}", site="mcity-signal", tests=20)
    strange = {check.name for check in found.checks if check.verdict != "ok"}
    assert found.passed
    overlooked = {"person behind a truck that stands beside", "person on the path", "person about to cross"}
    assert strange <= (overlooked if name == "MyHastyAv" else set())


@pytest.mark.usefixtures("avs")
def test_the_flaw_of_the_hasty_example_is_what_it_says(odd: Odd) -> None:
    """Behind the truck a person is not heeded; in the open after a second."""
    sys.path.insert(0, str(Path.cwd()))
    try:
        example = importlib.import_module("junction_av")
    finally:
        sys.path.pop(0)
    context = context_of(odd, batch=1, seed=0)
    answers = {}
    for name in ("person on the path", "person behind a truck that stands beside"):
        hasty = example.MyHastyAv()
        hasty.setup(context)
        for time in (5.0, 5.5, 6.0):
            table = site_case(name)[None].copy()
            table[0, 1, 0] = time
            scenes = site_scene.SiteScenes(table, context)
            answers[name, time] = hasty.act(scenes)[0], example.MyAv().act(scenes)[0]
    first, open_later = answers["person on the path", 5.0], answers["person on the path", 6.0]
    assert first[1] < -1.0 < first[0]
    assert open_later[0] == open_later[1]
    hidden, still = (
        answers["person behind a truck that stands beside", 5.0],
        answers["person behind a truck that stands beside", 6.0],
    )
    assert hidden[1] < 0.0 < hidden[0]
    assert still[0] == hidden[0]


def test_what_is_seen_is_what_is_there(odd: Odd) -> None:
    """Each number against the recorded world, turned and moved into the AV's frame by NumPy."""
    with pytest.warns(UserWarning, match="Site:"):
        run = experiment(SITE, av="idm-yield")

    setting = run.setting.with_drivers(av=OUTSIDE)
    batch = lockstep.allocate_batch(1, run.slots, np.zeros((1, 22 + run.slots - 1, 10)), run.setting.road)
    s = allocate_scratch(run.slots, setting.who.policy)

    keep, done = keep_nothing(run.slots), np.zeros(1, dtype=np.int64)
    lights = set()
    priorities = set()
    assert odd.site is not None
    for test in range(6):
        lockstep.begin(5, np.zeros(1, dtype=np.int64), np.array([test]), setting, batch)
        for _ in range(60):
            if not lockstep.running(batch).size:
                break
            lockstep.see(batch, setting, s)
            seen, v = batch.views[0], batch.worlds.vehicles[0]
            turn = np.array(
                [
                    [np.cos(v["heading"][0]), np.sin(v["heading"][0])],
                    [-np.sin(v["heading"][0]), np.cos(v["heading"][0])],
                ]
            )
            route = odd.site.routes[int(batch.worlds.agents[0, 0]["route"])]
            own_s = float(batch.worlds.agents[0, 0]["s"])
            there = seen[22:][seen[22:, 0] >= 0]
            slots = there[:, 0].astype(int)
            assert set(slots) == set(np.flatnonzero(v["present"])) - {0}
            apart = np.stack([v["x"][slots] - v["x"][0], v["y"][slots] - v["y"][0]])
            np.testing.assert_allclose(there[:, 4:6], (turn @ apart).T, atol=1e-9)
            ways = v["heading"][slots]
            moves = v["speed"][slots] * np.stack([np.cos(ways), np.sin(ways)])
            np.testing.assert_allclose(there[:, 7:9], (turn @ moves).T, atol=1e-9)
            np.testing.assert_array_equal(there[:, 1], v["kind"][slots])
            for k in (0, 4, 19):
                s_there = own_s + 2.0 * (k + 1)
                if s_there < route.length:
                    x, y = (np.interp(s_there, route.along, column) for column in route.line.T)
                    np.testing.assert_allclose(seen[2 + k, :2], turn @ [x - v["x"][0], y - v["y"][0]], atol=0.05)
            assert abs(seen[1, 2] - (route.stop - own_s - 0.5 * v["length"][0])) < 1e-9
            lights.add(int(seen[1, 3]))
            priorities |= set(there[:, 9].astype(int))
            lockstep.act(np.array([[0.3 * (8.0 - v["speed"][0]), 0.0]]), False, setting, batch, s, keep, done)
        lockstep.stop(batch, np.zeros(1, dtype=np.int64))
    assert {1, 3} <= lights
    assert priorities == {-1, 0, 1}
