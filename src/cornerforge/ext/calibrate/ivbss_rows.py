"""Checks of rows of probabilities from files: they are counted and scaled to sum 1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError

__all__ = ["EXACT", "TOLERANCE", "RowCounts", "check_numbers", "checked_cumulative", "checked_rows"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

EXACT = 1e-6
"""A row with a sum this near to 1 is used unchanged."""
TOLERANCE = 0.01
"""A row with a sum this near to 1 is divided by the sum; any other row is refused: it holds no probabilities."""
_NOISE = 1e-9
"""Negative numbers up to this size are rounding errors and count as 0."""


@dataclass(frozen=True)
class RowCounts:
    """Counts of the rows of one table.

    Attributes:
        rows: All rows (states) of the table.
        empty: Rows that are all 0, without data. They are filled from the base model.
        renormalised: Rows divided by their sum.
    """

    rows: int
    empty: int
    renormalised: int

    def to_json(self) -> Mapping[str, int]:
        """The fields, JSON-compatible."""
        return {"rows": self.rows, "empty": self.empty, "renormalised": self.renormalised}


def check_numbers(name: str, values: Floats) -> None:
    """Check that there is no NaN, infinite or negative number (beyond rounding of 1e-9) in `values`, any shape.

    Raises:
        FileFormatError: There is one; the message counts them and names the first place.
    """
    odd = ~np.isfinite(values)
    below = values < -_NOISE
    if odd.any() or below.any():
        place = [int(i) for i in np.argwhere(odd | below)[0]]
        raise FileFormatError(
            f"{name} holds {int(odd.sum())} NaN or infinite and {int(below.sum())} negative number(s), the first at "
            f"{place}; mend the file."
        )


def checked_rows(name: str, table: Floats) -> tuple[Floats, Bools, RowCounts]:
    """Check rows of probabilities, shape (*d, k), and scale them to sum 1.

    Returns:
        The rows (an empty one stays 0), which rows hold data, shape (*d), and the counts.

    Raises:
        FileFormatError: A number is no probability, or a sum is farther than `TOLERANCE` from 1.
    """
    check_numbers(name, table)
    rows = np.maximum(table, 0.0)
    total = rows.sum(axis=-1)
    known = total > 0.0
    off = known & (np.abs(total - 1.0) > EXACT)
    far = known & (np.abs(total - 1.0) > TOLERANCE)
    if far.any():
        place = tuple(int(i) for i in np.argwhere(far)[0])
        raise FileFormatError(
            f"{name}: {int(far.sum())} of {known.size} rows do not sum to 1 within {TOLERANCE:g}, the first at "
            f"{list(place)} with {total[place]:.6g}; divide each row by its sum if it holds counts."
        )
    rows = np.where(off[..., None], rows / np.where(off, total, 1.0)[..., None], rows)
    return rows, known, RowCounts(known.size, int((~known).sum()), int(off.sum()))


def checked_cumulative(name: str, table: Floats) -> tuple[Floats, Bools, RowCounts]:
    """Check rows of cumulative probabilities, shape (n, k), and return probabilities; a row of NaN is empty.

    Returns:
        As `checked_rows`.

    Raises:
        FileFormatError: A number is no probability, or a row falls or does not end at 1.
    """
    empty = np.asarray(np.isnan(table).all(axis=-1))
    table = np.where(empty[:, None], 0.0, table)
    check_numbers(name, table)
    falls = np.diff(table, axis=-1) < -_NOISE
    if falls.any():
        place = [int(i) for i in np.argwhere(falls)[0]]
        raise FileFormatError(
            f"{name}: cumulative probabilities fall {int(falls.sum())} time(s), first after {place}; it is no "
            "cumulative distribution."
        )
    return checked_rows(name, np.maximum(np.diff(table, axis=-1, prepend=0.0), 0.0))
