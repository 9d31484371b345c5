"""The whole analysis: features, projection, density split, clusters, crash types, valuable cases."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checks import check_integer
from cornerforge.analysis._sklearn import require_sklearn
from cornerforge.analysis.crash_types import CrashTypes, classify_crashes
from cornerforge.analysis.dbscan import NOISE, DensitySplit, split
from cornerforge.analysis.features import Features, ShortCases, check_history, crash_features, standardise
from cornerforge.analysis.kmeans import cluster
from cornerforge.analysis.pca import Projection, project
from cornerforge.analysis.valuable import rare_cases, typical_cases
from cornerforge.errors import InputError

__all__ = ["MIN_CASES", "Analysis", "Cluster", "analyse"]

MIN_CASES = 10
"""With fewer cases there is no density to speak of: they form one cluster."""


@dataclass(frozen=True)
class Cluster:
    """One K-means cluster of the majority or the minority.

    Attributes:
        id: From 0: the majority's clusters by size, then the minority's by size.
        group: "majority" or "minority".
        size: Cases in it.
        typical: Up to three case ids, nearest to the centre first.
        crash_types: Cases by type name, types that occur only.
    """

    id: int
    group: str
    size: int
    typical: tuple[str, ...]
    crash_types: dict[str, int]


@dataclass(frozen=True)
class Analysis:
    """Result of `analyse`. Arrays have one row per analysed case, in the order of the input.

    Attributes:
        case_ids: The analysed cases.
        steps: Seconds before the crash that the features look at.
        features: The features, in SI units.
        projection: The cases in the plane of two principal components of the standardised features.
        density: The split into majority and minority; None when there were too few or only identical cases.
        is_majority: Shape (S,).
        cluster_index: `Cluster.id` of each case, shape (S,).
        clusters: All clusters.
        rare: Up to ten case ids of outliers, farthest first.
        crash_types: Type and striker of each case.
        seconds: Wall-clock of each stage [s].
        note: Why the result is trivial, else None.
    """

    case_ids: tuple[str, ...]
    steps: int
    features: Features
    projection: Projection
    density: DensitySplit | None
    is_majority: NDArray[np.bool_]
    cluster_index: NDArray[np.int64]
    clusters: tuple[Cluster, ...]
    rare: tuple[str, ...]
    crash_types: CrashTypes
    seconds: dict[str, float] = field(metadata={"unit": "s"})
    note: str | None = None

    @property
    def points(self) -> dict[str, NDArray[Any]]:
        """Columns for a table with one row per case: case_id, pc1, pc2, group, cluster, crash_type."""
        return {
            "case_id": np.array(self.case_ids, dtype=np.str_),
            "pc1": self.projection.points[:, 0],
            "pc2": self.projection.points[:, 1],
            "group": np.where(self.is_majority, "majority", "minority"),
            "cluster": self.cluster_index,
            "crash_type": np.array(self.crash_types.names, dtype=np.str_),
        }

    def to_json(self) -> dict[str, Any]:
        """Everything but the points, as plain JSON values; `eps` and `min_samples` are None for a trivial result."""
        result: dict[str, Any] = {
            "cases": len(self.case_ids),
            "steps": self.steps,
            "features": list(self.features.names),
            "padded": self.features.padded,
            "excluded": self.features.excluded,
            "explained_variance": self.projection.explained_variance.tolist(),
            "loadings": dict(zip(self.features.names, self.projection.loadings.T.tolist(), strict=True)),
            "eps": None if self.density is None else self.density.eps,
            "min_samples": None if self.density is None else self.density.min_samples,
            "majority": int(self.is_majority.sum()),
            "minority": int((~self.is_majority).sum()),
            "clusters": [
                {
                    "id": one.id,
                    "group": one.group,
                    "size": one.size,
                    "typical": list(one.typical),
                    "crash_types": dict(one.crash_types),
                }
                for one in self.clusters
            ],
            "rare": list(self.rare),
            "crash_types": self.crash_types.counts(),
            "striker": self.crash_types.striker_counts(),
            "seconds": dict(self.seconds),
        }
        if self.note is not None:
            result["note"] = self.note
        return result


def analyse(
    case_ids: Sequence[str],
    history: NDArray[np.floating],
    *,
    steps: int = 1,
    seed: int = 0,
    vehicle_length: float = 5.0,
    vehicle_width: float = 2.0,
    short: ShortCases = "pad",
) -> Analysis:
    """Find typical and rare cases and the types of crash.

    Args:
        case_ids: One different name per case, length S.
        history: [x m, y m, speed m/s, heading rad] of the AV (0) and the crash partner (1) at k seconds before the
            crash, shape (S, 16, 2, 4); k = 0 is the first frame of contact; NaN where the test had not begun.
        steps: Seconds before the crash that the features look at, 1 to 15.
        seed: Of the subsample and the starts of K-means, 0 to 2^32 - 1.
        vehicle_length: Of both vehicles [m].
        vehicle_width: Of both vehicles [m].
        short: What happens to cases shorter than `steps`: "pad" or "exclude" (see `crash_features`).

    Raises:
        InputError: There are no cases, or an argument is not as described.
        MissingExtraError: scikit-learn is not installed.
    """
    require_sklearn()
    check_integer("seed", seed, low=0, high=2**32 - 1)
    _check_ids(case_ids, history)
    clock = _Clock()
    with clock.stage("features"):
        features = crash_features(history, steps, short=short)
        if len(features.kept) == 0:
            raise InputError(f"No case lasts {steps} s; ask for fewer steps, or pad short cases.")
        scaled = standardise(features.values)
    with clock.stage("crash_types"):
        crash_types = classify_crashes(history[features.kept, 0], vehicle_length, vehicle_width)
    with clock.stage("pca"):
        projection = project(scaled)
    note = _why_trivial(scaled)
    with clock.stage("dbscan"):
        density = split(projection.points) if note is None else None
    is_majority = np.ones(len(scaled), np.bool_) if density is None else density.is_majority
    with clock.stage("kmeans"):
        groups = _cluster_groups(projection.points, is_majority, seed, one_only=density is None)
    ids = tuple(str(case_ids[row]) for row in features.kept)
    with clock.stage("valuable"):
        clusters, cluster_index = _describe(ids, projection.points, groups, crash_types)
        rare = () if density is None else rare_cases(projection.points, density.labels == NOISE, is_majority)
    return Analysis(
        case_ids=ids,
        steps=steps,
        features=features,
        projection=projection,
        density=density,
        is_majority=is_majority,
        cluster_index=cluster_index,
        clusters=clusters,
        rare=tuple(ids[row] for row in rare),
        crash_types=crash_types,
        seconds=clock.seconds(),
        note=note,
    )


class _Clock:
    """Wall-clock of named stages."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._stages: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self._stages[name] = time.perf_counter() - begin

    def seconds(self) -> dict[str, float]:
        return {**self._stages, "total": time.perf_counter() - self._start}


def _check_ids(case_ids: Sequence[str], history: NDArray[np.floating]) -> None:
    check_history(history)
    if len(case_ids) != len(history):
        raise InputError(f"There are {len(case_ids)} case ids for {len(history)} histories; give one for each.")
    if len(set(case_ids)) != len(case_ids):
        raise InputError(f"{len(case_ids) - len(set(case_ids))} case ids occur more than once; name each case once.")


def _why_trivial(scaled: NDArray[np.float64]) -> str | None:
    if len(scaled) < MIN_CASES:
        return f"Only {len(scaled)} case(s): fewer than {MIN_CASES} are not clustered."
    if not scaled.any():
        return "All cases have the same features: there is nothing to tell apart."
    return None


@dataclass(frozen=True)
class _Group:
    """Clusters of one group: `rows` of the cases, with a label each."""

    name: str
    rows: NDArray[np.intp]
    labels: NDArray[np.intp]
    centres: NDArray[np.float64]


def _cluster_groups(
    points: NDArray[np.float64], is_majority: NDArray[np.bool_], seed: int, *, one_only: bool
) -> list[_Group]:
    """Cluster majority and minority separately, as the paper does; an empty group is left out."""
    groups = []
    for name, mask in (("majority", is_majority), ("minority", ~is_majority)):
        rows = np.flatnonzero(mask)
        if rows.size == 0:
            continue
        if one_only:
            groups.append(_Group(name, rows, np.zeros(rows.size, np.intp), points[rows].mean(axis=0, keepdims=True)))
        else:
            found = cluster(points[rows], seed=seed)
            groups.append(_Group(name, rows, found.labels, found.centres))
    return groups


def _describe(
    ids: Sequence[str], points: NDArray[np.float64], groups: list[_Group], crash_types: CrashTypes
) -> tuple[tuple[Cluster, ...], NDArray[np.int64]]:
    """Number the clusters through all groups and pick their typical cases."""
    clusters: list[Cluster] = []
    cluster_index = np.full(len(points), -1, np.int64)
    for group in groups:
        cluster_index[group.rows] = group.labels + len(clusters)
        typical = typical_cases(points[group.rows], group.labels, group.centres)
        for label, chosen in enumerate(typical):
            members = group.rows[group.labels == label]
            clusters.append(
                Cluster(
                    id=len(clusters),
                    group=group.name,
                    size=members.size,
                    typical=tuple(ids[group.rows[row]] for row in chosen),
                    crash_types={name: n for name, n in crash_types.counts(members).items() if n},
                )
            )
    return tuple(clusters), cluster_index
