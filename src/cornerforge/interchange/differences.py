"""Rates that a file does not give, from differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cornerforge.types import FRAME_S

__all__ = ["rates"]


def rates(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take the rate of change of a quantity at each frame, from the frames before and after it.

    At the ends of a stretch, and so in the first frame, it is the difference to the only neighbour; 0 where there is
    none.

    Args:
        values: One for each tenth of a second, (F,); NaN where it is not known.

    Returns:
        Change by second, (F,); NaN where `values` is.

    >>> rates(np.array([np.nan, 0.0, 1.0, 3.0, np.nan, 7.0]))
    array([nan, 10., 15., 20., nan,  0.])
    """
    found = np.full(values.size, np.nan)
    known = np.flatnonzero(np.isfinite(values))
    for span in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        found[span] = np.gradient(values[span], FRAME_S) if span.size > 1 else 0.0
    return found
