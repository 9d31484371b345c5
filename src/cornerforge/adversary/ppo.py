"""Proximal policy optimisation (Schulman et al. 2017), all of it: hyperparameters, preset and learner.

The network is the DQN's with another meaning: its values, up to a number that is the same for all actions, are the
logits of the policy, and their mean is the value of the state.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from cornerforge._schema import Share, meant
from cornerforge.adversary.config import TrainConfig
from cornerforge.adversary.learner import below
from cornerforge.adversary.network import TrainableNetwork
from cornerforge.adversary.replay import allocate_transitions
from cornerforge.adversary.worlds import Exploring, Transitions
from cornerforge.drivers.policy import numbers_of_network
from cornerforge.sim import controllers

__all__ = ["PRESETS", "PpoConfig", "PpoLearner", "make_learner"]

_FORBIDDEN = -1e9
"""Logit of an action that the mask forbids."""


class PpoConfig(TrainConfig):
    """Hyperparameters of PPO.

    A round begins when each world has made `rollout` decisions: `epochs` times over these, in batches of `batch`.
    Advantages are sums over later decisions, which `trace` weights (lambda of generalised advantage estimation). The
    odds of an action count up to a change by `clip`. The loss is that of the policy, plus `value_weight` times the
    squared error of the state's value, minus `entropy_weight` times the policy's entropy [nats].

    Raises:
        InputError: A value is out of range.
    """

    head: ClassVar[str] = "softmax"

    learner: str = "ppo"
    rollout: Annotated[int, meant("Decisions of a world in a round.", "", 1, 10**6)]
    epochs: Annotated[int, meant("Times over these.", "", 1, 10**6)]
    batch: Annotated[int, meant("Decisions of a batch.", "", 1, 10**6)]
    trace: Share
    clip: Share
    value_weight: Annotated[float, meant("Of the value's squared error.", "", 0.0, 1e3)]
    entropy_weight: Annotated[float, meant("Of the entropy.", "", 0.0, 1e3)]
    largest_norm: Annotated[float, meant("Of a gradient; longer ones are cut.", "", 0.0, 1e3)]


PRESETS = {
    "fast": PpoConfig(
        preset="fast",
        learning_rate=1e-3,
        final_learning_rate=5e-5,
        worlds=512,
        decisions=3_000_000,
        n_shared=2,
        n_stream=1,
        width=64,
        rollout=32,
        epochs=4,
        batch=2048,
        trace=0.95,
        clip=0.2,
        value_weight=0.5,
        entropy_weight=0.005,
        largest_norm=0.5,
    )
}


class PpoLearner:
    """PPO with a clipped objective; see `learner.Learner`.

    Args:
        config: Hyperparameters.
        seed: Seed of the initial weights and of the order of batches.

    Attributes:
        updates: Gradient steps so far.
        network: The network that learns, and acts.
    """

    def __init__(self, config: PpoConfig, seed: int) -> None:
        self._config, self._seed = config, seed
        self.network = TrainableNetwork(config.network, seed, "adam", config.largest_norm)
        self.updates = 0
        self._loss: float | None = None
        self._entropy: float | None = None
        self._noted = 0
        rows = allocate_transitions(config.rollout * config.worlds, config.network.n_inputs)
        self._rows = rows._replace(
            next_observation=rows.next_observation[: config.worlds], next_allowed=rows.next_allowed[:0]
        )

    def exploring(self, decisions: int) -> Exploring:  # noqa: ARG002  (it always explores alike)
        """Give the policy, which draws its actions."""
        numbers = numbers_of_network(self.network.weights(), self._config.network, self._config.head)
        return Exploring(controllers.POLICY, numbers, 0.0, 0, 0.0)

    def note(self, batch: Transitions) -> None:
        """Keep one decision of each world until the round."""
        begin = self._noted * self._config.worlds
        for name in ("observation", "allowed", "action", "log_prob", "reward", "end"):
            getattr(self._rows, name)[begin : begin + self._config.worlds] = getattr(batch, name)
        self._rows.next_observation[:] = batch.next_observation
        self._noted += 1

    def learn(self, learning_rate: float) -> None:
        """Make the steps of a round, if one is due."""
        if self._noted == self._config.rollout:
            self._round(learning_rate)
            self._noted = 0

    def _round(self, learning_rate: float) -> None:
        config, rows = self._config, self._rows
        advantage, value = self._advantages()
        observation, allowed = torch.from_numpy(rows.observation), torch.from_numpy(rows.allowed)
        action, log_prob = torch.from_numpy(rows.action), torch.from_numpy(rows.log_prob)
        for _ in range(config.epochs):
            # A function of seed and update, not a stream: nothing of it must be kept.
            rng = np.random.Generator(np.random.Philox(key=self._seed, counter=self.updates << 64))
            order = torch.from_numpy(rng.permutation(len(action)))
            for part in torch.split(order, config.batch):
                self._step(
                    observation[part], allowed[part], action[part], log_prob[part], advantage[part], value[part],
                    learning_rate,
                )  # fmt: skip

    def _step(
        self, observation: Tensor, allowed: Tensor, action: Tensor, log_prob: Tensor, advantage: Tensor, value: Tensor,
        learning_rate: float,
    ) -> None:  # fmt: skip
        """Make one step on a batch; `log_prob` is that of the policy that acted, `value` what is to be learnt."""
        config = self._config
        values = self.network(observation)
        log_probs = values.masked_fill(~allowed, _FORBIDDEN).log_softmax(dim=1)
        ratio = (log_probs.gather(1, action.unsqueeze(1)).squeeze(1) - log_prob).exp()
        gain = torch.minimum(ratio * advantage, ratio.clamp(1.0 - config.clip, 1.0 + config.clip) * advantage).mean()
        error = (values.mean(dim=1) - value).square().mean()
        entropy = -(log_probs.exp() * log_probs).sum(dim=1).mean()
        loss = config.value_weight * error - gain - config.entropy_weight * entropy
        self.network.descend(loss, learning_rate)
        self.updates += 1
        self._loss, self._entropy = loss.item(), entropy.item()

    def _advantages(self) -> tuple[Tensor, Tensor]:
        """Estimate how much better each decision was than the policy's mean, standardised, and what the state is worth.

        Returns:
            Both float32 (rollout * worlds,).
        """
        config, rows = self._config, self._rows
        with torch.no_grad():
            seen = torch.from_numpy(np.concatenate([rows.observation, rows.next_observation]))
            value = self.network(seen).mean(dim=1).numpy().reshape(config.rollout + 1, config.worlds)
        reward, goes_on = (part.reshape(config.rollout, config.worlds) for part in (rows.reward, ~rows.end))
        error = reward + config.discount * goes_on * value[1:] - value[:-1]
        for k in range(config.rollout - 2, -1, -1):
            error[k] += config.discount * config.trace * goes_on[k] * error[k + 1]
        goal = torch.from_numpy((error + value[:-1]).astype(np.float32).ravel())
        advantage = torch.from_numpy(error.astype(np.float32).ravel())
        return (advantage - advantage.mean()) / (advantage.std() + 1e-8), goal

    def point(self, decisions: int) -> dict[str, float | None]:  # noqa: ARG002
        """Give loss and entropy of the last batch; no decision is drawn uniformly."""
        return {"loss": self._loss, "epsilon": None, "entropy": self._entropy}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give the network, the optimiser's state, and what was noted since the last round, by name; views."""
        noted = {f"rows.{name}": array for name, array in self._rows._asdict().items()}
        return noted | {f"network.{name}": array for name, array in self.network.arrays().items()}

    def values(self) -> dict[str, Any]:
        """Give the part of the state that is not in arrays, JSON-compatible."""
        return {"updates": self.updates, "noted": self._noted, "loss": self._loss, "entropy": self._entropy}

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Restore the state that `arrays` and `values` gave.

        Raises:
            KeyError, ValueError: Something is missing or does not fit.
        """
        for name, ours in self._rows._asdict().items():
            ours[...] = arrays[f"rows.{name}"]
        self.network.restore(below("network", arrays))
        self.updates, self._noted = values["updates"], values["noted"]
        self._loss, self._entropy = values["loss"], values["entropy"]


make_learner = PpoLearner
