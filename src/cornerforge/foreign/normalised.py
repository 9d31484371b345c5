"""Mean and variance by which a network's observations were normalised in training, as VecNormalize saved them.

Nothing that is pickled is run: whatever a pickle names becomes an object that keeps what it is given, and the numbers
are read off these.
"""

from __future__ import annotations

import io
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError, InputError

__all__ = ["Statistics", "statistics_for"]

_NAME = re.compile(r"_?vec_?normalize")


class _Inert:
    """Whatever a pickle names: keeps what it is given."""

    given: tuple[Any, ...]
    state: Any = None

    def __new__(cls, *given: Any, **_: Any) -> _Inert:
        self = super().__new__(cls)
        self.given = given
        return self

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:  # noqa: ARG002 - none is imported
        return type(name, (_Inert,), {})


def _array(kept: Any) -> NDArray[np.float64]:
    """Make the array that NumPy pickled, by one of its two ways."""
    if type(kept).__name__ == "_frombuffer":
        data, kind, shape, order = kept.given
    else:
        _, shape, kind, is_fortran, data = kept.state
        order = "F" if is_fortran else "C"
    if kind.given[0] not in ("f4", "f8"):
        raise ValueError("its numbers are of another type")
    flat = np.frombuffer(bytes(data), kind.state[1] + kind.given[0])
    return flat.reshape(shape, order=order).astype(np.float64)


class Statistics:
    """Normalisation of observations, as VecNormalize does it: (x - mean) / sqrt(var + epsilon), cut to +-clip.

    Args:
        path: A file that `VecNormalize.save` wrote.

    Attributes:
        path, content: The file and its bytes.
        shape: Of an observation; () where VecNormalize left them alone (`norm_obs=False`).

    Raises:
        FileFormatError: There is no such file, or it is another.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.shape = path, ()
        if not path.is_file():
            raise FileFormatError(f"{path} is no file; name the statistics that venv.save(FILE) wrote, or say none.")
        try:
            self.content = path.read_bytes()
            kept = _Reader(io.BytesIO(self.content)).load().state
            if kept["norm_obs"] is False:
                return
            self._mean, var = (_array(kept["obs_rms"].state[name]) for name in ("mean", "var"))
            self._scale, self._clip = np.sqrt(var + float(kept["epsilon"])), float(kept["clip_obs"])
            if var.shape != self._mean.shape or not np.isfinite(self._mean / self._scale).all():
                raise ValueError("mean and variance do not fit together")
        except Exception as error:  # a damaged pickle raises whatever its bytes lead to
            reason = " ".join(str(error).split())[:100]
            raise FileFormatError(
                f"{path} holds no statistics of VecNormalize ({type(error).__name__}: {reason}); save them by "
                "venv.save(FILE)."
            ) from error
        self.shape = self._mean.shape

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Normalise observations (B, *shape)."""
        return np.clip((observation - self._mean) / self._scale, -self._clip, self._clip).astype(np.float32)


def statistics_for(said: str | None, network: Path) -> Statistics | None:
    """Read the statistics of a network: of the file that was said, or of the one beside it, by the usual names.

    `vec_normalize.pkl` and `vecnormalize.pkl` go with all files of the folder, `NAME_vecnormalize.pkl` with `NAME.zip`,
    and `P_vecnormalize_1000_steps.pkl` with `P_1000_steps.zip`. Others, or in a folder beside, are asked about.

    Args:
        said: A file, or "none"; None: nothing was said.
        network: The network's file.

    Raises:
        FileFormatError: The file holds none.
        InputError: Some lie beside the network, and it is not clear which one to use (ONNX may hold its own).
    """
    if said is None:
        folder = network.parent
        there = {
            p: _NAME.sub("", p.stem).strip("_")
            for p in sorted((*folder.glob("*.pkl"), *folder.glob("*/*ormalize*.pkl")))
            if p.parent == folder or not any(p.parent.glob("*.zip"))
            if _NAME.search(p.stem) or (p.is_file() and b"VecNormalize" in np.fromfile(p, np.uint8, 200).tobytes())
        }
        beside = {p: of for p, of in there.items() if p.parent == folder}
        own = [p for p, of in beside.items() if of == network.stem] or [p for p, of in beside.items() if not of]
        if there and (len(own) != 1 or network.suffix.lower() != ".zip"):
            raise InputError(
                f"Beside {network} lies {', '.join(str(p.relative_to(folder)) for p in there)}. Say by which file the "
                "observations that go into the network were normalised: --av-statistics FILE, or --av-statistics none."
            )
        said = str(own[0]) if own else "none"
    return None if said == "none" else Statistics(Path(said))
