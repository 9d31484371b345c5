"""Dependence of the split into majority and minority on the two numbers of DBSCAN that a rule chose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.dbscan import NOISE, DensitySplit, dbscan, majority_of
from cornerforge.errors import InputError

__all__ = ["EPS_FACTORS", "MIN_SAMPLES_FACTORS", "SplitAt", "split_sensitivity"]

EPS_FACTORS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.6, 1.8, 2.0)
MIN_SAMPLES_FACTORS = (0.5, 1.0, 2.0)


@dataclass(frozen=True)
class SplitAt:
    """The split at one pair of numbers.

    Attributes:
        eps_factor: `eps` over the chosen one.
        eps: Radius of a neighbourhood.
        min_samples: Cases within eps that make a core.
        majority_share: Cases of the majority over all.
        noise_share: Cases in no dense cluster over all.
        dense_clusters: Dense clusters of any size.
        agreement: Share of the cases that are on the same side, majority or minority, as in the chosen split.
    """

    eps_factor: float
    eps: float
    min_samples: int
    majority_share: float
    noise_share: float
    dense_clusters: int
    agreement: float

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)


def split_sensitivity(
    points: NDArray[np.float64],
    chosen: DensitySplit,
    *,
    eps_factors: Sequence[float] = EPS_FACTORS,
    min_samples_factors: Sequence[float] = MIN_SAMPLES_FACTORS,
) -> list[SplitAt]:
    """Split the same points with other numbers around the chosen ones.

    Args:
        points: Shape (S, 2), the points that were split.
        chosen: The split that the rule chose for them.
        eps_factors: Multiples of its eps, above 0.
        min_samples_factors: Multiples of its `min_samples`, above 0; rounded up, at least 2, at most S.

    Returns:
        One entry for each pair, by `min_samples`, then by eps. At factors of 1 it is the chosen split: agreement 1.

    Raises:
        InputError: A factor is not above 0, or the split is of other points.
    """
    if len(points) != len(chosen.labels):
        raise InputError(f"The split is of {len(chosen.labels)} points, not of these {len(points)}; split them first.")
    if min(*eps_factors, *min_samples_factors, 1.0) <= 0.0:
        raise InputError("A factor is 0 or less; allowed: above 0.")
    found = []
    for part in min_samples_factors:
        min_samples = max(2, min(len(points), int(np.ceil(part * chosen.min_samples))))
        for factor in eps_factors:
            eps = factor * chosen.eps
            labels = dbscan(points, eps, min_samples)
            is_majority = majority_of(labels)
            found.append(
                SplitAt(
                    eps_factor=float(factor),
                    eps=float(eps),
                    min_samples=min_samples,
                    majority_share=float(is_majority.mean()),
                    noise_share=float((labels == NOISE).mean()),
                    dense_clusters=int(labels.max()) + 1,
                    agreement=float((is_majority == chosen.is_majority).mean()),
                )
            )
    return found
