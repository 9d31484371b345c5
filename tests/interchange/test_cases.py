"""Moving cases become scripts that drive."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.drivers.rails import ACCELERATION, LANE, POSE_NUMBERS, SPEED, X, Y
from cornerforge.errors import InputError
from cornerforge.experiment.setting import RECORDED_AV, experiment
from cornerforge.library.case_content import case_schema
from cornerforge.library.case_file import case_text, of_moving
from cornerforge.library.out_case import NAME_PATTERN, MovingCase, check_name, safe_name, script_of, straight_road


def braking_leader(frames: int = 58) -> MovingCase:
    """The leader brakes at 6 m/s2, the AV, 20 m behind, keeps its speed: they touch 2.6 s later."""
    time = 0.1 * np.arange(frames)
    poses = np.zeros((frames, 2, POSE_NUMBERS))
    poses[:, :, Y], poses[:, :, LANE] = 1.5 * 3.5, 1
    poses[:, 0, X], poses[:, 0, SPEED] = 25.0 * time, 25.0
    stop = np.minimum(time, 25.0 / 6.0)
    poses[:, 1, X] = 24.6 + 25.0 * stop - 3.0 * stop**2
    poses[:, 1, SPEED], poses[:, 1, ACCELERATION] = 25.0 - 6.0 * stop, np.where(time < 25.0 / 6.0, -6.0, 0.0)
    odd = straight_road(lanes=3, lane_width=3.5, vehicles=2, seconds=0.1 * frames, fastest=25.0, av_size=(4.6, 1.8))
    size = np.array([4.6, 12.0]), np.array([1.8, 2.5])
    return MovingCase("braking", odd, np.array([0, 1], np.int8), *size, poses)


def test_the_av_drives_as_recorded() -> None:
    case = braking_leader()
    driver = experiment(road=case.odd, av=RECORDED_AV, takes_recorded=True).script_driver()
    scenario, _ = driver.record(script_of(case))
    # 24.6 m between centres, 8.3 m of it vehicles: 16.3 = 3 t^2, so contact at 2.331 s, seen in frame 24.
    assert scenario.crash is not None
    assert scenario.crash.slot_b == 1
    assert round(10 * scenario.crash.time) == 24
    np.testing.assert_array_equal(scenario.x[:24], case.poses[:24, :, X])
    np.testing.assert_array_equal(scenario.speed[:24], case.poses[:24, :, SPEED])
    np.testing.assert_array_equal(scenario.length, case.length)


def test_a_better_av_brakes_in_time() -> None:
    case = braking_leader()
    ending = experiment(road=case.odd, av="idm-mobil").script_driver().drive(script_of(case))
    assert ending.pose is None


def test_nobody_recorded_cannot_drive() -> None:
    case = braking_leader()
    unknown = case.poses.copy()
    unknown[1:, 0] = np.nan
    driver = experiment(road=case.odd, av=RECORDED_AV, takes_recorded=True).script_driver()
    with pytest.raises(InputError, match="does not say what the AV did"):
        driver.drive(script_of(replace(case, poses=unknown)))
    with pytest.raises(InputError, match="no AV that could drive on its own"):
        experiment(av=RECORDED_AV)


def test_a_vehicle_may_have_any_size_that_vehicles_have() -> None:
    """A road train of 25 m in an ODD of cars of 4.6 m: half the sum of the lengths less its rear is 6.5 m nearer."""
    case = braking_leader()
    driver = experiment(road=case.odd, av=RECORDED_AV, takes_recorded=True).script_driver()
    longer = replace(case, length=np.array([4.6, 25.0]))
    ending = driver.drive(script_of(longer))
    # 16.3 - 6.5 = 9.8 = 3 t^2: contact at 1.807 s, seen in frame 19.
    assert (ending.frame, ending.partner) == (19, 1)
    for length, width in ((31.0, 2.5), (12.0, 4.1), (0.4, 0.3)):
        with pytest.raises(InputError, match=r"allowed: 0\.5 to 30 m long, 0\.3 to 4 m wide"):
            driver.drive(script_of(replace(case, length=np.array([4.6, length]), width=np.array([1.8, width]))))


def test_a_lane_that_the_road_lacks_is_named() -> None:
    case = braking_leader()
    for lane in (-1.0, 3.0, 0.5):
        poses = case.poses.copy()
        poses[7, 1, LANE] = lane
        with pytest.raises(InputError, match=rf"vehicle 1 is in lane {lane:g} in frame 7; the road has lanes 0 to 2"):
            script_of(replace(case, poses=poses))


@given(st.text(st.characters(), max_size=300), st.floats() | st.integers() | st.text(st.characters(), max_size=50))
def test_whatever_a_file_says_a_case_file_can_hold_it(text: str, fact: float | int | str) -> None:
    """All characters that are, lone halves of pairs among them."""
    name = safe_name(text)
    assert re.fullmatch(NAME_PATTERN.strip("^$"), name)
    assert check_name(f"{name}-12") == f"{name}-12"
    case = replace(braking_leader(11), name=name, facts={text: fact, "text": text * 200}, notes=(text * 10,))
    case_text(of_moving(case, licence=text * 100)).encode()


def test_names_and_the_schema_are_one() -> None:
    assert case_schema()["$defs"]["CaseContent"]["properties"]["name"]["pattern"].startswith(NAME_PATTERN)
