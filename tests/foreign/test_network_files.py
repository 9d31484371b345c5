"""AVs from files: the answers are those of the library that made the file, and nothing pickled is run."""

from __future__ import annotations

import base64
import io
import json
import pickle
import zipfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_built import WIDE

from cornerforge.errors import FileFormatError, InputError, MissingExtraError
from cornerforge.foreign.edge_cases import EDGE_CASES, edge_case, random_views, sample_views
from cornerforge.foreign.loaders import load_av
from cornerforge.foreign.networks import (
    SIZES,
    Reading,
    answers_of_actions,
    answers_of_box,
    answers_of_index,
    answers_of_numbers,
)
from cornerforge.foreign.normalised import Statistics
from cornerforge.foreign.onnx_file import ACTIONS_KEY
from cornerforge.foreign.policies import PolicyDriver
from cornerforge.foreign.sb3_file import Sb3Av
from cornerforge.types import ACCELERATIONS, ACTION_ACCELERATIONS, ACTION_SIDES, N_ACTIONS

VIEWS = random_views(np.random.default_rng(3), (1, 150), WIDE)[0]


def test_actions_are_the_33_of_the_paper() -> None:
    answers = answers_of_actions(np.eye(33))
    assert answers[:2].tolist() == [[0.0, 1.0], [0.0, -1.0]]
    np.testing.assert_array_equal(answers[2:, 0], ACCELERATIONS)
    assert not answers[2:, 1].any()
    spoiled = np.eye(33)[:2]
    spoiled[1, 5] = np.nan
    assert np.isnan(answers_of_actions(spoiled)).tolist() == [[False, False], [True, True]]


def test_what_stands_again_for_another_python_is_the_same() -> None:
    index = np.arange(N_ACTIONS)
    np.testing.assert_array_equal(answers_of_index(index), np.stack([ACTION_ACCELERATIONS, ACTION_SIDES], axis=1))
    edges = [edge_case(name, WIDE) for name in EDGE_CASES]
    np.testing.assert_array_equal(sample_views()[: len(edges)], edges)
    np.testing.assert_array_equal(
        sample_views()[len(edges) :], random_views(np.random.default_rng(0), (1, 64), WIDE)[0]
    )


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
    policy = arguments.pop("policy", "MlpPolicy")
    return getattr(sb3, algorithm)(policy, World(), seed=1, device="cpu", **arguments)


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
    about = load_av(str(tmp_path / "net.zip"), Reading(compares=True))[1]
    assert float(about["maker"].split()[0]) < 1e-4
    assert "stable-baselines3" in about["maker"]
    weight, bias = av._layers[-1]
    av._layers[-1] = weight, bias + torch.linspace(-1.0, 1.0, len(bias))  # its maker keeps to the file
    assert float(av.compared(VIEWS).split()[0]) > 0.01


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("scaled", [True, False])
@pytest.mark.parametrize("flat", [True, False])
def test_a_network_of_driving_v0_sees_what_it_saw_there(tmp_path: Path, *, scaled: bool, flat: bool) -> None:
    """As a file and as an object with predict."""
    sb3 = pytest.importorskip("stable_baselines3")
    import gymnasium

    env: Any = gymnasium.make("cornerforge.envs:cornerforge/Driving-v0", scaled=scaled)
    env = gymnasium.wrappers.FlattenObservation(env) if flat else env
    model = sb3.PPO("MlpPolicy", env, seed=1, device="cpu")
    model.save(tmp_path / "net.zip")
    shown = (VIEWS / SIZES if scaled else VIEWS).reshape(-1, *env.observation_space.shape)
    expected = answers_of_index(model.predict(shown, deterministic=True)[0])
    assert len(np.unique(expected, axis=0)) > 1
    driver, about = load_av(str(tmp_path / "net.zip"))
    assert ("divided by usual sizes" in about["read"]) == scaled
    np.testing.assert_array_equal(driver.av.act(VIEWS), expected)
    np.testing.assert_array_equal(PolicyDriver(model).answer(VIEWS), expected)


# --- what lies beside a file ---


def normaliser(path: Path, shape: tuple[int, ...] = (13, 8), **how: Any) -> Any:
    """Save a VecNormalize that has seen the views."""
    pytest.importorskip("stable_baselines3")
    import gymnasium
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    class World(gymnasium.Env[Any, Any]):
        observation_space, action_space = spaces_of("unit", shape)

    wrapped = VecNormalize(DummyVecEnv([World]), **how)
    frames = int(np.prod(shape)) // 104
    wrapped.obs_rms.update(np.concatenate([VIEWS.reshape(-1, *frame_of(shape))] * frames, axis=-1))
    wrapped.save(str(path))
    return wrapped


def frame_of(shape: tuple[int, ...]) -> tuple[int, ...]:
    return (13, 8) if len(shape) == 2 else (104,)


@pytest.mark.sampled(2)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("file", ["vec_normalize.pkl", "net_vecnormalize.pkl", "any.pkl"])
def test_observations_are_normalised_as_they_were(tmp_path: Path, file: str) -> None:
    model = model_of("PPO", "unit", policy_kwargs={"net_arch": [16]})
    model.save(tmp_path / "net.zip")
    plain = load_av(str(tmp_path / "net.zip"))
    wrapped = normaliser(tmp_path / file, clip_obs=1.5)
    said = Reading(statistics=str(tmp_path / file)) if file.startswith("any") else Reading()
    driver, about = load_av(str(tmp_path / "net.zip"), said)
    seen = wrapped.normalize_obs(VIEWS)
    assert np.abs(seen).max() == 1.5, "nothing is cut"
    expected = answers_of_box(model.predict(seen, deterministic=True)[0])
    np.testing.assert_allclose(driver.av.act(VIEWS), expected, atol=1e-4)
    assert np.abs(expected - plain[0].av.act(VIEWS)).max() > 0.01
    assert about["read"].endswith(f"normalised by {file}")
    assert about["hash"] != plain[1]["hash"]
    without = load_av(str(tmp_path / "net.zip"), Reading(statistics="none"))
    assert without[1] == plain[1]


@pytest.mark.filterwarnings("ignore")
def test_statistics_of_unclear_use_are_asked_for(tmp_path: Path) -> None:
    model_of("PPO", "unit", policy_kwargs={"net_arch": [4]}).save(tmp_path / "net_9_steps.zip")
    name = str(tmp_path / "net_9_steps.zip")
    normaliser(tmp_path / "net_vecnormalize_8_steps.pkl")
    with pytest.raises(InputError, match=r"lies net_vecnormalize_8_steps.pkl. Say by .*--av-statistics none"):
        load_av(name)
    (tmp_path / "net_vecnormalize_8_steps.pkl").unlink()
    (tmp_path / "other.pkl").write_bytes(b"words")
    assert "normalised by" not in load_av(name)[1]["read"]
    for other in ("stats.pkl", "Driving-v0/vecnormalize.pkl"):  # of another name, and where RL Zoo keeps it
        (tmp_path / "Driving-v0").mkdir(exist_ok=True)
        normaliser(tmp_path / other)
        with pytest.raises(InputError, match=f"lies {other}. Say by which file"):
            load_av(name)
        (tmp_path / other).unlink()
    normaliser(tmp_path / "net_vecnormalize_9_steps.pkl")
    normaliser(tmp_path / "vec_normalize.pkl")
    assert load_av(name)[1]["read"].endswith("normalised by net_vecnormalize_9_steps.pkl")
    off = normaliser(tmp_path / "off.pkl")
    off.norm_obs = False
    off.save(str(tmp_path / "off.pkl"))
    switched_off = load_av(name, Reading(statistics=str(tmp_path / "off.pkl")))[0]
    plain = load_av(name, Reading(statistics="none"))[0]
    np.testing.assert_array_equal(switched_off.av.act(VIEWS), plain.av.act(VIEWS))
    normaliser(tmp_path / "flat.pkl", (104,))
    (tmp_path / "bomb.pkl").write_bytes(pickle.dumps(Bomb()))
    (tmp_path / "words.pkl").write_bytes(b"words")
    for file, text in (
        ("flat.pkl", r"shape \(104,\); the AV's are \(13, 8\)"),
        ("bomb.pkl", "holds no statistics of VecNormalize .*; save them by"),
        ("words.pkl", "holds no statistics of VecNormalize"),
        ("nowhere.pkl", "nowhere.pkl is no file; name the statistics"),
    ):
        with pytest.raises(FileFormatError, match=text):
            load_av(name, Reading(statistics=str(tmp_path / file)))
    with pytest.raises(InputError, match="says itself what its actions are"):
        load_av(name, Reading(actions="si", statistics="none"))


@pytest.mark.parametrize("protocol", [3, 4, 5])
def test_statistics_are_read_without_what_the_pickle_names(
    tmp_path: Path, protocol: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "vec_normalize.pkl"
    wrapped = normaliser(path)
    wrapped.tried = Bomb()
    path.write_bytes(pickle.dumps(wrapped, protocol))
    found = Statistics(path)
    assert found.shape == (13, 8)
    np.testing.assert_array_equal(found(VIEWS), wrapped.normalize_obs(VIEWS))
    assert "a pickle was run" not in capsys.readouterr().out


@pytest.mark.sampled(2)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("shape", [(13, 24), (312,)])
@pytest.mark.parametrize("normalises", ["", "views", "stacks"])
def test_views_are_stacked_as_they_were(tmp_path: Path, shape: tuple[int, ...], normalises: str) -> None:
    """VecFrameStack of three views, within VecNormalize or around it."""
    model = model_of("PPO", "unit", shape, policy_kwargs={"net_arch": [8]})
    model.save(tmp_path / "net.zip")
    from stable_baselines3.common.vec_env.stacked_observations import StackedObservations

    frame = frame_of(shape)
    wrapped = (
        normaliser(tmp_path / "vec_normalize.pkl", frame if normalises == "views" else shape) if normalises else None
    )
    driver, about = load_av(str(tmp_path / "net.zip"))
    assert driver.about["remembers"] == "yes"
    assert "sees the last 3 views, " in about["read"]
    stack = StackedObservations(2, 3, spaces_of("unit", frame)[0])

    def seen_in(views: Any) -> Any:
        rows = views.reshape(2, *frame)
        return wrapped.normalize_obs(rows) if wrapped is not None and normalises == "views" else rows

    for k in range(6):
        views = VIEWS[2 * k : 2 * k + 2]
        over = np.array([k == 4, False])
        if k == 4:
            driver.reset(np.array([0]), np.array([7]))
        stacked = stack.reset(seen_in(views)) if k == 0 else stack.update(seen_in(views), over, [{}, {}])[0]
        observation = wrapped.normalize_obs(stacked) if wrapped is not None and normalises == "stacks" else stacked
        expected = answers_of_box(model.predict(observation, deterministic=True)[0])
        np.testing.assert_allclose(driver.av.act(views), expected, atol=1e-4)
    kept = driver.av._past.copy()
    driver.av.act(views * np.array([0.0, 1.0], np.float32)[:, None, None])  # the first world does not drive
    assert ((driver.av._past == kept).reshape(2, -1).all(axis=1) == [True, False]).all()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("algorithm", "actions", "shape", "arguments", "text"),
    [
        ("DQN", "5", (13, 8), {}, r"action space .*Discrete.* 5; an AV's is Discrete\(33\)"),
        ("PPO", "other", (13, 8), {}, "action space"),
        ("DQN", "33", (13, 7), {}, r"observations of shape \[13, 7\]"),
        ("PPO", "33", (13, 12), {}, r"observations of shape \[13, 12\]"),
        ("SAC", "raw", (13, 8), {"use_sde": True}, "gSDE"),
    ],
)
def test_policies_that_do_not_fit_are_refused(
    tmp_path: Path, algorithm: str, actions: str, shape: tuple[int, ...], arguments: dict[str, Any], text: str
) -> None:
    model_of(algorithm, actions, shape, **arguments).save(tmp_path / "net.zip")
    with pytest.raises(FileFormatError, match=text):
        load_av(str(tmp_path / "net.zip"))


def net_of_others(part: str) -> dict[str, Any]:
    """Arguments of a policy that holds code of its user: in a class, in a call, or in the network that is built."""
    torch = pytest.importorskip("torch")
    layers = pytest.importorskip("stable_baselines3.common.torch_layers")

    class Steep(torch.nn.LeakyReLU):  # type: ignore[name-defined]
        def __init__(self) -> None:
            super().__init__(0.3)

    class Scaled(layers.FlattenExtractor):  # type: ignore[name-defined]
        def forward(self, observations: Any) -> Any:
            return super().forward(observations) / 100.0

    arguments: dict[str, dict[str, Any]] = {
        "class": {"activation_fn": Steep},
        "partial": {"activation_fn": partial(torch.nn.LeakyReLU, 0.3)},
        "lambda": {"activation_fn": lambda: torch.nn.ELU(0.5)},
        "extractor": {"features_extractor_class": Scaled},
    }
    return arguments[part]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("part", ["class", "partial", "lambda", "extractor"])
def test_code_that_is_not_in_the_file_is_not_guessed(tmp_path: Path, part: str) -> None:
    arguments = net_of_others(part)
    model_of("PPO", "unit", policy_kwargs=arguments).save(tmp_path / "net.zip")
    with pytest.raises(FileFormatError, match=f"{next(iter(arguments))} is .*, whose code is not in the file"):
        load_av(str(tmp_path / "net.zip"))


@pytest.mark.filterwarnings("ignore")
def test_a_policy_class_of_its_user_is_not_taken_for_mlp_policy(tmp_path: Path) -> None:
    policies = pytest.importorskip("stable_baselines3.common.policies")

    class Own(policies.ActorCriticPolicy):  # type: ignore[name-defined]
        pass

    model_of("PPO", "unit", policy=Own).save(tmp_path / "net.zip")
    with pytest.raises(FileFormatError, match=r"policy_class is .*test_network_files, whose code is not in the file"):
        load_av(str(tmp_path / "net.zip"))


class Bomb:
    def __reduce__(self) -> Any:
        return print, ("a pickle was run",)


@pytest.mark.filterwarnings("ignore")
def test_nothing_pickled_is_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torch = pytest.importorskip("torch")
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


def onnx_file(
    path: Path,
    n_outputs: int,
    batch: int | str = "B",
    shape: tuple[int, ...] = (13, 8),
    kind: str = "float",
    *,
    ends: tuple[str, ...] = (),
    says: str = "",
    beside: bool = False,
) -> np.ndarray:
    """A linear model; returns its weights (104, n_outputs).

    Args:
        ends: Operations after it, such as Tanh.
        says: Its actions, in its metadata.
        beside: Its weights lie in a file of their own.
    """
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    weights = np.random.default_rng(0).normal(0.0, 0.02, (int(np.prod(shape)), n_outputs)).astype(np.float32)
    element = {"float": TensorProto.FLOAT, "double": TensorProto.DOUBLE}[kind]
    array = weights.astype(np.float32 if kind == "float" else np.float64)
    nodes = [
        helper.make_node("Flatten", ["view"], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "w"], ["out0"]),
    ]
    how: dict[str, Any] = {"ArgMax": {"axis": 1, "keepdims": 0}, "Cast": {"to": TensorProto.FLOAT}}
    for k, end in enumerate(ends):
        more = ["axis"] if end == "Unsqueeze" else []
        nodes.append(helper.make_node(end, [f"out{k}", *more], [f"out{k + 1}"], **how.get(end, {})))
    last = TensorProto.INT64 if "ArgMax" in ends and "Cast" not in ends else element
    rank = [batch] if "ArgMax" in ends and "Unsqueeze" not in ends else [batch, 1 if "ArgMax" in ends else n_outputs]
    graph = helper.make_graph(
        nodes,
        "av",
        [helper.make_tensor_value_info("view", element, [batch, *shape])],
        [helper.make_tensor_value_info(f"out{len(ends)}", last, rank)],
        [numpy_helper.from_array(array, "w"), numpy_helper.from_array(np.array([1]), "axis")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if says:
        helper.set_model_props(model, {ACTIONS_KEY: says})
    beside_it: Any = (
        {"save_as_external_data": True, "location": f"{path.name}.data", "size_threshold": 0} if beside else {}
    )
    onnx.save(model, path, **beside_it)
    return weights


@pytest.mark.parametrize(("n_outputs", "batch", "shape"), [(2, "B", (13, 8)), (33, "B", (104,)), (2, 1, (13, 8))])
def test_an_onnx_model_answers(tmp_path: Path, n_outputs: int, batch: int | str, shape: tuple[int, ...]) -> None:
    pytest.importorskip("onnxruntime")
    weights = onnx_file(tmp_path / "net.onnx", n_outputs, batch, shape)
    driver, about = load_av(str(tmp_path / "net.onnx"))
    assert driver.about["remembers"] == "no"
    assert ("m/s2 and a lane wish (" in about["read"]) == (n_outputs == 2)
    outputs = VIEWS.reshape(-1, 104).astype(np.float64) @ weights
    expected = answers_of_actions(outputs) if n_outputs == 33 else answers_of_numbers(outputs)
    np.testing.assert_allclose(driver.av.act(VIEWS), expected, atol=1e-3)
    np.testing.assert_array_equal(driver.av.act(VIEWS)[:1], driver.av.act(VIEWS[:1]))  # whatever the number of worlds


def test_numbers_from_minus_one_to_one_are_asked_about(tmp_path: Path) -> None:
    """They may be shares of the strongest braking, or m/s2: only the user can know, or the file."""
    pytest.importorskip("onnxruntime")
    weights = onnx_file(tmp_path / "net.onnx", 2, ends=("Tanh",))
    with pytest.raises(InputError, match=r"net.onnx gives -1 to 1. Is the .*--av-actions si.*--av-actions box"):
        load_av(str(tmp_path / "net.onnx"))
    onnx_file(tmp_path / "says.onnx", 2, ends=("Tanh",), says="box")
    box = load_av(str(tmp_path / "net.onnx"), Reading("box"))
    outputs = np.tanh(VIEWS.reshape(-1, 104) @ weights)
    np.testing.assert_allclose(box[0].av.act(VIEWS), answers_of_box(outputs), atol=1e-3)
    assert box[0].av.act(VIEWS)[:, 0].min() < -7.9
    assert load_av(str(tmp_path / "says.onnx"))[0].av.actions == "box"
    si = load_av(str(tmp_path / "says.onnx"), Reading("si"))
    np.testing.assert_allclose(si[0].av.act(VIEWS), answers_of_numbers(outputs), atol=1e-3)
    assert len({box[1]["hash"], si[1]["hash"], load_av(str(tmp_path / "says.onnx"))[1]["hash"]}) == 3
    with pytest.raises(InputError, match=r"in shape \(B, 2\), which is not number \(--av-actions\)"):
        load_av(str(tmp_path / "net.onnx"), Reading("number"))


@pytest.mark.parametrize("ends", [("ArgMax",), ("ArgMax", "Unsqueeze")])
def test_an_onnx_model_gives_the_number_of_an_action(tmp_path: Path, ends: tuple[str, ...]) -> None:
    pytest.importorskip("onnxruntime")
    weights = onnx_file(tmp_path / "net.onnx", 33, ends=ends)
    index = np.argmax(VIEWS.reshape(-1, 104) @ weights, axis=1)
    np.testing.assert_array_equal(load_av(str(tmp_path / "net.onnx"))[0].av.act(VIEWS), answers_of_index(index))
    onnx_file(tmp_path / "float.onnx", 33, ends=(*ends, "Cast"))
    with pytest.raises(InputError, match="numbers of the 33 actions, say so"):
        load_av(str(tmp_path / "float.onnx"))
    said = load_av(str(tmp_path / "float.onnx"), Reading("number"))[0]
    np.testing.assert_array_equal(said.av.act(VIEWS), answers_of_index(index))
    onnx_file(tmp_path / "more.onnx", 40, ends=ends)
    with pytest.raises(InputError, match="numbers of the 33 actions are whole, 0 to 32"):
        load_av(str(tmp_path / "more.onnx"))


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("discrete", "cuts"), [(True, False), (False, True), (False, False)])
def test_the_export_that_stable_baselines3_documents(tmp_path: Path, *, discrete: bool, cuts: bool) -> None:
    """The .onnx and the .zip of one policy, which brakes fully, drive the same, once its actions are known."""
    torch = pytest.importorskip("torch")
    pytest.importorskip("onnxruntime")
    model = model_of("PPO", "33" if discrete else "unit", policy_kwargs={"net_arch": [8]})
    if not discrete:
        with torch.no_grad():
            model.policy.action_net.bias.copy_(torch.tensor([-5.0, 0.0]))
            model.policy.action_net.weight.mul_(0.1)
    model.save(tmp_path / "net.zip")

    class Policy(torch.nn.Module):  # type: ignore[name-defined]
        def __init__(self) -> None:
            super().__init__()
            self.policy = model.policy

        def forward(self, observation: Any) -> Any:
            given = self.policy(observation, deterministic=True)
            return given[0].clamp(-1.0, 1.0) if cuts else given

    path = tmp_path / "net.onnx"
    batch = {"dynamic_axes": {"view": {0: "B"}}, "input_names": ["view"], "dynamo": False, "opset_version": 17}
    torch.onnx.export(Policy(), (torch.zeros(1, 13, 8),), path, **batch)
    if not discrete:
        with pytest.raises(
            InputError, match=r"--av-actions box" if cuts else "beside values and log probabilities as Stable"
        ):
            load_av(str(path))
    ours = load_av(str(path), Reading(None if discrete else "box"))[0].av.act(VIEWS)
    np.testing.assert_allclose(ours, load_av(str(tmp_path / "net.zip"))[0].av.act(VIEWS), atol=1e-4)
    assert discrete or (ours[:, 0] == -8.0).all()


def test_weights_in_a_file_of_their_own_belong_to_the_av(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    onnx_file(tmp_path / "net.onnx", 33)
    expected = load_av(str(tmp_path / "net.onnx"))[0].av.act(VIEWS)
    onnx_file(tmp_path / "out.onnx", 33, beside=True)
    driver, about = load_av(str(tmp_path / "out.onnx"))
    np.testing.assert_array_equal(driver.av.act(VIEWS), expected)
    data = tmp_path / "out.onnx.data"
    content = data.read_bytes()
    data.write_bytes(content[:400] + content[404:408] + content[404:])
    assert load_av(str(tmp_path / "out.onnx"))[1]["hash"] != about["hash"]
    data.unlink()
    with pytest.raises(FileFormatError, match=r"keeps weights in out.onnx.data, which is not there"):
        load_av(str(tmp_path / "out.onnx"))


def test_normalisation_before_an_onnx_model_is_asked_about(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    weights = onnx_file(tmp_path / "net.onnx", 33, shape=(13, 16))
    wrapped = normaliser(tmp_path / "vecnormalize.pkl")
    with pytest.raises(InputError, match=r"lies vecnormalize.pkl. Say by which file the observations"):
        load_av(str(tmp_path / "net.onnx"))
    driver = load_av(str(tmp_path / "net.onnx"), Reading(statistics=str(tmp_path / "vecnormalize.pkl")))[0]
    seen = np.concatenate([np.zeros_like(VIEWS), wrapped.normalize_obs(VIEWS)], axis=2)
    np.testing.assert_allclose(driver.av.act(VIEWS), answers_of_actions(seen.reshape(-1, 208) @ weights))
    assert driver.about["remembers"] == "yes"


@pytest.mark.parametrize(
    ("n_outputs", "shape", "kind", "text"),
    [(3, (13, 8), "float", r"an AV gives float \(B, 2\) or \(B, 33\)"),
     (2, (12, 8), "float", "an AV takes one float32"), (2, (208,), "float", "an AV takes one float32"),
     (2, (13, 8), "double", "an AV takes one float32")],
)  # fmt: skip
def test_onnx_models_that_do_not_fit_are_refused(
    tmp_path: Path, n_outputs: int, shape: tuple[int, ...], kind: str, text: str
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
        Sb3Av("a.zip", b"no zip at all")
