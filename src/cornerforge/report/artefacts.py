"""Reading and checking what the report shows, of a run or of a library; nothing here draws or simulates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cornerforge._checksums import read_json
from cornerforge._schema import Declared, Whole
from cornerforge.errors import FileFormatError
from cornerforge.report.judged import read_table
from cornerforge.results import Analysed, NaturalRate, Simulated
from cornerforge.results.driving import CasesMade
from cornerforge.results.learning import Baseline, TrainingCurve
from cornerforge.results.rates import Counted, Rate
from cornerforge.results.stating import from_file
from cornerforge.results.whole import Exposure, Spending
from cornerforge.types import METRES_PER_MILE

if TYPE_CHECKING:
    from cornerforge.library import CaseLibrary

__all__ = [
    "NATURAL_TRAFFIC",
    "Artefacts",
    "Emptiness",
    "Points",
    "Summary",
    "analyse_command",
    "library_artefacts",
    "per_billion_miles",
    "rate_beside",
    "read_artefacts",
    "read_emptiness",
]

_BILLION = 1e9
NATURAL_TRAFFIC = "natural traffic"
"""Name of the natural rate among rates."""


class Summary(Declared):
    """Part of `RunDone` that the page shows; a single library lacks what has a default."""

    av: str
    version: str = "unknown"
    effort: str = "unknown"
    seed: Whole | str = "unknown"
    bounded: bool = False
    seconds: float | None = None
    nde: Simulated | None = None
    natural: NaturalRate | None = None
    natural_cases: Analysed | None = None
    spending: Spending | None = None
    generate: CasesMade | None = None
    analyse: Any = None
    baselines: tuple[Baseline, ...] = ()
    adversary: str = "adversary"

    @property
    def natural_rate(self) -> Rate | None:
        """The best that is known of the AV's rate in natural traffic; None if nothing is."""
        rate, plain = self.natural, self.nde
        if rate is None or (rate.is_bound and plain is not None and (not plain.is_bound or plain.tests > rate.tests)):
            return plain
        return rate

    @property
    def rates(self) -> dict[str, Counted]:
        """All rates, by what drives the others."""
        plain = {one.name: one for one in self.baselines}
        found = {self.adversary: self.generate, **plain, NATURAL_TRAFFIC: self.natural_rate}
        return {name: one for name, one in found.items() if one is not None}


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
    summary = _summary(out / "summary.json", run)
    analysis = from_file(Analysed, out / "analysis" / "analysis.json", analyse)
    if summary.generate is not None and summary.generate.cases < analysis.cases:
        raise FileFormatError(
            f'{out / "summary.json"}: "generate.cases" is {summary.generate.cases}, but {analysis.cases} were analysed '
            f"({out / 'analysis' / 'analysis.json'}); write the file again with: {run}"
        )
    return Artefacts(
        out=out,
        library=out / "library",
        analysed_in=out / "analysis",
        summary=summary,
        training=_timed(
            from_file(TrainingCurve, out / "training.json", run), from_file(_Times, out / "provenance.json", run)
        ),
        exposure=from_file(Exposure, out / "exposure.json", run),
        analysis=analysis,
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
    from cornerforge.library.filling import cases_made

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
            generate=cases_made(cases) if found.natural is None and not cases.scripted and cases.tests else None,
            adversary=str(run.get("bv", "adversary")),
        ),
        training=None,
        exposure=None,
        analysis=found,
        points=_points(out / "analysis" / "points.parquet", command),
        provenance=_provenance(out / "analysis", command),
        command=command,
    )


def rate_beside(library: Path) -> NaturalRate | None:
    """Read the natural rate that `rate --out` left beside its library; None if there is none."""
    file = library.parent / "rate.json"
    if not file.is_file():
        return None
    return from_file(NaturalRate, file, f"cornerforge rate --out {library.parent} --resume")


def per_billion_miles(cases: CaseLibrary) -> float:
    """Give the crashes per billion miles that one crash per test stands for, as the natural rate beside a library says.

    Without one it is by the length of a test, which is more than an AV drives that crashes on the way.
    """
    rate = rate_beside(cases.path)
    if rate is not None and rate.crashes_per_mile and rate.crashes_per_test:
        return _BILLION * rate.crashes_per_mile / rate.crashes_per_test
    return _BILLION * METRES_PER_MILE / cases.odd.test_length


def analyse_command(out: Path) -> str:
    """Return the command that writes the analysis of a run again."""
    return f"cornerforge analyse {out / 'library'} --out {out / 'analysis'}"


def _provenance(folder: Path, command: str) -> dict[str, Any]:
    return read_json(folder / "provenance.json", f"write it with: {command}")


def _summary(file: Path, command: str) -> Summary:
    found = from_file(Summary, file, command)
    if found.nde is None or found.generate is None:
        raise FileFormatError(f'{file}: "nde, generate" are missing; write the file again with: {command}')
    return found


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
