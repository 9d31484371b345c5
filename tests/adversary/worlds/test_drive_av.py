"""Learning steps of the AV: what is paid, what follows on what, and the worlds that go on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_built import WIDE, setting_of

from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.train_av import AV_TRAINING
from cornerforge.adversary.worlds.drive_av import HOSTILE, AvReward, allocate_av_actors, collect_av, start_av_worlds
from cornerforge.adversary.worlds.drive_bv import Transitions
from cornerforge.drivers.avs import AV_KINDS
from cornerforge.drivers.policy import NO_POLICY, NetworkShape, PolicyNumbers, n_weights
from cornerforge.ndd.model import NddModel
from cornerforge.sim.av_features import N_AV_FEATURES
from cornerforge.sim.controllers import ADVERSARIES
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.sim.world import n_slots

B = 16
NOBODY = np.array([(ADVERSARIES["nobody"], 0)], dtype=HOSTILE)
SWERVE = np.array([(ADVERSARIES["swerve"], 0)], dtype=HOSTILE)


class Worlds:
    """B worlds in which an AV explores."""

    def __init__(self, model: NddModel, seed: int, mix: np.ndarray, reward: AvReward) -> None:
        odd = replace(WIDE, av_substeps=5)
        setting = setting_of(model, odd)
        shape = NetworkShape(N_AV_FEATURES, 1, 0, 8)
        network = PolicyNumbers(np.zeros(n_weights(shape), dtype=np.float32), shape.n_inputs, 1, 0, 8)
        self.setting = setting._replace(av=setting.av._replace(kind=AV_KINDS["learned"].code, network=network))
        self.reward = reward
        self.actors = allocate_av_actors(B, n_slots(odd), N_AV_FEATURES, mix)
        self.scratch, self.nothing = allocate_scratch(n_slots(odd), NO_POLICY), keep_nothing(n_slots(odd))
        self.observation, self.allowed = self.actors.observation, self.actors.allowed
        self.tests, self.finished = self.actors.worlds.state["test"][:, 0], self.actors.finished[0]
        start_av_worlds(seed, 0, self.setting, self.scratch, self.actors)
        assert self.tests.tolist() == list(range(B))

    def second(self, epsilon: float = 1.0) -> Transitions:
        """One second of all worlds."""
        out = allocate_transitions(2 * B, N_AV_FEATURES)
        rows = collect_av(B, epsilon, self.setting, self.reward, self.actors, self.scratch, self.nothing, out)
        return Transitions._make(part[:rows] for part in out)


def test_what_is_seen_next_is_what_is_seen(model: NddModel, seed: int) -> None:
    worlds = Worlds(model, seed, NOBODY, AV_TRAINING.av_reward)
    for _ in range(30):
        before, tests = worlds.observation.copy(), worlds.tests.copy()
        batch = worlds.second()
        on = tests == worlds.tests
        if on.all():  # two rows a world
            np.testing.assert_array_equal(batch.observation[::2], before)
            np.testing.assert_array_equal(batch.next_observation[::2], batch.observation[1::2])
            np.testing.assert_array_equal(batch.next_observation[1::2], worlds.observation)
            np.testing.assert_array_equal(batch.next_allowed[1::2], worlds.allowed)
        assert B + on.sum() <= batch.action.size <= 2 * B
        assert np.isin(worlds.tests - tests, [0, B]).all()
    assert worlds.finished["tests"] >= B  # 400 m last half a minute at most, unless the AV crawls


def test_the_pay_by_hand(model: NddModel, seed: int) -> None:
    # Progress and acceleration can be read from what is seen next: entry 1 is (speed - 30) / 10, entry 4 a / 4.
    worlds = Worlds(model, seed, NOBODY, AvReward(0.01, 0.002, 0.004, 0.0, 1.0))
    changes = 0
    for _ in range(20):
        batch = worlds.second()
        speed = 30.0 + 10.0 * batch.next_observation[:, 1]
        paid = 0.01 * (speed - 20.0) / 15.0 - 0.002 * np.abs(batch.next_observation[:, 4]) - 0.004 * (batch.action < 2)
        np.testing.assert_allclose(batch.reward[~batch.end], paid[~batch.end], atol=1e-6)
        assert (batch.reward[batch.end] == -1.0).all()
        changes += int((batch.action < 2).sum())
    assert changes > 10


def test_nearness_costs(model: NddModel, seed: int) -> None:
    # The same driving with and without: what differs lies in [0, 0.02] and is zero beyond the time gap.
    rewards = (AvReward(0.0, 0.0, 0.0, 0.0, 1.0), AvReward(0.0, 0.0, 0.0, 0.02, 1.0))
    free, paying = (Worlds(model, seed, NOBODY, reward) for reward in rewards)
    near = 0
    for _ in range(20):
        without, batch = free.second(), paying.second()
        cost = without.reward - batch.reward
        assert (cost >= 0.0).all()
        assert (cost <= 0.02 + 1e-7).all()
        ahead = batch.next_observation[:, 9:17]
        speed = 30.0 + 10.0 * batch.next_observation[:, 1]
        lack = np.where(ahead[:, 0] > 0.0, np.clip(1.0 - 50.0 * ahead[:, 1] / speed, 0.0, 1.0), 0.0)
        keeps = (batch.next_observation[:, 7] == 0.0) & (np.abs(ahead[:, 5]) < 0.1) & ~batch.end
        np.testing.assert_allclose(cost[keeps], 0.02 * lack[keeps], atol=1e-5)
        near += int((cost > 0.0).sum())
    assert near > 5


def test_only_a_crash_is_an_end(model: NddModel, seed: int) -> None:
    worlds = Worlds(model, seed, SWERVE, AV_TRAINING.av_reward)
    ends = sum(int(worlds.second().end.sum()) for _ in range(30))
    assert ends == worlds.finished["av_crashes"] > 10
    assert worlds.finished["tests"] > worlds.finished["av_crashes"]
    assert worlds.finished["natural_av_crashes"] == 0  # none of them in natural traffic


@pytest.mark.parametrize("epsilon", [0.0, 1.0])
def test_the_same_seed_drives_the_same(model: NddModel, seed: int, epsilon: float) -> None:
    runs = [Worlds(model, seed, NOBODY, AV_TRAINING.av_reward) for _ in range(2)]
    for _ in range(5):
        for ours, theirs in zip(*(run.second(epsilon) for run in runs), strict=True):
            np.testing.assert_array_equal(ours, theirs)
