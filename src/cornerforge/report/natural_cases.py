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
        case_id, mechanism, crash_type: Facts of each case; mechanism "" where the library does not say it.
        weight: Crashes per test that it stands for, shape (S,).
        points: Places in the plane of the principal components, shape (S, 2).
        prevention: What would have prevented it, one of `analysis.prevented.PREVENTION`, shape (S,).
    """

    case_id: list[str]
    mechanism: list[str]
    crash_type: list[str]
    weight: NDArray[np.float64]
    points: NDArray[np.float64]
    prevention: NDArray[np.str_]

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Mark the cases that were judged for prevention, bool (S,)."""
        return np.not_equal(self.prevention, NOT_JUDGED)

    def first(self) -> tuple[FirstCase, bool] | None:
        """Choose the case to look at first, as `what_to_see_first` does."""
        kinds = self.mechanism if any(self.mechanism) else self.crash_type
        return what_to_see_first(kinds, self.weight, self.points, self.prevention)


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
    mechanisms: dict[str, str | None] = {}
    if "mechanism" in cases.extra:
        rows = cases.scalars(["case_id", "mechanism"])
        mechanisms = dict(zip(rows["case_id"].to_pylist(), rows["mechanism"].to_pylist(), strict=True))
    names = ["case_id", "crash_type", "pc1", "pc2", "prevention"]
    found = read_table(analysis / "cases.parquet", names, command)
    rows_known = [row for row, case in enumerate(found["case_id"]) if weights.get(case, 0.0) > 0.0]
    column = {name: [found[name][row] for row in rows_known] for name in names}
    return NaturalCases(
        case_id=column["case_id"],
        mechanism=[mechanisms.get(case) or "" for case in column["case_id"]],
        crash_type=column["crash_type"],
        weight=np.array([weights[case] for case in column["case_id"]], np.float64),
        points=np.stack([np.array(column[name], np.float64) for name in ("pc1", "pc2")], axis=-1),
        prevention=np.array(column["prevention"], np.str_),
    )
