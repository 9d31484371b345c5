"""`figure` draws for a paper: a case as a strip of snapshots, or the charts of a run's or a library's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cornerforge._arguments import checked
from cornerforge._files import write_bytes
from cornerforge._locks import claim_folder, claims
from cornerforge.analysis.avoidability import AvoidParams, avoidability
from cornerforge.analysis.in_words import what_happened
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.output import check_new_file, is_finished_run
from cornerforge.ext.pictures.printed import CAPTIONS, print_chart
from cornerforge.ext.pictures.printing import FORMATS, check_print, print_of, width_named
from cornerforge.ext.pictures.strip import key_moments, strip_figure
from cornerforge.library import CaseLibrary
from cornerforge.report.moments import partner_of
from cornerforge.results.whole import Figured, FiguredOne
from cornerforge.types import Scenario
from cornerforge.verbs.analyse import analyse
from cornerforge.verbs.make_report import library_of

if TYPE_CHECKING:
    from cornerforge.report.artefacts import Artefacts

__all__ = ["figure"]

_NATURAL = "natural/"
"""Begins the names of a run's natural cases, as on its page."""
_OF_CASES = ("types", "fault", "rules", "own", "prevented", "avoidability")
_COUNTED = " Natural cases are counted, not weighted by how often they happen."


@checked
@claims()
def figure(
    place: Path | str,
    case: str | None = None,
    *,
    out: Path | str | None = None,
    times: Sequence[float] | None = None,
    figures: Sequence[str] | None = None,
    file_format: str = "pdf",
    width: str = "column",
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> Figured:
    """Draw figures for a paper: vector graphics with 8 pt text at the width at which they are to be printed.

    Args:
        place: A library; or a folder of `run` or `rate`.
        case: Id of a case, which becomes a strip of snapshots; `natural/ID` for a natural case of a run. None: the
            charts of the page of `run` or `report` are drawn instead.
        out: For a case the new file, .pdf or .svg. For charts their folder; for those of a library it also holds
            `analysis/`, as for `report`. None: nothing is drawn, and the names of the charts are returned.
        times: Seconds at which the snapshots are taken, 0 is the contact, negative before it; None: begin of the
            manoeuvre, first braking, the AV's last way out, the contact.
        figures: Names of charts; None for all there are.
        file_format: Of charts, pdf or svg.
        width: column (3.5 in) or page (7.16 in).
        seed, threads: Of the analysis of a library, as for `analyse`.
        progress: Told how far it is.

    Returns:
        What `cornerforge figure --json` prints: the files, each with a caption.

    Raises:
        CornerForgeError: There is no such case or chart, a file or output place is not right, or matplotlib is not
            installed.
    """
    inches = width_named(width)
    if case is not None:
        return _strip(Path(place), case, out, times, inches)
    if times is not None:
        raise InputError("Times are those of a case's snapshots; name the case.")
    suffix = f".{file_format.lower()}"
    if suffix not in FORMATS:
        raise InputError(f'No format "{file_format}"; choose pdf or svg.')
    for name in figures or ():
        if name not in CAPTIONS:
            raise UnknownNameError("figure", name, CAPTIONS)
    if out is None:
        return Figured(figures=tuple(FiguredOne(name=name, file=None, caption=text) for name, text in CAPTIONS.items()))
    folder = Path(out)
    claim_folder(folder)
    files = {name: folder / f"{name}{suffix}" for name in figures or CAPTIONS}
    for file in files.values():
        check_print(file)
        check_new_file(file)
    charts, is_natural = _charts(Path(place), folder, seed, threads, progress)
    missing = [name for name in figures or () if name not in charts]
    if missing:
        raise InputError(f"{place} holds nothing for the figure {missing[0]}; there are: {', '.join(charts)}.")
    made = []
    chosen = [name for name in CAPTIONS if name in charts and name in files]
    for done, name in enumerate(chosen):
        progress("figure", done, len(chosen))
        write_bytes(files[name], print_of(print_chart(charts[name], inches), suffix))
        caption = f"{CAPTIONS[name]}{_COUNTED if is_natural and name in _OF_CASES else ''}"
        made.append(FiguredOne(name=name, file=str(files[name]), caption=caption))
    progress("figure", len(chosen), len(chosen))
    return Figured(figures=tuple(made))


def _strip(
    place: Path, case: str, out: Path | str | None, times: Sequence[float] | None, inches: float
) -> Figured:  # fmt: skip
    if out is None:
        raise InputError("A case's figure needs a file; name it by --out, such as --out crash.pdf.")
    file = Path(out)
    check_print(file)
    check_new_file(file)
    case_id = case.removeprefix(_NATURAL)
    cases = CaseLibrary.open(library_of(place / "natural" if case != case_id else place))
    scenario = cases.scenario(case_id).scenario
    moments: Mapping[float, str] | Sequence[float]
    if times is not None:
        moments = [0.0 if time == 0.0 else -time for time in times]
    else:
        moments = key_moments(scenario, _known(scenario, steers=bool(cases.identity.get("av_steers"))))
    write_bytes(file, print_of(strip_figure(scenario, moments, width=inches), file.suffix.lower()))
    return Figured(figures=(FiguredOne(name=case, file=str(file), caption=_caption(case, scenario)),))


def _known(scenario: Scenario, *, steers: bool) -> dict[float, str]:
    """Describe some seconds before the contact; "" where the AV does not crash."""
    if partner_of(scenario) is None:
        return {}
    answer = avoidability(scenario, AvoidParams(steers=steers))
    known = {answer.manoeuvre_s: "the manoeuvre begins"}
    if answer.latest_s is not None:
        known[answer.latest_s] = "; ".join(filter(None, (known.get(answer.latest_s), "the AV's last way out")))
    return known


def _caption(case: str, scenario: Scenario) -> str:
    happened = "" if partner_of(scenario) is None else f": {what_happened(scenario)}"
    return (
        f"Case {case}{happened}. Seen from above, to scale, moving with the AV (dark); times are relative to the "
        "contact, lines behind vehicles are their paths of the last second, dashed arrows lead to the lane that is "
        "changed to."
    )


def _charts(
    place: Path, folder: Path, seed: int, threads: int | None, progress: Progress
) -> tuple[dict[str, Any], bool]:  # fmt: skip
    """Make the charts of the page of a run or a library by name; say whether the cases are natural ones."""
    from cornerforge.report.artefacts import library_artefacts, read_artefacts
    from cornerforge.report.page import charts_of

    found: Artefacts
    if is_finished_run(place):
        found = read_artefacts(place)
    else:
        library = library_of(place)
        analyse(library, out=folder / "analysis", seed=seed, threads=threads, progress=progress)
        found = library_artefacts(library, folder)
    return charts_of(found, set(found.points.case_id)), found.analysis.natural is not None
