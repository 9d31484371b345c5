"""The derivative written out is that of autograd, and the steps are those of PyTorch's optimisers."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cornerforge.adversary.dueling import Adam, DuelingNet, Pass, Sgd
from cornerforge.adversary.q_network import QNetwork, flat_weights
from cornerforge.drivers.policy import NetworkShape

SHAPES = [
    NetworkShape(40, 2, 1, 64),
    NetworkShape(40, 4, 2, 128),
    NetworkShape(7, 1, 0, 5),  # the smallest: no layer of its own in the streams
    NetworkShape(9, 3, 3, 8),
]


def networks(shape: NetworkShape) -> tuple[QNetwork, DuelingNet]:
    """The same weights in both forms."""
    with torch.random.fork_rng():
        torch.manual_seed(5)
        module = QNetwork(shape)
    return module, DuelingNet(shape, torch.from_numpy(flat_weights(module)))


def flat_gradient(module: QNetwork, shape: NetworkShape) -> np.ndarray:
    """Autograd's gradient in the flat layout."""
    copy = QNetwork(shape)
    for ours, theirs in zip(copy.parameters(), module.parameters(), strict=True):
        assert theirs.grad is not None
        ours.data.copy_(theirs.grad)
    return flat_weights(copy)


def draw(shape: NetworkShape, seed: int, rows: int = 50) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    observation = rng.uniform(-1.0, 1.0, (rows, shape.n_inputs)).astype(np.float32)
    return torch.from_numpy(observation), torch.from_numpy(rng.normal(size=(rows, 33)).astype(np.float32))


@pytest.mark.parametrize("shape", SHAPES)
def test_values_and_gradients_are_those_of_autograd(shape: NetworkShape, seed: int) -> None:
    module, net = networks(shape)
    gradient = DuelingNet(shape, torch.full_like(net.flat, torch.nan))
    room = Pass(shape, 50)
    for repetition in range(2):  # the second finds what the first left in the room
        observation, slope = draw(shape, seed + repetition)
        expected = module(observation)
        module.zero_grad()
        (expected * slope).sum().backward()
        np.testing.assert_allclose(room.forward(net, observation).numpy(), expected.detach().numpy(), atol=2e-5)
        room.backward(net, slope, gradient)
        theirs = flat_gradient(module, shape)
        # Float32 sums of 50 rows of size 1 in another order; a wrong formula is off by the size of the entries.
        np.testing.assert_allclose(gradient.flat.numpy(), theirs, atol=2e-4 * np.abs(theirs).max())
        assert np.abs(theirs).max() > 0.1


@pytest.mark.parametrize("name", ["adam", "sgd"])
def test_steps_are_those_of_pytorchs_optimisers(name: str, seed: int) -> None:
    shape = SHAPES[0]
    module, net = networks(shape)
    theirs = (
        torch.optim.Adam(module.parameters(), lr=1e-2, eps=1e-5)
        if name == "adam"
        else torch.optim.SGD(module.parameters(), lr=1e-2)
    )
    ours = (Adam if name == "adam" else Sgd)(net.flat.numel())
    before = net.flat.numpy().copy()
    for step in range(5):
        observation, slope = draw(shape, seed + step)
        module.zero_grad()
        (module(observation) * slope).sum().backward()
        ours.step(net.flat, torch.from_numpy(flat_gradient(module, shape)), 1e-2)
        theirs.step()
    assert ours.steps == 5
    assert np.abs(net.flat.numpy() - before).max() > 1e-2
    np.testing.assert_allclose(net.flat.numpy(), flat_weights(module), atol=1e-5, rtol=1e-5)


def test_weights_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        DuelingNet(SHAPES[0], torch.zeros(10))
