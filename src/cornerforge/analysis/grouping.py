"""Groups in a table of features: projection, majority and minority, clusters, typical and rare rows.

This part of the analysis works on numbers only: `analyse` adds case names and crash types,
`periods` repeats it over longer and longer histories.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_finite, check_integer
from cornerforge.analysis._sklearn import require_sklearn
from cornerforge.analysis.dbscan import NOISE, DensitySplit, dbscan, split
from cornerforge.analysis.features import scaling_of
from cornerforge.analysis.kmeans import Choice, cluster
from cornerforge.analysis.pca import Projection, project
from cornerforge.analysis.valuable import rare_cases, typical_cases
from cornerforge.errors import InputError

__all__ = ["MIN_CASES", "Clock", "Group", "Grouping", "group_features", "load"]

MIN_CASES = 10
"""Fewer cases than this form one cluster, because their density says nothing."""


@dataclass(frozen=True)
class Group:
    """One K-means cluster of the majority or the minority.

    Attributes:
        name: "majority" or "minority".
        size: Rows in it.
        typical: Up to three rows, nearest to the centre first.
    """

    name: str
    size: int
    typical: tuple[int, ...]


@dataclass(frozen=True)
class Grouping:
    """Groups of the rows of a table of features; rows count from 0.

    Attributes:
        projection: The rows in the plane of two principal components of the z-scores.
        density: The split into majority and minority; None when there were too few or only identical rows.
        is_majority: Shape (S,).
        groups: All clusters: the majority's by size, then the minority's by size.
        index: Place in `groups` of each row's cluster, shape (S,).
        choices: Why "majority" and "minority" have as many clusters; without an empty group, empty without a split.
        rare: Up to ten outliers, farthest first.
        note: Why the result is trivial, else None.
        seconds: Wall-clock of each stage [s], without loading libraries.
    """

    projection: Projection
    density: DensitySplit | None
    is_majority: NDArray[np.bool_]
    groups: tuple[Group, ...]
    index: NDArray[np.int64]
    choices: dict[str, Choice]
    rare: tuple[int, ...]
    note: str | None
    seconds: dict[str, float]

    @property
    def noise_share(self) -> float:
        """Share of rows in no dense cluster."""
        return 0.0 if self.density is None else float((self.density.labels == NOISE).mean())


class Clock:
    """Wall-clock of named stages."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._stages: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what is within."""
        begin = time.perf_counter()
        yield
        self._stages[name] = time.perf_counter() - begin

    def seconds(self) -> dict[str, float]:
        """The stages so far [s], and `total` since the clock was made."""
        return {**self._stages, "total": time.perf_counter() - self._start}


def group_features(values: NDArray[np.float64], *, seed: int = 0) -> Grouping:
    """Standardise, project, split by density, cluster, and pick typical and rare rows.

    Args:
        values: Features in SI units, one row per case, shape (S, F), S >= 1, F >= 2, finite.
        seed: Seed of the subsamples and the starts of K-means, 0 to 2^32 - 1.

    Raises:
        InputError: The shape is wrong, a value is not finite, or the seed is out of range.
        MissingExtraError: scikit-learn is not installed.
    """
    load()
    check_integer("seed", seed, low=0, high=2**32 - 1)
    if values.ndim != 2 or len(values) < 1 or values.shape[1] < 2:
        raise InputError(
            f"values has shape {values.shape}; allowed: (cases, features), 1 case and 2 features at least."
        )
    clock = Clock()
    with clock.stage("pca"):
        check_finite("values", values)
        scaling = scaling_of(values)
        projection = project(values, scaling)
    points = projection.points
    note = _why_trivial(len(values), is_alike=scaling.is_trivial)
    with clock.stage("dbscan"):
        density = split(points) if note is None else None
    is_majority = np.ones(len(points), np.bool_) if density is None else density.is_majority
    groups: list[Group] = []
    index = np.full(len(points), -1, np.int64)
    choices: dict[str, Choice] = {}
    with clock.stage("kmeans"):
        found = _clustered(points, is_majority, seed, choices, one_only=density is None)
    with clock.stage("valuable"):
        for name, rows, labels, centres in found:
            index[rows] = labels + len(groups)
            for label, chosen in enumerate(typical_cases(points[rows], labels, centres)):
                size = int((labels == label).sum())
                groups.append(Group(name, size, tuple(int(rows[row]) for row in chosen)))
        rare = [] if density is None else rare_cases(points, density.labels == NOISE, is_majority)
    return Grouping(projection, density, is_majority, tuple(groups), index, choices, tuple(rare), note, clock.seconds())


def load() -> None:
    """Load what the analysis needs, so that no stage's time holds the import of a library.

    Raises:
        MissingExtraError: scikit-learn is not installed.
    """
    require_sklearn()
    dbscan(np.zeros((1, 2)), 1.0, 1)


def _why_trivial(n: int, *, is_alike: bool) -> str | None:
    if n < MIN_CASES:
        return f"Only {n} case(s): fewer than {MIN_CASES} are not clustered."
    if is_alike:
        return "All cases have the same features: there is nothing to tell apart."
    return None


def _clustered(
    points: NDArray[np.float64],
    is_majority: NDArray[np.bool_],
    seed: int,
    choices: dict[str, Choice],
    *,
    one_only: bool,
) -> list[tuple[str, NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]]:
    """Cluster majority and minority, as the paper does: name, rows, labels and centres of each that is not empty."""
    found = []
    for name, mask in (("majority", is_majority), ("minority", ~is_majority)):
        rows = np.flatnonzero(mask)
        if rows.size == 0:
            continue
        if one_only:
            found.append((name, rows, np.zeros(rows.size, np.intp), points[rows].mean(axis=0, keepdims=True)))
        else:
            made = cluster(points[rows], seed=seed)
            choices[name] = made.choice
            found.append((name, rows, made.labels, made.centres))
    return found
