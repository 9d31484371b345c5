"""Limits of an AV's memory."""

from __future__ import annotations

from pathlib import Path

import pytest

import cornerforge
from cornerforge.errors import CornerForgeError, InputError

pytestmark = pytest.mark.full

GOOD = """
import numpy as np
class Good:
    def act(self, view):
        return np.zeros((len(view), 2))
"""


@pytest.fixture
def tries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an AV."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tries.py").write_text(GOOD, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"av_memory": 0.1}, "av_memory = 0.1 GB is out of range"),
        ({"av_memory": float("nan")}, "av_memory = nan"),
        ({"av": "idm-mobil", "av_memory": 2.0}, "av_memory is for AVs that are not built in"),
    ],
)
def test_options_are_checked(tries: Path, options: dict[str, object], text: str) -> None:  # noqa: ARG001
    with pytest.raises(InputError, match=text):
        cornerforge.simulate(**({"av": "tries:Good", "tests": 1} | options))  # type: ignore[arg-type]


def test_a_network_that_asks_for_much_memory_is_one_line(tries: Path) -> None:
    """An ONNX file of some hundred bytes whose tensor takes 16 GB."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    size = helper.make_tensor("size", onnx.TensorProto.INT64, [2], [1 << 16, 1 << 16])
    nodes = [
        helper.make_node("ConstantOfShape", ["size"], ["big"]),
        helper.make_node("ReduceSum", ["big"], ["sum"], keepdims=0),
        helper.make_node("Flatten", ["view"], ["flat"], axis=1),
        helper.make_node("ReduceMean", ["flat"], ["mean"], axes=[1], keepdims=1),
        helper.make_node("Add", ["mean", "sum"], ["one"]),
        helper.make_node("Concat", ["one", "one"], ["out"], axis=1),
    ]
    graph = helper.make_graph(
        nodes, "big", [helper.make_tensor_value_info("view", kind, ["B", 13, 8])],
        [helper.make_tensor_value_info("out", kind, ["B", 2])], [size],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    (tries / "big.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(CornerForgeError) as failure:
        cornerforge.simulate(av="big.onnx", tests=1, av_memory=2.0)
    said = str(failure.value)
    assert "big.onnx" in said
    assert "\n" not in said
