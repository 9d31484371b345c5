"""Dueling double DQN: Q of a network from a replay memory (van Hasselt et al. 2016; Wang et al. 2016; the paper's)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import smooth_l1_loss

from cornerforge.adversary.config import PRESETS, DqnConfig
from cornerforge.adversary.learner import below
from cornerforge.adversary.network import Network, TrainableNetwork
from cornerforge.adversary.replay import KEPT, BalancedMemory
from cornerforge.adversary.worlds import Exploring, Transitions
from cornerforge.drivers.policy import numbers_of_network
from cornerforge.sim import controllers, observe

__all__ = ["PRESETS", "DqnLearner", "make_learner"]

_LARGEST_NORM = 10.0
"""Gradients are cut to this Euclidean length."""


class DqnLearner:
    """Double DQN with a target network, on batches from a replay memory; see `learner.Learner`.

    Args:
        config: Hyperparameters; the network's inputs decide how long an observation is.
        seed: Seed of the initial weights and of the draws from the memory.

    Attributes:
        memory: The transitions noted so far.
        updates: Gradient steps so far.
        network: The network that learns, and acts.
    """

    def __init__(self, config: DqnConfig, seed: int) -> None:
        self._config, self._seed = config, seed
        shape = config.network
        self.network = TrainableNetwork(shape, seed, config.optimiser, _LARGEST_NORM)
        self._target = Network(shape, self.network.flat.clone())
        self.memory = BalancedMemory(config.replay_size, shape.n_inputs, config.paid_share)
        self.updates = 0
        self._loss: float | None = None
        self._batch = self.memory.room(config.batch)
        self._tensors = {name: torch.from_numpy(getattr(self._batch, name)) for name in KEPT}

    def exploring(self, decisions: int) -> Exploring:
        """Give the greedy policy, and the chance of exploring, which falls in a straight line."""
        config = self._config
        numbers = numbers_of_network(self.network.weights(), config.network, config.head)
        guided = round(config.guided * config.worlds)
        richer = round(config.richer * observe.UNITS_PER_NAT)
        return Exploring(controllers.POLICY, numbers, self._epsilon(decisions), guided, config.guided_epsilon, richer)

    def _epsilon(self, decisions: int) -> float:
        config = self._config
        done = min(1.0, decisions / config.epsilon_decisions)
        return config.epsilon_start + (config.epsilon_end - config.epsilon_start) * done

    def note(self, batch: Transitions) -> None:
        """Add transitions to the memory."""
        self.memory.add(batch)

    def learn(self, learning_rate: float) -> None:
        """Make the steps that go with one decision of each world, as soon as the memory holds enough."""
        if self.memory.recent.size >= self._config.replay_start:
            self.descend(self._config.worlds // self._config.decisions_per_update, learning_rate)

    def descend(self, n_updates: int, learning_rate: float) -> None:
        """Make a number of gradient steps on replayed batches; the memory must hold at least one transition."""
        for k in range(n_updates):
            # A function of seed and update, not a stream: nothing of it must be kept.
            rng = np.random.Generator(np.random.Philox(key=self._seed, counter=self.updates << 64))
            self.memory.draw(rng, self._batch)
            loss = self._loss_of_batch()
            self.network.descend(loss, learning_rate)
            self.updates += 1
            if self.updates % self._config.target_update == 0:
                self._target.flat.copy_(self.network.flat)
            if k == n_updates - 1:
                self._loss = loss.item()

    def _loss_of_batch(self) -> torch.Tensor:
        """Compute Huber's loss on the drawn batch."""
        t = self._tensors
        with torch.no_grad():
            following = t["next_observation"]
            masked = self.network(following).masked_fill_(~t["next_allowed"], -torch.inf)
            best = masked.argmax(dim=1, keepdim=True)
            value = self._target(following).gather(1, best).squeeze(1).masked_fill_(t["end"], 0.0)
            limit = self._config.target_limit
            goal = value.mul_(self._config.discount).add_(t["reward"]).clamp_(-limit, limit)
        q = self.network(t["observation"]).gather(1, t["action"].unsqueeze(1)).squeeze(1)
        return smooth_l1_loss(q, goal)

    def point(self, decisions: int) -> dict[str, float | None]:
        """Give the last loss and the chance of exploring."""
        return {"loss": self._loss, "epsilon": round(self._epsilon(decisions), 4)}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give both networks, the optimiser's state and the replay memory, by name; views."""
        found = {f"replay.{name}": array for name, array in self.memory.state().items()}
        found |= {f"network.{name}": array for name, array in self.network.arrays().items()}
        return found | {"target": self._target.flat.numpy()}

    def values(self) -> dict[str, Any]:
        """Give the part of the state that is not in arrays, JSON-compatible."""
        return {"updates": self.updates, "loss": self._loss, "places": self.memory.places}

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Restore the state that `arrays` and `values` gave.

        Raises:
            KeyError, ValueError: Something is missing or does not fit.
        """
        self.memory.restore(below("replay", arrays), values["places"])
        self.network.restore(below("network", arrays))
        self._target.flat.copy_(torch.from_numpy(arrays["target"]))
        self.updates, self._loss = values["updates"], values["loss"]


make_learner = DqnLearner
