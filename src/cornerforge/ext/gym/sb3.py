"""Conversion of a Stable-Baselines3 agent that learnt in `cornerforge/Adversary-v0` to a policy of cornerforge.

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

_Layer = tuple[NDArray[np.float64], NDArray[np.float64]]


def policy_of_sb3(model: Any, *, bounded: bool = False) -> Policy:
    """Make the policy of a DQN, PPO or MaskablePPO, to be written with `experiment.policy_file.save_policy`.

    A plain network is a dueling one without streams and with the mean of its outputs as value: Q = mean Q + (Q - mean
    Q). So the values of a DQN, and the logits of PPO, are the network's own up to rounding in float32.

    Args:
        model: `stable_baselines3.DQN` or `PPO`, or `sb3_contrib.MaskablePPO`, with "MlpPolicy", ReLU and hidden layers
            of one width; PPO's are others unless its `policy_kwargs` say so.
        bounded: Whether it learnt, and acts, with the NDD-bounded mask.

    Returns:
        The policy; it acts with the mask, so it never takes the substitute of a forbidden action: a DQN's greedily,
        PPO's by the probabilities of the allowed actions.

    Raises:
        InputError: The model is of another kind, or of other shapes, or sees normalised observations.
    """
    modules, head = _network(model)
    kinds = [type(module).__name__ for module in modules]
    if kinds != ["Linear", *["ReLU", "Linear"] * (len(kinds) // 2)]:
        raise InputError(
            f"The network is {kinds}; allowed: Linear layers with ReLU between them. Train with "
            'policy_kwargs={"activation_fn": torch.nn.ReLU}.'
        )
    layers: list[_Layer] = [
        tuple(part.detach().cpu().numpy().astype(np.float64) for part in (module.weight, module.bias))
        for module in modules[::2]
    ]
    shapes = [weight.shape for weight, _ in layers]
    width = shapes[0][0]
    wanted = [(width, observe.N_OBSERVATION), *[(width, width)] * (len(shapes) - 2), (N_ACTIONS, width)]
    if len(shapes) < 2 or shapes != wanted:
        raise InputError(
            f"The network's layers are {shapes} (outputs, inputs); allowed: from {observe.N_OBSERVATION} observations "
            f"through hidden layers of one width to {N_ACTIONS} actions."
        )
    if getattr(model.get_vec_normalize_env(), "norm_obs", False):
        raise InputError("It learnt from normalised observations (VecNormalize), which a policy file cannot keep.")
    shape = NetworkShape(observe.N_OBSERVATION, len(layers) - 1, 0, width)
    weight, bias = layers[-1]
    layers[-1:] = [(weight.mean(axis=0, keepdims=True), bias.mean(keepdims=True)), (weight, bias)]
    flat = np.concatenate([part.ravel() for weight, bias in layers for part in (weight.T, bias)])
    if not np.isfinite(flat).all():
        raise InputError("The network's weights are not finite: the training has diverged; lower its learning rate.")
    done = {"decisions": int(model.num_timesteps), "updates": int(model._n_updates)}
    made_by = f"stable-baselines3 {type(model).__name__}"
    return Policy(flat.astype(np.float32), shape, bounded, {"made_by": made_by, **done}, head=head)


def _network(model: Any) -> tuple[list[Any], str]:
    """List the modules from observations to values or logits, and say how a policy acts by them (`HEADS`)."""
    policy: Any = getattr(model, "policy", None)
    if type(getattr(policy, "features_extractor", None)).__name__ not in ("NoneType", "FlattenExtractor"):
        raise InputError("The network extracts features of its own; only MlpPolicy can be taken.")
    values = getattr(getattr(policy, "q_net", None), "q_net", None)
    if values is not None:
        return list(values), "greedy"
    hidden = getattr(getattr(policy, "mlp_extractor", None), "policy_net", None)
    if hidden is None or hasattr(policy, "lstm_actor"):
        raise InputError(
            f"{type(model).__name__} is no DQN, PPO or MaskablePPO with MlpPolicy; no other model can be taken."
        )
    return [*hidden, policy.action_net], "softmax"
