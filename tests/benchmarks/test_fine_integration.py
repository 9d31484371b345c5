"""Motion and car following against integration in tiny steps."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import fine_integration
import numpy as np
import pytest
from fine_integration import Leads, held_decisions, random_leads, reference, simulated
from hand_built import WIDE
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.drivers.avs import AVS
from cornerforge.road.straight import road_numbers
from cornerforge.sim.actions import hold
from cornerforge.sim.motion import move_vehicle
from cornerforge.sim.world import VEHICLE
from cornerforge.types import ACCELERATIONS

TINY = 2000
"""Steps per second of the integration that motion is compared with."""


def integrate(x: float, speed: float, accelerations: list[float], max_speed: float) -> tuple[float, float]:
    """Where a vehicle ends that holds each acceleration for 1 s: explicit steps, speed cut to [0, max_speed]."""
    h = 1.0 / TINY
    for a in accelerations:
        for _ in range(TINY):
            after = min(max(speed + a * h, 0.0), max_speed)
            x += 0.5 * (speed + after) * h
            speed = after
    return x, speed


@given(
    st.floats(0.0, 40.0),
    st.lists(st.sampled_from([float(a) for a in ACCELERATIONS]), min_size=1, max_size=4),
    st.sampled_from([15.0, 40.0]),
)
def test_motion_is_that_of_tiny_steps(speed: float, accelerations: list[float], max_speed: float) -> None:
    road = road_numbers(replace(WIDE, max_speed=max_speed, max_jerk=math.inf))
    speed = min(speed, max_speed)
    v = np.zeros(1, dtype=VEHICLE)
    v["x"], v["speed"] = 400.0, speed
    for a in accelerations:
        hold(v, 0, a, road)
        for substep in range(10):
            move_vehicle(v, 0, (substep + 1) * 0.1, road)
    x, end = integrate(400.0, speed, accelerations, max_speed)
    # A tiny step that meets a bound is cut in its middle: an error of at most a h^2 / 8 = 1.3e-7 m each time.
    assert v["x"][0] == pytest.approx(x, abs=1e-6)
    assert v["speed"][0] == pytest.approx(end, abs=1e-9)


@pytest.mark.parametrize(("speed", "a", "metres", "end"), [(2.0, -4.0, 0.5, 0.0), (39.0, 2.0, 39.75, 40.0)])
def test_bounds_are_met_within_the_second_by_hand(speed: float, a: float, metres: float, end: float) -> None:
    # 2 m/s at -4 m/s2 stands after 0.5 s and 0.5 m; 39 m/s at 2 m/s2 has 40 m/s after 0.5 s: 19.75 + 20 m.
    v = np.zeros(1, dtype=VEHICLE)
    v["speed"] = speed
    road = road_numbers(replace(WIDE, max_jerk=math.inf))
    hold(v, 0, a, road)
    move_vehicle(v, 0, 1.0, road)
    assert v["x"][0] == pytest.approx(metres, abs=1e-12)
    assert v["speed"][0] == end


@pytest.mark.full
def test_the_reference_has_converged() -> None:
    leads, idm = random_leads(4), AVS["idm-mobil"].idm
    coarse, fine = (reference(leads, idm, steps=steps) for steps in (250, 500))
    for a, b in zip(coarse, fine, strict=True):
        assert np.abs(a - b).max() < 1e-4


@pytest.mark.full
@pytest.mark.parametrize("name", ["idm-mobil", "idm-mobil-d2rl"])
def test_car_following_converges_to_the_continuous_idm(name: str) -> None:
    leads, idm = random_leads(4), AVS[name].idm
    truth = reference(leads, idm, steps=500)
    errors = [
        max(np.abs(a - b).max() for a, b in zip(held_decisions(leads, idm, n), truth, strict=True))
        for n in (10, 20, 40)
    ]
    assert truth[1].min() < 0.1, "nobody stops"
    assert errors[0] < 0.4
    for coarse, fine in pairwise(errors):
        assert fine == pytest.approx(0.5 * coarse, rel=0.1)  # first order


@pytest.mark.parametrize("name", ["idm-mobil", "idm-mobil-d2rl"])
def test_the_simulator_follows_as_its_idm_and_motion_say(name: str) -> None:
    leads, idm = random_leads(4), AVS[name].idm
    for a, b in zip(simulated(leads, idm), held_decisions(leads, idm, 10), strict=True):
        assert np.abs(a - b).max() < 1e-9


def test_a_wrong_reaction_is_seen() -> None:
    # Negative control: an AV with a tenth more time gap is further off than the step explains.
    leads, idm = random_leads(4), AVS["idm-mobil"].idm
    truth = reference(leads, idm, steps=500)
    wrong = held_decisions(leads, replace(idm, time_gap=1.1 * idm.time_gap), 10)
    assert np.abs(wrong[0] - truth[0]).max() > 1.0


def test_leads_are_in_closed_form_too() -> None:
    # Braking at 4 from 10 m/s: stands after 2.5 s and 12.5 m, and stays.
    action = np.zeros((1, fine_integration.SECONDS), dtype=np.int64)
    lead = Leads(action, np.array([50.0]), np.array([0.0]), np.array([10.0]))
    x, v = fine_integration._lead_motion(lead, 10)
    assert x[-1, 0] - x[0, 0] == pytest.approx(12.5, abs=1e-9)
    assert v[24, 0] == pytest.approx(0.4, abs=1e-9)
    assert v[26, 0] == 0.0
