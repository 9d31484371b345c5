"""`report` makes the page of anything: of a run, of a natural rate, or of any library of cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cornerforge._extensions import extension
from cornerforge._locks import claim_folder
from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.output import is_finished_run
from cornerforge.library.manifest import MANIFEST
from cornerforge.results.whole import Reported
from cornerforge.verbs.analyse import analyse
from cornerforge.verbs.options.whole import MakeReport

if TYPE_CHECKING:
    from cornerforge.report.artefacts import Artefacts

__all__ = ["library_of", "make_report"]


@verb(MakeReport)
def make_report(options: MakeReport) -> Reported:
    """Make `report.html` of a run or of a library, whichever AV and adversary made it.

    Returns:
        What `cornerforge report --json` prints: where the page is.

    Raises:
        CornerForgeError: There is nothing to make a page of, or a file or output place is not right.
    """
    from cornerforge.report import write_library_report, write_report
    from cornerforge.report.artefacts import library_artefacts, read_artefacts

    given = Path(options.place)
    if options.beside and not options.evidence:
        raise InputError("--beside names results for --evidence; give both.")
    if is_finished_run(given):
        claim_folder(given)
        options.progress("report", 0, 1)
        page = write_report(given)
        options.progress("report", 1, 1)
        found = Reported(report=str(page), library=str(given / "library"))
        return _with_evidence(found, options, lambda: read_artefacts(given))
    library = library_of(given)
    folder = Path(options.out)
    claim_folder(folder)
    analyse(
        library, out=folder / "analysis", avoidability=options.avoidability, reaction=options.reaction,
        seed=options.seed, threads=options.threads, progress=options.progress,
    )  # fmt: skip
    options.progress("report", 0, 1)
    page = write_library_report(library, folder)
    options.progress("report", 1, 1)
    found = Reported(report=str(page), library=str(library))
    return _with_evidence(found, options, lambda: library_artefacts(library, folder))


def _with_evidence(found: Reported, options: MakeReport, artefacts: Callable[[], Artefacts]) -> Reported:
    """Add the page of evidence, if it is asked for."""
    if not options.evidence:
        return found
    page, data = extension("evidence").write_evidence(artefacts(), [Path(place) for place in options.beside])
    return replace(found, evidence=str(page), evidence_data=str(data))


def library_of(place: Path) -> Path:
    """Find the library that a folder is, or that a natural rate left in it.

    Raises:
        InputError: There is none.
    """
    for folder in (place, place / "weighted", place / "library"):
        if (folder / MANIFEST).exists():
            return folder
    raise InputError(
        f"{place} is no folder of run or rate and no library of cases; name one that cornerforge run, rate --out or "
        "generate made."
    )
