"""The natural crashes of a page, case by case: how often each happens, its kind, and what would have prevented it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.first_case import FirstCase, what_to_see_first
from cornerforge.analysis.prevented import NOT_JUDGED
from cornerforge.report.judged import read_table

__all__ = ["NaturalCases", "read_natural_cases"]


@dataclass(frozen=True)
class NaturalCases:
    """Columns of S cases.

    Attributes:
        case_id, mechanism: Facts of each case.
        weight: Crashes per test that it stands for, shape (S,).
        points: Places in the plane of the principal components, shape (S, 2).
        prevention: What would have prevented it, one of `analysis.prevented.PREVENTION`, shape (S,).
    """

    case_id: list[str]
    mechanism: list[str]
    weight: NDArray[np.float64]
    points: NDArray[np.float64]
    prevention: NDArray[np.str_]

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Mark the cases that were judged for prevention, bool (S,)."""
        return np.not_equal(self.prevention, NOT_JUDGED)

    def first(self) -> tuple[FirstCase, bool] | None:
        """Choose the case to look at first, as `what_to_see_first` does."""
        return what_to_see_first(self.mechanism, self.weight, self.points, self.prevention)


def read_natural_cases(library: Path, analysis: Path, command: str) -> NaturalCases:
    """Read the natural cases of a library that were analysed.

    Args:
        library: The library.
        analysis: Folder of its analysis.
        command: What writes the analysis again, for messages.

    Raises:
        FileFormatError: A file is missing or damaged.
    """
    from cornerforge.library import CaseLibrary
    from cornerforge.library.natural import natural_weights

    cases = CaseLibrary.open(library)
    weights = natural_weights(cases) or {}
    names = ["case_id", "mechanism", "pc1", "pc2", "prevention"]
    found = read_table(analysis / "cases.parquet", names, command)
    rows_known = [row for row, case in enumerate(found["case_id"]) if weights.get(case, 0.0) > 0.0]
    column = {name: [found[name][row] for row in rows_known] for name in names}
    return NaturalCases(
        case_id=column["case_id"],
        mechanism=column["mechanism"],
        weight=np.array([weights[case] for case in column["case_id"]], np.float64),
        points=np.stack([np.array(column[name], np.float64) for name in ("pc1", "pc2")], axis=-1),
        prevention=np.array(column["prevention"], np.str_),
    )
