"""A real client: Stable-Baselines3 learns in both environments, and what it learnt acts in our kernels."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from sb3_contrib import MaskablePPO
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from cornerforge import simulate
from cornerforge.drivers.policy import allocate_scratch, q_values
from cornerforge.envs.sb3 import policy_of_sb3
from cornerforge.errors import InputError
from cornerforge.experiment.policy_file import load_policy, policy_numbers, save_policy
from cornerforge.ext.gym import ADVERSARY_ID, DRIVING_ID
from cornerforge.sim.observe import N_OBSERVATION


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("name", [ADVERSARY_ID, DRIVING_ID])
def test_its_own_checker_has_no_complaint(name: str) -> None:
    """Warnings are errors here; it advises to flatten what the AV sees, which `MlpPolicy` does by itself."""
    check_env(gymnasium.wrappers.FlattenObservation(gymnasium.make(name).unwrapped))


@pytest.mark.full
@pytest.mark.parametrize("name", [ADVERSARY_ID, DRIVING_ID])
def test_dqn_learns(name: str) -> None:
    env = gymnasium.make(name)
    model = DQN("MlpPolicy", env, seed=0, learning_starts=200)
    before = [parameter.detach().clone() for parameter in model.q_net.parameters()]
    model.learn(2000)
    assert model.num_timesteps == 2000
    after = list(model.q_net.parameters())
    assert all(torch.isfinite(parameter).all() for parameter in after)
    assert all((a != b).any() for a, b in zip(before, after, strict=True))
    buffer = model.ep_info_buffer
    assert buffer is not None
    returns = [float(episode["r"]) for episode in buffer]
    assert len(returns) >= 5
    assert all(-1.0 <= r <= 1.1 for r in returns)
    assert len(set(returns)) > 1
    observation, _ = env.reset(seed=1)
    action, _ = model.predict(observation, deterministic=True)
    assert env.action_space.contains(action[()])


@pytest.fixture(scope="module")
def small_dqn() -> DQN:
    """Hardly trained."""
    model = DQN(
        "MlpPolicy", gymnasium.make(ADVERSARY_ID), seed=1, learning_starts=50, policy_kwargs={"net_arch": [24, 24, 24]}
    )
    return model.learn(200)


@pytest.mark.full
def test_the_policy_file_has_the_networks_values(small_dqn: DQN, tmp_path: Path, seed: int) -> None:
    path = tmp_path / "dqn.safetensors"
    save_policy(policy_of_sb3(small_dqn, bounded=True), path)
    policy = load_policy(path)
    assert policy.bounded
    assert policy.about["decisions"] == 200
    numbers = policy_numbers(policy)
    observations = np.random.default_rng(seed).normal(size=(50, N_OBSERVATION)).astype(np.float32)
    with torch.no_grad():
        theirs = small_dqn.q_net(torch.from_numpy(observations)).numpy()
    ours = np.zeros((50, 33), dtype=np.float32)
    for k in range(50):
        q_values(numbers, observations[k], allocate_scratch(numbers), ours[k])
    assert np.ptp(theirs, axis=0).min() > 0.01, "the values hardly depend on what is seen"
    np.testing.assert_allclose(ours, theirs, atol=1e-5)


def test_the_policy_file_drives(small_dqn: DQN, tmp_path: Path) -> None:
    path = tmp_path / "dqn.safetensors"
    save_policy(policy_of_sb3(small_dqn), path)
    driven = simulate(bv=str(path), tests=64)
    assert driven.tests == 64
    assert driven.digest != simulate(bv="nde", tests=64).digest


@pytest.mark.full
@pytest.mark.parametrize("name", ["PPO", "MaskablePPO"])
def test_a_policy_gradient_acts_by_the_same_probabilities(name: str, tmp_path: Path, seed: int) -> None:
    """On 1,000 observations of tests that random allowed actions drove."""
    masks = name == "MaskablePPO"
    learner: Any = MaskablePPO if masks else PPO
    env = gymnasium.make(ADVERSARY_ID, bounded=True)
    network = {"activation_fn": torch.nn.ReLU, "net_arch": [48, 48]}
    model = learner("MlpPolicy", env, n_steps=256, learning_rate=1e-2, policy_kwargs=network, seed=1, device="cpu")
    model.learn(512)
    path = tmp_path / "ppo.safetensors"
    save_policy(policy_of_sb3(model, bounded=True), path)
    policy = load_policy(path)
    assert (policy.head, policy.about["made_by"]) == ("softmax", f"stable-baselines3 {name}")
    numbers, scratch = policy_numbers(policy), allocate_scratch(policy_numbers(policy))
    seen, info = env.reset(seed=seed % 2**31)
    env.action_space.seed(seed % 2**31)
    theirs, ours = np.zeros((1000, 33)), np.zeros((1000, 33), dtype=np.float32)
    allowed = np.zeros((1000, 33), dtype=np.bool_)
    for k in range(1000):
        allowed[k] = info["action_mask"]
        given = {"action_masks": allowed[k]} if masks else {}
        with torch.no_grad():
            drawn: Any = model.policy.get_distribution(torch.from_numpy(seen[None]), **given)
        theirs[k] = drawn.distribution.probs.numpy()
        q_values(numbers, seen, scratch, ours[k])
        seen, _, ended, cut, info = env.step(env.action_space.sample(mask=info["action_mask"]))
        if ended or cut:
            seen, info = env.reset()
    odds = np.exp(ours.astype(np.float64) - ours.max(axis=1, keepdims=True))
    if masks:
        assert theirs[~allowed].max() < 1e-12
        odds[~allowed] = 0.0
    assert not allowed.all()
    assert np.ptp(theirs[allowed]) > 0.01, "it hardly depends on what is seen"
    np.testing.assert_allclose(odds / odds.sum(axis=1, keepdims=True), theirs, atol=1e-5)
    drawn, greedy = (simulate(bv=str(path), tests=64, acting=acting).digest for acting in ("learned", "greedy"))
    assert drawn != greedy


def test_networks_of_another_kind_are_named() -> None:
    env = gymnasium.make(ADVERSARY_ID)

    def dqn(where: Any = env, **network: Any) -> DQN:
        return DQN("MlpPolicy", where, policy_kwargs=network, buffer_size=10)

    normalised = dqn(VecNormalize(DummyVecEnv([lambda: env])))
    for model, message in (
        (PPO("MlpPolicy", env, device="cpu"), r"ReLU between them. Train with policy_kwargs"),
        (SAC("MlpPolicy", gymnasium.make(DRIVING_ID, actions="box"), buffer_size=10), "SAC is no DQN, PPO or Maskable"),
        (normalised, "normalised observations"),
        (dqn(net_arch=[32, 16]), "hidden layers of one width"),
        (dqn(net_arch=[]), "layers are"),
        (dqn(activation_fn=torch.nn.Tanh), "ReLU between them"),
        (dqn(gymnasium.make(DRIVING_ID)), f"from {N_OBSERVATION} observations"),
        ("model.zip", "str is no DQN, PPO or MaskablePPO"),
    ):
        with pytest.raises(InputError, match=message):
            policy_of_sb3(model)
    with torch.no_grad():
        broken = dqn()
        next(iter(broken.q_net.parameters()))[0, 0] = torch.nan
    with pytest.raises(InputError, match="not finite"):
        policy_of_sb3(broken)


@pytest.mark.full
def test_the_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "agent.safetensors"
    example = Path(__file__).parents[2] / "examples" / "train_sb3.py"
    monkeypatch.setattr(sys, "argv", [str(example), "1200", str(path)])
    runpy.run_path(str(example), run_name="__main__")
    assert load_policy(path).about["decisions"] == 1200
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == ["agent", "uniform", "swerve"]


@pytest.mark.slow
def test_dqn_learns_to_make_the_av_crash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The example at its full length beats random actions beyond doubt.

    H0: it crashes the AV no more often than uniform actions (0.03 per test). The unit is the test, n = 2000 each; the
    exact 95 % intervals must lie apart by a factor 2. Measured: 0.31 against 0.03.
    """
    example = Path(__file__).parents[2] / "examples" / "train_sb3.py"
    path = tmp_path / "agent.safetensors"
    monkeypatch.setattr(sys, "argv", [str(example), "60000", str(path)])
    runpy.run_path(str(example), run_name="__main__")
    capsys.readouterr()
    low = simulate(bv=str(path), tests=2000, seed=1).interval95[0]
    high = simulate(bv="uniform", tests=2000, seed=1).interval95[1]
    assert low > 2.0 * high
