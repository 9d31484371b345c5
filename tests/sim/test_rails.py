"""Others on rails: they are where they are told to be, whoever drives and however it is driven."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.drivers.rails import ACCELERATION, LANE, LATERAL_SPEED, POSE_NUMBERS, SPEED, X, Y, keeps_on, slow_down
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.ext.studies.r157_scenarios import R157
from cornerforge.ext.studies.scenarios import Panel, panels, rails_of_panel, road_of_suite
from cornerforge.sim import Setting, controllers, outcome, recorder, runner
from cornerforge.sim.rails import Rails, rails_of
from cornerforge.sim.scripted import Script
from cornerforge.types import Odd, Scenario

ROAD = road_of_suite(R157, Odd())
HEEDLESS = """
import numpy as np

class Heedless:
    def act(self, view):
        return np.zeros((len(view), 2))


class Chaser:
    def setup(self, context):
        self.wanted = context.set_speed

    def act(self, view):
        return np.stack([self.wanted - view[:, 0, 3], np.zeros(len(view))], axis=1)
"""


@pytest.fixture(scope="module")
def panel() -> Panel:
    found, _ = panels(R157, ["cut-in"], ROAD)
    one = next(p for p in found if (p.av_kmh, p.other_kmh) == (60, 30))
    few = np.zeros_like(one.possible)
    few[[3, 8, 30], :] = True
    return replace(one, possible=few)


@pytest.fixture(scope="module")
def rails(panel: Panel) -> Rails:
    return rails_of_panel(panel, ROAD)


@pytest.fixture(scope="module")
def run() -> Experiment:
    return experiment(road=ROAD)


def on(run: Experiment, rails: Rails, kmh: float = 60.0) -> Setting:
    setting = run.setting.with_drivers(critical=controllers.NOBODY, others=controllers.RAILS, rails=rails)
    return setting.with_set_speed(kmh / 3.6)


def record(run: Experiment, rails: Rails, test: int) -> Scenario:
    return replace(run, setting=on(run, rails)).recorder().record(7, test)


def test_they_are_where_they_are_told_to_be(run: Experiment, rails: Rails, panel: Panel) -> None:
    k = int(np.flatnonzero(panel.points[1] == 1.0)[0])
    driven = record(run, rails, rails.first + k)
    frames = len(driven.x)
    told = rails.poses[k, :frames, 1]
    for name, column in (("x", X), ("y", Y), ("speed", SPEED), ("acceleration", ACCELERATION), ("target_lane", LANE)):
        np.testing.assert_array_equal(getattr(driven, name)[:, 1], told[:, column])
    assert (driven.critical_bv == -1).all()
    assert (driven.log_prob_nde == 0.0).all()


def test_an_av_sees_that_one_moves_sideways_before_its_body_is_over_the_line(run: Experiment, rails: Rails) -> None:
    """It brakes while the other's body, 0.95 m to each side, is still in its own lane of 3.5 m."""
    brakes = 0
    for k in range(len(rails.poses)):
        if 0.3 <= rails.poses[k, :, 1, LATERAL_SPEED].max() <= 0.6:
            driven = record(run, rails, rails.first + k)
            over = driven.y[:, 1] + 0.95 > 3.5
            first = int(np.argmax(over)) if over.any() else len(over) - 1
            brakes += driven.acceleration[first, 0] < 0.0
    assert brakes > 0


def test_a_script_a_range_and_a_recording_give_the_same(run: Experiment, rails: Rails) -> None:
    setting = on(run, rails)
    out, _ = runner.drive_chunk(setting, run.slots, 7, rails.first, len(rails.poses), False)
    assert 0 < (out.code == outcome.AV_CRASH).sum() < out.code.size
    driver = run.script_driver()  # its AV drives at another speed; the start says at which it is set to drive here
    for k in range(len(rails.poses)):
        driven = record(run, rails, rails.first + k)
        assert (driven.crash is not None) == (out.code[k] == outcome.AV_CRASH)
        nothing = np.full((len(driven.action), 2), -1, dtype=np.int8)
        poses = rails.poses[k, : 10 * len(nothing) + 1]
        script = Script(driven.slot, rails.start[k], nothing, 7, rails.first + k, poses)
        again, _ = driver.record(script)
        assert recorder.scenario_digest(again) == recorder.scenario_digest(driven)


def test_a_part_of_a_script_is_the_rest_of_it(run: Experiment, rails: Rails) -> None:
    driver = run.script_driver()
    nothing = np.full((6, 2), -1, dtype=np.int8)
    k = len(rails.poses) - 1
    script = Script(np.arange(2, dtype=np.int16), rails.start[k], nothing, 0, 0, rails.poses[k, :61])
    whole, _ = driver.record(script)
    later = driver.later(script, 2)
    assert later is not None
    rest, _ = driver.record(later)
    np.testing.assert_array_equal(rest.x[:, 1], whole.x[20:, 1])
    np.testing.assert_allclose(rest.x[:, 0], whole.x[20:, 0], atol=1e-9)


@pytest.mark.full
@pytest.mark.usefixtures("in_memory")
def test_an_av_from_outside_is_set_to_the_speed_and_drives_the_same_as_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rails: Rails
) -> None:
    (tmp_path / "av_on_rails.py").write_text(HEEDLESS, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    ends = {}
    for name in ("Heedless", "Chaser"):
        run = experiment(av=f"av_on_rails:{name}", road=ROAD, takes_foreign=True, av_batch=4)
        out, _ = run.drive(on(run, rails), run.slots, 0, rails.first, len(rails.poses), False)
        driver = run.script_driver()
        nothing = np.full((36, 2), -1, dtype=np.int8)
        crashed = []
        for k in (0, len(rails.poses) // 2, len(rails.poses) - 1):
            script = Script(np.arange(2, dtype=np.int16), rails.start[k], nothing, 0, 0, rails.poses[k])
            crashed.append(driver.drive(script).pose is not None)
            assert crashed[-1] == (out.code[k] == outcome.AV_CRASH)
        ends[name] = out.code.tolist()
        run.rest()
    assert ends["Heedless"] == ends["Chaser"], "who is set to the speed that it has keeps it"
    assert outcome.AV_CRASH in ends["Chaser"]


def test_one_that_is_absent_for_a_while_touches_nobody() -> None:
    """A standing car in the AV's lane is there only before the AV comes, or all the time."""
    found, _ = panels(R157, ["deceleration"], ROAD)
    start = rails_of_panel(replace(found[2], possible=np.arange(found[2].possible.size).reshape(
        found[2].possible.shape) == 0), ROAD).start  # fmt: skip
    poses = np.full((1, 371, 2, POSE_NUMBERS), np.nan)
    keeps_on(poses[0, :, 1], 30.0, 5.25, 0.0, 1)
    blind = experiment(road=ROAD, av="idm-mobil", lanes=2)
    setting = on(blind, rails_of(start, poses))
    stiff = setting._replace(av=setting.av._replace(idm=setting.av.idm._replace(max_braking=0.1)))
    assert runner.drive_chunk(stiff, blind.slots, 0, 0, 1, False)[0].code[0] == outcome.AV_CRASH
    poses[0, 5:, 1] = np.nan
    gone = on(blind, rails_of(start, poses))
    gone = gone._replace(av=stiff.av)
    assert runner.drive_chunk(gone, blind.slots, 0, 0, 1, False)[0].code[0] != outcome.AV_CRASH


def test_braking_is_built_up_and_ends_in_a_stand() -> None:
    poses = np.zeros((101, POSE_NUMBERS))
    keeps_on(poses, 0.0, 0.0, 20.0, 1)
    slow_down(poses, 6.0, 12.65)
    np.testing.assert_allclose(np.diff(poses[:6, SPEED]) / 0.1, [-1.265, -2.53, -3.795, -5.06, -6.0])
    assert poses[-1, SPEED] == 0.0
    assert poses[-1, X] == poses[-2, X]
    np.testing.assert_allclose(np.diff(poses[:, X]), 0.05 * (poses[1:, SPEED] + poses[:-1, SPEED]), atol=1e-12)


def test_bad_rails_are_named(rails: Rails) -> None:
    with pytest.raises(InputError, match="these are"):
        rails_of(rails.start[:1], rails.poses)
    half = rails.poses.copy()
    half[0, 3, 1, X] = np.nan
    with pytest.raises(InputError, match="absent with NaN"):
        rails_of(rails.start, half)
    nothing = np.full((50, 2), -1, dtype=np.int8)
    with pytest.raises(InputError, match="needs 501 frames"):
        Script(np.arange(2, dtype=np.int16), rails.start[0], nothing, poses=rails.poses[0])
