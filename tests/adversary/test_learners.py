"""One contract over all learners: each learns a tiny problem, acts by what it gave, and goes on from what was kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cornerforge.adversary import ppo
from cornerforge.adversary.config import PRESETS, TrainConfig, preset_named
from cornerforge.adversary.learner import Learner
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.worlds.drive_bv import Exploring, Transitions
from cornerforge.drivers.policy import HEADS, allocate_scratch, best_action, q_values
from cornerforge.results.learning import TrainingPoint
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.types import N_ACTIONS
from cornerforge.world_options import LEARNERS

pytestmark = pytest.mark.usefixtures("one_torch_thread")

WORLDS, STATES = 64, 5
LEFT, RIGHT, STOP = 3, 17, 32
"""The three actions that the mask allows."""
COMMON: dict[str, Any] = {"worlds": WORLDS, "width": 32, "discount": 0.9}
TINY: dict[str, TrainConfig] = {
    "dqn": replace(
        PRESETS["fast"], batch=64, replay_size=4096, replay_start=64, decisions_per_update=64, target_update=25,
        epsilon_decisions=WORLDS * 300, guided=0.0, paid_share=0.0, **COMMON,
    ),
    "ppo": replace(ppo.PRESETS["fast"], rollout=16, batch=256, **COMMON),
}  # fmt: skip
EVERY = pytest.mark.parametrize("name", LEARNERS)


class Corridor:
    """Worlds in which beyond one end of five places is +1 and beyond the other -1; STOP ends with 0.3 anywhere.

    At the best every place leads to the end that pays: from the farthest that is worth 0.9^4 = 0.66.
    """

    def __init__(self, pays: int, seed: int) -> None:
        self._pays = pays
        self._rng = np.random.default_rng(seed)
        self._place = self._rng.integers(0, STATES, WORLDS)
        self._allowed = np.zeros((WORLDS, N_ACTIONS), dtype=np.bool_)
        self._allowed[:, [LEFT, RIGHT, STOP]] = True

    def _seen(self) -> np.ndarray:
        return np.eye(STATES, N_OBSERVATION, dtype=np.float32)[self._place]

    def _choose(self, exploring: Exploring, values: np.ndarray, allowed: np.ndarray) -> tuple[int, float]:
        if exploring.policy.head == HEADS["softmax"]:
            odds = np.where(allowed, np.exp(values - values.max()), 0.0).astype(np.float64)
            p = odds / odds.sum()
            action = int(self._rng.choice(N_ACTIONS, p=p))
            return action, float(np.log(p[action]))
        if self._rng.uniform() < exploring.epsilon:
            return int(self._rng.choice(np.flatnonzero(allowed))), 0.0
        return best_action(values, allowed), 0.0

    def second(self, exploring: Exploring) -> Transitions:
        out, scratch = allocate_transitions(WORLDS), allocate_scratch(exploring.policy)
        out.observation[:], out.allowed[:], out.next_allowed[:] = self._seen(), self._allowed, self._allowed
        values = np.zeros(N_ACTIONS, dtype=np.float32)
        for b in range(WORLDS):
            q_values(exploring.policy, out.observation[b], scratch, values)
            out.action[b], out.log_prob[b] = self._choose(exploring, values, out.allowed[b])
        self._place += np.where(out.action == STOP, 0, np.where(out.action == RIGHT, 1, -1))
        left, right, stopped = self._place < 0, self._place >= STATES, out.action == STOP
        pays, costs = (right, left) if self._pays == RIGHT else (left, right)
        out.reward[:] = np.where(stopped, 0.3, 1.0 * pays - costs)
        out.end[:] = left | right | stopped
        self._place = np.where(out.end, self._rng.integers(0, STATES, WORLDS), self._place)
        out.next_observation[:] = self._seen()
        return out


def taught(name: str, worlds: Corridor, iterations: int, learning_rate: float = 3e-3) -> Learner:
    learner = TINY[name].make_learner(5)
    for k in range(iterations):
        batch = worlds.second(learner.exploring(k * WORLDS))
        learner.learn(learning_rate)
        learner.note(batch)
    return learner


def weights(learner: Learner) -> bytes:
    return learner.exploring(10**9).policy.weights.tobytes()


def best_actions(learner: Learner) -> list[int]:
    policy = learner.exploring(10**9).policy
    allowed, values = np.zeros(N_ACTIONS, dtype=np.bool_), np.zeros(N_ACTIONS, dtype=np.float32)
    allowed[[LEFT, RIGHT, STOP]] = True
    found = []
    for seen in np.eye(STATES, N_OBSERVATION, dtype=np.float32):
        q_values(policy, seen, allocate_scratch(policy), values)
        found.append(best_action(values, allowed))
    return found


@EVERY
@pytest.mark.parametrize("pays", [LEFT, RIGHT])
def test_it_goes_where_it_pays_and_does_not_stop_before(name: str, pays: int, seed: int) -> None:
    """The end that pays must be found from all five places; a learner that only follows its first weights cannot find
    both ends."""
    assert best_actions(taught(name, Corridor(pays, seed), 600)) == [pays] * STATES


@EVERY
def test_negative_control_without_steps_of_size_it_does_not(name: str, seed: int) -> None:
    ends = [best_actions(taught(name, Corridor(pays, seed), 100, learning_rate=1e-9)) for pays in (LEFT, RIGHT)]
    assert ends != [[LEFT] * STATES, [RIGHT] * STATES]


@EVERY
@pytest.mark.parametrize("kept_after", [0, 37, 120])
def test_it_goes_on_from_what_was_kept_as_if_nothing_had_been(name: str, kept_after: int, seed: int) -> None:
    learner = taught(name, Corridor(RIGHT, seed), kept_after)
    kept = {key: array.copy() for key, array in learner.arrays().items()}
    again = TINY[name].make_learner(5)
    again.restore(kept, learner.values())
    worlds = Corridor(RIGHT, seed + 1)
    for _ in range(40):
        batch = worlds.second(learner.exploring(0))
        for one in (learner, again):
            one.learn(1e-3)
            one.note(batch)
        assert again.updates == learner.updates
    assert weights(again) == weights(learner)
    assert again.point(0) == learner.point(0)
    assert learner.updates > 0


@EVERY
def test_worlds_act_with_a_copy_and_the_curve_knows_every_word(name: str, seed: int) -> None:
    learner = taught(name, Corridor(RIGHT, seed), 60)
    before = learner.exploring(0).policy
    same = before.weights.copy()
    for _ in range(40):
        learner.learn(1e-3)
        learner.note(Corridor(RIGHT, seed).second(learner.exploring(0)))
    assert before.weights.tobytes() == same.tobytes() != weights(learner)
    assert before.head == HEADS[TINY[name].head]
    assert set(learner.point(0)) <= set(TrainingPoint.__dataclass_fields__)
    assert learner.point(0)["loss"] is not None


@EVERY
def test_every_learner_has_a_preset_fast_that_names_it(name: str) -> None:
    config = preset_named("fast", name)
    assert (config.learner, config.preset) == (name, "fast")
    assert weights(config.make_learner(1)) != weights(config.make_learner(2))
