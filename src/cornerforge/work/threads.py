"""A pool of threads that yields results in order, and buffers for its threads."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

__all__ = ["Rooms", "default_threads", "in_threads", "is_given_up"]

T = TypeVar("T")


def default_threads() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_here = threading.local()


def is_given_up() -> bool:
    """Is the work of this thread not wanted any more, after an interrupt say? Long work asks, and raises then."""
    given_up = getattr(_here, "given_up", None)
    return given_up is not None and given_up.is_set()


def in_threads(
    work: Callable[[int, int], T],
    first: int,
    total: int,
    *,
    chunk: int,
    threads: int,
    pool: ThreadPoolExecutor | None = None,
) -> Generator[T, None, None]:
    """Do what `spread.in_order` does, in threads; at most two ranges a thread are begun and not yet yielded."""
    starts = iter(range(first, first + total, chunk))
    pending: deque[Future[T]] = deque()
    given_up = threading.Event()

    def begin(start: int, count: int) -> T:
        _here.given_up = given_up
        return work(start, count)

    with contextlib.nullcontext(pool) if pool is not None else ThreadPoolExecutor(threads) as at:
        try:
            while True:
                while len(pending) < 2 * threads and (start := next(starts, None)) is not None:
                    pending.append(at.submit(begin, start, min(chunk, first + total - start)))
                if not pending:
                    return
                yield pending.popleft().result()
        finally:
            given_up.set()
            for future in pending:
                future.cancel()


class Rooms(Generic[T]):
    """Buffers for work: one thread at a time uses each; a new one is made when none is free.

    Rooms that are sent to another process are empty there.

    Args:
        make: Makes a buffer.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._idle: SimpleQueue[T] = SimpleQueue()

    def __reduce__(self) -> tuple[type[Rooms[T]], tuple[Callable[[], T]]]:
        return Rooms, (self._make,)

    @contextmanager
    def lend(self) -> Iterator[T]:
        """Give a buffer to the block while it runs; after an exception the buffer is not used again."""
        try:
            room = self._idle.get_nowait()
        except Empty:
            room = self._make()
        yield room
        self._idle.put(room)
