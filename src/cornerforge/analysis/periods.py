"""The paper's Figure 7: the same analysis over ever longer histories, 1 to 15 s before the crash."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.features import ShortCases, crash_features
from cornerforge.analysis.grouping import Grouping, group_features
from cornerforge.errors import InputError

__all__ = ["PERIODS", "Period", "analyse_periods"]

PERIODS = (1, 2, 3, 5, 7, 9, 12, 15)
"""The paper's eight periods [s]: each holds all seconds from 1 to its end, five features a second."""


@dataclass(frozen=True)
class Period:
    """Groups found with one length of history.

    Attributes:
        steps: Seconds before the crash that the features cover.
        kept: Rows of the input that are analysed, shape (S',).
        padded: How many of them repeat their earliest recorded second.
        excluded: How many were left out because they began too late.
        grouping: The analysis of these rows.
    """

    steps: int
    kept: NDArray[np.intp]
    padded: int
    excluded: int
    grouping: Grouping

    def to_json(self) -> dict[str, Any]:
        """Counts and shares as plain JSON values; `eps` and `min_samples` are None for a trivial result."""
        found = self.grouping
        density = found.density
        return {
            "steps": self.steps,
            "cases": len(self.kept),
            "padded": self.padded,
            "excluded": self.excluded,
            "features": int(found.projection.loadings.shape[1]),
            "explained_variance": found.projection.explained_variance.tolist(),
            "eps": None if density is None else density.eps,
            "min_samples": None if density is None else density.min_samples,
            "dense_clusters": 0 if density is None else int(density.labels.max()) + 1,
            "majority": int(found.is_majority.sum()),
            "minority": int((~found.is_majority).sum()),
            "noise": round(found.noise_share * len(self.kept)),
            "clusters": {name: sum(group.name == name for group in found.groups) for name in ("majority", "minority")},
            "note": found.note,
        }


def analyse_periods(
    history: NDArray[np.floating],
    *,
    periods: Sequence[int] = PERIODS,
    seed: int = 0,
    short: ShortCases = "pad",
) -> list[Period]:
    """Analyse the same cases over several lengths of history.

    Args:
        history: As for `crash_features`, shape (S, 16, 2, 4).
        periods: Seconds before the crash, each 1 to 15.
        seed: As for `group_features`.
        short: What happens to cases shorter than a period: "pad" or "exclude" (see `crash_features`). Padded, all
            periods show the same cases; excluded, the longer ones show fewer and other cases.

    Returns:
        One entry for each period; with "exclude", without the periods that no case is long enough for.

    Raises:
        InputError: There are no cases, or an argument is not as described.
        MissingExtraError: scikit-learn is not installed.
    """
    found = []
    for steps in periods:
        features = crash_features(history, steps, short=short)
        if len(features.kept):
            grouping = group_features(features.values, seed=seed)
            found.append(Period(steps, features.kept, features.padded, features.excluded, grouping))
    if not found:
        raise InputError("No case lasts as long as any of the periods; ask for shorter ones, or pad short cases.")
    return found
