"""One check of `ndd validate`: a quantity, its found value, the allowed range, and the published value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cornerforge.results.validation import FactFound

__all__ = ["judged", "spread"]

_T_95 = 2.093
"""97.5 % point of Student's t with 19 degrees of freedom, for 20 blocks."""


def judged(found: float | None, allowed: tuple[float, float] | None, **row: Any) -> FactFound:
    """Make the row of a check: `within` is None where nothing is allowed or forbidden, False where nothing was found.

    Args:
        found: What was found; None: the quantity was not seen at all.
        allowed: Ends of the allowed range, both allowed; None: shown only.
        row: The other fields of `FactFound`.
    """
    if allowed is None:
        return FactFound(found=found, allowed=None, within=None, **row)
    low, high = allowed
    within = found is not None and low <= found <= high
    return FactFound(found=found, allowed=(round(low, 9), round(high, 9)), within=within, **row)


def spread(found: float | None, without_one: Sequence[float | None]) -> tuple[float, float] | None:
    """Compute a 95 % interval by jackknife from values that each leave out one of 20 blocks; None if one is None."""
    values = np.array([np.nan if value is None else value for value in without_one])
    if found is None or not np.isfinite(values).all():
        return None
    n = values.size
    error = float(np.sqrt((n - 1) / n * ((values - values.mean()) ** 2).sum()))
    return found - _T_95 * error, found + _T_95 * error
