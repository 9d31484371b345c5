"""The common part of AVs from network files: what they observe, evaluation in blocks, and the meaning of outputs."""

from __future__ import annotations

import math
import shlex
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError
from cornerforge.foreign.interface import VIEW_SHAPE, Av

if TYPE_CHECKING:
    from cornerforge.foreign.normalised import Statistics

__all__ = [
    "ACTIONS",
    "BLOCK",
    "BOUNDS",
    "FLAT",
    "LANE_ORDER_FROM",
    "N_ACTIONS",
    "SIZES",
    "NetworkAv",
    "Reading",
    "answers_of_actions",
    "answers_of_box",
    "answers_of_index",
    "answers_of_numbers",
    "form_of",
    "frames_in",
    "is_scaled",
]

BLOCK = 64
"""Rows of one evaluation. Matrix libraries round differently for other numbers of rows; with a fixed number an answer
does not depend on how many worlds are driven side by side."""
FLAT = (math.prod(VIEW_SHAPE),)
"""Shape of a view without rows."""
SIZES = np.array([1.0, 50.0, 4.0, 30.0, 2.0, 4.0, 2.0, 1.0], dtype=np.float32)
"""Usual sizes of the columns of a view, by which `cornerforge/Driving-v0` divides it."""
_SIGHT = 200.0
LANE_ORDER_FROM = 1.0 / 3.0
"""A network's second number beyond this is a lane order."""
N_ACTIONS = 33
"""Actions of `cornerforge.types`. An AV's process has NumPy only, so what they do stands here again, and a test holds
the two together."""
_ACCELERATIONS = np.concatenate([[0.0, 0.0], np.round(np.arange(-20, 11) * 0.2, 1)])
_SIDES = np.array([1.0, -1.0] + 31 * [0.0])
_BRAKING, _ACCELERATION = 8.0, 2.0
_MOST_FRAMES = 64


@dataclass(frozen=True)
class Reading:
    """The word of a user on a network, where its file has none.

    Attributes:
        actions: What its outputs are, a name of `ACTIONS`; None: as the file says.
        statistics: File by which observations were normalised, or "none"; None: what lies beside the network.
        compares: Whether its maker's library answers too, where it is installed.
    """

    actions: str | None = None
    statistics: str | None = None
    compares: bool = False

    def options(self) -> str:
        """Write it as options of the command line, with a blank before each."""
        said = {"actions": self.actions, "statistics": self.statistics}
        return "".join(f" --av-{name} {shlex.quote(value)}" for name, value in said.items() if value is not None)


def answers_of_actions(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make answers (B, 2) from the best of 33 values in each row (B, 33); NaN where a value is NaN."""
    return answers_of_index(np.where(np.isnan(values).any(axis=1), np.nan, np.argmax(values, axis=1)))


def answers_of_index(index: NDArray[np.number]) -> NDArray[np.float64]:
    """Make answers (B, 2) from numbers of actions, (B,) or (B, 1); NaN where one is no whole number from 0 to 32.

    >>> answers_of_index(np.array([0, 32, 33]))
    array([[ 0.,  1.],
           [ 2.,  0.],
           [nan, nan]])
    """
    given = np.asarray(index, dtype=np.float64).reshape(len(index))
    known = (given >= 0) & (given < N_ACTIONS) & (given == np.floor(given))
    row = np.where(known, given, 0.0).astype(np.int64)
    return np.where(known[:, None], np.stack([_ACCELERATIONS[row], _SIDES[row]], axis=1), np.nan)


def answers_of_numbers(outputs: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make answers (B, 2) from outputs (B, 2): acceleration [m/s2], and lane wish: above 1/3 left, below -1/3 right.

    >>> answers_of_numbers(np.array([[-3.0, 0.2], [1.0, -0.9]]))
    array([[-3.,  0.],
           [ 1., -1.]])
    """
    answers = np.array(outputs, dtype=np.float64)
    wish = answers[:, 1]
    order = (wish > LANE_ORDER_FROM).astype(np.float64) - (wish < -LANE_ORDER_FROM)
    answers[:, 1] = np.where(np.isfinite(wish), order, np.nan)
    return answers


def answers_of_box(outputs: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make answers (B, 2) from outputs (B, 2) of `Box(-1, 1, (2,))`, cut to it: the first times 8 or 2 m/s2, lane wish.

    >>> answers_of_box(np.array([[-0.5, 0.2], [3.0, -0.9]]))
    array([[-4.,  0.],
           [ 2., -1.]])
    """
    wish = np.clip(np.asarray(outputs, dtype=np.float64), -1.0, 1.0)
    wish[:, 0] *= np.where(wish[:, 0] < 0.0, _BRAKING, _ACCELERATION)
    return answers_of_numbers(wish)


ACTIONS: dict[str, tuple[str, Callable[[NDArray[np.floating]], NDArray[np.float64]]]] = {
    "box": ("two numbers of Box(-1, 1): the first times 8 or 2 m/s2, the second a lane wish", answers_of_box),
    "si": ("an acceleration in m/s2 and a lane wish", answers_of_numbers),
    "number": ("the number of one of the 33 actions", answers_of_index),
    "values": ("values of the 33 actions, of which the largest is taken", answers_of_actions),
}
"""What outputs may be, by name: in words, and how answers are made of them."""
BOUNDS = {"box": ([-1.0, -1.0], [1.0, 1.0]), "si": ([-8.0, -1.0], [2.0, 1.0])}
"""Action spaces of two numbers, lowest and highest, by the names of `ACTIONS`."""


def form_of(low: Any, high: Any) -> str | None:
    """Find the name in `ACTIONS` of an action space by its lowest and highest numbers; None: it is another."""
    bounds = [np.asarray(bound, dtype=np.float64).ravel().tolist() for bound in (low, high)]
    return next((name for name, known in BOUNDS.items() if bounds == list(known)), None)


def frames_in(shape: tuple[int, ...]) -> int:
    """Say how many successive views, oldest first, an observation of a shape holds; 0 if it is no observation.

    >>> frames_in((13, 8)), frames_in((104,)), frames_in((13, 32)), frames_in((208,)), frames_in((12, 8))
    (1, 1, 4, 2, 0)
    """
    whole, rest = divmod(math.prod(shape), FLAT[0])
    is_one = len(shape) == 1 or (len(shape) == 2 and shape[0] == VIEW_SHAPE[0])
    return whole if is_one and rest == 0 and whole <= _MOST_FRAMES else 0


def is_scaled(high: NDArray[np.floating]) -> bool:
    """Say by the upper ends of an observation space whether views are divided by `SIZES`; else they have SI units.

    >>> high = np.tile([1.0, 200.0, 11.0, 40.0, 25.0, 2.0, 2.0, 1.0], (13, 1)).astype(np.float32)
    >>> is_scaled(high), is_scaled(high / SIZES), is_scaled((high / SIZES).ravel()), is_scaled(np.full(104, np.inf))
    (False, True, True, False)
    """
    row = high.reshape(VIEW_SHAPE[0], -1)[1, : SIZES.size] if frames_in(high.shape) else high
    return row.shape == SIZES.shape and bool(row[1] * SIZES[1] == _SIGHT)


class NetworkAv(Av):
    """An AV whose answer is a function of the view, or of the last views, evaluated block by block.

    Args:
        shape: Of an observation, k views (`frames_in`); those before the first are 0.
        actions: What outputs are, a name of `ACTIONS`.
        statistics: How observations are normalised; None: they are not.
        block: Rows of one evaluation.
        scaled: Views are divided by `SIZES` before all else.

    Raises:
        FileFormatError: The statistics are those of others.
    """

    def __init__(
        self, shape: tuple[int, ...], actions: str, statistics: Statistics | None, block: int = BLOCK,
        *, scaled: bool = False,
    ) -> None:  # fmt: skip
        self.shape, self.actions, self.frames, self._block = shape, actions, frames_in(shape), block
        self.scaled = scaled
        self._frame = VIEW_SHAPE if len(shape) == 2 else FLAT
        self._normal = statistics if statistics is not None and statistics.shape else None
        self._past = np.zeros((0, *shape), dtype=np.float32)
        if self._normal is not None and self._normal.shape not in (shape, self._frame):
            raise FileFormatError(
                f"{self._normal.path} is for observations of shape {self._normal.shape}; the AV's are {shape}."
            )

    @abstractmethod
    def evaluate(self, observation: NDArray[np.float32]) -> NDArray[np.floating]:
        """Compute outputs (block, 2), (block, 33) or (block,) for observations (block, *shape)."""

    def reset(self, worlds: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:  # noqa: ARG002 - nothing is drawn
        """See `Av.reset`."""
        if len(self._past):
            self._past[worlds] = 0.0

    def observed(self, view: NDArray[np.float32]) -> NDArray[np.float32]:
        """Make observations (B, *shape) of views (B, 13, 8), and remember these."""
        rows, normal = (view / SIZES if self.scaled else view).reshape(len(view), *self._frame), self._normal
        if normal is not None and normal.shape == self._frame:
            rows, normal = normal(rows), None
        if self.frames > 1:
            if len(self._past) != len(view):
                self._past = np.zeros((len(view), *self.shape), dtype=np.float32)
            drives = view[:, 0, 0] == 1.0
            last = self._past[drives][..., self._frame[-1] :]
            self._past[drives] = np.concatenate([last, rows[drives]], axis=-1)
            rows = self._past
        return rows if normal is None else normal(rows)

    def outputs(self, view: NDArray[np.float32]) -> NDArray[np.floating]:
        """Compute outputs for views (B, 13, 8)."""
        rows = -(-len(view) // self._block) * self._block
        padded = np.zeros((rows, *self.shape), dtype=np.float32)
        padded[: len(view)] = self.observed(view)
        parts = [self.evaluate(padded[k : k + self._block]) for k in range(0, rows, self._block)]
        return np.concatenate(parts)[: len(view)]

    def act(self, view: NDArray[np.float32]) -> NDArray[np.float64]:
        """See `Av.act`."""
        return ACTIONS[self.actions][1](self.outputs(view))
