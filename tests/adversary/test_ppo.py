"""PPO: advantages as a slow, plain way gives them, probabilities as the kernel acted by, and the clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from cornerforge.adversary.ppo import PRESETS, PpoLearner
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.worlds.drive_bv import Transitions, allocate_actors, collect, start_worlds
from cornerforge.adversary.worlds.rewards import reward_numbers
from cornerforge.errors import InputError
from cornerforge.experiment.setting import experiment
from cornerforge.sim.controllers import TOLD
from cornerforge.sim.keep import keep_nothing
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.scratch import allocate_scratch
from cornerforge.types import N_ACTIONS

pytestmark = pytest.mark.usefixtures("one_torch_thread")

SMALL = replace(PRESETS["fast"], worlds=8, rollout=6, batch=16, width=16, discount=0.9, trace=0.7)


def noted(learner: PpoLearner, seed: int, decisions: int = SMALL.rollout) -> list[Transitions]:
    """Note decisions whose every part is drawn; each is followed by what is seen next."""
    rng, batches = np.random.default_rng(seed), []
    seen = rng.normal(size=(decisions + 1, SMALL.worlds, N_OBSERVATION)).astype(np.float32)
    for k in range(decisions):
        batch = allocate_transitions(SMALL.worlds)
        batch.observation[:], batch.next_observation[:] = seen[k], seen[k + 1]
        batch.allowed[:] = True
        batch.action[:] = rng.integers(0, N_ACTIONS, SMALL.worlds)
        with torch.no_grad():
            log_probs = learner.network(torch.from_numpy(seen[k])).log_softmax(dim=1).numpy()
        batch.log_prob[:] = log_probs[np.arange(SMALL.worlds), batch.action]
        batch.reward[:] = rng.normal(size=SMALL.worlds)
        batch.end[:] = rng.random(SMALL.worlds) < 0.3
        learner.note(batch)
        batches.append(batch)
    return batches


def test_advantages_are_those_of_the_plain_sum(seed: int) -> None:
    """Of each decision: the sum of later one-step errors of its test, each weighted (discount * trace)^distance."""
    learner = PpoLearner(SMALL, seed=1)
    batches = noted(learner, seed)

    def value(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return learner.network(torch.from_numpy(observation)).mean(dim=1).numpy().astype(np.float64)

    expected = np.zeros((SMALL.rollout, SMALL.worlds))
    for k in range(SMALL.rollout):
        for b in range(SMALL.worlds):
            for later in range(k, SMALL.rollout):
                batch = batches[later]
                following = 0.0 if batch.end[b] else SMALL.discount * value(batch.next_observation)[b]
                error = batch.reward[b] + following - value(batch.observation)[b]
                expected[k, b] += (SMALL.discount * SMALL.trace) ** (later - k) * error
                if batch.end[b]:
                    break
    advantage, goal = (part.numpy().reshape(expected.shape) for part in learner._advantages())
    values = np.stack([value(batch.observation) for batch in batches])
    np.testing.assert_allclose(goal, expected + values, atol=1e-4)
    np.testing.assert_allclose(advantage, (expected - expected.mean()) / expected.std(ddof=1), atol=1e-4)


def test_a_round_comes_after_every_rollout_and_not_before(seed: int) -> None:
    learner = PpoLearner(SMALL, seed=1)
    noted(learner, seed, SMALL.rollout - 1)
    learner.learn(1e-3)
    assert learner.updates == 0
    noted(learner, seed, 1)
    learner.learn(1e-3)
    assert learner.updates == SMALL.epochs * SMALL.rollout * SMALL.worlds // SMALL.batch
    learner.learn(1e-3)
    assert learner.updates == 12


def test_odds_that_have_changed_enough_change_no_more(seed: int) -> None:
    """With the clip the policy stays near the one that acted; without it one round takes it far."""
    changes = []
    for clip in (0.01, 1.0):
        learner = PpoLearner(replace(SMALL, clip=clip, epochs=30, value_weight=0.0, entropy_weight=0.0), seed=1)
        seen = torch.from_numpy(noted(learner, seed)[0].observation)
        with torch.no_grad():
            before = learner.network(seen).log_softmax(dim=1)
        learner.learn(1e-3)
        with torch.no_grad():
            after = learner.network(seen).log_softmax(dim=1)
        changes.append((after - before).abs().max().item())
    assert changes[0] < 0.5 * changes[1]


@pytest.mark.full
@pytest.mark.parametrize("bounded", [False, True])
def test_worlds_draw_by_the_probabilities_that_it_learns_from(bounded: bool) -> None:
    """What a kernel notes as an action's log-probability is what PyTorch computes of the network and the mask."""
    run = experiment(bv="uniform", bounded=bounded)
    config = replace(PRESETS["fast"], worlds=64)
    exploring = PpoLearner(config, seed=2).exploring(0)
    setting = run.setting.with_drivers(critical=TOLD, policy=exploring.policy)
    actors = allocate_actors(config.worlds, setting, run.slots, N_OBSERVATION)
    scratch, out = allocate_scratch(run.slots, exploring.policy), allocate_transitions(config.worlds)
    start_worlds(4, 0, setting, scratch, keep_nothing(run.slots), actors)
    network = PpoLearner(config, seed=2).network
    drawn = set()
    for _ in range(10):
        seen, allowed = actors.observation.copy(), actors.allowed.copy()
        collect(
            config.worlds, exploring, setting, reward_numbers("crash"), actors, scratch, keep_nothing(run.slots), out
        )
        np.testing.assert_array_equal(out.observation, seen)
        np.testing.assert_array_equal(out.allowed, allowed)
        with torch.no_grad():
            values = network(torch.from_numpy(seen)).masked_fill(~torch.from_numpy(allowed), -torch.inf)
        expected = values.log_softmax(dim=1).numpy()[np.arange(config.worlds), out.action]
        np.testing.assert_allclose(out.log_prob, expected, atol=1e-5)
        drawn |= set(out.action.tolist())
    assert len(drawn) > 10


@pytest.mark.parametrize(
    ("name", "value"), [("rollout", 0), ("epochs", 0), ("clip", 1.5), ("trace", -0.1), ("entropy_weight", float("nan"))]
)
def test_settings_out_of_range_are_named(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        replace(PRESETS["fast"], **{name: value})  # type: ignore[arg-type]
