"""Judges of a crash at a site, against scenes that are put together by hand, whose answers are known."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from analysis.site_scenes import Agent, meeting, middle, name_at, odd_of, scene, steady
from numpy.typing import NDArray

import cornerforge
from cornerforge.analysis.avoidability import AvoidParams, avoidability
from cornerforge.analysis.conduct import conduct_of
from cornerforge.analysis.fault import assign_fault
from cornerforge.analysis.in_words import what_happened
from cornerforge.analysis.mechanism import crash_type_of, mechanism_of
from cornerforge.analysis.prevented import prevented_by, prevention_of
from cornerforge.analysis.site_case import site_case
from cornerforge.counterfactual import drive_profile
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.recordings import recordings_of
from cornerforge.road.straight import road_numbers
from cornerforge.sim import NO_VEHICLE
from cornerforge.site.tables import pose_at
from cornerforge.types import FRAME_S, PERSON, TRUCK, Odd, Scenario

SIGNAL, CROSSING = odd_of("mcity-signal"), odd_of("mcity-crossing")
NORTH_SOUTH, EAST_WEST = 1.0, 20.0
"""Times of the programme shortly after green begins."""
STRAIGHT, LEFT, RIGHT, ACROSS = 4, 12, 3, 8
"""Routes: straight on from the north, left from the south, right from the north, straight on from the west."""


def fault(case: Scenario) -> tuple[str, str, str]:
    told = assign_fault(recordings_of(case), odd=case.odd).columns()
    return str(told["fault"][0]), str(told["av_rule"][0]), str(told["bv_rule"][0])


def at_clock(odd: Odd, agents: list[Agent], clock: float) -> Scenario:
    return scene(odd, agents, name_at(odd, clock))


def test_a_red_runner_is_at_fault() -> None:
    case = at_clock(SIGNAL, meeting(SIGNAL, STRAIGHT, ACROSS, (7.0, 7.0)), NORTH_SOUTH)
    assert mechanism_of(case).name == "angle"
    assert fault(case) == ("bv", "none", "light: passed the stop line on red")
    assert "on a red light" in what_happened(case)


def test_an_av_that_runs_red_is_at_fault() -> None:
    case = at_clock(SIGNAL, meeting(SIGNAL, STRAIGHT, ACROSS, (7.0, 7.0)), EAST_WEST)
    assert fault(case) == ("av", "light: passed the stop line on red", "none")
    assert conduct_at(case) == "runs-red"


def conduct_at(case: Scenario) -> str:
    recordings = recordings_of(case)
    prevention = prevention_of(recordings, [None], case.odd, AvoidParams())
    return str(conduct_of(recordings, case.odd, prevention).columns()["conduct"][0])


def test_one_that_turns_left_gives_way() -> None:
    case = at_clock(SIGNAL, meeting(SIGNAL, LEFT, STRAIGHT, (4.0, 7.0)), NORTH_SOUTH)
    assert mechanism_of(case).name == "left-across-by-av"
    assert fault(case) == ("av", "right of way: did not give way to a vehicle", "none")
    words = what_happened(case)
    assert words.startswith("The AV, turning left at 4 m/s,")
    assert "a car that came straight on from ahead at 7 m/s with the right of way" in words
    from_the_side = at_clock(SIGNAL, meeting(SIGNAL, ACROSS, LEFT, (5.0, 4.0)), EAST_WEST)
    assert mechanism_of(from_the_side).name == "angle", "the south's lanes come at 100 degrees to those from the west"
    turned = at_clock(SIGNAL, meeting(SIGNAL, STRAIGHT, LEFT, (7.0, 4.0)), NORTH_SOUTH)
    assert mechanism_of(turned).name == "left-across-by-bv"
    assert fault(turned) == ("bv", "none", "right of way: did not give way to a vehicle")


def test_one_that_stands_in_the_way_for_long_is_not_to_be_hit() -> None:
    here, there = middle(SIGNAL, LEFT, STRAIGHT)
    case = at_clock(SIGNAL, [Agent(LEFT, lambda _: here), steady(STRAIGHT, there, 8.0, 4.0)], NORTH_SOUTH)
    assert fault(case) == ("bv", "none", "right of way: did not brake for one in its way")


def test_a_person_on_walk_goes_first() -> None:
    """Crosswalk 19 has Walk while the north is green, so one that turns right from there gives way."""
    case = at_clock(SIGNAL, meeting(SIGNAL, RIGHT, 19, (3.0, 1.4), PERSON), NORTH_SOUTH)
    assert mechanism_of(case).name == "person-right-turn"
    assert fault(case) == ("av", "right of way: did not give way to a person on a crosswalk", "none")
    assert what_happened(case).endswith("which had left the kerb on Walk")


def test_a_person_on_dont_walk_does_not() -> None:
    """Crosswalk 13 lies before the lanes from the north, which are green."""
    case = at_clock(SIGNAL, meeting(SIGNAL, STRAIGHT, 13, (6.0, 3.0), PERSON), NORTH_SOUTH)
    assert mechanism_of(case).name == "person-straight"
    assert fault(case)[2] == "person: left the kerb on Don't Walk"


def test_one_behind_is_at_fault() -> None:
    case = at_clock(SIGNAL, [steady(STRAIGHT, 0.0, 0.0, 8.0), Agent(STRAIGHT, lambda _: 30.0 - 0.4)], NORTH_SOUTH)
    assert mechanism_of(case).name == "rear-end-by-av"
    assert crash_type_of(case) == ("rear-end by AV", "av")
    assert fault(case)[:2] == ("av", "longitudinal: vehicle behind did not brake")
    struck = at_clock(SIGNAL, [Agent(STRAIGHT, lambda _: 30.0), steady(STRAIGHT, 0.0, 0.0, 8.0)], NORTH_SOUTH)
    assert mechanism_of(struck).name == "rear-end-by-bv"
    assert fault(struck)[0] == "bv"


def test_the_last_moment_to_brake_is_that_of_the_stopping_way() -> None:
    """From 8 m/s at 12.65 m/s3 to 8 m/s2 a vehicle needs 6.40 m; it comes 0.8 m in a frame and touches 0.4 m deep."""
    case = at_clock(SIGNAL, [steady(STRAIGHT, 0.0, 0.0, 8.0), Agent(STRAIGHT, lambda _: 29.0 - 0.4 - 0.2)], NORTH_SOUTH)
    ramp = 8.0 / 12.65
    way = 8.0 * ramp - 12.65 * ramp**3 / 6.0 + (8.0 - 0.5 * 12.65 * ramp**2) ** 2 / 16.0
    deep = 5.0 - float(np.hypot(case.x[-1, 1] - case.x[-1, 0], case.y[-1, 1] - case.y[-1, 0]))
    found = avoidability(case)
    assert found.braking_s == found.latest_s == pytest.approx(np.ceil((way + deep) / 0.8) * FRAME_S)


def pose_on(case: Scenario, x: float, y: float, heading: float) -> Box:
    return Box(x, y, heading, case.length[0], case.width[0])


@pytest.mark.parametrize("speeds", [(4.0, 7.0), (6.0, 3.0), (2.0, 8.0), (7.0, 5.0)])
def test_a_way_out_touches_nobody_in_the_recording(speeds: tuple[float, float]) -> None:
    case = at_clock(SIGNAL, meeting(SIGNAL, LEFT, STRAIGHT, speeds), NORTH_SOUTH)
    found = avoidability(case)
    assert found.witness is not None
    assert found.latest_s is not None
    begin = len(case.x) - 1 - round(found.latest_s / FRAME_S)
    assert (found.witness.x[0], found.witness.y[0]) == pytest.approx((case.x[begin, 0], case.y[begin, 0]), abs=1e-6)
    for k in range(len(case.x) - begin):
        own = pose_on(case, found.witness.x[k], found.witness.y[k], found.witness.heading[k])
        other = Box(
            case.x[begin + k, 1], case.y[begin + k, 1], case.heading[begin + k, 1], case.length[1], case.width[1]
        )
        assert not boxes_overlap(own, other)
    limits = np.diff(found.witness.speed) / FRAME_S
    assert limits.min() >= -8.0 - 1e-6
    assert limits.max() <= 2.0 + 1e-6


def runs_out(when: float) -> Scenario:
    """A person that runs at 4 m/s before an AV at 6 m/s, which would be where they meet at a moment [s]."""
    here, there = middle(CROSSING, 0, 4)
    return scene(CROSSING, [steady(0, here, when, 6.0), steady(4, there, 5.2, 4.0, PERSON)])


@pytest.mark.parametrize("when", [5.3, 5.4, 5.5, 5.6])
def test_where_no_way_out_can_exist_no_random_one_is_one(when: float) -> None:
    case = runs_out(when)
    found = avoidability(case)
    assert (found.label, found.exhaustive) == ("unavoidable", True)
    assert fault(case)[2] == "person: left the kerb right before a vehicle"
    assert not prevented_by(case)["cc-human"].prevented
    rng = np.random.default_rng(1)
    assert all(touches(case, found.manoeuvre_s, rng.uniform(-8.0, 2.0, 40)) for _ in range(300))


def touches(case: Scenario, begin_s: float, commands: NDArray[np.float64]) -> bool:
    """Does the AV touch the person, who runs on, if it drives by accelerations from a moment before the contact on?"""
    road = road_numbers(case.odd)
    begin = len(case.x) - 1 - round(begin_s / FRAME_S)
    places = site_case(recordings_of(case), case.odd).s
    track = np.empty((commands.size + 1, 3))
    drive_profile((float(places[begin, 0]), float(case.speed[begin, 0]), 0.0), commands, road, track)
    for k in range(len(track)):
        late = max(0, begin + k + 1 - len(case.x))
        other = pose_at(road.site, 4, float(places[min(begin + k, len(case.x) - 1), 1]) + 4.0 * FRAME_S * late)
        own = pose_at(road.site, 0, float(track[k, 0]))
        if boxes_overlap(Box(*own, case.length[0], case.width[0]), Box(*other, case.length[1], case.width[1])):
            return True
    return False


def test_a_person_that_comes_a_little_earlier_can_be_avoided() -> None:
    case = runs_out(5.8)
    found = avoidability(case)
    assert found.label == "by braking"
    assert found.braking_s is not None
    hardest = np.full(40, -8.0)
    assert not touches(case, found.braking_s, hardest)
    assert touches(case, found.braking_s - FRAME_S, hardest)


def test_a_careful_driver_stops_for_a_slow_person() -> None:
    here, there = middle(CROSSING, 0, 4)
    case = scene(CROSSING, [steady(0, here, 9.0, 6.0), steady(4, there, 9.0, 0.8, PERSON)])
    told = prevented_by(case)
    assert list(told) == ["cc-human"]
    assert told["cc-human"].prevented
    assert conduct_at(case) == "does-not-yield-to-people"


def test_a_turn_of_the_whole_site_changes_nothing() -> None:
    """Judges look along routes: a crash type is the same whichever way the road leads."""
    kinds = {
        crash_type_of(at_clock(SIGNAL, [steady(route, 0.0, 0.0, 6.0), Agent(route, lambda _: 25.0)], NORTH_SOUTH))
        for route in (STRAIGHT, ACROSS, 1, 11)
    }
    assert kinds == {("rear-end by AV", "av")}


@cache
def behind_truck(speed: float, walks: float, *, truck: bool = True) -> Scenario:
    """An AV straight on from the north past a truck that stands in the lane to its left; a person steps out before it.

    The lane to the left is that of route 6. Person 13 comes from that side.
    """
    here, there = middle(SIGNAL, STRAIGHT, 13)
    stop = road_numbers(SIGNAL).site[0]["route"][6]["stop"]
    agents = [steady(STRAIGHT, here, 7.0, speed), steady(13, there, 7.0, walks, PERSON)]
    half = 0.5 * SIGNAL.size_of(TRUCK)[0]
    standing = [Agent(6, lambda _: float(stop) - half, TRUCK)] if truck else []
    return at_clock(SIGNAL, [*agents, *standing], NORTH_SOUTH)


def test_one_that_steps_out_behind_a_truck_is_named() -> None:
    case = behind_truck(4.0, 1.4)
    site = site_case(recordings_of(case), SIGNAL)
    hider, frame = site.came_out
    assert hider == 2
    # the line from the AV's middle to the person passes the truck's nearer front corner then
    x, y = case.x[frame], case.y[frame]
    heading = case.heading[frame, 2]
    corner = np.array([x[2], y[2]]) + 0.5 * case.length[2] * np.array([np.cos(heading), np.sin(heading)])
    corner += 0.5 * case.width[2] * np.array([np.sin(heading), -np.cos(heading)])
    ray = np.arctan2(y[1] - y[0], x[1] - x[0]) - np.arctan2(corner[1] - y[0], corner[0] - x[0])
    away = np.hypot(x[1] - x[0], y[1] - y[0])
    assert abs((ray + np.pi) % (2.0 * np.pi) - np.pi) * away < 0.6
    assert re.search(r"; a truck that stood hid it from the AV until \d\.\d s before$", what_happened(case))
    assert conduct_at(case) == "overlooks-hidden-people"
    free = behind_truck(4.0, 1.4, truck=False)
    assert site_case(recordings_of(free), SIGNAL).came_out == (NO_VEHICLE, -1)
    assert "hid" not in what_happened(free)
    assert conduct_at(free) == "drives-on"


def test_a_careful_driver_sees_through_no_vehicle() -> None:
    """At 6 m/s it stops for a person at 2.4 m/s only if it sees the person before the truck uncovers it."""
    assert prevented_by(behind_truck(6.0, 2.4, truck=False))["cc-human"].prevented
    assert not prevented_by(behind_truck(6.0, 2.4))["cc-human"].prevented


@pytest.mark.full
def test_no_careful_driver_prevents_what_nothing_could(tmp_path: Path) -> None:
    """Of 60 such crashes 27 were "prevented by braking", since the AV had not braked; in 23 no way out exists."""
    site = {"site": "mcity-signal", "av": "rss-yield"}
    cornerforge.generate(policy=("dart-out",), out=tmp_path / "library", cases=25, seed=7, **site)  # type: ignore[arg-type]
    cornerforge.analyse(tmp_path / "library", out=tmp_path / "analysis")
    rows = pq.read_table(tmp_path / "analysis" / "cases.parquet").to_pylist()
    assert any(row["conduct"] == "drives-on" and row["avoidability"] == "unavoidable" for row in rows)
    assert not any(row["prevention"] == "by braking" and row["avoidability"] == "unavoidable" for row in rows)
