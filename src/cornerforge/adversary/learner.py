"""Double DQN: from a replay memory to weights. Knows no world, so whoever fills the memory can use it.

Deterministic: the same transitions added in the same order, the same seed and the same numbers of updates give the same
weights.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.adversary.config import TrainConfig
from cornerforge.adversary.replay import ReplayMemory
from cornerforge.errors import MissingExtraError
from cornerforge.sim.drive import Transitions

try:
    import torch

    from cornerforge.adversary.q_network import QNetwork, flat_weights
except ImportError as error:
    raise MissingExtraError("torch", "learn") from error

__all__ = ["DqnLearner", "below"]


class DqnLearner:
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

    def weights(self) -> NDArray[np.float32]:
        """A copy of the online network in the layout of `drivers.policy.PolicyNumbers`, float32 (n_weights,)."""
        return flat_weights(self.online)

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

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Both networks, what the optimiser remembers, and the replay memory, by name."""
        found = {f"replay.{name}": array for name, array in self.memory.state().items()}
        for kind, network in (("online", self.online), ("target", self._target)):
            found |= {f"{kind}.{name}": tensor.numpy() for name, tensor in network.state_dict().items()}
        for index, memory in self._optimiser.state_dict()["state"].items():
            tensors = {name: item for name, item in memory.items() if isinstance(item, torch.Tensor)}
            found |= {f"optimiser.{index}.{name}": tensor.numpy() for name, tensor in tensors.items()}
        return found

    def values(self) -> dict[str, Any]:
        """What is not an array, JSON-compatible."""
        return {"updates": self.updates, "place": self.memory.place, "rng": _plain(self._rng.bit_generator.state)}

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Take over what `arrays` and `values` gave."""
        self.memory.restore(below("replay", arrays), values["place"])
        for kind, network in (("online", self.online), ("target", self._target)):
            network.load_state_dict({name: torch.from_numpy(a) for name, a in below(kind, arrays).items()})
        memories: dict[int, dict[str, torch.Tensor]] = {}
        for name, array in below("optimiser", arrays).items():
            index, _, key = name.partition(".")
            # A copy in memory that PyTorch allocated: the file's may lie unaligned.
            memories.setdefault(int(index), {})[key] = torch.from_numpy(array).clone()
        self._optimiser.load_state_dict(self._optimiser.state_dict() | {"state": memories})
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
