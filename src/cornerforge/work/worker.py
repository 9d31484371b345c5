"""Worker of a cluster: it unpacks work once, and then works on ranges."""

from __future__ import annotations

import pickle
import socket
import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from cornerforge.errors import EngineError
from cornerforge.work.code import code_hash

__all__ = ["Done", "work_on"]

_MOST_KEPT = 2
_kept: OrderedDict[str, Callable[[int, int], Any]] = OrderedDict()


class Done(NamedTuple):
    """Results of some ranges.

    Attributes:
        results: One a range.
        cpu_seconds, seconds: What they took.
        warnings: What was warned of on the way.
    """

    results: list[Any]
    cpu_seconds: float
    seconds: float
    warnings: list[Warning | str]


def work_on(code: str, name: str, fetch: Callable[[], bytes], ranges: Sequence[tuple[int, int]]) -> Done:
    """Work on ranges (first number, size).

    Args:
        code: `code_hash` of the program that asks.
        name: Name of the work; the content unpacked under a name is kept.
        fetch: Gets the packed work. It is unpacked into memory of our own: shared memory would be read-only, and
            kernels are compiled for arrays that can be written.
        ranges: What to work on.

    Raises:
        EngineError: This machine has other code.
    """
    if code != code_hash():
        raise EngineError(
            f"{socket.gethostname()} has another version of cornerforge (code {code_hash()}, here {code}); install the "
            "same on all machines."
        )
    if name not in _kept:
        _kept[name] = pickle.loads(fetch())
        while len(_kept) > _MOST_KEPT:
            _kept.popitem(last=False)
    work = _kept[name]
    begun, cpu_begun = time.perf_counter(), time.process_time()
    with warnings.catch_warnings(record=True) as told:
        results = [work(first, count) for first, count in ranges]
    return Done(results, time.process_time() - cpu_begun, time.perf_counter() - begun, [one.message for one in told])
