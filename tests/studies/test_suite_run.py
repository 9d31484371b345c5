"""`suite run aeb`: tests of automatic emergency braking, and what UN R152 allows in them."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import cornerforge
from cornerforge import cli
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.ext.studies import suite_run as module
from cornerforge.ext.studies.aeb_scenarios import AEB, R152_KMH
from cornerforge.ext.studies.scenarios import Panel, panels, rails_of_panel, road_of_suite
from cornerforge.types import Odd

pytestmark = pytest.mark.full

ROAD = road_of_suite(AEB, Odd())
LEAST_BRAKING = 5.0
"""What R152 demands of an AEB at least (paragraph 5.2.1.2) [m/s2]."""
R152_MAXIMUM_MASS = {**R152_KMH, 42: 10}
AVS = """
import numpy as np

class Brakes:
    def act(self, view):
        return np.tile([-5.0, 0.0], (len(view), 1))


class Changes:
    def act(self, view):
        return np.tile([0.0, 1.0], (len(view), 1))


class Steers:
    answers = "trajectory"

    def plan(self, scene):
        own, t = scene.own, np.arange(0.0, 2.0, 0.1)
        return np.stack([t, own.x + own.vx * t, own.y + 1.5 * t], axis=1)
"""


@pytest.fixture
def avs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "aeb_avs.py").write_text(AVS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


def of(name: str) -> Panel:
    return panels(AEB, [name], ROAD)[0][0]


@pytest.mark.usefixtures("avs", "in_memory")
@pytest.mark.parametrize("jerk", [math.inf, 12.65])
@pytest.mark.parametrize("other_kmh", [0, 20])
def test_an_aeb_that_just_avoids_at_40_kmh_has_the_table_of_r152(
    jerk: float, other_kmh: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Braking by 5 m/s2 from one TTC on, at all relative speeds: speeds at contact, rounded up to 5 km/h, are R152's.

    It avoids at up to 40.5 km/h, so the relative speed at contact is sqrt(v (v - 40.5)). Any of 40 to 41.4 does.
    """
    avoids = 40.5
    ttc = avoids / 3.6 / (2.0 * LEAST_BRAKING) + LEAST_BRAKING / (2.0 * jerk)  # half the time to reach it is lost
    one = np.array([ttc])
    family = replace(of("stationary").family, is_test=lambda _, at: at == ttc)
    every = [
        Panel(family, speed + other_kmh, other_kmh, np.array([float(speed)]), one, np.ones((1, 1), np.bool_), k)
        for k, speed in enumerate(R152_MAXIMUM_MASS)
    ]
    monkeypatch.setattr(module, "panels", lambda *_: (every, []))
    monkeypatch.setattr(module, "road_of_suite", lambda *_: replace(ROAD, max_jerk=jerk))
    found = {test.av_kmh - other_kmh: test for test in cornerforge.suite_run("aeb", av="aeb_avs:Brakes").tests}
    for speed, allowed in R152_MAXIMUM_MASS.items():
        touch = found[speed].touch_kmh
        assert (0.0 if touch is None else 5.0 * math.ceil(touch / 5.0)) == allowed
        late = (3.6 * LEAST_BRAKING**2 / jerk) ** 2 / 12.0  # what else the time to reach it costs
        assert touch is None or touch == pytest.approx(math.sqrt(speed * (speed - avoids) - late), abs=0.05)


def test_scenarios_begin_as_the_protocols_say() -> None:
    every, _ = panels(AEB, [family.name for family in AEB.families], ROAD)
    assert Counter(p.family.name for p in every for _ in range(int(p.tests.sum()))) == {
        "stationary": 16, "moving": 11, "braking": 4,
    }  # fmt: skip
    for panel in every:
        course = rails_of_panel(panel, ROAD)
        for k in np.flatnonzero(panel.tests):
            gap = course.poses[k, 0, 1, 0] - 4.3
            if panel.family.name == "braking":
                assert gap in (12.0, 40.0)
                speed = course.poses[k, :, 1, 2]
                assert speed[0] - speed[20] == pytest.approx(panel.points[1][k] * 1.55)  # reached evenly within 1 s
            else:
                assert gap == pytest.approx(4.0 * (panel.av_kmh - panel.other_kmh) / 3.6)


def test_what_is_said_is_what_happened(tmp_path: Path) -> None:
    said = cornerforge.suite_run("aeb", av="flawed-brakes-late", out=tmp_path / "out", junit=tmp_path / "aeb.xml")
    assert module.fails_the_suite(said) == ""
    touched = [test for test in said.tests if test.verdict == "touched"]
    beyond = [test for test in touched if test.allowed_kmh is not None and (test.touch_kmh or 0.0) > test.allowed_kmh]
    assert len(beyond) == said.beyond_allowed > 0
    assert all(test.allowed_kmh is None for test in said.tests if test.av_kmh > 60 or test.family == "braking")
    with (tmp_path / "out" / "scenarios.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == said.scenarios == 477
    assert {row["verdict"] for row in rows} == {"avoided", "touched"}
    assert all((row["touch_kmh"] != "") == (row["av"] == "failed") for row in rows)
    suite = ElementTree.parse(tmp_path / "aeb.xml").getroot()
    tags = Counter(one.tag for case in suite for one in case)
    by_all = [row for row in rows if row["av"] == "failed" and not any(
        int(row[f"crash_{name}"]) for name in ("cc_human", "reg157", "rss_brake", "fsm")
        if (name, row["family"]) != ("reg157", "braking"))]  # fmt: skip
    assert len(by_all) == said.failed_but_prevented_by_all
    assert tags == {"failure": len(by_all), "skipped": said.failed - len(by_all)}
    assert (suite.get("failures"), suite.get("tests")) == (str(len(by_all)), "477")
    page = (tmp_path / "out" / "aeb.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 3
    assert cornerforge.replay(tmp_path / "out" / "library", "all", check=True).identical
    again = cornerforge.retest(tmp_path / "out" / "library", av="flawed-brakes-late")
    assert again.recorded.still_crashing == said.failed


@pytest.mark.usefixtures("avs", "in_memory")
def test_lanes_beside_are_closed(tmp_path: Path) -> None:
    order = cornerforge.suite_run("aeb", av="aeb_avs:Changes", families="braking")
    assert {test.verdict for test in order.tests} == {"touched"}
    said = cornerforge.suite_run("aeb", av="aeb_avs:Steers", families="braking", junit=tmp_path / "aeb.xml")
    assert "left its lane" in {test.verdict for test in said.tests}
    messages = [one.get("message") for one in ElementTree.parse(tmp_path / "aeb.xml").iter("skipped")]
    assert any(str(message).startswith("left its lane") for message in messages)
    avoided = cornerforge.suite_run("aeb", av="idm-mobil", families=["braking"])
    assert {test.verdict for test in avoided.tests} == {"avoided"}
    assert module.fails_the_suite(avoided) is None


def test_the_command_fails_as_the_av_does(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["suite", "run", "aeb", "--family", "braking", "--json", "--av"]
    assert cli.main([*line, "flawed-brakes-late"]) == 1
    assert json.loads(capsys.readouterr().out)["failed_but_prevented_by_all"] > 0
    assert cli.main([*line, "idm-mobil"]) == 0
    capsys.readouterr()
    assert cli.main(["suite", "run", "aeb", "--av", "flawed-brakes-late", "--family", "stationary"]) == 1
    assert "60 to 0 km/h: touched at 4" in (text := capsys.readouterr().out)
    assert "R152 allows 35" in text


def test_r157_is_a_suite() -> None:
    one = cornerforge.r157(av="cc-human", families=["deceleration"])
    two = cornerforge.suite_run("r157", av="cc-human", families="deceleration")
    assert replace(one, seconds=0.0) == replace(two, seconds=0.0)
    assert one.tests == ()


def test_bad_input_is_named(tmp_path: Path) -> None:
    for suite, given in (("aeb", "lanes"), ("aeb", "road"), ("r157", "road"), ("r157", "traffic")):
        wrong: dict[str, Any] = {given: {"lanes": 2, "road": "curves", "traffic": "dense"}[given]}
        with pytest.raises(InputError, match=rf"scenarios of {suite} .*leave out .*{given}"):
            cornerforge.suite_run(suite, **wrong, out=tmp_path / "out")
    with pytest.raises(UnknownNameError, match="stationary"):
        cornerforge.suite_run("aeb", families=["cut-in"])
    with pytest.raises(InputError, match="Did you mean"):
        cornerforge.suite_run("aebs")
    assert not (tmp_path / "out").exists()
