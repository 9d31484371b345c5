"""A pool of threads that yields results in order, and buffers lent to its threads."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from cornerforge._checks import check_integer

__all__ = ["Rooms", "default_threads", "in_order"]

T = TypeVar("T")


def default_threads() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(
    work: Callable[[int, int], T],
    first: int,
    total: int,
    *,
    chunk: int,
    threads: int,
    pool: ThreadPoolExecutor | None = None,
) -> Generator[T, None, None]:
    """Work on first .. first + total - 1 in ranges, and yield the ranges' results in order.

    At most two ranges a thread are begun and not yet yielded, so memory does not grow with the total. Closing the
    iterator early, or an exception out of it, drops the ranges not yet begun.

    Args:
        work: Takes the first number and the size of a range; called from several threads.
        first: The first number.
        total: Number of numbers, 0 or more.
        chunk: Size of a range; the last may be smaller.
        threads: 1 to 1,024. The results do not depend on it if `work` depends on its range alone.
        pool: A pool of `threads` threads to work in; None: one is made for this call.

    Raises:
        InputError: `threads` or `chunk` is out of range.
    """
    check_integer("threads", threads, low=1, high=1024)
    check_integer("chunk", chunk, low=1)
    starts = iter(range(first, first + total, chunk))
    pending: deque[Future[T]] = deque()
    with contextlib.nullcontext(pool) if pool is not None else ThreadPoolExecutor(threads) as at:
        try:
            while True:
                while len(pending) < 2 * threads and (start := next(starts, None)) is not None:
                    pending.append(at.submit(work, start, min(chunk, first + total - start)))
                if not pending:
                    return
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()


class Rooms(Generic[T]):
    """Buffers for work in threads: each is lent to one thread at a time, made when none is free, and used again.

    Args:
        make: Makes a buffer.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._idle: SimpleQueue[T] = SimpleQueue()

    @contextmanager
    def lend(self) -> Iterator[T]:
        """Lend a buffer for as long as the block runs; after an exception it is not used again."""
        try:
            room = self._idle.get_nowait()
        except Empty:
            room = self._make()
        yield room
        self._idle.put(room)
