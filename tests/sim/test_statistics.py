"""Counting traffic: hand-built states, recordings counted slowly, and windows of time and road that add up."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, Car, setting_of, world_of

from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import road_numbers
from cornerforge.sim import statistics
from cornerforge.sim.actions import start_lane_change
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import allocate_windows, drive_chunk, drive_chunk_by_window, simulate, simulate_chunks
from cornerforge.sim.statistics import EVERYBODY, Census, Counts, allocate_counts, count_choices, count_states
from cornerforge.sim.world import World, n_slots
from cornerforge.types import ACCELERATIONS, Scenario

ODD = replace(WIDE, n_lanes=3)
ROAD = road_numbers(ODD)
GO_ON = 22
"""Index of acceleration 0."""


def states(world: World, census: Census = EVERYBODY, time: int = 0) -> tuple[Counts, float]:
    counts = allocate_counts()
    return counts, count_states(world, time, counts, census)


def total(counts: Counts, which: int) -> int:
    return int(counts.totals[which])


def only_bin(row: np.ndarray) -> int:
    """The only bin that holds something, which is one count."""
    (place,) = np.flatnonzero(row)
    assert row[place] == 1
    return int(place)


def test_one_follower_by_hand() -> None:
    """30.26 m behind the AV at 25 m/s, closing by 4.01 m/s: time gap 1.2104 s, TTC 7.546 s (no value on an edge)."""
    counts, travel = states(world_of([Car(100.0, 1, 20.99), Car(64.74, 1, 25.0)]))
    assert travel == 25.0
    assert [total(counts, k) for k in (statistics.BV_STATES, statistics.FOLLOWING_STATES)] == [1, 1]
    below = counts.totals[statistics.TTC_BELOW :].tolist()
    assert below == [0, 0, 0, 1, 1, 1]  # of 3, 4, 5, 10, 15, 20 s
    assert only_bin(counts.histograms[1]) == 605  # bins of 0.05 m
    assert only_bin(counts.histograms[2]) == 242  # bins of 0.005 s
    assert only_bin(counts.histograms[3]) == 799  # bins of 0.02 m/s from -20 m/s on
    joint = counts.joint[:, 25]
    assert only_bin(joint[statistics.GAP]) == 60
    assert only_bin(joint[statistics.TIME_GAP]) == 24
    assert only_bin(joint[statistics.RANGE_RATE]) == 79
    assert only_bin(joint[statistics.INVERSE_TTC]) == 7  # bins of 1/60 per s
    assert counts.joint.sum() == 4


def test_a_leader_beyond_the_tables_is_none() -> None:
    for gap, follows in ((115.5, 1), (115.6, 0)):
        counts, _ = states(world_of([Car(300.0, 1, 30.0), Car(295.0 - gap, 1, 30.0)]))
        assert total(counts, statistics.FOLLOWING_STATES) == follows, gap


def test_the_nearest_leader_of_all_lanes_that_it_occupies_counts() -> None:
    world = world_of([Car(200.0, 2, 30.0), Car(100.0, 1, 30.0), Car(140.0, 1, 30.0), Car(120.0, 2, 29.0)])
    assert only_bin(states(world)[0].joint[statistics.GAP, 30][:80]) == 70  # 35 m behind slot 2; slot 3 is in lane 2
    start_lane_change(world, 1, 2, ROAD)
    assert states(world)[0].joint[statistics.GAP, 30, 30] == 1  # 15 m behind slot 3, whose lane it enters


def test_who_is_absent_or_outside_the_stretch_is_not_counted() -> None:
    cars = [Car(0.0, 1, 30.0), Car(100.0, 1, 30.0), Car(200.0, 1, 30.0), Car(300.0, 1, 30.0, present=False)]
    census = Census(True, 0, 99, 90.0, 150.0, 20.0)
    assert total(states(world_of(cars), census, time=0)[0], statistics.BV_STATES) == 1
    assert total(states(world_of(cars), census, time=3)[0], statistics.BV_STATES) == 1  # 150 to 210 m: slot 2
    assert total(states(world_of(cars), census, time=20)[0], statistics.BV_STATES) == 0
    assert total(states(world_of(cars))[0], statistics.BV_STATES) == 2


def test_choices_by_hand() -> None:
    """Slot 1 changes to the left between slots 2 (20 m ahead) and 3 (10 m behind); 2 brakes by 1; 3 and 4 crash."""
    world = world_of(
        [Car(500.0, 0, 30.0), Car(100.0, 1, 25.0), Car(125.0, 2, 20.0), Car(85.0, 2, 30.0), Car(70.0, 2, 31.0)]
    )
    counts, _ = states(world)
    v = world.vehicles
    v["action"][1:] = [0, GO_ON - 5, GO_ON, GO_ON]
    start_lane_change(world, 1, 2, ROAD)
    v["x"] += 30.0  # what is counted must be as it was when they chose
    v["present"][3:] = 0
    world.state["bv_crashes_before"], world.state["bv_crashes"] = 0, 1
    count_choices(world, ROAD, counts)
    assert total(counts, statistics.LANE_CHANGES) == 1
    assert total(counts, statistics.CRASHED_BVS) == 2
    assert only_bin(counts.joint[statistics.LEAD_GAP, 25]) == 20
    assert only_bin(counts.joint[statistics.REAR_GAP, 25]) == 10
    assert only_bin(counts.joint[statistics.FREE_ACCELERATION, 25]) == 20  # a lane change holds the speed: bin of 0
    assert only_bin(counts.joint[statistics.FREE_ACCELERATION, 20]) == 15  # -1
    assert counts.histograms[4].sum() == 4


def test_vanishing_without_a_crash_is_no_crash() -> None:
    world = world_of([Car(500.0, 0, 30.0), Car(100.0, 1, 25.0)])
    counts, _ = states(world)
    world.vehicles["present"][1], world.vehicles["action"][1] = 0, GO_ON
    count_choices(world, ROAD, counts)
    assert total(counts, statistics.CRASHED_BVS) == 0


def test_nobody_beside_is_the_last_bin() -> None:
    world = world_of([Car(500.0, 0, 30.0), Car(100.0, 1, 25.0)])
    counts, _ = states(world)
    world.vehicles["action"][1] = 1
    start_lane_change(world, 1, 0, ROAD)
    count_choices(world, ROAD, counts)
    assert only_bin(counts.joint[statistics.LEAD_GAP, 25]) == 120  # the AV is 395 m ahead
    assert only_bin(counts.joint[statistics.REAR_GAP, 25]) == 120


# Beside each other, and cutting in


def test_who_drives_beside_whom() -> None:
    """Slots 1 to 4: the left one of a pair less the right one; a pair is 10 m apart at most and changes no lane."""
    cars = [Car(115.0, 1, 29.0), Car(100.0, 0, 20.0), Car(109.9, 1, 23.014), Car(95.0, 1, 33.5), Car(88.0, 2, 35.014)]
    row = statistics.SPEED_DIFFERENCE_BESIDE
    found = np.flatnonzero(states(world_of(cars))[0].histograms[row])
    grid = statistics.BESIDE[0]
    differences = (3.014, 13.5, 1.514)  # 2 and 1, 3 and 1, 4 and 3; the AV beside nobody
    assert found.tolist() == sorted(math.floor((value - grid.low) / grid.width) for value in differences)
    changing = world_of(cars)
    start_lane_change(changing, 2, 2, ROAD)
    assert states(changing)[0].histograms[row].sum() == 2
    apart = world_of([Car(500.0, 1, 29.0), Car(100.0, 0, 20.0), Car(110.1, 1, 23.0), Car(95.0, 2, 33.5)])
    assert states(apart)[0].histograms[row].sum() == 0


def cut_in(world: World, rear: int = 2, *, y: float = 8.4) -> Counts:
    """Slot 1 at 28 m/s crosses the marking at y = 8 m half a second on; the rear goes from 30 to 31 m/s."""
    v = world.vehicles
    v["y"][1], v["lateral_speed"][1] = 7.6, 0.8
    counts, _ = states(world)
    v["action"][1:] = GO_ON
    v["x"] += v["speed"]
    v["y"][1] = y
    v["x"][rear] += 0.5
    v["speed"][rear] += 1.0
    count_choices(world, ROAD, counts)
    return counts


FAR_AV = Car(2000.0, 0, 30.0)


def test_a_cut_in_by_hand() -> None:
    """At the crossing: 114 m against 85.125 m, so 23.875 m between bumpers, closing by 30.5 - 28 m/s."""
    cars = [FAR_AV, Car(100.0, 1, 28.0), Car(70.0, 2, 30.0), Car(60.0, 2, 33.0), Car(80.0, 1, 33.0)]
    counts = cut_in(world_of(cars))
    found, pairs = counts.cut_ins, counts.pairs
    assert found.sum() == found[2].sum() == 4  # at 25 to 35 m/s
    values = (23.875, 23.875 / 30.5, 2.5 / 23.875, 2.5)
    for grid, row, value in zip(statistics.CUT_INS, found[2], values, strict=True):
        assert only_bin(row) == pytest.approx((value - grid.low) / grid.width - 0.5, abs=0.51), grid.name
    placed = [math.floor(value / grid.width) for value, grid in zip(values, statistics.CUT_IN_PAIRS, strict=False)]
    assert np.argwhere(pairs).tolist() == [[2, row, placed[row], placed[2]] for row in range(2)]


@pytest.mark.parametrize(
    ("rear", "counted"),
    [
        (Car(70.0, 2, 27.0), 0),  # not closing
        (Car(20.5, 2, 30.0), 1),  # 73.4 m behind
        (Car(18.5, 2, 30.0), 0),  # 75.4 m behind
        (Car(70.0, 1, 30.0), 0),  # in the lane that is left
        (Car(70.0, 2, 30.0, present=False), 0),
        (Car(97.0, 2, 30.0), 1),  # beside it: overlaps lengthwise
        (Car(104.0, 2, 30.0), 0),  # ahead
    ],
)
def test_which_vehicles_behind_make_a_cut_in(rear: Car, counted: int) -> None:
    assert cut_in(world_of([FAR_AV, Car(100.0, 1, 28.0), rear])).cut_ins.sum() == 4 * counted


def test_no_cut_in_without_a_crossing_before_the_av_or_beyond_the_bands() -> None:
    rear = Car(70.0, 2, 30.0)
    assert cut_in(world_of([FAR_AV, Car(100.0, 1, 28.0), rear]), y=7.9).cut_ins.sum() == 0
    assert cut_in(world_of([Car(80.0, 2, 40.0), Car(100.0, 1, 28.0), rear])).cut_ins.sum() == 0
    assert cut_in(world_of([FAR_AV, Car(100.0, 1, 36.0), Car(70.0, 2, 39.0)])).cut_ins.sum() == 0
    slow = cut_in(world_of([FAR_AV, Car(100.0, 1, 14.9), rear])).cut_ins
    assert slow[0].sum() == slow.sum() == 4


def slow_cut_ins(scenario: Scenario) -> list[tuple[float, float, float, float]]:
    """Gap, time gap, 1/TTC and closing speed of closing cut-ins, from frames 0.1 s apart."""
    found = []
    last = 10 * ((scenario.x.shape[0] - 1) // 10)
    lane = np.floor(scenario.y / 4.0)
    for f in range(last):
        there = scenario.present[f] & scenario.present[10 * (f // 10 + 1)]
        for i in np.flatnonzero(there & (lane[f] != lane[f + 1])):
            if i == 0:
                continue
            marking = 4.0 * max(lane[f, i], lane[f + 1, i])
            part = (marking - scenario.y[f, i]) / (
                scenario.y[f + 1, i] - scenario.y[f, i]
            ) + 1e-6  # others cross at the same moment
            x, y, speed = ((1.0 - part) * a[f] + part * a[f + 1] for a in (scenario.x, scenario.y, scenario.speed))
            behind = np.flatnonzero(there & (np.floor(y / 4.0) == lane[f + 1, i]) & (x <= x[i]))
            behind = behind[behind != i]
            if behind.size == 0:
                continue
            rear = behind[np.argmax(x[behind])]
            gap, closing = max(0.0, x[i] - x[rear] - 5.0), speed[rear] - speed[i]
            if rear > 0 and closing > 0.0 and gap <= 75.0 and 25.0 <= speed[i] < 35.0:
                found.append((gap, gap / speed[rear], closing / max(gap, 0.01), closing))
    return found


# Against recordings


@pytest.mark.full
def test_cut_ins_are_those_of_the_recordings(reckless: NddModel) -> None:
    """Quantiles by the histograms and by NumPy on the frames.

    With 1 s between the counts one cut-in in a hundred is in one of them only, so each quantile lies between those of
    1 % less and more.
    """
    tests = 1500
    odd = replace(ODD, time_limit=20.0, test_length=5e4)
    setting = setting_of(reckless, odd)
    recorder = Recorder(setting, odd)
    slow = np.array([row for test in range(tests) for row in slow_cut_ins(recorder.record(5, test))])
    counts = simulate(setting, n_slots(odd), seed=5, tests=tests, counting=True).counts
    assert counts.cut_ins[2, 0].sum() == pytest.approx(len(slow), rel=0.01)
    assert len(slow) > 1000
    for grid, row, values in zip(statistics.CUT_INS, counts.cut_ins[2], slow.T, strict=True):
        for percent in (10.0, 25.0, 50.0, 75.0):
            low, high = np.percentile(values, [percent - 1.0, percent + 1.0])
            found = statistics.histogram_quantile(grid, row, percent)
            assert low - grid.width <= found <= high + grid.width, (grid.name, percent)


def slow_counts(scenario: Scenario) -> tuple[int, int, int, int, list[int]]:
    """BV states, following states, lane changes, states with TTC below 10 s, and actions, from a recording.

    A change into a lane that the body touches, as to turn back, is no lane change.
    Who follows whom needs the lanes that a vehicle occupies, which a recording gives at the start only; so following
    states are those at time 0.
    """
    decisions = scenario.action.shape[0]
    at = np.arange(decisions) * 10
    here = scenario.present[at]
    here[:, 0] = False
    actions = scenario.action[here]
    target = scenario.target_lane[at][here]
    changes = actions < 2
    for side in (-1.0, 1.0):
        changes &= target != np.floor((scenario.y[at][here] + side) / 4.0)
    x, lane, speed = scenario.x[0], np.floor(scenario.y[0] / 4.0), scenario.speed[0]
    following = close = 0
    for i in np.flatnonzero(scenario.present[0])[1:]:
        gaps = [(x[j] - x[i] - 5.0, speed[j] - speed[i]) for j in range(x.size) if lane[j] == lane[i] and x[j] > x[i]]
        gap, rate = min(gaps, default=(math.inf, 0.0))
        following += gap <= 115.5
        close += gap <= 115.5 and rate < 0.0 and gap < -10.0 * rate
    return int(here.sum()), following, int(changes.sum()), close, np.bincount(actions, minlength=33).tolist()


@pytest.mark.parametrize("adversary", [None, "lane-changer"])
def test_counts_are_those_of_the_recordings(reckless: NddModel, adversary: str | None) -> None:
    setting = setting_of(reckless, ODD, adversary=adversary)
    recorder = Recorder(setting, ODD)
    slow = [slow_counts(recorder.record(5, test)) for test in range(50)]
    counts = simulate(setting, n_slots(ODD), seed=5, tests=50, counting=True).counts
    assert total(counts, statistics.BV_STATES) == sum(one[0] for one in slow)
    assert total(counts, statistics.LANE_CHANGES) == sum(one[2] for one in slow) > 100
    actions = np.sum([one[4] for one in slow], axis=0)
    wanted = actions[2:].copy()
    wanted[GO_ON - 2] += actions[:2].sum()
    np.testing.assert_array_equal(counts.histograms[4][:31], wanted)
    assert ACCELERATIONS[GO_ON - 2] == 0.0
    at_start = Census(True, 0, 1, -math.inf, math.inf, 0.0)
    counts = simulate(setting, n_slots(ODD), seed=5, tests=50, counting=at_start).counts
    assert total(counts, statistics.FOLLOWING_STATES) == sum(one[1] for one in slow) > 500
    assert total(counts, statistics.TTC_BELOW + 3) == sum(one[3] for one in slow) > 5


def test_crashed_vehicles_are_two_for_each_crash(reckless: NddModel) -> None:
    tally = simulate(setting_of(reckless, ODD), n_slots(ODD), seed=5, tests=300, counting=True)
    assert tally.bv_crashes > 10
    assert total(tally.counts, statistics.CRASHED_BVS) == 2 * tally.bv_crashes


# Windows


@pytest.mark.parametrize("field", ["time", "road"])
def test_parts_of_time_and_of_road_add_up(reckless: NddModel, field: str) -> None:
    setting = setting_of(reckless, ODD)
    inf = math.inf
    cuts = {
        "time": [Census(True, 0, 4, -inf, inf, 0.0), Census(True, 4, 999, -inf, inf, 0.0)],
        "road": [
            Census(True, 0, 999, -inf, 300.123, 30.0),
            Census(True, 0, 999, np.nextafter(300.123, inf), inf, 30.0),
        ],
    }[field]
    whole, *parts = (
        simulate(setting, n_slots(ODD), seed=2, tests=60, counting=census).counts for census in (EVERYBODY, *cuts)
    )
    assert all(part.totals[statistics.BV_STATES] > 1000 for part in parts)
    np.testing.assert_array_equal(parts[0].histograms[:5] + parts[1].histograms[:5], whole.histograms[:5])
    np.testing.assert_array_equal(parts[0].joint + parts[1].joint, whole.joint)
    assert whole.cut_ins.sum() > 20
    np.testing.assert_array_equal(parts[0].cut_ins + parts[1].cut_ins, whole.cut_ins)
    beside = statistics.SPEED_DIFFERENCE_BESIDE
    assert whole.histograms[beside].sum() > 100
    np.testing.assert_array_equal(parts[0].histograms[beside] + parts[1].histograms[beside], whole.histograms[beside])
    without_av = np.delete(np.arange(whole.totals.size), [statistics.AV_STATES, statistics.BV_TRAVEL_MM])
    np.testing.assert_array_equal((parts[0].totals + parts[1].totals)[without_av], whole.totals[without_av])
    travel = [int(part.totals[statistics.BV_TRAVEL_MM]) for part in (whole, *parts)]
    assert 0 <= travel[0] - travel[1] - travel[2] <= 60  # each test is cut to whole millimetres


def test_what_is_counted_changes_no_outcome_and_threads_no_count(reckless: NddModel) -> None:
    setting = setting_of(reckless, ODD)
    census = Census(True, 2, 6, 300.0, 900.0, 30.0)
    one, many = (simulate(setting, n_slots(ODD), seed=3, tests=1200, counting=census, threads=n) for n in (1, 3))
    plain = simulate(setting, n_slots(ODD), seed=3, tests=1200)
    assert one.digest.hexdigest() == many.digest.hexdigest() == plain.digest.hexdigest()
    for left, right in zip(one.counts, many.counts, strict=True):
        np.testing.assert_array_equal(left, right)
    assert not any(part.any() for part in plain.counts)
    chunks = simulate_chunks(setting, n_slots(ODD), seed=3, first=0, tests=1200, threads=2, counting=census, chunk=7)
    joint = sum(counts.joint for _, _, counts in chunks)
    np.testing.assert_array_equal(joint, one.counts.joint)


def test_windows_of_one_drive_add_up_and_note_the_states(reckless: NddModel) -> None:
    odd = replace(ODD, test_length=1e5, time_limit=8.0)
    setting, slots = setting_of(reckless, odd), n_slots(odd)
    census = Census(True, 0, 8, 100.0, 600.0, 30.0)
    windows = allocate_windows(np.array([1, 5, 8]), 3, slots)
    out = drive_chunk_by_window(setting, slots, 5, 0, 30, census, windows)
    plain, whole = drive_chunk(setting, slots, 5, 0, 30, census)
    for one, other in zip(out, plain, strict=True):
        np.testing.assert_array_equal(one, other)
    for name in Counts._fields[:-1]:
        np.testing.assert_array_equal(getattr(windows.counts, name).sum(axis=0), getattr(whole, name))
    difference = whole.totals - windows.counts.totals.sum(axis=0)
    assert 0 <= difference[statistics.BV_TRAVEL_MM] <= 3 * 30  # each window is cut to whole millimetres
    assert not np.delete(difference, statistics.BV_TRAVEL_MM).any()
    middle = drive_chunk(setting, slots, 5, 0, 30, census._replace(first=1, until=5))[1]
    np.testing.assert_array_equal(windows.counts.joint[1], middle.joint)
    recorder = Recorder(setting, odd)
    for test in range(3):
        scenario = recorder.record(5, test)
        seconds = np.arange(scenario.action.shape[0])
        noted = windows.states[test, seconds, : scenario.x.shape[1]]
        there = scenario.present[10 * seconds]
        np.testing.assert_array_equal(noted["present"] == 1, there)
        for name in ("x", "y", "speed"):
            np.testing.assert_array_equal(noted[name][there], getattr(scenario, name)[10 * seconds][there])
    assert (windows.lengths[:, 1] == 5.0).all()


def test_other_grids_of_joint_counts_fit_the_array() -> None:
    assert all(grid.bins <= allocate_counts().joint.shape[2] for grid in statistics.JOINT)
    for limit in statistics.TTC_LIMITS:  # each limit is an edge of the inverse TTC's bins
        grid = statistics.JOINT[statistics.INVERSE_TTC]
        assert (1.0 / limit - grid.low) / grid.width == pytest.approx(round((1.0 / limit - grid.low) / grid.width))


def test_a_longer_test_is_counted_whole(model: NddModel) -> None:
    odd = replace(ODD, test_length=1e5, time_limit=5.0)
    counts = simulate(setting_of(model, odd), n_slots(odd), seed=1, tests=5, counting=True).counts
    assert total(counts, statistics.AV_STATES) == 25


def test_counts_are_sent_whole_and_zeros_as_nothing() -> None:
    counts = allocate_counts()
    assert len(pickle.dumps(counts)) < 1_000
    counts.joint[1, 2, 3] = 7
    again = pickle.loads(pickle.dumps(counts))
    assert isinstance(again, Counts)
    for sent, come in zip(counts, again, strict=True):
        assert np.array_equal(sent, come)
        assert come.flags.writeable
