"""`export` writes cases of a library for other tools."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cornerforge._checks import check_in
from cornerforge.errors import InputError
from cornerforge.interchange.cases import OutCase
from cornerforge.library import CaseLibrary
from cornerforge.pipeline.case_facts import CaseFacts
from cornerforge.pipeline.output import check_path, config_hash, open_output, provenance, write_json
from cornerforge.pipeline.progress import NO_PROGRESS, Progress
from cornerforge.results.whole import Exported

__all__ = ["EXPORTS", "export"]

_AFTER = 50
"""Progress is told after so many cases."""


@dataclass(frozen=True)
class _Options:
    version: str
    mode: str


@dataclass(frozen=True)
class ExportFormat:
    """A format for other tools.

    Attributes:
        label: For people.
        write: Writes a case into a folder and returns the names of its files.
    """

    label: str
    write: Callable[[OutCase, Path, _Options], Sequence[str]]


def _openscenario(case: OutCase, folder: Path, options: _Options) -> Sequence[str]:
    from cornerforge.interchange.openscenario import write_openscenario

    return write_openscenario(case, folder, version=options.version, mode=options.mode)


def _commonroad(case: OutCase, folder: Path, options: _Options) -> Sequence[str]:  # noqa: ARG001
    from cornerforge.interchange.commonroad import write_commonroad

    return write_commonroad(case, folder)


def _table(ending: str) -> Callable[[OutCase, Path, _Options], Sequence[str]]:
    def write(case: OutCase, folder: Path, options: _Options) -> Sequence[str]:  # noqa: ARG001
        from cornerforge.interchange.tables import write_table

        name = f"{case.name}.{ending}"
        write_table(case, folder / name)
        return (name,)

    return write


def _rerun(case: OutCase, folder: Path, options: _Options) -> Sequence[str]:  # noqa: ARG001
    from cornerforge.interchange.rerun_file import write_rerun

    name = f"{case.name}.rrd"
    write_rerun(case, folder / name)
    return (name,)


EXPORTS: Mapping[str, ExportFormat] = {
    "openscenario": ExportFormat("OpenSCENARIO and OpenDRIVE (XML)", _openscenario),
    "commonroad": ExportFormat("CommonRoad (XML)", _commonroad),
    "csv": ExportFormat("table (CSV)", _table("csv")),
    "parquet": ExportFormat("table (Parquet)", _table("parquet")),
    "rerun": ExportFormat("rerun recording (.rrd)", _rerun),
}
"""The formats by name."""


def export(
    library: Path | str,
    cases: Sequence[str] | str,
    *,
    to: str,
    out: Path | str,
    version: str = "1.2",
    mode: str = "recorded",
    resume: bool = False,
    progress: Progress = NO_PROGRESS,
) -> Exported:
    """Write cases for other tools.

    Args:
        library: The library's folder.
        cases: Case ids, or "all".
        to: A name of `EXPORTS`.
        out: Folder for the files, new or empty.
        version: Of OpenSCENARIO: 1.0, 1.1, 1.2 or 1.3.
        mode: Of OpenSCENARIO (`interchange.openscenario.write_openscenario`): recorded, controller or relative.
        resume: Go on with what an earlier call that was ended left.
        progress: Told how far it is.

    Returns:
        What `cornerforge export --json` prints.

    Raises:
        CornerForgeError: No such case or format, the library cannot be read, an extra is missing, or the folder cannot
            be used.
    """
    began = time.perf_counter()
    check_in("format", to, tuple(EXPORTS))
    options = _Options(version, mode)
    if to != "openscenario" and options != _Options("1.2", "recorded"):
        raise InputError(f"Version and mode are those of openscenario; leave them out for {to}.")
    given, place = Path(library), Path(out)
    check_path(given)
    source = CaseLibrary.open(given.resolve())
    ids = _ids(source, [cases] if isinstance(cases, str) else cases)
    identity = {
        "library": config_hash(source.identity), "to": to, "version": version, "mode": mode, "cases": config_hash({"": ids})
    }  # fmt: skip
    facts = CaseFacts(source)
    open_output(place, identity, resume=resume)
    write = EXPORTS[to].write
    files: dict[str, None] = {}
    for done, stored in enumerate(source.scenarios(ids), 1):
        case_id = str(stored.scalars["case_id"])
        files.update(dict.fromkeys(write(facts.out_case(case_id, stored), place, options)))
        if done % _AFTER == 0 or done == len(ids):
            progress("export", done, len(ids))
    seconds = round(time.perf_counter() - began, 3)
    write_json(place / "provenance.json", provenance(identity, seconds))
    return Exported(cases=len(ids), to=to, out=str(place), files=tuple(files), seconds=seconds)


def _ids(source: CaseLibrary, wanted: Sequence[str]) -> list[str]:
    """Return the wanted ids, each once.

    Raises:
        InputError: There is none.
    """
    if list(wanted) == ["all"]:
        ids = source.scalars(["case_id"])["case_id"].to_pylist()
    else:
        ids = list(dict.fromkeys(wanted))
    if not ids:
        raise InputError(f"There is no case to export; name some of the library {source.path}, or all.")
    return ids
