"""An AV in an ONNX file: view in, 2 numbers or 33 values out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError, MissingExtraError
from cornerforge.foreign.interface import VIEW_SHAPE
from cornerforge.foreign.networks import BLOCK, NetworkAv

__all__ = ["OnnxAv"]

_FLAT = (math.prod(VIEW_SHAPE),)


class OnnxAv(NetworkAv):
    """Runs an ONNX model on one thread.

    Its one input takes float32 (B, 13, 8) or (B, 104), B free or fixed; its first output gives (B, 2), acceleration
    [m/s2] and lane wish (beyond 1/3 left, below -1/3 right), or (B, 33), the values of the 33 actions.

    Args:
        name: The file, for messages.
        content: Its bytes.

    Raises:
        MissingExtraError: onnxruntime is not installed.
        FileFormatError: It is no ONNX model, or its shapes do not fit.
    """

    def __init__(self, name: str, content: bytes) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise MissingExtraError("onnxruntime", "onnx") from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session: Any = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has a dozen exceptions without a common base
            reason = " ".join(str(error).split())[:200]
            raise FileFormatError(f"{name} is no ONNX model that can be run: {reason}") from error
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if (
            len(inputs) != 1
            or inputs[0].type != "tensor(float)"
            or tuple(inputs[0].shape[1:]) not in (VIEW_SHAPE, _FLAT)
        ):
            found = ", ".join(f"{i.name} {i.type} {i.shape}" for i in inputs)
            raise FileFormatError(f"{name} takes {found}; an AV takes one float32 (B, 13, 8) or (B, 104).")
        shape = list(outputs[0].shape)
        if len(shape) == 2 and isinstance(shape[1], int) and shape[1] not in (2, 33):
            raise FileFormatError(f"{name} gives {shape}; an AV gives (B, 2) or (B, 33).")
        self._input, self._output = inputs[0].name, outputs[0].name
        self._shape = tuple(inputs[0].shape[1:])
        batch = inputs[0].shape[0]
        super().__init__(batch if isinstance(batch, int) and batch > 0 else BLOCK)
        self._name = name

    def evaluate(self, view: NDArray[np.float32]) -> NDArray[np.floating]:
        """See `NetworkAv.evaluate`."""
        rows = view.reshape(len(view), *self._shape)
        output: NDArray[np.floating] = np.asarray(self._session.run([self._output], {self._input: rows})[0])
        if output.ndim != 2 or output.shape[1] not in (2, 33) or output.shape[0] != len(view):
            raise FileFormatError(
                f"{self._name} gave an output of shape {output.shape}; an AV gives (B, 2) or (B, 33)."
            )
        return output
