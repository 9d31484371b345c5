"""Reading and checking what the report shows, of a run or of a library; nothing here draws or simulates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checksums import read_json
from cornerforge._schema import Declared, Share, Whole
from cornerforge.errors import FileFormatError
from cornerforge.intervals import binomial_interval
from cornerforge.report.judged import read_table
from cornerforge.results import Analysed
from cornerforge.results.learning import TrainingCurve
from cornerforge.results.rates import INTERVAL95, PER_TEST, TESTS, Interval
from cornerforge.results.stating import from_file
from cornerforge.results.whole import Exposure, Spending
from cornerforge.types import METRES_PER_MILE

if TYPE_CHECKING:
    from cornerforge.library import CaseLibrary

__all__ = [
    "Artefacts",
    "Emptiness",
    "FilledRate",
    "OnRoads",
    "Points",
    "Rate",
    "Summary",
    "analyse_command",
    "library_artefacts",
    "per_billion_miles",
    "rate_beside",
    "read_artefacts",
    "read_emptiness",
]

_BILLION = 1e9


class Rate(Declared):
    """Part of a crash rate that the page shows: fields of `Simulated`, `Filled` and `Baseline`.

    Attributes:
        name: What drove the background vehicles.
    """

    name: str = ""
    tests: Annotated[Whole, TESTS]
    crashes_per_test: Annotated[Share, PER_TEST]
    interval95: Annotated[Interval, INTERVAL95]
    av_crashes: Whole | None = None
    crashes_per_mile: float | None = None
    miles: float | None = None

    @property
    def is_bound(self) -> bool:
        """True if no crash was seen: the rate is known only to lie below the upper end of its interval."""
        return self.crashes_per_test == 0.0

    @property
    def digits(self) -> int:
        """Number of significant digits to show: the third is noise unless there are hundreds of crashes."""
        return 3 if self.crashes_per_test * self.tests >= 100.0 else 2

    @property
    def bound(self) -> float:
        """Upper end of the 95 % interval, which is all that is known when no crash was seen."""
        return self.interval95[1]


class FilledRate(Rate):
    """The rate of the tests that filled the library, and the cases in it."""

    cases: Whole


class OnRoads(Rate):
    """Part of the natural rate (`NaturalRate`) that the page shows."""

    method: str
    plain_tests: Whole
    interval95_per_mile: Interval | None = None
    doubts: tuple[str, ...] = ()
    effective_sample_size: Whole
    cpu_seconds: float
    acceleration: float

    @property
    def digits(self) -> int:
        """Number of significant digits to show: the third is noise unless there are hundreds of crashes."""
        return 3 if self.method == "mc" and super().digits == 3 else 2


class Summary(Declared):
    """Part of `RunDone` that the page shows; early files may lack what has a default, and so does a single library."""

    av: str
    version: str = "unknown"
    effort: str = "unknown"
    seed: Whole | str = "unknown"
    bounded: bool = False
    seconds: float | None = None
    nde: Rate | None = None
    natural: OnRoads | None = None
    natural_cases: Analysed | None = None
    spending: Spending | None = None
    generate: FilledRate | None = None
    analyse: Any = None
    baselines: tuple[Rate, ...] = ()

    @property
    def natural_rate(self) -> Rate | None:
        """The best that is known of the AV's rate in natural traffic; None if nothing is."""
        rate, plain = self.natural, self.nde
        if rate is None or (rate.is_bound and plain is not None and (not plain.is_bound or plain.tests > rate.tests)):
            return plain
        return rate


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
    """Everything the page shows except the trajectories, which are read case by case.

    Attributes:
        out: Folder of the page.
        library, analysed_in: The library, and the folder of its analysis.
        summary: Numbers of the page.
        training, exposure: Results of a run; None for a library.
        analysis, points: Analysis and points of the library.
        provenance: Where it comes from.
        command: What writes the page again.
    """

    out: Path
    library: Path
    analysed_in: Path
    summary: Summary
    training: TrainingCurve | None
    exposure: Exposure | None
    analysis: Analysed
    points: Points
    provenance: Mapping[str, Any]
    command: str

    @property
    def natural_library(self) -> Path | None:
        """Where natural crashes are, weighted or counted; None if there is none."""
        natural = self.summary.natural
        if natural is None or self.training is None:
            return None if self.analysis.natural is None else self.library
        return self.out / "natural" / ("library" if natural.method == "mc" else "weighted")


@dataclass(frozen=True)
class Emptiness:
    """Artefacts of a run for some hours in which the adversary made the AV crash in no test.

    Attributes:
        summary: Numbers of the run.
        provenance: Where it comes from.
    """

    summary: Summary
    provenance: Mapping[str, Any]


def read_emptiness(out: Path) -> Emptiness | None:
    """Read the artefacts of a run that found no case; None if it found some.

    Raises:
        FileFormatError: A file is missing or damaged; the message names it and what writes it again.
    """
    run = f"cornerforge run --out {out} --resume"
    summary = _summary(out / "summary.json", run)
    if summary.analyse is not None or summary.spending is None:
        return None
    return Emptiness(summary, _provenance(out, run))


def read_artefacts(out: Path) -> Artefacts:
    """Read the artefacts of a run.

    Args:
        out: Folder that `cornerforge run --out` filled.

    Raises:
        FileFormatError: A file is missing or damaged; the message names it and what writes it again.
    """
    run, analyse = f"cornerforge run --out {out}", analyse_command(out)
    provenance = _provenance(out, run)
    return Artefacts(
        out=out,
        library=out / "library",
        analysed_in=out / "analysis",
        summary=_summary(out / "summary.json", run),
        training=_timed(
            from_file(TrainingCurve, out / "training.json", run), from_file(_Times, out / "provenance.json", run)
        ),
        exposure=from_file(Exposure, out / "exposure.json", run),
        analysis=from_file(Analysed, out / "analysis" / "analysis.json", analyse),
        points=_points(out / "analysis" / "points.parquet", analyse),
        provenance=provenance,
        command=run,
    )


def library_artefacts(library: Path, out: Path) -> Artefacts:
    """Read what the page of a single library shows.

    Args:
        library: The library.
        out: Folder of the page, with its analysis in `analysis/`.

    Raises:
        FileFormatError: A file is missing or damaged; the message names it and what writes it again.
    """
    from cornerforge.library import CaseLibrary

    command = f"cornerforge report {library} --out {out}"
    cases = CaseLibrary.open(library)
    found = from_file(Analysed, out / "analysis" / "analysis.json", command)
    run = cases.identity
    return Artefacts(
        out=out,
        library=library,
        analysed_in=out / "analysis",
        summary=Summary(
            av=str(run.get("av", "unknown")),
            version=str(run.get("cornerforge", "unknown")),
            effort="",
            seed=str(run.get("seed", "unknown")),
            bounded=bool(run.get("bounded", False)),
            natural=rate_beside(library) if found.natural is not None else None,
            natural_cases=found if found.natural is not None else None,
            generate=None if found.natural is not None or cases.scripted else _filled_rate(cases),
        ),
        training=None,
        exposure=None,
        analysis=found,
        points=_points(out / "analysis" / "points.parquet", command),
        provenance=_provenance(out / "analysis", command),
        command=command,
    )


def rate_beside(library: Path) -> OnRoads | None:
    """Read the natural rate that `rate --out` left beside its library; None if there is none."""
    file = library.parent / "rate.json"
    if not file.is_file():
        return None
    return replace(
        from_file(OnRoads, file, f"cornerforge rate --out {library.parent} --resume"), name="natural traffic"
    )


def per_billion_miles(cases: CaseLibrary) -> float:
    """Give the crashes per billion miles that one crash per test stands for, as the natural rate beside a library says.

    Without one it is by the length of a test, which is more than an AV drives that crashes on the way.
    """
    rate = rate_beside(cases.path)
    if rate is not None and rate.crashes_per_mile and rate.crashes_per_test:
        return _BILLION * rate.crashes_per_mile / rate.crashes_per_test
    return _BILLION * METRES_PER_MILE / cases.odd.test_length


def _filled_rate(cases: CaseLibrary) -> FilledRate | None:
    """Give the rate of the tests that filled a library; None if it does not say how many there were."""
    if cases.tests == 0:
        return None
    return FilledRate(
        name=str(cases.identity.get("bv", "adversary")),
        tests=cases.tests,
        crashes_per_test=cases.crashes / cases.tests,
        interval95=binomial_interval(cases.crashes, cases.tests),
        av_crashes=cases.crashes,
        cases=len(cases),
    )


def analyse_command(out: Path) -> str:
    """Return the command that writes the analysis of a run again."""
    return f"cornerforge analyse {out / 'library'} --out {out / 'analysis'}"


def _provenance(folder: Path, command: str) -> dict[str, Any]:
    return read_json(folder / "provenance.json", f"write it with: {command}")


def _summary(file: Path, command: str) -> Summary:
    found = from_file(Summary, file, command)
    if found.nde is None or found.generate is None:
        raise FileFormatError(f'{file}: "nde, generate" are missing; write the file again with: {command}')
    name = "natural traffic"
    natural = found.natural if found.natural is None else replace(found.natural, name=name)
    nde, generate = replace(found.nde, name=name), replace(found.generate, name="adversary")
    return replace(found, nde=nde, natural=natural, generate=generate)


@dataclass(frozen=True)
class _Times:
    """Times at which the points of the training curve were reached [s], as a provenance may say."""

    point_seconds: tuple[float, ...] | None = None


def _timed(found: TrainingCurve, times: _Times) -> TrainingCurve:
    """Take the times of the points from the provenance; those of files of older versions are in the points."""
    seconds = times.point_seconds
    if seconds is None or len(seconds) != len(found.points):
        return found
    points = (replace(point, seconds=at) for point, at in zip(found.points, seconds, strict=True))
    return replace(found, points=tuple(points))


def _points(file: Path, command: str) -> Points:
    names = ["case_id", "pc1", "pc2", "group", "cluster", "crash_type"]
    columns = read_table(file, names, command)
    return Points(
        case_id=columns["case_id"],
        pc1=np.array(columns["pc1"], dtype=np.float64),
        pc2=np.array(columns["pc2"], dtype=np.float64),
        group=columns["group"],
        cluster=np.array(columns["cluster"], dtype=np.int64),
        crash_type=columns["crash_type"],
    )
