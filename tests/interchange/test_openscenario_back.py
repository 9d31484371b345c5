"""What is written as OpenSCENARIO is read back as it was: same vehicles, same places, same contact."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crashes_by_hand import LEFT, MIDDLE, RIGHT, Car, Turn, crash, mirrored
from openscenario_read_back import real_crashes
from reference.openscenario import as_in_file

from cornerforge.drivers.rails import HEADING, LANE, SPEED, X, Y
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.ext.interchange.openscenario import VERSIONS, write_openscenario
from cornerforge.ext.interchange.read_openscenario import read_openscenario
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.library.out_case import MovingCase, OutCase, script_of
from cornerforge.types import ODDS, Scenario

SOME = 10
"""Real crashes that a test looks at, of each ODD."""


def back(folder: Path, scenario: Scenario, *, version: str = "1.2", mode: str = "recorded") -> MovingCase:
    file, _ = write_openscenario(OutCase("case", scenario, {"case_id": "0:1"}), folder, version=version, mode=mode)
    return as_in_file(read_openscenario(folder / file))


def contact(case: MovingCase) -> tuple[int, int] | None:
    """First frame in which the AV's box touches another, and the other's column."""
    for frame, poses in enumerate(case.poses):
        boxes = [
            Box(pose[X], pose[Y], pose[HEADING], length, width)
            for pose, length, width in zip(poses, case.length, case.width, strict=True)
        ]
        for column in range(1, len(boxes)):
            if np.isfinite(poses[[0, column], X]).all() and boxes_overlap(boxes[0], boxes[column]):
                return frame, column
    return None


def assert_same(case: MovingCase, scenario: Scenario) -> None:
    frames = len(scenario.x)
    poses = case.poses[:frames]
    there = scenario.present
    np.testing.assert_array_equal(np.isfinite(poses[:, :, X]), there)
    off = np.hypot(poses[:, :, X] - scenario.x, poses[:, :, Y] - scenario.y)
    assert off[there].max() < 1e-5  # [m]; 0.001 is asked for
    np.testing.assert_allclose(poses[there][:, HEADING], scenario.heading[there], rtol=0, atol=1e-7)
    np.testing.assert_allclose(poses[there][:, SPEED], scenario.speed[there], rtol=0, atol=0.25)
    np.testing.assert_array_equal(case.kind, scenario.kind)
    np.testing.assert_allclose(case.length, scenario.length, atol=1e-6)
    np.testing.assert_allclose(case.width, scenario.width, atol=1e-6)
    assert (case.odd.n_lanes, case.odd.lane_width) == (scenario.odd.n_lanes, pytest.approx(scenario.odd.lane_width))
    assert scenario.crash is not None
    other = int(np.flatnonzero(scenario.slot == scenario.crash.slot_b)[0])
    assert contact(case) == (round(10.0 * scenario.crash.time), other)


@pytest.mark.full
@pytest.mark.parametrize("odd", list(ODDS))
def test_real_crashes(odd: str, tmp_path: Path) -> None:
    crashes = real_crashes(odd)[:SOME]
    assert len(crashes) == SOME
    for number, scenario in enumerate(crashes):
        case = back(tmp_path, scenario, version=VERSIONS[number % len(VERSIONS)])
        assert_same(case, scenario)
        assert all("LightStateAction" in note or "does not begin" in note for note in case.notes)  # only indicators
        near = (case.poses[: len(scenario.x), :, LANE] == scenario.target_lane)[scenario.present].mean()
        assert (
            near > 0.9
        )  # a vehicle that has decided and not yet begun to change lanes is not told from one that stays


def test_mirror_images(tmp_path: Path) -> None:
    cut_in = crash(
        Car(100.0, RIGHT, 30.0),
        Car(145.0, MIDDLE, 20.0, pulls=((1.5, -3.0),), turns=(Turn(1.0, 3.0, RIGHT),)),
        Car(60.0, LEFT, 25.0),
    )
    for scenario in (cut_in, mirrored(cut_in)):
        assert_same(back(tmp_path, scenario), scenario)


@pytest.mark.full
@pytest.mark.parametrize("mode", ["controller", "relative"])
def test_an_av_of_the_users(mode: str, tmp_path: Path) -> None:
    for scenario in real_crashes("default")[:SOME]:
        case = back(tmp_path, scenario, mode=mode)
        assert not case.av_is_recorded
        np.testing.assert_allclose(case.poses[0, 0, [X, Y]], [scenario.x[0, 0], scenario.y[0, 0]], atol=1e-5)
        assert case.poses[0, 0, SPEED] == pytest.approx(scenario.speed[0, 0], abs=1e-3)
        if mode == "controller":
            others = scenario.present[:, 1:]
            off = np.abs(case.poses[: len(others), 1:, X] - scenario.x[:, 1:])
            assert off[others].max() < 1e-5


@pytest.mark.full
def test_what_is_read_drives_to_the_same_contact(tmp_path: Path) -> None:
    """The simulator drives what was read as it was recorded, far along the road too, and sees the crash when it was."""
    for number, scenario in enumerate(real_crashes("default")[:SOME]):
        far = replace(scenario, x=scenario.x + 700.0 * number)
        file, _ = write_openscenario(OutCase("case", far, {}), tmp_path)
        case = read_openscenario(tmp_path / file)
        driver = experiment(road=case.odd, av=RECORDED_AV, takes_recorded=True).script_driver()
        found, wanted = driver.record(script_of(case))[0].crash, scenario.crash
        assert found is not None
        assert wanted is not None
        assert found.time == pytest.approx(wanted.time)
        assert scenario.slot[found.slot_b] == wanted.slot_b
