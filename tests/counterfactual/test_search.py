"""The search for a way out, against all sequences one by one, closed forms, and the reward that asks about braking."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, setting_of
from hypothesis import given
from hypothesis import strategies as st
from reference.avoid import Actions, Traffic, has_way_out
from reference.crashes import ODD, Mover, crash, drive, random_crash, scenario_of
from reference.recorded import recordings_of_all
from reference.shapes import Box as ShapeBox
from reference.world import Vehicle

from cornerforge.analysis.avoidability import Avoidability, AvoidParams, _labels, _search, avoidability
from cornerforge.counterfactual.braking import Braking, avoidable_by_braking, is_avoidable
from cornerforge.counterfactual.motion import allocate_rows
from cornerforge.counterfactual.search import BRAKING, Manoeuvres
from cornerforge.counterfactual.witness import drive_way_out
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.ndd.model import NddModel
from cornerforge.recordings import BODY_FIELDS, Recordings, Trajectories, unpack
from cornerforge.road.straight import road_numbers
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import crashed_tests, simulate_chunks
from cornerforge.sim.step import allocate_recording
from cornerforge.sim.world import n_slots
from cornerforge.types import Odd, Scenario

BOUND = 4.0
EVASIVE = replace(ODD, lane_change_duration=float(np.sqrt(10.0 / np.sqrt(3.0) * ODD.lane_width / BOUND)))


PARAMS = AvoidParams(horizon_s=1.2, lookback_s=1.3)
ACTIONS = Actions(PARAMS.accelerations_mps2, 5, PARAMS.lane_changes, EVASIVE, 12)
MARGIN = 0.01
"""What a lateral state taken from differences of frames may be off [m]."""


def cars(odd: Odd, n: int) -> np.ndarray:
    """Bodies of n cars; their lane changes take as long as the ODD says."""
    bodies = np.zeros(n, dtype=BODY_FIELDS)
    bodies["length"], bodies["width"] = odd.vehicle_length, odd.vehicle_width
    bodies["change_time"] = odd.lane_change_duration
    return bodies


def later_than(found: float | None, traffic: Traffic, since_s: float) -> range:
    """Moments after the one found, back to where it was looked for."""
    first = traffic.last - round(10 * min(since_s, PARAMS.lookback_s))
    return range(max(first, 0) if found is None else traffic.last - round(10 * found) + 1, traffic.last)


@pytest.fixture(scope="module")
def random_crashes() -> list[Traffic]:
    rng = np.random.default_rng(20_260_101)
    return [traffic for traffic in (random_crash(rng) for _ in range(200)) if traffic is not None]


@pytest.mark.full
def test_nothing_is_lost_against_all_sequences_one_by_one(random_crashes: list[Traffic]) -> None:
    """The referee: where the search finds nothing, no sequence keeps clear; what it finds, the referee finds too."""
    assert len(random_crashes) >= 20
    seen = dict.fromkeys(["later", "found", "none"], 0)
    for traffic in random_crashes:
        answer = avoidability(scenario_of(traffic), PARAMS)
        for kind, found in (("braking", answer.braking_s), ("steering", answer.steering_s), ("any", answer.latest_s)):
            since = 99.0 if kind == "any" else answer.manoeuvre_s
            for moment in later_than(found, traffic, since):
                seen["later"] += 1
                assert not has_way_out(traffic, moment, kind, ACTIONS, margin=MARGIN), (kind, moment)
            seen["none"] += found is None
            if found is not None:
                seen["found"] += 1
                assert has_way_out(traffic, traffic.last - round(10 * found), kind, ACTIONS, margin=-MARGIN)
    assert min(seen.values()) >= 10  # the crashes are of both sorts


def random_squeeze(rng: np.random.Generator) -> Traffic | None:
    """An AV in one lane with a car close ahead and one close behind: only few orders of braking and going on fit."""
    speed = rng.uniform(18.0, 35.0)

    def other(x: float) -> Mover:
        pull, acts = float(rng.choice([-4.0, -2.0, 0.0, 2.0])), int(rng.integers(0, 5))
        return Mover(x, 1, float(np.clip(speed + rng.normal(0.0, 3.0), 17.5, 40.0)), pull, 0, acts)

    av = Mover(200.0, 1, speed, rng.choice([-2.0, 0.0, 2.0]), 0, 3)
    traffic = drive(av, other(205.0 + rng.uniform(0.3, 5.0)), other(195.0 - rng.uniform(0.1, 2.5)), frames=31)
    return traffic if traffic is not None and traffic.last >= 5 else None


def test_no_order_of_accelerations_is_lost_where_few_will_do() -> None:
    """The same by braking alone, where it matters which of two orders came to one place, or to one speed, first.

    The numbers above 99 are squeezes, of the first 2,500, in which a search that forgets the place or the speed of its
    states was seen to lose a way out.
    """
    telling = (430, 708, 1074, 1094, 1452, 1643, 1884, 2312)
    drawn = [random_squeeze(np.random.default_rng([20_260_102, k])) for k in (*range(100), *telling)]
    squeezes = [traffic for traffic in drawn if traffic is not None]
    assert len(squeezes) >= 50
    ways_out = 0
    for traffic in squeezes:
        answer = avoidability(scenario_of(traffic), PARAMS)
        ways_out += answer.braking_s is not None
        for moment in later_than(answer.braking_s, traffic, answer.manoeuvre_s):
            assert not has_way_out(traffic, moment, "braking", ACTIONS, margin=MARGIN), moment
    assert 15 <= ways_out <= len(squeezes) - 15


def test_the_referee_catches_a_search_that_leaves_actions_out(random_crashes: list[Traffic]) -> None:
    """Negative control: the same comparison fails when the search may not accelerate, or not change lanes twice."""
    for short_sighted in (
        replace(PARAMS, accelerations_mps2=(-8.0, -4.0, 0.0)),
        replace(PARAMS, accelerations_mps2=(-4.0, 0.0, 2.0)),
        replace(PARAMS, lane_changes=0),
    ):
        missed = 0
        for traffic in random_crashes:
            found = avoidability(scenario_of(traffic), short_sighted).latest_s
            if found != avoidability(scenario_of(traffic), PARAMS).latest_s:
                later = later_than(found, traffic, 99.0)
                missed += any(has_way_out(traffic, moment, "any", ACTIONS, margin=MARGIN) for moment in later)
        assert missed > 0


@given(st.floats(4.0, 60.0))
def test_behind_a_braking_lead_the_closed_form_decides(gap: float) -> None:
    """Both at 30 m/s, the lead brakes at 4 m/s2 from 1 s on, the AV at 8 from d later, both at the ODD's jerk.

    While the lead's braking comes on, in p, the AV gains 2 p^2 / 3; with q for the AV's own ramp it is faster by
    w = 4 (d - p / 2) when it begins to brake and when its ramp ends. It just does not touch at the gap
    2 (d - p)^2 + 2 p (d - p) + 2 p^2 / 3 + w q + 2 q^2 / 3 + w^2 / 8; without a limit, at 4 d^2.
    """
    answer = avoidability(crash(Mover(400.0, 1, 30.0), Mover(405.0 + gap, 1, 30.0, -4.0, acts=10)))
    assert answer.manoeuvre_s is not None
    assert answer.braking_s is not None
    after = answer.manoeuvre_s - answer.braking_s
    p, q, d = 4.0 / ODD.max_jerk, 8.0 / ODD.max_jerk, np.linspace(0.4, 6.0, 5601)
    w = 4.0 * (d - 0.5 * p)
    needed = 2.0 * (d - p) ** 2 + 2.0 * p * (d - p) + (p**2 + q**2) / 1.5 + w * q + w**2 / 8.0
    latest = np.interp(gap, needed, d) - 0.1  # the lead is seen to brake at 1 m/s2 a frame after it begins
    # moments are 0.1 s apart, contacts are looked for every 0.1 s
    assert latest - 0.11 <= after <= latest + 0.05


STANDING = Mover(520.0, 1, 0.0)
AV = Mover(400.0, 1, 30.0)


def gap_at(scenario: Scenario, before_s: float | None) -> float:
    """Between the AV and the standing car, so long before the contact [m]."""
    assert before_s is not None
    return 515.0 - float(scenario.x[len(scenario.x) - 1 - round(10 * before_s), 0])


def test_before_a_standing_car_braking_needs_its_way_and_steering_its_time() -> None:
    """Braking from 30 m/s takes 900 / 16 = 56.25 m, and 30 q / 2 - 8 q^2 / 24 more for the ramp of q = 8 / 12.65 s.

    A lane change takes the time until 2 m across are done.
    """
    scenario = crash(AV, STANDING)
    answer = avoidability(scenario)
    assert answer.label == "by both"
    q = 8.0 / ODD.max_jerk
    way = 56.25 + 15.0 * q - q**2 / 3.0
    assert way <= gap_at(scenario, answer.braking_s) <= way + 3.0  # moments are 3 m apart
    u = np.linspace(0.0, 1.0, 2001)
    clear = EVASIVE.lane_change_duration * u[np.argmax(4.0 * (10 * u**3 - 15 * u**4 + 6 * u**5) >= 2.0)]
    # a box that is turned by up to 6 degrees needs 0.3 m more, at 3 m/s across 0.1 s
    assert clear - 0.1 <= gap_at(scenario, answer.steering_s) / 30.0 <= clear + 0.3
    assert gap_at(scenario, answer.steering_s) < gap_at(scenario, answer.braking_s)  # at 30 m/s


def test_walls_on_both_sides_leave_braking_and_a_follower_leaves_steering() -> None:
    walls = [Mover(400.0 + far, lane, 30.0) for lane in (0, 2) for far in range(-24, 60, 6)]
    lead = Mover(420.0, 1, 30.0, -4.0, acts=10)
    assert avoidability(crash(AV, lead, *walls)).label == "by braking"
    follower = Mover(394.5, 1, 30.0)
    assert avoidability(crash(AV, lead, follower)).label == "by steering"
    answer = avoidability(crash(AV, lead, follower, *walls))
    assert answer.label == "unavoidable"
    assert answer.latest_s is None or answer.latest_s > answer.manoeuvre_s


def test_who_is_hit_from_behind_because_it_braked_has_not_avoided() -> None:
    """The follower drives as it did and does not see the AV brake; a far one has room to be braked for."""
    lead = Mover(420.0, 1, 30.0, -4.0, acts=10)
    only_braking = AvoidParams(lane_changes=0)
    assert avoidability(crash(AV, lead, Mover(394.5, 1, 30.0)), only_braking).label == "unavoidable"
    assert avoidability(crash(AV, lead, Mover(300.0, 1, 30.0)), only_braking).label == "by braking"


def mirrored(scenario: Scenario) -> Scenario:
    lanes = (ODD.n_lanes - 1 - scenario.target_lane).astype(np.int8)
    y = ODD.n_lanes * ODD.lane_width - scenario.y
    return replace(scenario, y=y, heading=-scenario.heading, target_lane=lanes)


def changed(scenario: Scenario, columns: dict[str, np.ndarray]) -> Scenario:
    return replace(scenario, **columns)  # type: ignore[arg-type]


def times(answer: Avoidability) -> tuple[object, ...]:
    return answer.label, answer.manoeuvre_s, answer.braking_s, answer.steering_s, answer.latest_s


def test_left_and_right_are_alike_and_slots_do_not_matter(random_crashes: list[Traffic]) -> None:
    for traffic in random_crashes[:20]:
        scenario = scenario_of(traffic)
        assert times(avoidability(mirrored(scenario))) == times(avoidability(scenario))
        order = [0, *range(scenario.slot.size - 1, 0, -1)]
        columns = (
            "slot",
            "x",
            "y",
            "speed",
            "heading",
            "acceleration",
            "target_lane",
            "present",
            "action",
            "change_time",
        )
        turned = changed(scenario, {name: getattr(scenario, name)[..., order] for name in columns})
        assert times(avoidability(turned)) == times(avoidability(scenario))


def test_more_actions_never_help_less(random_crashes: list[Traffic]) -> None:
    few = AvoidParams(accelerations_mps2=(-8.0, 0.0), lane_changes=1)
    for traffic in random_crashes[:20]:
        scenario = scenario_of(traffic)
        little = avoidability(scenario, few).latest_s
        for more in (replace(few, accelerations_mps2=(-8.0, -2.0, 0.0, 2.0)), replace(few, lane_changes=2)):
            much = avoidability(scenario, more).latest_s
            assert little is None or (much is not None and much <= little)


def test_absent_vehicles_and_a_far_one_change_nothing(random_crashes: list[Traffic]) -> None:
    scenario = scenario_of(random_crashes[0])
    frames = len(scenario.x)

    def with_one_more(value: float, there: bool) -> Scenario:
        more = {
            name: np.hstack([getattr(scenario, name), np.full((frames, 1), value)])
            for name in ("x", "y", "speed", "heading", "acceleration")
        }
        lanes = np.hstack([scenario.target_lane, np.full((frames, 1), 1 if there else -1, np.int8)])
        present = np.hstack([scenario.present, np.full((frames, 1), there)])
        slot = np.append(scenario.slot, np.int16(99))
        for name in ("kind", "length", "width", "change_time"):
            values = getattr(scenario, name)
            more[name] = np.append(values, values[-1])
        return changed(scenario, {**more, "slot": slot, "target_lane": lanes, "present": present})

    assert times(avoidability(with_one_more(np.nan, there=False))) == times(avoidability(scenario))
    far = with_one_more(0.0, there=True)
    far.x[:, -1], far.y[:, -1] = 5000.0, 6.0
    assert times(avoidability(far)) == times(avoidability(scenario))


def test_ways_out_begin_with_the_acceleration_that_the_av_has(random_crashes: list[Traffic]) -> None:
    """The reference's AV, from the recorded moment on, drives every way out to the bit; without its acceleration not.

    Its motion is the simulator's to the bit, jerk included (`tests/sim/test_twin.py`).
    """
    checked = others = 0
    for traffic in random_crashes:
        witness = avoidability(scenario_of(traffic), PARAMS).witness
        if witness is None:
            continue
        av = copy(traffic.rows[traffic.last - round(10 * witness.begin_s)][0])
        forgetful = copy(av)
        forgetful.acceleration = 0.0
        for one, same in ((av, True), (forgetful, av.acceleration == 0.0)):
            one.change_time = EVASIVE.lane_change_duration
            track = [(one.x, one.speed)]
            for k, (acceleration, lane) in enumerate(zip(witness.acceleration, witness.lane, strict=True)):
                one.hold(float(acceleration), EVASIVE)
                if lane != one.target_lane:
                    one.change_lane(int(lane), EVASIVE)
                for _ in range(min(5, witness.x.size - 1 - 5 * k)):
                    one.move(EVASIVE)
                    track.append((one.x, one.speed))
            found = np.array_equal(track, np.stack([witness.x, witness.speed], axis=1))
            assert found or not same
            checked, others = checked + int(same), others + int(not found)
    assert checked >= 10
    assert others > 0, "no way out begins with an acceleration: the case shows nothing"


def test_a_plan_that_does_nothing_is_caught_at_the_recorded_contact() -> None:
    """The check that witnesses must pass finds the crash itself when the AV goes on as it did."""
    scenario = crash(AV, STANDING)
    last = len(scenario.x) - 1
    frames = allocate_recording(last + 61, 2)
    for name in ("x", "y", "speed", "heading", "acceleration", "target_lane"):
        frames[name][: last + 1] = getattr(scenario, name)
        frames[name][last + 1 :] = getattr(scenario, name)[-1]  # the other one stands
    frames["present"] = 1
    road = road_numbers(ODD)
    goes_on = Manoeuvres(np.zeros(1), 5, 0, 0, 8.0, 0, 0, road, road, 1)
    nothing, lane = np.zeros(8), np.ones(8, dtype=np.int64)
    track = np.zeros((41, 4))
    test = Trajectories(frames, cars(ODD, 2), 2)
    assert drive_way_out(test, last - 20, nothing, lane, goes_on, allocate_rows(2), track) == last
    np.testing.assert_allclose(track[:20, 0], scenario.x[last - 20 : last, 0])
    brake = np.full(8, -8.0)
    assert drive_way_out(test, last - 30, brake, lane, goes_on, allocate_rows(2), track) == -1


def test_witnesses_keep_clear_of_everybody(random_crashes: list[Traffic]) -> None:
    """The arrays that are stored, against the traffic's own objects."""
    checked = 0
    for traffic in random_crashes:
        witness = avoidability(scenario_of(traffic), PARAMS).witness
        if witness is None:
            continue
        first = traffic.last - round(10 * witness.begin_s)
        for k, values in enumerate(zip(witness.x, witness.y, witness.heading, strict=True)):
            others = traffic.rows[first + k][1:]
            size = 5.0 - MARGIN, 2.0 - MARGIN
            assert not any(boxes_overlap(Box(*values, *size), Box(o.x, o.y, o.heading, *size)) for o in others)
        assert np.all(np.diff(witness.speed) / 0.1 >= -8.0 - 1e-6)
        assert np.all(np.diff(witness.speed) / 0.1 <= 2.0 + 1e-6)
        steady = witness.speed[2:] >= 5.0  # below, the simulator turns braking across the road too
        assert np.all(np.abs(np.diff(witness.y, 2) / 0.01)[steady] <= BOUND + 0.1)
        checked += 1
    assert checked >= 10


SWIFT = replace(WIDE, name="swift", lane_change_duration=2.5, max_jerk=math.inf)
CAR, TRUCK = (5.0, 2.0), (16.5, 2.55)


def cut_in(ahead: float, size: tuple[float, float]) -> Recordings:
    """Of the given size, `ahead` m before the AV, it changes from the left into the AV's lane at 1 s; all at 30 m/s.

    The contact is the first overlap of both boxes, by the reference's polygons.
    """
    av, bv = now = [Vehicle(0, 200.0, 6.0, 30.0, 1, {1}), Vehicle(1, 200.0 + ahead, 10.0, 30.0, 2, {2})]
    av.change_time = bv.change_time = SWIFT.lane_change_duration
    rows: list[list[Vehicle]] = []
    for vehicle in now:
        vehicle.hold(0.0, ODD)
    while True:
        if len(rows) == 10:
            bv.change_lane(1, SWIFT)
        rows.append([copy(vehicle) for vehicle in now])
        if ShapeBox(av.x, av.y, av.heading, *CAR).overlaps(ShapeBox(bv.x, bv.y, bv.heading, *size)):
            break
        for vehicle in now:
            vehicle.move(SWIFT)
    scenario = replace(scenario_of(Traffic(ODD, rows, len(rows) - 1), partner=1), odd=SWIFT)
    recordings = recordings_of_all([scenario])
    length, width = recordings.length.copy(), recordings.width.copy()
    length[1], width[1] = size
    return recordings._replace(length=length, width=width)


def by_braking(recordings: Recordings) -> tuple[bool, str, float]:
    """Does braking at 8 m/s2 at once help (`is_avoidable`); the search's label, and its latest moment to brake.

    The last is in seconds from the begin of the manoeuvre, at 1 s.
    """
    params = AvoidParams(lane_changes=0)
    found = _search(recordings, SWIFT, params, threads=1)
    assert found.begin.tolist() == [10]
    assert (found.touched < 0).all()
    n, last = int(recordings.vehicles[0]), int(recordings.last[0])
    test = Trajectories(allocate_recording(last + 1, n), cars(SWIFT, n), n)
    unpack(recordings, 0, test.frames, test.bodies)
    at_once = bool(is_avoidable(test, last, 1, road_numbers(SWIFT), Braking(0.0, 8.0)))
    return at_once, _labels(found, params)[0], 0.1 * (int(found.moment[0, BRAKING]) - 10)


def test_a_truck_that_cuts_in_blocks_the_way_that_a_car_leaves_free() -> None:
    """Its centre is 1 m ahead: the AV must fall back by 5 - 1 = 4 m behind a car, by 10.75 - 1 = 9.75 m behind a truck.

    At 8 m/s2 that takes 1 and 1.56 s. In a lane change of 2.5 s a car overlaps the AV sideways after 1.25 s; its tail,
    which swings by 2.5 m times 0.1 rad, 0.1 s later. The truck at 1.5 s is 1.27 m beside, turned by 0.092 rad; the AV's
    front, 7.5 m behind its centre, is 1.27 - 1.28 + 7.5 * 0.092 = 0.68 m from its side, where 1 m is the AV itself. A
    truck with its rear where the car's is, 5.75 m further ahead, leaves the car's way free.
    """
    at_once, label, moment = by_braking(cut_in(1.0, CAR))
    assert (at_once, label) == (True, "by braking")
    assert 0.1 <= moment <= 0.4
    at_once, label, moment = by_braking(cut_in(1.0, TRUCK))
    assert (at_once, label) == (False, "unavoidable")
    assert moment < 0.0
    at_once, label, moment = by_braking(cut_in(6.75, TRUCK))
    assert (at_once, label) == (True, "by braking")
    assert moment >= 0.1


def test_never_unavoidable_where_the_reward_says_avoidable(model: NddModel, seed: int) -> None:
    """With the reward's own continuation: what braking from d after the manoeuvre began avoids, braking avoids here.

    The reward takes lateral paths from differences of positions, up to 0.16 m off the planned ones (at the begin of a
    lane change of 2.5 s): so its verdict must hold for vehicles that are wider by twice that.
    """
    odd = WIDE
    setting, slots = setting_of(model, odd, adversary="swerve"), n_slots(odd)
    chunks = simulate_chunks(setting, slots, seed=seed, first=0, tests=120, threads=1)
    recorder = Recorder(setting, odd)
    avoidable = 0
    for test in [test for first, out, _ in chunks for test in crashed_tests(first, out)][:40]:
        scenario = recorder.record(seed, test)
        for delay in (0.0, 1.0):
            params = AvoidParams(delay_s=delay, others="partner", lookback_s=60.0)
            wider = replace(scenario, odd=replace(odd, vehicle_width=odd.vehicle_width + 0.32))
            if avoidable_by_braking(wider, delay_s=delay):
                avoidable += 1
                assert avoidability(scenario, params).label in ("by braking", "by both")
    assert avoidable >= 10


STEERS = replace(PARAMS, steers=True)


def test_an_av_that_steers_has_every_way_out_of_one_that_orders_lanes(random_crashes: list[Traffic]) -> None:
    """It may do all that the other may, and drive beside a lane's centre, so its last way out is no earlier."""
    later = compared = 0
    for traffic in random_crashes:
        if any(row[0].path is not None for row in traffic.rows[: traffic.last]):
            continue  # within a lane change the two go on otherwise
        orders, steers = (avoidability(scenario_of(traffic), params) for params in (PARAMS, STEERS))
        if orders.latest_s is not None and orders.exhaustive and steers.exhaustive:
            assert steers.latest_s is not None
            assert steers.latest_s <= orders.latest_s + 1e-9
            later += steers.latest_s < orders.latest_s
            compared += 1
    assert compared >= 10
    assert later >= 1


def test_it_passes_within_its_lane_by_what_stands_half_in_it() -> None:
    """A car stands 0.2 m within reach, both lanes beside are taken: an order for a lane helps nobody, 1.33 m do."""
    beside = [Mover(400.0 + dx, lane, 30.0) for lane in (0, 2) for dx in (-6.0, 0.0, 6.0)]
    traffic = drive(AV, Mover(520.0, 1, 0.0), *beside)
    assert traffic is not None
    for row in traffic.rows:
        row[1].y = 7.8  # half in the lane on the left
        for other in row[2:]:
            other.y += 0.6 if other.target_lane == 2 else -0.6
    scenario = scenario_of(traffic, 1)
    braking = AvoidParams(accelerations_mps2=(0.0, -0.5), lane_changes=1, lookback_s=4.0)
    assert avoidability(scenario, braking).steering_s is None
    answer = avoidability(scenario, replace(braking, steers=True))
    assert answer.steering_s is not None
    assert answer.witness is not None
    assert set(answer.witness.lane.tolist()) == {1}
    side = answer.witness.y[round(10 * answer.witness.begin_s)]
    assert 3.9 < side < 5.81


def test_an_av_that_steers_is_taken_over_where_it_is() -> None:
    """It drifts to the left beside its lane's centre: the way out begins there, at its lateral speed."""
    scenario = crash(AV, STANDING)
    last = len(scenario.x) - 1
    y = scenario.y.copy()
    y[:, 0] = 6.0 + 0.4 * np.clip((np.arange(last + 1) - last + 25) * 0.1, 0.0, None)
    drifting = replace(scenario, y=y, heading=np.where(np.arange(2) == 0, np.arctan(0.4 / 30.0), 0.0) + 0.0 * y)
    answer = avoidability(drifting, replace(PARAMS, steers=True, lookback_s=3.0))
    assert answer.witness is not None
    first = last - round(10 * answer.witness.begin_s)
    assert answer.witness.y[0] == pytest.approx(y[first, 0])
    assert answer.witness.y[1] - answer.witness.y[0] == pytest.approx(0.04, abs=0.025)
