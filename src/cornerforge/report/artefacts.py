"""Reading and checking what the report shows, from the folder of a run; nothing here draws or simulates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cornerforge.errors import FileFormatError
from cornerforge.report.judged import Judged, read_judged, read_table
from cornerforge.report.reader import Reader, read_json

__all__ = [
    "Analysis",
    "Artefacts",
    "Cluster",
    "Histogram",
    "Points",
    "Rate",
    "Training",
    "analyse_command",
    "read_artefacts",
]


@dataclass(frozen=True)
class Rate:
    """Crashes of the AV in independent tests, with its 95 % interval.

    Attributes:
        name: What drove the background vehicles.
        tests: Number of tests, the sampling unit.
        per_test: Crashes per test, in [0, 1].
        low, high: 95 % interval of `per_test`.
        crashes: Number of crashes; None where the artefact does not say.
        per_mile: Crashes per mile; None where the artefact does not say.
    """

    name: str
    tests: int
    per_test: float
    low: float
    high: float
    crashes: int | None = None
    per_mile: float | None = None

    @property
    def is_bound(self) -> bool:
        """True if no crash was seen: the rate is known only to lie below 3 / tests (95 %)."""
        return self.per_test == 0.0

    @property
    def digits(self) -> int:
        """Number of significant digits to show: the third is noise unless there are hundreds of crashes."""
        return 3 if self.per_test * self.tests >= 100.0 else 2

    @property
    def bound(self) -> float:
        """Upper 95 % bound of the rate when no crash was seen: 3 / tests (at most 1)."""
        return min(1.0, 3.0 / self.tests)


@dataclass(frozen=True)
class Histogram:
    """One quantity at 1 Hz in two worlds.

    Attributes:
        label, unit: For the axis.
        edges: Bin edges in `unit`, shape (n + 1,), rising.
        nde, adversary: Samples per bin, shape (n,).
    """

    label: str
    unit: str
    edges: NDArray[np.float64]
    nde: NDArray[np.float64]
    adversary: NDArray[np.float64]


@dataclass(frozen=True)
class Training:
    """Yield while the adversary learnt; lists of equal length, None where a value was not recorded."""

    preset: str
    seconds: list[float | None]
    decisions: list[float]
    epsilon: list[float | None]
    loss: list[float | None]
    per_test: list[float | None]
    tests: list[float | None]


@dataclass(frozen=True)
class Cluster:
    """A cluster of cases; `typical` holds case ids, nearest to the centre first."""

    id: int
    group: str
    size: int
    typical: list[str]
    crash_types: dict[str, int]


@dataclass(frozen=True)
class Analysis:
    """The analysis of the library; see each key of `analysis.json`. `explained_variance` are shares in [0, 1]."""

    cases: int
    steps: int
    features: list[str]
    padded: int
    excluded: int
    explained_variance: list[float]
    loadings: dict[str, list[float]]
    eps: float | None
    min_samples: int | None
    majority: int
    minority: int
    clusters: list[Cluster]
    rare: list[str]
    crash_types: dict[str, int]
    striker: dict[str, int]
    note: str


@dataclass(frozen=True)
class Points:
    """The cases in the plane of the two principal components (no unit); all of shape (S,)."""

    case_id: list[str]
    pc1: NDArray[np.float64]
    pc2: NDArray[np.float64]
    group: list[str]
    cluster: NDArray[np.int64]
    crash_type: list[str]


@dataclass(frozen=True)
class Artefacts:
    """Everything the page shows except the trajectories, which are read case by case."""

    out: Path
    av: str
    version: str
    effort: str
    seed: str
    bounded: bool
    seconds: float | None
    nde: Rate
    generate: Rate
    cases: int
    baselines: list[Rate]
    training: Training
    miles: dict[str, float]
    exposure: dict[str, Histogram]
    analysis: Analysis
    judged: Judged
    points: Points
    provenance: Mapping[str, Any]


def read_artefacts(out: Path) -> Artefacts:
    """Read and check the artefacts of a run.

    Args:
        out: Folder that `cornerforge run --out` filled.

    Raises:
        FileFormatError: A file is missing or damaged; the message names it and what writes it again.
    """
    run = f"cornerforge run --out {out}"
    summary = read_json(out / "summary.json", run)
    exposure = read_json(out / "exposure.json", run)
    analyse = analyse_command(out)
    analysis = read_json(out / "analysis" / "analysis.json", analyse)
    generate = summary.child("generate")
    provenance = read_json(out / "provenance.json", run)
    return Artefacts(
        out=out,
        av=summary.text("av"),
        version=summary.text("version", "unknown"),
        effort=summary.text("effort", "unknown"),
        seed=str(summary.values.get("seed", "unknown")),
        bounded=bool(summary.values.get("bounded", False)),
        seconds=summary.number_or_none("seconds"),
        nde=_rate(summary.child("nde"), "natural traffic (NDE)"),
        generate=_rate(generate, "adversary"),
        cases=generate.count("cases"),
        baselines=[
            _rate(r, r.text("name")) for r in (summary.children("baselines") if summary.has("baselines") else [])
        ],
        training=_training(read_json(out / "training.json", run), provenance),
        miles={world: exposure.child("miles").number(world) for world in ("nde", "adversary")},
        exposure={k: _histogram(exposure.child("quantities").child(k)) for k in exposure.child("quantities").values},
        analysis=_analysis(analysis),
        judged=read_judged(analysis),
        points=_points(out / "analysis" / "points.parquet", analyse),
        provenance=provenance.values,
    )


def analyse_command(out: Path) -> str:
    """Return the command that writes the analysis of a run again."""
    return f"cornerforge analyse {out / 'library'} --out {out / 'analysis'}"


def _rate(reader: Reader, name: str) -> Rate:
    tests = reader.count("tests")
    if tests == 0:
        raise reader.fault("tests", "is 0, so there is no rate")
    per_test = reader.number("crashes_per_test")
    low, high = reader.numbers("interval95", 2)
    if not 0.0 <= low <= per_test <= high:
        raise reader.fault("interval95", f"= [{low}, {high}] does not hold crashes_per_test = {per_test}")
    crashes = reader.count("av_crashes") if reader.has("av_crashes") else None
    return Rate(name, tests, per_test, low, high, crashes, reader.number_or_none("crashes_per_mile"))


def _training(reader: Reader, provenance: Reader) -> Training:
    """Read the curve; its times come from the provenance, or from the points in files of older versions."""
    points = reader.children("points")
    found = provenance.values.get("point_seconds")
    timed = isinstance(found, list) and len(found) == len(points)

    def column(key: str) -> list[float | None]:
        return [point.number_or_none(key) for point in points]

    return Training(
        preset=reader.text("preset", "unknown"),
        seconds=[*provenance.numbers("point_seconds")] if timed else column("seconds"),
        decisions=[point.number("decisions") for point in points],
        epsilon=column("epsilon"),
        loss=column("loss"),
        per_test=column("crashes_per_test"),
        tests=column("tests"),
    )


def _histogram(reader: Reader) -> Histogram:
    edges = np.array(reader.numbers("edges"))
    if len(edges) < 2 or not (np.diff(edges) > 0).all():
        raise reader.fault("edges", "are not at least two rising numbers")
    counts = {world: np.array(reader.numbers(world, len(edges) - 1)) for world in ("nde", "adversary")}
    for world, values in counts.items():
        if (values < 0).any():
            raise reader.fault(world, "holds a negative count")
    return Histogram(reader.text("label"), reader.text("unit"), edges, counts["nde"], counts["adversary"])


def _analysis(reader: Reader) -> Analysis:
    loadings = reader.child("loadings") if reader.has("loadings") else None
    return Analysis(
        cases=reader.count("cases"),
        steps=reader.count("steps"),
        features=reader.texts("features"),
        padded=reader.count("padded"),
        excluded=reader.count("excluded"),
        explained_variance=reader.numbers("explained_variance", 2),
        loadings={name: loadings.numbers(name, 2) for name in loadings.values} if loadings else {},
        eps=reader.number_or_none("eps"),
        min_samples=reader.count("min_samples") if reader.has("min_samples") else None,
        majority=reader.count("majority"),
        minority=reader.count("minority"),
        clusters=[_cluster(cluster) for cluster in reader.children("clusters")],
        rare=reader.texts("rare"),
        crash_types=reader.counts("crash_types"),
        striker=reader.counts("striker"),
        note=reader.text("note", ""),
    )


def _cluster(reader: Reader) -> Cluster:
    return Cluster(
        id=reader.count("id"),
        group=reader.text("group"),
        size=reader.count("size"),
        typical=reader.texts("typical"),
        crash_types=reader.counts("crash_types"),
    )


def _points(file: Path, command: str) -> Points:
    names = ["case_id", "pc1", "pc2", "group", "cluster", "crash_type"]
    columns = read_table(file, names, command)
    fault = _points_fault(columns)
    if fault:
        raise FileFormatError(f"{file}: {fault}; write it again with: {command}")
    return Points(
        case_id=columns["case_id"],
        pc1=np.array(columns["pc1"], dtype=np.float64),
        pc2=np.array(columns["pc2"], dtype=np.float64),
        group=columns["group"],
        cluster=np.array(columns["cluster"], dtype=np.int64),
        crash_type=columns["crash_type"],
    )


def _points_fault(columns: dict[str, list[Any]]) -> str | None:
    """Say what is wrong with the columns; None if nothing is."""
    for name, values in columns.items():
        if any(value is None or (isinstance(value, float) and not math.isfinite(value)) for value in values):
            return f'the column "{name}" holds a value that is missing or not finite'
    unknown = set(columns["group"]) - {"majority", "minority"}
    return f'the column "group" holds {sorted(unknown)[0]!r}, allowed: majority, minority' if unknown else None
