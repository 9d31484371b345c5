"""The Q-network: what PyTorch learns is what the compiled kernel acts on."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cornerforge.adversary.q_network import QNetwork, flat_weights, set_flat_weights
from cornerforge.drivers.policy import NetworkShape, PolicyNumbers, allocate_scratch, n_weights, q_values
from cornerforge.types import N_ACTIONS

SHAPES = [
    NetworkShape(40, 2, 1, 128),  # preset fast
    NetworkShape(40, 4, 2, 128),  # preset paper
    NetworkShape(7, 1, 0, 5),  # the smallest: no layer of its own in the streams, narrower than 33 actions
]


def network(shape: NetworkShape, seed: int) -> QNetwork:
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return QNetwork(shape)


def compiled_q(shape: NetworkShape, weights: np.ndarray, observations: np.ndarray) -> np.ndarray:
    policy = PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)
    q = np.zeros((len(observations), N_ACTIONS), dtype=np.float32)
    scratch = allocate_scratch(policy)
    for row, observation in zip(q, observations, strict=True):
        q_values(policy, observation, scratch, row)
    return q


@pytest.mark.parametrize("shape", SHAPES)
def test_flat_weights_and_back(shape: NetworkShape) -> None:
    first, second = network(shape, 1), network(shape, 2)
    flat = flat_weights(first)
    assert flat.dtype == np.float32
    assert flat.shape == (n_weights(shape),)
    assert not np.array_equal(flat, flat_weights(second))
    set_flat_weights(second, flat)
    assert np.array_equal(flat, flat_weights(second))
    for a, b in zip(first.state_dict().values(), second.state_dict().values(), strict=True):
        assert torch.equal(a, b)


@pytest.mark.parametrize("shape", SHAPES)
def test_kernel_and_torch_give_the_same_values(shape: NetworkShape, seed: int) -> None:
    net = network(shape, 3)
    observations = np.random.default_rng(seed).uniform(-1.0, 1.0, (50, shape.n_inputs)).astype(np.float32)
    with torch.no_grad():
        expected = net(torch.from_numpy(observations)).numpy()
    found = compiled_q(shape, flat_weights(net), observations)
    # Both sum some hundred float32 numbers of size 1 in different orders.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-5)
    # Negative control: the same weights in another order.
    assert np.abs(compiled_q(shape, flat_weights(net)[::-1].copy(), observations) - expected).max() > 1e-3


def test_dueling_mean_of_q_is_the_value() -> None:
    net = network(SHAPES[0], 4)
    observations = torch.linspace(-1.0, 1.0, 80).reshape(2, 40)
    with torch.no_grad():
        value = net.value(net.shared(observations)).squeeze(1)
        torch.testing.assert_close(net(observations).mean(dim=1), value, rtol=0.0, atol=1e-6)
