"""An AV that steers: its motion against the equations of the bicycle, integrated by somebody else; and its limits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hand_built import WIDE, Car, setting_of, world_of
from scipy.integrate import solve_ivp

from cornerforge.drivers.policy import NO_POLICY
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import road_numbers
from cornerforge.sim.bicycle import (
    HARDEST_TURN,
    LARGEST_HEADING,
    MOST_LATERAL_ACCELERATION,
    STEERING_RATE,
    Motion,
    roll,
    steer_on,
    wheelbase_of,
)
from cornerforge.sim.loop import steer_as_av
from cornerforge.sim.reach import bound_motion, find_pairs
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.types import FRAME_S, SUBSTEPS

ODD = WIDE
ROAD = road_numbers(ODD)
LENGTH = ODD.vehicle_length
WHEELBASE = float(wheelbase_of(LENGTH))


def by_the_centre(pose: tuple[float, float, float], speed: float, acceleration: float, curvature: float) -> np.ndarray:
    """Pose of the centre after a step, by the bicycle as textbooks have it: at the centre, with a slip angle."""
    slip = np.arctan(0.5 * WHEELBASE * curvature)

    def rates(t: float, state: np.ndarray) -> list[float]:
        at_centre = (speed + acceleration * t) / np.cos(slip)
        course = state[2] + slip
        return [at_centre * np.cos(course), at_centre * np.sin(course), at_centre * np.sin(slip) / (0.5 * WHEELBASE)]

    return np.asarray(solve_ivp(rates, (0.0, FRAME_S), pose, rtol=1e-11, atol=1e-12).y[:, -1])


def test_it_moves_as_the_equations_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(100):
        pose = 0.0, float(rng.uniform(0, 12)), float(rng.uniform(-0.5, 0.5))
        speed, a = float(rng.uniform(3.0, 38.0)), float(rng.uniform(-6.0, 1.5))
        curvature = float(rng.uniform(-1, 1) * min(0.9 * HARDEST_TURN, 0.9 * MOST_LATERAL_ACCELERATION / speed**2))
        x, y, heading, after, now, bent = roll(Motion(*pose, speed, a, curvature), a, curvature, LENGTH, ROAD)
        np.testing.assert_allclose([x, y, heading], by_the_centre(pose, speed, a, curvature), atol=1e-9)
        assert abs(after - (speed + 0.1 * a)) < 1e-12
        assert now == a
        assert abs(bent - curvature) < 1e-12


def test_the_limits_hold_for_any_answer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cut = 0
    for _ in range(50):
        state = Motion(0.0, 6.0, 0.0, float(rng.uniform(0.0, ROAD.max_speed)), 0.0, 0.0)
        for _ in range(60):
            before = state
            wish = float(rng.normal() * rng.choice([0.01, 1.0, 100.0]))
            state = roll(state, float(rng.uniform(-8.0, 2.0)), wish, LENGTH, ROAD)
            x, _, heading, speed, a, curvature = state
            assert np.isfinite(state).all()
            assert x > before[0] - 1e-12
            assert abs(heading) <= LARGEST_HEADING + 1e-12
            assert 0.0 <= speed <= ROAD.max_speed
            assert abs(curvature) <= HARDEST_TURN + 1e-12
            assert before[3] ** 2 * abs(curvature) <= MOST_LATERAL_ACCELERATION + 1e-9
            slowest = min(abs(before[5]), MOST_LATERAL_ACCELERATION / max(before[3] ** 2, 1e-9))  # what friction undoes
            assert abs(curvature) <= slowest + STEERING_RATE * FRAME_S / WHEELBASE + 1e-12
            if 0.0 < speed < ROAD.max_speed:  # there the acceleration ends at once
                assert abs(a - before[4]) <= ROAD.max_jerk * FRAME_S + 1e-9
            cut += abs(curvature - wish) > 1e-9
    assert cut > 1000


def test_a_standing_car_does_not_turn() -> None:
    pose = roll(Motion(5.0, 6.0, 0.1, 0.0, 0.0, 0.0), -3.0, 0.2, LENGTH, ROAD)
    assert pose[:4] == (5.0, 6.0, 0.1, 0.0)


def test_mirrored_it_does_the_mirrored() -> None:
    left = roll(Motion(0.0, 0.0, 0.05, 30.0, -1.0, 0.001), -2.0, 0.004, LENGTH, ROAD)
    right = roll(Motion(0.0, 0.0, -0.05, 30.0, -1.0, -0.001), -2.0, -0.004, LENGTH, ROAD)
    assert [left[0], -left[1], -left[2], *left[3:5], -left[5]] == list(right)


def test_every_contact_is_among_the_pairs_that_are_looked_at(model: NddModel, seed: int) -> None:
    """Who may touch is bounded at the begin of a second; an AV that steers wildly must not get out of the bounds."""
    rng = np.random.default_rng(seed)
    road, touched = setting_of(model, ODD).road, 0
    for _ in range(400):
        cars = [Car(200.0, 1, float(rng.uniform(1.0, 39.0)))]
        cars += [
            Car(200.0 + float(rng.uniform(-25, 25)), int(rng.integers(3)), float(rng.uniform(1, 39))) for _ in "ab"
        ]
        world = world_of(cars)
        v, state = world.vehicles, world.state[0]
        v["y"][0] = rng.uniform(1.0, 11.0)
        v["heading"][0] = rng.uniform(-0.6, 0.6)
        speed = v["speed"][0]
        v["lateral_speed"][0], v["speed"][0] = speed * np.sin(v["heading"][0]), speed * np.cos(v["heading"][0])
        v["x_held"], v["speed_held"] = v["x"], v["speed"]
        steer_as_av(world, np.zeros(2))
        world.order[: v.size] = np.argsort(v["x"])
        scratch = allocate_scratch(v.size, NO_POLICY)
        bound_motion(world, 12.0, 10.0, scratch)
        find_pairs(world, road, scratch)
        pairs = {(int(a), int(b)) for a, b in world.pairs[: state["n_pairs"]]}
        away = float(rng.choice([-1.0, 1.0]))
        for substep in range(SUBSTEPS):
            steer_on(world, float(rng.uniform(-8, 2)), away * float(rng.uniform(0, 0.2)), road)
            for j in range(1, v.size):
                v["x"][j] = v["x_held"][j] + v["speed"][j] * FRAME_S * (substep + 1)
                if boxes_overlap(
                    *(Box(*(float(v[f][i]) for f in ("x", "y", "heading", "length", "width"))) for i in (0, j))
                ):
                    touched += 1
                    assert (0, j) in pairs
    assert touched > 100


def test_what_others_see_of_it_is_its_motion(model: NddModel) -> None:
    """It drifts from the second lane to the third: seen to enter from 0.375 m off the centre on, then settled there."""
    world = world_of([Car(200.0, 1, 30.0), Car(260.0, 1, 30.0)])
    v, road = world.vehicles, setting_of(model, ODD).road
    steer_as_av(world, np.zeros(2))
    lanes, seen = [], []
    for k in range(60):
        off = 10.0 - v["y"][0]
        steer_on(world, 0.0, 0.004 * off * (1 if k < 60 else 0) / 4 - 0.12 * v["heading"][0], road)
        lanes.append(int(v["target_lane"][0]))
        seen.append((float(v["y"][0]), float(v["duration"][0])))
    first = lanes.index(2)
    assert set(lanes[:first]) == {1}
    assert set(lanes[first:]) == {2}
    assert seen[first][0] >= 6.375
    assert seen[first - 1][0] < 6.375 + 0.1
    assert all(a[1] == 0.0 for a in seen[: first - 1])
    assert seen[first][1] == 1.0
    assert all(b[0] - a[0] < 0.5 for a, b in pairwise(seen))
