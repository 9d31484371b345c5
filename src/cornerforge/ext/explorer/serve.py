"""`serve` shows the cases of a run, or of a library, in the browser."""

from __future__ import annotations

import contextlib
import shlex
import threading
import warnings
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cornerforge._files import below, real_path
from cornerforge._options import verb
from cornerforge.errors import CornerForgeError, FileFormatError, InputError, MissingExtraError
from cornerforge.experiment.output import SUMMARY, is_finished_run, read_json_file
from cornerforge.ext.explorer.options import Serve
from cornerforge.ext.interchange.beside import analysis_beside, own_folder
from cornerforge.library import CaseLibrary
from cornerforge.library.manifest import MANIFEST
from cornerforge.library.natural import natural_weights
from cornerforge.results.whole import Served

if TYPE_CHECKING:
    from cornerforge.ext.explorer.exhibit import Exhibit
    from cornerforge.ext.explorer.sources import Analysis, Source

__all__ = ["serve", "serve_text"]

_LABELS = {"natural": "Natural traffic", "adversary": "Made by the adversary", "scripted": "Scripted cases"}
_IDLE_S = 2.0
"""Time from the page's first questions to the loading of kernels [s]: earlier it would slow the answers down."""
_ENDS_S = 3.0
"""Longest wait for work in the background when the server ends [s]."""


@verb(Serve, writes=False)
def serve(options: Serve) -> Served:
    """Show the cases of a run or of a library in the browser, until Ctrl-C.

    A library without an analysis beside it is analysed in the background, into the folder LIB-analysis.

    Returns:
        What `cornerforge serve --json` prints, when it has ended.

    Raises:
        CornerForgeError: There is nothing to show, the port is taken, or the page is not built.
    """
    try:
        from cornerforge.ext.explorer.driving import Driving
        from cornerforge.ext.explorer.exhibit import Exhibit
        from cornerforge.ext.explorer.server import open_door, serve_exhibit
    except ModuleNotFoundError as error:
        raise MissingExtraError(str(error.name), "explorer") from error
    given = Path(options.place)
    given = real_path(given)  # . and .. have no name, and a command that is copied holds from any folder
    found = _sources(given)
    driving = Driving(options.avs, found[0].source)
    notes = _warnings(given, found)
    door = open_door(options.host, options.port)
    exhibit = Exhibit(given.name, [(one.source, one.analysis) for one in found], driving, notes)
    served = Served(
        url=door.url, host=door.host, port=door.port, usual_port=door.usual, token=door.token is not None,
        cases=exhibit.table.table.num_rows, sources=tuple(one.source.name for one in found),
    )  # fmt: skip
    stopping = threading.Event()
    behind = threading.Thread(
        target=_behind, args=(exhibit, found, options.threads, stopping), daemon=True, name="cornerforge-analysis"
    )

    def begin() -> None:
        behind.start()
        if served.token:
            warnings.warn(
                f"{served.host} can be reached by other machines. The address is all that is needed to see the cases; "
                "the connection is not encrypted.",
                stacklevel=2,
            )
        options.up(served)
        if options.open_browser:
            webbrowser.open(served.url)

    try:
        serve_exhibit(exhibit, door, begin)
    finally:
        stopping.set()
        if behind.ident is not None:
            behind.join(_ENDS_S)  # a thread that the program cuts off within C++ would end it by abort()
    return served


@dataclass
class _Found:
    """A library, its analysis if there is one, and the folder in which one would be made."""

    source: Source
    analysis: Analysis | None
    folder: Path


def _sources(place: Path) -> list[_Found]:
    """Find the libraries of a folder (its path resolved), natural crashes first.

    Raises:
        InputError: The folder has no library, or none holds a case.
        FileFormatError: One is damaged.
    """
    from cornerforge.ext.explorer.sources import Source, read_analysis

    if (place / MANIFEST).exists():
        libraries = [place]
    else:
        natural = [place / "natural" / "weighted", place / "natural" / "library", place / "weighted"]
        libraries = [one for one in (*natural, place / "library") if (one / MANIFEST).exists()]
    if not libraries:
        raise InputError(
            f"{place} is no folder of run or rate and no library of cases; name one that cornerforge run, rate --out "
            "or generate made."
        )
    found: dict[str, _Found] = {}
    for library in libraries:
        cases = CaseLibrary.open(library)
        if len(cases) == 0:
            continue
        weights = natural_weights(cases)
        on_road = weights is not None  # crashes of trees are stored as scripts, and each has its weight
        name = "natural" if on_road else "scripted" if cases.scripted else "adversary"
        if name in found:
            continue
        replay = f"cornerforge replay {shlex.quote(str(library))}"
        source = Source(name, _LABELS[name], cases, on_road, weights, replay)
        beside = analysis_beside(cases)
        analysis = None if beside is None else read_analysis(beside, cases.path)
        found[name] = _Found(source, analysis, beside or own_folder(library))
    if not found:
        raise InputError(f"There is no case in {place} yet; fill a library with: cornerforge generate, or rate --out")
    return list(found.values())


def _warnings(place: Path, found: Sequence[_Found]) -> list[str]:
    """Say what of a folder is damaged, missing or to be doubted."""
    lines = [line for one in found for line in (*one.source.cases.damaged, *_kept_notes(one.source))]
    lines += [line for one in found if one.source.natural for line in _doubts(one.source)]
    return lines + _absent(place)


def _absent(place: Path) -> list[str]:
    """Say which libraries of a folder are gone: a finished run says which it had."""
    if (place / MANIFEST).exists():
        return []
    wanted: list[tuple[Path, ...]] = [(place / "library",)] if (place / "library").exists() else []
    if is_finished_run(place):
        try:
            said = read_json_file(place / SUMMARY)
        except FileFormatError as error:
            return [str(error)]
        wanted = [(place / "library",)]
        if said.get("natural_cases") is not None:
            wanted.append((place / "natural" / "weighted", place / "natural" / "library"))
    return [
        f"{libraries[-1]} is no library of cases any more, so its cases are missing here; restore it from a copy."
        for libraries in wanted
        if not any((one / MANIFEST).exists() for one in libraries)
    ]


def _behind(exhibit: Exhibit, found: Sequence[_Found], threads: int | None, stopping: threading.Event) -> None:
    """Load the kernels that answers need, then analyse libraries without an analysis; for a thread of its own."""
    from cornerforge.ext.explorer.sources import read_analysis
    from cornerforge.verbs.analyse import analyse

    bare = [one for one in found if one.analysis is None]
    if bare:  # said at once, so that the page asks again
        exhibit.work = {"what": "analyse", "done": 0, "total": len(bare[0].source.cases)}
    stopping.wait(_IDLE_S)
    for one in bare:
        if stopping.is_set():
            return

        def progress(stage: str, done: float, total: float) -> None:
            if stopping.is_set():
                raise KeyboardInterrupt
            exhibit.work = {"what": stage, "done": done, "total": total}

        progress("analyse", 0, len(one.source.cases))
        try:
            with below(str(one.folder.parent)):  # its name is ours, so a link there is a stranger's
                analyse(one.source.cases.path, out=one.folder, threads=threads, progress=progress)
            exhibit.analysed(one.source.name, read_analysis(one.folder, one.source.cases.path))
        except CornerForgeError as error:
            exhibit.warnings.append(f"There is no analysis: {error}")
        except Exception as error:  # a bug; the page goes on, and says so
            line = " ".join(str(error).split())[:200]
            exhibit.warnings.append(f"There is no analysis, by a fault of cornerforge: {type(error).__name__}: {line}")
        except KeyboardInterrupt:
            return
        finally:
            exhibit.work = None
    if not stopping.is_set():
        _warm_up(exhibit, found)


def _warm_up(exhibit: Exhibit, found: Sequence[_Found]) -> None:
    """Ask once what needs files or kernels, so that the first person who asks need not wait."""
    for one in found:
        source = one.source
        case = exhibit.table.first_of(source.name)
        own = str(source.cases.identity["av"])
        for ask in (exhibit.case, exhibit.ghosts, lambda name, of, av=own: exhibit.case_with(name, of, av)):
            with contextlib.suppress(Exception):  # the request that needs it reports the error
                ask(source.name, case)


def _kept_notes(source: Source) -> list[str]:
    """Say where notes of earlier versions are."""
    library = real_path(source.cases.path)  # . and .. have no name
    file = library.with_name(f"{library.name}-notes.json")
    told = f"Notes are no longer shown; those on cases of {library.name} stay in {file}, a text file for any editor."
    return [told] if file.is_file() else []


def _doubts(source: Source) -> list[str]:
    """Say why the rates of natural cases cannot be trusted yet; nothing if they can."""
    from cornerforge.report.artefacts import rate_beside

    rate = rate_beside(source.cases.path)
    if rate is None or not rate.doubts:
        return []
    return [f"How often crashes happen is not to be trusted yet: {'; '.join(rate.doubts)}."]


def serve_text(found: Served) -> str:
    """Write the page's address, and unusual facts about it."""
    from cornerforge.ext.explorer.server import PORT

    taken = "" if found.usual_port else f"Port {PORT} is taken by another program, so it is port {found.port}.\n"
    return f"{taken}{found.cases:,} cases: {found.url} (Ctrl-C ends it)"
