"""Where ranges of work are computed: in threads of this process, or by the workers of a Ray cluster."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import TYPE_CHECKING, TypeVar

from cornerforge._checks import check_in, check_integer
from cornerforge._schema import check_value
from cornerforge.errors import InputError
from cornerforge.work.threads import in_threads

if TYPE_CHECKING:
    from cornerforge.work.cluster import Cluster

__all__ = ["ENGINES", "cpu_seconds", "engine", "in_order", "is_spread"]

T = TypeVar("T")

ENGINES = ("threads", "ray")
_cluster: ContextVar[Cluster | None] = ContextVar("cluster", default=None)


def engine(
    name: str = "threads", *, address: str | None = None, workers: int | None = None
) -> AbstractContextManager[None]:
    """Choose where tests are driven for as long as the block runs; no result depends on it.

    `simulate`, `generate`, `rate`, `plausibility`, `analyse` and all others that spread their work then use all
    machines of a cluster. AVs from outside drive in processes of this machine, so they need "threads".

    Args:
        name: "threads": this process; "ray": a Ray cluster (extra `ray`).
        address: Address of a running cluster, "HOST:PORT", or "auto" for the one that this machine belongs to; None:
            one of this machine alone is started, and stopped at the end of the block.
        workers: Ranges that are worked on at once, 1 to 100,000; None: as many as the cluster has cores.

    Raises:
        UnknownNameError, InputError: The engine is unknown, or there is an address without a cluster engine.
        MissingExtraError: Ray is not installed.
        EngineError: No cluster answers, or one of other versions.

    >>> with engine("threads"):
    ...     print(is_spread())
    False
    """
    check_value("name", name, str)
    check_value("address", address, str | None)
    check_value("workers", workers, int | None)
    check_in("engine", name, ENGINES)
    if workers is not None:
        check_integer("threads", workers, low=1, high=100_000)
    if name == "threads" and address is not None:
        raise InputError(f"address = {address!r} needs the engine ray: --engine ray --address {address}")
    return _chosen(name, address, workers)


@contextmanager
def _chosen(name: str, address: str | None, workers: int | None) -> Iterator[None]:
    from cornerforge.work.cluster import joined  # needs the extra "ray"

    with nullcontext() if name == "threads" else joined(address, workers) as cluster:
        token = _cluster.set(cluster)
        try:
            yield
        finally:
            _cluster.reset(token)


def is_spread() -> bool:
    """Say whether other processes do the work now."""
    return _cluster.get() is not None


def cpu_seconds() -> float:
    """Read the CPU time of this process and of what a cluster did for it [s]; only differences mean something."""
    cluster = _cluster.get()
    return time.process_time() + (0.0 if cluster is None else cluster.cpu_seconds)


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

    Few ranges are begun and not yet yielded, so memory does not grow with the total. Closing the iterator early, or an
    exception out of it, drops the ranges not yet begun.

    Args:
        work: Takes the first number and the size of a range; called from several threads, or sent to other machines:
            it must then say all that it needs, and return all that it made.
        first: The first number.
        total: Number of numbers, 0 or more.
        chunk: Size of a range; the last may be smaller.
        threads: 1 to 1,024; a cluster has a number of its own. The results do not depend on it if `work` depends on its
            range alone.
        pool: A pool of `threads` threads to work in; None: one is made for this call. A cluster does not use it.

    Raises:
        InputError: `threads` or `chunk` is out of range.
        EngineError: The cluster broke down.
    """
    check_integer("threads", threads, low=1, high=1024)
    check_integer("chunk", chunk, low=1)
    cluster = _cluster.get()
    if cluster is not None:
        yield from cluster.in_order(work, first, total, chunk=chunk)
    else:
        yield from in_threads(work, first, total, chunk=chunk, threads=threads, pool=pool)
