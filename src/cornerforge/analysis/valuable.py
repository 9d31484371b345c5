"""Valuable cases: typical ones, which resemble many others, and rare ones, which resemble no other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["N_RARE", "N_TYPICAL", "rare_cases", "typical_cases"]

N_TYPICAL = 3
"""Number of typical cases of each cluster."""
N_RARE = 10


def typical_cases(
    points: NDArray[np.float64], labels: NDArray[np.intp], centres: NDArray[np.float64]
) -> list[list[int]]:
    """Pick up to three members of each cluster, nearest to its centre first (ties: the earlier case).

    Args:
        points: Shape (S, 2).
        labels: Cluster of each case, shape (S,), 0..k-1.
        centres: Shape (k, 2).

    Returns:
        Rows of `points`, one list per cluster.
    """
    chosen = []
    for index, centre in enumerate(centres):
        members = np.flatnonzero(labels == index)
        distance = np.hypot(*(points[members] - centre).T)
        chosen.append([int(row) for row in members[np.argsort(distance, kind="stable")[:N_TYPICAL]]])
    return chosen


def rare_cases(points: NDArray[np.float64], is_noise: NDArray[np.bool_], is_majority: NDArray[np.bool_]) -> list[int]:
    """Pick up to ten outliers, farthest first.

    The distance is that to the nearest case of the majority. The distance to its centre would make the ends of a long
    majority rare, and a case between two clusters common.

    Args:
        points: Shape (S, 2).
        is_noise: The case is in no dense cluster, shape (S,).
        is_majority: Shape (S,); at least one is True unless nothing is noise.

    Returns:
        Rows of `points`; ties: the earlier case.
    """
    from scipy.spatial import KDTree

    outliers = np.flatnonzero(is_noise & ~is_majority)
    if outliers.size == 0:
        return []
    distance = KDTree(points[is_majority]).query(points[outliers])[0]
    return [int(row) for row in outliers[np.argsort(-distance, kind="stable")[:N_RARE]]]
