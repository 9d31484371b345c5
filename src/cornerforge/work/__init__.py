"""The spreading of work: ranges of tests, cases or worlds go in, their results come out in order.

A pool of threads computes them, since kernels release the interpreter's lock; or the workers of a cluster do
(`engine`). The results are the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cornerforge._doors import door

if TYPE_CHECKING:
    from cornerforge.work.code import code_hash
    from cornerforge.work.spread import ENGINES, cpu_seconds, engine, in_order, is_spread
    from cornerforge.work.threads import Rooms, default_threads, is_given_up

__all__ = [
    "ENGINES",
    "Rooms",
    "code_hash",
    "cpu_seconds",
    "default_threads",
    "engine",
    "in_order",
    "is_given_up",
    "is_spread",
]

__getattr__ = door(
    "cornerforge.work",
    {
        "ENGINES": "spread",
        "Rooms": "threads",
        "code_hash": "code",
        "cpu_seconds": "spread",
        "default_threads": "threads",
        "engine": "spread",
        "in_order": "spread",
        "is_given_up": "threads",
        "is_spread": "spread",
    },
)
