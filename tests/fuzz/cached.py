"""A kernel whose machine code is kept in the folder `cache` of the working directory."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from cornerforge import _jit

__all__ = ["with_cache"]


def _tripled(values: Any) -> float:
    return 3.0 * values[0]


def with_cache() -> float:
    """Call the kernel as a new process would: it reads its machine code, or compiles it and keeps it."""
    place = Path("cache").resolve()
    with patch.object(_jit, "cache_folder", lambda: str(place)):
        tripled: Any = _jit.kernel(_tripled)
        return float(tripled(np.ones(2)))
