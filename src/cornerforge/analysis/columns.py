"""Columns that analyses add to cases: their documentation, in the manner of `library/schema.py`."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CaseColumn"]


@dataclass(frozen=True)
class CaseColumn:
    """One column, one value a case.

    Attributes:
        name: Ends in its unit where it has one.
        kind: "float", "bool" or "str", as in `library.schema.EXTRA_TYPES`.
        unit: Of the values, "" for none.
        meaning: One sentence, with the edge values. Where it says null, a float is NaN.
    """

    name: str
    kind: str
    unit: str
    meaning: str
