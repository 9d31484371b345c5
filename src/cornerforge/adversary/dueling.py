"""The dueling network with its derivative written out, over one flat weight vector.

PyTorch's own autograd, optimiser and gradient clipping spend more time in bookkeeping than in arithmetic on networks
this small (measured at width 64 and batch 512: 6.7 ms an update against 2). Here PyTorch only multiplies matrices.
Tests compare values, gradients and Adam steps with those of `q_network.QNetwork` by autograd.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from cornerforge.drivers.policy import NetworkShape, n_weights
from cornerforge.types import N_ACTIONS

__all__ = ["Adam", "DuelingNet", "Pass", "Sgd"]

_Layer = tuple[Tensor, Tensor]


class DuelingNet:
    """Q(s, a) = V(s) + A(s, a) - mean_a A(s, a) (Wang et al. 2016; paper, equation 9).

    Args:
        shape: The network.
        flat: Where its weights lie, in the layout of `drivers.policy.PolicyNumbers`, float32 (n_weights,); it is not
            copied, so a change of it changes the network.
    """

    def __init__(self, shape: NetworkShape, flat: Tensor) -> None:
        self.shape = shape
        self.flat = flat
        places = _layers(shape, flat)
        self.shared = [next(places) for _ in range(shape.n_shared)]
        self.value = [next(places) for _ in range(shape.n_stream + 1)]
        self.advantage = [next(places) for _ in range(shape.n_stream + 1)]


def _layers(shape: NetworkShape, flat: Tensor) -> Iterator[_Layer]:
    """Views of matrix (n_in, n_out) and bias (n_out,) of each layer, in the order of the flat layout."""
    width = shape.width
    sizes = [(shape.n_inputs, width)] + [(width, width)] * (shape.n_shared - 1)
    for n_out in (1, N_ACTIONS):
        sizes += [(width, width)] * shape.n_stream + [(width, n_out)]
    if flat.shape != (n_weights(shape),):
        raise ValueError(f"{flat.numel()} weights do not fit {shape}")
    place = 0
    for n_in, n_out in sizes:
        end = place + n_in * n_out
        yield flat[place:end].view(n_in, n_out), flat[end : end + n_out]
        place = end + n_out


class Pass:
    """Arrays for one forward pass of `rows` observations, and for the backward pass that may follow it."""

    def __init__(self, shape: NetworkShape, rows: int) -> None:
        self._input = torch.empty(0)
        self._shared = [torch.empty(rows, shape.width) for _ in range(shape.n_shared)]
        self._value = [torch.empty(rows, shape.width) for _ in range(shape.n_stream)] + [torch.empty(rows, 1)]
        self._advantage = [torch.empty(rows, shape.width) for _ in range(shape.n_stream)]
        self._advantage.append(torch.empty(rows, N_ACTIONS))
        self._deltas = [torch.empty(rows, shape.width) for _ in range(2)]
        self.q = torch.empty(rows, N_ACTIONS)

    def forward(self, net: DuelingNet, observation: Tensor) -> Tensor:
        """Q of all actions, float32 (rows, 33), for observations, float32 (rows, n_inputs); overwritten next time."""
        self._input = observation
        hidden = _run(net.shared, observation, self._shared, last_is_linear=False)
        value = _run(net.value, hidden, self._value, last_is_linear=True)
        advantage = _run(net.advantage, hidden, self._advantage, last_is_linear=True)
        torch.sub(advantage, advantage.mean(dim=1, keepdim=True), out=self.q)
        return self.q.add_(value)

    def backward(self, net: DuelingNet, slope: Tensor, gradient: DuelingNet) -> None:
        """Write the derivative of sum(slope * q) of the last `forward` by all weights into `gradient`.

        Args:
            net: The network of that pass, its weights unchanged since.
            slope: float32 (rows, 33).
            gradient: Of the same shape; overwritten.
        """
        hidden = self._shared[-1]
        by_value = slope.sum(dim=1, keepdim=True)
        by_advantage = slope - by_value / N_ACTIONS
        delta = self._back(net.value, hidden, self._value, by_value, gradient.value, self._deltas[0])
        delta += self._back(net.advantage, hidden, self._advantage, by_advantage, gradient.advantage, self._deltas[1])
        _cut_where_off(delta, hidden)
        for k in range(len(net.shared) - 1, -1, -1):
            source = self._shared[k - 1] if k > 0 else self._input
            _slopes_of_layer(source, delta, gradient.shared[k])
            if k > 0:
                delta = torch.mm(delta, net.shared[k][0].t())
                _cut_where_off(delta, source)

    def _back(
        self, layers: list[_Layer], hidden: Tensor, made: list[Tensor], delta: Tensor, into: list[_Layer], out: Tensor
    ) -> Tensor:  # fmt: skip
        """Write the slope at the input of a stream (value or advantage) into `out`."""
        for k in range(len(layers) - 1, 0, -1):
            _slopes_of_layer(made[k - 1], delta, into[k])
            delta = torch.mm(delta, layers[k][0].t())
            _cut_where_off(delta, made[k - 1])
        _slopes_of_layer(hidden, delta, into[0])
        return torch.mm(delta, layers[0][0].t(), out=out)


def _run(layers: list[_Layer], given: Tensor, made: list[Tensor], *, last_is_linear: bool) -> Tensor:
    last = len(layers) - 1
    for k, (matrix, bias) in enumerate(layers):
        given = torch.addmm(bias, given, matrix, out=made[k])
        if k < last or not last_is_linear:
            given.relu_()
    return given


def _slopes_of_layer(given: Tensor, delta: Tensor, into: _Layer) -> None:
    torch.mm(given.t(), delta, out=into[0])
    torch.sum(delta, dim=0, out=into[1])


def _cut_where_off(delta: Tensor, made: Tensor) -> None:
    """Set the slope to 0 where a ReLU gave 0."""
    torch.ops.aten.threshold_backward.grad_input(delta, made, 0.0, grad_input=delta)


class Sgd:
    """Plain stochastic gradient descent."""

    def __init__(self, n: int) -> None:  # noqa: ARG002  (as Adam's)
        self.steps = 0

    def step(self, weights: Tensor, gradient: Tensor, learning_rate: float) -> None:
        """Change `weights` by one step against `gradient`."""
        weights.add_(gradient, alpha=-learning_rate)
        self.steps += 1

    def arrays(self) -> dict[str, Tensor]:
        """Names of its further state: none besides `steps`."""
        return {}


class Adam:
    """Adam (Kingma and Ba 2015) with the usual 0.9 and 0.999, epsilon 1e-5."""

    def __init__(self, n: int) -> None:
        self.steps = 0
        self._mean = torch.zeros(n)
        self._square = torch.zeros(n)
        self._scratch = torch.empty(n)

    def step(self, weights: Tensor, gradient: Tensor, learning_rate: float) -> None:
        """Change `weights` by one step against `gradient`."""
        self.steps += 1
        self._mean.lerp_(gradient, 0.1)
        self._square.mul_(0.999).addcmul_(gradient, gradient, value=1.0 - 0.999)
        torch.sqrt(self._square, out=self._scratch)
        self._scratch.mul_(1.0 / math.sqrt(1.0 - 0.999**self.steps)).add_(1e-5)
        weights.addcdiv_(self._mean, self._scratch, value=-learning_rate / (1.0 - 0.9**self.steps))

    def arrays(self) -> dict[str, Tensor]:
        """Names of its further state besides `steps`."""
        return {"mean": self._mean, "square": self._square}
