"""`report` makes the page of anything: of a run, of a natural rate, or of any library of cases."""

from __future__ import annotations

from pathlib import Path

from cornerforge._locks import claim_folder
from cornerforge._options import verb
from cornerforge.errors import InputError
from cornerforge.experiment.output import is_finished_run
from cornerforge.library.manifest import MANIFEST
from cornerforge.results.whole import Reported
from cornerforge.verbs.analyse import analyse
from cornerforge.verbs.options.whole import MakeReport

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

    given = Path(options.place)
    if is_finished_run(given):
        claim_folder(given)
        options.progress("report", 0, 1)
        page = write_report(given)
        options.progress("report", 1, 1)
        return Reported(report=str(page), library=str(given / "library"))
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
    return Reported(report=str(page), library=str(library))


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
