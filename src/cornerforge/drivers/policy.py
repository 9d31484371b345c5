"""A learned policy as a driver: the dueling Q-network evaluated inside compiled kernels (Wang et al. 2016).

The sums run in a fixed order, one input after the other, so an action does not depend on batch size, threads or vector
width. PyTorch learns the weights; this module acts by them, with the same bits in every run.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cornerforge._jit import kernel
from cornerforge._schema import Closed, check_fields, meant
from cornerforge.types import N_ACTIONS

__all__ = [
    "HEADS",
    "LEARNED_WIDTH",
    "NO_POLICY",
    "NetworkShape",
    "PolicyNumbers",
    "allocate_scratch",
    "best_action",
    "n_weights",
    "numbers_of_network",
    "q_values",
]

HEADS = {"greedy": 0, "softmax": 1}
"""Codes of what a policy does with the values of its actions when nothing else is asked for. greedy: it takes the best
one. softmax: it draws one with odds exp(value). `sim.adversaries` has the kernels."""
LEARNED_WIDTH = 128
"""No layer of a learned AV's network is wider."""


class NetworkShape(Closed, frozen=True):
    """Dueling network: `n_shared` layers, then a value and an advantage stream of `n_stream` layers, all `width` wide.

    Every layer but the two outputs (1 value, 33 advantages) is followed by a ReLU.
    """

    n_inputs: Annotated[int, meant("Numbers that it sees.", "", 1, 4096)]
    n_shared: Annotated[int, meant("Layers before the streams part.", "", 1, 16)]
    n_stream: Annotated[int, meant("Layers of each stream before its output.", "", 0, 16)]
    width: Annotated[int, meant("Numbers that a layer gives.", "", 1, 1024)]

    def __post_init__(self) -> None:
        check_fields(self, "network.")


class PolicyNumbers(NamedTuple):
    """A network as kernels take it.

    Attributes:
        weights: All layers one after the other: shared, value stream, advantage stream; each as its matrix (n_in,
            n_out), input by input, then its bias (n_out). float32.
        n_inputs, n_shared, n_stream, width: As in `NetworkShape`; n_inputs 0 means no policy.
        head: A code of HEADS.
    """

    weights: NDArray[np.float32]
    n_inputs: int
    n_shared: int
    n_stream: int
    width: int
    head: int = HEADS["greedy"]


NO_POLICY = PolicyNumbers(np.zeros(1, dtype=np.float32), 0, 0, 0, 1)


def n_weights(shape: NetworkShape) -> int:
    """Compute the length of the flat weight vector."""
    w = shape.width
    shared = (shape.n_inputs + 1) * w + (shape.n_shared - 1) * (w + 1) * w
    return shared + 2 * shape.n_stream * (w + 1) * w + (w + 1) * (1 + N_ACTIONS)


def numbers_of_network(weights: NDArray[np.float32], shape: NetworkShape, head: str = "greedy") -> PolicyNumbers:
    """Make what kernels take of flat weights, float32 (n_weights,), their shape, and a name of HEADS."""
    return PolicyNumbers(weights, shape.n_inputs, shape.n_shared, shape.n_stream, shape.width, HEADS[head])


def allocate_scratch(policy: PolicyNumbers) -> NDArray[np.float32]:
    """Allocate scratch for one evaluation at a time: float32 (4, width of the widest layer)."""
    return np.zeros((4, max(policy.width, N_ACTIONS, policy.n_inputs)), dtype=np.float32)


@kernel
def _layer(
    weights: NDArray[np.float32], start: int, x: NDArray[np.float32], n_in: int, y: NDArray[np.float32], n_out: int
) -> int:
    """Write W x + b into y, summing in the order of inputs; return where the next layer starts."""
    bias = start + n_in * n_out
    for o in range(n_out):
        y[o] = weights[bias + o]
    for i in range(n_in):
        xi = x[i]
        if xi != 0.0:  # after a ReLU about half are 0
            row = weights[start + i * n_out : start + (i + 1) * n_out]
            for o in range(n_out):
                y[o] += xi * row[o]
    return bias + n_out


@kernel
def _relu(x: NDArray[np.float32], n: int) -> None:
    for i in range(n):
        x[i] = max(x[i], np.float32(0.0))


@kernel
def q_values(
    policy: PolicyNumbers, observation: NDArray[np.float32], scratch: NDArray[np.float32], q: NDArray[np.float32]
) -> None:
    """Write Q = V + A - mean(A) of all 33 actions into `q`, float32 (33,), for an observation, float32 (n_inputs,)."""
    weights = policy.weights
    width = policy.width
    current = 0
    place = _layer(weights, 0, observation, policy.n_inputs, scratch[0], width)
    _relu(scratch[0], width)
    for _ in range(policy.n_shared - 1):
        place = _layer(weights, place, scratch[current], width, scratch[1 - current], width)
        current = 1 - current
        _relu(scratch[current], width)
    value = np.float32(0.0)
    for stream in range(2):
        source = current
        target = 2
        for _ in range(policy.n_stream):
            place = _layer(weights, place, scratch[source], width, scratch[target], width)
            _relu(scratch[target], width)
            source = target
            target = 5 - target
        if stream == 0:
            place = _layer(weights, place, scratch[source], width, q, 1)
            value = q[0]
        else:
            place = _layer(weights, place, scratch[source], width, q, N_ACTIONS)
    mean = np.float32(0.0)
    for a in range(N_ACTIONS):
        mean += q[a]
    mean /= np.float32(N_ACTIONS)
    for a in range(N_ACTIONS):
        q[a] = value + (q[a] - mean)


@kernel
def best_action(q: NDArray[np.float32], allowed: NDArray[np.bool_]) -> int:
    """Find the first allowed action of the largest value; -1 when none is allowed."""
    best = -1
    for a in range(N_ACTIONS):
        if allowed[a] and (best < 0 or q[a] > q[best]):
            best = a
    return best
