"""World as its AV perceives it, held against recordings, shapes and counts."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hand_built import WIDE, Car, setting_of
from hand_built import world_of as world_by_hand
from numpy.typing import NDArray

from cornerforge.drivers.policy import NO_POLICY
from cornerforge.intervals import binomial_interval
from cornerforge.ndd.model import NddModel
from cornerforge.perception import Perception
from cornerforge.road.straight import road_numbers
from cornerforge.sim import (
    Recorder,
    advance,
    allocate_recording,
    copy_of,
    keep_nothing,
    packed,
    perceived,
    reset_world,
    unpacked,
)
from cornerforge.sim.controllers import OUTSIDE
from cornerforge.sim.lockstep import allocate_batch, begin, see
from cornerforge.sim.loop import AV_MUST_ANSWER, NEVER, OVER, answer_as_av
from cornerforge.sim.neighbours import SIGHT
from cornerforge.sim.perception import MOST_HIDDEN, show_as_seen
from cornerforge.sim.runner import simulate
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import allocate_worlds, n_slots, world_of
from cornerforge.types import Odd, Scenario

SEED = 11


def seen_as(perception: Perception | None) -> Odd:
    return replace(Odd(), perception=perception)


def recorded(model: NddModel, perception: Perception, test: int = 0) -> tuple[Scenario, NDArray[np.float64]]:
    odd = seen_as(perception)
    scenario = Recorder(setting_of(model, odd), odd).record(SEED, test)
    return scenario, perceived(scenario)


def in_sight(scenario: Scenario) -> NDArray[np.bool_]:
    """Vehicles that are within the range of sight at all, (T, N)."""
    return np.asarray(np.hypot(scenario.x - scenario.x[:, :1], scenario.y - scenario.y[:, :1]) <= SIGHT)


def test_late_is_where_a_vehicle_was_carried_on_at_its_speed_of_then(model: NddModel) -> None:
    scenario, seen = recorded(model, Perception(latency=0.5))
    x, y, speed = scenario.x, scenario.y, scenario.speed
    across = speed * np.tan(scenario.heading)
    assert np.abs(across).max() > 0.5  # one of them changes lanes
    near = in_sight(scenario)
    near[:, 0] = False
    assert near.sum() > 1000
    for frame in range(len(x)):
        then, late = max(0, frame - 5), 0.1 * min(frame, 5)  # it has looked since the start only
        of = near[frame]
        assert (np.isfinite(seen[frame, 1:, 0]) == of[1:]).all()
        np.testing.assert_allclose(seen[frame, of, 0], (x + late * speed)[then, of], atol=1e-9)
        np.testing.assert_allclose(seen[frame, of, 1], (y + late * across)[then, of], atol=1e-9)
    np.testing.assert_allclose(seen[:, 0, 0], x[:, 0], atol=1e-9)  # its own place it knows


def test_range_ends_where_it_says(model: NddModel) -> None:
    scenario, seen = recorded(model, Perception(range=60.0))
    away = np.hypot(scenario.x - scenario.x[:, :1], scenario.y - scenario.y[:, :1])
    assert (np.isnan(seen[:, :, 0]) == (away > 60.0)).all()
    assert 0 < np.isnan(seen[:, :, 0]).sum() < away.size


def test_losses_are_as_many_as_said_and_last_a_second(model: NddModel) -> None:
    lost = seconds = 0
    for test in range(12):
        scenario, seen = recorded(model, Perception(dropout=0.1), test)
        whole = len(scenario.x) // 10 * 10
        gone, near = (a[:whole, 1:].reshape(-1, 10, scenario.slot.size - 1)
                      for a in (np.isnan(seen[:, :, 0]), in_sight(scenario)))  # fmt: skip
        gone = gone.transpose(0, 2, 1)[near.all(axis=1)]
        assert (gone == gone[:, :1]).all()
        lost, seconds = lost + int(gone[:, 0].sum()), seconds + len(gone)
    low, high = binomial_interval(lost, seconds, 0.999)
    assert low < 0.1 < high


def test_noise_has_the_deviation_said_and_no_jumps(model: NddModel) -> None:
    off: list[NDArray[np.float64]] = []
    steps: list[NDArray[np.float64]] = []
    for test in range(20):
        scenario, seen = recorded(model, Perception(noise=0.6), test)
        error = (seen - np.stack([scenario.x, scenario.y], axis=2))[:, 1:]
        off.append(error[::10].reshape(-1, 2))  # independent from second to second
        steps.append(np.diff(error, axis=0).reshape(-1, 2))
    errors = np.concatenate(off)
    errors = errors[np.isfinite(errors[:, 0])]
    n = len(errors)
    for axis, sigma in ((0, 0.6), (1, 0.2)):
        assert abs(errors[:, axis].std() / sigma - 1.0) < 4.0 / math.sqrt(2 * n)
        assert abs(errors[:, axis].mean()) < 4.0 * sigma / math.sqrt(n)
    assert np.nanmax(np.abs(np.concatenate(steps)[:, 0])) < 0.6 * 0.1 * 10  # of ten deviations a second


def free_share(cars: list[Car], target: int, rays: int = 40) -> float:
    """How much of a car is free to the AV's middle: rays to all of its outline are walked along; nearer ones hide."""
    middles = np.array([(car.x, 4.0 * car.lane + 2.0) for car in cars])
    away = np.hypot(*(middles - middles[0]).T)
    nearer = middles[(away < away[target]) & (away > 0.0)]
    edge = np.linspace(-1.0, 1.0, rays)
    sides = [(2.5 * edge, np.full(rays, s)) for s in (-1.0, 1.0)] + [
        (np.full(rays, 2.5 * s), edge) for s in (-1.0, 1.0)
    ]
    ends = np.concatenate([np.stack(side, axis=1) for side in sides]) + middles[target]
    walked = middles[0] + np.linspace(0.0, 1.0, 700)[:, None, None] * (ends - middles[0])
    inside = np.zeros(len(ends), dtype=bool)
    for middle in nearer:
        inside |= (np.abs(walked - middle) < (2.5, 1.0)).all(axis=2).any(axis=0)
    return float(1.0 - inside.mean())


def test_what_others_hide_wholly_is_not_seen_along_rays() -> None:
    random = np.random.default_rng(3)
    odd = replace(WIDE, perception=Perception(occlusion=True))
    hidden = shown = 0
    for _ in range(20):
        cars = [Car(0.0, 1, 30.0)] + [
            Car(float(x), int(lane), 30.0) for lane in range(3) for x in np.cumsum(random.uniform(9, 40, 4)) - 40
        ]
        cars = [car for k, car in enumerate(cars) if k == 0 or abs(car.x) > 6.0 or car.lane != 1]
        world = world_by_hand(cars)
        show_as_seen(world, 0, road_numbers(odd), allocate_scratch(len(cars), NO_POLICY).av)
        for k in range(1, len(cars)):
            free = free_share(cars, k)
            if free == 0.0:
                assert not world.vehicles["present"][k]
                hidden += 1
            elif free > 0.1:  # five rays may miss a sliver
                assert world.vehicles["present"][k]
                shown += 1
    assert hidden > 15
    assert shown > 60


@pytest.mark.parametrize("perception", [Perception(latency=0.5), Perception(latency=0.3, dropout=0.05, noise=0.5)])
def test_a_world_cut_anywhere_goes_on_as_the_uncut_one(model: NddModel, perception: Perception) -> None:
    odd = seen_as(perception)
    setting, slots = setting_of(model, odd), n_slots(odd)
    scratch, keep = allocate_scratch(slots, NO_POLICY), keep_nothing(slots)
    for test in range(6):
        whole, cut = (world_of(allocate_worlds(1, slots, setting.road)) for _ in range(2))
        reset_world(whole, SEED, test, setting)
        reset_world(cut, SEED, test, setting)
        advance(whole, setting, scratch, keep, NEVER)
        advance(cut, setting, scratch, keep, 3 + test)
        again = unpacked(packed(copy_of(cut)), setting)
        assert advance(again, setting, scratch, keep, NEVER) == OVER
        for name, array in whole.arrays().items():
            np.testing.assert_array_equal(array, again.arrays()[name], err_msg=name)


def test_without_room_for_what_was_it_is_an_error_not_an_early_look(model: NddModel) -> None:
    odd = seen_as(Perception(latency=0.5))
    with pytest.raises(RuntimeError, match="room"):
        reset_world(world_of(allocate_worlds(1, n_slots(odd))), SEED, 0, setting_of(model, odd))


def test_an_av_from_outside_sees_what_a_recording_says(model: NddModel) -> None:
    """The view's place ahead and aside, at each tenth, against `perceived` of the same test."""
    perception = Perception(latency=0.2, range=90.0, dropout=0.1, noise=0.4, occlusion=True)
    odd = seen_as(perception)
    setting = setting_of(model, odd).with_drivers(av=OUTSIDE)
    slots = n_slots(odd)
    batch = allocate_batch(1, slots, np.zeros((1, slots, 18)), setting.road)  # scenes
    begin(SEED, np.zeros(1, np.int64), np.array([4]), setting, batch)
    scratch, keep = allocate_scratch(slots, NO_POLICY), keep_nothing(slots)
    world = world_of(batch.worlds)
    told = []
    keep = keep._replace(recording=allocate_recording(601, slots))
    while True:
        reason = advance(world, setting, scratch, keep, NEVER)
        if reason == OVER:
            break
        assert reason == AV_MUST_ANSWER
        see(batch, setting, scratch)
        told.append(batch.views[0].copy())
        answer_as_av(world, 0.0, int(world.vehicles["target_lane"][0]))
    frames = keep.recording[: len(told)]
    there = frames["present"].astype(bool)
    columns: dict[str, Any] = {
        name: np.where(there, frames[name], np.nan) for name in ("x", "y", "speed", "heading", "acceleration")
    }
    scenario = Scenario(
        seed=SEED, test=4, odd=odd, slot=np.arange(slots, dtype=np.int16), present=there, **columns,
        target_lane=frames["target_lane"].astype(np.int8), action=np.zeros((1, slots), np.int8),
        critical_bv=np.full(1, -1, np.int16), log_prob_nde=np.zeros(1), crash=None,
    )  # fmt: skip
    seen = perceived(scenario)
    start = frames["x"][0, 0]
    for frame, view in enumerate(told):
        rows = view[1:][view[1:, 0] > 0]
        near = np.abs(seen[frame, :, 0] - scenario.x[frame, 0]) < SIGHT
        assert set(rows[:, 0].astype(int)) == set(np.flatnonzero(near)) - {0}
        for row in rows:
            np.testing.assert_allclose(row[4:6] + np.array([start, 0.0]), seen[frame, int(row[0])], atol=1e-6)


@pytest.mark.parametrize("perception", [Perception(latency=1.0), Perception(dropout=0.2, noise=1.0, occlusion=True)])
def test_threads_change_nothing_and_perception_does(model: NddModel, perception: Perception) -> None:
    odd = seen_as(perception)
    one, two = (simulate(setting_of(model, odd), n_slots(odd), seed=SEED, tests=600, threads=k) for k in (1, 2))
    perfect = simulate(setting_of(model, Odd()), n_slots(Odd()), seed=SEED, tests=600)
    assert one.digest.hexdigest() == two.digest.hexdigest() != perfect.digest.hexdigest()


def test_an_adversary_pays_for_what_it_makes_the_av_lose(model: NddModel) -> None:
    odd = seen_as(Perception(dropout=0.01))
    setting = setting_of(model, odd, adversary="swerve", bounded=True, budget=12.0)
    recorder, price = Recorder(setting, odd), math.log(0.99 / 0.01)
    without = Recorder(setting_of(model, Odd(), adversary="swerve", bounded=True, budget=12.0), Odd())
    most = 0
    for test in range(200):
        scenario = recorder.record(SEED, test)
        assert scenario.shortfall is not None
        assert scenario.shortfall.sum() < 12.0 + 1e-5 * len(scenario.shortfall)
        seconds = [k for k in range(MOST_HIDDEN) if scenario.hidden >> k & 1]
        most = max(most, len(seconds))
        assert all(scenario.shortfall[k] > price - 1e-6 for k in seconds)
        assert all(scenario.log_prob_nde[k] <= math.log(0.01) for k in seconds)
        seen = perceived(scenario)
        for k in seconds:
            gone = seen[10 * k + 1 : 10 * k + 11, scenario.critical_bv[k], 0]
            assert np.isnan(gone).all()
            assert gone.size
        assert without.record(SEED, test).hidden == 0
    assert most == 2  # 12 nats buy two losses of 4.6
