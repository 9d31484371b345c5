"""The analysis that lies beside a library, if there is one."""

from __future__ import annotations

from pathlib import Path

from cornerforge.errors import CornerForgeError
from cornerforge.experiment.output import read_json_file
from cornerforge.ext.explorer.sources import FILES
from cornerforge.library import CaseLibrary

__all__ = ["analysis_beside", "own_folder"]


def own_folder(library: Path) -> Path:
    """Name the folder for a library's analysis that lies beside it."""
    return library.parent / f"{library.name}-analysis"


def analysis_beside(cases: CaseLibrary) -> Path | None:
    """Find the whole analysis of a library: `analysis` or LIB-analysis in the same folder; None: it does not exist.

    It must be of the library as it is now. The library's path must have a name (`Path.resolve`).
    """
    places = (cases.path.parent / "analysis", own_folder(cases.path))
    return next((one for one in places if _is_of(one, cases)), None)


def _is_of(folder: Path, cases: CaseLibrary) -> bool:
    if not all((folder / name).is_file() for name in (*FILES, "provenance.json")):
        return False
    try:
        identity = read_json_file(folder / "provenance.json").get("identity")
    except CornerForgeError:
        return False
    of = {**cases.identity, "cases": len(cases)}
    return isinstance(identity, dict) and all(identity.get(key) == value for key, value in of.items())
