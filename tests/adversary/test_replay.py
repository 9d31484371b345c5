"""The replay memory is a ring of whole transitions; the balanced one also keeps tests that were paid for."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cornerforge.adversary.replay import BalancedMemory, ReplayMemory, allocate_transitions
from cornerforge.adversary.worlds.drive_bv import Transitions


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


# The balanced memory. An observation tells its test, its number in it, and whether the test will be paid for.


class Stream:
    """Worlds whose tests last 1 to 5 decisions; one test in `one_in` is paid."""

    def __init__(self, worlds: int, one_in: float, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._one_in, self._tests = one_in, worlds
        self._now = [self._new(w) for w in range(worlds)]

    def _new(self, test: int) -> list[int]:
        return [test, 0, int(self._rng.integers(1, 6)), int(self._rng.random() * self._one_in < 1.0)]

    def step(self) -> Transitions:
        batch = allocate_transitions(len(self._now))
        for w, (test, k, length, paid) in enumerate(self._now):
            batch.observation[w, :3] = test, k, paid
            batch.end[w] = k + 1 == length
            batch.reward[w] = (1.0 if paid else -1.0) if batch.end[w] else 0.0
            if batch.end[w]:
                self._now[w] = self._new(self._tests)
                self._tests += 1
            else:
                self._now[w][1] += 1
        return batch


def steps_of(memory: ReplayMemory) -> set[tuple[int, int]]:
    told = memory.arrays.observation[: memory.size].astype(int)
    return {(test, k) for test, k, _ in told[:, :3].tolist()}


@given(st.integers(1, 9), st.integers(10, 100), st.integers(1, 60), st.integers(0, 2**32))
def test_paid_tests_are_kept_whole_and_no_others(worlds: int, capacity: int, steps: int, seed: int) -> None:
    stream, memory = Stream(worlds, 3.0, seed), BalancedMemory(max(capacity, 6 * worlds), share=1.0)
    finished: dict[int, int] = {}
    for _ in range(steps):
        batch = stream.step()
        memory.add(batch)
        finished |= {int(t): int(k) + 1 for t, k, _ in batch.observation[batch.end & (batch.reward > 0.0), :3].tolist()}
    kept, paid = memory.paid.arrays.observation[: memory.paid.size, :3], memory.recent.arrays.observation[:, 2]
    assert (kept[:, 2] == 1.0).all()
    if memory.paid.size < memory.paid.capacity:
        assert steps_of(memory.paid) == {(test, k) for test, n in finished.items() for k in range(n)}
    # In the last transitions the same are marked: those of paid tests that have ended.
    test = memory.recent.arrays.observation[: memory.recent.size, 0].astype(int)
    marked = memory.state()["is_paid"][: memory.recent.size]
    assert np.array_equal(marked, np.isin(test, list(finished)))
    assert paid[: memory.recent.size][marked].all()


def test_a_batch_holds_the_share_of_paid_tests_that_was_asked_for() -> None:
    """A tolerance of 5 standard errors of a binomial share."""
    batch, rng = allocate_transitions(1000), np.random.default_rng(1)
    for one_in, share, expected in ((50.0, 0.5, 0.5), (1.0, 0.25, 1.0)):
        stream, memory = Stream(32, one_in, 2), BalancedMemory(40_000, share=share)
        for _ in range(2000):
            memory.add(stream.step())
        memory.draw(rng, batch)
        assert memory.paid_share < 0.05 or one_in == 1.0
        if one_in > 1.0:
            assert abs((batch.observation[:, 2] == 1.0).mean() - expected) < 5.0 * np.sqrt(0.25 / 1000)
        else:
            assert (batch.observation[:, 2] == 1.0).mean() == 1.0
            assert memory.paid.size < 32 * 10  # where pay is not scarce nothing is kept twice


def test_without_a_share_it_draws_as_the_ring_does() -> None:
    ring, memory = ReplayMemory(64), BalancedMemory(64)
    ring.add(numbered(0, 50))
    memory.add(numbered(0, 50))
    drawn, expected = memory.room(20), ring.room(20)
    memory.draw(np.random.default_rng(3), drawn)
    ring.sample(np.random.default_rng(3).integers(0, 50, 20), expected)
    check_whole(drawn, expected.action)


def test_the_balanced_memory_goes_on_from_its_state() -> None:
    stream, memory = Stream(8, 10.0, 5), BalancedMemory(200, share=0.5)
    for _ in range(100):
        memory.add(stream.step())
    again = BalancedMemory(200, share=0.5)
    again.restore({name: array.copy() for name, array in memory.state().items()}, memory.places)
    for _ in range(30):
        batch = stream.step()
        memory.add(batch)
        again.add(batch)
    one, other = memory.room(64), memory.room(64)
    memory.draw(np.random.default_rng(0), one)
    again.draw(np.random.default_rng(0), other)
    assert np.array_equal(one.observation, other.observation)
    assert memory.places == again.places
