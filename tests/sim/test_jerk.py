"""Accelerations go to the commanded ones at the ODD's jerk: motion in closed form, and what tests record."""

from __future__ import annotations

import math
from dataclasses import replace

import numba
import numpy as np
import pytest
from hand_built import setting_of
from hypothesis import example, given
from hypothesis import strategies as st

from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import road_numbers
from cornerforge.sim.actions import hold
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.world import VEHICLE
from cornerforge.types import ODDS, Odd

TINY = 1e-5
TOP = 40.0


@numba.njit(error_model="numpy")
def integrate(speed: float, a: float, command: float, jerk: float, time: float) -> tuple[float, float]:
    """Distance and speed by steps of TINY: drive or brakes go to the command, and the speed is cut to [0, TOP]."""
    x = 0.0
    steps = int(np.rint(time / TINY))
    for k in range(steps):
        gone = (k + 0.5) * TINY * jerk
        force = min(a + gone, command) if command > a else max(a - gone, command)
        after = min(max(speed + force * TINY, 0.0), TOP)
        x += 0.5 * (speed + after) * TINY
        speed = after
    return x, speed


def moved(speed: float, a: float, command: float, odd: Odd, times: np.ndarray) -> np.ndarray:
    """Distance, speed and acceleration at some times, (T, 3)."""
    v, road, rows = np.zeros(1, dtype=VEHICLE), road_numbers(odd), []
    v["speed"], v["acceleration"] = speed, a
    hold(v, 0, command, road)
    for time in times:
        move_vehicle(v, 0, float(time), road)
        rows.append([v["x"][0], v["speed"][0], v["acceleration"][0]])
    return np.array(rows)


EDGES = (st.floats(0.0, 2.0), st.floats(0.0, TOP), st.floats(TOP - 2.0, TOP))


@given(
    st.one_of(*EDGES), st.floats(-8.0, 2.0), st.floats(-8.0, 2.0), st.sampled_from([1.0, 4.0, 12.65, 60.0]),
    st.integers(1, 20),
)  # fmt: skip
@example(1.0, -8.0, 2.0, 12.65, 10)  # stands while the brakes are released, then starts
@example(39.9, 2.0, -8.0, 4.0, 10)  # keeps its highest speed until it brakes
@example(39.0, -1.0, 2.0, 4.0, 20)  # slower first, then at its highest speed
@example(0.0, 0.0, -4.0, 12.65, 10)
@example(TOP, 0.0, 2.0, 12.65, 10)
def test_the_closed_form_is_the_integral(speed: float, a: float, command: float, jerk: float, tenths: int) -> None:
    time = 0.1 * tenths
    x, after, _ = moved(speed, a, command, Odd(max_jerk=jerk), np.array([time]))[0]
    # One step in which the force is cut, one in which the speed is: less than (jerk TINY + 10) TINY^2 and jerk TINY^2.
    error = 4.0 * jerk * TINY**2 + 1e-9
    true_x, true_speed = integrate(speed, a, command, jerk, time)
    assert after == pytest.approx(true_speed, abs=error)
    assert x == pytest.approx(true_x, abs=2.0 * error + 20.0 * TINY**2)


def test_a_wrong_ramp_is_seen() -> None:
    # Negative control: at another jerk the same command leads elsewhere.
    x = moved(30.0, 0.0, -8.0, Odd(max_jerk=12.0), np.array([1.0]))[0, 0]
    assert abs(x - integrate(30.0, 0.0, -8.0, 12.65, 1.0)[0]) > 1e-2


def test_a_driver_brakes_by_hand() -> None:
    """From 30 m/s to -8 m/s2 at 10 m/s3: 0.8 s; after it 30 - 3.2 m/s and 24 - 10 0.8^3 / 6 m."""
    ramp, later = moved(30.0, 0.0, -8.0, Odd(max_jerk=10.0), np.array([0.4, 0.8]))
    assert ramp == pytest.approx([12.0 - 10.0 * 0.4**3 / 6.0, 30.0 - 0.8, -4.0])
    assert later == pytest.approx([24.0 - 10.0 * 0.8**3 / 6.0, 26.8, -8.0])


def test_whoever_stands_or_is_at_the_highest_speed_has_no_acceleration() -> None:
    times = np.linspace(0.1, 1.0, 10)
    stopping = moved(0.5, -2.0, -8.0, Odd(), times)
    assert (stopping[3:, 1:] == 0.0).all()
    topping = moved(39.8, 2.0, 2.0, Odd(), times)
    assert (topping[2:, 1:] == [40.0, 0.0]).all()
    released = moved(0.5, -8.0, 2.0, Odd(), times)  # a(t) passes 0 at 0.632 s
    assert (released[1:6, 1:] == 0.0).all()
    np.testing.assert_allclose(released[6:7, 2], 12.65 * 0.7 - 8.0)


@given(st.floats(0.0, TOP), st.floats(-8.0, 2.0), st.floats(-8.0, 2.0))
def test_without_a_limit_the_command_acts_at_once(speed: float, a: float, command: float) -> None:
    odd = Odd(max_jerk=math.inf)
    times = np.array([0.3, 1.0])
    np.testing.assert_array_equal(moved(speed, a, command, odd, times), moved(speed, command, command, odd, times))
    assert moved(speed, a, command, odd, times)[1, 2] == command


def steepest(model: NddModel, odd: Odd, av_tests: int = 60) -> float:
    """Largest change of a recorded acceleration from one frame to the next, stops and highest speeds left out."""
    recorder, largest = Recorder(setting_of(model, odd, adversary="uniform"), odd), 0.0
    for test in range(av_tests):
        scenario = recorder.record(5, test)
        free = (scenario.speed[1:] > 0.0) & (scenario.speed[1:] < odd.max_speed)
        both = scenario.present[1:] & scenario.present[:-1] & free
        largest = max(largest, float(np.abs(np.diff(scenario.acceleration, axis=0))[both].max(initial=0.0)))
    return largest


@pytest.mark.parametrize("name", [name for name, odd in ODDS.items() if odd.max_jerk < math.inf])
def test_no_recorded_acceleration_changes_faster_than_the_limit(model: NddModel, name: str) -> None:
    odd = ODDS[name]
    assert 0.099 * odd.max_jerk < steepest(model, odd) <= 0.1 * odd.max_jerk + 1e-9
    assert steepest(model, replace(odd, max_jerk=math.inf)) > 0.2 * odd.max_jerk  # negative control


def test_what_is_stored_tells_the_limit_and_early_files_had_none() -> None:
    assert ODDS["paper"].max_jerk == math.inf
    assert "max_jerk" not in ODDS["paper"].stated()
    for odd in ODDS.values():
        assert Odd.of_stated(odd.stated()) == odd
    early = {name: value for name, value in Odd().stated().items() if name != "max_jerk"}
    assert Odd.of_stated(early) == Odd(max_jerk=math.inf)
