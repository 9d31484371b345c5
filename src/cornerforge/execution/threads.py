"""A pool of threads that gives results in order."""

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
    """Cores that this process may use."""
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
    """Work on first .. first + total - 1 in ranges, and yield what each gave, in their order.

    At most two ranges a thread are begun and not yet yielded, so memory does not grow with the total. Closing the
    iterator early, or an exception out of it, drops what is not yet begun.

    Args:
        work: Gets the first number of a range and how many; called from several threads.
        first: The first number.
        total: How many, 0 or more.
        chunk: Numbers in a range; the last may be shorter.
        threads: 1 to 1,024. What is yielded does not depend on it if `work` depends on its range alone.
        pool: To work in, of so many threads; None: one of its own.

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
    """Buffers for work in threads: each is lent to one at a time, made when none is free, and used again.

    Args:
        make: Makes a buffer.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._idle: SimpleQueue[T] = SimpleQueue()

    @contextmanager
    def lend(self) -> Iterator[T]:
        """A buffer for as long as the block runs; after an exception it is not used again."""
        try:
            room = self._idle.get_nowait()
        except Empty:
            room = self._make()
        yield room
        self._idle.put(room)
