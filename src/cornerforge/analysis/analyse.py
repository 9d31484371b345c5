"""The whole analysis: features, projection, density split, clusters, crash types, valuable cases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.analysis.crash_types import CrashTypes, classify_crashes
from cornerforge.analysis.dbscan import DensitySplit
from cornerforge.analysis.features import Features, ShortCases, check_history, crash_features
from cornerforge.analysis.grouping import MIN_CASES, Clock, Grouping, group_features, load
from cornerforge.analysis.kmeans import Choice
from cornerforge.analysis.pca import Projection
from cornerforge.errors import InputError
from cornerforge.results import as_json
from cornerforge.results.analysis import Cluster

__all__ = ["MIN_CASES", "Analysis", "Cluster", "analyse"]


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
        choices: Why "majority" and "minority" have as many clusters; empty when there was no split.
        rare: Up to ten case ids of outliers, farthest first.
        crash_types: Type and striker of each case.
        seconds: Wall-clock of each stage [s], without loading libraries.
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
    choices: dict[str, Choice]
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
            "clusters": [as_json(one) for one in self.clusters],
            "choices": {name: choice.to_json() for name, choice in self.choices.items()},
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
    vehicle_length: float | NDArray[np.floating] = 5.0,
    vehicle_width: float | NDArray[np.floating] = 2.0,
    short: ShortCases = "pad",
) -> Analysis:
    """Find typical and rare cases and the types of crash.

    Args:
        case_ids: One different name per case, length S.
        history: [x m, y m, speed m/s, heading rad] of the AV (0) and the crash partner (1) at k seconds before the
            crash, shape (S, 16, 2, 4); k = 0 is the first frame of contact; NaN where the test had not begun.
        steps: Seconds before the crash that the features look at, 1 to 15.
        seed: Seed of the subsample and of the starts of K-means, 0 to 2^32 - 1.
        vehicle_length: Length of AV and crash partner [m], one number or shape (S, 2).
        vehicle_width: Width [m], in the same form.
        short: What happens to cases shorter than `steps`: "pad" or "exclude" (see `crash_features`).

    Raises:
        InputError: There are no cases, or an argument is not as described.
        MissingExtraError: scikit-learn is not installed.
    """
    load()
    _check_ids(case_ids, history)
    clock = Clock()
    with clock.stage("features"):
        features = crash_features(history, steps, short=short)
    if len(features.kept) == 0:
        raise InputError(f"No case lasts {steps} s; ask for fewer steps, or pad short cases.")
    with clock.stage("crash_types"):
        kept = features.kept
        length, width = (
            size[kept] if isinstance(size, np.ndarray) else size for size in (vehicle_length, vehicle_width)
        )
        crash_types = classify_crashes(history[kept, 0], length, width)
    found = group_features(features.values, seed=seed)
    own = clock.seconds()
    total = {"total": own.pop("total")}
    ids = tuple(str(case_ids[row]) for row in features.kept)
    return Analysis(
        case_ids=ids,
        steps=steps,
        features=features,
        projection=found.projection,
        density=found.density,
        is_majority=found.is_majority,
        cluster_index=found.index,
        clusters=_named(ids, found, crash_types),
        choices=found.choices,
        rare=tuple(ids[row] for row in found.rare),
        crash_types=crash_types,
        seconds=own | {name: value for name, value in found.seconds.items() if name != "total"} | total,
        note=found.note,
    )


def _check_ids(case_ids: Sequence[str], history: NDArray[np.floating]) -> None:
    check_history(history)
    if len(case_ids) != len(history):
        raise InputError(f"There are {len(case_ids)} case ids for {len(history)} histories; give one for each.")
    if len(set(case_ids)) != len(case_ids):
        raise InputError(f"{len(case_ids) - len(set(case_ids))} case ids occur more than once; name each case once.")


def _named(ids: Sequence[str], found: Grouping, crash_types: CrashTypes) -> tuple[Cluster, ...]:
    """The clusters with the names of their typical cases and their crash types."""
    return tuple(
        Cluster(
            id=number,
            group=group.name,
            size=group.size,
            typical=tuple(ids[row] for row in group.typical),
            crash_types={name: n for name, n in crash_types.counts(np.flatnonzero(found.index == number)).items() if n},
        )
        for number, group in enumerate(found.groups)
    )
