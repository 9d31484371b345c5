"""An AV in a file of Stable-Baselines3; nothing that is pickled in the file is run.

The file holds weights (loaded as plain tensors) and settings (JSON). Pickled parts of the settings are left alone: the
text beside them says what is needed. The network is built here from the shapes of the weights. So only the `MlpPolicy`
of DQN, PPO, A2C, SAC, TD3 and DDPG can be read; for another policy its own code would have to run.
"""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError, MissingExtraError
from cornerforge.foreign.interface import VIEW_SHAPE
from cornerforge.foreign.networks import NetworkAv
from cornerforge.types import N_ACTIONS

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Sb3Av", "sb3_av"]

_ACTIVATIONS = ("ReLU", "Tanh", "ELU", "LeakyReLU", "GELU", "SiLU", "Sigmoid", "Softplus")
_FAMILIES = (
    # what marks it, layers before the last, the last, activation by default, actions are squashed
    ("q_net.q_net.0.weight", "q_net.q_net", None, "ReLU", False),
    ("action_net.weight", "mlp_extractor.policy_net", "action_net", "Tanh", False),
    ("actor.mu.weight", "actor.latent_pi", "actor.mu", "ReLU", True),
    ("actor.mu.0.weight", "actor.mu", None, "ReLU", True),
)
_BRAKING, _ACCELERATION = 8.0, 2.0
_MAX_JSON = 50_000_000
_SAFE_TORCH = (2, 10)
"""Before, `torch.load` could run code of a file in spite of `weights_only` (CVE-2025-32434, CVE-2026-24747)."""


class Sb3Av(NetworkAv):
    """A chain of linear layers with one activation, evaluated by torch on one thread.

    Args:
        layers: Weight (out, in) and bias (out,) of each layer, as tensors.
        activation: Function between the layers.
        finish: Makes outputs (B, 2) or (B, 33) from the last layer's.
    """

    def __init__(self, layers: list[tuple[Any, Any]], activation: Any, finish: Callable[[Any], Any]) -> None:
        super().__init__()
        self._layers, self._activation, self._finish = layers, activation, finish

    def evaluate(self, view: NDArray[np.float32]) -> NDArray[np.floating]:
        """See `NetworkAv.evaluate`."""
        import torch

        with torch.inference_mode():
            x = torch.from_numpy(view.reshape(len(view), -1))
            for k, (weight, bias) in enumerate(self._layers):
                x = torch.nn.functional.linear(self._activation(x) if k else x, weight, bias)
            outputs: NDArray[np.floating] = self._finish(x).numpy()
        return outputs


def sb3_av(name: str, content: bytes) -> Sb3Av:
    """Make the AV of a Stable-Baselines3 file.

    Its observation is the view, (13, 8) or flattened (104,). Its action is one of 33, `Discrete(33)`, or two numbers,
    acceleration [m/s2] and lane wish: of `Box([-8, -1], [2, 1])`, or of `Box(-1, 1, (2,))`, where the first is
    multiplied by 8 if negative and by 2 if positive (as in `cornerforge/Driving-v0`). The best or mean action is taken.

    Args:
        name: The file, for messages.
        content: Its bytes.

    Raises:
        MissingExtraError: torch is not installed, or so old that it could run code of the file.
        FileFormatError: It is no file of Stable-Baselines3, or its policy is of another kind.
    """
    try:
        import torch
    except ImportError as error:
        raise MissingExtraError("torch", "learn") from error
    if tuple(int(part) for part in torch.__version__.split(".")[:2]) < _SAFE_TORCH:
        needed = "torch {}.{} or newer".format(*_SAFE_TORCH)
        raise MissingExtraError(f"{needed} (this is {torch.__version__}, which a file could make run code)", "learn")
    torch.set_num_threads(1)
    settings, weights = _read(name, content)
    for text in ("features_extractor.", "shared_net."):
        if any(text in key for key in weights):
            raise FileFormatError(f"{name} has a network of its own ({text[:-1]}); only MlpPolicy can be taken.")
    family = next((f for f in _FAMILIES if f[0] in weights), None)
    if family is None:
        raise FileFormatError(f"{name} holds no policy of DQN, PPO, A2C, SAC, TD3 or DDPG with MlpPolicy.")
    _, hidden, last, activation, squashed = family
    if settings.get("use_sde") and squashed:
        raise FileFormatError(
            f"{name} explores by gSDE (use_sde), whose mean action is of another form; train without."
        )
    layers = _chain(weights, hidden)
    if last is not None:
        layers.append((weights[f"{last}.weight"], weights[f"{last}.bias"]))
    kwargs = settings.get("policy_kwargs")
    found = re.search(r"activation\.(\w+)'", str((kwargs or {}).get("activation_fn", "")))
    chosen = found.group(1) if found else activation
    if chosen not in _ACTIVATIONS:
        raise FileFormatError(f"{name} uses the activation {chosen}; known: {', '.join(_ACTIVATIONS)}.")
    if (kwargs or {}).get("squash_output"):
        raise FileFormatError(f"{name} was trained with squash_output, which is not supported; train without.")
    _check_chain(name, layers, settings)
    return Sb3Av(layers, getattr(torch.nn, chosen)(), _finish(name, settings.get("action_space"), squashed))


def _read(name: str, content: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read settings and weights; pickled parts of the settings stay text."""
    import torch

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if archive.getinfo("data").file_size > _MAX_JSON:
                raise ValueError("its settings are of no reasonable size")
            settings = json.loads(archive.read("data"))
            weights = torch.load(io.BytesIO(archive.read("policy.pth")), map_location="cpu", weights_only=True)
    except Exception as error:  # zipfile, json, torch and pickle each have their own for damaged bytes
        reason = " ".join(str(error).split())[:150]
        raise FileFormatError(f"{name} is no file of Stable-Baselines3 ({type(error).__name__}: {reason}).") from error
    if not isinstance(settings, dict) or not isinstance(weights, dict):
        raise FileFormatError(f"{name} is no file of Stable-Baselines3 (its parts are of other kinds).")
    return settings, {str(key): value for key, value in weights.items()}


def _chain(weights: dict[str, Any], prefix: str) -> list[tuple[Any, Any]]:
    """List the linear layers `prefix.0`, `prefix.2`, ... in order."""
    pattern = re.compile(rf"{re.escape(prefix)}\.(\d+)\.weight")
    places = sorted(int(match.group(1)) for key in weights if (match := pattern.fullmatch(key)))
    return [(weights[f"{prefix}.{k}.weight"], weights.get(f"{prefix}.{k}.bias")) for k in places]


def _check_chain(name: str, layers: list[tuple[Any, Any]], settings: dict[str, Any]) -> None:
    shapes = [tuple(weight.shape) for weight, _ in layers]
    linear = all(len(shape) == 2 for shape in shapes) and all(bias is not None for _, bias in layers)
    pairs = zip(shapes, shapes[1:])  # noqa: B905, RUF007 - for Python 3.9
    if not linear or any(a[0] != b[1] for a, b in pairs):
        raise FileFormatError(f"{name} holds layers that are no chain of linear ones ({shapes}).")
    observed = (settings.get("observation_space") or {}).get("_shape")
    if shapes[0][1] != math.prod(VIEW_SHAPE) or observed not in ([*VIEW_SHAPE], [math.prod(VIEW_SHAPE)]):
        raise FileFormatError(
            f"{name} takes observations of shape {observed}; an AV's view is (13, 8), or flattened (104,)."
        )


def _numbers(text: object) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d*)?", str(text))]


def _finish(name: str, space: Any, squashed: bool) -> Callable[[Any], Any]:
    """Make the function from the last layer's outputs to 33 values, or to acceleration [m/s2] and lane wish."""
    import torch

    space = space if isinstance(space, dict) else {}
    kind = str(space.get(":type:", ""))
    if "Discrete'" in kind and str(space.get("n")) == str(N_ACTIONS) and str(space.get("start", "0")) == "0":
        return lambda x: x
    low, high = _numbers(space.get("low")), _numbers(space.get("high"))
    unit = (low, high) in (([-1.0], [1.0]), ([-1.0, -1.0], [1.0, 1.0]))
    if "Box'" not in kind or space.get("_shape") != [2] or not (unit or (low, high) == ([-8.0, -1.0], [2.0, 1.0])):
        raise FileFormatError(
            f"{name} has the action space {kind} {space.get('n', (low, high))}; an AV's is Discrete(33), "
            "Box([-8, -1], [2, 1]) or Box(-1, 1, (2,))."
        )
    bottom = torch.tensor([-1.0, -1.0] if unit else [-8.0, -1.0])
    top = torch.tensor([1.0, 1.0] if unit else [2.0, 1.0])

    def finish(x: Any) -> Any:
        x = bottom + 0.5 * (torch.tanh(x) + 1.0) * (top - bottom) if squashed else torch.clamp(x, bottom, top)
        if unit:
            x[:, 0] = x[:, 0] * torch.where(x[:, 0] < 0.0, _BRAKING, _ACCELERATION)
        return x

    return finish
