"""The replay memory is a ring: the newest transitions, each with all its parts."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.adversary.replay import ReplayMemory, allocate_transitions
from cornerforge.sim.drive_bv import Transitions


def numbered(first: int, n: int) -> Transitions:
    """Transitions whose every part tells their number."""
    batch = allocate_transitions(n)
    number = np.arange(first, first + n)
    batch.observation[:] = number[:, None]
    batch.action[:] = number
    batch.reward[:] = -number
    batch.end[:] = number % 2 == 0
    batch.next_observation[:] = number[:, None] + 0.5
    batch.next_allowed[np.arange(n), number % 33] = True
    return batch


def check_whole(found: Transitions, number: np.ndarray) -> None:
    assert np.array_equal(found.action, number)
    assert np.array_equal(found.reward, -number.astype(np.float32))
    assert np.array_equal(found.end, number % 2 == 0)
    assert (found.observation == number[:, None]).all()
    assert (found.next_observation == number[:, None] + 0.5).all()
    assert np.array_equal(found.next_allowed.argmax(axis=1), number % 33)
    assert (found.next_allowed.sum(axis=1) == 1).all()


@given(st.data(), st.integers(1, 12))
def test_the_ring_holds_the_newest_each_whole(data: st.DataObject, capacity: int) -> None:
    sizes = data.draw(st.lists(st.integers(0, capacity), max_size=8))
    memory = ReplayMemory(capacity)
    total = 0
    for n in sizes:
        memory.add(numbered(total, n))
        total += n
        assert memory.size == min(total, capacity)
        newest = np.arange(total - memory.size, total)
        found = memory.room(newest.size)
        memory.sample(newest % capacity, found)
        check_whole(found, newest)  # number k always stands at place k mod capacity


def test_samples_are_copies() -> None:
    memory = ReplayMemory(4)
    memory.add(numbered(0, 4))
    sample = memory.room(2)
    memory.sample(np.array([1, 1]), sample)
    memory.add(numbered(4, 4))
    check_whole(sample, np.array([1, 1]))
