"""Work in ranges: in order, few at a time, dropped when nobody wants it."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from cornerforge import execution, work
from cornerforge.errors import InputError
from cornerforge.work import Rooms, in_order


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize(("total", "chunk"), [(0, 5), (1, 5), (10, 5), (23, 4)])
def test_results_come_in_order_and_cover_the_range(threads: int, total: int, chunk: int) -> None:
    def work(start: int, count: int) -> range:
        time.sleep(0.002 * (start % 3))  # later ranges may be done first
        return range(start, start + count)

    parts = list(in_order(work, 7, total, chunk=chunk, threads=threads))
    assert [n for part in parts for n in part] == list(range(7, 7 + total))
    assert all(len(part) == chunk for part in parts[:-1])


def test_little_is_begun_ahead_and_what_is_not_wanted_is_dropped() -> None:
    begun: list[int] = []
    pool = ThreadPoolExecutor(2)
    results = in_order(lambda start, _: begun.append(start), 0, 1000, chunk=1, threads=2, pool=pool)
    next(results)
    time.sleep(0.05)
    assert len(begun) <= 4
    results.close()
    assert pool.submit(int).result() == 0, "a pool that was given is left open"
    pool.shutdown()
    assert len(begun) <= 4


def test_an_exception_arrives_where_its_result_would() -> None:
    def work(start: int, _: int) -> int:
        if start == 4:
            raise ValueError("four")
        return start

    results = in_order(work, 0, 10, chunk=2, threads=2)
    assert [next(results), next(results)] == [0, 2]
    with pytest.raises(ValueError, match="four"):
        next(results)


def test_numbers_out_of_range_are_named() -> None:
    with pytest.raises(InputError, match="threads"):
        next(in_order(lambda *_: 0, 0, 1, chunk=1, threads=0))
    with pytest.raises(InputError, match="chunk"):
        next(in_order(lambda *_: 0, 0, 1, chunk=0, threads=1))


def test_a_room_serves_one_at_a_time_and_is_used_again() -> None:
    made: list[int] = []

    def make() -> list[int]:
        made.append(0)
        return []

    rooms = Rooms(make)
    barrier = threading.Barrier(2)

    def work(start: int, _: int) -> int:
        with rooms.lend() as room:
            if start < 2:
                barrier.wait(timeout=10)  # two at the same time need two rooms
            room.append(start)
            return len(room)

    assert sum(1 for _ in in_order(work, 0, 40, chunk=1, threads=2)) == 40
    assert len(made) == 2
    with pytest.raises(ValueError, match="spoiled"), rooms.lend():
        raise ValueError("spoiled")
    with rooms.lend(), rooms.lend():
        assert len(made) == 3


def test_the_earlier_name_gives_the_same() -> None:
    assert sorted(execution.__all__) == sorted(work.__all__)
    assert all(getattr(execution, name) is getattr(work, name) for name in work.__all__)
