"""`figure` draws for a paper: a case as a strip of snapshots, or the charts of a run's or a library's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cornerforge._files import write_bytes
from cornerforge._locks import claim_folder
from cornerforge._options import verb
from cornerforge.analysis.avoidability import AvoidParams, avoidability
from cornerforge.analysis.in_words import what_happened
from cornerforge.errors import InputError, UnknownNameError
from cornerforge.experiment.output import check_new_file, is_finished_run
from cornerforge.ext.pictures.options import Figure
from cornerforge.ext.pictures.printed import CAPTIONS, print_chart
from cornerforge.ext.pictures.printing import FORMATS, check_print, print_of, width_named
from cornerforge.ext.pictures.strip import key_moments, strip_figure
from cornerforge.library import CaseLibrary
from cornerforge.results.whole import Figured, FiguredOne
from cornerforge.types import Scenario
from cornerforge.verbs.analyse import analyse
from cornerforge.verbs.make_report import library_of
from cornerforge.work.progress import Progress

if TYPE_CHECKING:
    from cornerforge.report.artefacts import Artefacts

__all__ = ["figure", "figure_text"]

_NATURAL = "natural/"
"""Begins the names of a run's natural cases, as on its page."""
_OF_CASES = ("types", "fault", "rules", "own", "prevented", "avoidability")
_COUNTED = " Natural cases are counted, not weighted by how often they happen."


@verb(Figure)
def figure(options: Figure) -> Figured:
    """Draw figures for a paper: vector graphics with 8 pt text at the width at which they are to be printed.

    Returns:
        What `cornerforge figure --json` prints: the files, each with a caption.

    Raises:
        CornerForgeError: The case or chart is unknown, a file or output place is not right, or matplotlib is not
            installed.
    """
    inches = width_named(options.width)
    if options.case is not None and not options.listing:
        return _strip(Path(options.place), options.case, options.out, _seconds(options.times), inches)
    if options.times is not None:
        raise InputError("Times are those of a case's snapshots; name the case.")
    suffix = f".{options.file_format.lower()}"
    if suffix not in FORMATS:
        raise InputError(f'No format "{options.file_format}"; choose pdf or svg.')
    for name in options.figures or ():
        if name not in CAPTIONS:
            raise UnknownNameError("figure", name, CAPTIONS)
    if options.listing or options.out is None:
        return Figured(figures=tuple(FiguredOne(name=name, file=None, caption=text) for name, text in CAPTIONS.items()))
    folder = Path(options.out)
    claim_folder(folder)
    files = {name: folder / f"{name}{suffix}" for name in options.figures or CAPTIONS}
    for file in files.values():
        check_print(file)
        check_new_file(file)
    charts, is_natural = _charts(Path(options.place), folder, options.seed, options.threads, options.progress)
    missing = [name for name in options.figures or () if name not in charts]
    if missing:
        raise InputError(f"{options.place} holds nothing for the figure {missing[0]}; there are: {', '.join(charts)}.")
    made = []
    chosen = [name for name in CAPTIONS if name in charts and name in files]
    for done, name in enumerate(chosen):
        options.progress("figure", done, len(chosen))
        write_bytes(files[name], print_of(print_chart(charts[name], inches), suffix))
        caption = f"{CAPTIONS[name]}{_COUNTED if is_natural and name in _OF_CASES else ''}"
        made.append(FiguredOne(name=name, file=str(files[name]), caption=caption))
    options.progress("figure", len(chosen), len(chosen))
    return Figured(figures=tuple(made))


def _seconds(given: str | Sequence[float] | None) -> Sequence[float] | None:
    """Read times such as "-3,-2,-1,0".

    Raises:
        InputError: They are no numbers.
    """
    if not isinstance(given, str):
        return given
    try:
        return [float(one) for one in given.split(",")]
    except ValueError:
        raise InputError(f'times = "{given}" are no numbers with commas between them, such as -3,-2,-1,0.') from None


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
    if scenario.partner is None:
        return {}
    answer = avoidability(scenario, AvoidParams(steers=steers))
    known = {answer.manoeuvre_s: "the manoeuvre begins"}
    if answer.latest_s is not None:
        known[answer.latest_s] = "; ".join(filter(None, (known.get(answer.latest_s), "the AV's last way out")))
    return known


def _caption(case: str, scenario: Scenario) -> str:
    happened = "" if scenario.partner is None else f": {what_happened(scenario)}"
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


def figure_text(found: Figured) -> str:
    """Write a line for each chart or strip."""
    return "\n".join(f"{one.name if one.file is None else one.file}: {one.caption}" for one in found.figures)
