"""AVs from files: the answers are those of the library that made the file, and nothing pickled is run."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cornerforge.errors import FileFormatError, MissingExtraError
from cornerforge.foreign.edge_cases import random_views
from cornerforge.foreign.loaders import load_av
from cornerforge.foreign.networks import answers_of_actions, answers_of_numbers
from cornerforge.foreign.sb3_file import sb3_av
from cornerforge.types import ACCELERATIONS, Odd

VIEWS = random_views(np.random.default_rng(3), (1, 150), Odd())[0]


def test_actions_are_the_33_of_the_paper() -> None:
    answers = answers_of_actions(np.eye(33))
    assert answers[:2].tolist() == [[0.0, 1.0], [0.0, -1.0]]
    np.testing.assert_array_equal(answers[2:, 0], ACCELERATIONS)
    assert not answers[2:, 1].any()
    spoiled = np.eye(33)[:2]
    spoiled[1, 5] = np.nan
    assert np.isnan(answers_of_actions(spoiled)).tolist() == [[False, False], [True, True]]


def test_a_lane_wish_becomes_an_order() -> None:
    wishes = np.array([[1.0, 0.34], [1.0, 0.33], [-9.0, -0.34], [np.nan, 0.0], [0.0, np.inf]])
    answers = answers_of_numbers(wishes)
    assert answers[:3].tolist() == [[1.0, 1.0], [1.0, 0.0], [-9.0, -1.0]]
    assert np.isnan(answers[3:]).any(axis=1).all()


# --- Stable-Baselines3 ---


def spaces_of(actions: str, shape: tuple[int, ...]) -> tuple[Any, Any]:
    from gymnasium import spaces

    box = {"raw": ([-8, -1], [2, 1]), "unit": ([-1, -1], [1, 1]), "other": ([0, 0], [1, 1])}
    if actions in box:
        low, high = (np.array(bound, np.float32) for bound in box[actions])
        return spaces.Box(-np.inf, np.inf, shape, np.float32), spaces.Box(low, high)
    return spaces.Box(-np.inf, np.inf, shape, np.float32), spaces.Discrete(int(actions))


def model_of(algorithm: str, actions: str, shape: tuple[int, ...] = (13, 8), **arguments: Any) -> Any:
    sb3 = pytest.importorskip("stable_baselines3")
    import gymnasium

    observed, acted = spaces_of(actions, shape)

    class World(gymnasium.Env[Any, Any]):
        observation_space, action_space = observed, acted

        def reset(self, **_: Any) -> Any:
            return np.zeros(shape, np.float32), {}

        def step(self, action: Any) -> Any:  # noqa: ARG002
            return np.zeros(shape, np.float32), 0.0, False, False, {}

    if algorithm in ("DQN", "SAC", "TD3"):
        arguments["buffer_size"] = 10
    return getattr(sb3, algorithm)("MlpPolicy", World(), seed=1, device="cpu", **arguments)


@pytest.mark.sampled(2)
@pytest.mark.filterwarnings("ignore")  # of Stable-Baselines3 itself
@pytest.mark.parametrize(
    ("algorithm", "actions", "shape", "arguments"),
    [
        ("DQN", "33", (13, 8), {}),
        ("DQN", "33", (104,), {"policy_kwargs": {"net_arch": [32]}}),
        ("PPO", "33", (13, 8), {}),
        ("PPO", "raw", (13, 8), {"activation": "ELU"}),
        ("A2C", "unit", (104,), {}),
        ("SAC", "raw", (13, 8), {"policy_kwargs": {"net_arch": [16, 16]}}),
        ("SAC", "unit", (13, 8), {"policy_kwargs": {"net_arch": [16, 16]}}),
        ("TD3", "raw", (104,), {"policy_kwargs": {"net_arch": [16, 16]}}),
    ],
)
def test_the_answers_are_those_of_stable_baselines3(
    tmp_path: Path, algorithm: str, actions: str, shape: tuple[int, ...], arguments: dict[str, Any]
) -> None:
    torch = pytest.importorskip("torch")
    if "activation" in arguments:
        arguments = {"policy_kwargs": {"activation_fn": getattr(torch.nn, arguments["activation"])}}
    model = model_of(algorithm, actions, shape, **arguments)
    model.save(tmp_path / "net.zip")
    driver, about = load_av(str(tmp_path / "net.zip"))
    av = driver.av
    assert about["kind"] == "zip"
    chosen, _ = model.predict(VIEWS.reshape(-1, *shape), deterministic=True)
    if actions == "33":
        expected = answers_of_actions(np.eye(33)[chosen])
    else:
        if actions == "unit":
            chosen[:, 0] *= np.where(chosen[:, 0] < 0, 8.0, 2.0)
        expected = answers_of_numbers(chosen)
        assert np.ptp(expected[:, 0]) > 0.1
    np.testing.assert_allclose(av.act(VIEWS), expected, atol=1e-4)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("algorithm", "actions", "shape", "arguments", "text"),
    [
        ("DQN", "5", (13, 8), {}, r"action space .*Discrete.* 5; an AV's is Discrete\(33\)"),
        ("PPO", "other", (13, 8), {}, "action space"),
        ("DQN", "33", (13, 7), {}, r"observations of shape \[13, 7\]"),
        ("SAC", "raw", (13, 8), {"use_sde": True}, "gSDE"),
    ],
)
def test_policies_that_do_not_fit_are_refused(
    tmp_path: Path, algorithm: str, actions: str, shape: tuple[int, ...], arguments: dict[str, Any], text: str
) -> None:
    model_of(algorithm, actions, shape, **arguments).save(tmp_path / "net.zip")
    with pytest.raises(FileFormatError, match=text):
        load_av(str(tmp_path / "net.zip"))


class Bomb:
    def __reduce__(self) -> Any:
        return print, ("a pickle was run",)


@pytest.mark.filterwarnings("ignore")
def test_nothing_pickled_is_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torch = pytest.importorskip("torch")
    import base64
    import pickle

    model_of("DQN", "33").save(tmp_path / "good.zip")
    bomb = base64.b64encode(pickle.dumps(Bomb())).decode()
    with zipfile.ZipFile(tmp_path / "good.zip") as good:
        parts = {name: good.read(name) for name in good.namelist()}
    settings = json.loads(parts["data"])
    for value in settings.values():
        if isinstance(value, dict) and ":serialized:" in value:
            value[":serialized:"] = bomb
    weights = io.BytesIO()
    torch.save({"q_net.q_net.0.weight": Bomb()}, weights)
    for name, changed in (("data", json.dumps(settings).encode()), ("policy.pth", weights.getvalue())):
        with zipfile.ZipFile(tmp_path / "bad.zip", "w") as bad:
            for part, content in (parts | {name: changed}).items():
                bad.writestr(part, content)
        if name == "data":
            assert load_av(str(tmp_path / "bad.zip"))[0].av.act(VIEWS).shape == (150, 2)
        else:
            with pytest.raises(FileFormatError, match="no file of Stable-Baselines3"):
                load_av(str(tmp_path / "bad.zip"))
    assert "a pickle was run" not in capsys.readouterr().out


# --- ONNX ---


def onnx_file(path: Path, n_outputs: int, batch: int | str, shape: list[int], kind: str = "float") -> np.ndarray:
    """A linear model; returns its weights (104, n_outputs)."""
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    weights = np.random.default_rng(0).normal(0.0, 0.02, (int(np.prod(shape)), n_outputs)).astype(np.float32)
    element = {"float": TensorProto.FLOAT, "double": TensorProto.DOUBLE}[kind]
    array = weights.astype(np.float32 if kind == "float" else np.float64)
    nodes = [
        helper.make_node("Flatten", ["view"], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "w"], ["out"]),
    ]
    graph = helper.make_graph(
        nodes,
        "av",
        [helper.make_tensor_value_info("view", element, [batch, *shape])],
        [helper.make_tensor_value_info("out", element, [batch, n_outputs])],
        [numpy_helper.from_array(array, "w")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    onnx.checker.check_model(model)
    return weights


@pytest.mark.parametrize(("n_outputs", "batch", "shape"), [(2, "B", [13, 8]), (33, "B", [104]), (2, 1, [13, 8])])
def test_an_onnx_model_answers(tmp_path: Path, n_outputs: int, batch: int | str, shape: list[int]) -> None:
    pytest.importorskip("onnxruntime")
    weights = onnx_file(tmp_path / "net.onnx", n_outputs, batch, shape)
    av = load_av(str(tmp_path / "net.onnx"))[0].av
    outputs = VIEWS.reshape(-1, 104).astype(np.float64) @ weights
    expected = answers_of_actions(outputs) if n_outputs == 33 else answers_of_numbers(outputs)
    np.testing.assert_allclose(av.act(VIEWS), expected, atol=1e-3)
    np.testing.assert_array_equal(av.act(VIEWS)[:1], av.act(VIEWS[:1]))  # whatever the number of worlds


@pytest.mark.parametrize(
    ("n_outputs", "shape", "kind", "text"),
    [(3, [13, 8], "float", r"an AV gives \(B, 2\) or \(B, 33\)"), (2, [12, 8], "float", "an AV takes one float32"),
     (2, [13, 8], "double", "an AV takes one float32")],
)  # fmt: skip
def test_onnx_models_that_do_not_fit_are_refused(
    tmp_path: Path, n_outputs: int, shape: list[int], kind: str, text: str
) -> None:
    pytest.importorskip("onnxruntime")
    onnx_file(tmp_path / "net.onnx", n_outputs, "B", shape, kind)
    with pytest.raises(FileFormatError, match=text):
        load_av(str(tmp_path / "net.onnx"))


@pytest.mark.parametrize(("version", "is_read"), [("2.9.1", False), ("2.10.0+cpu", True)])
def test_no_file_is_given_to_a_torch_that_could_run_its_code(
    version: str, is_read: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """pip does not look at an AV's own Python (`--av-python`), so the lowest version is checked here as well."""
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch, "__version__", version)
    expected: type[Exception] = FileFormatError if is_read else MissingExtraError
    with pytest.raises(
        expected, match="no file of Stable-Baselines3" if is_read else r"torch 2\.10 or newer \(this is 2\.9\.1"
    ):
        sb3_av("a.zip", b"no zip at all")
