"""`report` makes the page of anything: of a run, of a natural rate, or of any library of cases."""

from __future__ import annotations

from pathlib import Path

from cornerforge._arguments import checked
from cornerforge._locks import claim_folder, claims
from cornerforge.errors import InputError
from cornerforge.execution.progress import NO_PROGRESS, Progress
from cornerforge.experiment.output import is_finished_run
from cornerforge.library.manifest import MANIFEST
from cornerforge.results.whole import Reported
from cornerforge.verbs.analyse import DEFAULT_LOOKS, analyse

__all__ = ["library_of", "make_report"]


@checked
@claims()
def make_report(
    place: Path | str,
    *,
    out: Path | str = "cornerforge-report",
    avoidability: int | str = DEFAULT_LOOKS,
    reaction: float = 0.0,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = NO_PROGRESS,
) -> Reported:
    """Make `report.html` of a run or of a library, whichever AV and adversary made it.

    Args:
        place: A folder of `run`, whose page is written again from what it holds; of `rate`; or a library.
        out: For a library: folder of `report.html` and `analysis/`; new or empty, or with the same analysis. The page
            of a run stays in its folder, so this is not used.
        avoidability, reaction, seed: Of the analysis of a library, as for `analyse`.
        threads: None for all cores; does not change the result.
        progress: Told how far it is.

    Returns:
        What `cornerforge report --json` prints: where the page is.

    Raises:
        CornerForgeError: There is nothing to make a page of, or a file or output place is not right.
    """
    from cornerforge.report import write_library_report, write_report

    given = Path(place)
    if is_finished_run(given):
        claim_folder(given)
        progress("report", 0, 1)
        page = write_report(given)
        progress("report", 1, 1)
        return Reported(report=str(page), library=str(given / "library"))
    library = library_of(given)
    folder = Path(out)
    claim_folder(folder)
    analyse(
        library, out=folder / "analysis", avoidability=avoidability, reaction=reaction, seed=seed, threads=threads,
        progress=progress,
    )  # fmt: skip
    progress("report", 0, 1)
    page = write_library_report(library, folder)
    progress("report", 1, 1)
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
