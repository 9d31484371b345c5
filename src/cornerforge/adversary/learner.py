"""Double DQN: it learns weights from a replay memory and is independent of the worlds that fill it.

Deterministic: the same transitions added in the same order, the same seed and the same numbers of updates give the same
weights.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.adversary.config import TrainConfig
from cornerforge.adversary.replay import BalancedMemory
from cornerforge.errors import MissingExtraError

try:
    import torch

    from cornerforge.adversary.dueling import Adam, DuelingNet, Pass, Sgd
    from cornerforge.adversary.q_network import QNetwork, flat_weights
except ImportError as error:
    raise MissingExtraError("torch", "learn") from error

__all__ = ["DqnLearner", "below"]

_LARGEST_NORM = 10.0
"""Gradients are cut to this Euclidean length."""


class DqnLearner:
    """Double DQN with a target network (van Hasselt et al. 2016); targets are cut to [-1, 1].

    PyTorch should be set to one thread by the caller: more gain nothing on networks this small, and results would
    depend on how many there are.

    Args:
        config: Hyperparameters; the network's inputs decide how long an observation is.
        seed: Seed of the initial weights and of the draws from the memory.

    Attributes:
        memory: Add transitions here.
        updates: Gradient steps so far.
    """

    def __init__(self, config: TrainConfig, seed: int) -> None:
        self._config = config
        shape = config.network
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            weights = torch.from_numpy(flat_weights(QNetwork(shape)))
        self._online = DuelingNet(shape, weights)
        self._target = DuelingNet(shape, weights.clone())
        self._gradient = DuelingNet(shape, torch.zeros_like(weights))
        self._optimiser = (Adam if config.optimiser == "adam" else Sgd)(weights.numel())
        self._rng = np.random.Generator(np.random.Philox(seed))
        self.memory = BalancedMemory(config.replay_size, shape.n_inputs, config.paid_share)
        self.updates = 0
        self._now, self._online_next, self._target_next = (Pass(shape, config.batch) for _ in range(3))
        self._slope = torch.zeros_like(self._now.q)
        self._batch = self.memory.room(config.batch)
        self._tensors = tuple(torch.from_numpy(array) for array in self._batch)

    def weights(self) -> NDArray[np.float32]:
        """A copy of the online network in the layout of `drivers.policy.PolicyNumbers`, float32 (n_weights,)."""
        copy: NDArray[np.float32] = self._online.flat.numpy().copy()
        return copy

    def q(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Q of all actions as the online network has it, float32 (B, 33), for float32 (B, n_inputs)."""
        room = Pass(self._online.shape, len(observation))
        values: NDArray[np.float32] = room.forward(self._online, torch.from_numpy(observation)).numpy()
        return values

    def learn(self, n_updates: int, learning_rate: float) -> float:
        """Make a number of gradient steps on replayed batches; returns the last loss (0 for no step).

        The memory must hold at least one transition.
        """
        loss = 0.0
        for k in range(n_updates):
            self.memory.draw(self._rng, self._batch)
            cut, apart = self._differentiate()
            if k == n_updates - 1:
                loss = float((cut * (apart - 0.5 * cut)).mean())  # Huber's
            self._optimiser.step(self._online.flat, self._gradient.flat, learning_rate)
            self.updates += 1
            if self.updates % self._config.target_update == 0:
                self._target.flat.copy_(self._online.flat)
        return loss

    def _differentiate(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Gradient of the Huber loss on the drawn batch, cut to its longest; also the errors cut to 1, and uncut."""
        observation, action, reward, end, following, allowed = self._tensors
        masked = self._online_next.forward(self._online, following).masked_fill_(~allowed, -torch.inf)
        best = masked.argmax(dim=1, keepdim=True)
        value = self._target_next.forward(self._target, following).gather(1, best).squeeze(1).masked_fill_(end, 0.0)
        goal = value.mul_(self._config.discount).add_(reward).clamp_(-1.0, 1.0)
        column = action.unsqueeze(1)
        apart = self._now.forward(self._online, observation).gather(1, column).squeeze(1).sub_(goal)
        cut = apart.clamp(-1.0, 1.0)
        self._slope.zero_().scatter_(1, column, (cut / len(cut)).unsqueeze(1))
        self._now.backward(self._online, self._slope, self._gradient)
        gradient = self._gradient.flat
        gradient.mul_((_LARGEST_NORM / (torch.linalg.vector_norm(gradient) + 1e-6)).clamp_(max=1.0))
        return cut, apart

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give both networks, the optimiser's state and the replay memory, by name; views."""
        found = {f"replay.{name}": array for name, array in self.memory.state().items()}
        found |= {"online": self._online.flat.numpy(), "target": self._target.flat.numpy()}
        return found | {f"optimiser.{name}": tensor.numpy() for name, tensor in self._optimiser.arrays().items()}

    def values(self) -> dict[str, Any]:
        """Give the part of the state that is not in arrays, JSON-compatible."""
        return {
            "updates": self.updates,
            "steps": self._optimiser.steps,
            "places": self.memory.places,
            "rng": _plain(self._rng.bit_generator.state),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Restore the state that `arrays` and `values` gave.

        Raises:
            KeyError, ValueError: Something is missing or does not fit.
        """
        self.memory.restore(below("replay", arrays), values["places"])
        for name, ours in self.arrays().items():
            if not name.startswith("replay."):
                if arrays[name].shape != ours.shape:
                    raise ValueError(f"{name} has shape {arrays[name].shape}, not {ours.shape}")
                ours[...] = arrays[name]
        self._optimiser.steps = values["steps"]
        self._rng.bit_generator.state = _unplain(values["rng"])
        self.updates = values["updates"]


def below(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays whose name begins with `prefix.`, without it."""
    return {name.removeprefix(f"{prefix}."): a for name, a in arrays.items() if name.startswith(f"{prefix}.")}


def _plain(state: Any) -> Any:
    """A state of NumPy's Philox with lists of whole numbers for its arrays of uint64."""
    if isinstance(state, dict):
        return {key: _plain(value) for key, value in state.items()}
    return state.tolist() if isinstance(state, np.ndarray) else state


def _unplain(state: Any) -> Any:
    """The inverse of `_plain`."""
    if isinstance(state, dict):
        return {key: _unplain(value) for key, value in state.items()}
    return np.array(state, dtype=np.uint64) if isinstance(state, list) else state
