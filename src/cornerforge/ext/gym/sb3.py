"""Conversion of a Stable-Baselines3 DQN that learnt in `cornerforge/Adversary-v0` to a policy of cornerforge.

Its file acts inside the compiled kernels: `simulate`, `generate`, `replay` and `retest` take it like one of
`cornerforge train`, at full speed, and every crash that it causes is a case that replays from its name.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.drivers.policy import NetworkShape
from cornerforge.errors import InputError
from cornerforge.experiment.policy_file import Policy
from cornerforge.sim import observe
from cornerforge.types import N_ACTIONS

__all__ = ["policy_of_sb3"]


def policy_of_sb3(model: Any, *, bounded: bool = False) -> Policy:
    """Make the greedy policy of a DQN, to be written with `experiment.policy_file.save_policy`.

    A plain Q-network is a dueling one without streams and with the mean of its outputs as value: Q = mean Q + (Q - mean
    Q). So the values are the network's own up to rounding in float32.

    Args:
        model: `stable_baselines3.DQN` with "MlpPolicy", ReLU and hidden layers of one width.
        bounded: Whether it learnt, and acts, with the NDD-bounded mask.

    Returns:
        The policy; it acts with the mask, so it never takes the substitute of a forbidden action.

    Raises:
        InputError: The model is of another kind, or of other shapes.
    """
    layers = _layers(model)
    shapes = [weight.shape for weight, _ in layers]
    width = shapes[0][0]
    wanted = [(width, observe.N_OBSERVATION), *[(width, width)] * (len(shapes) - 2), (N_ACTIONS, width)]
    if len(shapes) < 2 or shapes != wanted:
        raise InputError(
            f"The network's layers are {shapes} (outputs, inputs); allowed: from {observe.N_OBSERVATION} observations "
            f"through hidden layers of one width to {N_ACTIONS} actions."
        )
    shape = NetworkShape(observe.N_OBSERVATION, len(layers) - 1, 0, width)
    weight, bias = layers[-1]
    layers[-1:] = [(weight.mean(axis=0, keepdims=True), bias.mean(keepdims=True)), (weight, bias)]
    flat = np.concatenate([part.ravel() for weight, bias in layers for part in (weight.T, bias)])
    if not np.isfinite(flat).all():
        raise InputError("The network's weights are not finite: the training has diverged; lower its learning rate.")
    done = {"decisions": int(model.num_timesteps), "updates": int(model._n_updates)}
    return Policy(flat.astype(np.float32), shape, bounded, {"made_by": "stable-baselines3 DQN", **done})


def _layers(model: Any) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Read weights (out, in) and biases (out,) of the linear layers."""
    network = getattr(getattr(getattr(model, "policy", None), "q_net", None), "q_net", None)
    if network is None:
        raise InputError(f"{type(model).__name__} has no Q-network; only a DQN of Stable-Baselines3 can be taken.")
    modules = list(network)
    kinds = [type(module).__name__ for module in modules]
    if kinds != ["Linear", *["ReLU", "Linear"] * (len(kinds) // 2)]:
        raise InputError(f"The network is {kinds}; allowed: Linear layers with ReLU between them.")
    return [
        tuple(part.detach().cpu().numpy().astype(np.float64) for part in (module.weight, module.bias))
        for module in modules[::2]
    ]
