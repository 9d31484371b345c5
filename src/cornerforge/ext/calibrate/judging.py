"""One check of `ndd validate`: a quantity, its found value, the allowed range, and the published value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["judged", "spread"]

_T_95 = 2.093
"""97.5 % point of Student's t with 19 degrees of freedom, for 20 blocks."""


def judged(
    theme: str, when: str, fact: str, unit: str, published: float | tuple[float, float] | None, source: str,
    found: float | None, n: int, interval95: Sequence[float] | None, allowed: tuple[float, float] | None,
) -> dict[str, Any]:  # fmt: skip
    """Make the row of a check.

    Args:
        theme: The table that shows it.
        when: Window of time, or file.
        fact, unit: The quantity, in words.
        published: Its published value, or the ends of several; None for none.
        source: Source of the published value.
        found: What was found; None: the quantity was not seen at all.
        n: Number of states, events or pairs behind it.
        interval95: Its interval; None: unknown.
        allowed: Ends of the allowed range, both allowed; None: shown only.

    Returns:
        These, and `within`: None where nothing is allowed or forbidden, False where nothing was found.
    """
    within = None
    if allowed is not None:
        within = found is not None and allowed[0] <= found <= allowed[1]
    return {
        "theme": theme,
        "when": when,
        "fact": fact,
        "unit": unit,
        "published": published,
        "source": source,
        "found": found,
        "n": n,
        "interval95": None if interval95 is None else list(interval95),
        "allowed": None if allowed is None else [round(end, 9) for end in allowed],
        "within": within,
    }


def spread(found: float | None, without_one: Sequence[float | None]) -> list[float] | None:
    """Compute a 95 % interval by jackknife from values that each leave out one of 20 blocks; None if one is None."""
    values = np.array([np.nan if value is None else value for value in without_one])
    if found is None or not np.isfinite(values).all():
        return None
    n = values.size
    error = float(np.sqrt((n - 1) / n * ((values - values.mean()) ** 2).sum()))
    return [found - _T_95 * error, found + _T_95 * error]
