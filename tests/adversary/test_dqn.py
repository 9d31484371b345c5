"""The DQN on problems with a known answer: exact Q*, masks, one batch by heart, schedules."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from cornerforge.adversary.config import PRESETS, DqnConfig, preset_named
from cornerforge.adversary.dqn import DqnLearner
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.train import _learning_rate
from cornerforge.adversary.worlds.drive_bv import Transitions
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.sim.observe import N_OBSERVATION

pytestmark = pytest.mark.usefixtures("one_torch_thread")

SMALL = replace(
    PRESETS["fast"], width=32, batch=64, replay_size=4096, replay_start=64, worlds=64, decisions_per_update=64,
    target_update=25, discount=0.9, paid_share=0.0,
)  # fmt: skip

# A corridor of five states. Left of the first is -1, right of the last +1; "stop" ends with 0.5 anywhere; "forbidden"
# ends with +1 and stands in the memory, but the mask of every state excludes it.
N_STATES = 5
LEFT, RIGHT, STOP, FORBIDDEN = 0, 1, 2, 32
ACTIONS = (LEFT, RIGHT, STOP, FORBIDDEN)


def outcome(state: int, action: int) -> tuple[float, int | None]:
    """Reward and next state (None at the end)."""
    if action == STOP:
        return 0.5, None
    if action == FORBIDDEN:
        return 1.0, None
    following = state + (1 if action == RIGHT else -1)
    if following < 0:
        return -1.0, None
    return (1.0, None) if following == N_STATES else (0.0, following)


def exact_q(discount: float, allowed: tuple[int, ...]) -> np.ndarray:
    """Q* of the corridor by value iteration, shape (5, 4); the maximum runs over the allowed actions."""
    q = np.zeros((N_STATES, len(ACTIONS)))
    columns = [ACTIONS.index(action) for action in allowed]
    for _ in range(100):
        best = q[:, columns].max(axis=1)
        for state in range(N_STATES):
            for column, action in enumerate(ACTIONS):
                reward, following = outcome(state, action)
                q[state, column] = reward + (0.0 if following is None else discount * best[following])
    return q


def corridor(allowed: tuple[int, ...]) -> Transitions:
    """Every state and action once."""
    batch = allocate_transitions(N_STATES * len(ACTIONS))
    batch.next_allowed[:, list(allowed)] = True
    for row, (state, action) in enumerate((s, a) for s in range(N_STATES) for a in ACTIONS):
        reward, following = outcome(state, action)
        batch.observation[row, state] = 1.0
        batch.action[row] = action
        batch.reward[row] = reward
        batch.end[row] = following is None
        if following is not None:
            batch.next_observation[row, following] = 1.0
    return batch


def values_of(learner: DqnLearner, observation: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return learner.network(torch.from_numpy(observation)).numpy()


def learned_q(allowed: tuple[int, ...]) -> np.ndarray:
    learner = DqnLearner(SMALL, seed=0)
    learner.note(corridor(allowed))
    for learning_rate in (3e-3, 1e-3, 1e-4):
        learner.descend(500, learning_rate)
    return values_of(learner, np.eye(N_STATES, N_OBSERVATION, dtype=np.float32))[:, ACTIONS]


def test_learner_reaches_exact_q_and_never_takes_the_maximum_over_a_masked_action() -> None:
    masked = exact_q(SMALL.discount, (LEFT, RIGHT, STOP))
    free = exact_q(SMALL.discount, ACTIONS)
    # If the mask were ignored the answer would be another one, far beyond the tolerance.
    assert np.abs(masked - free).max() > 0.2
    np.testing.assert_allclose(learned_q((LEFT, RIGHT, STOP)), masked, atol=0.02)


def test_negative_control_without_the_mask_the_answer_is_the_other_one() -> None:
    np.testing.assert_allclose(learned_q(ACTIONS), exact_q(SMALL.discount, ACTIONS), atol=0.02)


def test_learner_knows_one_batch_by_heart(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = allocate_transitions(64)
    batch.observation[:] = rng.uniform(-1.0, 1.0, batch.observation.shape)
    batch.action[:] = rng.integers(0, 33, 64)
    batch.reward[:] = rng.integers(-1, 2, 64)
    batch.end[:] = True
    learner = DqnLearner(replace(SMALL, width=64), seed=0)
    learner.note(batch)
    losses = []
    for steps in (1, 800):
        learner.descend(steps, 1e-3)
        losses.append(learner.point(0)["loss"])
    before, after = losses
    assert before is not None
    assert after is not None
    assert before > 0.1
    assert after < 1e-3


@pytest.mark.parametrize("limit", [1.0, 3.0])
def test_targets_are_cut_to_their_limit(limit: float) -> None:
    learner = DqnLearner(replace(SMALL, target_limit=limit), seed=0)
    batch = allocate_transitions(64)
    batch.reward[:] = 50.0
    batch.end[:] = True
    learner.note(batch)
    learner.descend(900, 3e-3)
    value = values_of(learner, np.zeros((1, N_OBSERVATION), dtype=np.float32))[0, 0]
    assert value == pytest.approx(limit, abs=0.05 * limit)


def test_epsilon_falls_in_a_straight_line_and_stays() -> None:
    learner = DqnLearner(replace(SMALL, epsilon_start=0.8, epsilon_end=0.2, epsilon_decisions=1000), seed=0)
    for decisions, epsilon in ((0, 0.8), (500, 0.5), (1000, 0.2), (10**9, 0.2)):
        assert learner.exploring(decisions).epsilon == pytest.approx(epsilon)
        assert learner.point(decisions)["epsilon"] == pytest.approx(epsilon)


def test_learning_rate_falls_as_a_cosine_and_stays() -> None:
    config = replace(SMALL, learning_rate=1e-2, final_learning_rate=1e-3, decisions=1000)
    assert _learning_rate(config, 0) == pytest.approx(1e-2)
    assert _learning_rate(config, 500) == pytest.approx(5.5e-3)
    assert _learning_rate(config, 1000) == pytest.approx(1e-3)
    assert _learning_rate(config, 2000) == pytest.approx(1e-3)


def test_preset_paper_is_table_1_of_the_paper() -> None:
    paper = PRESETS["paper"]
    assert (paper.optimiser, paper.learning_rate, paper.final_learning_rate) == ("sgd", 1e-6, 1e-6)
    assert (paper.batch, paper.replay_size, paper.replay_start, paper.target_update) == (16, 1_000_000, 5_000, 1_000)
    assert (paper.epsilon_start, paper.epsilon_end, paper.discount) == (1.0, 0.1, 1.0)
    assert (paper.n_shared, paper.n_stream, paper.width) == (4, 2, 128)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("learning_rate", 0.0), ("learning_rate", float("nan")), ("discount", 1.5), ("epsilon_end", -0.1), ("batch", 0),
        ("decisions", 0), ("replay_start", 4097), ("replay_size", 63), ("decisions_per_update", 65),
        ("optimiser", "amad"), ("target_limit", 0.0), ("guided_epsilon", 1.5),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_named(name: str, value: float | str) -> None:
    with pytest.raises(InputError, match=name):
        replace(SMALL, **{name: value})  # type: ignore[arg-type]


def test_an_unknown_preset_suggests_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match='Did you mean "fast"'):
        preset_named("fats")
    with pytest.raises(UnknownNameError, match='Did you mean "ppo"'):
        preset_named("fast", "poo")


def test_presets_are_valid_and_named() -> None:
    assert all(isinstance(config, DqnConfig) and config.preset == name for name, config in PRESETS.items())
