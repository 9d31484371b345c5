"""Which crashes are paid for: the AV's front in the contact, and what `collect` gives against tests judged apart."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.worlds.drive_bv import Exploring, allocate_actors, collect, start_worlds
from cornerforge.adversary.worlds.judge import judge_crashes
from cornerforge.adversary.worlds.rewards import (
    REWARDS,
    av_strikes,
    driver_of_reward,
    is_paid,
    reward_named,
    reward_numbers,
)
from cornerforge.analysis.contact import FRONT, find_contact
from cornerforge.counterfactual.braking import Braking
from cornerforge.drivers.policy import NO_POLICY
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.geometry import Box, boxes_overlap
from cornerforge.ndd.model import NddModel
from cornerforge.road.straight import road_numbers
from cornerforge.sim.controllers import ADVERSARIES, TOLD
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.outcome import AV_CRASH, BV_CRASH
from cornerforge.sim.recorder import Recorder
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import VEHICLE, n_slots

ROAD = road_numbers(WIDE)


def random_contacts(seed: int, n: int) -> np.ndarray:
    """Poses of two boxes that overlap by up to some metres, (at most n, 2, 4)."""
    rng = np.random.default_rng(seed)
    pose = np.zeros((n, 2, 4))
    pose[:, 0, :2] = rng.uniform(100.0, 200.0, (n, 2))
    pose[:, :, 2] = rng.uniform(0.0, 40.0, (n, 2))
    pose[:, :, 3] = rng.normal(0.0, 0.3, (n, 2))
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    reach = np.stack([np.cos(angle) * rng.uniform(0.0, 4.6, n), np.sin(angle) * rng.uniform(0.0, 1.8, n)], axis=1)
    pose[:, 1, :2] = pose[:, 0, :2] + reach
    overlap = [
        boxes_overlap(Box(ax, ay, ah, 5.0, 2.0), Box(bx, by, bh, 5.0, 2.0)) for (ax, ay, _, ah), (bx, by, _, bh) in pose
    ]
    return pose[np.array(overlap)]


def boxes(pose: np.ndarray) -> np.ndarray:
    """Two vehicles at [x, y, speed, heading], (2, 4)."""
    found = np.zeros(2, dtype=VEHICLE)
    for name, values in zip(("x", "y", "speed", "heading"), pose.T, strict=True):
        found[name] = values
    found["length"], found["width"] = 5.0, 2.0
    return found


def strikes(*poses: tuple[float, float, float, float]) -> bool:
    return av_strikes(boxes(np.array(poses)), 0, 1, along_road=True)


def test_the_av_strikes_where_the_analysis_sees_its_front(seed: int) -> None:
    pose = random_contacts(seed, 3000)
    expected = find_contact(pose, 5.0, 2.0).av_sector == FRONT
    found = [av_strikes(boxes(pair), 0, 1, along_road=True) for pair in pose]
    assert np.array_equal(found, expected)
    assert 300 < expected.sum() < len(pose) - 300


def test_plain_contacts() -> None:
    assert strikes((0.0, 2.0, 30.0, 0.0), (4.5, 2.0, 20.0, 0.0)) is True  # into a rear
    assert strikes((4.5, 2.0, 20.0, 0.0), (0.0, 2.0, 30.0, 0.0)) is False  # struck from behind
    assert strikes((0.0, 2.0, 30.0, 0.0), (1.0, 3.9, 30.0, -0.1)) is False  # side against side


def test_who_is_paid_for_what() -> None:
    table = {
        name: [
            bool(is_paid(reward.code, strikes, avoidable)) for strikes in (False, True) for avoidable in (False, True)
        ]
        for name, reward in REWARDS.items()
    }
    assert table == {
        "crash": [True, True, True, True],
        "striking": [False, False, True, True],
        "avoidable": [False, True, False, True],
        "preventable": [False] * 4,  # these are given outside the kernels
        "preventable-by-braking": [False] * 4,
        "own-fault": [False] * 4,
        "own-doing": [False] * 4,
    }
    by_case = {name for name, reward in REWARDS.items() if reward.by_case}
    assert by_case == {"preventable", "preventable-by-braking", "own-fault", "own-doing"}


def test_a_reward_may_name_its_reference_driver() -> None:
    assert driver_of_reward("preventable") == driver_of_reward("preventable:cc-human") == "cc-human"
    assert driver_of_reward("preventable:fsm") == driver_of_reward("preventable-by-braking:fsm") == "fsm"
    assert driver_of_reward("own-fault") is None
    with pytest.raises(UnknownNameError, match=r'reference driver.*Did you mean "fsm"'):
        reward_named("preventable:fsn")
    with pytest.raises(InputError, match='crash asks no driver; leave out ":fsm"'):
        reward_named("crash:fsm")


def test_unknown_rewards_and_times_out_of_range_are_named() -> None:
    with pytest.raises(UnknownNameError, match='Did you mean "avoidable"'):
        reward_named("avoidabel")
    for wrong in ({"delay_s": -1.0}, {"delay_s": float("nan")}, {"deceleration_mps2": 0.0}):
        with pytest.raises(InputError):
            reward_numbers("avoidable", **wrong)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", [name for name, reward in REWARDS.items() if not reward.by_case])
@pytest.mark.parametrize("adversary", ["swerve", "lane-changer"])
def test_collect_pays_as_tests_judged_apart(name: str, adversary: str, model: NddModel, seed: int) -> None:
    odd, n = WIDE, 24
    setting, slots = setting_of(model, odd, adversary=adversary), n_slots(odd)
    told = setting.with_drivers(critical=TOLD)
    exploring = Exploring(ADVERSARIES[adversary], NO_POLICY, 0.0, 0, 0.0)
    actors, out = allocate_actors(n, told, slots, N_OBSERVATION), allocate_transitions(n)
    scratch, nothing = allocate_scratch(slots, NO_POLICY), keep_nothing(slots)
    start_worlds(seed, 0, told, scratch, nothing, actors)
    tests = actors.worlds.state["test"][:, 0]
    assert tests.tolist() == list(range(n))
    rewards: dict[int, float] = {}
    for _ in range(60):
        before = tests.copy()
        collect(n, exploring, told, reward_numbers(name), actors, scratch, nothing, out)
        assert not out.reward[~out.end].any()
        rewards |= dict(zip(before[out.end].tolist(), out.reward[out.end].tolist(), strict=True))
    assert actors.finished["tests"][0] == len(rewards) > 2 * n
    expected, recorder = {}, partial(Recorder, setting, odd)
    for test in rewards:
        outcome, _ = drive_chunk(setting, slots, seed, test, 1, False)
        struck, avoidable = judge_crashes(recorder, setting, seed=seed, tests=[test], braking=Braking(1.0, 8.0))
        paid = {"crash": True, "striking": bool(struck[0]), "avoidable": bool(avoidable[0])}[name]
        expected[test] = float(paid) if outcome.code[0] == AV_CRASH else -float(outcome.code[0] == BV_CRASH)
    assert rewards == expected
    assert actors.finished["paid"][0] == sum(reward > 0.0 for reward in rewards.values())
