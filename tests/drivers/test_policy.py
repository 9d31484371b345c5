from __future__ import annotations

import itertools

import numpy as np
import pytest

from cornerforge.drivers.policy import (
    NO_POLICY,
    NetworkShape,
    PolicyNumbers,
    allocate_scratch,
    best_action,
    n_weights,
    q_values,
)
from cornerforge.errors import InputError

SHAPES = [
    NetworkShape(40, 4, 2, 128),
    NetworkShape(40, 2, 1, 64),
    NetworkShape(7, 1, 0, 5),
    NetworkShape(60, 3, 3, 16),
    NetworkShape(1, 1, 1, 1),
]


def network(shape: NetworkShape, rng: np.random.Generator) -> PolicyNumbers:
    weights = rng.normal(0.0, 0.3, n_weights(shape)).astype(np.float32)
    return PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width)


def forward(policy: PolicyNumbers, observation: np.ndarray) -> np.ndarray:
    """Plain float64 forward pass; takes the flat weights apart as `PolicyNumbers` describes them."""
    weights = iter(policy.weights.astype(np.float64))

    def layer(x: np.ndarray, n_out: int, *, relu: bool = True) -> np.ndarray:
        matrix = np.array(list(itertools.islice(weights, x.size * n_out))).reshape(x.size, n_out)
        y = x @ matrix + np.array(list(itertools.islice(weights, n_out)))
        return np.asarray(np.maximum(y, 0.0)) if relu else y

    x = observation.astype(np.float64)
    for _ in range(policy.n_shared):
        x = layer(x, policy.width)
    streams = []
    for n_out in (1, 33):
        y = x
        for _ in range(policy.n_stream):
            y = layer(y, policy.width)
        streams.append(layer(y, n_out, relu=False))
    assert next(weights, None) is None
    value, advantage = streams
    return np.asarray(value + advantage - advantage.mean())


def evaluate(policy: PolicyNumbers, observation: np.ndarray, scratch: np.ndarray | None = None) -> np.ndarray:
    q = np.full(33, np.nan, dtype=np.float32)
    q_values(policy, observation, allocate_scratch(policy) if scratch is None else scratch, q)
    return q


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_q_values_are_those_of_a_plain_forward_pass(shape: NetworkShape, seed: int) -> None:
    rng = np.random.default_rng(seed)
    policy = network(shape, rng)
    for _ in range(5):
        observation = rng.normal(0.0, 1.0, shape.n_inputs).astype(np.float32)
        expected = forward(policy, observation)
        tolerance = 1e-4 * max(1.0, float(np.abs(expected).max()))
        np.testing.assert_allclose(evaluate(policy, observation), expected, atol=tolerance)


def test_the_order_of_the_weights_matters_to_this_test(seed: int) -> None:
    # negative control: the same numbers with two inputs swapped are another network
    rng = np.random.default_rng(seed)
    policy = network(SHAPES[1], rng)
    observation = rng.normal(0.0, 1.0, 40).astype(np.float32)
    swapped = observation.copy()
    swapped[[0, 1]] = swapped[[1, 0]]
    assert np.abs(evaluate(policy, observation) - forward(policy, swapped)).max() > 1e-3


def test_alone_and_within_a_loop_are_bitwise_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    policy = network(SHAPES[0], rng)
    observations = rng.normal(0.0, 1.0, (50, 40)).astype(np.float32)
    scratch = allocate_scratch(policy)
    in_turn = [evaluate(policy, observation, scratch) for observation in observations]
    for observation, q in zip(observations, in_turn, strict=True):
        np.testing.assert_array_equal(evaluate(policy, observation), q)
    # and a row of a larger array is read as a copy of it is
    np.testing.assert_array_equal(evaluate(policy, observations[3]), evaluate(policy, observations[3].copy()))


def test_dirty_scratch_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for shape in SHAPES:
        policy = network(shape, rng)
        observation = rng.normal(0.0, 1.0, shape.n_inputs).astype(np.float32)
        dirty = np.full_like(allocate_scratch(policy), np.nan)
        np.testing.assert_array_equal(evaluate(policy, observation, dirty), evaluate(policy, observation))


def test_constant_advantages_leave_the_value(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = SHAPES[2]
    policy = network(shape, rng)
    policy.weights[-33:] = 7.0  # biases of the advantages
    policy.weights[-33 - 33 * shape.width : -33] = 0.0
    q = evaluate(policy, rng.normal(0.0, 1.0, shape.n_inputs).astype(np.float32))
    assert np.ptp(q) == 0.0
    assert q[0] != 7.0


def test_best_action_is_the_first_of_the_largest_allowed() -> None:
    q = np.zeros(33, dtype=np.float32)
    allowed = np.ones(33, dtype=np.bool_)
    q[[4, 9]] = 1.0
    q[20] = 2.0
    assert best_action(q, allowed) == 20
    allowed[20] = False
    assert best_action(q, allowed) == 4
    allowed[4] = False
    assert best_action(q, allowed) == 9
    allowed[:] = False
    assert best_action(q, allowed) == -1
    allowed[32] = True
    q[:] = -np.inf
    assert best_action(q, allowed) == 32


@pytest.mark.parametrize("mask_seed", range(20))
def test_best_action_respects_any_mask(mask_seed: int) -> None:
    rng = np.random.default_rng(mask_seed)
    q = rng.integers(-3, 4, 33).astype(np.float32)
    allowed = rng.random(33) < 0.3
    allowed[rng.integers(33)] = True
    expected = np.flatnonzero(allowed)[np.argmax(q[allowed])]
    assert best_action(q, allowed) == expected


def test_no_policy_is_marked() -> None:
    assert NO_POLICY.n_inputs == 0
    assert allocate_scratch(NO_POLICY).shape == (4, 33)


@pytest.mark.parametrize(
    "arguments", [(0, 1, 1, 8), (40, 0, 1, 8), (40, 1, -1, 8), (40, 1, 1, 0), (40, 1, 1, 2000), (40, 17, 1, 8)]
)
def test_shapes_are_checked(arguments: tuple[int, int, int, int]) -> None:
    with pytest.raises(InputError, match=r"network\."):
        NetworkShape(*arguments)
