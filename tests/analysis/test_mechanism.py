"""Mechanisms of crashes driven by hand, on every mirror image, and shifted along the road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from driven_by_hand import Driver, mirrored, scenario_of
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.analysis.mechanism import MECHANISMS, contact_pose, mechanism_of
from cornerforge.errors import InputError
from cornerforge.experiment.roads import odd_on, road_named
from cornerforge.types import Crash, Odd

BESIDE = Driver(0.0, 1, 30.0)
# name: drivers, mechanism, contact
CASES: dict[str, tuple[list[Driver], str, str]] = {
    "BV closes in from behind": ([Driver(0, 1, 25), Driver(-40, 1, 30)], "bv-rear", "rear-end by BV"),
    "AV brakes hard": (
        [Driver(0, 1, 30, braking=(3, 6, -4.0)), Driver(-15, 1, 30)], "bv-rear-av-braking", "rear-end by BV"
    ),
    "AV braked hard, but long ago": (
        [Driver(0, 1, 30, braking=(0, 1, -4.0)), Driver(-30, 1, 30)], "bv-rear", "rear-end by BV"
    ),
    "AV brakes softly": (
        [Driver(0, 1, 30, braking=(1, 8, -2.9)), Driver(-12, 1, 30)], "bv-rear", "rear-end by BV"
    ),
    "AV cuts in ahead of a faster BV": (
        [Driver(0, 0, 25, ((1, 1),)), Driver(-46, 1, 35)], "bv-rear-av-cut-in", "rear-end by BV"
    ),
    "AV cut in ahead and brakes": (
        [Driver(0, 0, 25, ((0, 1),), (2, 5, -4.0)), Driver(-40, 1, 30)], "bv-rear-av-cut-in", "rear-end by BV"
    ),
    "AV cut in long ago": (
        [Driver(0, 0, 25, ((0, 1),)), Driver(-96, 1, 35)], "bv-rear", "rear-end by BV"
    ),
    "BV changes lanes behind": (
        [Driver(0, 1, 25), Driver(-46, 0, 35, ((1, 1),))], "bv-rear-bv-change", "rear-end by BV"
    ),
    "BV hits an AV that leaves its lane": (
        [Driver(0, 1, 25, ((2, 0),)), Driver(-26, 1, 35)], "bv-rear", "rear-end by BV"
    ),
    "AV closes in on a slow BV": ([Driver(0, 1, 30), Driver(40, 1, 25)], "av-rear", "rear-end by AV"),
    "BV ahead brakes hard": (
        [Driver(0, 1, 30), Driver(15, 1, 30, braking=(3, 6, -4.0))], "av-rear-bv-braking", "rear-end by AV"
    ),
    "BV cuts in ahead": (
        [Driver(0, 1, 35), Driver(46, 0, 25, ((1, 1),))], "av-rear-bv-cut-in", "rear-end by AV"
    ),
    "AV changes lanes into a rear": (
        [Driver(0, 0, 35, ((1, 1),)), Driver(46, 1, 25)], "av-rear-av-change", "rear-end by AV"
    ),
    "BV moves over into the AV beside it": ([BESIDE, Driver(1, 0, 30, ((1, 1),))], "bv-side", "side"),
    "AV moves over into the BV beside it": ([Driver(0, 0, 30, ((1, 1),)), Driver(1, 1, 30)], "av-side", "side"),
    "AV enters the lane that the BV is about to leave": (
        [Driver(0, 0, 30, ((1, 1),)), Driver(1, 1, 30, ((2.5, 2),))], "av-side", "side"
    ),
    "both enter one lane from the same side, the BV faster": (
        [Driver(0, 0, 25, ((0, 1),)), Driver(-20, 0, 33, ((0, 1),))], "same-lane-same-side", "rear-end by BV"
    ),
    "both enter one lane from the same side, the AV faster": (
        [Driver(-20, 0, 33, ((0, 1),)), Driver(0, 0, 25, ((1, 1),))], "same-lane-same-side", "rear-end by AV"
    ),
    "both enter one lane from opposite sides": (
        [Driver(0, 0, 30, ((0, 1),)), Driver(1, 2, 30, ((1, 1),))], "same-lane-opposite-sides", "side"
    ),
    "both enter one lane from opposite sides, one behind": (
        [Driver(0, 0, 25, ((0, 1),)), Driver(-33, 2, 35, ((0, 1),))], "same-lane-opposite-sides", "rear-end by BV"
    ),
    "both enter one lane from opposite sides, the AV gives way too late": (
        [Driver(0, 2, 24, ((0, 1), (2.4, 2))), Driver(-37, 0, 35, ((0, 1),))],
        "same-lane-opposite-sides", "rear-end by BV"
    ),
    "each enters the other's lane": (
        [Driver(0, 1, 30, ((0, 2),)), Driver(1, 2, 30, ((0, 1),))], "swap", "side"
    ),
    "the AV aborts, back into a BV that has drawn level": (
        [Driver(0, 1, 25, ((0, 2), (2.4, 1))), Driver(-16, 1, 30)], "av-side", "side"
    ),
    "the BV moves over into the AV beside it and turns back too late": (
        [BESIDE, Driver(1, 0, 30, ((1, 1), (3, 0)))], "bv-side", "side"
    ),
    "the BV turns back too late behind": (
        [Driver(0, 1, 22), Driver(-48, 0, 35, ((1, 1), (3.2, 0)))], "bv-rear-bv-change", "rear-end by BV"
    ),
    "the AV drifts out of its lane": ([Driver(0, 1, 30, drift=0.5), Driver(1, 2, 30)], "other", "side"),
    "after a crash of two BVs ahead": (
        [Driver(0, 1, 30, braking=(2, 6, -4.0)), Driver(-15, 1, 30),
         Driver(60, 1, 25, gone_at=2.0), Driver(64, 1, 25, gone_at=2.0)], "follow-up", "rear-end by BV"
    ),
    "after a crash of two BVs far away": (
        [Driver(0, 1, 30, braking=(2, 6, -4.0)), Driver(-15, 1, 30),
         Driver(400, 1, 25, gone_at=2.0), Driver(404, 1, 25, gone_at=2.0)], "bv-rear-av-braking", "rear-end by BV"
    ),
    "after two BVs far from each other left the road": (
        [Driver(0, 1, 30, braking=(2, 6, -4.0)), Driver(-15, 1, 30),
         Driver(60, 1, 25, gone_at=2.0), Driver(-60, 1, 25, gone_at=2.0)], "bv-rear-av-braking", "rear-end by BV"
    ),
    "after a crash of two BVs long ago": (
        [Driver(0, 1, 30, braking=(7, 11, -4.0)), Driver(-15, 1, 30),
         Driver(60, 1, 25, gone_at=2.0), Driver(64, 1, 25, gone_at=2.0)], "bv-rear-av-braking", "rear-end by BV"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_crashes_driven_by_hand_and_their_mirror_images(name: str) -> None:
    drivers, mechanism, contact = CASES[name]
    scenario = scenario_of(drivers)
    for image in (scenario, mirrored(scenario)):
        found = mechanism_of(image)
        assert (found.name, found.contact) == (mechanism, contact)


BY_A_RAMP, BY_AN_EXIT = (
    replace(odd_on(Odd(), replace(road_named(name), lane_width=4.0)), road_at=650.0) for name in ("on-ramp", "exit")
)
"""The right lane is an acceleration lane, or leads to an exit, from -50 m to 200 m."""
# name: drivers, road, mechanism there, and where lanes go on
AT_LANE_ENDS: dict[str, tuple[list[Driver], Odd, str, str]] = {
    "the AV merges": (CASES["AV cuts in ahead of a faster BV"][0], BY_A_RAMP, "av-merges", "bv-rear-av-cut-in"),
    "the BV merges": (CASES["BV cuts in ahead"][0], BY_A_RAMP, "bv-merges", "av-rear-bv-cut-in"),
    "the BV moves over into a lane that goes on": (
        [Driver(0, 2, 30), Driver(1, 1, 30, ((1, 2),))], BY_A_RAMP, "bv-side", "bv-side"
    ),
    "the AV brakes before the end": (
        [Driver(0, 0, 30, braking=(3, 6, -4.0)), Driver(-15, 0, 30)], BY_A_RAMP, "lane-end", "bv-rear-av-braking"
    ),
    "the AV takes the exit": ([Driver(0, 1, 30, ((1, 0),)), Driver(1, 0, 30)], BY_AN_EXIT, "leaving", "av-side"),
    "the AV brakes on the way to the exit": (
        [Driver(0, 0, 30, braking=(3, 6, -4.0)), Driver(-15, 0, 30)], BY_AN_EXIT, "bv-rear-av-braking",
        "bv-rear-av-braking",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", AT_LANE_ENDS)
def test_where_lanes_end_crashes_have_kinds_of_their_own(name: str) -> None:
    drivers, odd, there, elsewhere = AT_LANE_ENDS[name]
    scenario = scenario_of(drivers)
    assert mechanism_of(scenario).name == elsewhere
    found = mechanism_of(replace(scenario, odd=odd))
    assert (found.name, found.plain) == (there, elsewhere)


def test_every_mechanism_is_driven_by_hand() -> None:
    driven = {mechanism for _, mechanism, _ in CASES.values()} | {there for _, _, there, _ in AT_LANE_ENDS.values()}
    assert driven == set(MECHANISMS)


def test_what_is_said_beside_the_name() -> None:
    found = mechanism_of(scenario_of([Driver(0, 0, 25, ((0, 1),)), Driver(-20, 0, 33, ((0.5, 1),))]))
    assert (found.at_start, found.av_changing, found.bv_changing, found.bv_start_after_av_s) == (True, True, True, 0.5)
    late = mechanism_of(scenario_of([Driver(0, 1, 25), Driver(-40, 1, 30)]))  # contact at 7 s
    assert (late.at_start, late.av_changing, late.bv_changing, late.bv_start_after_av_s) == (False, False, False, None)


def test_a_vehicle_that_turns_back_changes_lanes_until_it_is_farthest() -> None:
    """It decides to turn back 3.1 s before the contact, and moves on into the AV's path: what is seen counts."""
    scenario = scenario_of([Driver(0, 1, 30), Driver(27.5, 0, 25, ((0, 1), (3.0, 0)))])
    frame, partner = scenario.contact()
    target = scenario.target_lane.copy()
    target[frame - 31 :, partner] = 0
    found = mechanism_of(replace(scenario, target_lane=target))
    assert (found.name, found.bv_changing) == ("av-rear-bv-cut-in", True)


@pytest.mark.parametrize(("contact_at", "at_start"), [(3.9, True), (4.0, True), (4.1, False)])
def test_the_start_ends_at_four_seconds(contact_at: float, at_start: bool) -> None:
    # closing at 10 m/s from 5 m more than `contact_at` needs; the boxes overlap in the frame after they touch
    scenario = scenario_of([Driver(0, 1, 20), Driver(-5.0 - 10.0 * contact_at + 0.5, 1, 30)])
    assert scenario.crash is not None
    assert scenario.crash.time == pytest.approx(contact_at)
    assert mechanism_of(scenario).at_start is (contact_at < 4.0) is (at_start and contact_at != 4.0)


@given(st.sampled_from(sorted(CASES)), st.floats(-1e4, 1e4))
def test_the_place_on_the_road_does_not_matter(name: str, shift: float) -> None:
    drivers, mechanism, _ = CASES[name]
    scenario = scenario_of(drivers)
    assert mechanism_of(replace(scenario, x=scenario.x + round(shift))).name == mechanism


@given(st.sampled_from(sorted(CASES)), st.permutations(range(3)))
def test_the_order_of_background_vehicles_does_not_matter(name: str, order: list[int]) -> None:
    drivers, mechanism, _ = CASES[name]
    extra = [Driver(300.0, 3, 30.0)] * (4 - len(drivers))
    bvs = [*drivers[1:], *extra]
    shuffled = [bvs[i] for i in order]
    scenario = scenario_of([drivers[0], *shuffled], partner=1 + order.index(0))
    assert mechanism_of(scenario).name == mechanism


def test_stored_precision_is_enough() -> None:
    for drivers, mechanism, _ in CASES.values():
        scenario = scenario_of(drivers)
        small = {name: getattr(scenario, name).astype(np.float32) for name in ("x", "y", "speed", "heading")}
        assert mechanism_of(replace(scenario, **small)).name == mechanism


def test_a_vehicle_that_joins_late_did_not_change_lanes_by_that() -> None:
    scenario = scenario_of([Driver(0, 1, 25), Driver(-40, 1, 30)])
    present, target = scenario.present.copy(), scenario.target_lane.copy()
    present[:50, 1], target[:50, 1] = False, -1
    found = mechanism_of(replace(scenario, present=present, target_lane=target))
    assert (found.name, found.bv_changing) == ("bv-rear", False)


def test_the_pose_at_contact() -> None:
    scenario = scenario_of([Driver(0, 1, 20), Driver(-14.5, 1, 30)])
    assert contact_pose(scenario) == pytest.approx(np.array([[20.0, 6.0, 20.0, 0.0], [15.5, 6.0, 30.0, 0.0]]))


def test_only_crashes_of_the_av_have_a_mechanism() -> None:
    scenario = scenario_of([Driver(0, 1, 25), Driver(-40, 1, 30)])
    for crash in (None, Crash(1.0, 1, 2)):
        with pytest.raises(InputError, match="0:0 holds no crash of the AV"):
            mechanism_of(replace(scenario, crash=crash))
    for crash in (Crash(99.0, 0, 1), Crash(1.0, 0, 7)):
        with pytest.raises(InputError, match="not in the recording"):
            mechanism_of(replace(scenario, crash=crash))
