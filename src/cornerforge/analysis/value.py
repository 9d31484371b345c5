"""Value of a case: how much it is worth a look, as four parts from 0 to 1 and their weighted mean (docs/adr/0017).

Own doing, avoidability and severity mean the same in every library; only novelty compares the cases of one library
with each other. In each part 0 and 1 have a meaning of their own. The parts are always given beside the mean.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cornerforge.analysis.dbscan import choose_min_samples, neighbour_distance
from cornerforge.errors import InputError
from cornerforge.results.analysis import PARTS

__all__ = [
    "PARTS",
    "REACTION_S",
    "RISK_DECADES",
    "Value",
    "avoidability_part",
    "novelty_part",
    "severity_part",
    "value_of",
]

REACTION_S = 2.0
"""Time to react [s] from which the part of avoidability is 1."""
RISK_DECADES = 3.0
"""Decades of injury probability from severity 1 (certain injury) to severity 0 (probability 10^-3 or less)."""


def avoidability_part(time_to_react_s: ArrayLike) -> NDArray[np.float64]:
    """Rate how well the AV could have avoided the crash: the time that it had to react over 2 s, at most 1.

    Args:
        time_to_react_s: From the begin of the manoeuvre to the last moment at which some manoeuvre of the AV avoids the
            crash [s], shape (S,); 0 or less where none does or only an immediate one; NaN where it was not looked for.

    Returns:
        Shape (S,), in [0, 1]; NaN stays NaN.

    >>> avoidability_part([-0.5, 1.0, 6.0]).tolist()
    [0.0, 0.5, 1.0]
    """
    return np.clip(np.asarray(time_to_react_s, np.float64) / REACTION_S, 0.0, 1.0)


def severity_part(injury_probability: ArrayLike) -> NDArray[np.float64]:
    """Rate how bad the crash is: a factor of 10 in the chance of a serious injury counts a third.

    Args:
        injury_probability: Probability of a serious injury (MAIS 3 or more) in the AV, shape (S,), in [0, 1].

    Returns:
        Shape (S,), in [0, 1]: 1 + log10(p) / 3, 0 below p = 10^-3.

    >>> severity_part([0.0, 0.001, 0.1, 1.0]).round(3).tolist()
    [0.0, 0.0, 0.667, 1.0]
    """
    with np.errstate(divide="ignore"):
        return np.clip(1.0 + np.log10(np.asarray(injury_probability, np.float64)) / RISK_DECADES, 0.0, 1.0)


def novelty_part(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rate how unlike the others a case is: the share of the other cases that lie in denser regions.

    Args:
        points: The cases in the plane of the analysis, shape (S, 2), finite.

    Returns:
        Shape (S,), in [0, 1]: share of the S - 1 others with a smaller distance to their k-th nearest case (k as
        DBSCAN's `min_samples`); 0 for a single case and where all cases are equal.

    >>> novelty_part(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [0.1, 0.1], [9.0, 9.0]])).tolist()[-1]
    1.0
    """
    n = len(points)
    if n < 2:
        return np.zeros(n)
    distance = neighbour_distance(points, choose_min_samples(n))
    return np.searchsorted(np.sort(distance), distance, side="left") / (n - 1)


@dataclass(frozen=True)
class Value:
    """Values of S cases.

    Attributes:
        parts: Name (`PARTS`) to values in [0, 1], shape (S,); NaN where a part is not known.
        weights: Name to weight; they sum to 1.
        score: Weighted mean of the parts, shape (S,), in [0, 1]; NaN where a part with a weight is not known.
    """

    parts: dict[str, NDArray[np.float64]]
    weights: dict[str, float]
    score: NDArray[np.float64]

    def best(self, n: int) -> NDArray[np.intp]:
        """Rows of the n most valuable cases, the best first (ties: the earlier case); only those with a score."""
        known = np.flatnonzero(np.isfinite(self.score))
        return known[np.argsort(-self.score[known], kind="stable")[:n]]


def value_of(parts: Mapping[str, ArrayLike], weights: Mapping[str, float] | None = None) -> Value:
    """Put the parts together.

    Args:
        parts: A value for each of `PARTS`, shape (S,), in [0, 1] or NaN.
        weights: Weights of the parts, at least 0, not all 0; taken relative to their sum. Equal if None.

    Raises:
        InputError: A part or a weight is missing, unknown or out of range, or the shapes differ.

    >>> value_of({"own_doing": [1.0], "avoidability": [1.0], "severity": [0.0], "novelty": [0.0]}).score.tolist()
    [0.5]
    """
    given = dict.fromkeys(PARTS, 1.0) if weights is None else dict(weights)
    for what, names in (("parts", set(parts)), ("weights", set(given))):
        if names != set(PARTS):
            raise InputError(f"The {what} are named {', '.join(sorted(names))}; needed: {', '.join(PARTS)}.")
    bad = [name for name, weight in given.items() if not (math.isfinite(weight) and weight >= 0.0)]
    total = sum(given.values())
    if bad or total <= 0.0:
        raise InputError(f"Weights {given}: each must be at least 0 and one above it.")
    arrays = {name: np.asarray(parts[name], np.float64) for name in PARTS}
    for name, array in arrays.items():
        if array.shape != arrays[PARTS[0]].shape or array.ndim != 1:
            raise InputError(
                f"The part {name} has shape {array.shape}, {PARTS[0]} {arrays[PARTS[0]].shape}; give one value a case."
            )
        if ((array < 0.0) | (array > 1.0)).any():
            raise InputError(f"The part {name} has values outside 0 to 1.")
    share = {name: given[name] / total for name in PARTS}
    score = sum(
        (share[name] * array for name, array in arrays.items() if share[name] > 0.0), np.zeros(arrays[PARTS[0]].shape)
    )
    return Value(arrays, share, score)
