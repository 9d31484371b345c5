"""Ranges of work on a Ray cluster: the same results, whichever worker runs or fails.

A range that was lost with its worker or its machine is worked on again by another; that changes no
result, since a result depends on its range alone. See docs/many-machines.md.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from cornerforge.errors import EngineError, MissingExtraError
from cornerforge.work.code import code_hash
from cornerforge.work.threads import default_threads

__all__ = ["Cluster", "joined"]

T = TypeVar("T")

_TASK_SECONDS = 0.25
"""Ranges are sent together until they take so long: what Ray needs for a task is then a small share."""
_MOST_TOGETHER = 64
_RETRIES = 20
_LOOK_SECONDS = 5.0
_PATIENCE_SECONDS = 60.0


class Cluster:
    """A cluster that was joined.

    Args:
        ray: The module.
        workers: Ranges at once; None: as many as there are cores, also when machines come or go.
    """

    def __init__(self, ray: Any, workers: int | None) -> None:
        self._ray, self._given = ray, workers
        self._task = ray.remote(_task()).options(num_cpus=1, max_retries=_RETRIES)
        self._cores, self._looked = 0, -1.0
        self.cpu_seconds = 0.0
        """Processor time of the workers so far."""

    def _workers(self) -> int:
        """Say for how many workers there is to be work."""
        now = time.monotonic()
        if self._cores == 0 or now - self._looked > _LOOK_SECONDS:
            self._cores, self._looked = int(self._ray.cluster_resources().get("CPU", 0)), now
        return max(1, self._cores if self._given is None else self._given)

    def in_order(
        self, work: Callable[[int, int], T], first: int, total: int, *, chunk: int
    ) -> Generator[T, None, None]:
        """Do what `spread.in_order` does.

        Raises:
            EngineError: The work cannot be sent, a machine has other code, or the cluster broke down.
        """
        ray = self._ray
        try:
            packed = ray.cloudpickle.dumps(work)
        except Exception as error:
            raise EngineError(
                f"This work cannot be sent to other machines ({error}); leave out --engine ray."
            ) from error
        parcel, name = ray.put(packed), uuid.uuid4().hex
        starts = range(first, first + total, chunk)
        sent, each = 0, _TASK_SECONDS
        pending: deque[Any] = deque()
        try:
            while True:
                workers = self._workers()
                while len(pending) < 2 * workers and sent < len(starts):
                    together = min(int(_TASK_SECONDS / each), (len(starts) - sent) // (2 * workers), _MOST_TOGETHER)
                    some = starts[sent : sent + max(1, together)]
                    ranges = [(start, min(chunk, first + total - start)) for start in some]
                    pending.append(self._task.remote(code_hash(), name, [parcel], ranges))
                    sent += len(some)
                if not pending:
                    return
                done = self._result(pending.popleft())
                self.cpu_seconds += done.cpu_seconds
                each = min(each, max(done.seconds / len(done.results), 1e-6))
                for message in done.warnings:
                    warnings.warn(message, stacklevel=2)
                yield from done.results
        finally:
            for reference in pending:
                ray.cancel(reference)

    def _result(self, reference: Any) -> Any:
        """Wait for a task."""
        ray = self._ray
        while True:
            try:
                done = ray.get(reference, timeout=_PATIENCE_SECONDS)
            except ray.exceptions.GetTimeoutError:
                if not ray.cluster_resources().get("CPU", 0):
                    raise EngineError(
                        "No machine of the cluster has a core any more; what is finished is kept."
                    ) from None
            except ray.exceptions.RayTaskError as error:
                raise (error.cause if isinstance(error.cause, Exception) else error) from None
            except ray.exceptions.RayError as error:
                raise EngineError(
                    f"The cluster broke down ({_first_line(error)}); what is finished is kept. To see why: ray status"
                ) from error
            else:
                if isinstance(done, str):
                    raise EngineError(done)
                return done


def _task() -> Callable[..., Any]:
    """Make the function that a worker calls; it is sent whole, so that a machine without cornerforge can say so."""

    def task(code: str, name: str, parcel: Sequence[Any], ranges: Sequence[tuple[int, int]]) -> Any:
        import socket

        import ray

        try:
            from cornerforge.work.worker import work_on
        except ImportError as error:
            return (
                f"{socket.gethostname()} cannot import cornerforge as it is here ({error}); install the same "
                "version on all machines."
            )
        return work_on(code, name, lambda: ray.get(parcel[0]), ranges)

    return task


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


@contextmanager
def joined(address: str | None, workers: int | None) -> Iterator[Cluster]:
    """Join a cluster, or start one of this machine alone, and leave or stop it at the end.

    A connection that the program already has is used, and kept.

    Raises:
        MissingExtraError: Ray is not installed.
        EngineError: No cluster answers, or it has other versions of Ray or Python.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing about a user's runs leaves their machines
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise MissingExtraError("The engine ray", "ray") from error
    if ray.is_initialized():
        yield Cluster(ray, workers)
        return
    _join(ray, address, workers)
    try:
        yield Cluster(ray, workers)
    finally:
        ray.shutdown()


def _join(ray: Any, address: str | None, workers: int | None) -> None:
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR, "configure_logging": True}
    if address is None:
        quiet |= {"address": "local", "num_cpus": workers or default_threads(), "include_dashboard": False}
    else:
        _check_answers(address)
        quiet |= {"address": address}
    kept = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(**quiet)
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        text = " ".join(line.strip() for line in str(error).strip().splitlines())
        if "ersion mismatch" in text:
            raise EngineError(f"The cluster has other versions than this machine. {text}") from error
        raise EngineError(
            f"No Ray cluster could be joined at {address or 'this machine'} ({text[:300]}); to start one: ray start "
            "--head"
        ) from error
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, kept)  # Ray takes it over, and would end us without a word


def _check_answers(address: str) -> None:
    """Knock before Ray does: it waits for a minute for a cluster that is not there."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon:
        return
    try:
        socket.create_connection((host, int(port)), timeout=10.0).close()
    except (OSError, ValueError) as error:
        raise EngineError(
            f"No Ray cluster answers at {address} ({error}); to start one there: ray start --head"
        ) from error
