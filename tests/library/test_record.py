from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.records import CaseRecord, case_record

from cornerforge.errors import InputError
from cornerforge.library.schema import check_extra_name
from cornerforge.library.tables import restore
from cornerforge.sim.harvest import NEAR_M
from cornerforge.types import Crash, Odd, Scenario

Make = Callable[..., Scenario]


def as_stored(record: CaseRecord) -> Scenario:
    return restore(record.case, record.tracks, 0, record.odd)


@given(seed=st.integers(0, 2**32), n_frames=st.integers(1, 45), n_vehicles=st.integers(2, 8))
def test_any_scenario_comes_back_as_float32_of_its_near_vehicles(seed: int, n_frames: int, n_vehicles: int) -> None:
    rng = np.random.default_rng(seed)
    shape, decisions = (n_frames, n_vehicles), -(-n_frames // 10)
    present = rng.random(shape) < 0.7
    present[:, 0] = True
    partner = int(rng.integers(1, n_vehicles))
    present[-1, partner] = True
    slot = np.concatenate([[0], 1 + rng.permutation(40)[: n_vehicles - 1]]).astype(np.int16)
    real = [np.where(present, rng.normal(400.0, 300.0, shape), np.nan) for _ in range(5)]
    scenario = Scenario(
        seed=seed, test=seed // 3, odd=Odd(), slot=slot,
        x=real[0], y=real[1] / 100.0, speed=real[2], heading=real[3], acceleration=real[4],
        target_lane=np.where(present, rng.integers(0, 3, shape), 77).astype(np.int8), present=present,
        action=np.where(present[::10], rng.integers(-1, 33, (decisions, n_vehicles)), -1).astype(np.int8),
        critical_bv=np.where(rng.random(decisions) < 0.3, -1, rng.integers(1, n_vehicles, decisions)).astype(np.int16),
        log_prob_nde=np.where(rng.random(decisions) < 0.3, -np.inf, -rng.exponential(1.0, decisions)),
        crash=Crash(round(0.1 * (n_frames - 1), 1), 0, int(slot[partner])),
    )  # fmt: skip
    back = as_stored(case_record(scenario, trajectory_digest="00"))

    kept = [int(np.flatnonzero(slot == s)[0]) for s in back.slot]
    for name in ("x", "y", "speed", "heading", "acceleration"):
        expected = getattr(scenario, name)[:, kept].astype(np.float32).astype(np.float64)
        np.testing.assert_array_equal(getattr(back, name), expected)
    np.testing.assert_array_equal(back.present, present[:, kept])
    np.testing.assert_array_equal(back.target_lane, np.where(present, scenario.target_lane, -1)[:, kept])
    np.testing.assert_array_equal(back.action, scenario.action[:, kept])
    np.testing.assert_array_equal(back.log_prob_nde, scenario.log_prob_nde)
    critical = scenario.critical_bv
    np.testing.assert_array_equal(back.critical_bv >= 0, critical >= 0)
    np.testing.assert_array_equal(back.slot[back.critical_bv[critical >= 0]], slot[critical[critical >= 0]])
    assert (back.seed, back.test, back.crash) == (scenario.seed, scenario.test, scenario.crash)
    near = (np.abs(scenario.x - scenario.x[:, :1]) <= NEAR_M).any(axis=0)
    assert set(np.flatnonzero(near)) <= set(kept)
    assert set(kept) <= {*np.flatnonzero(near), *critical, partner}


def test_labels_at_contact_are_those_of_the_last_frame(make_scenario: Make) -> None:
    scenario = make_scenario(5)
    case = case_record(scenario, trajectory_digest="ab").case
    assert case["case_id"] == "7:5"
    assert case["bv_slot"] == 3
    assert case["crash_time_s"] == pytest.approx(6.0)
    assert case["impact_speed_difference_mps"] == scenario.speed[-1, 3] - scenario.speed[-1, 0]
    assert case["relative_lon_m"] == pytest.approx(4.99)
    assert case["relative_lat_m"] == pytest.approx(0.25)
    assert case["relative_lane"] == 0
    assert case["relative_heading_rad"] == 0.0
    assert case["log_prob_nde"] == pytest.approx(scenario.log_prob_nde.sum())
    assert (case["n_vehicles"], case["n_decisions"], case["n_impossible"]) == (6, 6, 0)
    assert list(np.asarray(case["critical_bv_action"])) == [-1, *scenario.action[1:, 3]]


def test_history_counts_seconds_back_from_contact(make_scenario: Make) -> None:
    scenario = make_scenario(5)
    history = np.asarray(case_record(scenario, trajectory_digest="ab").case["history"]).reshape(16, 2, 4)
    for k in range(7):
        for i, column in enumerate((0, 3)):
            arrays = (scenario.x, scenario.y, scenario.speed, scenario.heading)
            expected = [a[60 - 10 * k, column] for a in arrays]
            np.testing.assert_array_equal(history[k, i], np.array(expected, dtype=np.float32))
    assert np.isnan(history[7:]).all()


def test_relative_heading_is_wrapped(make_scenario: Make) -> None:
    scenario = make_scenario(1)
    scenario.heading[-1, 0], scenario.heading[-1, 3] = 3.0, -3.0
    found = case_record(scenario, trajectory_digest="ab").case["relative_heading_rad"]
    assert found == pytest.approx(2.0 * math.pi - 6.0)


def test_peaks_measure_what_the_vehicles_did(make_scenario: Make) -> None:
    scenario = make_scenario(1)
    case = case_record(scenario, trajectory_digest="ab").case
    assert case["av_max_braking_mps2"] == 0.0
    assert case["bv_max_braking_mps2"] == pytest.approx(3.0)
    assert case["bv_max_lateral_acceleration_mps2"] == 0.0
    assert case["physically_plausible"] is True


@pytest.mark.parametrize(("lateral", "plausible"), [(3.9, True), (4.1, False)])
def test_plausible_is_bounded_across_the_road(make_scenario: Make, lateral: float, plausible: bool) -> None:
    scenario = make_scenario(1)
    scenario.y[-11:, 3] += 0.5 * lateral * np.linspace(0.0, 1.0, 11) ** 2
    case = case_record(scenario, trajectory_digest="ab").case
    assert case["bv_max_lateral_acceleration_mps2"] == pytest.approx(lateral)
    assert case["physically_plausible"] is plausible


@pytest.mark.parametrize(("braking", "plausible"), [(8.4, True), (8.6, False)])
def test_plausible_is_bounded_along_the_road(make_scenario: Make, braking: float, plausible: bool) -> None:
    scenario = make_scenario(1)
    scenario.speed[-11:, 0] -= braking * np.linspace(0.0, 1.0, 11)
    case = case_record(scenario, trajectory_digest="ab").case
    assert case["av_max_braking_mps2"] == pytest.approx(braking)
    assert case["physically_plausible"] is plausible


def test_min_ttc_sees_only_who_is_in_the_path_and_present(make_scenario: Make) -> None:
    scenario = make_scenario(1, n_frames=4, n_vehicles=4)
    scenario.x[:] = [[0.0, 20.0, 20.0, 40.0]]
    scenario.y[:] = [[2.0, 2.0, 6.0, 3.9]]
    scenario.speed[:] = [[30.0, 31.0, 1.0, 25.0]]
    scenario.x[2:, 2] = scenario.y[2:, 2] = np.nan
    case = case_record(scenario, trajectory_digest="ab").case
    assert case["min_ttc_s"] == pytest.approx((40.0 - 5.0) / 5.0)
    scenario.speed[:, 3] = 30.0
    assert case_record(scenario, trajectory_digest="ab").case["min_ttc_s"] is None
    scenario.x[:, 1], scenario.speed[:, 1] = -15.0, 35.0
    assert case_record(scenario, trajectory_digest="ab").case["min_ttc_s"] == pytest.approx(2.0)


def test_an_impossible_action_leaves_no_log_probability(make_scenario: Make) -> None:
    scenario = make_scenario(1)
    scenario.log_prob_nde[[2, 4]] = -np.inf
    case = case_record(scenario, trajectory_digest="ab").case
    assert case["log_prob_nde"] is None
    assert case["n_impossible"] == 2


def test_a_crash_in_the_first_frame_is_a_case(make_scenario: Make) -> None:
    record = case_record(make_scenario(1, n_frames=1), trajectory_digest="ab")
    assert record.case["av_max_acceleration_mps2"] is None
    assert record.case["min_ttc_s"] is None
    assert record.case["physically_plausible"] is True
    assert as_stored(record).x.shape[0] == 1


@pytest.mark.parametrize("crash", [None, Crash(6.0, 1, 3)])
def test_only_crashes_of_the_av_are_cases(make_scenario: Make, crash: Crash | None) -> None:
    with pytest.raises(InputError, match=r"7:1 holds no crash of the AV"):
        case_record(replace(make_scenario(1), crash=crash), trajectory_digest="ab")


@pytest.mark.parametrize("crash", [Crash(9.0, 0, 3), Crash(6.0, 0, 99), Crash(6.0, 0, 2)])
def test_a_crash_outside_the_recording_is_refused(make_scenario: Make, crash: Crash) -> None:
    with pytest.raises(InputError, match="is not in the recording"):
        case_record(replace(make_scenario(1), crash=crash), trajectory_digest="ab")


@pytest.mark.parametrize("name", ["Upper", "two words", "a;b", "", "test"])
def test_extra_names_that_cannot_be_columns_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="Extra column"):
        check_extra_name(name)
