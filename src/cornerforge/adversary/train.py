"""Training loop of the adversary: worlds act in compiled kernels on one core while PyTorch learns on the other.

Everything follows the number of decisions: acting uses the weights as they were when the iteration began, learning
uses the transitions of the iterations before. So the weights depend on seed and configuration only, not on speed or
threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.adversary.config import TrainConfig
from cornerforge.adversary.replay import ReplayMemory, allocate_transitions
from cornerforge.drivers.policy import PolicyNumbers
from cornerforge.errors import MissingExtraError
from cornerforge.sim.adversaries import ADVERSARIES, allocate_choice_scratch
from cornerforge.sim.drive import Setting, Transitions, collect, start_worlds
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.sim.step import allocate_pairs, allocate_recording
from cornerforge.sim.world import allocate_worlds
from cornerforge.types import N_ACTIONS

try:
    import torch

    from cornerforge.adversary.q_network import QNetwork, flat_weights
except ImportError as error:
    raise MissingExtraError("torch", "learn") from error

__all__ = ["TRAINING_TESTS", "CurvePoint", "TrainResult", "train_adversary"]

TRAINING_TESTS = 1 << 40
"""Number of the first training test; evaluation and generation use tests far from these."""
_POINT_EVERY = 50
"""Iterations between two points of the training curve."""


@dataclass(frozen=True)
class CurvePoint:
    """One point of the training curve, over the tests that ended since the point before (while exploring)."""

    decisions: int
    seconds: float
    updates: int
    epsilon: float
    loss: float | None
    tests: int
    crashes_per_test: float | None


@dataclass
class TrainResult:
    """What training gives: weights for `drivers.policy`, the curve, and totals."""

    weights: NDArray[np.float32]
    decisions: int
    updates: int
    seconds: float
    curve: list[CurvePoint] = field(default_factory=list)


class _Actor:
    """The worlds that produce transitions."""

    def __init__(self, setting: Setting, slots: int, n: int, seed: int) -> None:
        self._setting = setting
        self._seed = seed
        self._worlds = allocate_worlds(n, slots)
        self._tests = np.arange(TRAINING_TESTS, TRAINING_TESTS + n, dtype=np.int64)
        self._observation = np.zeros((n, N_OBSERVATION), dtype=np.float32)
        self._allowed = np.zeros((n, N_ACTIONS), dtype=np.bool_)
        self._pairs = allocate_pairs(slots)
        self._recording = allocate_recording(0, slots)
        self._scratch = allocate_choice_scratch(setting.policy)
        self.finished = np.zeros(3, dtype=np.int64)
        start_worlds(seed, self._tests, setting, self._worlds, self._scratch, self._observation, self._allowed)

    def act(self, weights: NDArray[np.float32], epsilon: float, out: Transitions) -> Transitions:
        """One decision of every world with the given weights; returns `out`."""
        setting = self._setting._replace(policy=self._setting.policy._replace(weights=weights))
        n = self._tests.size
        collect(
            self._seed,
            0,
            n,
            self._tests,
            epsilon,
            setting,
            self._worlds,
            self._pairs,
            self._scratch,
            self._recording,
            self._observation,
            self._allowed,
            out,
            self.finished,
        )
        return out


class _Learner:
    """Double DQN with a target network (van Hasselt et al. 2016); targets are cut to [-1, 1]."""

    def __init__(self, config: TrainConfig, seed: int) -> None:
        self._config = config
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            self.online = QNetwork(config.network)
            self._target = QNetwork(config.network)
        self._target.load_state_dict(self.online.state_dict())
        parameters = self.online.parameters()
        self._optimiser: torch.optim.Optimizer
        if config.optimiser == "adam":
            self._optimiser = torch.optim.Adam(parameters, lr=config.learning_rate, eps=1e-5, foreach=True)
        else:
            self._optimiser = torch.optim.SGD(parameters, lr=config.learning_rate)
        self._rng = np.random.Generator(np.random.Philox(seed))
        self.memory = ReplayMemory(config.replay_size)
        self.updates = 0

    def learn(self, n_updates: int, learning_rate: float) -> float:
        """Make so many gradient steps on replayed batches; returns the last loss."""
        for group in self._optimiser.param_groups:
            group["lr"] = learning_rate
        loss = 0.0
        for _ in range(n_updates):
            batch = self.memory.sample(self._rng.integers(0, self.memory.size, self._config.batch))
            loss = self._update(batch)
            self.updates += 1
            if self.updates % self._config.target_update == 0:
                self._target.load_state_dict(self.online.state_dict())
        return loss

    def _update(self, batch: Transitions) -> float:
        observation, action, reward, end, following, allowed = (torch.from_numpy(a) for a in batch)
        with torch.no_grad():
            masked = self.online(following).masked_fill(~allowed, -torch.inf)
            best = masked.argmax(dim=1, keepdim=True)
            value = self._target(following).gather(1, best).squeeze(1)
            goal = reward + self._config.discount * torch.where(end, torch.zeros_like(value), value)
            goal = goal.clamp(-1.0, 1.0)
        q = self.online(observation).gather(1, action.unsqueeze(1)).squeeze(1)
        loss = torch.nn.functional.smooth_l1_loss(q, goal)
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.online.parameters(), 10.0)
        self._optimiser.step()
        return float(loss.detach())


def _epsilon(config: TrainConfig, decisions: int) -> float:
    done = min(1.0, decisions / config.epsilon_decisions)
    return config.epsilon_start + (config.epsilon_end - config.epsilon_start) * done


def _learning_rate(config: TrainConfig, decisions: int) -> float:
    """Cosine from the first to the final rate over the planned decisions."""
    done = min(1.0, decisions / config.decisions)
    share = 0.5 * (1.0 + float(np.cos(np.pi * done)))
    return config.final_learning_rate + (config.learning_rate - config.final_learning_rate) * share


def train_adversary(
    setting: Setting,
    slots: int,
    config: TrainConfig,
    *,
    seed: int = 0,
    threads: int = 2,
    max_seconds: float | None = None,
    progress: Callable[[CurvePoint], None] | None = None,
) -> TrainResult:
    """Learn to make the AV crash by controlling the BV nearest to it (paper, equations 5 to 9).

    Args:
        setting: The run; its adversary and policy are replaced by the learning one, its mask (`bounded`) is used.
        slots: Vehicle slots per world.
        config: Hyperparameters; `config.decisions` says how long, rounded up to whole iterations.
        seed: Names tests, exploration, initial weights and replay draws.
        threads: 1 acts and learns by turns, more do both at once; the result is the same.
        max_seconds: Stop earlier after this time [s]; then the result depends on the machine's speed.
        progress: Called with each new point of the curve.

    Returns:
        Final weights and the training curve.
    """
    check_integer("seed", seed, low=0, high=2**63 - 1)
    n_torch = torch.get_num_threads()
    torch.set_num_threads(1)  # one core for learning: results do not depend on the machine's number of cores
    try:
        return _train(setting, slots, config, seed, threads, max_seconds, progress)
    finally:
        torch.set_num_threads(n_torch)


def _train(
    setting: Setting, slots: int, config: TrainConfig, seed: int, threads: int,
    max_seconds: float | None, progress: Callable[[CurvePoint], None] | None,
) -> TrainResult:  # fmt: skip
    start = time.perf_counter()
    learner = _Learner(config, seed)
    shape = config.network
    numbers = PolicyNumbers(flat_weights(learner.online), shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)
    actor = _Actor(setting._replace(adversary=ADVERSARIES["policy"], policy=numbers), slots, config.worlds, seed)
    buffer = allocate_transitions(config.worlds)
    result = TrainResult(numbers.weights, 0, 0, 0.0)
    updates = config.worlds // config.decisions_per_update
    seen = np.zeros(3, dtype=np.int64)
    loss: float | None = None
    iterations = -(-config.decisions // config.worlds)
    with ThreadPoolExecutor(1) as pool:
        for iteration in range(iterations):
            weights = flat_weights(learner.online)
            epsilon = _epsilon(config, result.decisions)
            acting = pool.submit(actor.act, weights, epsilon, buffer)
            if threads == 1:
                acting.result()
            if learner.memory.size >= config.replay_start:
                loss = learner.learn(updates, _learning_rate(config, result.decisions))
            learner.memory.add(acting.result())
            result.decisions += config.worlds
            result.seconds = time.perf_counter() - start
            last = iteration == iterations - 1 or (max_seconds is not None and result.seconds >= max_seconds)
            if last or (iteration + 1) % _POINT_EVERY == 0:
                tests, crashes = (int(n) for n in (actor.finished - seen)[:2])
                seen[:] = actor.finished
                rate = crashes / tests if tests else None
                point = CurvePoint(
                    result.decisions, round(result.seconds, 3), learner.updates, round(epsilon, 4), loss, tests, rate
                )
                result.curve.append(point)
                if progress is not None:
                    progress(point)
            if last:
                break
    result.weights = flat_weights(learner.online)
    result.updates = learner.updates
    return result
