"""The one place that meets Numba: how compiled kernels are made.

`kernel` compiles on first call, caches the machine code beside the package (a second start pays no compile time),
releases the GIL (so that ranges of tests run in a thread pool), and keeps IEEE semantics: no `fastmath`, hence results
that do not depend on vector width, thread count or batch size.

Trap: Numba's cache key is the source file of the function itself, not of those it calls. `make clean-cache` after an
edit below `drivers/` or `geometry.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

__all__ = ["kernel"]

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile a scalar loop function to machine code."""
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


