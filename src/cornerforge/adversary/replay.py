"""Replay memory: a ring of transitions in NumPy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.sim.drive_bv import Transitions
from cornerforge.sim.observe import N_OBSERVATION
from cornerforge.types import N_ACTIONS

__all__ = ["ReplayMemory", "allocate_transitions"]


def allocate_transitions(n: int, n_inputs: int = N_OBSERVATION) -> Transitions:
    """Room for n transitions with observations of `n_inputs` entries."""
    return Transitions(
        np.zeros((n, n_inputs), dtype=np.float32),
        np.zeros(n, dtype=np.int64),
        np.zeros(n, dtype=np.float32),
        np.zeros(n, dtype=np.bool_),
        np.zeros((n, n_inputs), dtype=np.float32),
        np.zeros((n, N_ACTIONS), dtype=np.bool_),
    )


class ReplayMemory:
    """The last `capacity` transitions; the oldest are overwritten.

    Args:
        capacity: How many, at least 1.
        n_inputs: Entries of an observation.
    """

    def __init__(self, capacity: int, n_inputs: int = N_OBSERVATION) -> None:
        self.capacity = capacity
        self._n_inputs = n_inputs
        self.arrays = allocate_transitions(capacity, n_inputs)
        self.size = 0
        self.place = 0

    def add(self, batch: Transitions) -> None:
        """Append a batch of at most `capacity` transitions."""
        n = batch.action.size
        first = min(n, self.capacity - self.place)
        for name in Transitions._fields:
            ring: NDArray[Any] = getattr(self.arrays, name)
            new: NDArray[Any] = getattr(batch, name)
            ring[self.place : self.place + first] = new[:first]
            ring[: n - first] = new[first:]
        self.place = (self.place + n) % self.capacity
        self.size = min(self.size + n, self.capacity)

    def room(self, n: int) -> Transitions:
        """Room for n transitions like those that it holds."""
        return allocate_transitions(n, self._n_inputs)

    def sample(self, indices: NDArray[np.int64], out: Transitions) -> None:
        """Copy the transitions at `indices`, each in [0, size), into `out` (`room` of that many)."""
        for name in Transitions._fields:
            # mode: without it NumPy copies by way of another array, to leave `out` alone if an index is wrong.
            np.take(getattr(self.arrays, name), indices, axis=0, out=getattr(out, name), mode="clip")

    def state(self) -> dict[str, NDArray[Any]]:
        """Views of what is filled, by name of the field of `Transitions`; with `place` that is all it remembers."""
        return {name: getattr(self.arrays, name)[: self.size] for name in Transitions._fields}

    def restore(self, state: Mapping[str, NDArray[Any]], place: int) -> None:
        """Take over what `state` gave, with `place` of that moment.

        Raises:
            ValueError: It does not fit into this memory.
        """
        self.size = state[Transitions._fields[0]].shape[0]
        self.place = place
        for name in Transitions._fields:
            getattr(self.arrays, name)[: self.size] = state[name]
