"""Traffic that stops: following at all speeds, hard braking, queues (docs/adr/0078-traffic-that-stops.md)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import Car, setting_of
from hand_built import world_of as hand_built_world
from numpy.typing import NDArray

from cornerforge.drivers.policy import NO_POLICY
from cornerforge.errors import InputError
from cornerforge.experiment.setting import experiment
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import road_numbers
from cornerforge.sim.braking import acceleration_of, braking_within, looks_away_chance, safely_behind
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.loop import advance
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.traffic import reset_world
from cornerforge.sim.world import allocate_worlds, n_slots, world_of
from cornerforge.types import ACCELERATIONS, FIRST_ACCELERATION, QUEUE_FROM, QUEUE_TO, Odd

DENSE, QUEUE = Odd(traffic="dense"), Odd(traffic="queue")


def pairs(odd: Odd, model: NddModel, tests: int, seconds: range) -> NDArray[np.float64]:
    """Speed, gap, and speed of the lead, of followers that keep their lane: rows of (speed, gap, lead's speed)."""
    setting, slots = setting_of(model, odd), n_slots(odd)
    world, scratch, keep = world_of(allocate_worlds(1, slots)), allocate_scratch(slots, NO_POLICY), keep_nothing(slots)
    rows = []
    for test in range(tests):
        reset_world(world, 9, test, setting)
        for second in seconds:
            advance(world, setting, scratch, keep, second)
            v = world.vehicles[: int(world.state["n_vehicles"][0])]
            v = v[(v["present"] == 1) & (v["duration"] == 0.0)]
            for lane in range(odd.n_lanes):
                one = np.sort(v[v["target_lane"] == lane], order="x")
                gap = np.diff(one["x"]) - 0.5 * (one["length"][1:] + one["length"][:-1])
                rows.append(np.stack([one["speed"][:-1], gap, one["speed"][1:]], axis=1))
    return np.concatenate(rows)


@pytest.mark.parametrize(
    ("low", "high", "recorded"),
    [(0.0, 0.3, (2.22, 3.02, 4.09)), (3.0, 8.0, (7.30, 10.05, 13.88))],
)
def test_a_queue_stands_and_crawls_as_densely_as_on_i80(
    model: NddModel, low: float, high: float, recorded: tuple[float, float, float]
) -> None:
    # I-80's congested pairs, quartiles of the gap [m] (9,881 and 123,546 states). They were not used for the limits
    # that keep vehicles apart. The pairs have a mean gap below 50 m, so gaps above that are left out here too.
    found = pairs(QUEUE, model, 60, range(15, 45, 3))
    at = found[(found[:, 0] >= low) & (found[:, 0] < high) & (found[:, 1] < 50.0)]
    assert len(at) > 1000
    np.testing.assert_allclose(np.percentile(at[:, 1], [25, 50, 75]), recorded, rtol=0.35)


def test_dense_traffic_keeps_its_speed_and_gaps(model: NddModel) -> None:
    # US-101: 5, 50, 95 % of speeds 2.9, 13.7, 18.3 m/s; time gaps at 12 to 16 m/s 0.61, 1.37, 3.44 s (1,016 states),
    # HOV lane of I-80 0.80, 1.73, 3.87 s (19,419).
    found = pairs(DENSE, model, 60, range(5, 26, 5))
    assert np.median(found[:, 0]) == pytest.approx(13.7, abs=3.0)
    at = found[(found[:, 0] > 12.0) & (found[:, 0] < 16.0)]
    low, middle, high = np.percentile(at[:, 1] / at[:, 0], [5, 50, 95])
    assert 0.5 < low < 0.9
    assert 1.2 < middle < 1.9
    assert 3.0 < high < 5.5


def test_a_queue_begins_ahead_and_all_can_stop_for_it(model: NddModel) -> None:
    setting, slots = setting_of(model, QUEUE), n_slots(QUEUE)
    world = world_of(allocate_worlds(1, slots))
    depths = []
    for test in range(50):
        reset_world(world, 2, test, setting)
        v = world.vehicles[: int(world.state["n_vehicles"][0])]
        assert len(v) < slots  # none was left out for want of a slot
        x, speed = v["x"] - QUEUE.av_start, v["speed"]
        crawls = v["desired_speed"] < 9.0
        crawls[0] = False
        assert (x[crawls] > QUEUE_FROM).all()
        assert (crawls | (x < QUEUE_TO)).all()
        assert speed[crawls].max() <= 8.0
        end = x[crawls].min()
        ahead = np.maximum(end - x[~crawls], 0.0)
        assert (speed[~crawls] ** 2 <= speed[crawls].max() ** 2 + 2.0 * 1.5 * (ahead + 10.0)).all()
        depths.append(crawls.sum())
    assert np.mean(depths) > 9


def test_safely_behind_leaves_room_to_stop() -> None:
    # Driven out: the lead brakes by 6 m/s2 after this second, the follower by 8 half a second later.
    rng = np.random.default_rng(3)
    bound = 0
    for _ in range(300):
        speed, other, gap = rng.uniform(0, 35), rng.uniform(0, 35), rng.uniform(1, 60)
        world = hand_built_world([Car(0.0, 1, speed), Car(gap + 5.0, 1, other)])
        safe = float(safely_behind(world.vehicles, 0, 1, road_numbers(QUEUE)))
        if safe < -speed + 0.1 or safe > 2.0:
            continue
        bound += 1
        steps = 1000
        lead = np.maximum(other - 6.0 * np.maximum(np.arange(12 * steps) / steps - 1.0, 0.0), 0.0)
        t = np.arange(12 * steps) / steps
        own = np.where(t < 1.0, speed + safe * t, speed + safe - 8.0 * np.maximum(t - 1.5, 0.0))
        left = gap + np.cumsum(lead - np.maximum(own, 0.0)) / steps
        assert left[-1] == pytest.approx(0.5, abs=0.05)
    assert bound > 50


def test_the_hardest_action_brakes_as_hard_as_it_takes(model: NddModel) -> None:
    for odd, gap, least, most in ((QUEUE, 40.0, 5.0, 5.3), (QUEUE, 10.0, 8.0, 8.0), (QUEUE, 200.0, 4.0, 4.0),
                                  (Odd(), 10.0, 4.0, 4.0)):  # fmt: skip
        world = hand_built_world([Car(500.0, 2, 0.0), Car(0.0, 1, 20.0), Car(gap + 5.0, 1, 0.0)])
        braking = -acceleration_of(world, 1, FIRST_ACCELERATION, ACCELERATIONS, setting_of(model, odd).road)
        assert least <= braking <= most


def test_a_driver_that_brakes_does_not_begin_to_look_away(model: NddModel) -> None:
    road, memory = setting_of(model, QUEUE).road, setting_of(model, QUEUE).tables.memory
    world = hand_built_world([Car(0.0, 1, 20.0), Car(40.0, 1, 20.0)])
    v = world.vehicles
    assert looks_away_chance(v, 1, road, memory) > 0.0
    v["commanded"][1] = -2.0
    assert looks_away_chance(v, 1, road, memory) == 0.0
    v["away"][1] = 1
    assert looks_away_chance(v, 1, road, memory) == memory.away_again


def test_drivers_wait_to_brake_and_then_stop_in_time() -> None:
    speed, room = 25.0, 180.0
    while speed > 0.1:
        braking = float(braking_within(speed, room, 2.5))
        assert braking <= 3.0 or room < 1.0
        room -= max(speed - 0.5 * braking, 0.5 * speed)
        speed = max(speed - braking, 0.0)
    assert -0.5 < room < 3.0


def test_free_traffic_does_not_change(model: NddModel) -> None:
    assert setting_of(model, Odd()).tables.p.shape[0] < setting_of(model, QUEUE).tables.p.shape[0]
    assert not setting_of(model, Odd()).road.stops


def test_a_model_without_slow_rows_is_refused(model: NddModel) -> None:
    with pytest.raises(InputError, match="knows no traffic that stops"):
        experiment(model=replace(model, slow=None), traffic="queue")
    with pytest.raises(InputError, match="traffic_length, for a queue"):
        Odd(traffic="queue", traffic_length=400.0)
