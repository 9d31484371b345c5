"""The common part of AVs from network files: evaluation in blocks of one size, and the meaning of outputs."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from cornerforge.foreign.interface import Av
from cornerforge.types import ACTION_ACCELERATIONS, ACTION_SIDES, N_ACTIONS

__all__ = ["BLOCK", "LANE_ORDER_FROM", "NetworkAv", "answers_of_actions", "answers_of_numbers"]

BLOCK = 64
"""Rows of one evaluation. Matrix libraries round differently for other numbers of rows; with a fixed number an answer
does not depend on how many worlds are driven side by side."""
LANE_ORDER_FROM = 1.0 / 3.0
"""A network's second number beyond this is a lane order."""


def answers_of_actions(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make answers (B, 2) from the best of 33 values in each row (B, 33); NaN where a value is NaN."""
    best = np.argmax(values, axis=1)
    answers = np.stack([ACTION_ACCELERATIONS[best], ACTION_SIDES[best]], axis=1)
    answers[np.isnan(values).any(axis=1)] = np.nan
    return answers


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


class NetworkAv(Av):
    """An AV whose answer is a function of the view, evaluated block by block.

    Args:
        block: Rows of one evaluation.
    """

    def __init__(self, block: int = BLOCK) -> None:
        self._block = block

    @abstractmethod
    def evaluate(self, view: NDArray[np.float32]) -> NDArray[np.floating]:
        """Compute outputs (block, 2) or (block, 33) for views (block, 13, 8)."""

    def act(self, view: NDArray[np.float32]) -> NDArray[np.float64]:
        """See `Av.act`."""
        rows = -(-len(view) // self._block) * self._block
        padded = np.zeros((rows, *view.shape[1:]), dtype=np.float32)
        padded[: len(view)] = view
        outputs = [self.evaluate(padded[k : k + self._block]) for k in range(0, rows, self._block)]
        merged = np.concatenate(outputs)[: len(view)]
        return answers_of_actions(merged) if merged.shape[1] == N_ACTIONS else answers_of_numbers(merged)
