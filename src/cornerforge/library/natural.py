"""Libraries of crashes of natural traffic, and how many crashes per test each of their cases stands for."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cornerforge.library.store import CaseLibrary

__all__ = ["WEIGHT", "is_natural", "natural_weights"]

WEIGHT = "weight"
"""Column of a library: crashes per test that the case stands for."""
_TRAFFIC = "nde"


def is_natural(cases: CaseLibrary) -> bool:
    """Say whether a library's cases come from natural traffic."""
    return cases.identity.get("bv") == _TRAFFIC


def natural_weights(cases: CaseLibrary) -> dict[str, float] | None:
    """Give each case's weight, by its id; None if they are not natural.

    Returns:
        Crashes per test that the case stands for; the sum is the rate.
    """
    if not is_natural(cases) or len(cases) == 0:
        return None
    if WEIGHT in cases.extra:
        rows = cases.scalars(["case_id", WEIGHT])
        return dict(zip(rows["case_id"].to_pylist(), rows[WEIGHT].to_pylist(), strict=True))
    if cases.scripted or cases.tests == 0:
        return None
    each = cases.crashes / cases.tests / len(cases)  # not all crashes need be stored
    return dict.fromkeys(cases.scalars(["case_id"])["case_id"].to_pylist(), each)
