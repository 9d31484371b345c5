"""How an AV follows its trajectory: the curve through its poses, and that what was planned is driven."""

from __future__ import annotations

import numpy as np
import pytest
from hand_built import WIDE
from scipy.interpolate import CubicHermiteSpline

from cornerforge.foreign.tracking import POSE_COLUMNS, bend, place_at, track, wheelbase
from cornerforge.road.straight import road_numbers
from cornerforge.sim import av_scene
from cornerforge.sim.bicycle import Motion, rear_axle_behind, roll
from cornerforge.types import FRAME_S

ODD = WIDE
ROAD = road_numbers(ODD)
LENGTH = ODD.vehicle_length


def plan_of(t: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    plan = np.full((t.size, POSE_COLUMNS), np.nan)
    plan[:, 0], plan[:, 1], plan[:, 2] = t, x, y
    return plan


def _slope(t: np.ndarray, values: np.ndarray, j: int) -> float:
    """Derivative at pose j of the polynomial through four poses."""
    first = min(max(j - 1, 0), t.size - 4)
    near = slice(first, first + 4)
    return float(np.polyval(np.polyder(np.polyfit(t[near] - t[j], values[near], 3)), 0.0))


def test_the_curve_is_scipys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for stated in (False, True):
        t = np.cumsum(rng.uniform(0.05, 0.6, 9))
        x, y = 25.0 * t + rng.normal(size=9), rng.normal(size=9)
        plan = plan_of(t, x, y)
        vx, vy = (np.array([_slope(t, values, j) for j in range(9)]) for values in (x, y))
        if stated:
            plan[:, 3], plan[:, 4] = rng.uniform(-0.3, 0.3, 9), rng.uniform(20, 30, 9)
            vx, vy = plan[:, 4] * np.cos(plan[:, 3]), plan[:, 4] * np.sin(plan[:, 3])
        curves = [CubicHermiteSpline(t, values, slopes) for values, slopes in ((x, vx), (y, vy))]
        for moment in rng.uniform(t[0], t[-1], 50):
            wanted = [curve(moment, order) for order in range(3) for curve in curves]
            np.testing.assert_allclose(place_at(plan, 9, moment), wanted, rtol=1e-7, atol=1e-7)


def test_after_its_end_it_goes_straight_on() -> None:
    plan = plan_of(np.array([0.0, 1.0]), np.array([0.0, 20.0]), np.array([5.0, 6.0]))
    assert place_at(plan, 2, 3.0) == (60.0, 8.0, 20.0, 1.0, 0.0, 0.0)


class Car:
    """An AV that tracks, alone."""

    def __init__(self, speed: float) -> None:
        self.state = Motion(0.0, 6.0, 0.0, speed, 0.0, 0.0)

    def own(self) -> np.ndarray:
        x, y, heading, speed, a, curvature = self.state
        row = np.zeros(av_scene.SCENE_COLUMNS)
        swing = float(rear_axle_behind(LENGTH)) * speed * curvature
        row[[av_scene.LENGTH, av_scene.X, av_scene.Y]] = LENGTH, x, y
        row[[av_scene.HEADING, av_scene.AX, av_scene.CURVATURE]] = heading, a, curvature
        row[av_scene.VX] = speed * np.cos(heading) - swing * np.sin(heading)
        row[av_scene.VY] = speed * np.sin(heading) + swing * np.cos(heading)
        return row

    def follow(self, plan: np.ndarray, tenths: int = 1) -> None:
        controls = np.zeros(2 * tenths)
        track(self.own(), plan, len(plan), ROAD, controls)
        for k in range(tenths):
            self.state = roll(self.state, controls[2 * k], controls[2 * k + 1], LENGTH, ROAD)


def smooth(s: np.ndarray) -> np.ndarray:
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


@pytest.mark.parametrize("speed", [15.0, 22.0, 30.0, 36.0])
@pytest.mark.parametrize("apart", [0.1, 0.2, 0.5])
@pytest.mark.parametrize("tenths", [1, 5, 10])
def test_an_evasion_within_the_lane_is_driven_as_planned(speed: float, apart: float, tenths: int) -> None:
    """2.73 m to the left within 1.5 s, 7 m/s2 at most: with lane orders alone 1.10 m came of it."""
    car = Car(speed)
    begin, time = 1.0, 0.0
    at: dict[float, float] = {}
    while time < 4.0 - 1e-9:
        t = np.arange(0.0, 4.01, apart)
        s = np.clip((time + t - begin) / 1.5, 0.0, 1.0)
        plan = plan_of(t, speed * (time + t), 6.0 + 2.73 * smooth(s))
        if apart == 0.5:  # three poses do not tell such a curve without their headings
            vy = 2.73 / 1.5 * 30.0 * s**2 * (1.0 - s) ** 2
            plan[:, 3], plan[:, 4] = np.arctan2(vy, speed), np.hypot(vy, speed)
        car.follow(plan, tenths)
        time += tenths * FRAME_S
        at[round(time, 1)] = car.state[1] - 6.0
        wanted = 2.73 * float(smooth(np.array((time - begin) / 1.5)))
        assert abs(car.state[1] - 6.0 - wanted) < 0.1
        assert abs(car.state[0] - speed * time) < 0.1
    assert abs(at[4.0] - 2.73) < 0.02


@pytest.mark.parametrize("speed", [12.0, 15.0, 22.0, 30.0, 36.0])
def test_a_planner_that_begins_where_it_is_each_time_gets_where_it_wants(speed: float) -> None:
    """It plans anew every 0.1 s, from its own state, a quintic to 3.6 m at a fixed time."""
    car = Car(speed)
    for k in range(40):
        left = max(4.0 - 0.1 * k, 1.0)
        x, y, heading, v, _, curvature = car.state
        vy, ay = v * np.sin(heading) + float(rear_axle_behind(LENGTH)) * v * curvature, v * v * curvature
        t = np.linspace(0.0, left, round(left / 0.1) + 1)
        rows = np.array(
            [
                [left**3, left**4, left**5],
                [3 * left**2, 4 * left**3, 5 * left**4],
                [6 * left, 12 * left**2, 20 * left**3],
            ]
        )
        goal = np.array([9.6 - y - vy * left - 0.5 * ay * left**2, -vy - ay * left, -ay])
        c = np.linalg.solve(rows, goal)
        car.follow(plan_of(t, x + speed * t, y + vy * t + 0.5 * ay * t**2 + c[0] * t**3 + c[1] * t**4 + c[2] * t**5))
    assert abs(car.state[1] - 9.6) < 0.25
    assert abs(car.state[2]) < 0.05


def test_small_errors_die_out() -> None:
    for beside, turned, slower in ((0.3, 0.0, 0.0), (0.0, 0.02, 0.0), (0.0, 0.0, 1.0)):
        car = Car(28.0)
        car.state = Motion(0.0, 6.0 + beside, turned, 28.0 - slower, 0.0, 0.0)
        for k in range(40):
            t = np.arange(0.0, 2.0, 0.2)
            car.follow(plan_of(t, 28.0 * (0.1 * k + t), np.full(t.size, 6.0)))
        x, y, heading, speed, *_ = car.state
        np.testing.assert_allclose([x, y, heading, speed], [112.0, 6.0, 0.0, 28.0], atol=5e-3)


def test_it_brakes_to_a_stand_as_planned() -> None:
    car = Car(20.0)
    for k in range(60):
        t = 0.1 * k + np.arange(0.0, 3.0, 0.1)
        way = np.where(t < 5.0, 20.0 * t - 2.0 * t**2, 50.0)
        car.follow(plan_of(t - 0.1 * k, way, np.full(t.size, 6.0)))
    assert abs(car.state[0] - 50.0) < 0.3
    assert car.state[3] < 0.1
    assert car.state[1] == pytest.approx(6.0, abs=1e-6)


def test_angles_of_wheels_become_curvatures() -> None:
    angles = np.array([0.0, 0.01, -0.3, 1.2, 1.5])
    answers = np.stack([np.zeros(5), angles], axis=1)
    bend(answers, LENGTH)
    np.testing.assert_allclose(answers[:4, 1], np.tan(angles[:4]) / wheelbase(LENGTH), rtol=1e-12)
    assert np.isnan(answers[4, 1])
