"""Which crashes are paid for: the AV's front in the contact, and what `collect` gives against tests judged apart."""

from __future__ import annotations

import numpy as np
import pytest
from hand_built import setting_of

from cornerforge.adversary.replay import allocate_transitions
from cornerforge.analysis.contact import FRONT, find_contact
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.geometry import boxes_overlap
from cornerforge.ndd.model import NddModel
from cornerforge.sim.adversaries import allocate_choice_scratch
from cornerforge.sim.braking import Braking
from cornerforge.sim.drive_bv import N_FINISHED, History, collect, start_worlds
from cornerforge.sim.judge import judge_crashes
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.reach import allocate_pairs
from cornerforge.sim.rewards import REWARDS, av_strikes, is_paid, reward_named, reward_numbers
from cornerforge.sim.runner import drive_chunk
from cornerforge.sim.step import SUBSTEPS, allocate_recording
from cornerforge.sim.world import AV_CRASH, BV_CRASH, allocate_worlds, n_slots, road_numbers
from cornerforge.types import Odd

ROAD = road_numbers(Odd())


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
    overlap = [boxes_overlap(ax, ay, ah, bx, by, bh, 5.0, 2.0) for (ax, ay, _, ah), (bx, by, _, bh) in pose]
    return pose[np.array(overlap)]


def test_the_av_strikes_where_the_analysis_sees_its_front(seed: int) -> None:
    pose = random_contacts(seed, 3000)
    expected = find_contact(pose, 5.0, 2.0).av_sector == FRONT
    found = [av_strikes(ax, ay, av, ah, bx, by, bv, bh, ROAD) for (ax, ay, av, ah), (bx, by, bv, bh) in pose]
    assert np.array_equal(found, expected)
    assert 300 < expected.sum() < len(pose) - 300


def test_plain_contacts() -> None:
    assert av_strikes(0.0, 2.0, 30.0, 0.0, 4.5, 2.0, 20.0, 0.0, ROAD) is True  # into a rear
    assert av_strikes(4.5, 2.0, 20.0, 0.0, 0.0, 2.0, 30.0, 0.0, ROAD) is False  # struck from behind
    assert av_strikes(0.0, 2.0, 30.0, 0.0, 1.0, 3.9, 30.0, -0.1, ROAD) is False  # side against side


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
    }


def test_unknown_rewards_and_times_out_of_range_are_named() -> None:
    with pytest.raises(UnknownNameError, match='Did you mean "avoidable"'):
        reward_named("avoidabel")
    for wrong in ({"delay_s": -1.0}, {"delay_s": float("nan")}, {"deceleration_mps2": 0.0}):
        with pytest.raises(InputError):
            reward_numbers("avoidable", **wrong)


@pytest.mark.parametrize("name", REWARDS)
@pytest.mark.parametrize("adversary", ["swerve", "lane-changer"])
def test_collect_pays_as_tests_judged_apart(name: str, adversary: str, model: NddModel, seed: int) -> None:
    odd, n = Odd(), 24
    setting, slots = setting_of(model, odd, adversary=adversary), n_slots(odd)
    worlds, pairs, scratch = allocate_worlds(n, slots), allocate_pairs(slots), allocate_choice_scratch(setting.policy)
    tests = np.arange(n, dtype=np.int64)
    view, allowed = np.zeros((n, N_OBSERVATION), dtype=np.float32), np.zeros((n, 33), dtype=np.bool_)
    recording, out, finished = allocate_recording(0, slots), allocate_transitions(n), np.zeros(N_FINISHED, np.int64)
    longest = setting.road.max_decisions
    history = History(
        np.zeros((n, longest), np.int16), np.zeros((n, longest), np.int8), allocate_worlds(1, slots),
        allocate_recording(SUBSTEPS * longest + 1, slots),
    )  # fmt: skip
    start_worlds(seed, tests, setting, worlds, scratch, view, allowed)
    rewards: dict[int, float] = {}
    for _ in range(60):
        before = tests.copy()
        collect(
            seed, 0, n, tests, 0.0, 0, 0.0, setting, reward_numbers(name), worlds, pairs, scratch, recording, history,
            view, allowed, out, finished,
        )  # fmt: skip
        assert not out.reward[~out.end].any()
        rewards |= dict(zip(before[out.end].tolist(), out.reward[out.end].tolist(), strict=True))
    assert finished[0] == len(rewards) > 2 * n
    expected = {}
    for test in rewards:
        outcome, _ = drive_chunk(setting, slots, seed, test, 1, False)
        strikes, avoidable = judge_crashes(setting, slots, seed=seed, tests=[test], braking=Braking(1.0, 8.0))
        paid = {"crash": True, "striking": bool(strikes[0]), "avoidable": bool(avoidable[0])}[name]
        expected[test] = float(paid) if outcome.code[0] == AV_CRASH else -float(outcome.code[0] == BV_CRASH)
    assert rewards == expected
    assert finished[3] == sum(reward > 0.0 for reward in rewards.values())
