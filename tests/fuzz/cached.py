"""A kernel whose machine code is kept in the folder `cache` of the working directory."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from cornerforge import _jit, _kernel_cache

__all__ = ["with_cache"]


def _tripled(values: Any) -> float:
    return 3.0 * values[0]


def with_cache() -> float:
    """Call the kernel as a new process would: it reads its machine code, or compiles it and keeps it."""
    with patch.dict(os.environ, NUMBA_CACHE_DIR=str(Path("cache").resolve())):
        _kernel_cache.cache_folder.cache_clear()
        tripled: Any = _jit.kernel(_tripled)
        found = float(tripled(np.ones(2)))
    _kernel_cache.cache_folder.cache_clear()
    return found
