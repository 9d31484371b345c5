"""An agent that decides as a built-in driver does gets the tests of `simulate`, to the bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cornerforge.adversary.train import TRAINING_TESTS
from cornerforge.adversary.verdicts import judge_by_case
from cornerforge.adversary.worlds.agents import substitute_action
from cornerforge.adversary.worlds.judge import judge_crashes
from cornerforge.adversary.worlds.rewards import reward_numbers
from cornerforge.errors import InputError
from cornerforge.experiment.experiments import Experiment
from cornerforge.experiment.setting import experiment
from cornerforge.ext.gym.batch import FIRST_TEST, AvBatch, BvBatch, adversary_batch, driving_batch
from cornerforge.ext.gym.spaces import av_commands
from cornerforge.sim.actions import ordered_lane
from cornerforge.sim.adversaries import choose_action
from cornerforge.sim.av import av_decide
from cornerforge.sim.controllers import ADVERSARIES
from cornerforge.sim.outcome import AV_CRASH, BV_CRASH, COMPLETED, Outcomes
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import World, world_of
from cornerforge.types import Odd
from cornerforge.world_options import WorldOptions

SEED = 2
N = 96


def world(batch: BvBatch | AvBatch, b: int) -> World:
    return world_of(batch.worlds, b)


def drive_to_the_end(batch: BvBatch | AvBatch, act) -> None:
    """Drive tests 0.. of SEED, one a world, until all are over; `act(batch, running)` steps them."""
    for b in range(batch.n):
        batch.name(b, SEED, b, lambda: 0)
    batch.begin(np.ones(batch.n, dtype=np.bool_))
    while not batch.is_over.all():
        act(batch, ~batch.is_over)


def as_adversary(kind: str):
    """Steps that take the choices of a plain adversary."""

    def act(batch: BvBatch, running: np.ndarray) -> None:
        policy = batch.run.setting.who.policy
        s = allocate_scratch(batch.run.slots, policy).choice
        actions = np.zeros(batch.n, dtype=np.int64)
        for b in np.flatnonzero(running):
            w = world(batch, int(b))
            s.allowed[:] = batch.allowed[b]
            assert (w.state["seed"][0], w.state["test"][0]) == (SEED, batch.tests[b])
            bv = int(w.state["controlled"][0])
            actions[b], _ = choose_action(w, bv, ADVERSARIES[kind], 0.0, 0.0, policy, s)
        batch.step(actions, running)

    return act


def as_built_in_av(batch: AvBatch, running: np.ndarray) -> None:
    """Steps that take the decisions of the built-in AV, as accelerations and lane orders."""
    command, order = np.zeros(batch.n), np.zeros(batch.n, dtype=np.int64)
    for b in np.flatnonzero(running):
        w = world(batch, int(b))
        command[b], lane = av_decide(w, batch.run.setting.road, batch.run.setting.av)
        order[b] = lane - w.vehicles["target_lane"][0]
    batch.drive(command, order, running)


def assert_same_tests(batch: BvBatch | AvBatch, run: Experiment) -> Outcomes:
    out, _ = drive_chunk(run.setting, run.slots, SEED, 0, batch.n, False)
    np.testing.assert_array_equal(batch.outcome, out.code)
    np.testing.assert_array_equal(batch.worlds.state["frame"][:, 0], out.frame)
    np.testing.assert_array_equal(batch.worlds.vehicles["x"][:, 0] - run.odd.av_start, out.distance)
    return out


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("kind", "bounded", "odd"),
    [("swerve", False, "default"), ("uniform", False, "paper"), ("uniform", True, "swift")],
)
def test_the_controlled_bv_does_what_the_agent_says(kind: str, bounded: bool, odd: str, reckless: Path) -> None:
    batch = adversary_batch(N, 2, WorldOptions(odd=odd, model=reckless, bounded=bounded), reward="crash")
    drive_to_the_end(batch, as_adversary(kind))
    out = assert_same_tests(batch, experiment(odd=odd, model=reckless, bv=kind, bounded=bounded, steer_from=0))
    assert len(set(out.code.tolist())) > 1, "too little happened"


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("bv", "odd"), [("nde", "default"), ("swerve", "default"), ("uniform", "paper"), ("idm", "swift")]
)
def test_the_av_does_what_the_agent_says(bv: str, odd: str, reckless: Path) -> None:
    batch = driving_batch(N, 2, WorldOptions(odd=odd, model=reckless), bv=bv, box=False, act_every=None)
    drive_to_the_end(batch, as_built_in_av)
    assert_same_tests(batch, experiment(odd=odd, model=reckless, bv=bv))


@pytest.mark.parametrize("act_every", [2, 5, 10])
def test_the_av_may_decide_less_often(act_every: int, reckless: Path) -> None:
    batch = driving_batch(N, 1, WorldOptions(model=reckless), bv="swerve", box=False, act_every=act_every)
    drive_to_the_end(batch, as_built_in_av)
    run = experiment(model=reckless, bv="swerve")
    slower = run.setting._replace(road=run.setting.road._replace(av_substeps=act_every))
    out = assert_same_tests(batch, replace(run, setting=slower))
    assert (out.code == AV_CRASH).sum() > 10


def test_at_the_end_everybody_stands_where_the_recording_says(reckless: Path) -> None:
    """A fast test moves only whom somebody may touch or see; what is shown last must be of one moment all the same."""
    batch = adversary_batch(N, 1, WorldOptions(model=reckless), reward="crash")
    drive_to_the_end(batch, as_adversary("swerve"))
    assert {AV_CRASH, BV_CRASH, COMPLETED} <= set(batch.outcome.tolist())
    recorder = Recorder(experiment(model=reckless, bv="swerve").setting, Odd())
    within_a_second = 0
    for b in range(N):
        last = recorder.record(SEED, b)
        w = world(batch, int(b))
        there = w.vehicles[: w.state["n_vehicles"][0]]
        np.testing.assert_array_equal(there["present"] == 1, last.present[-1])
        for name in ("x", "y", "speed", "heading"):
            np.testing.assert_array_equal(there[name][last.present[-1]], getattr(last, name)[-1][last.present[-1]])
        within_a_second += w.state["frame"][0] % 10 > 0
    assert within_a_second > N // 4


@pytest.mark.sampled(2)
@pytest.mark.parametrize("reward", ["crash", "striking", "avoidable", "preventable", "own-fault"])
def test_the_adversary_is_paid_as_its_crashes_are_judged(reward: str, reckless: Path) -> None:
    """One sum per test, by the judgement of the same tests driven again; two threads with scratch of their own."""
    batch = adversary_batch(N, 2, WorldOptions(model=reckless), reward=reward, delay=0.3)
    total = np.zeros(N)
    drive = as_adversary("swerve")

    def act(batch: BvBatch, running: np.ndarray) -> None:
        drive(batch, running)
        total[running] += batch.reward[running]

    drive_to_the_end(batch, act)
    assert {AV_CRASH, BV_CRASH, COMPLETED} <= set(batch.outcome.tolist())
    crashed = np.flatnonzero(batch.outcome == AV_CRASH)
    run = experiment(model=reckless, bv="swerve")
    strikes, avoidable = judge_crashes(
        run.recorder, run.setting, seed=SEED, tests=crashed.tolist(), braking=reward_numbers(reward, 0.3).braking
    )
    by_case = judge_by_case(run, SEED, crashed.tolist(), reward, 1)
    in_kernels = {"crash": np.ones(crashed.size, np.bool_), "striking": strikes, "avoidable": avoidable}
    paid = in_kernels[reward] if by_case is None else by_case.paid
    assert paid.all() == (reward == "crash")
    assert paid.any() or reward == "striking", "nobody who is swerved into strikes"
    expected = np.where(batch.outcome == BV_CRASH, -1.0, 0.0)
    expected[crashed] = paid
    np.testing.assert_array_equal(total, expected)


def test_the_av_is_paid_for_metres_and_pays_for_crashes(reckless: Path) -> None:
    batch = driving_batch(N, 1, WorldOptions(model=reckless), bv="swerve", box=False, act_every=None)
    total = np.zeros(N)

    def act(batch: AvBatch, running: np.ndarray) -> None:
        as_built_in_av(batch, running)
        total[running] += batch.reward[running]

    drive_to_the_end(batch, act)
    crashed = batch.outcome == AV_CRASH
    assert 0 < crashed.sum() < N
    np.testing.assert_allclose(total, (batch.worlds.vehicles["x"][:, 0] - 240.0) / 400.0 - crashed, rtol=1e-12)
    assert total[batch.outcome == COMPLETED].min() >= 1.0
    assert total[crashed].max() < 0.01  # it may crash in the frame in which it reaches the end, up to 4 m behind it


def test_the_substitute_of_a_forbidden_action_is_the_nearest_allowed_acceleration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(500):
        allowed = rng.random(33) < rng.random()
        allowed[rng.integers(33)] = True
        for wished in range(33):
            taken = substitute_action(wished, allowed)
            assert allowed[taken]
            goal = wished if wished > 1 else 22
            if allowed[wished]:
                assert taken == wished
            elif allowed[2:].any():
                assert taken > 1
                assert abs(taken - goal) == np.abs(2 + np.flatnonzero(allowed[2:]) - goal).min()


def test_accelerations_and_lane_orders_by_hand() -> None:
    command, order = av_commands(np.array([0, 1, 2, 22, 32]), box=False)
    np.testing.assert_allclose(command, [0.0, 0.0, -4.0, 0.0, 2.0])
    np.testing.assert_array_equal(order, [1, -1, 0, 0, 0])
    wishes = np.array([[-1.0, 0.0], [1.0, 0.34], [0.5, -0.34], [-0.5, 0.33], [-7.0, 9.0]], dtype=np.float32)
    command, order = av_commands(wishes, box=True)
    np.testing.assert_allclose(command, [-8.0, 2.0, 1.0, -4.0, -8.0])
    np.testing.assert_array_equal(order, [0, 1, -1, 0, 1])


def test_lane_orders_begin_break_off_and_stay_on_the_road() -> None:
    batch = driving_batch(1, 1, WorldOptions(lanes=2), bv="nde", box=False, act_every=None)
    road = batch.run.setting.road
    one = np.ones(1, dtype=np.bool_)
    w = world(batch, 0)

    def lane_after(order: int) -> int:
        batch.drive(np.zeros(1), np.array([order]), one)
        return int(w.vehicles["target_lane"][0])

    batch.name(0, SEED, 0, lambda: 0)
    batch.begin(one)
    start = int(w.vehicles["target_lane"][0])
    there, back = (1, -1) if start == 0 else (-1, 1)
    assert ordered_lane(w, 0, back, road) == start, "off the road"
    assert lane_after(0) == start
    assert lane_after(there) == 1 - start
    assert lane_after(there) == 1 - start, "an order in the change's own direction changes nothing"
    assert lane_after(back) == start, "an order against it breaks it off"
    assert lane_after(0) == start


def test_a_world_without_anybody_to_control_is_named() -> None:
    run = experiment(bv="uniform")
    empty = run.setting._replace(road=run.setting.road._replace(av_start=0.0, traffic_length=-1000.0))
    batch = BvBatch(replace(run, setting=empty), 2, 1, 1, reward_numbers("crash"))
    for b in range(2):
        batch.name(b, SEED, b, lambda: 0)
    with pytest.raises(InputError, match="no background vehicle to control in 1000 tests"):
        batch.begin(np.array([True, False]))
    assert batch.is_over.all()


def test_agents_learn_where_training_learns() -> None:
    assert FIRST_TEST == TRAINING_TESTS
