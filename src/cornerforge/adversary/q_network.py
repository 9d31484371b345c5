"""The dueling Q-network in PyTorch (Wang et al. 2016; paper, Figure 1), for learning; acting is `drivers.policy`."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from cornerforge.drivers.policy import NetworkShape
from cornerforge.types import N_ACTIONS

__all__ = ["QNetwork", "flat_weights", "set_flat_weights"]


def _stack(n_in: int, n_layers: int, width: int) -> list[nn.Module]:
    layers: list[nn.Module] = []
    for k in range(n_layers):
        layers += [nn.Linear(n_in if k == 0 else width, width), nn.ReLU()]
    return layers


class QNetwork(nn.Module):
    """Q(s, a) = V(s) + A(s, a) - mean_a A(s, a)."""

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.shared = nn.Sequential(*_stack(shape.n_inputs, shape.n_shared, shape.width))
        self.value = nn.Sequential(*_stack(shape.width, shape.n_stream, shape.width), nn.Linear(shape.width, 1))
        self.advantage = nn.Sequential(
            *_stack(shape.width, shape.n_stream, shape.width), nn.Linear(shape.width, N_ACTIONS)
        )

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Q of all actions, float32 (batch, 33), for observations, float32 (batch, n_inputs)."""
        hidden = self.shared(observation)
        advantage = self.advantage(hidden)
        q: torch.Tensor = self.value(hidden) + advantage - advantage.mean(dim=1, keepdim=True)
        return q


def _linears(network: QNetwork) -> list[nn.Linear]:
    return [m for part in (network.shared, network.value, network.advantage) for m in part if isinstance(m, nn.Linear)]


def flat_weights(network: QNetwork) -> NDArray[np.float32]:
    """All weights in the layout of `drivers.policy.PolicyNumbers`, float32 (n_weights,)."""
    parts = []
    for layer in _linears(network):
        parts.append(layer.weight.detach().numpy().T.ravel())
        parts.append(layer.bias.detach().numpy())
    return np.concatenate(parts).astype(np.float32)


def set_flat_weights(network: QNetwork, flat: NDArray[np.float32]) -> None:
    """The inverse of `flat_weights`."""
    place = 0
    with torch.no_grad():
        for layer in _linears(network):
            n_out, n_in = layer.weight.shape
            layer.weight.copy_(torch.from_numpy(flat[place : place + n_in * n_out].reshape(n_in, n_out).T.copy()))
            place += n_in * n_out
            layer.bias.copy_(torch.from_numpy(flat[place : place + n_out].copy()))
            place += n_out
