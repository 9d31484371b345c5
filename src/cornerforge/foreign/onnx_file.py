"""An AV in an ONNX file: views in; 2 numbers, 33 values, or the number of an action out."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError, InputError, MissingExtraError
from cornerforge.foreign.edge_cases import sample_views
from cornerforge.foreign.networks import BLOCK, FLAT, N_ACTIONS, NetworkAv, answers_of_index, frames_in
from cornerforge.foreign.normalised import Statistics

__all__ = ["ACTIONS_KEY", "OnnxAv", "files_of_weights"]

ACTIONS_KEY = "cornerforge.actions"
"""Entry of a model's metadata that names what its outputs are (`networks.ACTIONS`)."""
_WEIGHTS = re.compile(rb"\x0a\x08location\x12([\x01-\x7f])")
_SB3_OUTPUTS = 3


def files_of_weights(path: Path, content: bytes) -> list[Path]:
    """List the files in which an ONNX model keeps weights, its external data.

    Raises:
        FileFormatError: One is missing, or lies outside the model's folder.
    """
    found = [content[one.end() : one.end() + one.group(1)[0]] for one in _WEIGHTS.finditer(content)]
    names = [PurePosixPath(name.decode("utf-8", "replace")) for name in dict.fromkeys(found)]
    for name in names:
        if name.is_absolute() or ".." in name.parts or not (path.parent / name).is_file():
            raise FileFormatError(f"{path} keeps weights in {name}, which is not there; put it beside the model.")
    return [path.parent / name for name in names]


class OnnxAv(NetworkAv):
    """Runs an ONNX model on one thread.

    Its one input takes float32 (B, 13, 8), (B, 104), or (B, 13, 8 k) for the last k views; B free or fixed. Its first
    output gives (B, 33), the values of the 33 actions; whole numbers (B,) or (B, 1), the actions' numbers; or (B, 2),
    which is one of two: m/s2 and a lane wish, or numbers of Box(-1, 1).

    Args:
        path: The file.
        content: Its bytes.
        said: What outputs are, a name of `networks.ACTIONS`; None: as its metadata say (`ACTIONS_KEY`), or its answers.
        statistics: How observations are normalised before they go in; None: they are not.

    Attributes:
        why: How it is known what outputs are; "" where it is clear.

    Raises:
        MissingExtraError: onnxruntime is not installed.
        FileFormatError: It is no ONNX model, or its shapes do not fit.
        InputError: It is not clear what its outputs are, or they are not what was said.
    """

    def __init__(self, path: Path, content: bytes, said: str | None, statistics: Statistics | None) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise MissingExtraError("onnxruntime", "onnx") from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        model = str(path) if files_of_weights(path, content) else content
        try:
            self._session: Any = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has a dozen exceptions without a common base
            reason = " ".join(str(error).split())[:200]
            raise FileFormatError(f"{path} is no ONNX model that can be run: {reason}") from error
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        shape = tuple(inputs[0].shape[1:]) if len(inputs) == 1 and inputs[0].type == "tensor(float)" else ()
        whole = bool(shape) and all(isinstance(size, int) for size in shape)
        if not whole or not frames_in(shape) or (len(shape) == 1 and shape != FLAT):
            found = ", ".join(f"{i.name} {i.type} {i.shape}" for i in inputs)
            raise FileFormatError(
                f"{path} takes {found}; an AV takes one float32 (B, 13, 8) or (B, 104), or (B, 13, 8 k) for k views."
            )
        self._input, self._output, self._name = inputs[0].name, outputs[0].name, path
        batch = inputs[0].shape[0]
        fixed = batch if isinstance(batch, int) and batch > 0 else BLOCK
        super().__init__(shape, "values", statistics, fixed)
        self.why = ""
        there = self._session.get_modelmeta().custom_metadata_map.get(ACTIONS_KEY)
        if said or there:
            self.why = "--av-actions" if said else f"{ACTIONS_KEY} in the file"
        self.actions = self._form(said or there, len(outputs))

    def _form(self, said: str | None, n_outputs: int) -> str:
        """Find out what outputs are, a name of `networks.ACTIONS`.

        Raises:
            InputError: It is not clear, or not what was said.
        """
        outputs = self.outputs(sample_views())
        self._past = self._past[:0]
        width = outputs.shape[1] if outputs.ndim == 2 else 1
        given = f"{self._name} gives {np.min(outputs):.4g} to {np.max(outputs):.4g}"
        if width == 1 and np.isnan(answers_of_index(outputs)).any():
            raise InputError(f"{given}; numbers of the 33 actions are whole, 0 to {N_ACTIONS - 1}.")
        fits = {N_ACTIONS: ("values",), 1: ("number",), 2: ("box", "si")}[width]
        if said is not None and said not in fits:
            raise InputError(f"{given} in shape (B, {width}), which is not {said} ({self.why}).")
        if said is not None or width == N_ACTIONS or outputs.dtype.kind in "iu":
            return said or fits[0]
        if width == 1:
            raise InputError(f"{given}. If these are numbers of the 33 actions, say so: --av-actions number.")
        most = float(np.abs(outputs[:, 0]).max())
        if most <= 1.0 or n_outputs == _SB3_OUTPUTS:
            also = ", beside values and log probabilities as Stable-Baselines3 exports them" if most > 1.0 else ""
            raise InputError(
                f"{given}{also}. Is the first of the two an acceleration in m/s2 (--av-actions si), or of Box(-1, 1), "
                "times 8 m/s2 for braking and 2 m/s2 else (--av-actions box)?"
            )
        self.why = f"{outputs[:, 0].min():.3g} to {outputs[:, 0].max():.3g} m/s2"
        return "si"

    def evaluate(self, observation: NDArray[np.float32]) -> NDArray[np.floating]:
        """See `NetworkAv.evaluate`."""
        output: NDArray[np.floating] = np.asarray(self._session.run([self._output], {self._input: observation})[0])
        width = output.shape[1] if output.ndim == 2 else 1
        kinds = "fiu" if width == 1 else "f" if width in (2, N_ACTIONS) else ""
        if output.ndim not in (1, 2) or output.shape[0] != len(observation) or output.dtype.kind not in kinds:
            raise FileFormatError(
                f"{self._name} gave an output of type {output.dtype} and shape {output.shape}; an AV gives float "
                "(B, 2) or (B, 33), or an action's number, (B,) or (B, 1)."
            )
        return output
