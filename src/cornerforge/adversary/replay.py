"""Replay memory: a ring of transitions in NumPy arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.adversary.worlds import Transitions
from cornerforge.sim import observe
from cornerforge.types import N_ACTIONS

__all__ = ["KEPT", "BalancedMemory", "ReplayMemory", "allocate_transitions"]

KEPT = tuple(name for name in Transitions._fields if name not in ("allowed", "log_prob"))
"""Fields of `Transitions` that a replay memory holds; a learning target needs no others."""


def allocate_transitions(n: int, n_inputs: int = observe.N_OBSERVATION) -> Transitions:
    """Allocate n transitions with observations of `n_inputs` entries."""
    return Transitions(
        np.zeros((n, n_inputs), dtype=np.float32),
        np.zeros((n, N_ACTIONS), dtype=np.bool_),
        np.zeros(n, dtype=np.int64),
        np.zeros(n, dtype=np.float32),
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

    def __init__(self, capacity: int, n_inputs: int = observe.N_OBSERVATION) -> None:
        self.capacity = capacity
        self._n_inputs = n_inputs
        self.arrays = allocate_transitions(capacity, n_inputs)
        self.size = 0
        self.place = 0

    def add(self, batch: Transitions) -> None:
        """Append a batch of at most `capacity` transitions."""
        n = batch.action.size
        first = min(n, self.capacity - self.place)
        for name in KEPT:
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
        for name in KEPT:
            # mode: without it NumPy copies by way of another array, to leave `out` alone if an index is wrong.
            np.take(getattr(self.arrays, name), indices, axis=0, out=getattr(out, name), mode="clip")

    def state(self) -> dict[str, NDArray[Any]]:
        """Give views of the filled part, by name in `KEPT`; with `place` this is the whole state."""
        return {name: getattr(self.arrays, name)[: self.size] for name in KEPT}

    def restore(self, state: Mapping[str, NDArray[Any]], place: int) -> None:
        """Restore the state that `state` gave, with `place` of the same moment.

        Raises:
            ValueError: It does not fit into this memory.
        """
        self.size = state[KEPT[0]].shape[0]
        self.place = place
        for name in KEPT:
            getattr(self.arrays, name)[: self.size] = state[name]


class BalancedMemory:
    """Replay memory that holds transitions of paid tests for longer, so that batches contain enough of them.

    A test is paid if its last reward is above 0. Where one test in thousands is, a batch drawn uniformly from all
    transitions says nearly nothing about what leads there. With a fixed share from paid tests the network learns
    not the probability of pay but a value that grows with it: the odds of every action are multiplied by the same
    factor, which keeps their order (ADR 7).

    Args:
        capacity: Of the last transitions; a quarter as many from paid tests.
        n_inputs: Entries of an observation.
        share: At least this share of a batch comes from paid tests, as soon as a batch of them is there; 0 draws
            uniformly from the last transitions.

    Attributes:
        recent, paid: The two memories.
    """

    def __init__(self, capacity: int, n_inputs: int = observe.N_OBSERVATION, share: float = 0.0) -> None:
        self.recent = ReplayMemory(capacity, n_inputs)
        self.paid = ReplayMemory(max(capacity // 4, 1), n_inputs)
        self._share = share
        self._is_paid = np.zeros(capacity, dtype=np.bool_)
        self._n_paid = 0

    @property
    def paid_share(self) -> float:
        """Share of the last transitions that are known to be from paid tests."""
        return self._n_paid / max(self.recent.size, 1)

    def add(self, batch: Transitions) -> None:
        """Append one decision of each of some worlds; with a share above 0 always of the same worlds in the same order.

        A test is paid if its last transition has a reward above 0.
        """
        begin = self.recent.place
        self.recent.add(batch)
        if self._share == 0.0:
            return
        n = batch.action.size
        self._mark((begin + np.arange(n)) % self.recent.capacity, np.False_)
        rows = self._tests_before(begin, np.flatnonzero(batch.end & (batch.reward > 0.0)), n)
        is_scarce = self.paid_share < self._share
        self._mark(rows, np.True_)
        if is_scarce:
            rows = rows[-self.paid.capacity :]
            self.paid.add(Transitions._make(array[rows] for array in self.recent.arrays))

    def _mark(self, rows: NDArray[np.int64] | slice, is_paid: np.bool_ | NDArray[np.bool_]) -> None:
        """Mark which of the last transitions are from paid tests, and count them, because every draw needs that."""
        self._is_paid[rows] = is_paid
        self._n_paid = int(np.count_nonzero(self._is_paid))

    def _tests_before(self, begin: int, worlds: NDArray[np.int64], n: int) -> NDArray[np.int64]:
        """Find the rows still in memory of the tests that end in these worlds in the batch of `n` rows at `begin`."""
        rows = [(begin + worlds) % self.recent.capacity]
        for back in range(1, self.recent.size // n):
            if worlds.size == 0:
                break
            row = (begin + worlds - back * n) % self.recent.capacity
            goes_on = ~self.recent.arrays.end[row]
            worlds = worlds[goes_on]
            rows.append(row[goes_on])
        return np.concatenate(rows)

    def room(self, n: int) -> Transitions:
        """Room for n transitions like those that it holds."""
        return self.recent.room(n)

    def draw(self, rng: np.random.Generator, out: Transitions) -> None:
        """Draw as many transitions as `out` holds, with replacement; at least one must have been added."""
        n = out.action.size
        by_chance = self.paid_share
        more = 0
        if by_chance < self._share and self.paid.size >= n:
            more = round(n * (self._share - by_chance) / (1.0 - by_chance))
        recent, paid = (Transitions._make(part[rows] for part in out) for rows in (slice(n - more), slice(n - more, n)))
        self.recent.sample(rng.integers(0, self.recent.size, n - more), recent)
        if more:
            self.paid.sample(rng.integers(0, self.paid.size, more), paid)

    def state(self) -> dict[str, NDArray[Any]]:
        """Give views of both memories, by name; with `places` this is the whole state."""
        parts = {f"recent.{name}": array for name, array in self.recent.state().items()}
        parts |= {f"paid.{name}": array for name, array in self.paid.state().items()}
        return parts | {"is_paid": self._is_paid}

    @property
    def places(self) -> list[int]:
        """Where the next transitions go in the two memories."""
        return [self.recent.place, self.paid.place]

    def restore(self, state: Mapping[str, NDArray[Any]], places: Sequence[int]) -> None:
        """Restore the state that `state` and `places` gave.

        Raises:
            KeyError, ValueError: Something is missing or does not fit into this memory.
        """
        for memory, name, place in zip((self.recent, self.paid), ("recent", "paid"), places, strict=True):
            memory.restore({key: state[f"{name}.{key}"] for key in KEPT}, place)
        self._mark(slice(None), state["is_paid"])
