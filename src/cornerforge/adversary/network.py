"""The dueling network in PyTorch (Wang et al. 2016; paper, Figure 1), for learning; acting is `drivers.policy`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from cornerforge.drivers.policy import NetworkShape, n_weights
from cornerforge.types import N_ACTIONS

__all__ = ["Network", "TrainableNetwork"]

_Layer = tuple[Tensor, Tensor]
_OPTIMISERS: Mapping[str, Any] = {
    "adam": lambda weights: torch.optim.Adam(weights, eps=1e-5, fused=True),
    "sgd": lambda weights: torch.optim.SGD(weights),
}


class Network:
    """V(s) + A(s, a) - mean_a A(s, a) of every action (paper, equation 9).

    Args:
        shape: The network.
        flat: All weights in the layout of `drivers.policy.PolicyNumbers`, float32 (n_weights,). The layers are views
            of it, so a change of it changes the network; a gradient of the layers adds to `flat.grad`.

    Raises:
        ValueError: So many weights do not fit the shape.
    """

    def __init__(self, shape: NetworkShape, flat: Tensor) -> None:
        if flat.shape != (n_weights(shape),):
            raise ValueError(f"{flat.numel()} weights do not fit {shape}")
        self.flat = flat
        self._place = 0
        wide = [shape.width] * shape.n_stream
        flat.grad = torch.zeros_like(flat)
        self._shared = self._layers([shape.n_inputs, *[shape.width] * shape.n_shared])
        self._value = self._layers([shape.width, *wide, 1])
        self._advantage = self._layers([shape.width, *wide, N_ACTIONS])

    def _layers(self, sizes: list[int]) -> list[_Layer]:
        """Make matrix (n_in, n_out) and bias (n_out,) of layers between these sizes, next in the flat layout."""
        return [(self._part(n_in, n_out), self._part(n_out)) for n_in, n_out in pairwise(sizes)]

    def _part(self, *size: int) -> Tensor:
        assert self.flat.grad is not None
        rows = slice(self._place, self._place + math.prod(size))
        self._place = rows.stop
        part = self.flat[rows].view(size).detach().requires_grad_()
        part.grad = self.flat.grad[rows].view(size)
        return part

    def draw(self, seed: int) -> None:
        """Draw weights: uniform in +-1 / sqrt(inputs of the layer)."""
        rng = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            for matrix, bias in (*self._shared, *self._value, *self._advantage):
                reach = 1.0 / math.sqrt(matrix.shape[0])
                matrix.uniform_(-reach, reach, generator=rng)
                bias.uniform_(-reach, reach, generator=rng)

    def __call__(self, observation: Tensor) -> Tensor:
        """Compute the values of all actions, float32 (B, 33), for observations, float32 (B, n_inputs)."""
        hidden = _through(self._shared, observation).relu_()
        advantage = _through(self._advantage, hidden)
        return _through(self._value, hidden) + (advantage - advantage.mean(dim=1, keepdim=True))


def _through(layers: list[_Layer], x: Tensor) -> Tensor:
    """Apply layers, with a ReLU between two."""
    for k, (matrix, bias) in enumerate(layers):
        x = torch.addmm(bias, x if k == 0 else x.relu_(), matrix)
    return x


class TrainableNetwork(Network):
    """A network with the optimiser that changes it.

    Args:
        shape: The network.
        seed: Of its first weights.
        optimiser: "adam" or "sgd".
        largest_norm: A gradient is cut to this Euclidean length.
    """

    def __init__(self, shape: NetworkShape, seed: int, optimiser: str, largest_norm: float) -> None:
        super().__init__(shape, torch.empty(n_weights(shape)))
        self.draw(seed)
        self._optimiser = _OPTIMISERS[optimiser]([self.flat])
        self._largest_norm = largest_norm

    def descend(self, loss: Tensor, learning_rate: float) -> None:
        """Make one step against the gradient of a loss."""
        assert self.flat.grad is not None
        self.flat.grad.zero_()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_([self.flat], self._largest_norm)
        self._optimiser.param_groups[0]["lr"] = learning_rate
        self._optimiser.step()

    def weights(self) -> NDArray[np.float32]:
        """Copy the weights, float32 (n_weights,)."""
        copy: NDArray[np.float32] = self.flat.numpy().copy()
        return copy

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give weights and the optimiser's state, by name; views."""
        state = self._optimiser.state[self.flat]
        return {"weights": self.flat.numpy()} | {f"optimiser.{name}": part.numpy() for name, part in state.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` gave.

        Raises:
            KeyError, ValueError: Something is missing or does not fit.
        """
        for name, array in arrays.items():
            if array.shape not in (self.flat.shape, ()):
                raise ValueError(f"{name} has shape {array.shape}, not {tuple(self.flat.shape)}")
        self.flat.copy_(torch.from_numpy(arrays["weights"]))
        self._optimiser.state[self.flat] = {
            name.removeprefix("optimiser."): torch.tensor(array) for name, array in arrays.items() if name != "weights"
        }
