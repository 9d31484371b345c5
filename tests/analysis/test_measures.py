"""Measures of cases: by hand, against the library's own, and what must not change them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hand_built import WIDE
from hypothesis import given
from hypothesis import strategies as st
from reference.recorded import recordings_of_all
from reference.records import case_record

from cornerforge.analysis.fault import Faults, assign_fault
from cornerforge.analysis.measures import MEASURES, Impact, measure_cases
from cornerforge.errors import InputError
from cornerforge.metrics import injury_probability
from cornerforge.recordings import Recordings, recordings_of_tracks
from cornerforge.types import Crash, Scenario

DT = 0.1
FORCE_DIRECTIONS = ("av_force_direction_rad", "bv_force_direction_rad")
INJURIES = ("av_injury_probability", "bv_injury_probability")
Row = tuple[float, float, float, float]


def scenario_of(frames: list[list[Row]], test: int = 0) -> Scenario:
    """A crash from [x, y, speed, heading] of each vehicle in each frame; the AV meets vehicle 1 in the last one."""
    values = np.array(frames, dtype=np.float64)
    n, slots = values.shape[:2]
    decisions = max(1, -(-(n - 1) // 10))
    return Scenario(
        seed=5,
        test=test,
        odd=WIDE,
        slot=np.arange(slots, dtype=np.int16),
        x=values[..., 0],
        y=values[..., 1],
        speed=values[..., 2],
        heading=values[..., 3],
        acceleration=np.zeros((n, slots)),
        target_lane=np.floor(values[..., 1] / 4.0).astype(np.int8),
        present=np.ones((n, slots), np.bool_),
        action=np.full((decisions, slots), -1, np.int8),
        critical_bv=np.full(decisions, -1, np.int16),
        log_prob_nde=np.zeros(decisions),
        crash=Crash(time=(n - 1) * DT, slot_a=0, slot_b=1),
    )


def measure(*scenarios: Scenario) -> dict[str, list[float]]:
    columns = measure_cases(recordings_of_all(scenarios))
    return {name: values.tolist() for name, values in columns.items()}


def braking_lead() -> Scenario:
    """Both at 25 m/s, 30 m apart; from 1 s on the lead brakes with 4 m/s2. Contact after 30 = 2 t^2: frame 4.9 s."""
    frames = []
    for k in range(50):
        t, since = k * DT, max(0.0, k * DT - 1.0)
        frames.append([(25.0 * t, 6.0, 25.0, 0.0), (35.0 + 25.0 * t - 2.0 * since**2, 6.0, 25.0 - 4.0 * since, 0.0)])
    return scenario_of(frames)


def from_the_right(lead: float) -> Scenario:
    """The AV keeps 30 m/s; a BV at 20 m/s, its centre `lead` m ahead, comes over from the right at 2 m/s."""
    heading = math.atan(2.0 / 20.0)
    frames: list[list[Row]] = []
    for k in range(200):
        t = k * DT
        y = min(6.0, 2.0 + 2.0 * t)
        bv = (lead + 20.0 * t, y, 20.0, heading if y < 6.0 else 0.0)
        frames.append([(30.0 * t, 6.0, 30.0, 0.0), bv])
        if abs(bv[0] - 30.0 * t) < 5.0 and 6.0 - y < 2.0:
            return scenario_of(frames)
    raise AssertionError("they miss each other")


def test_a_rear_end_crash_by_hand() -> None:
    found = measure(braking_lead())
    # The last frame before contact, 3.8 s after the braking began: 30 - 2 * 3.8^2 = 1.12 m, closing with 15.2 m/s.
    assert found["min_bbd_front_m"] == pytest.approx([1.12])
    assert found["min_ttc_front_s"] == pytest.approx([1.12 / 15.2])
    assert found["min_thw_front_s"] == pytest.approx([1.12 / 25.0])
    assert found["max_drac_front_mps2"] == pytest.approx([15.2**2 / 2.24])
    safe = 12.5 + 0.25 + 26.0**2 / 8.0 - 9.8**2 / 8.0
    assert found["min_rss_margin_front_m"] == pytest.approx([1.12 - safe])
    # They are in one lane, so across they lack all: 2 m of overlap, margin 0.1 m, what both drift while responding.
    assert found["min_rss_margin_m"] == pytest.approx([-(2.0 + 0.1 + 0.03125 + 0.125)])
    # One second before contact: 30 - 2 * 2.9^2 = 13.18 m, closing with 11.6 m/s.
    assert found["bbd_1s_m"] == pytest.approx([13.18])
    assert found["ttc_1s_s"] == pytest.approx([13.18 / 11.6])
    # At contact the lead has 25 - 4 * 3.9 = 9.4 m/s left.
    assert found["impact_speed_mps"] == pytest.approx([15.6])
    assert found["impact_angle_rad"] == [0.0]
    assert found["av_delta_v_mps"] == found["bv_delta_v_mps"] == pytest.approx([7.8])
    assert found["av_force_direction_rad"] == pytest.approx([0.0])
    assert np.abs(found["bv_force_direction_rad"]) == pytest.approx([math.pi])
    assert found["av_injury_probability"] == pytest.approx([1.0 / (1.0 + math.exp(6.9774 - 0.1620 * 7.8 / 0.44704))])
    assert found["bv_injury_probability"] == pytest.approx([1.0 / (1.0 + math.exp(8.0329 - 0.1793 * 7.8 / 0.44704))])
    for name in ("pet_s", "min_bbd_rear_m", "min_ttc_rear_s", "min_thw_rear_s", "max_drac_rear_mps2"):
        assert np.isnan(found[name]).all(), name


def test_a_sideswipe_by_hand() -> None:
    # The BV's centre is 4 m ahead after 1.1 s, when it is 4.2 m from the right: 1.8 m beside the AV, in its side.
    scenario = from_the_right(15.0)
    assert len(scenario.x) == 12
    found = measure(scenario)
    assert found["impact_speed_mps"] == pytest.approx([math.hypot(10.0, 2.0)])
    assert found["impact_angle_rad"] == pytest.approx([math.atan(0.1)])
    # The AV's corner meets the side of the BV, which stands askew. Across that side both close in; along it they slide.
    turn = math.atan(0.1)
    closing = 10.0 * math.sin(turn) + 2.0 * math.cos(turn)
    assert closing < math.hypot(10.0, 2.0) / 3.0
    assert found["av_delta_v_mps"] == found["bv_delta_v_mps"] == pytest.approx([closing / 2.0 * math.hypot(1.0, 0.5)])
    # Friction pulls the AV back along the BV, the push comes from the right, across the BV's side.
    assert found["av_force_direction_rad"] == pytest.approx([turn - math.atan2(1.0, 0.5)])
    assert found["bv_force_direction_rad"] == pytest.approx([math.pi - math.atan2(1.0, 0.5)])
    assert found["pet_s"] == [0.0]
    assert np.isnan(found["min_bbd_front_m"]).all()  # never in one path before the contact


def test_force_on_a_side_is_near_side_where_the_driver_sits() -> None:
    frame: list[Row] = [(0.0, 6.0, 20.0, 0.0), (0.0, 4.2, 20.0, math.atan(0.15))]  # from the right with 3 m/s
    found = measure(scenario_of([frame]))
    assert found["av_force_direction_rad"] == pytest.approx([-math.pi / 2.0])
    assert found["av_injury_probability"] == pytest.approx([float(injury_probability(1.5, -math.pi / 2.0))])
    assert found["bv_injury_probability"] > found["av_injury_probability"]


def test_encroachment_at_constant_speeds_is_the_headway_on_entering() -> None:
    # The BV overlaps the AV sideways once it has come 2 m: after 1 s, seen at 1.1 s. The AV is then 11 m nearer.
    found = measure(from_the_right(50.0))
    assert found["pet_s"] == pytest.approx([(50.0 - 11.0 - 5.0) / 30.0])


TRUCK, MOTORCYCLE = (16.5, 2.55), (2.2, 0.8)
"""Length and width [m]."""


def as_class(scenario: Scenario, vehicle: int, size: tuple[float, float]) -> Recordings:
    """The recording of a scenario in which one vehicle has another size."""
    recordings = recordings_of_all([scenario])
    length, width = recordings.length.copy(), recordings.width.copy()
    length[vehicle], width[vehicle] = size
    return recordings._replace(length=length, width=width)


def moved(scenario: Scenario, vehicle: int, distance: float) -> Scenario:
    x = scenario.x.copy()
    x[:, vehicle] += distance
    return replace(scenario, x=x)


@pytest.mark.parametrize("size", [TRUCK, MOTORCYCLE])
def test_a_lead_of_another_length_with_its_rear_where_a_cars_is_gives_the_same(size: tuple[float, float]) -> None:
    scenario = braking_lead()
    further = moved(scenario, 1, 0.5 * (size[0] - 5.0))
    car, other = measure(scenario), measure_cases(as_class(further, 1, size))
    for name, values in car.items():
        if name in (
            "min_rss_margin_m",
            "rss_margin_1s_m",
        ):  # across the road they lack half of both widths, and what is theirs as cars
            assert other[name] == pytest.approx([values[0] + 2.0 - 0.5 * (2.0 + size[1])])
        else:
            assert other[name] == pytest.approx(values, nan_ok=True, abs=1e-9), name
    faults, others = assign_fault(recordings_of_all([scenario])), assign_fault(as_class(further, 1, size))
    assert (others.fault, others.rule, others.violation_s) == (faults.fault, faults.rule, faults.violation_s)
    # Negative control: as a car the motorcycle overlaps before the contact, and the truck's rear is not touched at all.
    if size == MOTORCYCLE:
        assert measure(further)["min_bbd_front_m"] == pytest.approx([1.12 - 1.4])
    else:
        with pytest.raises(InputError, match="m apart at the contact"):
            measure(further)


def test_encroachment_is_that_of_bumpers() -> None:
    # As above, with a truck of a car's width and its rear where the car's was; then with the AV as a truck: its front.
    scenario = from_the_right(50.0)
    truck = as_class(moved(scenario, 1, 5.75), 1, (16.5, 2.0))
    assert measure_cases(truck)["pet_s"] == pytest.approx(measure(scenario)["pet_s"])
    long_av = as_class(moved(scenario, 0, -5.75), 0, (16.5, 2.0))
    assert measure_cases(long_av)["pet_s"] == pytest.approx(measure(scenario)["pet_s"])


@pytest.mark.parametrize(
    ("size", "apart", "gap"),
    [(MOTORCYCLE, 1.39, 16.4), (MOTORCYCLE, 1.41, None), (TRUCK, 2.27, 9.25), (TRUCK, 2.28, None)],
)
def test_in_the_path_is_who_overlaps_sideways_with_its_own_width(
    size: tuple[float, float], apart: float, gap: float | None
) -> None:
    # Sideways they overlap below 1 + 0.4 = 1.4 m and 1 + 1.275 = 2.275 m; 20 m ahead, 3.6 and 10.75 m are vehicle.
    frame: list[Row] = [(0.0, 6.0, 25.0, 0.0), (-4.6, 6.0, 30.0, 0.0), (20.0, 6.0 - apart, 25.0, 0.0)]
    found = measure_cases(as_class(scenario_of([frame, frame]), 2, size))
    assert found["min_bbd_front_m"] == pytest.approx([math.nan if gap is None else gap], nan_ok=True)


def test_short_recordings_have_no_second_before() -> None:
    frame: list[Row] = [(0.0, 6.0, 25.0, 0.0), (4.6, 6.0, 20.0, 0.0)]
    found = measure(scenario_of([frame]))
    for name in ("rss_margin_1s_m", "bbd_1s_m", "ttc_1s_s", "min_rss_margin_m", "min_bbd_front_m", "pet_s"):
        assert np.isnan(found[name]).all(), name
    assert found["impact_speed_mps"] == [5.0]


def random_scenario(seed: int, test: int = 0) -> Scenario:
    """Five vehicles with random speeds and slow drift; the recording ends with vehicle 1 in the AV's rear or front."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 40))
    t = np.arange(n)[:, None] * DT
    speed = rng.uniform(15.0, 35.0, 5) + np.cumsum(rng.uniform(-0.3, 0.3, (n, 5)), axis=0)
    x = rng.uniform(0.0, 120.0, 5) + np.cumsum(speed * DT, axis=0)
    y = rng.choice([2.0, 6.0, 10.0], 5) + rng.uniform(-0.6, 0.6, 5) * t
    x[:, 1] += x[-1, 0] + rng.choice([-4.9, 4.9]) - x[-1, 1]
    y[:, 1] += y[-1, 0] + rng.uniform(-1.5, 1.5) - y[-1, 1]
    heading = np.arctan(np.gradient(y, DT, axis=0) / speed)
    values = np.stack([x, y, speed, heading], axis=-1)
    scenario = scenario_of(values.tolist(), test)
    present = rng.uniform(size=(n, 5)) < 0.9
    present[:, 0] = present[-1, 1] = True
    holes: dict[str, Any] = {
        name: np.where(present, getattr(scenario, name), np.nan) for name in ("x", "y", "speed", "heading")
    }
    return replace(scenario, present=present, **holes)


seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_times_to_collision_are_those_of_the_library(seed: int) -> None:
    scenario = random_scenario(seed)
    found = measure(scenario)
    both = np.fmin(found["min_ttc_front_s"], found["min_ttc_rear_s"]).tolist()
    stored = case_record(scenario, trajectory_digest="0" * 64).case["min_ttc_s"]
    assert (None if math.isnan(both[0]) else both[0]) == (None if stored is None else pytest.approx(stored))


@given(seeds)
def test_mirrored_roads_give_mirrored_measures(seed: int) -> None:
    scenario = random_scenario(seed)
    one = measure(scenario)
    other = measure(replace(scenario, y=12.0 - scenario.y, heading=-scenario.heading))
    for name, values in one.items():
        if name in FORCE_DIRECTIONS:
            assert np.cos(values) == pytest.approx(np.cos(other[name]))
            assert np.sin(values) == pytest.approx(-np.sin(other[name]), abs=1e-9)
        elif name not in INJURIES:
            assert values == pytest.approx(other[name], nan_ok=True, abs=1e-9), name


@given(st.lists(seeds, min_size=1, max_size=6, unique=True))
def test_a_batch_is_its_cases_one_by_one_and_its_blocks(all_seeds: list[int]) -> None:
    scenarios = [random_scenario(seed, test) for test, seed in enumerate(all_seeds)]
    recordings = recordings_of_all(scenarios)
    batch = measure_cases(recordings)
    blocks = [measure_cases(block) for block in recordings.blocks(2)]
    singles = [measure_cases(recordings_of_all([scenario])) for scenario in scenarios]
    for name, values in batch.items():
        assert np.array_equal(values, np.concatenate([one[name] for one in singles]), equal_nan=True)
        assert np.array_equal(values, np.concatenate([block[name] for block in blocks]), equal_nan=True)


def from_library(scenarios: list[Scenario]) -> Recordings:
    records = [case_record(scenario, trajectory_digest="0" * 64) for scenario in scenarios]
    cases, tracks = (pa.concat_tables(tables) for tables in ([r.cases for r in records], [r.tracks for r in records]))
    return recordings_of_tracks(cases, tracks)


@given(st.lists(seeds, min_size=1, max_size=5, unique=True))
def test_stored_tracks_give_what_the_scenarios_give(all_seeds: list[int]) -> None:
    # Tracks hold float32, so the scenarios are rounded first: then everything is the same to the bit.
    scenarios = [
        replace(s, **{name: getattr(s, name).astype(np.float32) for name in ("x", "y", "speed", "heading")})
        for s in (random_scenario(seed, test) for test, seed in enumerate(all_seeds))
    ]
    stored, direct = from_library(scenarios), recordings_of_all(scenarios)
    assert stored.case_ids == direct.case_ids
    one, other = measure_cases(stored), measure_cases(direct)
    for name, values in one.items():
        assert np.array_equal(values, other[name], equal_nan=True), name
    faults, again = assign_fault(stored), assign_fault(direct)
    for name in Faults.__dataclass_fields__:
        assert np.array_equal(getattr(faults, name), getattr(again, name), equal_nan=name.endswith("_s")), name


def test_masses_and_restitution_move_the_severity() -> None:
    recordings = recordings_of_all([braking_lead()])
    lorry = measure_cases(recordings, impact=Impact(av_mass=1500.0, bv_mass=6000.0, restitution=0.1))
    assert lorry["av_delta_v_mps"] == pytest.approx([15.6 * 1.1 * 0.8])
    assert lorry["bv_delta_v_mps"] == pytest.approx([15.6 * 1.1 * 0.2])
    assert lorry["av_injury_probability"] > measure_cases(recordings)["av_injury_probability"]
    with pytest.raises(InputError, match=r"impact\.restitution = 1\.5"):
        Impact(restitution=1.5)


def test_columns_are_documented_and_end_in_their_unit() -> None:
    found = measure(braking_lead())
    assert list(found) == [column.name for column in MEASURES]
    endings = {"m": "_m", "s": "_s", "m/s": "_mps", "m/s2": "_mps2", "rad": "_rad", "": "_probability"}
    assert all(column.name.endswith(endings[column.unit]) for column in MEASURES)
    assert all(column.meaning.endswith(".") and column.type == "float64" for column in MEASURES)


def test_no_cases_no_values() -> None:
    recordings = recordings_of_all([braking_lead()])
    nothing = Recordings._make(values[:0] for values in recordings)
    assert {values.size for values in measure_cases(nothing).values()} == {0}


def test_tracks_without_the_partner_are_refused() -> None:
    record = case_record(braking_lead())
    cases, tracks = record.cases, record.tracks

    def changed(name: str, value: object) -> pa.Table:
        place = cases.schema.get_field_index(name)
        return cases.set_column(place, cases.schema.field(name), pa.array([value], cases.schema.field(name).type))

    with pytest.raises(InputError, match="Case 5:0: its crash partner is not among its vehicles"):
        measure_cases(recordings_of_tracks(changed("bv_slot", 9), tracks))
    for time in (5.0, None):
        with pytest.raises(InputError, match="Case 5:0: its contact is not in the recording"):
            measure_cases(recordings_of_tracks(changed("crash_time_s", time), tracks))
    with pytest.raises(InputError, match="2 cases and 1 trajectories are not of the same cases"):
        recordings_of_tracks(pa.concat_tables([cases, cases]), tracks)
