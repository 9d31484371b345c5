"""Scripted drives: the script of a recorded test is that test, a later start is its rest, and nothing is drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.ndd.model import Memory, default_model_path, load_model, save_model
from cornerforge.perception import Perception
from cornerforge.road.straight import lane_centre
from cornerforge.sim.recorder import scenario_digest
from cornerforge.sim.scripted import NATURAL, START_FIELDS, Script, ScriptDriver, scripted_start
from cornerforge.sim.world import VEHICLE
from cornerforge.types import ACCELERATIONS, CAR, MOTORCYCLE, TRUCK, Crash, Odd, Scenario

RUNS = {
    "swerve": {"bv": "swerve"},
    "swift, lane-changer, watchful AV": {"bv": "lane-changer", "odd": "swift", "av": "idm-mobil-watchful"},
    "paper, uniform, 2 lanes": {"bv": "uniform", "odd": "paper", "lanes": 2},
    "cautious AV": {"bv": "swerve", "av": "rss-cautious"},
    "learned AV": {"bv": "swerve", "av": "rl"},
    "natural": {"bv": "nde"},
    "idm": {"bv": "idm"},
}
TESTS = 30


def recorded(run: Experiment, driver: ScriptDriver, test: int, seed: int = 3) -> tuple[Scenario, Script]:
    """A recorded test and its script."""
    scenario = run.recorder().record(seed, test)
    return scenario, Script(scenario.slot, driver.start_of_test(seed, test), scenario.action)


def crashes(run: Experiment, driver: ScriptDriver, n: int) -> list[tuple[Scenario, Script]]:
    """The first AV crashes of a run."""
    found: list[tuple[Scenario, Script]] = []
    test = 0
    while len(found) < n:
        pair = recorded(run, driver, test)
        if pair[0].crash is not None and pair[0].crash.slot_a == 0:
            found.append(pair)
        test += 1
    return found


@pytest.fixture(scope="module")
def swerve() -> Experiment:
    return experiment(bv="swerve")


@pytest.fixture(scope="module")
def driver(swerve: Experiment) -> ScriptDriver:
    return ScriptDriver(swerve.setting, swerve.odd)


def start_of(*vehicles: tuple[float, int, float]) -> NDArray[np.void]:
    """Vehicles (x, lane, speed) that keep their lanes."""
    fields = np.zeros((len(vehicles), len(START_FIELDS)))
    for row, (x, lane, speed) in zip(fields, vehicles, strict=True):
        values = {"x": x, "y": lane_centre(lane, 4.0), "speed": speed, "target_lane": lane, "lanes": 1 << lane}
        values |= {"length": 5.0, "width": 2.0, "quantile": 0.5, "habit": 0.5, "desired_speed": speed}
        row[:] = [values.get(name, 0.0) for name in START_FIELDS]
    return scripted_start(fields)


def natural(start: NDArray[np.void], decisions: int) -> Script:
    """Everybody drives naturally."""
    slots = np.arange(start.size, dtype=np.int16)
    return Script(slots, start, np.full((decisions, start.size), NATURAL, dtype=np.int8))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", RUNS)
def test_the_script_of_a_test_is_that_test_bit_for_bit(name: str) -> None:
    run = experiment(**RUNS[name])  # type: ignore[arg-type]
    driver = ScriptDriver(run.setting, run.odd)
    compared = 0
    for test in range(TESTS):
        scenario, script = recorded(run, driver, test)
        if scenario.crash is not None and scenario.crash.slot_a != 0:
            continue  # the controlled BV's crash ends a test of an adversary, and nobody is controlled in a script
        again, _ = driver.record(script)
        assert scenario_digest(again) == scenario_digest(scenario)
        assert again.crash == scenario.crash
        assert again.log_prob_nde[0] == scenario.log_prob_nde[0]
        compared += 1
    assert compared >= TESTS // 2


@pytest.fixture(scope="module")
def forgetful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped model, but for its memory."""
    path = tmp_path_factory.mktemp("model") / "forgetful.npz"
    save_model(replace(load_model(default_model_path()), memory=Memory()), path)
    return path


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", RUNS)
def test_without_memory_the_chances_are_those_of_the_test_too(name: str, forgetful: Path) -> None:
    """A script tells actions, not where in its interval each quantile was, which drivers with a memory go on from."""
    run = experiment(**RUNS[name], model=forgetful)  # type: ignore[arg-type]
    driver = ScriptDriver(run.setting, run.odd)
    compared = 0
    for test in range(TESTS):
        scenario, script = recorded(run, driver, test)
        if scenario.crash is not None and scenario.crash.slot_a != 0:
            continue
        again, _ = driver.record(script)
        assert scenario_digest(again) == scenario_digest(scenario)
        np.testing.assert_array_equal(again.log_prob_nde, scenario.log_prob_nde)
        compared += 1
    assert compared >= TESTS // 2


def test_another_action_of_one_bv_gives_another_test(swerve: Experiment, driver: ScriptDriver) -> None:
    """Negative control of the digest above."""
    for scenario, script in crashes(swerve, driver, 5):
        action = script.action.copy()
        action[0, -1] = 2 if action[0, -1] != 2 else 3
        again, _ = driver.record(replace(script, action=action))
        assert scenario_digest(again) != scenario_digest(scenario)


@pytest.mark.parametrize("name", ["swerve", "learned AV"])
def test_a_later_start_is_the_rest_of_the_drive(name: str) -> None:
    run = experiment(**RUNS[name])  # type: ignore[arg-type]
    driver = ScriptDriver(run.setting, run.odd)
    for scenario, script in crashes(run, driver, 5):
        assert driver.later(script, 0) is script
        for k in range(1, len(script.action)):
            later = driver.later(script, k)
            assert later is not None
            rest, _ = driver.record(later)
            there = scenario.present[10 * k]
            for series in ("x", "y", "speed", "heading", "acceleration", "target_lane", "present"):
                np.testing.assert_array_equal(getattr(rest, series), getattr(scenario, series)[10 * k :, there])
            assert rest.crash is not None
            assert scenario.crash is not None
            expected = Crash(round(scenario.crash.time - k, 1), 0, scenario.crash.slot_b)
            assert rest.crash == expected


def test_a_drive_and_its_recording_end_alike(swerve: Experiment, driver: ScriptDriver) -> None:
    for scenario, script in crashes(swerve, driver, 10):
        assert scenario.crash is not None
        ending = driver.drive(script)
        last = [getattr(scenario, series)[-1] for series in ("x", "y", "speed", "heading")]
        assert ending.pose is not None
        np.testing.assert_array_equal(ending.pose, np.stack(last, axis=1)[[0, scenario.crash.slot_b]])
        assert (ending.partner, ending.frame) == (scenario.crash.slot_b, round(10 * scenario.crash.time))


def test_chances_are_probabilities_and_natural_is_the_likeliest(swerve: Experiment, driver: ScriptDriver) -> None:
    for scenario, script in crashes(swerve, driver, 5):
        again, chances = driver.record(script)
        bvs = scenario.present[::10][: len(scenario.action)].copy()
        bvs[:, 0] = False
        np.testing.assert_allclose(chances[: len(bvs)][bvs].sum(axis=1), 1.0, atol=1e-12)
        assert np.isnan(chances[:, 0]).all()
        k = np.arange(len(scenario.action))
        p = chances[k, scenario.critical_bv, scenario.action[k, scenario.critical_bv]]
        with np.errstate(divide="ignore"):
            np.testing.assert_allclose(np.log(p), again.log_prob_nde, rtol=1e-12)
        free = replace(script, action=np.full_like(script.action, NATURAL))
        driven, chances = driver.record(free)
        decided = driven.action >= 0
        assert (driven.action[decided] == np.nan_to_num(chances).argmax(axis=2)[: len(decided)][decided]).all()
        named, _ = driver.record(replace(script, action=driven.action))
        assert scenario_digest(named) == scenario_digest(driven)


def test_a_natural_av_drives_like_a_bv_in_its_place(driver: ScriptDriver) -> None:
    """The same pair, once with the AV behind, once with a BV behind; that AV is out of sight."""
    as_av = natural(start_of((300.0, 1, 30.0), (340.0, 1, 22.0)), 6)
    as_bv = natural(start_of((10.0, 0, 0.0), (300.0, 1, 30.0), (340.0, 1, 22.0)), 6)
    first, _ = driver.record(as_av, av_is_natural=True)
    second, _ = driver.record(as_bv)
    np.testing.assert_allclose(first.x, second.x[:, 1:], atol=1e-9)  # sums of another number of steps
    np.testing.assert_allclose(first.speed[::10], second.speed[::10, 1:], atol=1e-9)
    assert (first.acceleration[10:, 0] < 0.0).any()
    itself, _ = driver.record(as_av)
    assert not np.isin(np.round(itself.acceleration[:, 0], 6), ACCELERATIONS).all(), "the AV's own law has no steps"


def test_bvs_that_crash_are_taken_off_the_road(driver: ScriptDriver) -> None:
    start = start_of((240.0, 0, 30.0), (300.0, 2, 40.0), (312.0, 2, 5.0))
    script = replace(natural(start, 3), action=np.full((3, 3), 22, dtype=np.int8))
    assert driver.drive(script).bv_crashes == 1
    later = driver.later(script, 2)
    assert later is not None
    assert later.slot.tolist() == [0]
    assert later.action.shape == (1, 1)
    # where one of the two is missing, the other goes on naturally after what is told
    scenario, _ = driver.record(script)
    assert scenario.action[:, 2].tolist() == [22, NATURAL, NATURAL]
    alone = Script(script.slot, start, scenario.action).of(np.array([True, True, False]))
    assert driver.record(alone)[0].present.all()


def test_there_is_no_later_start_after_the_end(swerve: Experiment, driver: ScriptDriver) -> None:
    _, script = crashes(swerve, driver, 1)[0]
    longer = replace(script, action=np.vstack([script.action, script.action]))
    assert driver.later(longer, len(script.action)) is None


def test_a_start_says_everything_about_a_vehicle() -> None:
    following = {"x_held", "speed_held", "present", "action", "commanded", "acceleration_held"}
    assert set(START_FIELDS) | following == set(VEHICLE.names or ())
    start = start_of((240.0, 1, 30.0))
    assert (start["x_held"], start["speed_held"], start["present"], start["action"]) == (240.0, 30.0, 1, -1)


def test_what_is_no_script_is_refused(driver: ScriptDriver) -> None:
    start = start_of((240.0, 1, 30.0), (300.0, 1, 30.0))
    good = natural(start, 2)
    wrong = [
        ({"slot": np.array([1, 2], dtype=np.int16)}, "ascend from 0"),
        ({"slot": np.array([0, 0], dtype=np.int16)}, "ascend from 0"),
        ({"start": start[:1]}, "start has shape"),
        ({"start": np.zeros((2, 3))}, "start has shape"),
        ({"action": np.zeros((0, 2), dtype=np.int8)}, "at least one decision"),
        ({"action": np.zeros((2, 3), dtype=np.int8)}, "action has shape"),
        ({"action": np.full((2, 2), 33, dtype=np.int8)}, "from 33 to 33"),
    ]
    for change, message in wrong:
        with pytest.raises(InputError, match=message):
            replace(good, **change)  # type: ignore[arg-type]
    for fields in (np.zeros((2, 3)), np.full((1, len(START_FIELDS)), np.nan)):
        with pytest.raises(InputError, match="A start is finite numbers"):
            scripted_start(fields)
    with pytest.raises(InputError, match="decisions of a script"):
        driver.drive(natural(start, 100))
    with pytest.raises(InputError, match="vehicles of a script"):
        driver.drive(natural(start_of(*((10.0 * k, 0, 30.0) for k in range(100))), 1))


@pytest.mark.parametrize(
    ("odd", "kind", "size", "message"),
    [
        ("default", TRUCK, (16.5, 2.55), "Vehicle 1 .* 16.5 m long and 2.55 m wide; allowed in ODD default: 5 x 2 m."),
        ("default", CAR, (4.5, 2.0), "4.5 m long"),
        ("mixed", CAR, (18.0, 2.55), "18 m long"),
        ("mixed", TRUCK, (16.5, 2.55), None),
        ("mixed", MOTORCYCLE, (2.2, 0.8), None),
    ],
)
def test_only_sizes_of_the_odd_are_driven(odd: str, kind: int, size: tuple[float, float], message: str | None) -> None:
    """Contacts know the ODD's sizes only: a truck in an ODD of cars was a car when it touched another vehicle."""
    run = experiment(odd=odd)
    driver = ScriptDriver(run.setting, run.odd)
    start = start_of((100.0, 1, 30.0), (109.0, 1, 30.0))  # a car's bumper is 4 m ahead, a truck's overlaps
    start["kind"][1], start["length"][1], start["width"][1] = kind, *size
    script = natural(start, 1)
    if message is None:
        assert (driver.drive(script).partner == 1) == (kind == TRUCK)
        return
    for attempt in (lambda: driver.drive(script), lambda: driver.record(script)):
        with pytest.raises(InputError, match=message):
            attempt()
    with pytest.raises(InputError, match=message):
        driver.later(replace(script, action=np.vstack([script.action, script.action])), 1)


@pytest.mark.parametrize("action", [NATURAL, 0, 17])
def test_an_av_goes_on_where_a_script_hides_who_is_ahead(action: int) -> None:
    """A slower BV ahead is unseen for a second, whatever it does itself: the AV goes on, where it brakes else."""
    odd = replace(Odd(lane_width=4.0), perception=Perception(latency=0.1))
    run = experiment(road=odd)
    driver = ScriptDriver(run.setting, odd)
    script = natural(start_of((200.0, 1, 30.0), (240.0, 1, 20.0)), 3)
    script = replace(script, action=np.where(np.arange(3)[:, None] == 0, np.int8(action), script.action))
    seen, hidden = (driver.record(replace(script, hidden=np.array(slots, dtype=np.int16)))[0] for slots in ([], [1]))
    assert seen.acceleration[8, 0] < -1.0
    assert hidden.acceleration[8, 0] > seen.acceleration[8, 0] + 1.0
    np.testing.assert_array_equal(seen.action[0], hidden.action[0])
