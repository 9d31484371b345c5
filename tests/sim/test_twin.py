"""The compiled simulator equals the slow plain-Python one bit for bit, on random roads, drivers and adversaries."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hand_built import setting_of
from reference.drivers import AvDriver
from reference.simulator import AV_CRASH, BV_CRASH, COMPLETED, TIME_UP, Drive, Simulator

from cornerforge.drivers.avs import AvModel, av_named
from cornerforge.drivers.sight import Sight
from cornerforge.ndd.model import NddModel
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.setting import Setting
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import allocate_worlds, n_slots, world_of
from cornerforge.types import ODDS, Odd, Scenario

QUICK, MINDFUL, SLOW = 72, 24, 1500
ADVERSARIES = [None, "uniform", "lane-changer", "swerve"]


@dataclass(frozen=True)
class Case:
    """A random run; the number decides everything."""

    number: int
    odd: Odd
    av: AvModel
    adversary: str | None
    bounded: bool
    idm_bvs: bool
    reckless: bool
    budget: float | None
    excess: bool
    steers_from: int

    @property
    def test(self) -> int:
        return self.number * 7_919

    def setting(self, model: NddModel) -> Setting:
        return setting_of(
            model,
            self.odd,
            av=self.av,
            adversary=self.adversary,
            bounded=self.bounded,
            idm_bvs=self.idm_bvs,
            budget=self.budget,
        ).with_drivers(excess=int(self.excess), steers_from=self.steers_from)


def sight_of(number: int, *, by_motion: bool) -> Sight:
    """What an AV sees: motion, from random offsets and at once or later, or decisions, or centres."""
    rng = np.random.default_rng([number, 2])
    if not by_motion:
        return Sight(str(rng.choice(["decision", "centre"])))
    return Sight(offset=float(rng.choice([0.1, 0.375, 0.8])), perception_time=float(rng.choice([0.0, 0.4])))


def case(number: int) -> Case:
    """Every fourth case is natural driving; roads, lanes, AVs and models vary at random beside it."""
    rng = np.random.default_rng(number)
    odd = replace(ODDS[rng.choice(sorted(ODDS))], n_lanes=int(rng.integers(2, 7)))
    if rng.random() < 0.4:
        odd = replace(
            odd,
            lane_width=round(rng.uniform(3.0, 4.5), 2),
            vehicle_length=round(rng.uniform(3.0, 7.0), 2),
            vehicle_width=round(rng.uniform(1.5, 2.2), 2),
            lane_change_duration=round(rng.uniform(1.0, 6.0), 2),
            max_lateral_acceleration=round(rng.uniform(2.0, 8.0), 2),
            av_substeps=int(rng.choice([1, 2, 3, 5, 10])),
            time_limit=round(rng.uniform(3.0, 30.0), 1),
            max_speed=round(rng.uniform(30.0, 45.0), 1),
        )
    if number % 3 == 0:
        odd = replace(odd, truck_share=0.3, motorcycle_share=0.2)
    av = av_named(rng.choice(["idm-mobil", "idm-mobil-d2rl"]))
    av = replace(
        av,
        sight=sight_of(number, by_motion=rng.random() < 0.6),
        mobil=replace(av.mobil, politeness=float(rng.choice([0.0, 0.5]))),
    )
    # A draw of its own, so that the other choices are those of the time when all AVs were plain.
    av = replace(av, kind=str(np.random.default_rng([number, 1]).choice(["plain", "plain", "watchful", "cautious"])))
    if av.kind == "cautious" and number % 2 == 1:  # behind a lead that brakes less than it, distances are another case
        av = replace(av, rss=replace(av.rss, lead_braking=3.0))
    adversary = ADVERSARIES[number % 4]
    later = np.random.default_rng([number, 3])
    return Case(
        number,
        odd,
        av,
        adversary,
        bounded=bool(rng.random() < 0.4),
        idm_bvs=bool(rng.random() < 0.15),
        reckless=bool(rng.random() < 0.5),
        budget=float(rng.choice([1.0, 4.0, 12.0])) if rng.random() < 0.5 else None,
        excess=bool(later.random() < 0.5),
        steers_from=int(later.choice([0, 0, 1, 4])),
    )


def driver_of(av: AvModel) -> AvDriver:
    """The same AV for the slow simulator."""
    return AvDriver(av.idm, av.mobil, av.sight, av.kind, av.rss)


def column(drive: Drive, name: str) -> np.ndarray:
    """(T, N) of one attribute; NaN where absent."""
    return np.array([[getattr(v, name) if v.present else math.nan for v in frame] for frame in drive.frames])


def assert_same(drive: Drive, scenario: Scenario) -> None:
    """Every recorded number, exactly; the log-probability to rounding, its -inf exactly."""
    assert scenario.x.shape == (len(drive.frames), len(drive.frames[0]))
    np.testing.assert_array_equal(scenario.slot, [vehicle.slot for vehicle in drive.frames[0]])
    present = np.array([[vehicle.present for vehicle in frame] for frame in drive.frames])
    np.testing.assert_array_equal(scenario.present, present)
    for name in ("x", "y", "speed", "heading", "acceleration"):
        np.testing.assert_array_equal(getattr(scenario, name), column(drive, name), err_msg=name)
    np.testing.assert_array_equal(scenario.target_lane, np.nan_to_num(column(drive, "target_lane"), nan=-1))
    actions = [[chosen.get(slot, -1) for slot in scenario.slot] for chosen in drive.actions]
    np.testing.assert_array_equal(scenario.action, actions)
    np.testing.assert_array_equal(scenario.critical_bv, drive.critical)
    # probabilities are differences of sums up to 1, so good to some 1e-16
    np.testing.assert_array_equal(np.isinf(scenario.log_prob_nde), np.array(drive.probability) == 0.0)
    np.testing.assert_allclose(np.exp(scenario.log_prob_nde), drive.probability, rtol=1e-9, atol=1e-15)
    crash = scenario.crash
    assert (crash is not None) == (drive.outcome in (AV_CRASH, BV_CRASH))
    if crash is not None:
        assert (crash.slot_a, crash.slot_b) == drive.contact
        assert crash.time == pytest.approx((len(drive.frames) - 1) / 10.0)


def assert_same_drivers(case: Case, setting: Setting, drive: Drive) -> None:
    """Compare what stays with the drivers, which no recording holds: exactly, at the start of a test."""
    world = world_of(allocate_worlds(1, n_slots(case.odd)))
    reset_world(world, case.number, case.test, setting)
    for name in ("quantile", "habit", "desired_speed", "noise", "inattention", "length", "width", "kind"):
        traits = [getattr(vehicle, name) for vehicle in drive.start]
        np.testing.assert_array_equal(world.vehicles[name][: len(traits)], traits, err_msg=name)


def compare(case: Case, model: NddModel) -> Drive:
    """Drive one test with both simulators; also through the bulk path that keeps only outcomes."""
    av = driver_of(case.av)
    budget = case.budget if case.bounded else None
    told = case.adversary, case.bounded, case.idm_bvs, budget, case.excess, case.steers_from
    simulator = Simulator(case.odd, model, av, *told)
    drive = simulator.drive(case.number, case.test)
    setting = case.setting(model)
    assert_same_drivers(case, setting, drive)
    assert_same(drive, Recorder(setting, case.odd).record(case.number, case.test))
    out, _ = drive_chunk(setting, n_slots(case.odd), case.number, case.test, 1, False)
    assert (out.code[0], out.frame[0], out.bv_crashes[0]) == (
        drive.outcome,
        len(drive.frames) - 1,
        drive.bv_crashes,
    )
    assert (out.slot_a[0], out.slot_b[0]) == drive.contact
    assert out.decisions[0] == len(drive.actions)
    assert out.distance[0] == drive.frames[-1][0].x - case.odd.av_start
    return drive


@pytest.mark.sampled(9)
@pytest.mark.parametrize("number", range(QUICK))
def test_equal_bit_for_bit(number: int, model: NddModel, reckless: NddModel) -> None:
    chosen = case(number)
    compare(chosen, reckless if chosen.reckless else model)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("number", range(MINDFUL))
def test_equal_bit_for_bit_with_habits_and_few_cars(number: int, mindful: NddModel) -> None:
    chosen = case(number)
    compare(replace(chosen, odd=replace(chosen.odd, truck_share=0.3, motorcycle_share=0.2)), mindful)


@pytest.mark.slow
def test_equal_bit_for_bit_on_many(model: NddModel, reckless: NddModel, seed: int) -> None:
    outcomes: Counter[int] = Counter()
    bv_crashes = 0
    for number in range(seed, seed + SLOW):
        chosen = case(number)
        drive = compare(chosen, reckless if chosen.reckless else model)
        outcomes[drive.outcome] += 1
        bv_crashes += drive.bv_crashes
    assert min(outcomes[code] for code in (COMPLETED, AV_CRASH, BV_CRASH, TIME_UP)) >= 20
    assert bv_crashes >= 50


def test_the_cases_are_worth_comparing(model: NddModel, reckless: NddModel) -> None:
    # Every outcome, every lane count, removed vehicles and aborted lane changes occur among the quick cases.
    outcomes: Counter[int] = Counter()
    removed = returned = impossible = 0
    for chosen in map(case, range(QUICK)):
        setting = chosen.setting(reckless if chosen.reckless else model)
        scenario = Recorder(setting, chosen.odd).record(chosen.number, chosen.test)
        out, _ = drive_chunk(setting, n_slots(chosen.odd), chosen.number, chosen.test, 1, False)
        outcomes[int(out.code[0])] += 1
        removed += int(scenario.present[0].sum() - scenario.present[-1].sum())
        changed = np.diff(scenario.target_lane.astype(int), axis=0)
        both = scenario.present[1:] & scenario.present[:-1]
        returned += int((((changed > 0) & both).any(axis=0) & ((changed < 0) & both).any(axis=0)).sum())
        impossible += int(np.isneginf(scenario.log_prob_nde).sum())
    assert {case(number).odd.n_lanes for number in range(QUICK)} == {2, 3, 4, 5, 6}
    assert min(outcomes[code] for code in (COMPLETED, AV_CRASH, BV_CRASH, TIME_UP)) >= 2
    assert removed >= 4
    assert returned >= 4
    assert impossible >= 4


def test_the_comparison_sees_the_last_bit(model: NddModel) -> None:
    # negative control
    chosen = case(0)
    av = driver_of(chosen.av)
    drive = Simulator(chosen.odd, model, av).drive(0, 0)
    scenario = Recorder(setting_of(model, chosen.odd, av=chosen.av), chosen.odd).record(0, 0)
    assert_same(drive, scenario)
    last = drive.frames[-1][0]
    last.x = math.nextafter(last.x, math.inf)
    with pytest.raises(AssertionError):
        assert_same(drive, scenario)
