"""The dueling network: what PyTorch learns is what the compiled kernel acts on, and every weight is learnt."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cornerforge.adversary.network import Network, TrainableNetwork
from cornerforge.drivers.policy import NetworkShape, allocate_scratch, n_weights, numbers_of_network, q_values
from cornerforge.types import N_ACTIONS

pytestmark = pytest.mark.usefixtures("one_torch_thread")

SHAPES = [
    NetworkShape(40, 2, 1, 128),  # wider than preset fast
    NetworkShape(40, 4, 2, 128),  # preset paper
    NetworkShape(7, 1, 0, 5),  # the smallest: no layer of its own in the streams, narrower than 33 actions
    NetworkShape(9, 3, 3, 8),
]


def network(shape: NetworkShape, seed: int = 3, optimiser: str = "adam") -> TrainableNetwork:
    return TrainableNetwork(shape, seed, optimiser, 10.0)


def observations(shape: NetworkShape, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (50, shape.n_inputs)).astype(np.float32)


def compiled_q(shape: NetworkShape, weights: np.ndarray, seen: np.ndarray) -> np.ndarray:
    policy = numbers_of_network(weights, shape)
    q = np.zeros((len(seen), N_ACTIONS), dtype=np.float32)
    scratch = allocate_scratch(policy)
    for row, observation in zip(q, seen, strict=True):
        q_values(policy, observation, scratch, row)
    return q


@pytest.mark.parametrize("shape", SHAPES)
def test_kernel_and_torch_give_the_same_values(shape: NetworkShape, seed: int) -> None:
    net, seen = network(shape), observations(shape, seed)
    with torch.no_grad():
        expected = net(torch.from_numpy(seen)).numpy()
    # Both sum some hundred float32 numbers of size 1 in different orders.
    np.testing.assert_allclose(compiled_q(shape, net.weights(), seen), expected, rtol=0.0, atol=2e-5)
    # Negative control: the same weights in another order.
    assert np.abs(compiled_q(shape, net.weights()[::-1].copy(), seen) - expected).max() > 1e-3


@pytest.mark.parametrize("shape", SHAPES)
def test_the_gradient_is_that_of_differences(shape: NetworkShape, seed: int) -> None:
    """Each of 40 weights, of all layers: the loss in float64 a little to both sides."""
    net, rng = network(shape), np.random.default_rng(seed)
    slope = torch.from_numpy(rng.normal(size=(50, N_ACTIONS)))
    seen = torch.from_numpy(observations(shape, seed).astype(np.float64))
    exact = Network(shape, net.flat.double())
    (exact(seen) * slope).sum().backward()
    assert exact.flat.grad is not None
    found = exact.flat.grad.numpy()
    step = 1e-6
    for place in rng.choice(n_weights(shape), 40, replace=False):
        sides = []
        for side in (-step, step):
            moved = net.flat.double()
            moved[place] += side
            sides.append((Network(shape, moved)(seen) * slope).sum().item())
        assert found[place] == pytest.approx((sides[1] - sides[0]) / (2.0 * step), abs=1e-3 * np.abs(found).max())
    assert np.abs(found).max() > 0.1


@pytest.mark.parametrize("optimiser", ["adam", "sgd"])
def test_a_step_lowers_the_loss_and_a_long_gradient_is_cut(optimiser: str, seed: int) -> None:
    shape = SHAPES[0]
    net, seen = network(shape, optimiser=optimiser), torch.from_numpy(observations(shape, seed))
    goal = torch.from_numpy(np.random.default_rng(seed).normal(size=(50, N_ACTIONS)).astype(np.float32))
    losses = []
    for _ in range(20):
        loss = (net(seen) - goal).square().mean()
        net.descend(loss, 1e-3)
        losses.append(loss.item())
    assert losses[-1] < losses[0]
    before = net.weights()
    net.descend(1e6 * (net(seen) - goal).square().mean(), 1e-3)
    moved = np.linalg.norm(net.weights() - before)
    assert moved <= 1.001 * 10.0 * 1e-3 if optimiser == "sgd" else moved < 1.0


def test_the_seed_decides_the_first_weights_and_leaves_the_users_random_numbers_alone() -> None:
    before = torch.get_rng_state()
    weights = network(SHAPES[0]).weights()
    assert torch.equal(before, torch.get_rng_state())
    assert weights.tobytes() == network(SHAPES[0]).weights().tobytes()
    assert weights.tobytes() != network(SHAPES[0], seed=4).weights().tobytes()
    assert np.abs(weights).max() <= 1.0 / np.sqrt(40)


def test_mean_over_actions_is_the_value() -> None:
    shape = SHAPES[2]
    net, seen = network(shape), torch.from_numpy(observations(shape, 4))
    with torch.no_grad():
        before = net(seen)
        net.flat[-N_ACTIONS:] += torch.arange(N_ACTIONS)  # biases of the advantages
        after = net(seen)
    torch.testing.assert_close(after.mean(dim=1), before.mean(dim=1), rtol=0.0, atol=1e-5)
    assert (after - before).abs().max() > 1.0


def test_weights_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        Network(SHAPES[0], torch.zeros(10))
