"""Trajectories for the page, and the times to collision beside them."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.analysis.avoidability import WayOut
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.metrics.risk import contact_time, lane_ttc, plane_ttc
from cornerforge.report import cases
from cornerforge.report.cases import case_data
from cornerforge.types import Scenario

MakeScenario = Callable[[int, str], Scenario]
LENGTH, WIDTH = 5.0, 2.0
angle = st.floats(-0.4, 0.4)


def time_of(dx: float, dy: float, vx: float, vy: float, ha: float, hb: float) -> float:
    offset, velocity = np.array([[dx, dy]]), np.array([[vx, vy]])
    return float(contact_time(offset, velocity, np.array([ha]), np.array([hb]), (LENGTH, LENGTH), (WIDTH, WIDTH))[0])


@given(st.floats(-30, 30), st.floats(-8, 8), st.floats(-10, 10), st.floats(-3, 3), angle, angle)
def test_contact_time_equals_stepping_forward(dx: float, dy: float, vx: float, vy: float, ha: float, hb: float) -> None:
    found = time_of(dx, dy, vx, vy, ha, hb)

    def touches(t: float) -> bool:
        return bool(boxes_overlap(Box(0.0, 0.0, ha, LENGTH, WIDTH), Box(dx + vx * t, dy + vy * t, hb, LENGTH, WIDTH)))

    before = min(found, 12.0) - 1e-6
    assert not any(touches(t) for t in np.linspace(0.0, before, 400) if before > 0.0)
    # A graze of a corner lasts too short to be seen by a step after it, hence several.
    if found < 12.0:
        assert any(touches(found + step) for step in (0.0, 1e-9, 1e-7, 1e-5, 1e-3)) or _grazes(dx, dy, vx, vy, ha, hb)


def _grazes(dx: float, dy: float, vx: float, vy: float, ha: float, hb: float) -> bool:
    """Boxes smaller by 1 mm would not touch, so that rounding decides."""
    offset, velocity = np.array([[dx, dy]]), np.array([[vx, vy]])
    small = contact_time(offset, velocity, np.array([ha]), np.array([hb]), (LENGTH - 1e-3,) * 2, (WIDTH - 1e-3,) * 2)
    return bool(np.isinf(small[0]))


def test_contact_time_at_its_edges() -> None:
    assert time_of(20.0, 0.0, -5.0, 0.0, 0.0, 0.0) == pytest.approx(3.0)
    assert time_of(0.0, 4.0, 0.0, -1.0, 0.0, 0.0) == pytest.approx(2.0)
    assert time_of(3.0, 0.0, 0.0, 0.0, 0.0, 0.0) == 0.0
    assert time_of(20.0, 0.0, 5.0, 0.0, 0.0, 0.0) == math.inf
    assert time_of(20.0, 4.0, -5.0, 0.0, 0.0, 0.0) == math.inf
    assert time_of(20.0, 0.0, 0.0, 0.0, 0.0, 0.0) == math.inf
    assert math.isnan(time_of(math.nan, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_both_times_agree_in_one_lane(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(4, "rear")
    ours, plane = lane_ttc(scenario, 1), plane_ttc(scenario, 1)
    assert np.isfinite(ours).all()
    assert ours == pytest.approx(plane)
    # At constant speeds the time falls by a second a second and is over at the crash.
    assert np.diff(ours[:-1]) == pytest.approx(-0.1)
    assert ours[-1] == 0.0


def test_side_by_side_there_is_no_time_in_the_lane(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(0, "side")
    beside = np.abs(scenario.y[:, 1] - scenario.y[:, 0]) >= WIDTH
    along = np.abs(scenario.x[:, 1] - scenario.x[:, 0]) <= LENGTH
    assert (beside & along).any()
    assert np.isinf(lane_ttc(scenario, 1)[beside & along]).all()
    assert np.isfinite(plane_ttc(scenario, 1)[-5:]).all()


@pytest.mark.parametrize("kind", ["side", "cut-in", "rear"])
def test_the_data_are_the_scenario_rounded(make_scenario: MakeScenario, kind: str) -> None:
    scenario = make_scenario(11, kind)
    data = json.loads(json.dumps(case_data("0:11", scenario), allow_nan=False))
    assert data["frames"] == len(scenario.x)
    assert data["vehicles"][0]["slot"] == 0
    assert data["vehicles"][data["partner"]]["slot"] == 1
    assert data["action"].count("change to the left") + data["action"].count("change to the right") == (kind != "rear")
    assert data["p_nde"].count(0.0) == 1
    for vehicle in data["vehicles"]:
        column = int(np.flatnonzero(scenario.slot == vehicle["slot"])[0])
        rows = slice(vehicle["from"], vehicle["from"] + len(vehicle["x"]))
        assert np.array(vehicle["x"]) == pytest.approx(scenario.x[rows, column] - scenario.x[0, 0], abs=6e-4)
        assert np.array(vehicle["y"]) == pytest.approx(scenario.y[rows, column], abs=6e-4)
        assert np.array(vehicle["h"]) == pytest.approx(scenario.heading[rows, column], abs=6e-5)


def test_vehicles_out_of_sight_are_left_out(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(3, "cut-in")
    slots = {vehicle["slot"] for vehicle in case_data("0:3", scenario)["vehicles"]}
    distance = np.nanmin(np.abs(scenario.x - scenario.x[:, :1]), axis=0)
    assert slots == set(scenario.slot[distance <= cases.SIGHT_M].tolist())
    assert 8 not in slots  # it starts 260 m ahead
    assert 5 in slots  # it is there for half of the test only


def test_only_the_end_of_a_long_test_is_kept(make_scenario: MakeScenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "SHOWN_S", 2.0)
    scenario = make_scenario(2, "cut-in")
    data = case_data("0:2", scenario)
    assert data["frames"] == 21
    assert data["first"] == len(scenario.x) - 21
    assert data["crash"] == 20
    assert len(data["ttc"]) == len(data["ttcPlane"]) == 21
    assert data["vehicles"][0]["x"][-1] == pytest.approx(scenario.x[-1, 0] - scenario.x[0, 0], abs=6e-4)


def test_a_test_without_a_crash_can_be_shown(make_scenario: MakeScenario) -> None:
    data = case_data("0:5", dataclasses.replace(make_scenario(5, "side"), crash=None))
    assert data["crash"] is None
    assert data["partner"] == -1
    assert data["ttc"] == []


@pytest.mark.parametrize(("shown_s", "begin_s", "start"), [(30.0, 1.0, 0), (2.0, 3.0, 10), (30.0, 0.0, None)])
def test_the_way_out_is_kept_over_the_frames_shown(
    make_scenario: MakeScenario, monkeypatch: pytest.MonkeyPatch, shown_s: float, begin_s: float, start: int | None
) -> None:
    monkeypatch.setattr(cases, "SHOWN_S", shown_s)
    scenario = make_scenario(2, "cut-in")
    steps = np.arange(10.0 * begin_s + 31.0)
    way = WayOut(begin_s, scenario.x[0, 0] + steps, 100.0 + steps, 200.0 + steps, 0.001 * steps)
    made = case_data("0:2", scenario, way)["wayOut"]
    if start is None:  # a way out that begins at the contact shows nothing
        assert made is None
        return
    n = round(10 * begin_s) + 1 - start
    assert made["from"] == case_data("0:2", scenario)["crash"] - n + 1
    for key, base in (("x", 0.0), ("y", 100.0), ("v", 200.0)):
        assert made[key] == pytest.approx((base + start + np.arange(n)).tolist())
    assert case_data("0:2", dataclasses.replace(scenario, crash=None), way)["wayOut"] is None
