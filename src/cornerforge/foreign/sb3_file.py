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
from cornerforge.foreign.networks import ACTIONS, BOUNDS, N_ACTIONS, NetworkAv, form_of, frames_in, is_scaled

if TYPE_CHECKING:
    from cornerforge.foreign.normalised import Statistics

__all__ = ["Sb3Av"]

_ACTIVATIONS = ("ReLU", "Tanh", "ELU", "LeakyReLU", "GELU", "SiLU", "Sigmoid", "Softplus")
_PARTS = {
    "policy_class": r"(stable_baselines3|sb3_contrib)\..*",
    "features_extractor_class": r"<class 'stable_baselines3\.common\.torch_layers\.FlattenExtractor'>",
    "activation_fn": rf"<class 'torch\.nn\.modules\.activation\.({'|'.join(_ACTIVATIONS)})'>",
}
_FAMILIES = (
    # what marks it, layers before the last, the last, activation by default, one that is so made, actions are squashed
    ("q_net.q_net.0.weight", "q_net.q_net", None, "ReLU", "DQN", False),
    ("action_net.weight", "mlp_extractor.policy_net", "action_net", "Tanh", "PPO", False),
    ("actor.mu.weight", "actor.latent_pi", "actor.mu", "ReLU", "SAC", True),
    ("actor.mu.0.weight", "actor.mu", None, "ReLU", "TD3", True),
)
_MAX_JSON = 50_000_000
_MAX_WEIGHTS = 1 << 28
_SAFE_TORCH = (2, 10)
"""Before, `torch.load` could run code of a file in spite of `weights_only` (CVE-2025-32434, CVE-2026-24747)."""


class Sb3Av(NetworkAv):
    """A chain of linear layers with one activation, evaluated by torch on one thread.

    Its observation is the view, (13, 8) or flattened (104,), or the last k of them (`VecFrameStack`). Its action is one
    of 33, `Discrete(33)`, or two numbers, acceleration [m/s2] and lane wish: of `Box([-8, -1], [2, 1])`, or of
    `Box(-1, 1, (2,))`, where the first is multiplied by 8 if negative and by 2 if positive (as in
    `cornerforge/Driving-v0`). The best or mean action is taken.

    Args:
        name: The file, for messages.
        content: Its bytes.
        statistics: How observations were normalised; None: they were not.

    Raises:
        MissingExtraError: torch is not installed, or so old that it could run code of the file.
        FileFormatError: It is no file of Stable-Baselines3, or its policy is of another kind.
    """

    def __init__(self, name: str, content: bytes, statistics: Statistics | None = None) -> None:
        try:
            import torch
        except ImportError as error:
            raise MissingExtraError("torch", "learn") from error
        if tuple(int(part) for part in torch.__version__.split(".")[:2]) < _SAFE_TORCH:
            needed = "torch {}.{} or newer".format(*_SAFE_TORCH)
            raise MissingExtraError(
                f"{needed} (this is {torch.__version__}, which a file could make run code)", "learn"
            )
        torch.set_num_threads(1)
        settings, weights = _read(name, content)
        for text in ("features_extractor.", "shared_net.", "lstm_actor."):
            if any(text in key for key in weights):
                raise FileFormatError(f"{name} has a network of its own ({text[:-1]}); only MlpPolicy can be taken.")
        family = next((f for f in _FAMILIES if f[0] in weights), None)
        if family is None:
            raise FileFormatError(f"{name} holds no policy of DQN, PPO, A2C, SAC, TD3 or DDPG with MlpPolicy.")
        _, hidden, last, activation, self._kind, self._is_squashed = family
        if settings.get("use_sde") and self._is_squashed:
            raise FileFormatError(
                f"{name} explores by gSDE (use_sde), whose mean action is of another form; train without."
            )
        layers = _chain(weights, hidden)
        if last is not None:
            layers.append((weights[f"{last}.weight"], weights[f"{last}.bias"]))
        kwargs = settings.get("policy_kwargs") or {}
        made = {"policy_class": (settings.get("policy_class") or {}).get("__module__"), **kwargs}
        for part, known in _PARTS.items():
            if made.get(part) is not None and not re.fullmatch(known, str(made[part])):
                raise FileFormatError(
                    f"{name}: {part} is {str(made[part])[:80]}, whose code is not in the file. Known activations: "
                    f"{', '.join(_ACTIVATIONS)}. Give an object with predict, or ONNX."
                )
        chosen = str(kwargs["activation_fn"])[:-2].rpartition(".")[2] if "activation_fn" in kwargs else activation
        if kwargs.get("squash_output"):
            raise FileFormatError(f"{name} was trained with squash_output, which is not supported; train without.")
        shape = _checked_shape(name, layers, settings)
        scaled = is_scaled(_numbers_in(settings.get("observation_space"), "high", shape))
        super().__init__(shape, _actions_of(name, settings.get("action_space")), statistics, scaled=scaled)
        self._layers, self._between = layers, getattr(torch.nn, chosen)
        self._activation = self._between()
        self._bounds = [torch.tensor(bound) for bound in BOUNDS.get(self.actions, ())]
        parts = f"{hidden}.", f"{last}."
        self._own = {key: part for key, part in weights.items() if key.startswith(parts)}

    def evaluate(self, observation: NDArray[np.float32]) -> NDArray[np.floating]:
        """See `NetworkAv.evaluate`."""
        import torch

        with torch.inference_mode():
            x = torch.from_numpy(observation.reshape(len(observation), -1))
            for k, (weight, bias) in enumerate(self._layers):
                x = torch.nn.functional.linear(self._activation(x) if k else x, weight, bias)
            if self._bounds:
                low, high = self._bounds
                x = low + 0.5 * (torch.tanh(x) + 1.0) * (high - low) if self._is_squashed else x.clamp(low, high)
            outputs: NDArray[np.floating] = x.numpy()
        return outputs

    def compared(self, views: NDArray[np.float32]) -> str:
        """Say how far the answers to views (B, 13, 8) are from those of Stable-Baselines3; "" where it is not there.

        Its own policy is made of the same weights, with nothing that is pickled in the file.
        """
        try:
            import stable_baselines3 as sb3
            from gymnasium import spaces
        except ImportError:
            return ""
        seen, kind = spaces.Box(-np.inf, np.inf, self.shape), vars(sb3)[self._kind]
        bounds = [bound.numpy() for bound in self._bounds]
        acted: Any = spaces.Box(bounds[0], bounds[1]) if bounds else spaces.Discrete(N_ACTIONS)
        network = {"net_arch": [len(bias) for _, bias in self._layers[:-1]], "activation_fn": self._between}
        theirs = kind.policy_aliases["MlpPolicy"](seen, acted, lambda _: 0.0, **network)
        theirs.load_state_dict(theirs.state_dict() | self._own)
        given = theirs.predict(self.observed(views), deterministic=True)[0]
        self._past = self._past[:0]
        answers = ACTIONS[self.actions if bounds else "number"][1](given)
        most = float(np.abs(answers - self.act(views)).max())
        self._past = self._past[:0]
        return f"{most:.2g} at most on {len(views)} views, to stable-baselines3 {sb3.__version__}"


def _read(name: str, content: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read settings and weights; pickled parts of the settings stay text."""
    import torch

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if archive.getinfo("data").file_size > _MAX_JSON:
                raise ValueError("its settings are of no reasonable size")
            if archive.getinfo("policy.pth").file_size > _MAX_WEIGHTS:
                raise ValueError(f"its weights unpack to more than {_MAX_WEIGHTS >> 20} MB")
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


def _checked_shape(name: str, layers: list[tuple[Any, Any]], settings: dict[str, Any]) -> tuple[int, ...]:
    """Return the shape of an observation, after a check that the layers are a chain from there."""
    shapes = [tuple(weight.shape) for weight, _ in layers]
    linear = all(len(shape) == 2 for shape in shapes) and all(bias is not None for _, bias in layers)
    pairs = zip(shapes, shapes[1:])  # noqa: B905, RUF007 - for Python 3.9
    if not linear or any(a[0] != b[1] for a, b in pairs):
        raise FileFormatError(f"{name} holds layers that are no chain of linear ones ({shapes}).")
    observed = (settings.get("observation_space") or {}).get("_shape")
    shape = tuple(observed) if isinstance(observed, list) and all(type(size) is int for size in observed) else ()
    if not frames_in(shape) or shapes[0][1] != math.prod(shape):
        raise FileFormatError(
            f"{name} takes observations of shape {observed}; an AV's view is (13, 8), or flattened (104,), and k of "
            "them are (13, 8 k) or (104 k,)."
        )
    return shape


def _numbers_in(space: Any, end: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Read the lower or upper ends of a Box from its text; infinite where it does not say them all."""
    text = str(space.get(end)) if isinstance(space, dict) else ""
    found = [float(number) for number in re.findall(r"-?\d+(?:\.\d*)?(?:e[+-]\d+)?", text)]
    return np.array(found if len(found) == math.prod(shape) else [np.inf] * math.prod(shape), np.float32).reshape(shape)


def _actions_of(name: str, space: Any) -> str:
    """Find out what the last layer's outputs are, a name of `networks.ACTIONS`."""
    space = space if isinstance(space, dict) else {}
    kind = str(space.get(":type:", ""))
    if "Discrete'" in kind and str(space.get("n")) == str(N_ACTIONS) and str(space.get("start", "0")) == "0":
        return "values"
    low, high = (
        [float(number) for number in re.findall(r"-?\d+(?:\.\d*)?", str(space.get(end)))] for end in ("low", "high")
    )
    form = form_of(low * 2, high * 2) if len(low) == len(high) == 1 else form_of(low, high)
    if "Box'" not in kind or space.get("_shape") != [2] or form is None:
        raise FileFormatError(
            f"{name} has the action space {kind} {space.get('n', (low, high))}; an AV's is Discrete(33), "
            "Box([-8, -1], [2, 1]) or Box(-1, 1, (2,))."
        )
    return form
